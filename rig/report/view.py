"""What a report shows of one point: one measured cycle, the fit's force on the same motion, and its errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rig.dampers import DamperModel
from rig.errors import RigError
from rig.identification.coil import with_lag
from rig.identification.measurement import Measurement
from rig.identification.model_slope import modelled_force
from rig.identification.preparation import prepare
from rig.recording.quality.campaign_delay import PointSkew
from rig.recording.recorded_point import RecordedPoint
from rig.report.chart import thinned
from rig.signals.arrays import FloatArray


@dataclass(frozen=True)
class Loop:
    """One cycle, thinned for drawing (k,): mm about mid-stroke, m/s, N; `fitted_N` None where there is no fit.

    `phase` runs from 0 to 1 over the cycle.
    """

    phase: FloatArray
    displacement_mm: FloatArray
    velocity_m_s: FloatArray
    force_N: FloatArray
    fitted_N: FloatArray | None


@dataclass(frozen=True)
class PointView:
    """A point, its loop (None when it cannot be drawn, and `why`), and its errors in the fit by `fit.json`'s keys."""

    point: RecordedPoint
    loop: Loop | None
    why: str = ""
    error: Mapping[str, Any] = field(default_factory=dict)
    held_out: bool = False
    measured: Measurement | None = field(default=None, repr=False)


def view_of(
    point: RecordedPoint, model: DamperModel | None, values: Mapping[str, float], error: Mapping[str, Any] | None,
    *, held_out: bool = False, skew: PointSkew | None = None,
) -> PointView:
    """Prepare a point for drawing; what keeps it from being drawn is said, never hidden.

    `skew` is what the campaign as a whole knows of the sensors' delays, as for the fit.
    """
    if point.kind == "current_step":
        return PointView(point, None, "the rod stood still; the current was stepped", error or {}, held_out)
    try:
        measured = prepare(point, skew)
    except RigError as problem:
        return PointView(point, None, str(problem), error or {}, held_out)
    if "eta" in values:
        measured = with_lag(measured, values["eta"])
    fitted = None if model is None else modelled_force(model, values, measured)
    return PointView(point, _middle_cycle(measured, fitted), "", error or {}, held_out, measured)


def _middle_cycle(measured: Measurement, fitted_N: FloatArray | None) -> Loop:
    count = len(measured.u_m)
    per_cycle = min(measured.samples_per_cycle or count, count)
    start = (count // per_cycle // 2) * per_cycle
    start = min(start, count - per_cycle)
    chosen = start + thinned(min(per_cycle + 1, count - start))
    force = np.where(measured.scored, measured.force_N, np.nan)
    return Loop(
        phase=(chosen - start) / per_cycle, displacement_mm=1e3 * measured.u_m[chosen],
        velocity_m_s=measured.v_m_s[chosen], force_N=force[chosen],
        fitted_N=None if fitted_N is None else fitted_N[chosen],
    )
