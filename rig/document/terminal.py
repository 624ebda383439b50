"""Documents as lines of text for any width: aligned columns where they fit, folded text, else one block per row.

Figures are left out: a terminal has no room for them.
"""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from rig.document import blocks as b
from rig.document.words import FAIR, GOOD, PLAIN, POOR, Severity, Words, typed

Line = tuple[str, str]
"""A text without line end, and its style (of rich)."""
STYLES: dict[Severity, str] = {GOOD: "green", FAIR: "yellow", POOR: "red", PLAIN: ""}
HEAD = "bold"
FADED = "dim"
NARROWEST = 20
FOLDED = 14
"""Characters to which a column of text is folded before rows become blocks."""


def lines(blocks: Iterable[b.Block], width: int) -> Iterator[Line]:
    """The lines of some blocks and their styles, none longer than `width` (20 at least) where its words allow."""
    width, before = max(NARROWEST, width), False
    for block in blocks:
        apart = isinstance(block, (b.Heading, b.Table))
        for count, line in enumerate(_WRITERS[type(block)](block, width)):
            if count == 0 and apart and before:
                yield "", ""
            before = not isinstance(block, b.Heading)
            yield line


def wrapped(text: Words, width: int, style: str = "") -> Iterator[Line]:
    """A text in lines of at most `width`, where its words allow; the second and later ones are indented."""
    indent = "  " if width > NARROWEST else ""
    # A path that was broken could not be copied.
    wrapper = textwrap.TextWrapper(
        max(NARROWEST, width), subsequent_indent=indent, break_on_hyphens=False, break_long_words=False
    )
    for part in typed(text).split("\n"):
        for line in wrapper.wrap(part):
            yield line, style


def _heading(block: b.Heading, width: int) -> Iterator[Line]:
    yield from wrapped(block.title, width, HEAD)


def _paragraph(block: b.Paragraph, width: int) -> Iterator[Line]:
    """An empty one is an empty line."""
    yield from wrapped(block.words, width) if block.words else [("", "")]


def _note(block: b.Note, width: int) -> Iterator[Line]:
    yield from wrapped(block.words, width, STYLES[block.severity])


def _facts(block: b.Facts, width: int) -> Iterator[Line]:
    for fact in block.facts:
        yield from wrapped(f"{typed(fact.value)}: {typed(fact.meaning)}", width, STYLES[fact.severity])


def _cards(block: b.Cards, width: int) -> Iterator[Line]:
    for card in block.cards:
        yield from lines(card.blocks, width)


def _properties(block: b.Properties, width: int) -> Iterator[Line]:
    for name, value in block.shown:
        yield from wrapped(f"{name}: {value}", width)


def _items(block: b.Items, width: int) -> Iterator[Line]:
    for item in block.items:
        yield from wrapped(f"- {typed(item)}", width)


def _listing(block: b.Listing, _width: int) -> Iterator[Line]:
    yield from ((line, "cyan") for line in block.text.splitlines())


def _details(block: b.Details, width: int) -> Iterator[Line]:
    yield from wrapped(block.summary, width)
    yield from lines(block.blocks, width)


def _beside(block: b.Beside, width: int) -> Iterator[Line]:
    yield from lines((*block.left, *block.right), width)


def _cover(block: b.Cover, width: int) -> Iterator[Line]:
    yield from wrapped(block.title, width, HEAD)
    for line in block.lines:
        yield from wrapped(line, width)


def _sheet(block: b.Sheet, width: int) -> Iterator[Line]:
    yield from lines(block.blocks, width)


def _signatures(block: b.Signatures, width: int) -> Iterator[Line]:
    for meaning, name in block.lines:
        yield from wrapped(f"{meaning}: {name}", width)


def _markup(block: b.Markup, width: int) -> Iterator[Line]:
    yield from lines(block.blocks, width)


def _nothing(_block: b.Block, _width: int) -> Iterator[Line]:
    yield from ()


