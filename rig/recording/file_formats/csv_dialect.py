"""Format of a CSV file: encoding, separator, decimal sign, lines of names, units and numbers.

Guessed from its first lines; the user's options take precedence.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rig.errors import FileProblem
from rig.recording.file_formats.file_units import known_unit
from rig.recording.file_formats.table_file import Dialect

LOOKED_AT = 2000
"""Lines among which the first numbers must be."""
FEWEST_ROWS = 3
REMARKS = 20
"""Lines above the first three rows among which there may be rows with remarks between them."""
SEPARATORS = (";", "\t", ",", "|", " ")
SHOWN = {"\t": "tab", " ": "white space"}
SHOWN_SIGNS = {" ": "space", "\u00a0": "no-break space", "\u2009": "thin space", "\u202f": "narrow no-break space"}
NOTHING = frozenset((
    "", "nan", "na", "n/a", "null", "none", "-", "--", "#n/a", "#div/0!", "#num!", "#value!", "#ref!", "#name?",
    "#null!",
))  # fmt: skip
# Possessive: a cell of 60,000 digits and a letter would take minutes of backtracking.
POINT = re.compile(r"[+-]?(\d++\.?\d*+|\.\d++)([eE][+-]?\d++)?|[+-]?inf(inity)?", re.IGNORECASE)
COMMA = re.compile(r"[+-]?(\d++,?\d*+|,\d++)([eE][+-]?\d++)?", re.IGNORECASE)
NUMBER_LIKE = re.compile(r"[-+]?[\d.,'\s]*\d[\d.,'\s]*([eEdD][-+]?\d{1,3})?")
"""What is a number written in another way, and no word."""
FORTRAN = re.compile(r"(?<![\w.,])[+-]?(\d++[.,]?\d*+|[.,]\d++)[dD][+-]?\d{1,3}(?![\w.])")
FORTRAN_HINT = "has a Fortran exponent with D: write exponents with E (sed -E 's/([0-9.])[Dd]([+-]?[0-9])/\\1E\\2/g')"
GROUPED = {
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?"), ",": re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+(,\d*)?"),
}  # fmt: skip
CLOCK = r"\d{1,2}:\d{2}:\d{2}([.,]\d{1,9})?"
ISO = rf"\d{{4}}(?P<iso>[-/])\d{{2}}(?P=iso)\d{{2}}[T ]{CLOCK}(Z|[+-]\d{{2}}:?\d{{2}})?"
DATE = r"\d{1,2}(?P<sign>[./-])(\d{1,2}|[A-Za-z]{3})(?P=sign)(\d{4}|\d{2})"
STAMP = re.compile(rf"({ISO})|(({DATE} )?{CLOCK}( [AaPp][Mm])?)")
OTHER_STAMPS = tuple((re.compile(form), normal) for form, normal in (
    (r"(.*\d{1,2}:\d\d:\d\d):(\d{1,6})", r"\1.\2"),  # a colon before the milliseconds
    (r"(\d{1,2}):(\d\d[.,]\d+)", r"00:\1:\2"),  # minutes and seconds
    (r"(?:0 days|0d) (\d{1,2}:\d\d:\d\d(?:[.,]\d+)?)", r"\1"),
    (r"(\d{4})\.(\d\d)\.(\d\d)([ T].+)", r"\1-\2-\3\4"),
    (r"(\d{4}-\d\d-\d\d)-(\d\d)\.(\d\d)\.(\d\d(?:[.,]\d+)?)", r"\1T\2:\3:\4"),
    (r"(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d(?:[.,]\d+)?Z?)", r"\1-\2-\3T\4:\5:\6"),
    (r"(\d{4}-.*\d) ([+-]\d\d:?\d\d)", r"\1\2"),  # a space before the time zone
))
"""Further forms of time stamps, and the known form that each is taken as."""
SPACES = " \u00a0\u2009\u202f"
QUOTES = "'\u2019"
"""Signs between thousands that are no decimal sign."""
PARTED = re.compile(rf"[+-]?\d{{1,3}}(?P<sign>[{SPACES}{QUOTES}])\d{{3}}((?P=sign)\d{{3}})*([.,]\d*)?")
GROUP = re.compile(rf"[{SPACES}{QUOTES}](?<=\d.)\d{{3}}")
"""A thousands separator between digits. The pattern starts with the separator, because a search for digits takes ten
times as long."""
MARKS = {
    b"\xff\xfe\0\0": "utf-32", b"\0\0\xfe\xff": "utf-32", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16",
}  # fmt: skip
"""First bytes of a text and its encoding."""
WORD_WITH_UNIT = re.compile(r"\S+(?:\s?[\[(][^\[\]()]*[\])])?")
UNITLESS = frozenset(("", "-", "1", "[-]", "[]", "()", "(-)", "n/a"))


@dataclass(frozen=True)
class CsvLayout:
    """How a file is written; lines are counted from 1, and 0 is none.

    Attributes:
        sample: the first value of each column.
        numeric: of each column, whether most of its first cells are numbers; true of an empty one.
        heading: cells of the line of names as they are in the file.
        units_heading: cells of the line of units.
    """

    separator: str
    decimal: str
    thousands: str
    encoding: str
    header_line: int
    units_line: int
    first_line: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    sample: tuple[str, ...]
    numeric: tuple[bool, ...] = ()
    heading: tuple[str, ...] = ()
    units_heading: tuple[str, ...] = ()

    @property
    def description(self) -> str:
        """For people."""
        separator = SHOWN.get(self.separator, self.separator)
        parts = [f"separator {separator!r}" if len(separator) == 1 else f"separator {separator}",
                 f"decimal {self.decimal!r}"]  # fmt: skip
        parts += [f"thousands {SHOWN_SIGNS.get(self.thousands, repr(self.thousands))}"] if self.thousands else []
        parts += [self.encoding, f"names in line {self.header_line}" if self.header_line else "no names"]
        parts += [f"units in line {self.units_line}"] if self.units_line else []
        return ", ".join((*parts, f"numbers from line {self.first_line}"))


def decoded(file: Path, data: bytes, encoding: str | None) -> tuple[str, str]:
    """The text of a file and its encoding: UTF-8, UTF-16 by its mark, Windows-1252 where only the head is not UTF-8.

    Raises:
        FileProblem: no text, or not in that encoding; with the line.
    """
    chosen = encoding or next((name for mark, name in MARKS.items() if data.startswith(mark)), "utf-8-sig")
    if b"\0" in data and not chosen.lower().replace("_", "-").startswith(("utf-16", "utf-32")):
        line = data.count(b"\n", 0, data.index(b"\0")) + 1
        cut = (
            " up to the end of the file (possibly a loss of power during recording)"
        ) if not data[data.index(b"\0") :].strip(b"\0") else ""
        raise FileProblem(str(file), [
            f"line {line}: zero bytes{cut}; {chosen.removesuffix('-sig')} text contains no zero bytes. Fix: repair or "
            "remove this line, or use --encoding"
        ])  # fmt: skip
    try:
        return data.decode(chosen), chosen.removesuffix("-sig")
    except LookupError as error:
        raise FileProblem(str(file), [f"encoding {encoding!r}: {error}"]) from error
    except UnicodeError as error:
        start = error.start if isinstance(error, UnicodeDecodeError) else 0
        if encoding is None and chosen == "utf-8-sig" and _in_the_head(data):
            return data.decode("cp1252", errors="replace"), "cp1252"
        line = data.count(b"\n", 0, start) + 1
        shown = "UTF-8" if chosen == "utf-8-sig" else chosen
        message = f"line {line}: not valid {shown} text. Fix: specify another encoding with --encoding, such as cp1252"
        raise FileProblem(str(file), [message]) from error


def _in_the_head(data: bytes) -> bool:
    """Whether all bytes that are not ASCII stand before the first numbers."""
    lines = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
    last = max(k for k, line in enumerate(lines) if not line.isascii())
    if last >= LOOKED_AT:
        return False
    layout = _first_rows([line.decode("cp1252", errors="replace") for line in lines[:LOOKED_AT]], Dialect())
    return layout is not None and last < layout[1]


def cells_of(line: str, separator: str) -> list[str]:
    """A line's cells without quotes, outer blanks, and spaces or apostrophes between thousands."""
    if separator == " ":
        return line.split()
    if '"' in line:
        try:
            return [ungrouped(cell.strip()) for cell in next(csv.reader([line], delimiter=separator), [])]
        except csv.Error:
            pass
    return [ungrouped(cell.strip()) for cell in line.split(separator)]


