"""What a document is made of. Every block is a value; sections make lists of them and writers read them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rig.document.numbers import number
from rig.document.words import PLAIN, Key, Severity, Words

if TYPE_CHECKING:
    from rig.document.figure import Figure, Panels  # these load numpy, which a list of runs does not need


@dataclass(frozen=True)
class Heading:
    """A heading of level 1 (title), 2 (section) or 3; `listed` is its entry in the contents, `name` its anchor."""

    title: Words
    level: int = 2
    name: str = ""
    listed: str = ""


@dataclass(frozen=True)
class Paragraph:
    """A paragraph; `small` for a remark on what is above or below it."""

    words: Words
    small: bool = False


@dataclass(frozen=True)
class Note:
    """A remark that must not be overlooked."""

    severity: Severity
    words: Words


@dataclass(frozen=True)
class Column:
    """A column: title, unit (empty for none), and whether its cells are numbers, aligned to the right."""

    title: str
    unit: str = ""
    numeric: bool = False

    @property
    def label(self) -> str:
        """Title and unit in one line."""
        return f"{self.title} {self.unit}".rstrip()


Head = str | Column
"""A column by its title alone, or with unit and alignment."""


@dataclass(frozen=True)
class Row:
    """Cells of one row, and the severity of the row as a whole."""

    cells: tuple[Words, ...]
    severity: Severity = PLAIN
    faded: bool = False


@dataclass(frozen=True)
class Table:
    """A table; each row has as many cells as there are columns. `title` is shown above it where it is not empty."""

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    title: str = ""


@dataclass(frozen=True)
class Fact:
    """A number or word that matters, and what it means."""

    value: Words
    meaning: Words
    severity: Severity = PLAIN


@dataclass(frozen=True)
class Facts:
    """The few facts at the top of a document."""

    facts: tuple[Fact, ...]


@dataclass(frozen=True)
class Keys:
    """The key of the figures that follow."""

    keys: tuple[Key, ...]
    label: str = ""


@dataclass(frozen=True)
class Figures:
    """Figures, so many of them side by side."""

    figures: tuple[Figure | Panels, ...]
    across: int = 1


@dataclass(frozen=True)
class Card:
    """A framed group of blocks with its title."""

    title: Words
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Cards:
    """Cards side by side; `large` ones have room for two figures each."""

    cards: tuple[Card, ...]
    large: bool = False


@dataclass(frozen=True)
class Properties:
    """Names and values, one pair a line; empty values are left out."""

    pairs: Mapping[str, object]

    @property
    def shown(self) -> Iterator[tuple[str, str]]:
        """The pairs with a value, as text."""
        for name, value in self.pairs.items():
            if value not in {None, ""}:
                yield name, number(value) if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class Items:
    """A list of texts."""

    items: tuple[Words, ...]


@dataclass(frozen=True)
class Listing:
    """Text as typed into a file or a terminal, line by line."""

    text: str


@dataclass(frozen=True)
class Details:
    """Blocks under a summary, unfolded on request."""

    summary: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Contents:
    """The document's listed headings."""


@dataclass(frozen=True)
class Markup:
    """HTML of a plug-in; `blocks` is the same for the other writers."""

    html: str
    blocks: tuple[Block, ...]


Block = (
    Heading | Paragraph | Note | Table | Facts | Keys | Figures | Cards | Properties | Items | Listing | Details
    | Contents | Markup
)
Blocks = list[Block]


@dataclass(frozen=True)
class Document:
    """A title, for the window and the file's properties, and its blocks in order."""

    title: str
    blocks: Sequence[Block] = field(default_factory=tuple)

    @property
    def listed(self) -> Iterator[Heading]:
        """The headings of the contents."""
        return (block for block in self.blocks if isinstance(block, Heading) and block.listed)


def section(title: Words, note: Words = "", level: int = 2) -> Blocks:
    """A heading, and under it what a reader must know first."""
    return [Heading(title, level), *([Paragraph(note, small=True)] if note else [])]


def table(
    columns: Sequence[Head], rows: Sequence[Sequence[Words] | Row], numeric: Sequence[int] = (),
    title: str = "",
) -> Table:
    """A table from titles and cells; `numeric` are the places of the columns of numbers that are given by title."""
    heads = [
        Column(one, "", place in numeric) if isinstance(one, str) else one for place, one in enumerate(columns)
    ]
    return Table(tuple(heads), tuple(row if isinstance(row, Row) else Row(tuple(row)) for row in rows), title)
