"""Dampers for a car from a fit or from a named parameter set, with draws from what the fit says it does not know."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig import dampers
from rig.campaign_folder import run_path
from rig.dampers.covered import Covered
from rig.errors import FileProblem
from rig.fits.fit_record import FitRecord
from rig.vehicle.motion import CornerDamper


@dataclass(frozen=True)
class FittedDamper:
    """One damper, and others that the same tests would have given.

    Attributes:
        name: as it was asked for.
        damper: the best values.
        draws: from the covariance of the fit; empty where it has none.
        adequate: what the fit says of itself; None: it is no fit, or says nothing.
        remark: what a reader has to know of the interval.
        covered: what its tests covered; None: it is no fit, or does not tell.
    """

    name: str
    damper: CornerDamper
    draws: tuple[CornerDamper, ...] = ()
    adequate: bool | None = None
    remark: str = ""
    covered: Covered | None = None


def fitted_damper(given: str, members: int, seed: int = 0) -> FittedDamper:
    """The damper of a parameter set by name, of a fit.json, or of a run's folder with one.

    Args:
        given: name or path. The name of a set is the set, whatever lies in the working folder: `./NAME` is what lies
            there, and the remark says so where both are there.
        members: how many draws.
        seed: of the draws.

    Raises:
        FileProblem: neither a set nor a fit, or a fit without a value for every parameter.
    """
    if given in dampers.PARAMETER_SETS:
        values = dampers.parameter_set(given)
        damper = CornerDamper(dampers.model(values.model, values.hysteresis), dict(values.values))
        beside = f"; for the file or folder with this name, write ./{given}" if Path(given).exists() else ""
        return FittedDamper(given, damper, remark=f"parameter set, so there is no interval{beside}")
    known = f"known parameter sets: {', '.join(dampers.PARAMETER_SETS)}"
    try:
        path = run_path(given)
    except FileProblem as problem:
        raise FileProblem(problem.file, [*problem.problems, known]) from problem
    if not path.exists():
        raise FileProblem(given, [f"no fit.json, run or parameter set with this name; {known}"])
    return _of_file(given if path == Path(given) else str(path), path, members, seed)


def _of_file(given: str, path: Path, members: int, seed: int) -> FittedDamper:
    fit = FitRecord.load(path)
    damper = CornerDamper(*fit.known_damper())
    remark = (
        "the interval is that of the parameters; it does not include the model error, which exceeds the measurement "
        "noise of the tests" if fit.adequate is False else ""
    )
    if fit.temperature is not None:
        remark += "; " * bool(remark) + f"constant damper temperature, {fit.temperature.reference_degC:.4g} degC"
    return FittedDamper(given, damper, _draws(damper, fit, members, seed), fit.adequate, remark, fit.tested)


def _draws(damper: CornerDamper, fit: FitRecord, members: int, seed: int) -> tuple[CornerDamper, ...]:
    """Dampers from the fit's standard errors and correlations; a parameter stays within its limits."""
    names = [
        name for name, entry in fit.parameters.items()
        if name in damper.values and entry.value is not None and entry.standard_error is not None
    ]  # fmt: skip
    if not names or members == 0:
        return ()
    own = [damper.model.parameter(name) for name in names]
    best = np.array([damper.values[name] for name in names])
    low = np.minimum([parameter.low for parameter in own], best)
    high = np.maximum([parameter.high for parameter in own], best)
    drawn = np.clip(fit.draws(names, members, np.random.default_rng(seed)), low, high)
    return tuple(
        CornerDamper(damper.model, {**damper.values, **dict(zip(names, values, strict=True))})
        for values in drawn.tolist()
    )
