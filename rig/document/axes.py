"""Figures drawn on axes of matplotlib, for people who go on with them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rig.document import style
from rig.document.figure import Figure, Style
from rig.errors import RigError
from rig.extras import how_to_install

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINES: dict[Style, dict[str, Any]] = {
    Style.MEASURED: {"color": style.MEASURED, "linewidth": 1.0},
    Style.FITTED: {"color": style.FITTED, "linewidth": 1.5},
    Style.OVERLAID: {"color": style.OVERLAID, "linewidth": 1.0, "linestyle": "--"},
    Style.RESIDUAL: {"color": style.RESIDUAL, "linewidth": 0.8},
    Style.THIN: {"color": style.INK, "linewidth": 0.8},
    Style.AREA: {"color": style.MEASURED, "linewidth": 0.0},
    Style.POINTS: {"color": style.MEASURED, "linestyle": "none", "marker": "o", "markersize": 2.0},
}
MOST_NAMED = 12
"""Entries of a legend."""


def draw_on(figure: Figure, ax: Axes | None = None) -> Axes:
    """Draw a figure on axes.

    Args:
        figure: the figure.
        ax: the axes; None: those of a new matplotlib figure.

    Returns:
        The axes, for labels, limits and further lines.

    Raises:
        RigError: matplotlib is not installed, or `ax` is not its axes.
    """
    if ax is None:
        ax = _new()
    if not hasattr(ax, "plot") or not hasattr(ax, "set_xlabel"):
        raise RigError(f"plot: got ax = {type(ax).__name__}, expected matplotlib axes, such as those of plt.subplots()")
    named: set[str] = set()
    for trace in figure.traces:
        options = dict(LINES[trace.style])
        if trace.colour:
            options["color"] = trace.colour
        label = trace.name if trace.name not in named else ""
        named |= {label} - {""}
        if trace.style is Style.AREA:
            ax.fill(trace.x, trace.y, alpha=0.3, label=label or None, **options)
        else:
            ax.plot(trace.x, trace.y, label=label or None, **options)
    ax.set_xlabel(figure.x.label)
    ax.set_ylabel(figure.y.label)
    if figure.title:
        ax.set_title(figure.title)
    if figure.legend and 0 < len(named) <= MOST_NAMED:
        ax.legend(fontsize="small")
    return ax


def _new() -> Axes:
    try:
        import matplotlib.pyplot as plt  # half a second, and optional
    except ImportError as error:
        raise RigError(f"plot: matplotlib is not installed. Fix: {how_to_install('notebook')}") from error
    _, ax = plt.subplots(layout="constrained")
    return ax
