"""Dampers for a ride from tests drawn again: how sure a response is where the fit's own interval leaves misfit out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rig.campaign_folder import CampaignFolder
from rig.errors import IdentificationFailed
from rig.identification import bootstrap
from rig.identification.uncertainty.fit import Fit
from rig.recording.run import Run
from rig.vehicle.fitted_damper import FittedDamper
from rig.vehicle.motion import CornerDamper

if TYPE_CHECKING:
    from rig.identification import Bootstrap

LEAST_DRAWS = 20
REMARK = (
    "model error exceeds the measurement noise of the tests; the interval is derived from {count} bootstrap fits to "
    "the {tests} tests"
)


def drawn_again(fitted: FittedDamper, members: int, seed: int) -> FittedDamper:
    """An inadequate fit's damper with draws from its tests drawn again, where these lie beside the fit.

    Any other is given back as it is; one whose tests cannot be drawn again too, and its remark says why.

    Args:
        fitted: the damper, by the path of its run or of its fit.
        members: how many draws are wanted, at least 20 are made; 0: none.
        seed: of the draws.
    """
    path = Path(fitted.name)
    folder = path if path.is_dir() else path.parent
    if fitted.adequate is not False or members == 0 or not CampaignFolder(folder).points.is_dir():
        return fitted
    try:
        fit = Fit.load(CampaignFolder(folder).fit)
        seen = {test.id for test in fit.error.per_test}
        points = [point for point in Run.open(folder).usable if point.id in seen]
        again = bootstrap(fit, points, count=max(members, LEAST_DRAWS), seed=seed)
    except IdentificationFailed as error:
        return replace(fitted, remark=f"{fitted.remark}; {error}")
    remark = REMARK.format(count=len(again.draws), tests=again.tests)
    return replace(fitted, draws=_dampers(fitted.damper, again), remark=remark)


def _dampers(damper: CornerDamper, again: Bootstrap) -> tuple[CornerDamper, ...]:
    """One damper a draw: the draws about their median, as far apart as so few tests ask for, within the limits."""
    middle = np.median(again.draws, axis=0)
    made = []
    for row in again.draws:
        values = dict(damper.values)
        for name, off in zip(again.names, again.widening * (row - middle), strict=True):
            if name not in values:
                continue
            parameter = damper.model.parameter(name)
            low, high = min(parameter.low, values[name]), max(parameter.high, values[name])
            values[name] = float(np.clip(values[name] + off, low, high))
        made.append(CornerDamper(damper.model, values))
    return tuple(made)
