"""Charts and tables of the report on paper: the same SVG as shapes; columns as wide as their words, nothing cut off."""

from __future__ import annotations

import html
import itertools
import re
from collections.abc import Callable, Sequence
from typing import Any

from reportlab.graphics.shapes import Drawing, Group, Path, Rect, String
from reportlab.lib.colors import HexColor
from reportlab.pdfbase.pdfmetrics import stringWidth
from reportlab.platypus import Paragraph, Table

from rig.report.html_tree import Node
from rig.report.style import FITTED, MEASURED, OVERLAID, RESIDUAL

LINES: dict[str, tuple[str, float, list[float] | None]] = {
    "g": ("#e6eaef", 0.8, None), "m": (MEASURED, 1.8, None), "p": (FITTED, 1.6, [5, 3]), "q": (OVERLAID, 1.0, [3, 4]),
    "e": (RESIDUAL, 1.0, None),
}  # fmt: skip
"""Colour, width and dashes of the style sheet's classes."""
THIN = 1.0
FINEST, SMALLEST = 0.25, 4.3
"""Of lines and letters on paper, points."""
TEXT, LABEL = (11.5, HexColor("#46515f")), (12.5, HexColor("#1c2430"))
ANCHORS = {"middle": "middle", "end": "end"}
STEP = re.compile(r"([MLHV])([^MLHV]*)")
TURNED = re.compile(r"translate\(([\d.-]+) ([\d.-]+)\) rotate\(-90\)")


def drawing(svg: Node, width: float) -> Drawing:
    """A chart of the report, so wide (points)."""
    *_, wide, high = (float(part) for part in svg.attributes["viewbox"].split())
    scale = width / wide
    canvas = Drawing(width, high * scale)
    group = Group(transform=(scale, 0, 0, -scale, 0, high * scale))
    for node in svg.elements():
        if node.tag == "path":
            group.add(_path(node, scale))
        elif node.tag == "rect":
            group.add(_rect(node))
        elif node.tag == "text":
            group.add(_letters(node, scale))
    canvas.add(group)
    return canvas


def _path(node: Node, scale: float) -> Path:
    kinds = node.kinds
    colour, width, dashes = next((LINES[kind] for kind in kinds if kind in LINES), ("#000000", 1.0, None))
    own = re.search(r"stroke:(#[0-9a-fA-F]{6})", node.attributes.get("style", ""))
    path = Path(
        fillColor=None, strokeColor=HexColor(own[1] if own else colour),
        strokeWidth=max(THIN if "thin" in kinds else width, FINEST / scale),
        strokeDashArray=dashes, strokeLineJoin=1,
    )  # fmt: skip
    x = y = 0.0
    for letter, rest in STEP.findall(node.attributes.get("d", "")):
        numbers = [float(part) for part in rest.split()]
        x = numbers[0] if letter in "MLH" else x
        y = numbers[-1] if letter != "H" else y
        (path.moveTo if letter == "M" else path.lineTo)(x, y)
    return path


def _rect(node: Node) -> Rect:
    x, y, width, height = (float(node.attributes[name]) for name in ("x", "y", "width", "height"))
    return Rect(x, y, width, height, fillColor=None, strokeColor=HexColor("#9aa5b1"), strokeWidth=1.0)


def _letters(node: Node, scale: float) -> Group:
    """A text, turned upright again inside the mirrored drawing."""
    size, colour = LABEL if "l" in node.kinds else TEXT
    size = max(size, SMALLEST / scale)
    anchor = ANCHORS.get(node.attributes.get("text-anchor", ""), "start")
    turned = TURNED.search(node.attributes.get("transform", ""))
    if turned is None:
        x, y = float(node.attributes.get("x", 0)), float(node.attributes.get("y", 0))
        transform = (1, 0, 0, -1, x, y)
    else:
        transform = (0, -1, -1, 0, float(turned[1]), float(turned[2]))
    text = String(0, 0, node.text, fontName="Sheet", fontSize=size, fillColor=colour, textAnchor=anchor)
    return Group(text, transform=transform)


