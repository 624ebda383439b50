"""Drawings as SVG: small, sharp in print, with a text alternative, no library and no network."""

from __future__ import annotations

import html
from functools import cache

import numpy as np

from rig.document.drawing import OPACITY, STROKES, Drawing, Letters, Line
from rig.document.figure import Style
from rig.document.style import INK
from rig.signals.arrays import FloatArray

LETTERS = "#46515f"
TEXT, LABEL = 11.5, 12.5
"""Height of a figure's letters, pixels."""
_RULES = "\n".join(
    f"svg .{kind} {{ stroke:{stroke.colour}; stroke-width:{stroke.width:g};"
    + (f" stroke-dasharray:{' '.join(f'{dash:g}' for dash in stroke.dashes)};" if stroke.dashes else "") + " }"
    for kind, stroke in STROKES.items() if kind != Style.AREA
)
SVG_RULES = f"""
svg text {{ font:{TEXT:g}px system-ui,sans-serif; fill:{LETTERS}; }} svg text.l {{ font-size:{LABEL:g}px; fill:{INK}; }}
svg path {{ fill:none; stroke-linejoin:round; }}
{_RULES}
svg .{Style.POINTS} {{ stroke-linecap:round; }}
svg .{Style.AREA} {{ fill:{STROKES[Style.AREA].colour}; fill-opacity:{OPACITY:g}; stroke:none; }}
"""
"""The style of a drawing, in a page and in a file of its own."""


def svg(drawing: Drawing) -> str:
    """A drawing as an `<svg>` element of a page that has `SVG_RULES`."""
    marks = "".join(_letters(mark) if isinstance(mark, Letters) else _line(mark) for mark in drawing.marks)
    return (
        f'<svg viewBox="0 0 {drawing.width:g} {drawing.height:g}" role="img" '
        f'aria-label="{html.escape(drawing.alternative)}">{marks}</svg>'
    )


def standalone(drawing: Drawing) -> str:
    """A drawing as a file of its own, with its style."""
    opening, content = svg(drawing).split(">", 1)
    size = f' xmlns="http://www.w3.org/2000/svg" width="{drawing.width:g}" height="{drawing.height:g}"'
    return f"{opening}{size}><style>{SVG_RULES}</style>{content}\n"


def _letters(mark: Letters) -> str:
    size = ' class="l"' if mark.large else ""
    place = (
        f'transform="translate({mark.x:g} {mark.y:g}) rotate(-90)"' if mark.turned
        else f'x="{round(mark.x, 1):g}" y="{round(mark.y, 1):g}"'
    )
    anchor = "" if mark.anchor == "start" else f' text-anchor="{mark.anchor}"'
    return f"<text{size} {place}{anchor}>{html.escape(mark.text)}</text>"


def _line(mark: Line) -> str:
    rule = "fill" if mark.kind == Style.AREA else "stroke"
    colour = f' style="{rule}:{mark.colour}"' if mark.colour else ""
    name = f"<title>{html.escape(mark.name)}</title>" if mark.name else ""
    ends = "h0" if mark.kind == Style.POINTS else ""
    pieces = "".join(_piece(piece) + ends for piece in mark.pieces)
    return f'<path class="{mark.kind}"{colour} d="{pieces}">{name}</path>'


def _piece(points: FloatArray) -> str:
    """A polyline with relative coordinates: half the size of one with absolute coordinates."""
    tenths = np.rint(10.0 * points).astype(np.int64)
    steps = " ".join(map(_tenths, np.diff(tenths, axis=0).ravel().tolist())).replace(" -", "-")
    return f"M{_tenths(int(tenths[0, 0]))} {_tenths(int(tenths[0, 1]))}" + (f"l{steps}" if steps else "")


@cache
def _tenths(count: int) -> str:
    """A number given in tenths, as text: `-.4`, `12`."""
    return f"{0.1 * count:.1f}".removesuffix(".0").replace("0.", ".") if abs(count) < 10 else f"{count / 10:g}"