def ungrouped(cell: str) -> str:
    """A number without the spaces or apostrophes between its thousands; anything else as it is."""
    match = PARTED.fullmatch(cell) if len(cell) > 4 else None
    return cell if match is None else cell.replace(match["sign"], "")


def without_groups(text: str, separator: str) -> tuple[str, str]:
    """A text whose numbers have lost the spaces or apostrophes between their thousands, and that sign.

    The sign is empty where no number has one.
    """
    if separator == " " or not any(sign in text for sign in SPACES + QUOTES) or GROUP.search(text) is None:
        return text, ""
    side, signs = rf"[{re.escape(separator)}\"\n]", set[str]()

    def joined(found: re.Match[str]) -> str:
        signs.add(found["sign"])
        return found[1].replace(found["sign"], "")

    text = re.sub(rf"(?:(?<={side})|\A) *({PARTED.pattern}) *(?={side}|\Z)", joined, text)
    return text, min(signs, default="")


def layout_of(file: Path, text: str, encoding: str, stated: Dialect) -> CsvLayout:
    """Guess how a text is written.

    Raises:
        FileProblem: no rows of numbers among the first lines, or the decimal sign is not clear.
    """
    lines = _first_lines(text)
    rows = _first_rows(lines, stated)
    if rows is None:
        fortran = next((hint for k, line in enumerate(lines) if (hint := _fortran_in(k + 1, line))), "")
        raise FileProblem(str(file), [
            f"no rows of numbers in the first {len(lines)} lines (expected at least three rows of two columns). "
            "Fix: "
            + (fortran or "specify the layout with --separator, --decimal and --header-line"),
        ])  # fmt: skip
    separator, first, count = rows
    sample = [cells for line in lines[first : first + 200] if (cells := cells_of(line, separator))]
    decimal, thousands = signs_of(file, sample, stated)
    header, units = _head(lines, first, separator, stated)
    named = _fitting(lines, header, separator, count, sample)
    names = named or [f"#{k + 1}" for k in range(count)]
    unit_cells = (_fitting(lines, units, separator, count, ()) or [""] * count) if units else [""] * count
    unit_cells = ["" if text in UNITLESS else text.strip("[]()").strip() for text in unit_cells]
    numeric = []
    for k in range(count):
        present = [cells[k] for cells in sample if k < len(cells) and cells[k].lower() not in NOTHING]
        numeric.append(2 * sum(is_any_number(cell) or is_stamp(cell) for cell in present) >= len(present))
    return CsvLayout(
        separator, decimal, thousands, encoding, header if named else 0, units, first + 1, tuple(names),
        tuple(unit_cells),
        tuple(next((cells[k] for cells in sample if k < len(cells) and cells[k].lower() not in NOTHING), "")
              for k in range(count)),
        tuple(numeric), tuple(cells_of(lines[header - 1], separator)) if named and header else (),
        tuple(cells_of(lines[units - 1], separator)) if units else (),
    )  # fmt: skip


