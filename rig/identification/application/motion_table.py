"""Motion and current from a table of a user's: columns by name, everything that is wrong with them said at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.errors import FileProblem
from rig.recording.file_formats.file_units import named_unit, units_for
from rig.recording.file_formats.named_columns import TIMES, NamedQuantity, named_quantity, time_name
from rig.recording.recorded_point import RecordedPoint

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

    Table = pd.DataFrame | Mapping[str, Any] | RecordedPoint | ArrayLike

COLUMNS = {
    "time": "time_s", "displacement": "displacement_m", "velocity": "velocity_m_s",
    "acceleration": "acceleration_m_s2", "current": "current_A", "coil_temperature": "temperature_degC",
}  # fmt: skip
"""Quantity as recorded files call it -> its name in SI. A column has either name, one of our exports, or its quantity
with another unit (`displacement_mm`)."""
STEMS = {"acceleration": ("acceleration", "acceleration"), "temperature": ("coil_temperature", "temperature")}
"""Names of columns besides those of recordings."""
POSITIONAL = ("displacement_m", "velocity_m_s", "current_A")
"""Columns of a plain array."""
UNEVEN = 0.1  # share by which an interval may differ from the mean one


@dataclass(frozen=True)
class Motion:
    """Motion about mid-stroke and current, arrays of shape (n,) in SI.

    Attributes:
        index: the table's index, or the time.
        time_s: time (s); None without any.
        dt_s: sampling interval (s); 0 without a time.
        u_m: extension about mid-stroke (m).
        v_m_s: velocity (m/s).
        a_m_s2: acceleration (m/s^2).
        current_A: coil current (A).
        temperature_degC: temperature (degC); None without any.
    """

    index: Any
    time_s: FloatArray | None
    dt_s: float
    u_m: FloatArray
    v_m_s: FloatArray
    a_m_s2: FloatArray
    current_A: FloatArray
    temperature_degC: FloatArray | None = None


def motion_of(table: Table, mid_stroke_m: float, *, needs_time: str = "", also: Sequence[str] = ()) -> Motion:
    """Read motion and current from a table.

    Args:
        table: columns as in `COLUMNS`; the time may be the index if that is called so. `displacement_m` and `current_A`
            are needed; velocity is differentiated from displacement where it is missing, acceleration from velocity (0
            without a time). A recorded point is the table of its channels; of an array the columns are `POSITIONAL`.
        mid_stroke_m: the displacement at mid-stroke (m).
        needs_time: why the time is needed; empty where it is not.
        also: further columns of the table that must hold numbers.

    Raises:
        FileProblem: what is missing, there twice, no numbers, or of another length; all of it.
    """
    frame, problems = _in_si(_frame(table), also)
    arrays = {name: _column(frame, name, problems) for name in COLUMNS.values()}
    for name in also:
        _numbers(frame, name, problems)
    time_s = arrays["time_s"]
    scale = TIMES.get(time_name(frame.index.name))
    if scale is not None:
        index_s = scale * np.asarray(frame.index, dtype=float)
        if time_s is not None and not np.array_equal(time_s, index_s):
            problems.append(
                "time: the index and the column have different values, expected only one of them. Fix: remove one"
            )
        time_s = index_s if time_s is None else time_s
    dt_s = _interval_s(time_s, problems)
    for name in ("displacement_m", "current_A"):
        if arrays[name] is None and name not in frame:
            problems.append(f"column `{name}`: missing; got columns {', '.join(map(str, frame.columns)) or 'none'}")
    if time_s is None and needs_time:
        problems.append(f"column `time_s` (s): missing, and {needs_time}")
    elif time_s is None and "velocity_m_s" not in frame:
        problems.append(
            "column `velocity_m_s`: missing. Fix: add this column, or add `time_s` so that the displacement can be "
            "differentiated"
        )
    if len(frame) == 0:
        problems.append("no rows")
    if problems:
        raise FileProblem("the table", problems)
    u_m = _sure(arrays["displacement_m"]) - mid_stroke_m
    velocity = arrays["velocity_m_s"]
    v_m_s = _slope(u_m, dt_s) if velocity is None else velocity
    acceleration = arrays["acceleration_m_s2"]
    a_m_s2 = acceleration if acceleration is not None else _slope(v_m_s, dt_s) if dt_s > 0.0 else np.zeros_like(u_m)
    current_A = _sure(arrays["current_A"])
    return Motion(frame.index, time_s, dt_s, u_m, v_m_s, a_m_s2, current_A, arrays["temperature_degC"])


def table_of(table: Table | None, given: Mapping[str, ArrayLike | None]) -> tuple[Table, float]:
    """The table that a call of `predict` means, and the mid-stroke (m) that it states.

    Args:
        table: of any kind; with columns in `given`, a plain array is the displacement (m); None: `given` alone.
        given: columns by their names in SI; None: not given.

    Raises:
        FileProblem: a table and columns are both given.
    """
    columns = {name: values for name, values in given.items() if values is not None}
    if table is None:
        return columns, 0.0
    if isinstance(table, RecordedPoint):
        if columns:
            raise FileProblem("predict", [_both(columns)])
        return _table_of_point(table)
    if not columns:
        return table, 0.0
    if hasattr(table, "columns") or isinstance(table, Mapping) or "displacement_m" in columns:
        raise FileProblem("predict", [_both(columns)])
    return {"displacement_m": table, **columns}, 0.0


def _both(columns: Mapping[str, object]) -> str:
    return (
        f"got both a table and the arguments {', '.join(columns)}, expected only one of these. Fix: add these columns "
        "to the "
        "table, or pass every quantity as an argument"
    )


def _table_of_point(point: RecordedPoint) -> tuple[Table, float]:
    """The channels of a point with the current that a fit takes of it, where it moved, and its mid-stroke (m).

    The current has no gaps: at the ends of a recording the samples of its source may begin later or end earlier.
    """
    from rig.identification.points.channels import current_at  # reads recordings

    table = point.to_pandas()
    table["current"], _ = current_at(point, point.time_s, [])
    middle_m = float(np.nanmean(point.displacement_m)) if point.mid_stroke_m is None else point.mid_stroke_m
    return table, middle_m


def _frame(table: Table) -> pd.DataFrame:
    """A table of any kind as one of pandas: numbers in a mapping repeated, columns of an array by `POSITIONAL`.

    Raises:
        FileProblem: arrays of different lengths or shapes, or no table.
    """
    import pandas as pd

    if isinstance(table, pd.DataFrame):
        return table
    if isinstance(table, RecordedPoint):
        return table.to_pandas()
    if isinstance(table, np.ndarray) and table.dtype.names is not None:
        return pd.DataFrame({name: table[name] for name in table.dtype.names})
    if not isinstance(table, Mapping):
        values = np.asarray(table)
        if values.ndim != 2 or values.shape[1] != len(POSITIONAL) or values.dtype.kind not in "biuf":
            raise FileProblem("the table", [
                f"got {type(table).__name__} of shape {values.shape}, expected a DataFrame, a mapping of columns, or "
                f"an array of shape (n, {len(POSITIONAL)}) with the columns {', '.join(POSITIONAL)}"
            ])  # fmt: skip
        return pd.DataFrame(values, columns=list(POSITIONAL))
    sizes = {str(name): np.atleast_1d(np.asarray(values)).shape for name, values in table.items() if values is not None}
    longest = max((shape[0] for shape in sizes.values()), default=0)
    if wrong := [f"`{name}`: got shape {shape}, expected ({longest},)" for name, shape in sizes.items()
                 if shape not in {(longest,), (1,)}]:  # fmt: skip
        raise FileProblem("the table", wrong)
    return pd.DataFrame({name: np.broadcast_to(np.atleast_1d(np.asarray(table[name])), (longest,)) for name in sizes})


def _in_si(frame: pd.DataFrame, also: Sequence[str]) -> tuple[pd.DataFrame, list[str]]:
    """The table with its quantities in SI, called as in `COLUMNS`, and what is wrong with its columns.

    A unit is that of the column's name or of the table's attribute `units`; a name without any is in SI.
    """
    stated = frame.attrs.get("units", {})
    sources: dict[str, list[str]] = {}
    problems: list[str] = []
    columns: dict[str, Any] = {}
    for place, name in enumerate(map(str, frame.columns)):
        quantity = named_quantity(name, STEMS)
        seconds = TIMES.get(time_name(name))
        target = "time_s" if seconds is not None else None if quantity is None else COLUMNS.get(quantity.channel)
        if target is None or name in also:
            sources.setdefault(name, []).append(name)
            columns.setdefault(name, frame.iloc[:, place])
            continue
        sources.setdefault(target, []).append(name)
        if target in columns:
            continue
        columns[target] = frame.iloc[:, place]
        text = stated.get(name) if isinstance(stated, Mapping) else None
        try:
            scale, offset = _unit_of(name, None if text is None else str(text), quantity, seconds)
            if (scale, offset) != (1.0, 0.0):
                columns[target] = columns[target] * scale + offset
        except (ValueError, TypeError) as error:
            problems.append(f"column `{name}`: {error}")
    twice = [
        f"columns {' and '.join(f'`{name}`' for name in names)}: both contain the same quantity. Fix: remove one"
        for target, names in sources.items() if len(names) > 1 and (target in COLUMNS.values() or target in also)
    ]
    converted = _with_index(columns, frame)
    return converted, [*twice, *problems]


def _with_index(columns: Mapping[str, Any], like: pd.DataFrame) -> pd.DataFrame:
    """Columns with the index of a table."""
    import pandas as pd

    return pd.DataFrame(columns, index=like.index)


def _unit_of(name: str, text: str | None, found: NamedQuantity | None, seconds: float | None) -> tuple[float, float]:
    """Scale and offset of a column to SI.

    Raises:
        ValueError: the stated unit is not one of the quantity, or contradicts the name.
    """
    by_name = None if found is None else found.unit
    scale, offset = (seconds or 1.0, 0.0) if by_name is None else (by_name.scale, by_name.offset)
    if text is None:
        return scale, offset
    dimension = "time" if found is None else found.dimension
    unit = named_unit(text, dimension)
    if unit is None:
        raise ValueError(f"the table states the unit {text!r}, expected one of {', '.join(units_for(dimension))}")
    own = by_name is not None or (found is None and "_" in time_name(name))
    if own and (unit[1].scale, unit[1].offset) != (scale, offset):
        raise ValueError(f"the name and the stated unit {text!r} contradict each other")
    return unit[1].scale, unit[1].offset


def _column(frame: pd.DataFrame, name: str, problems: list[str]) -> FloatArray | None:
    return _numbers(frame, name, problems, empty=name == "temperature_degC") if name in frame else None


def _numbers(frame: pd.DataFrame, column: str, problems: list[str], *, empty: bool = False) -> FloatArray | None:
    """A column's values, the first one's of several; what is no number is a problem, unless it may be left empty."""
    try:
        values = np.ascontiguousarray(frame.loc[:, frame.columns == column].iloc[:, 0].to_numpy(), dtype=float)
    except (TypeError, ValueError) as error:
        problems.append(f"column `{column}`: got non-numeric values, expected numbers: {error}")
        return None
    broken = np.flatnonzero(~np.isfinite(values))
    if broken.size and not empty:
        problems.append(
            f"column `{column}`, row {broken[0]}: got {values[broken[0]]:g} ({broken.size} such rows), expected finite "
            "numbers. Fix: remove these rows, or interpolate the values"
        )
    return values


def _interval_s(time_s: FloatArray | None, problems: list[str]) -> float:
    """Sampling interval (s); 0 without a time."""
    if time_s is None:
        return 0.0
    steps = np.diff(time_s)
    if steps.size == 0 or not np.all(steps > 0.0):
        problems.append("`time_s`: expected at least two rows with strictly increasing values")
        return 0.0
    dt_s = float(np.mean(steps))
    worst = int(np.argmax(np.abs(steps - dt_s)))
    if abs(float(steps[worst]) - dt_s) > UNEVEN * dt_s:
        problems.append(
            f"`time_s`: got a step of {float(steps[worst]):.4g} s before row {worst + 1}, expected even spacing "
            f"({dt_s:.4g} s on average). Fix: resample the table"
        )
    return dt_s


def _slope(values: FloatArray, dt_s: float) -> FloatArray:
    """Derivative in time, central differences, shape (n,)."""
    return np.ascontiguousarray(np.gradient(values, dt_s, edge_order=2 if values.size > 2 else 1))


def _sure(values: FloatArray | None) -> FloatArray:
    return np.zeros(0) if values is None else values