def _table(block: b.Table, width: int) -> Iterator[Line]:
    yield from wrapped(block.title, width, HEAD) if block.title else ()
    cells = [tuple(map(typed, row.cells)) for row in block.rows]
    heads = [[column.label] for column in block.columns]
    sizes = [max(map(len, _lines_of(head, place, cells))) for place, head in enumerate(heads)]
    if sum(sizes) + len(sizes) - 1 > width:
        sizes = _folded_sizes(block, cells, width)
        if not sizes:
            yield from _blocks(block, cells, width)
            return
        heads = [[*_folded(column.title, size), column.unit] for column, size in zip(block.columns, sizes, strict=True)]
    yield from _aligned(block, heads, cells, sizes, 2 if sum(sizes) + 2 * (len(sizes) - 1) <= width else 1)


def _lines_of(head: Sequence[str], place: int, cells: Sequence[Sequence[str]]) -> list[str]:
    """Every line of a column, folding aside."""
    return [*head, *(line for row in cells for line in row[place].split("\n"))]


def _folded_sizes(block: b.Table, cells: Sequence[Sequence[str]], width: int) -> list[int]:
    """Widths of the columns with heads and texts folded; empty where not even that fits."""
    sizes, least = [], []
    for place, column in enumerate(block.columns):
        own = [len(line) for line in _lines_of([column.unit], place, cells)]
        words = [len(word) for line in _lines_of([column.title], place, cells) for word in line.split()]
        sizes.append(max(len(column.title), *own))
        least.append(max([*own, *map(len, column.title.split())]) if column.numeric
                     else min(sizes[-1], max(FOLDED, *words, 0)))  # fmt: skip
    for _ in range(sum(sizes) + len(sizes) - 1 - width):
        place = max(range(len(sizes)), key=lambda place: sizes[place] - least[place])
        if sizes[place] <= least[place]:
            return []
        sizes[place] -= 1
    return sizes


def _folded(text: str, size: int) -> list[str]:
    return [line for part in text.split("\n") for line in textwrap.wrap(part, size, break_on_hyphens=False) or [""]]


def _aligned(
    block: b.Table, heads: Sequence[Sequence[str]], cells: Sequence[Sequence[str]], sizes: Sequence[int], gap: int,
) -> Iterator[Line]:
    right = [column.numeric for column in block.columns]

    def row(columns: Sequence[Sequence[str]]) -> Iterator[str]:
        for line in itertools.zip_longest(*columns, fillvalue=""):
            yield (" " * gap).join(
                text.rjust(size) if numeric else text.ljust(size)
                for text, size, numeric in zip(line, sizes, right, strict=True)
            ).rstrip()  # fmt: skip

    for line in row(heads):
        if line:
            yield line, HEAD
    for one, texts in zip(block.rows, cells, strict=True):
        style = FADED if one.faded else STYLES[one.severity]
        folded = [_folded(text, size) for text, size in zip(texts, sizes, strict=True)]
        yield from ((line, style) for line in row(folded))


def _blocks(block: b.Table, cells: Sequence[Sequence[str]], width: int) -> Iterator[Line]:
    """Each row as a line of its first one or two texts and, indented, its other values with title and unit."""
    named = next((place for place, column in enumerate(block.columns) if column.numeric), 1)
    named = max(1, min(named, 2))
    for row, texts in zip(block.rows, cells, strict=True):
        style = FADED if row.faded else STYLES[row.severity]
        yield from wrapped(" ".join(texts[:named]), width, style)
        values = [
            f"{column.title} {text} {column.unit}".strip()
            for column, text in list(zip(block.columns, texts, strict=True))[named:] if text
        ]
        glued = ", ".join(value.replace(" ", "\0") if len(value) < width - 3 else value for value in values)
        for line in textwrap.wrap(glued, width - 2, break_on_hyphens=False):
            yield f"  {line}".replace("\0", " "), ""


_WRITERS: dict[type[b.Block], Callable[[Any, int], Iterator[Line]]] = {
    b.Heading: _heading, b.Paragraph: _paragraph, b.Note: _note, b.Table: _table, b.Facts: _facts, b.Keys: _nothing,
    b.Figures: _nothing, b.Cards: _cards, b.Properties: _properties, b.Items: _items, b.Listing: _listing,
    b.Details: _details, b.Markup: _markup, b.Contents: _nothing,
    b.Beside: _beside, b.Cover: _cover, b.Sheet: _sheet, b.Signatures: _signatures,
}  # fmt: skip