def _first_lines(text: str) -> list[str]:
    """First lines of a text, without splitting the whole text."""
    end = -1
    for _ in range(LOOKED_AT):
        end = text.find("\n", end + 1)
        if end < 0:
            return text.split("\n")
    return text[:end].split("\n")


def _fortran_in(line_number: int, line: str) -> str:
    """What to do about the first Fortran number of a line; empty where it has none."""
    number = FORTRAN.search(line)
    return f"line {line_number}: {number[0]!r} {FORTRAN_HINT}" if number else ""


def _first_rows(lines: Sequence[str], stated: Dialect, *, words: bool = False) -> tuple[str, int, int] | None:
    """Separator, index of the first line of numbers, and cells a line: what makes most lines rows of numbers.

    Rows of which some cells are words are looked for only where there are no others.
    """
    after = max(stated.header_line or 0, stated.units_line or 0)
    best: tuple[int, int, tuple[str, int, int]] | None = None
    for separator in (stated.separator,) if stated.separator else SEPARATORS:
        counts = [_numbers_in(cells_of(line, separator), words) if k >= after else 0
                  for k, line in enumerate(lines)]  # fmt: skip
        run = _longest_start(counts)
        if run is None:
            continue
        first, length, cells = run
        first = _below_heading(lines, separator, first, cells)
        if best is None or (length, cells) > best[:2]:
            best = (length, cells, (separator, first, cells))
    if best is None and not words:
        return _first_rows(lines, stated, words=True)
    return None if best is None else best[2]


