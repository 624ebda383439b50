"""The time (s) of a table's rows: from its index or a column that says it is a time, never from row numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rig.errors import FileProblem
from rig.recording.layout import FloatArray

if TYPE_CHECKING:
    import pandas as pd

SECONDS = {"": 1.0, "_s": 1.0, "_ms": 1e-3, "_us": 1e-6, "_ns": 1e-9}
NAMES = {f"{stem}{end}": scale for stem in ("time", "t") for end, scale in SECONDS.items()}
"""Names of a time (lower case) -> seconds per unit."""


def table_time(table: pd.DataFrame, where: str) -> tuple[FloatArray, str | None]:
    """Time of every row and the column that held it.

    An index counts as time when it holds dates or durations (the first row is then 0 s), when it is named `time` or `t`
    (with `_s`, `_ms`, `_us`, `_ns`; without: s), or when it has no name and is not whole numbers. Else a column of such
    a name does.

    Args:
        table: one row a sample.
        where: what to call the table in an error.

    Returns:
        Time in s, (n,), and the column's name; None where the index is the time.

    Raises:
        FileProblem: neither is a time; or it is not finite, or does not increase.
    """
    named = {str(name).lower(): name for name in table.columns}
    column = next((named[name] for name in NAMES if name in named), None)
    if _is_time(table.index):
        column, time_s = None, _seconds(table.index, where)
    elif column is not None:
        time_s = _seconds(table[column], where)
    else:
        raise FileProblem(where, [
            f"the table has no time: its index ({table.index.name or 'without a name'}) counts rows; give a column "
            "`time_s`, or set the index to the time in s: table.index = pd.Index(time_s, name='time_s')"
        ])  # fmt: skip
    if len(time_s) < 2 or not np.all(np.diff(time_s) > 0.0) or not np.all(np.isfinite(time_s)):
        name = "index" if column is None else f"column {column!r}"
        raise FileProblem(where, [f"the time ({name}, in s) must increase from row to row, two rows or more"])
    return time_s, column


def _is_time(index: pd.Index) -> bool:
    if index.nlevels > 1:
        return False
    if index.dtype.kind in "mM" or hasattr(index.dtype, "tz"):
        return True
    if index.dtype.kind not in "iuf":
        return False
    if index.name is not None:
        return str(index.name).lower() in NAMES
    values = index.to_numpy(np.float64)
    return index.dtype.kind == "f" and not np.array_equal(values, np.round(values))


def _seconds(source: pd.Index | pd.Series, where: str) -> FloatArray:
    if source.dtype.kind in "mM" or hasattr(source.dtype, "tz"):
        values = source.to_numpy()
        if source.dtype.kind == "M" or hasattr(source.dtype, "tz"):
            values = source.to_numpy("datetime64[ns]")
        steps = np.asarray(values - values[:1], "timedelta64[ns]")
        return np.where(np.isnat(steps), np.nan, steps.astype(np.int64) * 1e-9)
    try:
        return source.to_numpy(np.float64) * NAMES.get(str(source.name).lower(), 1.0)
    except (ValueError, TypeError) as error:
        raise FileProblem(where, [f"the time in {source.name!r} is not a number: {error}"]) from error
