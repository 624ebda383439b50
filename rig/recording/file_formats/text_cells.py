"""Cells of text as numbers or times, and dates as times, by one rule for files and tables."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.recording.file_formats.csv_dialect import NOTHING, is_number, is_stamp, normal_stamp, stamp_forms
from rig.signals.arrays import FloatArray

HALF_DAY_NS = 43_200_000_000_000
NO_VALUE = NOTHING | {"<na>", "nat"}
"""Texts for no value, those of pandas too."""


class NotStamps(ValueError):
    """Cells that are no time stamps.

    Attributes:
        rows: which ones, by row.
    """

    def __init__(self, rows: dict[int, str]) -> None:
        self.rows = rows
        row, text = next(iter(rows.items()))
        super().__init__(f"row {row}: {text[:40]!r} is not a time stamp")


def numbers_of_cells(cells: Iterable[object]) -> FloatArray:
    """Cells (n,), each a number, a text that is one, or one of the texts for no value (`NOTHING`: NaN).

    Raises:
        ValueError: a cell is something else; with its row.
    """
    numbers = []
    for row, cell in enumerate(cells):
        if isinstance(cell, int | float):
            numbers.append(float(cell))
            continue
        text = "" if cell is None else str(cell).strip()
        known = text.lower() not in NO_VALUE
        if known and not is_number(text, ".", grouped=False):
            raise ValueError(f"row {row}: {text[:40]!r} is not a number")
        numbers.append(float(text) if known else math.nan)
    return np.array(numbers, np.float64)


def seconds_of_dates(values: NDArray[Any]) -> FloatArray:
    """Dates or durations of NumPy (n,) as seconds from the first one; NaN where there is none (NaT)."""
    steps = np.asarray(values - values[:1], "timedelta64[ns]")
    return np.where(np.isnat(steps), np.nan, steps.astype(np.int64) * 1e-9)


def texts_of_cells(cells: Iterable[object]) -> list[str]:
    """Cells as stripped texts; empty where a cell has no value. Empty ones at the end are left out."""
    texts = ["" if cell is None or cell != cell else str(cell).strip() for cell in cells]
    while texts and not texts[-1]:
        texts.pop()
    return texts


def seconds_of_stamps(cells: Sequence[object]) -> tuple[FloatArray, int]:
    """Time stamps (n,) as seconds after the first one, and how often times of day pass midnight.

    Cells without a value at the end are NaN.

    Raises:
        NotStamps: some are no time stamps.
        ValueError: they are not written alike.
        OverflowError: beyond the range of dates.
    """
    texts = [normal_stamp(text).replace(",", ".") for text in texts_of_cells(cells)]
    wrong = {row: text for row, text in enumerate(texts) if not is_stamp(text)}
    if wrong or not texts:
        raise NotStamps(wrong or {0: ""})
    nanoseconds, midnights = _nanoseconds(texts), 0
    if not stamp_forms(texts[0]) or not re.search(r"\d[-/.]", texts[0][:5]):
        days = np.cumsum(np.diff(nanoseconds, prepend=nanoseconds[:1]) < -HALF_DAY_NS)
        midnights = int(days[-1])
        nanoseconds = nanoseconds + 2 * HALF_DAY_NS * days
    seconds = np.full(len(cells), np.nan)
    seconds[: len(texts)] = (nanoseconds - nanoseconds[0]) * 1e-9
    return seconds, midnights


def _nanoseconds(texts: Sequence[str]) -> NDArray[np.int64]:
    """Time stamps, shape (n,), in ns; where day and month may be either, in the order that makes the test shorter.

    Raises:
        ValueError: they are not written alike.
    """
    import pandas as pd

    forms = stamp_forms(texts[0])
    if not forms:
        return np.asarray(pd.to_timedelta(list(texts)).to_numpy().astype("timedelta64[ns]").astype(np.int64))
    series = pd.Series(texts)
    if forms == ("ISO8601",):
        series = series.str.replace("/", "-")
    read: list[NDArray[np.int64]] = []
    refused: ValueError | None = None
    for form in forms:
        try:
            stamps = pd.to_datetime(series, format=form, utc=True).dt.tz_localize(None)
        except ValueError as error:
            refused = error
        else:
            read.append(np.asarray(stamps.to_numpy().astype("datetime64[ns]").astype(np.int64)))
    if not read and refused is not None:
        raise refused
    return min(read, key=lambda nanoseconds: abs(int(nanoseconds[-1]) - int(nanoseconds[0])))
