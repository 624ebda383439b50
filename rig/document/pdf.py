"""Documents as PDF (A4 or US letter) with vector graphics, bookmarks and page numbers.

No browser is needed.
"""

from __future__ import annotations

import html
import io
import itertools
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache, partial
from typing import Any

from reportlab.graphics import renderPDF
from reportlab.graphics import shapes as graphics
from reportlab.lib.colors import HexColor
from reportlab.lib.pagesizes import A4, letter
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.pdfbase.pdfmetrics import stringWidth
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import (
    CondPageBreak,
    Flowable,
    Image,
    KeepInFrame,
    PageBreak,
    Preformatted,
    SimpleDocTemplate,
    Spacer,
)
from reportlab.platypus import Paragraph as Flow
from reportlab.platypus import Table as Grid

from rig.document import blocks as b
from rig.document import fonts, style
from rig.document.drawing import OPACITY, STROKES, Drawing, Letters, drawing_of
from rig.document.drawing import Line as Stroked
from rig.document.figure import Style
from rig.document.fonts import known
from rig.document.picture import Picture
from rig.document.svg import LABEL, LETTERS, TEXT
from rig.document.words import PLAIN, Code, Key, Label, Shade, Span, Strong, Words, parts, plain, printed

MARGIN = 11 * mm
BOTTOM = 13 * mm
PAPERS = {"A4": A4, "letter": letter}
FRAME = 6.0
"""Padding of the library's frames, points."""
INK, SOFT, LINE = HexColor(style.INK), HexColor(style.SOFT), HexColor(style.LINE)
LARGE, SMALL = 3, 4
"""Cards side by side."""
HIGH_CARD, LOW_CARD, FEW_ROWS, TITLE = 52 * mm, 37 * mm, 24 * mm, 12 * mm
"""What must fit below a heading, else it begins a page."""
ROW_HEIGHT, MOST_TOGETHER = 3.6 * mm, 30
"""Of a line of a table; a table of so many rows at most is not broken behind its heading."""
GAP = 2 * mm
MARK_TOP, MARK_HEIGHT = 9 * mm, 4.6 * mm
"""Of a document's mark: its lower edge below that of the page, and its height."""
SHEET_SCALES = (1.4, 1.32, 1.24, 1.16, 1.08, 1.0, 0.92, 0.84)
"""Sizes of letters at which the blocks of one page are tried; from the last on everything is made smaller."""
FUZZ = 0.5
CONTENTS_SIZE = 8.0
LOGO_HEIGHT, LOGO_SHARE = 13 * mm, 0.28
SPACE = "\N{NO-BREAK SPACE}"
SIZE, PADDING = 6.0, 2.2
"""Of table cells: letters and the room beside them, points."""
FINEST, SMALLEST = 0.25, 4.3
"""Of a figure's lines and letters, points."""
LINE_CAP_BUTT, LINE_CAP_ROUND = 0, 1

Flowables = list[Any]


def pdf(document: b.Document) -> bytes:
    """A document as a PDF."""
    fonts.register()
    target, paper = io.BytesIO(), PAPERS[document.paper]
    width = paper[0] - 2 * MARGIN
    template = SimpleDocTemplate(
        target, pagesize=paper, leftMargin=MARGIN - FRAME, rightMargin=MARGIN - FRAME, topMargin=MARGIN,
        bottomMargin=BOTTOM,
        title=known(document.title), creator="mr-damper-rig",
    )  # fmt: skip
    flow = list(_flow(document.blocks, width))
    links = [(block.name, block.listed) for block in document.listed]
    filled = [part for one in flow for part in (_contents(links, width) if isinstance(one, _ContentsPlace) else [one])]
    while filled and isinstance(filled[-1], PageBreak):  # a document that ends with a sheet has no empty page
        filled.pop()
    template.build(filled, canvasmaker=partial(_NumberedCanvas, mark=document.mark, paper=paper))
    return target.getvalue()


def figure_pdf(drawing: Drawing) -> bytes:
    """A figure alone, on a page of its size."""
    fonts.register()
    return bytes(renderPDF.drawToString(_drawn(drawing, drawing.width * 0.75)))


