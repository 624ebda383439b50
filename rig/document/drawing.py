"""The one way to draw: a figure laid out as lines and letters in pixels, y downwards, for any output format."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig.document.figure import Axis, Figure, Panels, Range, Style, Trace
from rig.document.numbers import MINUS
from rig.document.style import FITTED, FRAME, GRID, MEASURED, OVERLAID, RESIDUAL
from rig.signals.arrays import FloatArray

LEFT, RIGHT, TOP, BOTTOM = 52, 8, 8, 36
TITLE_ROOM, DIGIT = 22, 7.3
"""Beside the ticks of a titled axis, and of one sign of theirs, pixels."""
HEAD, ENTRY, SAMPLE, LETTER = 20, 18, 22, 6.3
"""Height of a panel's title and of a line of the legend, length of its sample, width of its letters; pixels."""
TICKS = 5
CROSS = 3.0
"""Half the size of the cross that a value without neighbours is drawn as."""


@dataclass(frozen=True)
class Stroke:
    """Colour, width (pixels) and dashes of a line."""

    colour: str
    width: float
    dashes: tuple[float, ...] = ()


GRID_CLASS, FRAME_CLASS = "g", "f"
STROKES: dict[str, Stroke] = {
    GRID_CLASS: Stroke(GRID, 1.0), FRAME_CLASS: Stroke(FRAME, 1.0), Style.MEASURED: Stroke(MEASURED, 1.8),
    Style.FITTED: Stroke(FITTED, 1.6, (5.0, 3.0)), Style.OVERLAID: Stroke(OVERLAID, 1.0, (3.0, 4.0)),
    Style.RESIDUAL: Stroke(RESIDUAL, 1.0), Style.THIN: Stroke(MEASURED, 1.0), Style.AREA: Stroke(MEASURED, 0.0),
    Style.POINTS: Stroke(MEASURED, 5.0),
}  # fmt: skip
OPACITY = 0.25
"""Of areas."""


@dataclass(frozen=True)
class Line:
    """Polylines (k, 2) of one class of `STROKES`, filled where that is an area; `colour` overrides the class's own."""

    kind: str
    pieces: tuple[FloatArray, ...]
    colour: str = ""
    name: str = ""


@dataclass(frozen=True)
class Letters:
    """A text at its base line; `anchor` is `start`, `middle` or `end`, `large` for labels, `turned` to read upwards."""

    x: float
    y: float
    text: str
    anchor: str = "start"
    large: bool = False
    turned: bool = False


@dataclass(frozen=True)
class Drawing:
    """What a figure is drawn with."""

    width: float
    height: float
    alternative: str
    marks: tuple[Line | Letters, ...]


def drawing_of(figure: Figure | Panels) -> Drawing:
    """Lay out a figure."""
    return _panels(figure) if isinstance(figure, Panels) else _figure(figure)


def _figure(figure: Figure) -> Drawing:
    frame = _Frame.of(figure)
    marks = [*frame.axes(), *(frame.line(trace) for trace in figure.traces)]
    entries = list(_legend(figure, frame.left)) if figure.legend else []
    rows = {entry.y for entry in entries if isinstance(entry, Letters)}
    height = figure.height + ENTRY * len(rows) + (4 if rows else 0)
    return Drawing(figure.width, height, figure.alternative, (*marks, *entries))


def _panels(panels: Panels) -> Drawing:
    marks: list[Line | Letters] = []
    across, top, width = min(panels.across, len(panels.figures)), 0.0, 0.0
    for start in range(0, len(panels.figures), across):
        row = [(figure, _figure(figure)) for figure in panels.figures[start : start + across]]
        left, head = 0.0, HEAD if any(figure.title for figure, _ in row) else 0
        for figure, drawing in row:
            if figure.title:
                marks.append(Letters(left + drawing.width / 2.0, top + 13.0, figure.title, "middle", large=True))
            marks += [_moved(mark, left, top + head) for mark in drawing.marks]
            left += drawing.width
        width, top = max(width, left), top + head + max(drawing.height for _, drawing in row)
    return Drawing(width, top, panels.alternative, tuple(marks))


