"""The report on paper: the same page as an A4 PDF, lines and letters as vectors, every page with its number.

No browser is needed: the page's own HTML is laid out with ReportLab, with the fonts that come with matplotlib.
"""

from __future__ import annotations

import html
import importlib.util
import io
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from reportlab.lib.colors import Color, HexColor, toColor
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.pdfbase.pdfmetrics import registerFont, registerFontFamily
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import CondPageBreak, Paragraph, Preformatted, SimpleDocTemplate, Spacer, Table

from rig.errors import RigError
from rig.recording.atomic_write import write_durably
from rig.report.html_tree import SILENT, Node, tree_of
from rig.report.paper import body_table, cells_table, drawing
from rig.report.style import CHIPS
from rig.text_file import read_text

LARGEST_REPORT_BYTES = 256_000_000
MARGIN = 11 * mm
BOTTOM = 13 * mm
WIDTH = A4[0] - 2 * MARGIN
FONTS = {"Sheet": "DejaVuSans.ttf", "Sheet-Bold": "DejaVuSans-Bold.ttf", "Sheet-Mono": "DejaVuSansMono.ttf"}
INK, SOFT, LINE = HexColor("#1c2430"), HexColor("#5b6675"), HexColor("#d8dee6")
CARDS = {"cards": 3, "charts": 4}
"""Cards side by side."""
HIGHEST_CARD, FEW_ROWS = 52 * mm, 24 * mm
"""What must fit below a heading, else it begins a page."""
INLINE = frozenset({"b", "span", "code", "i", "br", "em"})
GAP = 2 * mm
SPACE = "\N{NO-BREAK SPACE}"

Flowables = list[Any]


def write_pdf(report: Path) -> Path:
    """Write `report.pdf` beside a report, from its HTML.

    Args:
        report: the HTML file as `write_report` gives it.

    Returns:
        The PDF's path.

    Raises:
        RigError: the fonts are missing.
        OSError: the report cannot be read, or the PDF not written.
    """
    path = report.with_suffix(".pdf")
    page = read_text(report, LARGEST_REPORT_BYTES)
    title = html.unescape(page.partition("<title>")[2].partition("</title>")[0])
    write_durably(path, pdf_of(page, title))
    return path


def pdf_of(page: str, title: str) -> bytes:
    """A page of the report's HTML as a PDF.

    Args:
        page: the whole page.
        title: the document's title in its properties.

    Raises:
        RigError: the fonts are missing.
    """
    _fonts()
    target = io.BytesIO()
    document = SimpleDocTemplate(
        target, pagesize=A4, leftMargin=MARGIN, rightMargin=MARGIN, topMargin=MARGIN, bottomMargin=BOTTOM, title=title,
        creator="mr-damper-rig",
    )  # fmt: skip
    document.build(list(_flow(tree_of(page), WIDTH)), canvasmaker=_NumberedCanvas)
    return target.getvalue()


class _NumberedCanvas(Canvas):  # type: ignore[misc]  # the library has no annotations
    """A canvas that knows how many pages there are when it writes the numbers: all pages are kept until the end."""

    def __init__(self, *arguments: object, **options: object) -> None:
        super().__init__(*arguments, **options)
        self._kept: list[dict[str, Any]] = []

    def showPage(self) -> None:
        """Keep the page."""
        self._kept.append(dict(self.__dict__))
        self._startPage()

    def save(self) -> None:
        """Write every page with its number."""
        for number, state in enumerate(self._kept, start=1):
            self.__dict__.update(state)
            self.setFont("Sheet", 7)
            self.setFillColor(SOFT)
            self.drawString(MARGIN, 7 * mm, str(self._doc.info.title)[:110])
            self.drawRightString(A4[0] - MARGIN, 7 * mm, f"page {number} of {len(self._kept)}")
            super().showPage()
        super().save()


@cache
def _fonts() -> None:
    spec = importlib.util.find_spec("matplotlib")
    places = [] if spec is None else [Path(place) for place in spec.submodule_search_locations or ()]
    folder = next((place / "mpl-data" / "fonts" / "ttf" for place in places), Path())
    missing = [name for name in FONTS.values() if not (folder / name).is_file()]
    if missing:
        raise RigError(f"no PDF can be made: matplotlib's fonts {', '.join(missing)} are not in {folder}")
    for name, file in FONTS.items():
        registerFont(TTFont(name, folder / file))
    registerFontFamily("Sheet", normal="Sheet", bold="Sheet-Bold", italic="Sheet", boldItalic="Sheet-Bold")


