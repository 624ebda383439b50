"""Columns of a table from a notebook: the quantity and unit of each one, and the time column."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.errors import DataWarning, FileProblem
from rig.recording.external_tests import LARGEST, implausible, uniform_times, without_no_value
from rig.recording.file_formats.csv_dialect import is_stamp
from rig.recording.file_formats.file_units import named_unit, units_for
from rig.recording.file_formats.named_columns import TIMES, NamedQuantity, named_quantity, time_name
from rig.recording.file_formats.text_cells import numbers_of_cells, seconds_of_dates, seconds_of_stamps
from rig.signals.arrays import FloatArray
from rig.signals.sample_times import SampleTimes
from rig.units import DIMENSIONS, Unit

if TYPE_CHECKING:
    import pandas as pd

DATES = frozenset(("time", "t", "date", "datetime", "timestamp"))
"""Beginnings of the names of columns of dates."""
SAME_TIME_s = 1e-6
"""Two columns of time may differ by so much, and by a millionth of their span."""


@dataclass
class TableUnits:
    """Units of a table's columns as the user states them: by `units=`, or in the table's attribute `units`.

    `assumed` collects the columns without any, each with the SI unit it is taken in.
    """

    stated: Mapping[str, str]
    attribute: Mapping[str, str]
    assumed: dict[str, str] = field(default_factory=dict)

    def of(self, column: str, named: NamedQuantity) -> Unit:
        """The unit of a column.

        Args:
            column: its name.
            named: the quantity and the unit in that name.

        Raises:
            ValueError: unknown, of another dimension, or contradicting the name.
        """
        dimension, by_name = named.dimension, named.unit
        text = self.stated.get(column, self.stated.get(named.channel, self.attribute.get(column)))
        if text is None:
            if by_name is None:
                self.assumed[column] = DIMENSIONS[dimension].si
            return by_name or units_for(dimension)[DIMENSIONS[dimension].si]
        unit = named_unit(str(text), dimension)
        if unit is None:
            known = ", ".join(units_for(dimension))
            raise ValueError(f"column {column!r}: {text!r} is not a unit of {dimension}; known units: {known}")
        if by_name is not None and by_name != unit[1]:
            raise ValueError(f"column {column!r}: the name states {named.suffix}, but the stated unit is {text}")
        return unit[1]


def table_channels(
    table: pd.DataFrame, where: str, units: Mapping[str, str] | None = None, accept: Sequence[str] = ()
) -> tuple[dict[str, FloatArray], SampleTimes | None]:
    """The channels of a table in SI, each (n,), with `time` in s, and how the times were found behind its stamps.

    Columns of texts that are no quantity are left out. Infinite values and numbers that stand for no value become NaN,
    stamps with few digits the uniform rate behind them, as in files (`rig.recording.external_tests`).

    Args:
        table: one row a sample. A column is `displacement`, `force`, `velocity`, `current` (or `current_measured`),
            `commanded_current` or `coil_temperature`, with its unit at the end (`force_kN`), in `units`, or in
            `table.attrs["units"]`; without any it is taken in SI, with a warning. Other numeric columns are kept.
        where: what to call the table in an error.
        units: column or quantity -> unit.
        accept: slugs of implausible sizes that are right all the same.

    Raises:
        FileProblem: a column is missing, there twice, empty or no numbers; a unit is not known; sizes that no test
            has; no time, or one that does not increase.
    """
    if not table.columns.is_unique:
        twice = sorted({str(name) for name in table.columns[table.columns.duplicated()]})
        raise FileProblem(where, [
            f"the table has several columns named {name!r}. Fix: rename all but one" for name in twice
        ])
    attribute = table.attrs.get("units", {})
    known = TableUnits(units or {}, attribute if isinstance(attribute, Mapping) else {})
    time_s, time_column = table_time(table, where, known)
    channels: dict[str, FloatArray] = {}
    source: dict[str, str] = {}
    problems = []
    for column in table:
        name = str(column)
        if name == time_column or time_name(name) in TIMES:
            continue
        try:
            quantity, values = _channel(table[column], name, known)
        except ValueError as error:
            problems.append(str(error))
            continue
        if values is None:
            continue
        if quantity in source:
            problems.append(f"columns {source[quantity]!r} and {name!r} both contain the {quantity}. Fix: remove one")
        channels[quantity], source[quantity] = values, name
    problems += [f"the table has no column {name!r}; its columns: {list(table)}" for name in ("displacement", "force")
                 if name not in channels and not problems]  # fmt: skip
    unused = [name for name in known.stated if name not in {*map(str, table), *channels, "time"}]
    problems += [f"units: the table has no column {name!r}; its columns: {list(table)}" for name in unused]
    if problems:
        raise FileProblem(where, problems)
    empty = [name for name in ("displacement", "force") if not np.any(np.isfinite(channels[name]))]
    if empty:
        raise FileProblem(where, [
            f"{name}: none of {len(time_s)} rows contains a number. Fix: specify another column" for name in empty
        ])
    channels = {"time": time_s, **channels}
    times = uniform_times(channels)
    wrong = np.flatnonzero(~(np.diff(channels["time"]) > 0.0))
    if len(wrong):
        row = int(wrong[0]) + 1
        now_s, before_s = channels["time"][row], channels["time"][row - 1]
        raise FileProblem(where, [
            f"row {row}: time {now_s:.9g} s is not after {before_s:.9g} s ({len(wrong)} such rows); the time "
            "must increase from row to row, and no uniform sampling rate was found. Fix: sort the rows; for several "
            "tests in one table, use rig.load(table, by=COLUMN); or set the time: table.index = "
            "pd.Index(np.arange(len(table)) / rate_Hz, name='time_s')"
        ])
    doubts = list(implausible(channels, source, accept))
    if doubts:
        way_out = "Fix: specify units=dict(displacement='mm', ...), or accept=(SLUG,) to accept the value"
        raise FileProblem(where, [*doubts, way_out])
    if known.assumed:
        units_text = ", ".join(f"{name} in {unit}" for name, unit in known.assumed.items())
        warnings.warn(f"{where}: columns without a unit are assumed to be in SI units: {units_text}. "
            "Specify the units with units=dict(force='kN'), with table.attrs['units'], or in names such as "
            "force_kN", stacklevel=3)  # fmt: skip
    return channels, times


def check_current(current_A: object, where: str) -> None:
    """Refuse what is no coil current of a damper.

    Raises:
        FileProblem: no finite number, or beyond the largest current.
    """
    most_A = LARGEST["current"][0]
    if not isinstance(current_A, (int, float, np.integer, np.floating)) or not abs(float(current_A)) <= most_A:
        raise FileProblem(where, [f"current_A = {current_A!r}, expected a number (A) of at most {most_A:g}"])


def _channel(column: pd.Series, name: str, known: TableUnits) -> tuple[str, FloatArray | None]:
    """The quantity of a column and its values in SI; None where it is a column of texts that is not needed.

    Raises:
        ValueError: its unit does not fit, or it must be numbers and is not.
    """
    stated = named_quantity(name)
    quantity = name if stated is None else stated.channel
    try:
        values = _numbers(column)
    except (ValueError, TypeError) as error:
        if stated is None:
            warnings.warn(f"column {name!r} contains text and is left out", DataWarning, stacklevel=4)
            return quantity, None
        raise ValueError(f"column {name!r} must contain numbers: {error}") from error
    values, notes = without_no_value(values, None)
    for note in notes:
        warnings.warn(f"column {name!r}: {note}", DataWarning, stacklevel=4)
    if stated is None:
        return quantity, values
    unit = known.of(name, stated)
    return quantity, np.asarray(values * unit.scale + unit.offset, np.float64)


def _numbers(column: Any) -> FloatArray:  # noqa: ANN401 - an index or a series
    """A column's numbers; in a column of texts as in a file.

    Raises:
        ValueError: not all are numbers.
        TypeError: likewise.
    """
    return np.asarray(column.to_numpy(np.float64) if column.dtype.kind in "biuf" else numbers_of_cells(column))


def table_time(
    table: pd.DataFrame, where: str, known: TableUnits | None = None
) -> tuple[FloatArray, str | None]:
    """Time of every row and the column that held it.

    An index or a column is a time when it holds dates or durations (the first row is then 0 s), or is named `time` or
    `t`, with its unit (`_s`, `_ms`, `_us`, `_ns`, or as stated) or without (s); an index also when it has no name and
    is not whole numbers. What has a unit goes before what has none. Row numbers are no time.

    Args:
        table: one row a sample.
        where: what to call the table in an error.
        known: the units that the user states.

    Returns:
        Time in s, (n,), and the column's name; None where the index is the time.

    Raises:
        FileProblem: there is none, or several that differ; or it is not finite in two rows or more.
    """
    known = known or TableUnits({}, {})
    certain: list[tuple[str | None, FloatArray]] = []
    bare: list[tuple[str | None, FloatArray]] = []
    for name, source in ((None, table.index), *((str(name), table[name]) for name in table)):
        kind = _kind_of_time(source, name, known)
        if kind:
            (certain if kind == "certain" else bare).append((name, _seconds(source, where, known)))
    differing = [name for name, time_s in certain[1:] if not _same(certain[0][1], time_s)]
    if differing:
        names_text = ", ".join("the index" if name is None else repr(name) for name, _time_s in certain)
        raise FileProblem(
            where, [f"the table has several different time columns: {names_text}. Fix: remove all but one"]
        )
    times = certain or bare
    if not times:
        raise FileProblem(where, [
            f"the table has no time: its index ({table.index.name or 'without a name'}) only numbers the rows. Fix: "
            "add a column `time_s`, or set the index to the time in s: table.index = pd.Index(time_s, name='time_s')"
        ])  # fmt: skip
    column, time_s = times[0]
    if not certain:
        known.assumed["the index" if column is None else column] = "s"
    if len(time_s) < 2 or not np.all(np.isfinite(time_s)):
        name = "index" if column is None else f"column {column!r}"
        raise FileProblem(where, [
            f"the time ({name}, in s) must have two or more rows of numbers and increase from row to row"
        ])
    return time_s, column


def _kind_of_time(source: Any, column: str | None, known: TableUnits) -> str:  # noqa: ANN401 - an index or a series
    """`certain`, `bare` (a time without a unit), or empty: no time."""
    if getattr(source, "nlevels", 1) > 1:
        return ""
    name = "" if source.name is None else time_name(source.name)
    dates = source.dtype.kind in "mM" or hasattr(source.dtype, "tz")
    if dates or _is_stamps(source):
        return "certain" if column is None or name.split("_")[0] in DATES else ""
    stated = _stated_unit(source, known) is not None
    if name in TIMES and (stated or "_" in name):
        return "certain"
    if name not in TIMES and not (column is None and not name and source.dtype.kind == "f"):
        return ""
    if source.dtype.kind not in "iuf":
        return "bare" if column is not None else ""
    values = source.to_numpy(np.float64)
    counts = np.array_equal(values, np.round(values)) and bool(np.all(np.diff(values) == 1.0)) if name else (
        np.array_equal(values, np.round(values)))  # fmt: skip
    return "" if counts else "bare"


def _stated_unit(source: Any, known: TableUnits) -> str | None:  # noqa: ANN401 - an index or a series
    name = str(source.name)
    return known.stated.get(name, known.stated.get("time", known.attribute.get(name)))


def _is_stamps(source: Any) -> bool:  # noqa: ANN401 - an index or a series
    """Whether a column's texts are time stamps, by its first one."""
    first = getattr(source, "iloc", source)[:1].tolist()  # pandas 2 takes a slice of a float index for labels
    return bool(first) and isinstance(first[0], str) and is_stamp(first[0].strip())