class _NumberedCanvas(Canvas):  # type: ignore[misc]  # the library has no annotations
    """A canvas that knows how many pages there are when it writes their numbers: all are kept until the end.

    `marks` are the headings of the page so far: level, title, anchor, height on the page (points). `entries` are the
    lines of the contents on it: anchor, and where the number of its page ends (points). `paper` is the size of the
    pages (points).
    """

    def __init__(self, *arguments: object, mark: str, paper: tuple[float, float], **options: object) -> None:
        super().__init__(*arguments, **options)
        self._kept: list[dict[str, Any]] = []
        self._mark, self.paper = mark, paper
        self.marks: list[tuple[int, str, str, float]] = []
        self.entries: list[tuple[str, float, float]] = []

    def showPage(self) -> None:
        """Keep the page."""
        self._kept.append(dict(self.__dict__))
        self._startPage()
        self.marks, self.entries = [], []

    def save(self) -> None:
        """Write every page with its number, its mark and its bookmarks."""
        level, count = -1, itertools.count()
        pages = {name: page for page, state in enumerate(self._kept, 1) for _, _, name, _ in state["marks"] if name}
        for number, state in enumerate(self._kept, start=1):
            self.__dict__.update(state)
            self._write_edges(f"page {number} of {len(self._kept)}")
            self.setFont("Sheet", CONTENTS_SIZE)
            for anchor, x, y in self.entries:
                self.drawRightString(x, y, str(pages.get(anchor, "")))
            for requested, title, anchor, top in self.marks:
                level = min(requested, level + 1)  # an outline may not skip a level
                name = anchor or f"heading {next(count)}"
                self.bookmarkHorizontalAbsolute(name, top)
                self.addOutlineEntry(title, name, level, closed=level > 0)
            super().showPage()
        super().save()

    def _write_edges(self, number: str) -> None:
        """Title and number below the page, the document's mark above it."""
        self.setFont("Sheet", 7)
        self.setFillColor(SOFT)
        self.drawString(MARGIN, 7 * mm, str(self._doc.info.title)[:110])
        width, height = self.paper
        self.drawRightString(width - MARGIN, 7 * mm, number)
        if self._mark:
            self.setFillColor(HexColor(style.MARK_PAPER))
            self.rect(MARGIN, height - MARK_TOP, width - 2 * MARGIN, MARK_HEIGHT, stroke=0, fill=1)
            self.setFillColor(HexColor(style.MARK_INK))
            self.setFont("Sheet-Bold", 8)
            self.drawCentredString(width / 2, height - MARK_TOP + 1.4 * mm, known(self._mark))
            self.setFillColor(SOFT)


class _Bookmark(Flowable):  # type: ignore[misc]  # the library has no annotations
    """Marks where a heading is; draws nothing."""

    width = height = 0.0
    _ZEROSIZE = True  # else a container does not draw it

    def __init__(self, level: int, title: str, name: str) -> None:
        super().__init__()
        self._mark = level, title, name

    def wrap(self, *_room: float) -> tuple[float, float]:
        """It takes no room."""
        return 0.0, 0.0

    def draw(self) -> None:
        """Leave the mark on the canvas."""
        self.canv.marks.append((*self._mark, self.canv.absolutePosition(0.0, 0.0)[1]))


class _ContentsPlace(Flowable):  # type: ignore[misc]  # the same
    """Where the contents belong, which are known once all headings are."""


class _ContentsLine(Flowable):  # type: ignore[misc]  # the same
    """A line of the contents: the title is a link, the number of the page is written at the end."""

    def __init__(self, name: str, title: str, width: float) -> None:
        super().__init__()
        self._name, self._title, self.width, self.height = name, title, width, 1.6 * CONTENTS_SIZE

    def wrap(self, *_room: float) -> tuple[float, float]:
        """As wide as it was made."""
        return self.width, self.height

    def draw(self) -> None:
        """The title, and for the canvas where the number belongs."""
        self.canv.setFont("Sheet", CONTENTS_SIZE)
        self.canv.setFillColor(INK)
        self.canv.drawString(0.0, 3.0, known(self._title))
        self.canv.linkRect("", self._name, (0.0, 0.0, self.width, self.height), relative=1, thickness=0)
        self.canv.entries.append((self._name, *self.canv.absolutePosition(self.width, 3.0)))