def _below_heading(lines: Sequence[str], separator: str, first: int, width: int) -> int:
    """The first row below the heading, where remarks in or among the first rows hide it; else `first`."""
    start = first
    for k in range(first - 1, max(-1, first - REMARKS), -1):
        cells = cells_of(lines[k], separator)[:width]
        numbers = sum(is_any_number(cell) or is_stamp(cell) for cell in cells)
        if numbers > 1 and 2 * numbers >= sum(cell.lower() not in NOTHING for cell in cells):
            start = k
        elif len(cells) == width and not numbers and all(
            name for name, cell in zip(cells, cells_of(lines[first], separator), strict=False) if is_any_number(cell)
        ):
            return start if start == k + 1 else first
    return first


def _longest_start(counts: Sequence[int]) -> tuple[int, int, int] | None:
    """First line, number of lines and cells of the first stretch of at least three lines of numbers.

    Lines of another width, or that are no numbers, may lie among them: they are wrong there, not the end.
    """
    for first in range(len(counts)):
        following = counts[first : first + FEWEST_ROWS]
        if counts[first] and len(following) > 1 and following.count(counts[first]) == len(following):
            width = Counter(count for count in counts[first:] if count).most_common(1)[0][0]
            if width == counts[first]:
                return first, counts[first:].count(width), width
    return None


def _numbers_in(cells: Sequence[str], words: bool) -> int:
    """How many cells a line of numbers has; 0 where it is none.

    At least two cells are numbers, and none is a word; with `words` no more are words than numbers.
    """
    if len(cells) < 2:
        return 0
    present = [cell for cell in cells if cell.lower() not in NOTHING]
    numbers = sum(is_any_number(cell) or is_stamp(cell) for cell in present)
    least = len(present) / 2 if words else len(present)
    return len(cells) if numbers > 1 and numbers >= least else 0


def is_any_number(cell: str) -> bool:
    """Whether a cell is a number with either decimal sign."""
    return _is_number(cell, ".") or _is_number(cell, ",")


def _is_number(cell: str, decimal: str) -> bool:
    return is_number(cell, decimal, grouped=True)


def is_number(cell: str, decimal: str, *, grouped: bool) -> bool:
    """Whether a cell is a number with that decimal sign; `grouped`: its thousands may be parted by the other one."""
    whole = POINT if decimal == "." else COMMA
    return bool(whole.fullmatch(cell) or (grouped and GROUPED[decimal].fullmatch(cell)))


def _grouped(decimal: str, cell: str) -> bool:
    return GROUPED[decimal].fullmatch(cell) is not None


def is_stamp(cell: str) -> bool:
    """Whether a cell is a time of day, with a date or not: ISO 8601, 31.12.2026 23:59:59, 12/31/26 11:59:59 PM."""
    return not POINT.fullmatch(cell) and STAMP.fullmatch(normal_stamp(cell)) is not None


def normal_stamp(cell: str) -> str:
    """A time stamp of one of the `OTHER_STAMPS` as one that `STAMP` knows; any other cell as it is."""
    if STAMP.fullmatch(cell):
        return cell
    for form, normal in OTHER_STAMPS:
        if form.fullmatch(cell):
            return form.sub(normal, cell)
    return cell


def stamp_forms(stamp: str) -> tuple[str, ...]:
    """How time stamps like that one may be written, as pandas says it; none where it is a plain time of day.

    Two if one stamp does not show whether day or month comes first.
    """
    if re.match(r"\d{4}[-/]", stamp):
        return ("ISO8601",)
    noon = stamp[-1] in "Mm"
    clock = ("%I" if noon else "%H") + ":%M:%S" + (".%f" if "." in stamp[stamp.index(":") :] else "") + " %p" * noon
    date = re.match(DATE, stamp)
    if date is None:
        return (clock,) if noon else ()
    sign, middle, year = date["sign"], date[2], "%Y" if len(date[3]) == 4 else "%y"
    if middle.isalpha():
        return (f"%d{sign}%b{sign}{year} {clock}",)
    orders = (("%d", "%m"),) if sign == "." else (("%d", "%m"), ("%m", "%d"))
    return tuple(f"{sign.join((*order, year))} {clock}" for order in orders)


