"""The Bouc-Wen model with other forces in rebound and jounce: asymmetric_bouc_wen.

Energy: with sigma >= 1/2 the flanks of the loop store and give back, what is left is dissipated; a force that is larger
in one direction still has the sign of the speed where |kwa| <= kw and |kva| <= kv.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from rig.dampers.arrays import FloatArray
from rig.dampers.bouc_wen import EXPONENT
from rig.dampers.friction import BACKGROUND, travel_rates
from rig.dampers.model import HystereticModel
from rig.dampers.parameter import Parameter, linear_parameter, shape_parameter
from rig.dampers.separation import MotionScale, Separation
from rig.dampers.unit_columns import UnitSeparation

if TYPE_CHECKING:
    from rig.dampers.kernel import Kernel

SIGMAS = (0.6, 1.5)
SIGMA_LIMITS = (0.5, 50.0)
EXPONENTS = (1.3, 2.5)
EXPONENT_LIMITS = (1.001, 16.0)

LOOP = (
    shape_parameter("rho", "1/m", 500.0, 1e-2, 1e6, "inverse of the yield displacement"),
    shape_parameter("sigma", "1", 0.6, 0.5, 100.0, "shape of the loop"),
    EXPONENT,
)
YIELD = (
    linear_parameter("kw", "N", 50.0, "yield force at zero current", term="yield", softens=True),
    linear_parameter("kw_b", "N/A", 200.0, "yield force per ampere", term="yield", at_zero="kw", softens=True),
)


def loop_shapes(scale: MotionScale) -> dict[str, tuple[float, float, list[float]]]:
    """Limits and starts of the loop's shape for tests that move so."""
    return {
        "rho": travel_rates(scale),
        "sigma": (*SIGMA_LIMITS, list(SIGMAS)),
        "n": (*EXPONENT_LIMITS, list(EXPONENTS)),
    }


class AsymmetricBoucWenModel(HystereticModel):
    """Normalised Bouc-Wen model with other yield and viscous forces in rebound and jounce (after Kwok et al. 2007)."""

    name: ClassVar[str] = "asymmetric_bouc_wen"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = (
        "F = kx u + kv v + kva |v| + kw w + kwa |w| + f0, w as in normalized_bouc_wen (after Kwok 2007); "
        "kv, kva, kw, kwa affine in I"
    )
    energy: ClassVar[str] = "dissipative over a closed loop for |kwa| <= kw and |kva| <= kv"
    speeds_tell_yield: ClassVar[bool] = True
    demonstration: ClassVar[Mapping[str, float]] = {
        "kx": 300.0, "kv": 700.0, "kv_b": 110.0, "f0": -150.0, "kva": 150.0, "kva_b": -40.0, "kw": 80.0, "kw_b": 250.0,
        "kwa": 15.0, "kwa_b": 30.0, "rho": 1200.0, "sigma": 0.8, "n": 1.8,
    }  # fmt: skip
    parameters: tuple[Parameter, ...] = (
        *BACKGROUND,
        linear_parameter(
            "kva", "N s/m", 0.0, "half the difference in viscous damping (rebound minus compression) at zero current",
            softens=True,
        ),
        linear_parameter(
            "kva_b", "N s/(m A)", 0.0, "half the difference in viscous damping (rebound minus compression) per ampere",
            at_zero="kva", softens=True,
        ),
        *YIELD,
        linear_parameter(
            "kwa", "N", 0.0, "half the difference in yield force (rebound minus compression) at zero current",
            softens=True,
        ),
        linear_parameter(
            "kwa_b", "N/A", 0.0, "half the difference in yield force (rebound minus compression) per ampere",
            at_zero="kwa", softens=True,
        ),
        *LOOP,
    )

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel, bouc_wen_rate  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            viscous = (p[1] + p[2] * current) * v + (p[4] + p[5] * current) * abs(v)
            yielding = (p[6] + p[7] * current) * s0 + (p[8] + p[9] * current) * abs(s0)
            return float(p[0] * u + p[3] + viscous + yielding)

        @njit()
        def rates(p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
            return bouc_wen_rate(s0, v, p[10] * p[11], p[10] * (1.0 - p[11]), p[10], p[12]), 0.0

        @njit()
        def fastest_rate(p: FloatArray, v: float, current: float) -> float:
            return float(p[10] * p[12] * abs(v) * max(1.0, abs(2.0 * p[11] - 1.0)))

        @njit()
        def loop(p: FloatArray) -> tuple[float, float, float, float]:
            return p[10], p[11], p[12], 1.0

        return Kernel(force, rates, fastest_rate, loop)

    def separation(self, scale: MotionScale) -> Separation:
        """See `DamperModel.separation`."""
        return UnitSeparation(self, ("kw", "kwa"), loop_shapes(scale))