def _contents(links: Sequence[tuple[str, str]], width: float) -> Flowables:
    """The contents in two columns, downwards."""
    if not links:
        return []
    half = math.ceil(len(links) / 2)
    lines = [_ContentsLine(name, title, width / 2 - 4 * GAP) for name, title in links]
    rows = [[lines[row], lines[half + row] if half + row < len(lines) else ""] for row in range(half)]
    title = Flow("Contents", _style("h2"))
    return [title, Grid(rows, colWidths=[width / 2] * 2, style=_BARE), Spacer(0, GAP)]


class _OnePage(Flowable):  # type: ignore[misc]  # the same
    """Blocks on a separate page, scaled to fit."""

    def __init__(self, blocks: Sequence[b.Block], width: float) -> None:
        super().__init__()
        self._blocks, self._width = blocks, width
        self._scale, self._content = 1.0, KeepInFrame(width, 0.0, [])

    def wrap(self, *_room: float) -> tuple[float, float]:
        """The size of the page."""
        room = self.canv.paper[1] - MARGIN - BOTTOM - 2 * FRAME - 2.0
        for self._scale in SHEET_SCALES:
            width, height = self._width / self._scale, room / self._scale
            last = self._scale == SHEET_SCALES[-1]
            flow = _unbroken(self._blocks, width)
            self._content = KeepInFrame(width, height, flow, mode="shrink" if last else "overflow")
            self._content.wrapOn(self.canv, width, height)
            if self._content.height < height - FUZZ:  # one that overflows states the height that it may have
                break
        self.width, self.height = self._width, self._scale * self._content.height
        return self.width, self.height

    def draw(self) -> None:
        """Everything, to scale."""
        self.canv.scale(self._scale, self._scale)
        self._content.drawOn(self.canv, 0.0, 0.0)


@cache
def _style(name: str) -> ParagraphStyle:
    size, leading, before, after, colour = {
        "h1": (14, 17, 0, 1, INK), "h2": (10.5, 13, 7, 2, INK), "h3": (8.5, 10.5, 4, 1.5, INK),
        "p": (7, 8.6, 0, 2, INK), "lead": (6.5, 8, 0, 2, SOFT), "card": (6.5, 8, 0, 1, INK),
        "fact": (7, 10, 0, 0, SOFT), "cell": (6, 7.2, 0, 0, INK), "name": (6, 7.2, 0, 0, SOFT),
        "right": (6, 7.2, 0, 0, INK),
        "head": (6, 7.2, 0, 0, INK), "headright": (6, 7.2, 0, 0, INK),
    }[name]  # fmt: skip
    bold = name in {"h1", "h2", "h3", "head", "headright"}
    return ParagraphStyle(
        name, fontName="Sheet-Bold" if bold else "Sheet", fontSize=size, leading=leading, spaceBefore=before,
        spaceAfter=after, textColor=colour, alignment=2 if name.endswith("right") else 0,
    )  # fmt: skip


def inline(words: Words) -> str:
    """A text with the markup of the library's paragraphs."""
    return "".join(_text(part) if isinstance(part, str) else _span(part) for part in printed(words))


def _text(value: object) -> str:
    return html.escape(known(str(value))).replace("\n", "<br/>")


def _span(span: Span) -> str:
    content = _text(span)
    match span:
        case Strong():
            return f"<b>{content}</b>"
        case Code():
            return f'<font name="Sheet-Mono">{content}</font>'
        case Label():
            paper, ink = style.LABELS[span.severity]
            return f'<font backColor="{paper}" color="{ink}">{SPACE}{content}{SPACE}</font>'
        case Shade():
            return f'<font backColor="{style.shade_colour(span.share)}">{SPACE}{content}{SPACE}</font>'
        case Key():
            sign = f"\N{EN DASH}{SPACE}\N{EN DASH}" if span.dashed else "\N{EM DASH}\N{EM DASH}"
            return f'<font color="{span.colour}"><b>{sign}</b></font>{SPACE}{content.replace(" ", SPACE)}{SPACE * 3} '
    return content


