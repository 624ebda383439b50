"""Drawings as PNG, for slides, wikis and e-mails that take no vectors. Lines are averaged from a larger picture."""

from __future__ import annotations

import io
from collections.abc import Iterator

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from rig.document import fonts, style
from rig.document.drawing import OPACITY, STROKES, Drawing, Letters, Line
from rig.document.figure import Style
from rig.document.svg import LABEL, LETTERS, TEXT
from rig.signals.arrays import FloatArray

PER_INCH = 96.0
"""Units of a drawing per inch, as on screen."""
LEAST_DPI, MOST_DPI = 24.0, 1200.0
SMOOTH = 3
"""Pillow draws lines without grey edges: everything but text is drawn so many times larger and averaged."""
MOST_PIXELS = 120e6
"""Of the larger picture, which is kept in memory with 3 bytes each; beyond it lines are averaged less."""


def png(drawing: Drawing, dpi: float) -> bytes:
    """A drawing as PNG on white.

    Args:
        drawing: the drawing.
        dpi: pixels per inch, at 96 units of the drawing per inch.

    Raises:
        ValueError: a resolution outside 24 to 1200 dpi.
    """
    if not LEAST_DPI <= dpi <= MOST_DPI:
        raise ValueError(f"dpi: got {dpi:g}, expected {LEAST_DPI:g} to {MOST_DPI:g}")
    scale = dpi / PER_INCH
    width, height = (max(1, round(scale * side)) for side in (drawing.width, drawing.height))
    smooth = max(1, min(SMOOTH, int((MOST_PIXELS / (width * height)) ** 0.5)))
    large = Image.new("RGB", (smooth * width, smooth * height), "white")
    canvas = ImageDraw.Draw(large, "RGBA")  # blends what is half transparent
    for mark in drawing.marks:
        if isinstance(mark, Line):
            _draw_line(canvas, mark, smooth * scale)
    picture = large.reduce(smooth)
    for mark in drawing.marks:
        if isinstance(mark, Letters):
            _draw_letters(picture, mark, scale)
    target = io.BytesIO()
    picture.save(target, "PNG", dpi=(dpi, dpi), optimize=True)
    return target.getvalue()


def _draw_line(canvas: ImageDraw.ImageDraw, line: Line, scale: float) -> None:
    stroke = STROKES[line.kind]
    colour, width = line.colour or stroke.colour, max(1, round(scale * stroke.width))
    for piece in line.pieces:
        points = scale * piece
        if line.kind == Style.AREA:
            if len(points) > 2:
                canvas.polygon(_corners(points), fill=f"{colour}{round(255 * OPACITY):02x}")
        elif line.kind == Style.POINTS:
            for x, y in points.tolist():
                canvas.ellipse((x - width / 2, y - width / 2, x + width / 2, y + width / 2), fill=colour)
        else:
            for part in _dashes(points, tuple(scale * dash for dash in stroke.dashes)):
                canvas.line(_corners(part), fill=colour, width=width, joint="curve")


def _corners(points: FloatArray) -> list[tuple[float, float]]:
    return [(x, y) for x, y in points.tolist()]


def _dashes(points: FloatArray, dashes: tuple[float, ...]) -> Iterator[FloatArray]:
    """The dashes of a polyline, (k, 2) each; all of it where there are none."""
    if not dashes:
        yield points
        return
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    for start in np.arange(0.0, along[-1], sum(dashes)):
        end = min(start + dashes[0], along[-1])
        places = np.concatenate(([start], along[(along > start) & (along < end)], [end]))
        yield np.column_stack([np.interp(places, along, points[:, axis]) for axis in (0, 1)])


def _draw_letters(picture: Image.Image, mark: Letters, scale: float) -> None:
    """A text at its base line, turned by way of a picture of its own."""
    size, colour = (LABEL, style.INK) if mark.large else (TEXT, LETTERS)
    font = ImageFont.truetype(fonts.file("Sheet"), scale * size)
    anchor, text = {"start": "ls", "middle": "ms", "end": "rs"}[mark.anchor], fonts.known(mark.text)
    if not mark.turned:
        ImageDraw.Draw(picture).text((scale * mark.x, scale * mark.y), text, colour, font, anchor)
        return
    left, top, right, bottom = (round(side) for side in font.getbbox(text, anchor=anchor))
    mask = Image.new("L", (right - left + 2, bottom - top + 2))
    ImageDraw.Draw(mask).text((1 - left, 1 - top), text, 255, font, anchor)
    turned = mask.rotate(90, expand=True)
    place = round(scale * mark.x) + top - 1, round(scale * mark.y) - right - 1
    picture.paste(colour, place, turned)