SIZE = 6.0
PADDING = 2.2
SPACE = "\N{NO-BREAK SPACE}"
LINE, SHADE = HexColor("#d8dee6"), HexColor("#f4f6f9")
BASE: list[tuple[Any, ...]] = [
    ("FONT", (0, 0), (-1, -1), "Sheet", SIZE, 7.2), ("VALIGN", (0, 0), (-1, -1), "TOP"),
    ("LINEBELOW", (0, 0), (-1, -1), 0.4, LINE), ("LEFTPADDING", (0, 0), (-1, -1), PADDING),
    ("RIGHTPADDING", (0, 0), (-1, -1), PADDING), ("TOPPADDING", (0, 0), (-1, -1), 0.7),
    ("BOTTOMPADDING", (0, 0), (-1, -1), 1.2),
]  # fmt: skip
Style = Callable[[str], Any]


def body_table(node: Node, width: float, inline: Callable[[Node], str], style: Style) -> Table:
    """A `<table>` within a width (points)."""
    rows = [list(row.elements("td", "th")) for row in node.everywhere("tr")]
    columns = max(len(row) for row in rows)
    widths = column_widths([[_text(cell) for cell in row] for row in rows], width)
    cells = []
    for index, row in enumerate(rows):
        cells.append([
            _cell(cell, widths[place], inline, style(_kind(cell, head=index == 0))) for place, cell in enumerate(row)
        ] + [""] * (columns - len(row)))  # fmt: skip
    right = [("ALIGN", (place, 1), (place, -1), "RIGHT") for place, cell in enumerate(rows[-1]) if "n" in cell.kinds]
    head = [("BACKGROUND", (0, 0), (-1, 0), SHADE)]
    return Table(cells, colWidths=widths, repeatRows=1, hAlign="LEFT", style=[*BASE, *right, *head])


def _kind(cell: Node, *, head: bool) -> str:
    """The style of a cell."""
    return "head" if head else "right" if "n" in cell.kinds else "cell"


def _text(cell: Node) -> str:
    """A cell's text with the room that its labels take."""
    return cell.text + SPACE * 2 * sum(1 for _ in cell.everywhere("span"))


def cells_table(rows: Sequence[tuple[str, str]], width: float, style: Style) -> Table:
    """Names and values (markup of paragraphs) in two columns."""
    first = min(0.3 * width, max((_wide(html.unescape(name)) for name, _ in rows), default=0.0) + 3 * PADDING)
    cells = [[Paragraph(name, style("cell")), Paragraph(value, style("cell"))] for name, value in rows] or [["", ""]]
    return Table(cells, colWidths=[first, width - first], hAlign="LEFT", style=BASE)


def column_widths(texts: Sequence[Sequence[str]], width: float) -> list[float]:
    """As wide as the longest text; where that is too much, long columns give way down to their longest word.

    Args:
        texts: of every cell, row by row, the head first.
        width: of all columns together, points.

    Returns:
        Widths in points, together at most `width`.
    """
    columns = max(len(row) for row in texts)
    head = [_wide(text, bold=True) for text in texts[0]] + [0.0] * (columns - len(texts[0]))
    least = [max(map(_bold_word, text.split()), default=0.0) for text in texts[0]] + [0.0] * (columns - len(texts[0]))
    wanted = list(least)
    for row in texts[1:]:
        for place, text in enumerate(row):
            least[place] = max([least[place], *(_wide(word) for word in text.split(" "))])
            wanted[place] = max(wanted[place], least[place], _wide(text))
    generous = [max(pair) for pair in zip(wanted, head, strict=True)]
    padded = [[one + 2 * PADDING + 1.0 for one in row] for row in (generous, wanted, least)]
    for most, low in itertools.pairwise(padded):
        over, room = sum(most) - width, sum(most) - sum(low)
        if over <= 0.0:
            return most
        if room >= over:
            return [one - over * (one - end) / room for one, end in zip(most, low, strict=True)]
    return [one * width / sum(padded[-1]) for one in padded[-1]]


def _wide(text: str, *, bold: bool = False) -> float:
    return float(stringWidth(text, "Sheet-Bold" if bold else "Sheet", SIZE)) + 0.5


def _bold_word(word: str) -> float:
    return _wide(word, bold=True)


def _cell(node: Node, width: float, inline: Callable[[Node], str], style: Any) -> Any:  # noqa: ANN401 - the library's
    """A plain text where that fits on one line, else a paragraph."""
    plain = not any(True for _ in node.elements())
    if plain and node.tag != "th" and _wide(node.text) <= width - 2 * PADDING:
        return node.text
    return Paragraph(inline(node), style)