def _flow(blocks: Iterable[b.Block], width: float) -> Iterator[Any]:
    """Blocks one below the other; a heading is not left alone at the end of a page."""
    listed = list(blocks)
    for place, block in enumerate(listed):
        if isinstance(block, b.Heading) and block.level > 1:
            least = max(map(_least, listed[place + 1 : place + 4]), default=FEW_ROWS)
            yield CondPageBreak(least + (TITLE if block.level == 2 else 0))
        yield from _WRITERS[type(block)](block, width)


def _least(block: b.Block) -> float:
    """The height (points) that the first part of a block needs."""
    if isinstance(block, b.Cards):
        return float(HIGH_CARD if block.large else LOW_CARD)
    if isinstance(block, (b.Table, b.Properties)):
        rows = len(block.rows) + 1 if isinstance(block, b.Table) else -(-len(list(block.shown)) // block.across)
        return max(float(FEW_ROWS), rows * ROW_HEIGHT) if rows <= MOST_TOGETHER else float(FEW_ROWS)
    return float(HIGH_CARD if isinstance(block, b.Figures) else FEW_ROWS)


def _heading(block: b.Heading, _width: float) -> Iterator[Any]:
    yield _Bookmark(block.level - 1, known(plain(block.title)), block.name)
    yield Flow(inline(block.title), _style(f"h{block.level}"))


def _paragraph(block: b.Paragraph, _width: float) -> Iterator[Any]:
    yield Flow(inline(block.words), _style("lead" if block.small else "p"))


def _note(block: b.Note, width: float) -> Iterator[Any]:
    yield Grid([[[Flow(inline(block.words), _style("p"))]]], colWidths=[width], style=[
        ("LINEBEFORE", (0, 0), (0, -1), 3, HexColor(style.BARS[block.severity])),
        ("LEFTPADDING", (0, 0), (-1, -1), 7), ("TOPPADDING", (0, 0), (-1, -1), 1),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 1),
    ])  # fmt: skip
    yield Spacer(0, 1 * mm)


BASE: list[tuple[Any, ...]] = [
    ("FONT", (0, 0), (-1, -1), "Sheet", SIZE, 7.2), ("VALIGN", (0, 0), (-1, -1), "TOP"),
    ("LINEBELOW", (0, 0), (-1, -1), 0.4, LINE), ("LEFTPADDING", (0, 0), (-1, -1), PADDING),
    ("RIGHTPADDING", (0, 0), (-1, -1), PADDING), ("TOPPADDING", (0, 0), (-1, -1), 0.7),
    ("BOTTOMPADDING", (0, 0), (-1, -1), 1.2),
]  # fmt: skip


def _table(block: b.Table, width: float) -> Iterator[Any]:
    if block.title:
        yield Flow(_text(block.title), _style("h3"))
    head = [column.label for column in block.columns]
    styles = ["right" if column.numeric else "cell" for column in block.columns]
    measured = (
        [_measured(cell, whole=name == "right") for cell, name in zip(row.cells, styles, strict=True)]
        for row in block.rows
    )
    widths = column_widths([head, *measured], width)
    cells = [[
        Flow(_head(column), _style("headright" if column.numeric else "head")) for column in block.columns
    ]]  # fmt: skip
    for row in block.rows:
        cells.append([_cell(*one) for one in zip(row.cells, widths, styles, strict=True)])
    right = [("ALIGN", (place, 1), (place, -1), "RIGHT") for place, name in enumerate(styles) if name == "right"]
    shade = [("BACKGROUND", (0, 0), (-1, 0), HexColor(style.SHADE))]
    yield Grid(cells, colWidths=widths, repeatRows=1, hAlign="LEFT", style=[*BASE, *right, *shade])
    yield Spacer(0, GAP)


def _head(column: b.Column) -> str:
    unit = f' <font name="Sheet" color="{style.SOFT}">{_text(column.unit)}</font>' if column.unit else ""
    return _text(column.title) + unit


