"""How warm oil weakens a damper: viscosity and yield force fall exponentially with the temperature.

    viscous parameters(T) = viscous parameters(T0) exp(-k_viscous (T - T0))
    yield parameters(T)   = yield parameters(T0) exp(-k_yield (T - T0))

The first is Reynolds' law of viscosity (Reynolds 1886), which Arrhenius' is within a few tens of kelvin; the second is
the same form for the yield stress, whose fall is small: of the MR fluids measured, the viscosity falls several times
as fast (Sahin, Wang, Gordaninejad 2009), and in a damper the yield stress may stay as it is (McKee, Wang, Gordaninejad
2011). Which of a model's parameters soften is the model's own (`Parameter.softens`); those of damping are viscous,
the others yield. Stiffness, inertia, gas force and the shape of the hysteresis stay.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.model import DamperModel
from rig.dampers.parameter import Parameter

VISCOUS, YIELD = "k_viscous", "k_yield"
COMMON = "k_warm"
"""One rate of both."""
NONE = "none"
RATES: Mapping[str, tuple[str, ...]] = {
    NONE: (), "viscous": (VISCOUS,), "yield": (YIELD,), "common": (COMMON,), "both": (VISCOUS, YIELD),
}  # fmt: skip
"""Temperature laws by name, and the names of their rates (1/K)."""


@dataclass(frozen=True)
class TemperatureLaw:
    """Rates at which warm oil weakens a damper.

    Attributes:
        reference_degC: temperature T0 (degC) at which the model's values hold.
        rates: name of each rate (`RATES`) to its value (1/K); positive where warm oil weakens.
        bend: 0 for the exponential; with 1 the same rates fall along a straight line, to second order, and about as far
            on its other side lies Arrhenius' law of 0.6 % per kelvin. Tests of one span do not tell them.
    """

    reference_degC: float
    rates: Mapping[str, float]
    bend: float = 0.0

    def rate_1_K(self, parameter: Parameter) -> float:
        """The rate (1/K) that a parameter follows; 0 where it does not soften, or its rate is not part of this law."""
        return sum(rate for name, rate in self.rates.items() if self.follows(parameter, name))

    def follows(self, parameter: Parameter, rate: str) -> bool:
        """Whether a parameter falls at the rate of this name."""
        return parameter.softens and rate in {COMMON, softens_by(parameter)}

    def vectors(self, model: DamperModel, values: Mapping[str, float], temperature_degC: FloatArray) -> FloatArray:
        """The model's parameters at temperatures (degC) of shape (n,): (n, parameters), in the kernel's order.

        Raises:
            KeyError: a parameter is missing or unknown.
        """
        rates = np.array([self.rate_1_K(parameter) for parameter in model.parameters])
        fall = np.outer(np.asarray(temperature_degC, dtype=float) - self.reference_degC, rates)
        return np.ascontiguousarray(model.vector(values) * np.exp(-fall * (1.0 + 0.5 * self.bend * fall)))

    def formula(self, model: DamperModel) -> str:
        """Which of a model's parameters follow which rate, as text."""
        followers: dict[str, list[str]] = {}
        for parameter in model.parameters:
            for name in self.rates:
                if self.follows(parameter, name):
                    followers.setdefault(name, []).append(parameter.name)
        parts = [
            f"{', '.join(names)} times exp(-{rate} (T - {self.reference_degC:.4g} degC))"
            for rate, names in followers.items()
        ]
        return "; ".join(parts)


def softens_by(parameter: Parameter) -> str:
    """The rate that a parameter follows: damping's (N s/m, N s/(m A)) or the yield force's; empty where it stays."""
    if not parameter.softens:
        return ""
    return VISCOUS if parameter.term == "viscous" or parameter.unit.startswith("N s/") else YIELD
