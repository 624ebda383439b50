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
from rig.identification.models.measurement import Measurement, first_cycle

MOST_RESIDUALS = 20_000
"""Points of a figure."""
WIDTH, HEIGHT = 480, 340
MOST_NAMED = 12
"""Tests that a legend still lists."""


def loops(law: Law, tests: Sequence[Measurement]) -> Plot:
    """Force over displacement and over velocity, one cycle of every test: measured as a line, modelled dashed.

    Raises:
        IdentificationFailed: there is no test to draw.
    """
    if not tests:
        raise IdentificationFailed(f"no loops to draw: {NO_TESTS}")
    currents = [float(np.mean(test.current_A)) for test in tests]
    levels = sorted(set(currents))
    over_u, over_v = list[Trace](), list[Trace]()
    for test, current_A in zip(map(first_cycle, tests), currents, strict=True):
        colour, name = current_colour(levels.index(current_A), len(levels)), f"{test.id}, {current_A:.2f} A"
        measured, force_N = np.where(test.scored, test.force_N, np.nan), law.force_of(test)
        for traces, along in ((over_u, 1e3 * test.u_m), (over_v, test.v_m_s)):
            traces += [Trace(along, measured, name=name, colour=colour), Trace(along, force_N, Style.OVERLAID)]
    force, legend = Axis("Force", "N"), len(tests) <= MOST_NAMED
    return Plot(Panels((
        Figure(Axis("Displacement about mid-stroke", "mm"), force, over_u, WIDTH, HEIGHT),
        Figure(Axis("Velocity", "m/s"), force, over_v, WIDTH, HEIGHT, legend=legend),
    ), title=f"{law.model.name}: measured (lines), modelled (dashed)"))  # fmt: skip


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
