"""Dampers for a car from a fit or from a named parameter set, with draws from what the fit says it does not know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rig import dampers
from rig.dampers.covered import Covered
from rig.errors import FileProblem
from rig.vehicle.fit_values import fit_values
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
    path = Path(given)
    if given in dampers.PARAMETER_SETS:
        values = dampers.parameter_set(given)
        damper = CornerDamper(dampers.model(values.model, values.hysteresis), dict(values.values))
        beside = f"; for what is called so in this folder write ./{given}" if path.exists() else ""
        return FittedDamper(given, damper, remark=f"a parameter set: no interval{beside}")
    if not path.exists():
        raise FileProblem(
            given, ["there is no such fit.json, run, or parameter set; sets: " + ", ".join(dampers.PARAMETER_SETS)]
        )
    return _of_file(given, path, members, seed)


def _of_file(given: str, path: Path, members: int, seed: int) -> FittedDamper:
    known = fit_values(path)
    fit, damper = known.content, CornerDamper(known.model, dict(known.values))
    adequate = fit.get("adequate")
    remark = (
        "the interval is that of the parameters; the model does not reach the tests' own scatter, and that misfit is "
        "not in it" if adequate is False else ""
    )
    if isinstance(warmth := fit.get("temperature"), dict):
        remark += "; " * bool(remark) + f"the damper at {warmth.get('reference_degC'):.4g} degC all the time"
    covered = Covered.of_entry(fit["tested"]) if fit.get("tested") else None
    draws = _draws(damper, fit["parameters"], fit, members, seed)
    return FittedDamper(given, damper, draws, adequate, remark, covered)


def _draws(
    damper: CornerDamper, entries: Mapping[str, Any], fit: Mapping[str, Any], members: int, seed: int
) -> tuple[CornerDamper, ...]:
    """Dampers from the fit's standard errors and correlations; a parameter stays within its limits."""
    errors = {
        name: float(entry["standard_error"]) for name, entry in entries.items()
        if name in damper.values and isinstance(entry.get("standard_error"), (int, float))
        and np.isfinite(entry["standard_error"])
    }  # fmt: skip
    if not errors or members == 0:
        return ()
    names = list(errors)
    correlation = fit.get("correlation") or {}
    matrix = np.array([
        [1.0 if a == b else float((correlation.get(a) or {}).get(b) or 0.0) for b in names] for a in names
    ])
    rates, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    root = vectors * np.sqrt(np.clip(rates, 0.0, None))
    scale = np.array([errors[name] for name in names])
    random = np.random.default_rng(seed)
    made = []
    for _ in range(members):
        change = scale * (root @ random.standard_normal(len(names)))
        values = dict(damper.values)
        for name, off in zip(names, change, strict=True):
            parameter = damper.model.parameter(name)
            low, high = min(parameter.low, values[name]), max(parameter.high, values[name])
            values[name] = float(np.clip(values[name] + off, low, high))
        made.append(CornerDamper(damper.model, values))
    return tuple(made)