def _moved(mark: Line | Letters, right: float, down: float) -> Line | Letters:
    if isinstance(mark, Letters):
        return replace(mark, x=mark.x + right, y=mark.y + down)
    return replace(mark, pieces=tuple(piece + np.array([right, down]) for piece in mark.pieces))


@dataclass(frozen=True)
class _Frame:
    """Where a figure's axes are: the frame's edges in pixels, and the limits that belong to them."""

    figure: Figure
    left: float
    x_range: Range
    y_range: Range

    @classmethod
    def of(cls, figure: Figure) -> _Frame:
        x_range, y_range = figure.limits
        if figure.y.names:
            left = 12 + LETTER * max(map(len, figure.y.names))
        else:
            signs = max((len(text) for _, text in _ticks(figure.y, y_range)), default=0)
            left = max(LEFT, math.ceil(TITLE_ROOM + DIGIT * signs)) if figure.y.quantity else LEFT
        return cls(figure, left, x_range, y_range)

    @property
    def right(self) -> float:
        return self.figure.width - RIGHT

    @property
    def bottom(self) -> float:
        return self.figure.height - BOTTOM

    def at_x(self, value: FloatArray | float) -> FloatArray:
        return self.left + _share(value, self.x_range, log=self.figure.x.log) * (self.right - self.left)

    def at_y(self, value: FloatArray | float) -> FloatArray:
        return self.bottom - _share(value, self.y_range, log=self.figure.y.log) * (self.bottom - TOP)

    def axes(self) -> Iterator[Line | Letters]:
        """Grid, frame, ticks and labels."""
        figure, left, right, bottom = self.figure, self.left, self.right, self.bottom
        grid, ticks = [], []
        for value, text in _ticks(figure.x, self.x_range):
            x = float(self.at_x(value))
            grid.append(np.array([[x, TOP], [x, bottom]]))
            ticks.append(Letters(x, bottom + 15, text, "middle"))
        for value, text in _ticks(figure.y, self.y_range):
            y = float(self.at_y(value))
            grid.append(np.array([[left, y], [right, y]]))
            ticks.append(Letters(left - 5, y + 4, text, "end"))
        yield Line(GRID_CLASS, tuple(grid))
        yield from ticks
        corners = [[left, TOP], [right, TOP], [right, bottom], [left, bottom], [left, TOP]]
        yield Line(FRAME_CLASS, (np.array(corners, np.float64),))
        yield Letters((left + right) / 2, figure.height - 4, figure.x.label, "middle", large=True)
        if figure.y.label:
            yield Letters(11, (TOP + bottom) / 2, figure.y.label, "middle", large=True, turned=True)

    def line(self, trace: Trace) -> Line:
        """A series, in pieces between its gaps, cut off at limits that were set."""
        x, y = np.asarray(trace.x, np.float64), np.asarray(trace.y, np.float64)
        if self.figure.y.limits is not None:
            x, y = _cut(x, y, self.y_range)
        if self.figure.x.limits is not None:
            y, x = _cut(y, x, self.x_range)
        points = np.column_stack([self.at_x(x), self.at_y(y)]).round(1)
        good: NDArray[np.bool_] = np.asarray(np.isfinite(points).all(axis=1))
        moved = np.any(np.diff(points, axis=0) != 0.0, axis=1)  # NaN is not 0: gaps stay
        new = np.concatenate(([True], moved)) if len(points) else moved
        points, good = points[new], good[new]
        if trace.style == Style.POINTS:
            return Line(trace.style, tuple(points[good][:, np.newaxis, :]), trace.colour, trace.name)
        edges = np.flatnonzero(np.diff(np.concatenate(([False], good, [False])).astype(np.int8)))
        pieces: list[FloatArray] = []
        for start, stop in edges.reshape(-1, 2).tolist():
            pieces += [points[start:stop]] if stop - start > 1 else _cross(points[start])
        return Line(trace.style, tuple(pieces), trace.colour, trace.name)


def _cross(point: FloatArray) -> list[FloatArray]:
    return [point + CROSS * np.array([[-1.0, 0.0], [1.0, 0.0]]), point + CROSS * np.array([[0.0, -1.0], [0.0, 1.0]])]


