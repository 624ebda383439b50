"""The Dahl model: friction that turns round with the path, beside a viscous force; terms that other models share.

Energy: |w| <= 1, so of the friction's power kw w v the part rho |v| w^2 kw >= 0 does not come back, the rest is elastic
energy of the bristles; with kw and kv not negative it dissipates.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.model import HystereticModel
from rig.dampers.parameter import Parameter, linear_parameter, shape_parameter
from rig.dampers.separation import MotionScale, Separation
from rig.dampers.unit_columns import UnitSeparation

if TYPE_CHECKING:
    from rig.dampers.kernel import Kernel

LENGTHS = np.geomspace(0.004, 0.5, 6)  # starts: 1/rho, as a share of the smallest amplitude

BACKGROUND = (
    linear_parameter("kx", "N/m", 0.0, "stiffness"),
    linear_parameter("kv", "N s/m", 500.0, "viscous damping at zero current", term="viscous", softens=True),
    linear_parameter(
        "kv_b", "N s/(m A)", 0.0, "viscous damping per ampere", term="viscous", at_zero="kv", softens=True
    ),
    linear_parameter("f0", "N", 0.0, "force offset"),
)
FRICTION = (
    linear_parameter("kw", "N", 50.0, "friction at zero current", term="yield", softens=True),
    linear_parameter("kw_b", "N/A", 200.0, "friction per ampere", term="yield", at_zero="kw", softens=True),
)
BRISTLE = shape_parameter("rho", "1/m", 500.0, 1e-2, 1e6, "inverse of the travel over which the friction reverses")


def travel_rates(scale: MotionScale) -> tuple[float, float, list[float]]:
    """Limits and starts of an inverse travel (1/m) for tests that move so."""
    amplitude = scale.smallest_amplitude_m
    return 1e-3 / amplitude, 2.0 / (LENGTHS[0] * amplitude), [float(1.0 / (share * amplitude)) for share in LENGTHS]


class DahlModel(HystereticModel):
    """Dahl model (Dahl 1968; for MR dampers Ikhouane and Rodellar 2007), its damping and friction affine in I."""

    name: ClassVar[str] = "dahl"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = "F = kx u + kv v + kw w + f0, w' = rho (v - |v| w) (Dahl 1968); kv, kw affine in I"
    energy: ClassVar[str] = (
        "dissipates rho |v| w^2 kw + kv v^2 at every instant; the remaining energy is elastic and is recovered"
    )
    speeds_tell_yield: ClassVar[bool] = True
    demonstration: ClassVar[Mapping[str, float]] = {
        "kx": 300.0, "kv": 700.0, "kv_b": 110.0, "f0": -150.0, "kw": 80.0, "kw_b": 250.0, "rho": 800.0,
    }  # fmt: skip
    parameters: tuple[Parameter, ...] = (*BACKGROUND, *FRICTION, BRISTLE)

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            return float(p[0] * u + (p[1] + p[2] * current) * v + p[3] + (p[4] + p[5] * current) * s0)

        @njit()
        def rates(p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
            return p[6] * (v - abs(v) * s0), 0.0

        @njit()
        def fastest_rate(p: FloatArray, v: float, current: float) -> float:
            return float(p[6] * abs(v))

        @njit()
        def loop(p: FloatArray) -> tuple[float, float, float, float]:
            return p[6], 1.0, 1.0, 1.0

        return Kernel(force, rates, fastest_rate, loop)

    def separation(self, scale: MotionScale) -> Separation:
        """See `DamperModel.separation`."""
        return UnitSeparation(self, ("kw",), {"rho": travel_rates(scale)})
