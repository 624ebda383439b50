"""A CSV file's columns as numbers, and where in it a value is wrong."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import FileProblem
from rig.recording.foreign.columns import split_heading
from rig.recording.foreign.csv_dialect import (
    FORTRAN,
    FORTRAN_HINT,
    NOTHING,
    POINT,
    CsvLayout,
    cells_of,
    decoded,
    is_number,
    is_stamp,
    layout_of,
    stamp_forms,
)
from rig.recording.foreign.foreign_file import Dialect, ForeignColumn
from rig.signals.arrays import FloatArray

MOST_PROBLEMS = 5
LINES_BEFORE = 50
"""By which the last line of a file is judged."""


class CsvFile:
    """A CSV file; see `rig.recording.foreign.foreign_file.ForeignFile`."""

    def __init__(self, file: Path, data: bytes, said: Dialect) -> None:
        """Guess how it is written.

        Raises:
            FileProblem: it is no text, or holds no rows of numbers.
        """
        self._file = file
        text, encoding = decoded(file, data, said.encoding)
        self._text = text.replace("\r\n", "\n").replace("\r", "\n")
        self._layout = layout_of(file, self._text, encoding, said)

    @property
    def layout(self) -> CsvLayout:
        """How it is written."""
        return self._layout

    @property
    def columns(self) -> list[ForeignColumn]:
        """See `ForeignFile.columns`."""
        listed = []
        for text, unit in zip(self._layout.names, self._layout.units, strict=True):
            name, bracketed = (text, unit) if unit else split_heading(text)
            listed.append(ForeignColumn(name, bracketed, text))
        return listed

    @property
    def read_as(self) -> str:
        """See `ForeignFile.read_as`."""
        return f"CSV, {self._layout.told}"

    @property
    def first_line(self) -> int:
        """See `ForeignFile.first_line`."""
        return self._layout.first_line

    def is_stamps(self, place: int) -> bool:
        """See `ForeignFile.is_stamps`."""
        return is_stamp(self._layout.sample[place])

    def own_time(self, places: Sequence[int]) -> None:
        """CSV files have none."""

    def values(self, places: Sequence[int]) -> list[FloatArray]:
        """See `ForeignFile.values`.

        Raises:
            FileProblem: some are no numbers.
        """
        import pandas as pd

        layout, beyond = self._layout, len(self._layout.names)
        stamps = [place for place in places if self.is_stamps(place)]
        separator = r"\s+" if layout.separator == " " else layout.separator
        widest = layout.separator.join(["nan"] * (beyond + 1)) + "\n"  # makes pandas see a column more
        try:
            table = pd.read_csv(
                io.StringIO(widest + self._body()), sep=separator, header=None, names=list(range(beyond + 1)),
                usecols=sorted({*places, beyond}), index_col=False, skipinitialspace=True, skip_blank_lines=False,
                decimal=layout.decimal, thousands=layout.thousands or None, na_values=sorted(NOTHING),
                dtype={place: "object" if place in (*stamps, beyond) else np.float64 for place in (*places, beyond)},
            )  # fmt: skip
        except (ValueError, OverflowError) as error:
            wrong = list(self._wrong_values(places))
            raise FileProblem(str(self._file), wrong or [" ".join(str(error).split())]) from error
        table = table.iloc[1:]
        if self._too_wide(table[beyond].tolist()) or layout.thousands:
            wrong = list(self._wrong_values(places))
            if wrong:
                raise FileProblem(str(self._file), wrong)
        columns = {place: table[place].to_numpy(copy=True) for place in places if place not in stamps}
        self._refuse_infinite(columns)
        columns |= {place: self._seconds(table[place].tolist(), place) for place in stamps}
        for place in {*self._cut_off()} & {*places}:
            columns[place][-1] = np.nan
        return [np.asarray(columns[place], np.float64) for place in places]

    @staticmethod
    def _too_wide(beyond: list[object]) -> bool:
        """Whether rows have a number after their last column: a thousands sign taken for a separator, perhaps."""
        return any(isinstance(cell, str) and POINT.fullmatch(cell.strip()) for cell in beyond)

    def _cut_off(self) -> list[int]:
        """Columns whose last number a recording that was cut off may have in part: its line has no end.

        Told by fewer cells than in the lines before, or fewer decimals than in any of these.
        """
        layout = self._layout
        if self._text.endswith("\n"):
            return []
        *before, last = (cells_of(line, layout.separator) for line in self._text.rsplit("\n", LINES_BEFORE)[1:])
        widths = [len(cells) for cells in before if cells]
        if not last or not widths or len(last) > min(widths):
            return []
        end = len(last) - 1
        decimals = [len(cells[end].partition(layout.decimal)[2]) for cells in before if cells]
        short = len(last[end].partition(layout.decimal)[2]) < min(decimals)
        return [end] if short or len(last) < min(widths) else []

    def _body(self) -> str:
        start = 0
        for _ in range(self._layout.first_line - 1):
            start = self._text.index("\n", start) + 1
        return self._text[start:]

    def _refuse_infinite(self, columns: dict[int, FloatArray]) -> None:
        problems = [
            f"line {int(np.flatnonzero(np.isinf(values))[0]) + self.first_line}, column "
            f"{self.columns[place].name!r}: infinite"
            for place, values in columns.items() if np.isinf(values).any()
        ]  # fmt: skip
        if problems:
            raise FileProblem(str(self._file), problems)

    def _seconds(self, cells: list[object], place: int) -> FloatArray:
        """Time stamps as seconds after the first one.

        Raises:
            FileProblem: some are no time stamps, or they are not written alike.
        """
        texts = ["" if cell is None or cell != cell else str(cell).strip().replace(",", ".") for cell in cells]
        while texts and not texts[-1]:
            texts.pop()
        wrong = [k for k, text in enumerate(texts) if not is_stamp(text)]
        if wrong:
            raise FileProblem(str(self._file), [
                f"line {k + self.first_line}, column {self.columns[place].name!r}: {texts[k][:40]!r} is no time stamp"
                for k in wrong[:MOST_PROBLEMS]
            ])  # fmt: skip
        try:
            nanoseconds = _nanoseconds(texts)
        except (ValueError, OverflowError) as error:
            problem = f"column {self.columns[place].name!r}: not all time stamps are written alike: {error}"
            raise FileProblem(str(self._file), [problem]) from error
        seconds = np.full(len(cells), np.nan)
        seconds[: len(texts)] = (nanoseconds - nanoseconds[0]) * 1e-9
        return seconds

    def _wrong_values(self, places: Sequence[int]) -> Iterator[str]:
        """Where the values are that are no numbers, the first few."""
        layout, told = self._layout, 0
        for line, row in enumerate(self._body().split("\n"), start=layout.first_line):
            cells = cells_of(row, layout.separator)
            problems = []
            if any(POINT.fullmatch(cell) for cell in cells[len(layout.names) :]):
                problems.append(f"line {line}: {len(cells)} values for {len(layout.names)} columns")
            for place in places:
                cell = cells[place] if place < len(cells) else ""
                if cell.lower() not in NOTHING and not self.is_stamps(place) and not is_number(
                    cell, layout.decimal, grouped=bool(layout.thousands)
                ):
                    hint = f"; decimals are taken to be written with {layout.decimal!r}" if "," in cell else ""
                    hint = f"; it {FORTRAN_HINT}" if FORTRAN.fullmatch(cell) else hint
                    name = self.columns[place].name
                    problems.append(f"line {line}, column {name!r}: {cell[:40]!r} is not a number{hint}")
            yield from problems
            told += len(problems)
            if told >= MOST_PROBLEMS:
                yield "and maybe more"
                return


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