def _cut(along: FloatArray, across: FloatArray, limits: Range) -> tuple[FloatArray, FloatArray]:
    """A polyline cut off where `across` leaves its limits; the crossings become ends of pieces."""
    low, high = min(limits), max(limits)
    known = across[np.isfinite(across)]
    if not len(known) or (known.min() >= low and known.max() <= high):
        return along, across
    cut: list[tuple[float, float]] = []
    for index, (x, y) in enumerate(zip(along.tolist(), across.tolist(), strict=True)):
        if index and math.isfinite(y):
            x0, y0 = float(along[index - 1]), float(across[index - 1])
            cut += [
                (x0 + share * (x - x0), edge) for share, edge in sorted(
                    ((edge - y0) / (y - y0), edge) for edge in (low, high) if min(y0, y) < edge < max(y0, y)
                )
            ]  # fmt: skip
        cut.append((x, y if low <= y <= high else math.nan))
    columns = np.array(cut)
    return columns[:, 0], columns[:, 1]


def _share(value: FloatArray | float, limits: Range, *, log: bool) -> FloatArray:
    """Where a value is between its limits, 0 to 1; NaN where a logarithmic axis has no place for it."""
    values = np.asarray(value, np.float64)
    if not log:
        return np.asarray((values - limits[0]) / (limits[1] - limits[0]))
    low, high = math.log10(limits[0]), math.log10(limits[1])
    return np.asarray((np.log10(np.where(values > 0.0, values, np.nan)) - low) / (high - low))


def _ticks(axis: Axis, limits: Range) -> list[tuple[float, str]]:
    """The values of an axis that are written beside it, and how."""
    if axis.names:
        return [(float(place), name) for place, name in enumerate(axis.names)]
    values = decades(limits) if axis.log else ticks(limits)
    return [(value, tick_text(value, limits)) for value in values]


def ticks(limits: Range) -> list[float]:
    """Round values inside a range, about `TICKS` of them."""
    rough = (limits[1] - limits[0]) / TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1.0, 2.0, 2.5, 5.0, 10.0) if factor * power >= rough)
    first = math.ceil(limits[0] / step - 1e-9)
    last = math.floor(limits[1] / step + 1e-9)
    return [number * step for number in range(first, last + 1)]


def decades(limits: Range) -> list[float]:
    """Ticks of a logarithmic axis: powers of 10, with 2 and 5 of each where there are few; round values within one."""
    low, high = math.floor(math.log10(limits[0])), math.ceil(math.log10(limits[1]))
    step = max(1, math.ceil((high - low) / (TICKS + 2)))
    factors = (1.0, 2.0, 5.0) if high - low <= 2 else (1.0,)
    values = [factor * 10.0**power for power in range(low, high + 1, step) for factor in factors]
    inside = [value for value in values if limits[0] <= value <= limits[1]]
    return inside if len(inside) > 2 else ticks(limits)


def tick_text(value: float, limits: Range) -> str:
    """A tick's value, without noise of the arithmetic."""
    largest = max(abs(limits[0]), abs(limits[1]))
    return f"{0.0 if abs(value) < 1e-9 * largest else value:.6g}".replace("-", MINUS)


def _legend(figure: Figure, left: float) -> Iterator[Line | Letters]:
    """A sample and the name of every named series, in rows below the figure."""
    named: dict[str, Trace] = {trace.name: trace for trace in reversed(figure.traces) if trace.name}
    entries = list(reversed(named.values()))
    wide = SAMPLE + 14 + LETTER * max((len(trace.name) for trace in entries), default=0)
    columns = max(1, int((figure.width - left - RIGHT) // wide))
    for place, trace in enumerate(entries):
        x, y = left + wide * (place % columns), figure.height + ENTRY * (place // columns) + 12.0
        middle: Sequence[FloatArray] = (
            (np.array([[x + SAMPLE / 2, y - 4.0]]),) if trace.style == Style.POINTS
            else (np.array([[x, y - 4.0], [x + SAMPLE, y - 4.0]]),)
        )
        yield Line(trace.style, tuple(middle), trace.colour)
        yield Letters(x + SAMPLE + 5, y, trace.name)
