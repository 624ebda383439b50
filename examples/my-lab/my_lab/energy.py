"""This lab's section of the report: the energy of every loop, per cycle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rig.recording.run import Run
from rig.report.fragment import heading, number, table, text


def energy_section(run: Run, fit: Mapping[str, Any] | None) -> str:
    """HTML: one row a point; `fit` is what `fit.json` says, None without a fit."""
    rows = []
    for point in run.points:
        power_W = point.force_N * point.velocity_m_s
        work_J = float(np.nansum(power_W[:-1] * np.diff(point.time_s)))
        rows.append(("", [text(point.id), number(work_J / max(point.cycles, 1.0))]))
    fitted = "not fitted" if fit is None else f"fitted by {fit['model']}"
    return heading("Energy in this lab's way", text(fitted)) + table(["Point", "J per cycle"], rows, (1,))
