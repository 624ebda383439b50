"""Workbooks (.xlsx, .xlsm, .xlsb, .xls, .ods): a sheet's table, read like a text file whose lines are the sheet's rows.

`workbook_rows` reads the rows in its own process.
"""

from __future__ import annotations

import json
import re
import subprocess
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from drivers.processes import own_program
from rig.errors import FileProblem
from rig.extras import how_to_install
from rig.recording.file_formats import table_file
from rig.recording.file_formats.csv_file import CsvFile
from rig.recording.file_formats.table_file import (
    LARGEST_BYTES,
    MOST_COLUMNS,
    Dialect,
    TableColumn,
    stream,
    unreadable,
)
from rig.recording.file_formats.workbook_rows import CPU_S, MEMORY_BYTES
from rig.signals.arrays import FloatArray

OLE = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
"""First bytes of the files of older Office programs."""
ENCRYPTED = "EncryptedPackage".encode("utf-16-le")
PARTS = ("xl/workbook.xml", "xl/workbook.bin", "content.xml")
"""Each kind of workbook that is a ZIP archive has one of these."""
LARGEST_PART_BYTES = 64 * 1024 * 1024
"""Parts of a workbook other than its sheets."""
SHEETS = ("xl/worksheets/", "content.xml", "xl/sharedStrings")
ALL_SHEETS = "all"
CELL_NUMBERS = 4
"""A cell takes as much memory as so many numbers."""
KINDS = {"xl/workbook.bin": "Excel workbook (.xlsb)", "content.xml": "OpenDocument spreadsheet"}
NOT_CALCULATED = re.compile(rb"(?:</f>|<f\s[^<>]*/>)\s*(?:<v\s*/>|<v>\s*</v>)?\s*</c>")
"""A formula without a stored value."""


@dataclass(frozen=True)
class Sheet:
    """A sheet's rows as lines of tabs, and its merged cells: first row, first column, last row, last column, from 0."""

    name: str
    hidden: bool
    text: str
    merged: tuple[tuple[int, int, int, int], ...]


def is_workbook(data: bytes, names: Sequence[str]) -> bool:
    """Whether a file is a workbook: of an older Excel, or a ZIP archive with these names in it."""
    return data.startswith(OLE) or any(part in names for part in PARTS)


def open_workbook(file: Path, data: bytes, stated: Dialect) -> list[tuple[str, SheetFile]]:
    """The sheets to read, each by its name.

    Args:
        file: of the content.
        data: the content.
        stated: the sheets that the user names, with the wildcards `*` and `?`; `all`: every visible sheet with a
            table.

    Raises:
        FileProblem: it is damaged or protected, needs too much memory, has no table or several, or python-calamine is
            not installed.
    """
    try:
        kind = _checked_kind(file, data)
    except FileProblem:
        raise
    except Exception as error:
        raise FileProblem(str(file), unreadable("workbook", error)) from error
    if find_spec("python_calamine") is None:
        raise FileProblem(str(file), [
            f"this file is an {kind}; workbooks require python-calamine: {how_to_install('files')}"
        ])
    sheets = {sheet.name: sheet for sheet in _sheets(file, data, kind, stated.decimal)}
    names = (stated.sheet,) if isinstance(stated.sheet, str) else stated.sheet or ()
    if names and (names != (ALL_SHEETS,) or ALL_SHEETS in sheets):
        return [(name, SheetFile(file, data, kind, sheets[name], stated)) for name in _chosen(file, sheets, names)]
    every = [(name, opened) for name, sheet in sheets.items()
             if (opened := _table(file, data, kind, sheet, stated)) is not None]  # fmt: skip
    tables = [(name, opened) for name, opened in every if not sheets[name].hidden] or every
    if stated.sheet is None and len(tables) > 1:
        raise FileProblem(str(file), [
            f"{len(tables)} sheets contain tables: {_quoted([name for name, _ in tables])}. Fix: use --sheet NAME for "
            "each sheet to import, or --sheet all for one test per sheet"
        ])
    if not tables:
        raise FileProblem(str(file), [f"the {kind} contains no rows of numbers; its sheets: {_quoted(sheets)}",
                                      *_not_calculated(data)])  # fmt: skip
    return tables


class SheetFile(CsvFile):
    """A sheet of a workbook; see `rig.recording.file_formats.table_file.TableFile`."""

    ROW = "row"

    def __init__(self, file: Path, data: bytes, kind: str, sheet: Sheet, stated: Dialect) -> None:
        """Find its table.

        Raises:
            FileProblem: it contains no rows of numbers.
        """
        self._data, self._kind, self._sheet = data, kind, sheet
        dialect = replace(stated, separator="\t", decimal=".", thousands="", encoding="utf-8")
        super().__init__(file, sheet.text.encode("utf-8", "replace"), dialect)
        if self.layout.header_line:
            names = [name or self._merged_text(self.layout.header_line - 1, place)
                     for place, name in enumerate(self.layout.names)]  # fmt: skip
            self._layout = replace(self.layout, names=tuple(names))

    @property
    def columns(self) -> list[TableColumn]:
        """See `TableFile.columns`; a column below a merged cell is also found as `MERGED CELL/NAME`."""
        columns, row = super().columns, self.layout.header_line - 2
        groups = [self._merged_text(row, place) for place in range(len(columns))]
        return [replace(column, full=f"{group}/{column.name}") if group not in {"", column.name} else column
                for column, group in zip(columns, groups, strict=True)]  # fmt: skip

    def _merged_text(self, row: int, column: int) -> str:
        """The text of the merged cell that a row and a column (from 0) belong to; empty: none."""
        for first_row, first_column, last_row, last_column in self._sheet.merged:
            if first_row <= row <= last_row and first_column <= column <= last_column:
                cells = self._sheet.text.split("\n", first_row + 1)[first_row].split("\t")
                return cells[first_column] if first_column < len(cells) else ""
        return ""

    @property
    def read_as(self) -> str:
        """See `TableFile.read_as`."""
        layout, rows = self.layout, f"numbers from row {self.layout.first_line}"
        names = f"names in row {layout.header_line}" if layout.header_line else "no names"
        units = [f"units in row {layout.units_line}"] if layout.units_line else []
        sheet = f"{'hidden ' * self._sheet.hidden}sheet {self._sheet.name!r}"
        return ", ".join((self._kind, sheet, names, *units, rows)) + self._midnight

    def values(self, places: Sequence[int]) -> list[FloatArray]:
        """See `TableFile.values`.

        Raises:
            FileProblem: some are no numbers, or there are formulas without a stored value.
        """
        columns = super().values(places)
        problems = _not_calculated(self._data) if any(np.isnan(values).any() for values in columns) else []
        if problems:
            raise FileProblem(str(self._file), problems)
        return columns


