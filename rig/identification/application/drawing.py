"""Figures of a fit: measured and modelled loops, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rig.errors import IdentificationFailed
from rig.identification.application.law import Law
from rig.identification.models.measurement import Measurement, first_cycle

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = "viridis"  # survives grey print and red-green blindness
MEASURED, MODELLED = {"linewidth": 1.4, "alpha": 0.55}, {"linewidth": 1.0, "linestyle": "--"}


def loops(law: Law, tests: Sequence[Measurement]) -> Figure:
    """Force over displacement and over velocity, one cycle of every test: measured drawn through, modelled dashed.

    Raises:
        IdentificationFailed: there is no test to draw, or matplotlib is not installed.
    """
    if not tests:
        raise IdentificationFailed("no loops to draw: this fit holds no tests and names no files of them")
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure
    except ImportError as error:
        raise IdentificationFailed(
            "drawing needs matplotlib: python -m pip install matplotlib; `rig report` draws loops without it"
        ) from error
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    currents = [float(np.mean(test.current_A)) for test in tests]
    low, high = min(currents), max(currents)
    for test, current_A in zip(map(first_cycle, tests), currents, strict=True):
        shade = 0.1 + 0.75 * ((current_A - low) / (high - low) if high > low else 0.5)
        colour = mpl.colormaps[COLOURS](shade)
        measured = np.where(test.scored, test.force_N, np.nan)
        force_N = law.force_of(test)
        for axis, along in zip(axes, (1e3 * test.u_m, test.v_m_s), strict=True):
            axis.plot(along, measured, color=colour, label=f"{test.id}, {current_A:.2f} A", **MEASURED)
            axis.plot(along, force_N, color=colour, **MODELLED)
    axes[0].set(xlabel="displacement about mid-stroke (mm)", ylabel="force (N)")
    axes[1].set(xlabel="velocity (m/s)")
    for axis in axes:
        axis.grid(visible=True, linewidth=0.4, alpha=0.6)
    figure.suptitle(f"{law.model.name}: measured (drawn through), modelled (dashed)")
    if len(tests) <= 12:
        axes[1].legend(fontsize=7)
    return figure
