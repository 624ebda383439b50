"""Figures of a fit: measured and modelled loops."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rig.document.figure import Axis, Figure, Panels, Style, Trace, thinned
from rig.document.plot import Plot
from rig.document.style import current_colour
from rig.errors import IdentificationFailed
from rig.identification.application.law import Law
from rig.identification.application.residuals import NO_TESTS, residual_table
from rig.identification.models.measurement import Measurement, closed_cycle
from rig.recording.views import current_name
from rig.signals.test_set import current_levels

MOST_RESIDUALS = 20_000
"""Points of a figure."""
WIDTH, HEIGHT = 480, 340
LINES = "measured (lines), modelled (dashed)"
MOST_NAMED = 12
"""Tests that a legend still lists."""


def loops(law: Law, tests: Sequence[Measurement], *, by_current: bool = False) -> Plot:
    """Force over displacement and over velocity, one cycle of every test: measured as a line, modelled dashed.

    Args:
        law: the fitted model.
        tests: any number of them, at least one.
        by_current: name the lines by their current alone.

    Raises:
        IdentificationFailed: there is no test to draw.
    """
    if not tests:
        raise IdentificationFailed(f"no loops to draw: {NO_TESTS}")
    levels = current_levels([test.current for test in tests])
    over_u, over_v = list[Trace](), list[Trace]()
    for number, test in enumerate(tests):
        colour, named = current_colour(levels.of_test[number] or 0, len(levels)), current_name(levels.name_A(number))
        name = named if by_current else f"{test.id}, {named}"
        closed = closed_cycle(test)
        measured, force_N = np.where(test.scored, test.force_N, np.nan)[closed], law.force_of(test)[closed]
        for traces, along in ((over_u, 1e3 * test.u_m[closed]), (over_v, test.v_m_s[closed])):
            traces += [Trace(along, measured, name=name, colour=colour), Trace(along, force_N, Style.OVERLAID)]
    force, legend = Axis("Force", "N"), len(tests) <= MOST_NAMED
    return Plot(Panels((
        Figure(Axis("Displacement about mid-stroke", "mm"), force, over_u, WIDTH, HEIGHT),
        Figure(Axis("Velocity", "m/s"), force, over_v, WIDTH, HEIGHT, legend=legend),
    ), title=f"{law.model.name}: {LINES}"))  # fmt: skip


def residuals(law: Law, tests: Sequence[Measurement], over: tuple[Axis, float]) -> Figure:
    """Measured minus modelled force (N) over velocity or displacement, as points.

    Args:
        law: the fitted model.
        tests: any number of them, at least one.
        over: horizontal axis, and its units for one of SI.

    Raises:
        IdentificationFailed: there is no test to draw.
    """
    axis, scale = over
    table = residual_table(law, tests)
    along = table["velocity_m_s" if axis.unit == "m/s" else "displacement_m"].to_numpy()
    few = thinned(len(table), MOST_RESIDUALS)
    drawn = Trace(scale * along[few], table["residual_N"].to_numpy()[few], Style.POINTS)
    return Figure(axis, Axis("Measured minus modelled force", "N"), [drawn], title=f"{law.model.name}: residuals")