@cache
def _style(name: str) -> ParagraphStyle:
    size, leading, before, after, colour = {
        "h1": (14, 17, 0, 1, INK), "h2": (10.5, 13, 7, 2, INK), "h3": (8.5, 10.5, 4, 1.5, INK),
        "p": (7, 8.6, 0, 2, INK), "lead": (6.5, 8, 0, 2, SOFT), "card": (6.5, 8, 0, 1, INK),
        "fact": (7, 10, 0, 0, SOFT), "cell": (6, 7.2, 0, 0, INK), "right": (6, 7.2, 0, 0, INK),
        "head": (6, 7.2, 0, 0, INK),
    }[name]  # fmt: skip
    bold = name in {"h1", "h2", "h3", "head"}
    return ParagraphStyle(
        name, fontName="Sheet-Bold" if bold else "Sheet", fontSize=size, leading=leading, spaceBefore=before,
        spaceAfter=after, textColor=colour, alignment=2 if name == "right" else 0,
    )  # fmt: skip


def _flow(node: Node, width: float) -> Iterator[Any]:
    """What is in an element, laid out one under the other; texts and inline elements in a row are one paragraph."""
    row: list[Node | str] = []
    for place, child in enumerate([*node.children, Node("end")]):
        if isinstance(child, str) or child.tag in INLINE:
            row.append(child)
            continue
        if inline := inline_of(Node("", {}, row)).strip():
            yield Paragraph(inline, _style("p"))
        row = []
        if child.tag in {"h2", "h3"}:
            following = [one for one in node.children[place + 1:place + 4] if isinstance(one, Node)]
            drawn = any(one.kinds & CARDS.keys() for one in following)
            yield CondPageBreak((HIGHEST_CARD if drawn else FEW_ROWS) + (0 if child.tag == "h3" else 12 * mm))
        if child.tag not in SILENT and child.tag != "end":
            yield from _block(child, width)


def _block(node: Node, width: float) -> Iterator[Any]:
    if node.tag in {"h1", "h2", "h3"}:
        yield Paragraph(inline_of(node), _style(node.tag))
    elif node.tag == "p":
        yield Paragraph(inline_of(node), _style("lead" if "lead" in node.kinds else "p"))
    elif node.tag == "svg":
        yield drawing(node, width)
    elif node.tag == "table":
        yield body_table(node, width, inline_of, _style)
        yield Spacer(0, GAP)
    elif node.tag == "dl":
        names, values = list(node.elements("dt")), list(node.elements("dd"))
        rows = [(html.escape(name.text), inline_of(value)) for name, value in zip(names, values, strict=False)]
        yield cells_table(rows, width, _style)
    elif node.tag == "ul":
        for item in node.elements("li"):
            yield Paragraph(f"\N{BULLET} {inline_of(item)}", _style("p"))
    elif node.tag == "pre":
        yield Preformatted(node.text, ParagraphStyle("pre", fontName="Sheet-Mono", fontSize=6, leading=7.2),
                           maxLineLength=140)  # fmt: skip
    elif node.tag == "summary":
        yield Paragraph(inline_of(node), _style("lead"))
    else:
        yield from _division(node, width)


def _division(node: Node, width: float) -> Iterator[Any]:
    """A `<div>` by its class; any other element is what is in it."""
    kinds = node.kinds
    columns = next((count for kind, count in CARDS.items() if kind in kinds), 0)
    if columns:
        yield _grid([_card(one, width / columns - 2 * GAP) for one in node.elements()], columns, width)
    elif "facts" in kinds:
        yield _facts(node, width)
    elif "pair" in kinds:
        halves = [list(_flow(Node("", {}, [one]), width / 2.0)) for one in node.elements()]
        yield Table([halves], colWidths=[width / max(len(halves), 1)] * len(halves), style=_bare())
    elif kinds & {"warn", "bad"}:
        colour = HexColor("#c0392b" if "bad" in kinds else "#e0a030")
        yield Table([[list(_flow(node, width - 4 * GAP))]], colWidths=[width], style=[
            ("LINEBEFORE", (0, 0), (0, -1), 3, colour), ("LEFTPADDING", (0, 0), (-1, -1), 7),
            ("TOPPADDING", (0, 0), (-1, -1), 1), ("BOTTOMPADDING", (0, 0), (-1, -1), 1),
        ])  # fmt: skip
        yield Spacer(0, 1 * mm)
    elif "card" in kinds:
        yield _grid([_card(node, width - 2 * GAP)], 1, width)
    else:
        yield from _flow(node, width)


