"""A fit with its model, as the exports of models need it: values, how sure they are, and where they were tested."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from rig.dampers.arrays import FloatArray
from rig.dampers.catalogue import PRINTED
from rig.dampers.covered import Covered
from rig.dampers.current_law_model import PLUS
from rig.dampers.model import DamperModel
from rig.fits.fit_record import FitRecord


@dataclass(frozen=True)
class FittedModel:
    """A model with the values of a fit.

    Attributes:
        model: the model.
        values: parameter name to value (SI), complete; eta is 0 where it is not known.
        fit: the fit.
    """

    model: DamperModel
    values: Mapping[str, float]
    fit: FitRecord

    @classmethod
    def of(cls, fit: FitRecord) -> FittedModel:
        """The model of a fit.

        Raises:
            FileProblem: there is no such model, or values are missing, or belong to single currents.
        """
        return cls(*fit.known_damper(eta_1_s=0.0), fit)

    @property
    def name(self) -> str:
        """Of the model, as files and functions may be called."""
        return re.sub(r"\W", "_", self.model.name, flags=re.ASCII)

    @property
    def sha256(self) -> str:
        """Of the fit's file (hex)."""
        return self.fit.sha256

    @property
    def vector(self) -> FloatArray:
        """The values in the kernel's order, shape (parameters,), SI."""
        return self.model.vector(self.values)

    @property
    def covered(self) -> Covered | None:
        """What the tests covered; None where the fit does not state it."""
        return self.fit.tested

    @property
    def tested(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest displacement (m), velocity (m/s), current (A), temperature (degC); where known."""
        covered = self.covered
        return {} if covered is None else {name: ends for name, ends in covered.ranges() if ends is not None}

    def described(self) -> list[str]:
        """Lines for people: model, equation, units, ranges, parameters with intervals, covariance, hash of the fit."""
        form = f", hysteresis form {self.model.hysteresis}" if self.model.name.partition(PLUS)[0] in PRINTED else ""
        lines = [
            f"Damper model {self.model.name}{form}, fitted by mr-damper-rig.",
            f"Equation: {self.model.equation}",
            "Extension u (m about mid-stroke), velocity v (m/s, > 0 in rebound), acceleration a (m/s^2),",
            "current I (A, in the coil, after its lag); force F (N, > 0 if it resists extension).",
            "All values are in SI units.",
            f"SHA-256 of the fit: {self.sha256}",
            *self._assessment(),
            *self._softens(),
            "",
            "Parameters: value, unit, 95 % interval (each parameter separately), standard error",
            *(self._parameter(name) for name in self.model.names),
        ]
        names, matrix = self.fit.known_covariance()
        if names:
            lines += ["", f"Covariance (SI) of {', '.join(names)}, lower triangle:"]
            lines += [
                f"{name}: {' '.join(f'{value:.6g}' for value in row[: k + 1])}"
                for k, (name, row) in enumerate(zip(names, matrix, strict=True))
            ]
        return lines

    def _assessment(self) -> list[str]:
        lines = []
        if (covered := self.covered) is not None:
            lines.append(
                f"Valid within the tested range: {covered.describe()}. The force outside it is an extrapolation."
            )
        else:
            lines.append("The tested range of this fit is unknown.")
        if self.fit.adequate is False:
            lines.append("DOES NOT FIT: model error exceeds the repeatability of the tests.")
        spring = self.fit.series
        if spring is not None and spring.stiffness_N_m is not None:
            stiffness = f"{spring.stiffness_N_m:.6g} N/m"
            lines.append(
                f"The fit includes a series spring of {stiffness}; the force here is that of the damper without the "
                "spring."
            )
        return lines

    def _softens(self) -> list[str]:
        """What is not in the exported force: how it follows the temperature."""
        term, law = self.fit.temperature, self.fit.temperature_law
        if term is None or law is None:
            return []
        rates = ", ".join(f"{name} = {rate:.6g} 1/K" for name, rate in law.rates.items())
        return [
            f"The force here is for {law.reference_degC:.4g} degC and does not depend on the temperature T. Fitted "
            f"from {term.lowest_degC:.4g} to {term.highest_degC:.4g} degC; for another T, use:",
            f"{law.formula(self.model)}; {rates}",
        ]

    def _parameter(self, name: str) -> str:
        entry, parameter = self.fit.parameters.get(name), self.model.parameter(name)
        if entry is None or entry.value is None:
            line = f"{name} unknown, {parameter.unit}"
        else:
            line = f"{name} = {self.values[name]!r} {parameter.unit}"
        if entry is not None:
            if entry.low is not None and entry.high is not None:
                line += f", {entry.low:.6g} to {entry.high:.6g}"
            if entry.standard_error is not None:
                line += f", +- {entry.standard_error:.3g}"
            if entry.quantity:
                line += f", value of {entry.quantity}"
            elif not entry.identifiable:
                line += ", not identifiable from these tests"
        return f"{line} ({parameter.meaning})"
