"""This lab's section of the report: the energy of every loop, per cycle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rig.document.blocks import Blocks, Column, section, table
from rig.document.numbers import number
from rig.recording.run import Run


def energy_section(run: Run, fit: Mapping[str, Any] | None) -> Blocks:
    """A row for each point; `fit` is `fit.json` as an object, None without a fit."""
    rows = []
    for point in run.points:
        power_W = point.force_N * point.velocity_m_s
        work_J = float(np.nansum(power_W[:-1] * np.diff(point.time_s)))
        rows.append([point.id, number(work_J / max(point.cycles, 1.0))])
    fitted = "not fitted" if fit is None else f"fitted by {fit['model']}"
    head = ["Point", Column("Energy", "J per cycle", numeric=True)]
    return [*section("Energy by this lab's method", fitted), table(head, rows)]