def _table(file: Path, data: bytes, kind: str, sheet: Sheet, stated: Dialect) -> SheetFile | None:
    """The table of a sheet; None where it has none."""
    try:
        return SheetFile(file, data, kind, sheet, stated)
    except FileProblem:
        return None


def _chosen(file: Path, sheets: dict[str, Sheet], names: Sequence[str]) -> list[str]:
    """The sheets that the user names, in the order of the workbook; wildcards match visible sheets only.

    Raises:
        FileProblem: a name is that of no sheet.
    """
    chosen: set[str] = set()
    for name in names:
        matching = {name} & sheets.keys() or {
            one for one, sheet in sheets.items() if not sheet.hidden and fnmatchcase(one, name)
        }
        if not matching:
            raise FileProblem(str(file), [f"the workbook has no sheet {name!r}; its sheets: {_quoted(sheets)}"])
        chosen |= matching
    return [name for name in sheets if name in chosen]


def _quoted(names: Sequence[str] | dict[str, Sheet]) -> str:
    return ", ".join(repr(name) for name in names)


def _checked_kind(file: Path, data: bytes) -> str:
    """What kind of workbook a file is, in words.

    Raises:
        FileProblem: it is protected by a password, or a part of it claims to unpack to more than can be read.
    """
    if data.startswith(OLE):
        if ENCRYPTED in data:
            raise FileProblem(str(file), ["the workbook is protected by a password. Fix: save it without a password"])
        return "Excel workbook (.xls)"
    with zipfile.ZipFile(stream(data)) as packed:
        for part in packed.infolist():
            largest = LARGEST_BYTES if part.filename.startswith(SHEETS) else LARGEST_PART_BYTES
            if part.file_size > largest:
                raise FileProblem(str(file), [
                    f"{part.filename[:80]!r} unpacks to {part.file_size} bytes; at most {largest} are allowed. Fix: "
                    "save only the sheet with the test, or save the sheet as CSV"
                ])  # fmt: skip
        return next((kind for part, kind in KINDS.items() if part in packed.namelist()), "Excel workbook")


def _sheets(file: Path, data: bytes, kind: str, decimal: str | None) -> Iterator[Sheet]:
    """All sheets of a workbook, numbers in text cells with a decimal point.

    Args:
        file: of the content.
        data: the content.
        kind: what kind of workbook it is, in words.
        decimal: decimal separator of the text cells, as the user states it.

    Raises:
        FileProblem: the child process reports a problem, or has been ended by its limits.
    """
    done = subprocess.run(
        own_program("rig.recording.file_formats.workbook_rows", str(table_file.MOST_NUMBERS // CELL_NUMBERS),
                    str(MOST_COLUMNS), *([] if decimal is None else [decimal])),
        input=data, capture_output=True, check=False,
    )  # fmt: skip
    lines = done.stdout.decode("utf-8", "replace").split("\n")
    at = 0
    while done.returncode == 0 and at < len(lines) and lines[at]:
        head = json.loads(lines[at])
        if "problem" in head:
            raise FileProblem(str(file), [f"{head['problem']}. Fix: save the sheet with the test as CSV"])
        if "error" in head:
            text = " ".join(str(head["error"]).split())[:200]
            raise FileProblem(str(file), [
                f"cannot be read as {kind}; the file is damaged or has another format ({text})"
            ])
        stop = at + 1 + head["lines"]
        merged = tuple((int(a), int(b), int(c), int(d)) for a, b, c, d in head["merged"])
        yield Sheet(head["name"], head["hidden"], "\n".join(lines[at + 1 : stop]) + "\n", merged)
        at = stop
    if done.returncode:
        raise FileProblem(str(file), [
            f"cannot be read as {kind}: its sheets require more than {MEMORY_BYTES >> 30} GiB of memory or {CPU_S} s, "
            "or the file is damaged. Fix: delete the cells far from the table, or save the sheet with the test as CSV"
        ])  # fmt: skip


def _not_calculated(data: bytes) -> list[str]:
    """What to state of formulas in an Excel workbook that have no stored value."""
    count = 0
    if data.startswith(b"PK"):
        with zipfile.ZipFile(stream(data)) as packed:
            for name in packed.namelist():
                if name.startswith("xl/worksheets/") and name.endswith(".xml"):
                    count += len(NOT_CALCULATED.findall(packed.read(name)))
    return [
        f"formulas without a stored value in the workbook: {count}; formulas are not evaluated. Fix: open the "
        "workbook in a spreadsheet program and save it"
    ] * bool(count)
