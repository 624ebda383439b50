"""Line charts as inline SVG: vector, small, readable in print, no library and no network."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.report.style import SVG_RULES
from rig.signals.arrays import FloatArray

Range = tuple[float, float]

LEFT, RIGHT, TOP, BOTTOM = 52, 8, 8, 36
TITLE_ROOM, DIGIT = 22, 7.3
"""Beside the ticks of a titled axis, and of one sign of theirs, pixels."""
WANTED_TICKS = 5
CROSS = 3.0
"""Half the size of the cross that a value without neighbours is drawn as."""


@dataclass(frozen=True)
class Trace:
    """One line: `x`, `y` (n,) in the axes' units, broken where a value is NaN, a cross where it has no neighbour.

    `style` is a class of the style sheet, `colour` overrides its own; `name` appears when the pointer rests on it.
    """

    x: FloatArray
    y: FloatArray
    style: str
    name: str = ""
    colour: str = ""


@dataclass(frozen=True)
class Chart:
    """A chart of `width` x `height` pixels; ranges default to all of the traces."""

    x_label: str
    y_label: str
    traces: Sequence[Trace]
    width: int = 300
    height: int = 220
    x_range: Range | None = None
    y_range: Range | None = None
    title: str = field(default="")

    def svg(self) -> str:
        """The chart as an `<svg>` element with a text alternative."""
        x_range = self.x_range or span([trace.x for trace in self.traces])
        y_range = self.y_range or span([trace.y for trace in self.traces])
        parts = [
            f'<svg viewBox="0 0 {self.width} {self.height}" role="img" '
            f'aria-label="{html.escape(self.title or f"{self.y_label} over {self.x_label}")}">',
            *self._axes(x_range, y_range),
            *(self._line(trace, x_range, y_range) for trace in self.traces),
            "</svg>",
        ]
        return "".join(parts)

    def standalone(self) -> str:
        """The chart as a file of its own, with its style."""
        opening, content = self.svg().split(">", 1)
        size = f' xmlns="http://www.w3.org/2000/svg" width="{self.width}" height="{self.height}"'
        return f"{opening}{size}><style>{SVG_RULES}</style>{content}\n"

    def save(self, path: Path | str) -> Path:
        """Write it as an SVG file.

        Raises:
            OSError: the file cannot be written.
        """
        file = Path(path)
        file.write_text(self.standalone(), encoding="utf-8")
        return file

    def _repr_svg_(self) -> str:
        return self.standalone()

    @cached_property
    def _left(self) -> float:
        """Where the frame begins: behind the widest tick, and a title where there is one."""
        if not self.y_label:
            return LEFT
        y_range = self.y_range or span([trace.y for trace in self.traces])
        signs = max((len(tick_text(value, y_range)) for value in ticks(y_range)), default=0)
        return max(LEFT, math.ceil(TITLE_ROOM + DIGIT * signs))

    def _axes(self, x_range: Range, y_range: Range) -> list[str]:
        left, right, bottom = self._left, self.width - RIGHT, self.height - BOTTOM
        parts = []
        for value in ticks(x_range):
            x = self._x(value, x_range)
            parts.append(f'<path class="g" d="M{x:.1f} {TOP}V{bottom}"/>')
            parts.append(f'<text x="{x:.1f}" y="{bottom + 15}" text-anchor="middle">{tick_text(value, x_range)}</text>')
        for value in ticks(y_range):
            y = self._y(value, y_range)
            parts.append(f'<path class="g" d="M{left} {y:.1f}H{right}"/>')
            parts.append(f'<text x="{left - 5}" y="{y + 4:.1f}" text-anchor="end">{tick_text(value, y_range)}</text>')
        middle_x, middle_y = (left + right) / 2, (TOP + bottom) / 2
        parts.append(f'<rect class="f" x="{left}" y="{TOP}" width="{right - left}" height="{bottom - TOP}"/>')
        x_text, y_text = html.escape(self.x_label), html.escape(self.y_label)
        parts.append(f'<text class="l" x="{middle_x}" y="{self.height - 4}" text-anchor="middle">{x_text}</text>')
        parts.append(
            f'<text class="l" transform="translate(11 {middle_y}) rotate(-90)" text-anchor="middle">{y_text}</text>',
        )
        return parts

    def _line(self, trace: Trace, x_range: Range, y_range: Range) -> str:
        x = np.round(self._x(trace.x, x_range), 1)
        y = np.round(self._y(trace.y, y_range), 1)
        good = np.isfinite(x) & np.isfinite(y)
        edged = np.concatenate(([False], good, [False]))
        alone = good & ~edged[:-2] & ~edged[2:]
        words, pen_up = [], True
        for px, py, usable, single in zip(x.tolist(), y.tolist(), good.tolist(), alone.tolist(), strict=True):
            if single:
                words.append(f"M{px - CROSS:g} {py:g}H{px + CROSS:g}M{px:g} {py - CROSS:g}V{py + CROSS:g}")
            elif usable:
                words.append(f"{'M' if pen_up else 'L'}{px:g} {py:g}")
            pen_up = not usable
        colour = f' style="stroke:{trace.colour}"' if trace.colour else ""
        name = f"<title>{html.escape(trace.name)}</title>" if trace.name else ""
        return f'<path class="{trace.style}"{colour} d="{"".join(words)}">{name}</path>'

    def _x(self, value: FloatArray | float, limits: Range) -> FloatArray:
        share = (np.asarray(value, np.float64) - limits[0]) / (limits[1] - limits[0])
        return np.asarray(self._left + share * (self.width - self._left - RIGHT))

    def _y(self, value: FloatArray | float, limits: Range) -> FloatArray:
        share = (np.asarray(value, np.float64) - limits[0]) / (limits[1] - limits[0])
        return np.asarray(self.height - BOTTOM - share * (self.height - BOTTOM - TOP))


def span(arrays: Sequence[FloatArray], margin: float = 0.05) -> Range:
    """Smallest to largest finite value with a margin on both sides; (-1, 1) when there is none."""
    finite = [array[np.isfinite(array)] for array in arrays]
    finite = [array for array in finite if len(array)]
    if not finite:
        return -1.0, 1.0
    low = min(float(np.min(array)) for array in finite)
    high = max(float(np.max(array)) for array in finite)
    room = margin * (high - low) or abs(high) * margin or 1.0
    return low - room, high + room


def ticks(limits: Range) -> list[float]:
    """Round values inside a range, about `WANTED_TICKS` of them."""
    rough = (limits[1] - limits[0]) / WANTED_TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1.0, 2.0, 2.5, 5.0, 10.0) if factor * power >= rough)
    first = math.ceil(limits[0] / step - 1e-9)
    last = math.floor(limits[1] / step + 1e-9)
    return [number * step for number in range(first, last + 1)]


def tick_text(value: float, limits: Range) -> str:
    """A tick's value, without noise of the arithmetic."""
    largest = max(abs(limits[0]), abs(limits[1]))
    return f"{0.0 if abs(value) < 1e-9 * largest else value:.6g}".replace("-", "\N{MINUS SIGN}")


def thinned(count: int, wanted: int = 300) -> NDArray[np.int64]:
    """Indices of at most `wanted` evenly spread samples out of `count`, first and last among them."""
    if count <= wanted:
        return np.arange(count)
    return np.unique(np.round(np.linspace(0, count - 1, wanted)).astype(np.int64))
