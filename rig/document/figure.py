"""Figures as data: series with their axes. `drawing` lays them out; nothing here knows an output format."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from rig.signals.arrays import FloatArray

Range = tuple[float, float]
WHISKER = 1.5
"""Interquartile ranges that a box plot's whiskers reach at most."""
BOX = 0.3
"""Half the height of a box or bar; neighbours are 1 apart."""


class Style(StrEnum):
    """How a series is drawn; the value is its class in the style sheet."""

    MEASURED = "m"
    FITTED = "p"
    OVERLAID = "q"
    RESIDUAL = "e"
    THIN = "t"
    AREA = "a"
    POINTS = "o"


@dataclass(frozen=True)
class Axis:
    """An axis: quantity and unit, limits (by default those of the series), logarithmic or not.

    `names` are categories at 0, 1, 2, ..., the first one on top; no other ticks are drawn then.
    """

    quantity: str = ""
    unit: str = ""
    limits: Range | None = None
    log: bool = False
    names: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Quantity and unit, as written along the axis."""
        return f"{self.quantity} ({self.unit})" if self.unit else self.quantity


@dataclass(frozen=True)
class Trace:
    """A series: `x`, `y` (n,) in the axes' units, broken where a value is NaN, a cross where it has no neighbour.

    `colour` overrides the style's own; `name` is in the legend and appears under the pointer.
    """

    x: FloatArray
    y: FloatArray
    style: Style = Style.MEASURED
    name: str = ""
    colour: str = ""


@dataclass(frozen=True)
class Figure:
    """Series over two axes, `width` x `height` pixels; `legend` draws the named series below, else `Keys` tell them."""

    x: Axis
    y: Axis
    traces: Sequence[Trace]
    width: int = 300
    height: int = 220
    title: str = ""
    legend: bool = False

    @property
    def alternative(self) -> str:
        """What the figure shows, for readers who do not see it."""
        return self.title or f"{self.y.label} vs. {self.x.label}"

    @property
    def limits(self) -> tuple[Range, Range]:
        """The limits of both axes."""
        return _limits(self.x, [trace.x for trace in self.traces]), _limits(self.y, [trace.y for trace in self.traces])


@dataclass(frozen=True)
class Panels:
    """Figures of one size in rows, `across` side by side, as one figure. Their titles are drawn above each."""

    figures: tuple[Figure, ...]
    across: int = 2
    title: str = ""

    @property
    def alternative(self) -> str:
        """What the figures show, for readers who do not see them."""
        return self.title or "; ".join(figure.alternative for figure in self.figures)


def _limits(axis: Axis, arrays: Sequence[FloatArray]) -> Range:
    if axis.limits is not None:
        return axis.limits
    if axis.names:
        return len(axis.names) - 0.4, -0.6
    if not axis.log:
        return span(arrays)
    positive = [array[array > 0.0] for array in arrays]
    low, high = span([np.log10(array) for array in positive if len(array)])
    return 10.0**low, 10.0**high


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


def thinned(count: int, most: int = 300) -> NDArray[np.int64]:
    """Indices of at most `most` evenly spread samples out of `count`, first and last among them."""
    if count <= most:
        return np.arange(count)
    return np.unique(np.round(np.linspace(0, count - 1, most)).astype(np.int64))


def box_plot(values: Sequence[float], place: float) -> list[Trace]:
    """A horizontal box plot: quartiles, whiskers to the last value within 1.5 interquartile ranges, outliers as points.

    Args:
        values: any number of them, at least one.
        place: where it is on the other axis.
    """
    data = np.sort(np.asarray(values, np.float64))
    low, middle, high = np.percentile(data, [25, 50, 75])
    inside = data[(data >= low - WHISKER * (high - low)) & (data <= high + WHISKER * (high - low))]
    first, last = (low, high) if not len(inside) else (min(inside[0], low), max(inside[-1], high))
    outliers = data[(data < first) | (data > last)]
    gap = math.nan
    x = [low, high, high, low, low, gap, first, low, gap, high, last]
    y = np.array([-BOX, -BOX, BOX, BOX, -BOX, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    drawn = [
        Trace(np.array(x), place + y, Style.THIN),
        Trace(np.full(2, middle), place + np.array([-BOX, BOX]), Style.FITTED),
    ]
    return [*drawn, Trace(outliers, np.full(len(outliers), place), Style.POINTS)] if len(outliers) else drawn


def bar(value: float, place: float) -> Trace:
    """A horizontal bar from 0."""
    return Trace(np.array([0.0, value, value, 0.0]), place + np.array([-BOX, -BOX, BOX, BOX]), Style.AREA)


def area(x: FloatArray, low: FloatArray, high: FloatArray, colour: str) -> Trace:
    """The area between two curves over x (n,)."""
    return Trace(np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]]), Style.AREA, "", colour)