def _of_stamps(source: Any, where: str) -> FloatArray:  # noqa: ANN401 - an index or a series
    try:
        return seconds_of_stamps(source.tolist())[0]
    except (ValueError, OverflowError) as error:
        problem = (
            f"the time in {source.name!r}: {error}. Fix: repair the row, or write all time stamps in the same "
            "format"
        )
        raise FileProblem(where, [problem]) from error


def _same(one: FloatArray, other: FloatArray) -> bool:
    """Whether two times have the same steps; dates count from the first row."""
    steps = (one - one[:1]) - (other - other[:1])
    largest = SAME_TIME_s + 1e-6 * float(np.max(np.abs(one - one[:1]), initial=0.0))
    return bool(np.all(np.abs(steps) <= largest))


def _seconds(source: Any, where: str, known: TableUnits) -> FloatArray:  # noqa: ANN401 - an index or a series
    if source.dtype.kind in "mM" or hasattr(source.dtype, "tz"):
        values = source.to_numpy()
        if source.dtype.kind == "M" or hasattr(source.dtype, "tz"):
            values = source.to_numpy("datetime64[ns]")
        return seconds_of_dates(values)
    if _is_stamps(source):
        return _of_stamps(source, where)
    name, stated = time_name(source.name), _stated_unit(source, known)
    scale = TIMES.get(name, 1.0)
    if stated is not None:
        unit = named_unit(str(stated), "time")
        if unit is None or ("_" in name and unit[1].scale != scale):
            problem = (
                f"the time in {source.name!r}: {stated!r} is not a unit of time or contradicts the unit in its "
                "name"
            )
            raise FileProblem(where, [problem])
        scale = unit[1].scale
    try:
        return np.asarray(_numbers(source) * scale, np.float64)
    except (ValueError, TypeError) as error:
        raise FileProblem(where, [f"the time in {source.name!r} is not a number: {error}"]) from error
