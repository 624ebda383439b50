"""Colours, the same on screen and on paper: those of Okabe and Ito; a colour is never the only sign."""

from __future__ import annotations

from rig.document.words import FAIR, GOOD, PLAIN, POOR, Severity

MEASURED = "#0072B2"
FITTED = "#D55E00"
OVERLAID = "#111111"
RESIDUAL = "#55606e"

SEQUENCE = ("#440154", "#472e7c", "#3a548c", "#2b758e", "#1f958b", "#2fb47c", "#6ece58")
"""From low to high current: viridis up to where it is still dark enough on white. Its lightness rises evenly, so the
order is visible without colour vision and in grey print."""
CATEGORIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8c1d10", "#55606e", "#111111")
"""Of methods and other things without an order."""

INK, SOFT, LINE, SHADE, GRID, FRAME = "#1c2430", "#5b6675", "#d8dee6", "#f4f6f9", "#e6eaef", "#9aa5b1"
LABELS: dict[Severity, tuple[str, str]] = {
    GOOD: ("#d9f2e3", "#0b5d33"), FAIR: ("#fdf0c4", "#6b4e00"), POOR: ("#fbdcd7", "#8c1d10"),
    PLAIN: ("#e6ebf2", "#38455a"),
}  # fmt: skip
"""Background and letters of labels."""
BARS: dict[Severity, str] = {GOOD: "#1e8e5a", FAIR: "#e0a030", POOR: "#c0392b", PLAIN: LINE}
"""The bar beside a note or a fact."""
MARK_PAPER, MARK_INK = "#ffe3b3", "#7a2e00"
"""Background and letters of a document's mark, such as SIMULATED."""
WARM, COLD = (213, 94, 0), (0, 114, 178)
"""Red, green and blue of shaded cells: positive and negative."""
DARKEST = 0.5
"""Opacity of the strongest shade."""


def current_colour(index: int, count: int) -> str:
    """Colour of one of several currents, by its place among them."""
    return SEQUENCE[round(index * (len(SEQUENCE) - 1) / max(count - 1, 1))]


def category_colour(index: int) -> str:
    """Colour of one of several things without an order."""
    return CATEGORIES[index % len(CATEGORIES)]


def shade_colour(share: float) -> str:
    """A shade on white paper, as `#rrggbb`."""
    opacity = DARKEST * min(1.0, abs(share))
    mixed = (round(255 + opacity * (one - 255)) for one in (WARM if share > 0.0 else COLD))
    return "#" + "".join(f"{one:02x}" for one in mixed)
