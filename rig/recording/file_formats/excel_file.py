"""Excel workbooks (.xlsx, .xlsm): the table of a sheet, read like a text file whose lines are the sheet's rows."""

from __future__ import annotations

import io
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any

from rig.errors import FileProblem
from rig.recording.file_formats.csv_file import CsvFile
from rig.recording.file_formats.table_file import (
    INSTALL_FILES,
    LARGEST_BYTES,
    MOST_COLUMNS,
    Dialect,
    check_size,
    stream,
    unreadable,
)

WORKBOOK = "xl/workbook.xml"
LARGEST_PART_BYTES = 64 * 1024 * 1024
"""Parts of a workbook other than its sheets are held in memory as a whole."""
LOOKED_AT = 2000
"""Rows by which a sheet is taken for a table."""
ALL_SHEETS = "all"
HIDDEN_MARKUP = (b"<!DOCTYPE", b"<!ENTITY", b"<\0!\0D", b"\0<\0!")
"""Of XML that defines entities, which can grow without bound."""


def open_workbook(file: Path, data: bytes, stated: Dialect) -> list[tuple[str, SheetFile]]:
    """The sheets to read, each by its name.

    Args:
        file: of the content.
        data: the content.
        stated: the sheet that the user names; `all`: every sheet with a table.

    Raises:
        FileProblem: it is damaged, claims to hold too much, has no table or several, or openpyxl is not installed.
    """
    try:
        import openpyxl
    except ImportError as error:
        raise FileProblem(str(file), [f"Excel workbooks require openpyxl: {INSTALL_FILES}"]) from error
    try:
        _check_parts(file, data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # on what it leaves out
            book = openpyxl.load_workbook(stream(data), read_only=True, data_only=True, keep_links=False)
            sheets = {sheet.title: sheet for sheet in book.worksheets}
            if stated.sheet not in {None, ALL_SHEETS, *sheets}:
                raise FileProblem(str(file), [f"the workbook has no sheet {stated.sheet!r}; its sheets: "
                    f"{_quoted(sheets)}"])
            chosen = [stated.sheet] if stated.sheet in sheets else [
                name for name, sheet in sheets.items() if _has_table(file, sheet, stated)
            ]
            if stated.sheet is None and len(chosen) > 1:
                raise FileProblem(str(file), [
                    f"{len(chosen)} sheets contain tables: {_quoted(chosen)}. Fix: use --sheet NAME, or --sheet all "
                    "for one test per sheet"
                ])  # fmt: skip
            if not chosen:
                raise FileProblem(str(file), ["the Excel workbook contains no rows of numbers; its sheets: "
                    f"{_quoted(sheets)}"])
            return [(name, SheetFile(file, sheets[name], stated)) for name in chosen if name is not None]
    except FileProblem:
        raise
    except Exception as error:
        raise FileProblem(str(file), unreadable("Excel workbook", error)) from error


class SheetFile(CsvFile):
    """A sheet of a workbook; see `rig.recording.file_formats.table_file.TableFile`."""

    def __init__(self, file: Path, sheet: Any, stated: Dialect) -> None:  # noqa: ANN401 - of a half annotated library
        """Read its rows.

        Raises:
            FileProblem: it holds no rows of numbers, or too many.
        """
        self._sheet = str(sheet.title)
        text = "\n".join(_lines(file, sheet)) + "\n"
        super().__init__(file, text.encode("utf-8", "replace"), _dialect(stated))

    @property
    def read_as(self) -> str:
        """See `TableFile.read_as`."""
        layout, rows = self.layout, f"numbers from row {self.layout.first_line}"
        names = f"names in row {layout.header_line}" if layout.header_line else "no names"
        units = [f"units in row {layout.units_line}"] if layout.units_line else []
        return ", ".join((f"Excel workbook, sheet {self._sheet!r}", names, *units, rows)) + self._midnight


def _dialect(stated: Dialect) -> Dialect:
    return replace(stated, separator="\t", decimal=".", thousands="", encoding="utf-8")


def _quoted(names: Sequence[str | None] | dict[str, Any]) -> str:
    return ", ".join(repr(name) for name in names)


def _check_parts(file: Path, data: bytes) -> None:
    """Refuse what claims to unpack to more than can be read.

    Raises:
        FileProblem: it does, or it defines entities.
    """
    with zipfile.ZipFile(stream(data)) as packed:
        for part in packed.infolist():
            largest = LARGEST_BYTES if part.filename.startswith("xl/worksheets/") else LARGEST_PART_BYTES
            if part.file_size > largest:
                raise FileProblem(str(file), [
                    f"{part.filename[:80]!r} unpacks to {part.file_size} bytes; at most {largest} are allowed"
                ])  # fmt: skip
            if part.filename.endswith((".xml", ".rels")):
                with packed.open(part) as content:
                    head = content.read(4096)
                if any(mark in head for mark in HIDDEN_MARKUP):
                    raise FileProblem(str(file), [f"{part.filename[:80]!r} defines XML entities, which Excel does "
                        "not write"])


def _has_table(file: Path, sheet: Any, stated: Dialect) -> bool:  # noqa: ANN401 - of a half annotated library
    text = io.StringIO()
    for number, line in enumerate(_lines(file, sheet)):
        if number == LOOKED_AT:
            break
        text.write(f"{line}\n")
    try:
        CsvFile(file, text.getvalue().encode("utf-8", "replace"), _dialect(stated))
    except FileProblem:
        return False
    return True


def _lines(file: Path, sheet: Any) -> Iterator[str]:  # noqa: ANN401 - of a half annotated library
    """The sheet's rows as lines with tabs.

    Raises:
        FileProblem: it holds too many cells.
    """
    sheet.reset_dimensions()  # what the file claims is not believed
    cells = 0
    for row in sheet.iter_rows(values_only=True):
        cells += len(row) + 1
        check_size(file, cells)
        yield "\t".join(_text(cell) for cell in row[:MOST_COLUMNS])


def _text(cell: object) -> str:
    if cell is None or isinstance(cell, bool):
        return "" if cell is None else str(int(cell))
    if isinstance(cell, (int, float)):
        return repr(cell)
    if isinstance(cell, timedelta):
        seconds, microseconds = divmod(round(cell.total_seconds() * 1e6), 1_000_000)
        return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}.{microseconds:06d}"
    if isinstance(cell, datetime):
        return cell.replace(tzinfo=None).isoformat(" ", "microseconds")
    if isinstance(cell, time):
        return cell.replace(tzinfo=None).isoformat("microseconds")
    if isinstance(cell, date):
        return cell.isoformat()
    return " ".join(str(cell).split()).replace('"', "''")
