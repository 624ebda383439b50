"""What a document is made of. Every block is a value; sections make lists of them and writers read them."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from rig.document.numbers import number
from rig.document.words import PLAIN, Key, Severity, Words, plain

if TYPE_CHECKING:
    from rig.display import Paper
    from rig.document.figure import Figure, Panels  # these load numpy, which a list of runs does not need
    from rig.document.picture import Picture


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

    @property
    def columns(self) -> int:
        """Number of columns, so that no row has one fact less than it must: 5 in one row, 6 in two of 3."""
        count = len(self.facts)
        return -(-count // max(1, -(-count // MOST_FACTS)))


MOST_FACTS = 5
"""Facts in one row."""


@dataclass(frozen=True)
class Keys:
    """The key of the figures that follow; on `paper` only where a screen shows the same key above."""

    keys: tuple[Key, ...]
    label: str = ""
    paper: bool = False


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
    """Cards side by side; `large` ones have room for two figures each, `wide` ones fill a line on paper."""

    cards: tuple[Card, ...]
    large: bool = False
    wide: bool = False


@dataclass(frozen=True)
class Beside:
    """Two groups of blocks side by side, the left one `share` of the width; one below the other where it is narrow."""

    left: tuple[Block, ...]
    right: tuple[Block, ...]
    share: float = 0.5


@dataclass(frozen=True)
class Cover:
    """The head of a document: its title, lines on what it is about, and the logo."""

    title: Words
    lines: tuple[Words, ...] = ()
    logo: Picture | None = None


@dataclass(frozen=True)
class Sheet:
    """Blocks that are one printed page: they are made smaller where they would not fit."""

    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Signatures:
    """Lines to sign on, each with what is signed and the name of who is to sign; empty for a name to be written."""

    lines: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Properties:
    """Names and values, `across` pairs a line; empty values are left out."""

    pairs: Mapping[str, object]
    across: int = 1

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
    """The document's listed headings; on a `screen`, on `paper` (with the numbers of the pages) or on both."""

    screen: bool = True
    paper: bool = True


@dataclass(frozen=True)
class Markup:
    """HTML of a plug-in; `blocks` is the same for the other writers."""

    html: str
    blocks: tuple[Block, ...]


Block = (
    Heading | Paragraph | Note | Table | Facts | Keys | Figures | Cards | Properties | Items | Listing | Details
    | Contents | Markup | Beside | Cover | Sheet | Signatures
)
Blocks = list[Block]


@dataclass(frozen=True)
class Document:
    """A title, for the window and the file's properties, and its blocks in order.

    `mark` is a warning shown on every page and always on screen; empty for none. `paper` is the size of printed pages.
    """

    title: str
    blocks: Sequence[Block] = field(default_factory=tuple)
    mark: str = ""
    paper: Paper = "A4"

    @property
    def listed(self) -> Iterator[Heading]:
        """The headings of the contents."""
        return (block for block in _flat(self.blocks) if isinstance(block, Heading) and block.listed)

    @property
    def sheets(self) -> Document:
        """The document's printed pages of their own (`Sheet`) without the rest."""
        return replace(self, blocks=tuple(block for block in self.blocks if isinstance(block, Sheet)))


def _flat(blocks: Iterable[Block]) -> Iterator[Block]:
    for block in blocks:
        yield from _flat(block.blocks) if isinstance(block, Sheet) else (block,)


def with_contents(blocks: Sequence[Block]) -> Blocks:
    """Blocks with every heading of level 2 listed in the contents, with an anchor of its own."""
    taken: set[str] = set()

    def listed(block: Block) -> Block:
        if isinstance(block, Sheet):
            return Sheet(tuple(map(listed, block.blocks)))
        if not isinstance(block, Heading) or block.level != 2:
            return block
        title = plain(block.title)
        name = anchor = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "section"
        for number_of_same in itertools.count(2):
            if anchor not in taken:
                break
            anchor = f"{name}-{number_of_same}"
        taken.add(anchor)
        return replace(block, name=block.name or anchor, listed=block.listed or title)

    return [listed(block) for block in blocks]


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