def _card(node: Node, width: float) -> Flowables:
    """What is in a card, its header first."""
    if "card" not in node.kinds:
        return list(_block(node, width))
    header = next(node.elements("header"), None)
    rest = Node("div", {}, [one for one in node.children if one is not header])
    title = [] if header is None else [Paragraph(inline_of(header, "  "), _style("card"))]
    return [*title, *_flow(rest, width)]


def _grid(cards: list[Flowables], columns: int, width: float) -> Table:
    """Cards in rows, framed; a row is never cut by the end of a page."""
    rows = [[*cards[start:start + columns]] for start in range(0, len(cards), columns)]
    rows[-1] += [[] for _ in range(columns - len(rows[-1]))]
    frames = [
        ("BOX", (index % columns, index // columns), (index % columns, index // columns), 0.5, LINE)
        for index in range(len(cards))
    ]
    padding = [(f"{side}PADDING", (0, 0), (-1, -1), GAP / 2) for side in ("LEFT", "RIGHT", "TOP", "BOTTOM")]
    return Table(rows, colWidths=[width / columns] * columns, style=[("VALIGN", (0, 0), (-1, -1), "TOP"),
                                                                    *frames, *padding])  # fmt: skip


def _facts(node: Node, width: float) -> Table:
    cells = []
    for fact in node.elements("div"):
        value, *rest = fact.elements("b", "span")
        meaning = " ".join(inline_of(one) for one in rest)
        colour = {"good": "#1e8e5a", "fair": "#b07a10", "poor": "#c0392b"}.get(next(iter(
            fact.kinds & {"good", "fair", "poor"}), ""), "#1c2430")
        cells.append([Paragraph(
            f'<font size="10" color="{colour}"><b>{inline_of(value)}</b></font><br/>{meaning}', _style("fact"),
        )])  # fmt: skip
    return _grid(cells, max(1, min(4, len(cells))), width)


def _bare() -> list[tuple[object, ...]]:
    return [(f"{side}PADDING", (0, 0), (-1, -1), 0) for side in ("LEFT", "RIGHT", "TOP", "BOTTOM")]


def inline_of(node: Node, between: str = "") -> str:
    """Text with the markup of the library's paragraphs; everything from the page is escaped again."""
    parts = []
    for child in node.children:
        if isinstance(child, str):
            parts.append(html.escape(child))
        elif child.tag not in SILENT:
            parts.append(_INLINE.get(child.tag, inline_of)(child))
    return between.join(parts)


def _span(node: Node) -> str:
    inner = inline_of(node)
    paint = next((CHIPS[kind] for kind in sorted(node.kinds) if kind in CHIPS), None)
    if paint is not None:
        return f'<font backColor="{paint[0]}" color="{paint[1]}">{SPACE}{inner}{SPACE}</font>'
    if "heat" in node.kinds and (colour := _heat(node.attributes.get("style", ""))) is not None:
        return f'<font backColor="{colour}">{SPACE}{inner}{SPACE}</font>'
    return inner


def _heat(style: str) -> str | None:
    """The colour of `background:rgba(r,g,b,a)` on white paper."""
    if "rgba(" not in style:
        return None
    *channels, alpha = (float(part) for part in style.partition("rgba(")[2].partition(")")[0].split(","))
    mixed = [round(255 + alpha * (channel - 255)) for channel in channels]
    return "#" + "".join(f"{value:02x}" for value in mixed)


def _key(node: Node) -> str:
    """One line of a drawing's key."""
    colour = node.attributes.get("style", "").rpartition(":")[2].strip() or "#000000"
    sign = "\N{EM DASH}\N{EM DASH}" if "dash" not in node.kinds else "\N{EN DASH} \N{EN DASH}"
    valid: Color = toColor(colour, HexColor("#000000"))
    return f'{SPACE * 4}<font color="#{valid.hexval()[2:]}"><b>{sign}</b></font> '


_INLINE: dict[str, Callable[[Node], str]] = {
    "b": lambda node: f"<b>{inline_of(node)}</b>",
    "code": lambda node: f'<font name="Sheet-Mono">{inline_of(node)}</font>',
    "br": lambda node: "<br/>",
    "i": _key,
    "span": _span,
}
