"""A fit with its model, as the exports of models need it: values, how sure they are, and where they were tested."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import rig.dampers
from rig.dampers.arrays import FloatArray
from rig.dampers.covered import QUANTITIES, Covered
from rig.dampers.model import DamperModel
from rig.dampers.temperature_law import law_of_entries
from rig.errors import FileProblem, RigError
from rig.fit_file import FIX

TESTED = QUANTITIES[:3]
"""Keys of `tested` in `fit.json` that every fit has which tells it."""
NOT_OF_THE_FORCE = "eta"
"""The coil's lag: it belongs to the current, not to the force."""


@dataclass(frozen=True)
class FittedModel:
    """A model with the values of a fit.

    Attributes:
        model: the model.
        values: parameter name to value (SI), complete; eta is 0 where it is not known.
        fit: what `fit.json` says.
        sha256: of that file.
    """

    model: DamperModel
    values: Mapping[str, float]
    fit: Mapping[str, Any]
    sha256: str

    @property
    def name(self) -> str:
        """Of the model, as files and functions may be called."""
        return re.sub(r"\W", "_", self.model.name, flags=re.ASCII)

    @property
    def vector(self) -> FloatArray:
        """The values in the kernel's order, shape (parameters,), SI."""
        return self.model.vector(self.values)

    @property
    def covered(self) -> Covered | None:
        """What the tests covered; None where the fit does not tell."""
        told = self.fit.get("tested")
        return Covered.of_entry(told) if told else None

    @property
    def tested(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest displacement (m), velocity (m/s), current (A), temperature (degC); those that are told."""
        covered = self.covered
        return {} if covered is None else {name: ends for name, ends in covered.ranges() if ends is not None}

    def covariance(self) -> tuple[list[str], FloatArray]:
        """Names of the parameters that have standard errors, and their covariance (SI), shape (names, names)."""
        errors = {
            name: float(entry["standard_error"])
            for name, entry in self.fit["parameters"].items()
            if entry.get("identifiable", True) and entry.get("standard_error") is not None
        }
        rows = self.fit.get("correlation") or {}
        names = [name for name in errors if name in rows]
        matrix = [[float(rows[a][b]) * errors[a] * errors[b] if _finite(rows[a].get(b)) else math.nan for b in names]
                  for a in names]  # fmt: skip
        return names, np.array(matrix, dtype=float).reshape(len(names), len(names))

    def described(self) -> list[str]:
        """Lines for people: model, equation, units, ranges, parameters with intervals, covariance, hash of the fit."""
        lines = [
            f"Damper model {self.model.name}, hysteresis form {self.model.hysteresis}, fitted by mr-damper-rig.",
            f"Equation: {self.model.equation}",
            "Extension u (m about mid-stroke), velocity v (m/s, > 0 in rebound), acceleration a (m/s^2),",
            "current I (A, the coil's own, after its lag); force F (N), > 0 resists extension. All values SI.",
            f"SHA-256 of the fit: {self.sha256}",
            *self._judged(),
            *self._softens(),
            "",
            "Parameters: value, unit, 95 % interval of each by itself, standard error",
            *(self._parameter(name) for name in self.model.names),
        ]
        names, matrix = self.covariance()
        if names:
            lines += ["", f"Covariance (SI) of {', '.join(names)}, lower triangle:"]
            lines += [
                f"{name}: {' '.join(f'{value:.6g}' for value in row[: k + 1])}"
                for k, (name, row) in enumerate(zip(names, matrix, strict=True))
            ]
        return lines

    def _judged(self) -> list[str]:
        lines = []
        if (covered := self.covered) is not None:
            lines.append(f"Tested, and valid, within: {covered.told()}. Beyond is extrapolation.")
        else:
            lines.append("This fit does not say within which motion and currents it was tested.")
        if self.fit.get("adequate") is False:
            lines.append("DOES NOT FIT: model error exceeds the repeatability of the tests.")
        spring = (self.fit.get("series_spring") or {}).get("stiffness_N_m")
        if spring is not None:
            lines.append(f"A spring of {spring:.6g} N/m in series was found; the force here is the damper's behind it.")
        return lines

    def _softens(self) -> list[str]:
        """What is not in the exported force: how it follows the temperature."""
        told = self.fit.get("temperature")
        law = law_of_entries(told, self.fit["parameters"])
        if told is None or law is None:
            return []
        rates = ", ".join(f"{name} = {rate:.6g} 1/K" for name, rate in law.rates.items())
        return [
            f"The force here is that at {law.reference_degC:.4g} degC, whatever the temperature T is. Fitted at "
            f"{told['lowest_degC']:.4g} to {told['highest_degC']:.4g} degC; at another T take:",
            f"{law.formula(self.model)}; {rates}",
        ]

    def _parameter(self, name: str) -> str:
        entry, parameter = self.fit["parameters"].get(name) or {}, self.model.parameter(name)
        value = "not known" if entry.get("value") is None else f"{self.values[name]!r}"
        line = f"{name} = {value} {parameter.unit}"
        if entry.get("low") is not None and entry.get("high") is not None:
            line += f", {entry['low']:.6g} to {entry['high']:.6g}"
        if entry.get("standard_error") is not None:
            line += f", +- {entry['standard_error']:.3g}"
        if not entry.get("identifiable", True):
            line += ", not identifiable by these tests"
        return f"{line} ({parameter.meaning})"


def fitted_model(fit: Mapping[str, Any], file: str, sha256: str) -> FittedModel:
    """The model of a fit.

    Args:
        fit: of `fit.json`.
        file: its name, for messages.
        sha256: of the file.

    Raises:
        FileProblem: there is no such model; values are missing or no numbers, or belong to single currents: each.
    """
    dependence = (fit.get("current") or {}).get("dependence", "affine")
    if dependence != "affine":
        raise FileProblem(file, [
            f"is fitted with current dependence {dependence!r}; a model is exported from one fit over all currents: "
            "`rig identify RUN --current affine`"
        ])  # fmt: skip
    try:
        model = rig.dampers.model(str(fit["model"]), fit.get("hysteresis") or "kwok")
    except RigError as error:
        raise FileProblem(file, [f"model: {error}", FIX]) from error
    problems, values = _problems_of_tested(fit.get("tested")), {}
    for name in model.names:
        entry = fit["parameters"].get(name)
        entry = entry if isinstance(entry, dict) else {}
        value = entry.get("value")
        if not _finite(value) and (name != NOT_OF_THE_FORCE or value is not None):
            reason = entry.get("reason") or "identify again with tests that determine it"
            problems.append(f"parameters.{name}.value: got {value!r}, expected a finite number: {reason}")
        problems += [
            f"parameters.{name}.{key}: got {entry[key]!r}, expected a finite number or null"
            for key in ("low", "high", "standard_error")
            if entry.get(key) is not None and not _finite(entry[key])
        ]
        values[name] = float(value) if value is not None and _finite(value) else 0.0
    if problems:
        raise FileProblem(file, problems)
    return FittedModel(model, values, fit, sha256)


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _problems_of_tested(tested: object) -> list[str]:
    if not tested:
        return []
    told = tested if isinstance(tested, dict) else {}
    problems = []
    warm = ["temperature_degC"] if told.get("temperature_degC") is not None else []
    for key in (*TESTED, *warm):
        ends = told.get(key)
        if not (isinstance(ends, list) and len(ends) == 2 and all(map(_finite, ends)) and ends[0] <= ends[1]):
            problems.append(f"tested.{key}: got {ends!r}, expected the lowest and the highest value")
    levels = told.get("only_at_A") or []
    if not (isinstance(levels, list) and all(map(_finite, levels))):
        problems.append(f"tested.only_at_A: got {levels!r}, expected currents")
    return problems