def signs_of(file: Path, rows: Sequence[Sequence[str]], message: Dialect) -> tuple[str, str]:
    """Decimal and thousands sign.

    Raises:
        FileProblem: some numbers have a comma, others a point, and none has both; or every one may be thousands.
    """
    stated = message.decimal
    if stated is None and message.thousands in {",", "."}:
        stated = "." if message.thousands == "," else ","
    if stated is not None and stated == message.thousands:
        raise FileProblem(str(file), [f"--decimal and --thousands are both {stated!r}"])
    cells = [cell for row in rows for cell in row if not is_stamp(cell)]
    both = [cell for cell in cells if "," in cell and "." in cell and any(map(_grouped, ".,", (cell, cell)))]
    decimal = stated or next(("," if cell.rfind(",") > cell.rfind(".") else "." for cell in both), "")
    commas = [cell for cell in cells if COMMA.fullmatch(cell) and "," in cell]
    points = [cell for cell in cells if POINT.fullmatch(cell) and "." in cell]
    way_out = (
        "Fix: specify the decimal separator with --decimal ',' or --decimal ., or the thousands separator with "
        "--thousands"
    )
    if not decimal and commas and points:
        raise FileProblem(str(file), [f"both {commas[0]!r} and {points[0]!r} occur as numbers. {way_out}"])
    unclear = commas or points
    if not decimal and unclear and all(_grouped("." if commas else ",", cell) for cell in unclear):
        whole = re.sub("[.,]", "", unclear[0])
        raise FileProblem(str(file), [
            f"{unclear[0]!r} may be {whole} or a number with three decimals, like every other number with this "
            f"separator. {way_out}",
        ])  # fmt: skip
    decimal = decimal or ("," if commas else ".")
    other = "," if decimal == "." else "."
    if message.thousands is not None:
        return decimal, other if message.thousands == other else ""
    grouped = any(other in cell and _grouped(decimal, cell) for cell in cells)
    return decimal, other if grouped and (both or stated) else ""


def _head(lines: Sequence[str], first: int, separator: str, stated: Dialect) -> tuple[int, int]:
    """Lines of names and units (from 1, 0: none): directly above the numbers, as far as they are not blank."""
    above = [k for k in range(first) if lines[k].strip(f" {separator}")]
    units = 0
    if stated.units_line is not None:
        units = stated.units_line
    elif (
        len(above) > 1 and stated.header_line != above[-1] + 1 and _is_units(cells_of(lines[above[-1]], separator))
        and len(cells_of(lines[above[-2]], separator)) > 1
    ):  # fmt: skip
        units = above[-1] + 1
    if stated.header_line is not None:
        return stated.header_line, units
    below_names = [k for k in above if k + 1 != units and (not units or k + 1 < units or stated.units_line)]
    return (below_names[-1] + 1 if below_names else 0), units


def _is_units(cells: Sequence[str]) -> bool:
    """Whether a line holds units: at least one that is known, and else what may be one."""
    known = [cell for cell in cells if known_unit(cell)]
    short = all(len(cell) <= 12 and not re.search(r"\s\S+\s", cell) for cell in cells)
    return bool(known) and short and all(cell in UNITLESS or known_unit(cell) or len(cells) > 2 for cell in cells)


def _fitting(
    lines: Sequence[str], line: int, separator: str, count: int, sample: Sequence[Sequence[str]]
) -> list[str] | None:
    """The cells of a line of names or units (from 1), one for each column; None if the assignment is ambiguous.

    Fewer than columns with numbers: which one has none? Between white space also more, unless units in brackets or
    wider gaps tell.
    """
    if not 1 <= line <= len(lines):
        return None
    text = lines[line - 1].strip("\ufeff")
    cells = [cell.strip("\ufeff") for cell in cells_of(text, separator)]
    if separator == " " and len(cells) != count:
        wide, bracketed = re.split(r"\s{2,}|\t", text.strip()), WORD_WITH_UNIT.findall(text)
        return next((split for split in (wide, bracketed) if len(split) == count), None)
    held = max((k + 1 for row in sample for k, cell in enumerate(row) if cell.lower() not in NOTHING), default=0)
    if len(cells) < held:
        return None
    return [*cells, *[""] * (count - len(cells))][:count]