def _measured(words: Words, *, whole: bool) -> str:
    """A cell's text with the room that its labels take; a `whole` one is not folded."""
    text = known(plain(words)) + SPACE * 2 * sum(isinstance(part, (Label, Shade)) for part in parts(words))
    text += SPACE * sum(len(part.text) // 5 + 1 for part in parts(words) if isinstance(part, Strong))  # bold is wider
    return text.replace(" ", SPACE) if whole else text


def _cell(words: Words, width: float, name: str) -> Any:  # noqa: ANN401 - the library's
    """A plain text where it fits on one line, else a paragraph, which takes longer to lay out."""
    if isinstance(words, str) and "\n" not in words and _wide(text := known(words)) <= width - 2 * PADDING:
        return text
    return Flow(inline(words), _style(name))


def column_widths(texts: Sequence[Sequence[str]], width: float) -> list[float]:
    """As wide as the longest text; where that is too much, long columns shrink, at most to their longest word.

    Args:
        texts: of every cell, row by row, the head first.
        width: of all columns together, points.

    Returns:
        Widths in points, together at most `width`.
    """
    head = [_wide(text, bold=True) for text in texts[0]]
    least = [max((_wide(word, bold=True) for word in text.split()), default=0.0) for text in texts[0]]
    widths = list(least)
    for row in texts[1:]:
        for place, text in enumerate(row):
            least[place] = max([least[place], *(_wide(word) for word in text.split())])
            widths[place] = max(widths[place], least[place], *(_wide(line) for line in text.split("\n")))
    generous = [max(pair) for pair in zip(widths, head, strict=True)]
    padded = [[one + 2 * PADDING + 1.0 for one in row] for row in (generous, widths, least)]
    for most, low in itertools.pairwise(padded):
        over, room = sum(most) - width, sum(most) - sum(low)
        if over <= 0.0:
            return most
        if room >= over:
            return [one - over * (one - end) / room for one, end in zip(most, low, strict=True)]
    return [one * width / sum(padded[-1]) for one in padded[-1]]


def _wide(text: str, *, bold: bool = False) -> float:
    return float(stringWidth(text, "Sheet-Bold" if bold else "Sheet", SIZE)) + 0.5


def _facts(block: b.Facts, width: float) -> Iterator[Any]:
    cells = []
    for fact in block.facts:
        colour = style.INK if fact.severity == PLAIN else style.LABELS[fact.severity][1]
        value = f'<font size="10" color="{colour}"><b>{inline(fact.value)}</b></font>'
        cells.append([Flow(f"{value}<br/>{inline(fact.meaning)}", _style("fact"))])
    if cells:
        yield _grid(cells, block.columns, width)


def _keys(block: b.Keys, _width: float) -> Iterator[Any]:
    label = f"{_text(block.label)}{SPACE * 3}" if block.label else ""
    yield Flow(label + inline(block.keys), _style("p"))


def _figures(block: b.Figures, width: float) -> Iterator[Any]:
    if block.across == 1:
        yield from (_drawn(drawing_of(figure), width) for figure in block.figures)
        return
    share = width / block.across
    drawn = [[_drawn(drawing_of(figure), share)] for figure in block.figures]
    rows = [drawn[start : start + block.across] for start in range(0, len(drawn), block.across)]
    rows[-1] += [[] for _ in range(block.across - len(rows[-1]))]
    yield Grid(rows, colWidths=[share] * block.across, style=_BARE)


def _cards(block: b.Cards, width: float) -> Iterator[Any]:
    columns = 1 if block.wide else LARGE if block.large else SMALL
    yield _grid([_card(card, width / columns - 2 * GAP) for card in block.cards], columns, width)


def _card(card: b.Card, width: float) -> Flowables:
    title = [Flow(inline(card.title), _style("card"))] if card.title else []
    return [*title, *_flow(card.blocks, width)]


def _grid(cards: list[Flowables], columns: int, width: float) -> Grid:
    """Cards in rows, framed; a row is never cut by the end of a page."""
    rows = [[*cards[start : start + columns]] for start in range(0, len(cards), columns)]
    rows[-1] += [[] for _ in range(columns - len(rows[-1]))]
    frames = [
        ("BOX", (index % columns, index // columns), (index % columns, index // columns), 0.5, LINE)
        for index in range(len(cards))
    ]
    padding = [(f"{side}PADDING", (0, 0), (-1, -1), GAP / 2) for side in ("LEFT", "RIGHT", "TOP", "BOTTOM")]
    return Grid(
        rows, colWidths=[width / columns] * columns, style=[("VALIGN", (0, 0), (-1, -1), "TOP"), *frames, *padding]
    )


def _properties(block: b.Properties, width: float) -> Iterator[Any]:
    pairs = [(known(name), value) for name, value in block.shown]
    share = width / block.across
    first = min(0.45 * share, max((_wide(name) for name, _ in pairs), default=0.0) + 3 * PADDING)
    cells = [[Flow(_text(name), _style("name")), Flow(_text(value), _style("cell"))] for name, value in pairs]
    rows = [[*itertools.chain(*cells[start : start + block.across])] for start in range(0, len(cells), block.across)]
    if rows:
        rows[-1] += [""] * (2 * block.across - len(rows[-1]))
        yield Grid(rows, colWidths=[first, share - first] * block.across, hAlign="LEFT", style=BASE)


_BARE = [(f"{side}PADDING", (0, 0), (-1, -1), 0) for side in ("LEFT", "RIGHT", "TOP", "BOTTOM")]


def _beside(block: b.Beside, width: float) -> Iterator[Any]:
    left = block.share * (width - GAP)
    widths = [left, GAP, width - GAP - left]
    sides = [_unbroken(block.left, widths[0]), [], _unbroken(block.right, widths[2])]
    yield Grid([sides], colWidths=widths, style=[*_BARE, ("VALIGN", (0, 0), (-1, -1), "TOP")])


def _unbroken(blocks: Sequence[b.Block], width: float) -> Flowables:
    """The flow of blocks that stay on one page."""
    return [one for one in _flow(blocks, width) if not isinstance(one, CondPageBreak)]


def _cover(block: b.Cover, width: float) -> Iterator[Any]:
    text: Flowables = [_Bookmark(0, known(plain(block.title)), ""), Flow(inline(block.title), _style("h1"))]
    text += [Flow(inline(line), _style("p")) for line in block.lines]
    if block.logo is None:
        yield from text
        return
    room = LOGO_SHARE * width
    yield Grid([[text, _logo(block.logo, room)]], colWidths=[width - room, room], style=[
        *_BARE, ("VALIGN", (0, 0), (-1, -1), "TOP"), ("ALIGN", (1, 0), (1, 0), "RIGHT"),
    ])  # fmt: skip
    yield Spacer(0, GAP)


def _logo(logo: Picture, room: float) -> Any:  # noqa: ANN401 - the library's
    """A picture as high as logos are, no wider than there is room."""
    width = min(room, LOGO_HEIGHT * logo.ratio)
    height = width / logo.ratio
    if logo.kind == "png":
        return Image(io.BytesIO(logo.content), width, height, mask="auto")
    from svglib.svglib import svg2rlg  # an extra, needed for this kind of logo only

    try:
        drawing = svg2rlg(io.BytesIO(logo.content), external_reference_root=os.devnull)
    except Exception:  # noqa: BLE001 - whatever a drawing of another program makes the library raise
        drawing = None
    if drawing is None or not drawing.width or not drawing.height:
        return Flow("The SVG logo cannot be printed. Fix: save it as PNG.", _style("lead"))
    drawing.scale(width / drawing.width, height / drawing.height)
    drawing.width, drawing.height, drawing.hAlign = width, height, "RIGHT"
    return drawing


def _sheet(block: b.Sheet, width: float) -> Iterator[Any]:
    yield _OnePage(block.blocks, width)
    yield PageBreak()


def _signatures(block: b.Signatures, width: float) -> Iterator[Any]:
    count = max(1, len(block.lines))
    share = (width - (count - 1) * 4 * GAP) / count
    widths = [share if place % 2 == 0 else 4 * GAP for place in range(2 * count - 1)]
    plain_rows = [
        [Flow(_text(text), _style("lead")) for text, _ in block.lines],
        [Flow(f"<b>{_text(name)}</b>", _style("p")) for _, name in block.lines],
        [Spacer(0, 7 * mm) for _ in block.lines],
        [Flow(f"Signature{SPACE * 24}Date", _style("lead")) for _ in block.lines],
    ]
    rows = [[cell for one in row for cell in (one, "")][:-1] for row in plain_rows]
    rules = [("LINEABOVE", (2 * place, 3), (2 * place, 3), 0.5, SOFT) for place in range(count)]
    yield Spacer(0, 2 * GAP)
    yield Grid(rows, colWidths=widths, style=[*_BARE, *rules])


def _items(block: b.Items, _width: float) -> Iterator[Any]:
    for item in block.items:
        yield Flow(f"\N{BULLET} {inline(item)}", _style("p"))


def _listing(block: b.Listing, _width: float) -> Iterator[Any]:
    mono = ParagraphStyle("pre", fontName="Sheet-Mono", fontSize=6, leading=7.2)
    yield Preformatted(known(block.text), mono, maxLineLength=140)


def _details(block: b.Details, width: float) -> Iterator[Any]:
    """What is folded on screen is printed."""
    yield Flow(_text(block.summary), _style("lead"))
    yield from _flow(block.blocks, width)


def _markup(block: b.Markup, width: float) -> Iterator[Any]:
    yield from _flow(block.blocks, width)


def _contents_place(block: b.Contents, _width: float) -> Iterator[Any]:
    if block.paper:
        yield _ContentsPlace()


_WRITERS: dict[type[b.Block], Callable[[Any, float], Iterator[Any]]] = {
    b.Heading: _heading, b.Paragraph: _paragraph, b.Note: _note, b.Table: _table, b.Facts: _facts, b.Keys: _keys,
    b.Figures: _figures, b.Cards: _cards, b.Properties: _properties, b.Items: _items, b.Listing: _listing,
    b.Details: _details, b.Markup: _markup, b.Contents: _contents_place,
    b.Beside: _beside, b.Cover: _cover, b.Sheet: _sheet, b.Signatures: _signatures,
}  # fmt: skip


def _drawn(drawing: Drawing, width: float) -> graphics.Drawing:
    """A drawing as wide as said (points)."""
    scale = width / drawing.width
    canvas = graphics.Drawing(width, drawing.height * scale)
    group = graphics.Group(transform=(scale, 0, 0, -scale, 0, drawing.height * scale))
    for mark in drawing.marks:
        group.add(_letters(mark, scale) if isinstance(mark, Letters) else _path(mark, scale))
    canvas.add(group)
    return canvas


def _path(line: Stroked, scale: float) -> graphics.Path:
    stroke = STROKES[line.kind]
    colour = HexColor(line.colour or stroke.colour)
    filled = line.kind == Style.AREA
    path = graphics.Path(
        fillColor=colour if filled else None, fillOpacity=OPACITY if filled else None,
        strokeColor=None if filled else colour,
        strokeWidth=max(stroke.width, FINEST / scale), strokeDashArray=list(stroke.dashes) or None, strokeLineJoin=1,
        strokeLineCap=LINE_CAP_ROUND if line.kind == Style.POINTS else LINE_CAP_BUTT,
    )  # fmt: skip
    for piece in line.pieces:
        first, *rest = piece.tolist()
        path.moveTo(*first)
        for point in rest or (first,):
            path.lineTo(*point)
    return path


def _letters(mark: Letters, scale: float) -> graphics.Group:
    """A text, turned upright again inside the mirrored drawing."""
    size, colour = (LABEL, style.INK) if mark.large else (TEXT, LETTERS)
    text = graphics.String(
        0, 0, known(mark.text), fontName="Sheet", fontSize=max(size, SMALLEST / scale), fillColor=HexColor(colour),
        textAnchor=mark.anchor,
    )  # fmt: skip
    turned = (0, -1, -1, 0) if mark.turned else (1, 0, 0, -1)
    return graphics.Group(text, transform=(*turned, mark.x, mark.y))

