"""A file of another program as a list of columns with names and units, whatever its format."""

from __future__ import annotations

import gc
import io
import re
import sys
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

from rig.errors import FileProblem
from rig.recording.memory import check_memory
from rig.signals.arrays import FloatArray

LARGEST_BYTES = 512 * 1024 * 1024
MOST_NUMBERS = 1 << 27
"""A file's numbers together may take so much memory: 1 GiB of float64."""
MEMORY_OF_A_BYTE, MEMORY_OF_A_NUMBER = 4, 40
"""Bytes of memory needed for an import: per byte of text (measured: 4.6 with short numbers), and per number."""
SPLIT = "split the file into shorter tests"
FACTOR_NAME = re.compile(
    r"scale|scaling|factor|slope|gain|sensitivity|calibration|multiplier|conversion|(?P<offset>offset|intercept)",
    re.IGNORECASE,
)
"""Properties that programs write a factor in."""
FEWEST_ROWS = 2
MOST_COLUMNS = 4096
DEEPEST = 6
"""Groups or structs within each other that are looked into."""


@dataclass(frozen=True)
class TableColumn:
    """One column.

    Attributes:
        name: by which it is called; two columns of a file may share it.
        unit: as the file says; empty where it says none.
        full: another name by which it is found: with its unit as a CSV head has it, or with its group.
        unapplied: a property (`gain = 0.05`) that may be the factor of its integers, and is none of the format's own.
        also: a third name by which it is found: by its number, where a matrix names its columns.
        applied: the factor or conversion of the format that its values already contain.
    """

    name: str
    unit: str = ""
    full: str = ""
    unapplied: str = ""
    also: str = ""
    applied: str = ""


@dataclass(frozen=True)
class Break:
    """A place in a table where the file has lines that are no numbers.

    Attributes:
        row: first row after it, counted from 0.
        line: of the file, the first one that is no row.
        count: how many lines.
        heading: whether the lines repeat the table's heading; otherwise they are notes or events.
        other: rows after it that belong to another table and are left out.
    """

    row: int
    line: int
    count: int
    heading: bool
    other: int = 0


NOT_DESCRIBED: Mapping[str, str] = MappingProxyType({})


class NoLines:
    """What formats without lines answer."""

    described = NOT_DESCRIBED

    def row_name(self, row: int) -> str:
        """See `TableFile.row_name`."""
        return f"row {row + 1}"

    def breaks(self) -> Sequence[Break]:
        """See `TableFile.breaks`."""
        return ()

    def is_stamps(self, place: int) -> bool:
        """See `TableFile.is_stamps`."""
        del place
        return False


class TableFile(Protocol):
    """What every format offers."""

    @property
    def columns(self) -> Sequence[TableColumn]:
        """All columns, in the file's order."""

    @property
    def read_as(self) -> str:
        """How the file was taken, for people: format, and of CSV the dialect."""

    @property
    def described(self) -> Mapping[str, str]:
        """What the file states of the test as a whole, by the names of `ImportedTest.described`."""

    def row_name(self, row: int) -> str:
        """Where a row (from 0) of `values` is in the file, for people: `line 42` or `row 7`."""

    def values(self, places: Sequence[int]) -> list[FloatArray]:
        """Columns by their place, each of shape (rows,), NaN where there is no number; time stamps in s.

        Raises:
            FileProblem: they cannot be read; one line for each value that is wrong.
        """

    def is_stamps(self, place: int) -> bool:
        """Whether a column holds times of day or dates, which `values` gives in s."""

    def breaks(self) -> Sequence[Break]:
        """Where rows that `values` gave one after the other are apart in the file, in order."""

    def own_time(self, places: Sequence[int]) -> FloatArray | Sequence[FloatArray] | None:
        """The time (s) that the format itself has for these columns, shape (rows,); None where it has none.

        Of columns that were sampled each at times of its own a sequence, one time for each.

        Raises:
            FileProblem: the columns were not sampled together, and nothing tells how they belong together.
        """


@dataclass(frozen=True)
class Dialect:
    """What the user states of a file of text or a workbook; None: guessed.

    Attributes:
        separator: between cells: a character, or " " for any white space.
        decimal: point or comma.
        encoding: as Python calls it.
        header_line: line of the names, counted from 1; 0: there is none.
        units_line: line of the units; 0: there is none.
        thousands: sign between thousands: comma, point, apostrophe, " " for any space; "": there is none.
        event_rows: what becomes of rows of words between rows of numbers: `refuse`, `skip` or `split` (the rows before
            and after are tests of their own).
        sheet: of a workbook, one name or several; None: the only one that holds a table.
    """

    separator: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    header_line: int | None = None
    units_line: int | None = None
    thousands: str | None = None
    event_rows: str = "refuse"
    sheet: str | tuple[str, ...] | None = None


def read_bytes(file: Path) -> bytes:
    """A file's content.

    Raises:
        FileProblem: no such file, unreadable, empty, larger than 512 MiB, or too large for the available memory.
    """
    if not file.is_file():
        kind = "is a folder" if file.is_dir() else "is not a regular file" if file.exists() else "no such file"
        raise FileProblem(str(file), [kind])
    size = file.stat().st_size
    if size > LARGEST_BYTES:
        raise FileProblem(str(file), [
            f"the file has {size} bytes; at most {LARGEST_BYTES} are allowed. Fix: {SPLIT}"
        ])  # fmt: skip
    check_memory(file, MEMORY_OF_A_BYTE * size, SPLIT)
    try:
        data = file.read_bytes()
    except OSError as error:
        raise FileProblem(str(file), [f"cannot be read: {error}"]) from error
    if not data:
        raise FileProblem(str(file), ["is empty"])
    return data


def unapplied_factor(properties: Mapping[str, object]) -> str:
    """The first of a channel's properties that looks like the factor or offset of its numbers; empty: none does."""
    for name, value in properties.items():
        match = FACTOR_NAME.search(str(name))
        try:
            number = float(value)  # type: ignore[arg-type]  # whatever a file holds
        except (TypeError, ValueError):
            continue
        if match and number != (0.0 if match["offset"] else 1.0):
            return f"{name!r} = {number:g}"
    return ""


def check_size(file: Path, numbers: int) -> None:
    """Refuse what claims to hold more numbers than can be read.

    Raises:
        FileProblem: it does.
    """
    if numbers > MOST_NUMBERS:
        raise FileProblem(str(file), [
            f"the file declares {numbers} numbers; at most {MOST_NUMBERS} are allowed. Fix: {SPLIT}"
        ])  # fmt: skip
    check_memory(file, MEMORY_OF_A_NUMBER * numbers, SPLIT)


def check_equal_lengths(file: Path, names: Sequence[str], rows: Sequence[int]) -> None:
    """Refuse columns of different lengths.

    Raises:
        FileProblem: they are.
    """
    if len(set(rows)) > 1:
        message = ", ".join(f"{name} {count}" for name, count in zip(names, rows, strict=True))
        raise FileProblem(str(file), [f"the columns have different numbers of rows: {message}; a common time base is "
            "required"])


def unreadable(kind: str, error: BaseException) -> list[str]:
    """What is said of a file that its own format's reader cannot read.

    What the reader had begun with is let go of in silence: its destructors know only whole files.
    """
    message = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        traceback.clear_frames(error.__traceback__)
        gc.collect()
    finally:
        sys.unraisablehook = hook
    return [f"cannot be read as {kind}; the file is damaged or has another format ({message})"]


def stream(data: bytes) -> io.BytesIO:
    """The content as the libraries want it."""
    return io.BytesIO(data)
