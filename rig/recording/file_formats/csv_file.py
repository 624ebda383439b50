"""A CSV file's columns as numbers, and the locations of invalid values."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import FileProblem
from rig.recording.file_formats.columns import split_heading
from rig.recording.file_formats.csv_dialect import (
    COMMA,
    FORTRAN,
    FORTRAN_HINT,
    NOTHING,
    NUMBER_LIKE,
    POINT,
    CsvLayout,
    cells_of,
    decoded,
    is_any_number,
    is_number,
    is_stamp,
    layout_of,
    signs_of,
    without_groups,
)
from rig.recording.file_formats.table_file import NOT_DESCRIBED, Break, Dialect, TableColumn
from rig.recording.file_formats.text_cells import NotStamps, seconds_of_stamps
from rig.signals.arrays import FloatArray

if TYPE_CHECKING:
    import pandas as pd

MOST_PROBLEMS = 5
MOST_EVENTS, FEW_EVENTS = 0.1, 5
"""Share of the rows that may be events; a few always may."""
MINUS = "\u2212"
"""The typographic sign, which some spreadsheets write before numbers."""
OWN_TABLE, OTHER_TABLE = "own", "other"
"""What a heading between rows begins."""
MTS_HEAD = re.compile(r"MTS793\|[^|\n]*\|[^|\n]*\|\d+\|\d+\|(?P<decimal>[.,])\|")
"""First line of a file of MTS 793: program, language, ..., decimal sign, sign in dates, sign in times, ..."""
LINES_BEFORE = 50
"""By which the last line of a file is judged."""
PART = 4_000_000
"""Characters that pandas parses at a time, so that memory is bounded."""
QUOTE = '"'
"""Of pandas: a line does not end within quotes."""


class _Text(io.TextIOBase):
    """A file object for a first line followed by a part of a text.

    The text is read in pieces: `io.StringIO` needs four bytes per character, and joining would copy the text.
    """

    def __init__(self, first: str, text: str, start: int, stop: int) -> None:
        super().__init__()
        self._first, self._text, self._position, self._stop = first, text, start, stop

    def readable(self) -> bool:
        """Return True: the file is readable."""
        return True

    def read(self, size: int | None = -1, /) -> str:
        """The next characters; empty at the end."""
        if self._first:
            first, self._first = self._first, ""
            return first
        end = self._stop if size is None or size < 0 else min(self._stop, self._position + size)
        part, self._position = self._text[self._position : end], end
        return part


class CsvFile:
    """A CSV file; see `rig.recording.file_formats.table_file.TableFile`."""

    ROW = "line"
    """What a row is called."""
    described = NOT_DESCRIBED

    def __init__(self, file: Path, data: bytes, stated: Dialect) -> None:
        """Guess how it is written.

        Raises:
            FileProblem: it is no text, or holds no rows of numbers.
        """
        self._file, self._stated = file, stated
        text, encoding = decoded(file, data, stated.encoding)
        # \r\r\n: Python's csv module on Windows, without newline=""; \x1a: the end of a file of DOS.
        text = text.replace("\r\r\n", "\n").replace("\r\n", "\n").replace("\r", "\n").rstrip("\x1a")
        self._text = text.replace(MINUS, "-")
        head = MTS_HEAD.match(self._text)
        if head is not None and stated.decimal is None and stated.thousands is None:
            stated = replace(stated, decimal=head["decimal"])
            self._stated = stated
        layout = layout_of(file, self._text, encoding, stated)
        parted = ""
        if stated.thousands != "":
            self._text, parted = without_groups(self._text, layout.separator)
        self._layout = replace(layout, thousands=parted) if parted else layout
        self._breaks: list[Break] = []
        self._lines: NDArray[np.int64] | None = None
        self._midnights = 0

    @property
    def layout(self) -> CsvLayout:
        """How it is written."""
        return self._layout

    @property
    def columns(self) -> list[TableColumn]:
        """See `TableFile.columns`."""
        listed = []
        for text, unit in zip(self._layout.names, self._layout.units, strict=True):
            name, bracketed = (text, unit) if unit else split_heading(text)
            listed.append(TableColumn(name, bracketed, text))
        return listed

    @property
    def read_as(self) -> str:
        """See `TableFile.read_as`."""
        return f"CSV, {self._layout.description}{self._midnight}"

    @property
    def _midnight(self) -> str:
        return f", {self._midnights} change(s) of date at midnight" if self._midnights else ""

    def row_name(self, row: int) -> str:
        """See `TableFile.row_name`."""
        return f"{self.ROW} {self._layout.first_line + row if self._lines is None else int(self._lines[row])}"

    def breaks(self) -> Sequence[Break]:
        """See `TableFile.breaks`; known after `values`."""
        return self._breaks

    def is_stamps(self, place: int) -> bool:
        """See `TableFile.is_stamps`."""
        return is_stamp(self._layout.sample[place])

    def own_time(self, places: Sequence[int]) -> None:
        """CSV files have none."""

    def values(self, places: Sequence[int]) -> list[FloatArray]:
        """See `TableFile.values`.

        Raises:
            FileProblem: some are no numbers.
        """
        stamps = [place for place in places if self.is_stamps(place)]
        start, last = self._body_start(), len(self._text)
        while last and self._text[last - 1].isspace():
            last -= 1
        blank = re.compile(rf"\n[ \t{re.escape(self._layout.separator)}]*\n").search(self._text, start, last)
        table = None if blank else self._table(self._text, start, places)
        if table is None:
            self._look_again(places)
            table = self._table(self._rows_alone(places), 0, places)
        if table is None:
            raise FileProblem(str(self._file), list(self._wrong_values(places)) or ["some values are not numbers"])
        columns = {place: self._seconds(table[place].tolist(), place) if place in stamps else table[place]
            for place in places}  # fmt: skip
        if self._lines is None or int(self._lines[-1]) == self._text.count("\n") + 1:
            for place in {*self._cut_off()} & {*places}:
                columns[place][-1] = np.nan
        return [np.asarray(columns[place], np.float64) for place in places]

    def _table(self, text: str, start: int, places: Sequence[int]) -> dict[int, NDArray[Any]] | None:
        """The columns of a text from a line's start on, by place; None where some values are no numbers.

        One call for each part, because before 3.1 pandas refuses a column without a cell if the file is longer than
        what it reads at a time (low_memory: 2**17 rows of five columns), and takes much memory without low_memory.
        """
        layout, beyond = self._layout, len(self._layout.names)
        parts, wide = [], False
        for body in _parts(layout.separator.join(["nan"] * (beyond + 1)) + "\n", text, start):
            part = self._part(body, places)
            if part is None:
                return None
            cells = part[beyond]
            wide = wide or self._too_wide(cells[cells.notna()].tolist())
            parts.append({place: part[place].to_numpy() for place in places})
        if (wide or layout.thousands in {",", "."}) and any(self._wrong_values(places)):
            return None
        return {place: np.concatenate([part[place] for part in parts]) for place in places}

    def _part(self, body: _Text, places: Sequence[int]) -> pd.DataFrame | None:
        """The columns of a part, with one for cells after the last column; None where some values are no numbers."""
        import pandas as pd

        layout, beyond = self._layout, len(self._layout.names)
        as_text = [beyond, *(place for place in places if self.is_stamps(place))]
        try:
            return pd.read_csv(
                body, sep=r"\s+" if layout.separator == " " else layout.separator, header=None,
                names=list(range(beyond + 1)), usecols=sorted({*places, beyond}), index_col=False,
                skipinitialspace=True, skip_blank_lines=False, low_memory=False, decimal=layout.decimal,
                thousands=layout.thousands if layout.thousands in {",", "."} else None,
                na_values=sorted({*NOTHING, *map(str.upper, NOTHING)}),
                dtype={place: "object" if place in as_text else np.float64 for place in (*places, beyond)},
            ).iloc[1:]  # fmt: skip
        except (ValueError, OverflowError):
            return None

    def _look_again(self, places: Sequence[int]) -> None:
        """Look for a thousands sign in the whole file, not in its first rows alone."""
        layout = self._layout
        if layout.thousands or self._stated.thousands == "":
            return
        rows = (cells_of(line, layout.separator) for line in self._body().split("\n"))
        cells_used = [[cells[place] for place in places if place < len(cells)] for cells in rows]
        decimal, thousands = signs_of(
            self._file, [[cell for cell in cells if is_any_number(cell)] for cells in cells_used], self._stated
        )
        if thousands:
            self._layout = replace(layout, decimal=decimal, thousands=thousands)

    def _rows_alone(self, places: Sequence[int]) -> str:
        """The rows of numbers without the lines between them: headings that are repeated, and rows of events.

        Raises:
            FileProblem: a heading differs from the first one; rows of events that are not to be skipped or split off;
                too many of them to be events.
        """
        lines = self._body().split("\n")
        while lines and not lines[-1].strip():
            lines.pop()
        good = np.array([self._is_row(line, places) for line in lines], bool)
        apart = [(int(start), int(stop)) for start, stop in _stretches(~good)]
        if not apart or not good.any():
            return "\n".join(lines)
        first = self._layout.first_line
        self._breaks, event_lines, elsewhere = [], list[int](), False
        for (start, stop), end in zip(apart, [*(start for start, _ in apart[1:]), len(lines)], strict=True):
            count = sum(bool(line.strip()) for line in lines[start:stop])
            heading = self._heading_in(lines[start:stop], start + first, places)
            elsewhere = heading == OTHER_TABLE or (elsewhere and heading != OWN_TABLE)
            row = int(np.count_nonzero(good[:start]))
            other = int(np.count_nonzero(good[stop:end])) if elsewhere else 0
            if elsewhere:
                good[stop:end] = False
            else:
                event_lines += [k for k in range(start, stop) if lines[k].strip()] if not heading else []
            self._breaks.append(Break(row, start + first, count, bool(heading) or elsewhere, other))
        if not good.any():
            return "\n".join(lines)
        events = len(event_lines)
        numbers = [k for k in event_lines if self._is_number_like(lines[k], places)]
        if numbers:
            raise FileProblem(str(self._file), [
                *self._wrong_values(places),
                f"{len(numbers)} row(s) contain numbers in another format, or more numbers than columns. Fix: use "
                "--decimal and --thousands; the thousands separator must differ from the column separator",
            ])  # fmt: skip
        if events and self._stated.event_rows == "refuse":
            raise FileProblem(str(self._file), [
                *self._wrong_values(places),
                f"{events} row(s) {self._where_events(event_lines, good)} contain text. Fix: if the rows are events or "
                "remarks, skip them with --event-rows skip, or split the file at these rows with --event-rows split",
            ])  # fmt: skip
        if events > max(FEW_EVENTS, MOST_EVENTS * np.count_nonzero(good)):
            raise FileProblem(str(self._file), [
                *self._wrong_values(places), f"{events} of {len(lines)} rows do not contain numbers: too many to be "
                    "events",
            ])  # fmt: skip
        self._lines = np.flatnonzero(good) + first
        return "\n".join(line for line, row in zip(lines, good, strict=True) if row) + "\n" * self._text.endswith("\n")

    @staticmethod
    def _where_events(event_lines: Sequence[int], good: NDArray[np.bool_]) -> str:
        """Where rows of text are: after the last row of numbers, or (some of them) between rows of numbers."""
        return "after the last row of numbers" if min(event_lines) > np.flatnonzero(good)[-1] else (
            "between rows of numbers")

    def _is_row(self, line: str, places: Sequence[int]) -> bool:
        """Whether a line is a row: numbers in the wanted columns, and no words where the first rows have numbers."""
        layout = self._layout
        cells = cells_of(line, layout.separator)
        if not any(cells) or any(POINT.fullmatch(cell) for cell in cells[len(layout.names) :]):
            return False
        grouped = layout.thousands in {",", "."}
        return all(
            cell.lower() in NOTHING or is_number(cell, layout.decimal, grouped=grouped) or is_stamp(cell)
            for place, cell in enumerate(cells[: len(layout.names)])
            if place in places or (place == 0 and layout.numeric[0])
        )

    def _is_number_like(self, line: str, places: Sequence[int]) -> bool:
        """Whether a line that is no row has numbers only, written otherwise or too many, where a row has its own."""
        cells = cells_of(line, self._layout.separator)
        own = [cells[place] for place in places if place < len(cells) and cells[place].lower() not in NOTHING]
        return bool(own) and all(NUMBER_LIKE.fullmatch(cell) or is_stamp(cell) for cell in own)

    def _heading_in(self, lines: Sequence[str], first: int, places: Sequence[int]) -> str:
        """Whether lines between rows hold the table's own heading again, or that of another table; empty: neither.

        Raises:
            FileProblem: they hold the heading of another table, which may have the wanted columns, or which the user
                does not skip.
        """
        layout = self._layout
        names = _trimmed(layout.heading)
        for number, line in enumerate(lines):
            cells = _trimmed(cells_of(line, layout.separator))
            words = not any(is_any_number(cell) or is_stamp(cell) or cell.lower() in NOTHING for cell in cells)
            common = len({*cells} & {*names})
            if not names or (2 * common < len(names) and not (words and len(cells) == len(names) > 1)):
                continue
            following = _trimmed(cells_of(lines[number + 1], layout.separator)) if number + 1 < len(lines) else ()
            units = _trimmed(layout.units_heading)
            if cells == names and (not units or following == units):
                return OWN_TABLE
            wanted = {layout.heading[place] for place in places if place < len(layout.heading)}
            possible = wanted <= {*cells}
            if possible or self._stated.event_rows == "refuse":
                skip = "" if possible else ", or leave this table out with --event-rows skip"
                raise FileProblem(str(self._file), [
                    f"{self.ROW} {number + first}: another table starts here, with the header "
                    f"{', '.join(cells + following)[:200]}; "
                    f"the header of the first table is {', '.join(names + units)[:200]}. Fix: save each table as a "
                    "separate file"
                    f"{skip}",
                ])  # fmt: skip
            return OTHER_TABLE
        return ""

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
        return self._text[self._body_start() :]

    def _body_start(self) -> int:
        start = 0
        for _ in range(self._layout.first_line - 1):
            start = self._text.index("\n", start) + 1
        return start

    def _seconds(self, cells: list[object], place: int) -> FloatArray:
        """Time stamps as seconds after the first one.

        Raises:
            FileProblem: some are no time stamps, or they are not written alike.
        """
        name = self.columns[place].name
        try:
            seconds, self._midnights = seconds_of_stamps(cells)
        except NotStamps as error:
            raise FileProblem(str(self._file), [
                f"{self.row_name(row)}, column {name!r}: {text[:40]!r} is not a time stamp. "
                "Fix: repair the row, or, for samples at a constant rate, use --rate instead of the column"
                for row, text in list(error.rows.items())[:MOST_PROBLEMS]
            ]) from error
        except (ValueError, OverflowError) as error:
            problem = f"column {name!r}: the time stamps have different formats: {error}. Fix: " + (
                "for samples at a constant rate, use --rate instead of the column"
            )
            raise FileProblem(str(self._file), [problem]) from error
        return seconds

    def _wrong_values(self, places: Sequence[int]) -> Iterator[str]:
        """Where the values are that are no numbers, the first few."""
        layout, reported = self._layout, 0
        for line, row in enumerate(self._body().split("\n"), start=layout.first_line):
            cells = cells_of(row, layout.separator)
            problems = []
            if any(POINT.fullmatch(cell) for cell in cells[len(layout.names) :]):
                problems.append(f"{self.ROW} {line}: {len(cells)} values, but only {len(layout.names)} columns")
            for place in places:
                cell = cells[place] if place < len(cells) else ""
                grouped = layout.thousands in {",", "."}
                if cell.lower() not in NOTHING and not self.is_stamps(place) and not is_number(
                    cell, layout.decimal, grouped=grouped
                ):
                    hint = f"; assumed decimal separator: {layout.decimal!r} (see --decimal and --thousands)"
                    hint = hint if "," in cell or "." in cell else ""
                    if layout.decimal == "." and COMMA.fullmatch(cell):
                        hint = ". Fix: if the comma is the decimal separator, add --decimal ,"
                    hint = f"; it {FORTRAN_HINT}" if FORTRAN.fullmatch(cell) else hint
                    name = self.columns[place].name
                    problems.append(f"{self.ROW} {line}, column {name!r}: {cell[:40]!r} is not a number{hint}")
            yield from problems
            reported += len(problems)
            if reported >= MOST_PROBLEMS:
                yield "and possibly more"
                return


def _parts(first: str, text: str, start: int) -> Iterator[_Text]:
    """A text from a line's start on in parts of whole lines, each after a first line that makes pandas see all columns.

    Without it, cells after the last column would be taken for an index or would be errors.
    """
    more = True
    while more:
        stop, quotes = start, 0
        while stop < len(text) and (stop == start or quotes % 2):
            following = text.find("\n", stop + PART if stop == start else stop) + 1 or len(text)
            quotes += text.count(QUOTE, stop, following)
            stop = following
        yield _Text(first, text, start, stop)
        start, more = stop, stop < len(text)


def _trimmed(cells: Sequence[str]) -> tuple[str, ...]:
    """Cells without empty ones at the end."""
    count = len(cells)
    while count and not cells[count - 1]:
        count -= 1
    return tuple(cells[:count])


def _stretches(marked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """First place and place after the last of every stretch of marked places, (stretches, 2)."""
    edges = np.diff(np.concatenate([[False], marked, [False]]).astype(np.int8))
    return np.column_stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)])
