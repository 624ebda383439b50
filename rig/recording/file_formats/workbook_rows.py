"""Child process that reads the rows of a workbook; started by `workbook_file`, with the workbook as input.

python-calamine allocates the rectangle up to a sheet's last cell and ends the process if that fails, so a small file
with a cell in the last row and column would end `rig import`. In its own process, with limits, it ends only itself.
Nothing of a workbook is executed: calamine reads the values that formulas had when the workbook was saved.

Output: one line of JSON for each sheet (`name`, `hidden`, `lines`, `merged`), each followed by its rows as lines of
tabs; or one line with the key `problem`, or `error` for what the library reports.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import sys
from datetime import date, datetime, time, timedelta

MEMORY_BYTES, CPU_S = 2 << 30, 120
"""Limits of this process, where the operating system has them."""


def main(most_cells: int, most_columns: int, decimal: str = "") -> None:
    """Write the rows of the workbook on standard input to standard output.

    Args:
        most_cells: more are a problem.
        most_columns: cells of a row to the right of these are left out.
        decimal: decimal separator of numbers in cells that contain text; empty: not stated.
    """
    from python_calamine import CalamineWorkbook, SheetTypeEnum, SheetVisibleEnum

    cells = 0
    number = number_pattern(decimal)
    book = CalamineWorkbook.from_filelike(io.BytesIO(sys.stdin.buffer.read()))
    for one in book.sheets_metadata:
        if one.typ != SheetTypeEnum.WorkSheet:
            continue
        opened = book.get_sheet_by_name(one.name)
        (_, left), (bottom, right) = opened.start or (0, 0), opened.end or (-1, -1)
        cells += (bottom + 1) * (right + 1)
        if cells > most_cells:
            _write({"problem": f"the workbook contains {cells} cells or more; at most {most_cells} are allowed"})
            return
        merged = [[*first, *last] for first, last in opened.merged_cell_ranges or []]
        hidden = one.visible != SheetVisibleEnum.Visible
        _write({"name": one.name, "hidden": hidden, "lines": bottom + 1, "merged": merged})
        for row in opened.iter_rows():  # begins at the first row, but at the first column that is used
            sys.stdout.write("\t" * left + "\t".join(cell_text(cell, number) for cell in row[:most_columns]) + "\n")


def _write(line: dict[str, object]) -> None:
    sys.stdout.write(json.dumps(line) + "\n")


def number_pattern(decimal: str) -> re.Pattern[str] | None:
    """Matches a number with this decimal separator, whose thousands may be separated by the other one."""
    if not decimal:
        return None
    other = re.escape({",": ".", ".": ","}[decimal])
    return re.compile(rf"([+-]?(?:\d{{1,3}}(?:{other}\d{{3}})+|\d*))(?:{re.escape(decimal)}(\d*))?([eE][+-]?\d+)?")


def cell_text(cell: object, number: re.Pattern[str] | None) -> str:
    """Text of a cell, with a decimal point in numbers.

    Args:
        cell: value of the cell.
        number: pattern of a number in a cell that contains text; None: such cells are not converted.
    """
    if isinstance(cell, bool):
        return str(int(cell))
    if isinstance(cell, (int, float)):
        return str(int(cell)) if abs(cell) < 1e15 and cell == int(cell) else repr(cell)
    if isinstance(cell, timedelta):
        seconds, microseconds = divmod(round(cell.total_seconds() * 1e6), 1_000_000)
        return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}.{microseconds:06d}"
    if isinstance(cell, datetime):
        return cell.replace(tzinfo=None).isoformat(" ", "microseconds")
    if isinstance(cell, time):
        return cell.replace(tzinfo=None).isoformat("microseconds")
    if isinstance(cell, date):
        return f"{cell.isoformat()} 00:00:00.000000"
    text = " ".join(str(cell).split())
    written = number.fullmatch(text) if number is not None and any(map(str.isdigit, text)) else None
    if written is not None:
        whole, fraction, exponent = (part or "" for part in written.groups())
        return f"{whole.replace(',', '').replace('.', '')}{'.' * bool(fraction)}{fraction}{exponent}"
    return text.replace('"', "''")


def limit() -> None:
    """Limit the memory and the processor time of this process."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for kind, most in ((resource.RLIMIT_AS, MEMORY_BYTES), (resource.RLIMIT_CPU, CPU_S), (resource.RLIMIT_CORE, 0)):
        with contextlib.suppress(ValueError, OSError):  # a lower limit is set already
            resource.setrlimit(kind, (most, most))


if __name__ == "__main__":
    limit()
    sys.stdout = io.TextIOWrapper(sys.stdout.buffer, "utf-8", "replace", newline="\n")
    try:
        main(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:])
    except Exception as error:  # noqa: BLE001 - whatever a damaged file makes of the library; reported by the parent
        _write({"error": f"{type(error).__name__}: {error}"})
    sys.stdout.flush()
