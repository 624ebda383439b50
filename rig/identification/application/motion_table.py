"""Motion and current from a table of a user's: columns by name, everything that is wrong with them said at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.errors import FileProblem

if TYPE_CHECKING:
    import pandas as pd

    Table = pd.DataFrame | Mapping[str, Any]

#: Quantity -> names of its column: with its unit, then as recorded files call it.
COLUMNS = {
    "time_s": ("time_s", "time"),
    "displacement_m": ("displacement_m", "displacement"),
    "velocity_m_s": ("velocity_m_s", "velocity"),
    "acceleration_m_s2": ("acceleration_m_s2", "acceleration"),
    "current_A": ("current_A", "current"),
    "temperature_degC": ("temperature_degC", "coil_temperature"),
}
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
            without a time).
        mid_stroke_m: the displacement at mid-stroke (m).
        needs_time: why the time is needed; empty where it is not.
        also: further columns of the table that must hold numbers.

    Raises:
        FileProblem: what is missing, there twice, no numbers, or of another length; all of it.
    """
    import pandas as pd

    frame = table if isinstance(table, pd.DataFrame) else _frame(table)
    problems = _twice(frame, also)
    arrays = {name: _column(frame, name, problems) for name in COLUMNS}
    for name in also:
        _numbers(frame, name, problems)
    time_s = arrays["time_s"]
    if str(frame.index.name) in COLUMNS["time_s"]:
        index_s = np.asarray(frame.index, dtype=float)
        if time_s is not None and not np.array_equal(time_s, index_s):
            problems.append(
                "time: the index and the column have different values, expected only one of them. Fix: remove one"
            )
        time_s = index_s if time_s is None else time_s
    dt_s = _interval_s(time_s, problems)
    for name in ("displacement_m", "current_A"):
        if arrays[name] is None and not _named(frame, name):
            problems.append(f"column `{name}`: missing; got columns {', '.join(map(str, frame.columns)) or 'none'}")
    if time_s is None and needs_time:
        problems.append(f"column `time_s` (s): missing, and {needs_time}")
    elif time_s is None and not _named(frame, "velocity_m_s"):
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


def _frame(table: Mapping[str, Any]) -> pd.DataFrame:
    """Columns of equal length, numbers repeated.

    Raises:
        FileProblem: arrays of different lengths.
    """
    import pandas as pd

    sizes = {str(name): np.atleast_1d(np.asarray(values)).shape for name, values in table.items() if values is not None}
    longest = max((shape[0] for shape in sizes.values()), default=0)
    if wrong := [f"`{name}`: got shape {shape}, expected ({longest},)" for name, shape in sizes.items()
                 if shape not in {(longest,), (1,)}]:  # fmt: skip
        raise FileProblem("the table", wrong)
    return pd.DataFrame({name: np.broadcast_to(np.atleast_1d(np.asarray(table[name])), (longest,)) for name in sizes})


def _twice(frame: pd.DataFrame, also: Sequence[str]) -> list[str]:
    """Quantities that several columns contain, so that the intended one is unknown."""
    problems = []
    for names in (*COLUMNS.values(), *((name,) for name in also)):
        given = [str(column) for column in frame.columns if column in names]
        if len(given) > 1:
            problems.append(
                f"columns {' and '.join(f'`{name}`' for name in given)}: both contain the same quantity. Fix: "
                "remove one"
            )
    return problems


def _named(frame: pd.DataFrame, name: str) -> str | None:
    return next((column for column in COLUMNS[name] if column in frame), None)


def _column(frame: pd.DataFrame, name: str, problems: list[str]) -> FloatArray | None:
    column = _named(frame, name)
    return None if column is None else _numbers(frame, column, problems, empty=name == "temperature_degC")


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
        problems.append("`time_s`: expected at least two rows, strictly increasing")
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
