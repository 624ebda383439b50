"""Models of straight pieces over the speed: hysteretic_biviscous and digressive_bilinear.

Energy: every piece of `digressive_bilinear` has the sign of the speed, so it dissipates at every instant where its
slopes are not negative. `hysteretic_biviscous` has the sign of the speed but within 2 v0 after a turn of the
acceleration, where its force still is that of the motion before; over a loop faster than v0 + vy it dissipates.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from rig.dampers.arrays import FloatArray
from rig.dampers.friction import BACKGROUND
from rig.dampers.model import HystereticModel
from rig.dampers.parameter import Parameter, linear_parameter, shape_parameter
from rig.dampers.separation import MotionScale, Separation
from rig.dampers.unit_columns import UnitSeparation

if TYPE_CHECKING:
    from rig.dampers.kernel import Kernel
    from rig.dampers.sampled_motion import Motion

YIELD_SPEEDS = (0.02, 0.08, 0.3)  # starts: vy, as a share of the greatest speed
OFFSET_SPEEDS = (0.01, 0.05, 0.2)  # v0
PER_AMPERE = (0.0, 0.5)  # vy_b times the mean current, as a share of vy
KNEES = (0.03, 0.1, 0.3, 0.7)
LEAST_M_S = 1e-6  # yield speed below which the branch is a step


class HystereticBiviscousModel(HystereticModel):
    """Nonlinear hysteretic bi-viscous model (Wereley, Pang and Park 1998), its yield speed affine in the current.

    Published in six pieces by the signs of speed and acceleration. With c the slope after yield, vy = Fy/(Cpr - c) and
    the offset speed taken by a play operator q (which the sign of the acceleration is on a loop) they are one line: q
    follows v at v0 behind it, whichever way v goes, so nothing jumps where the acceleration changes its sign.
    """

    name: ClassVar[str] = "hysteretic_biviscous"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = (
        "F = kx u + kv v + ky max(-1, min(1, q/vy)) + f0, q = v - v0 while v rises, v + v0 while v falls (Wereley "
        "1998); kv, ky, vy affine in I"
    )
    energy: ClassVar[str] = (
        "dissipative over a loop whose peak speed exceeds v0 + vy; returns energy within 2 v0 of a reversal"
    )
    demonstration: ClassVar[Mapping[str, float]] = {
        "kx": 300.0, "kv": 700.0, "kv_b": 110.0, "f0": -150.0, "ky": 60.0, "ky_b": 240.0, "vy": 0.03, "vy_b": 0.01,
        "v0": 0.015,
    }  # fmt: skip
    parameters: tuple[Parameter, ...] = (
        *BACKGROUND,
        linear_parameter("ky", "N", 50.0, "yield force at zero current", term="yield", softens=True),
        linear_parameter("ky_b", "N/A", 200.0, "yield force per ampere", term="yield", at_zero="ky", softens=True),
        shape_parameter("vy", "m/s", 0.02, 1e-5, 10.0, (
            "speed relative to v0 at which the force yields, at zero current"
        )),
        shape_parameter(
            "vy_b", "m/(s A)", 0.0, 0.0, 10.0, "speed relative to v0 at which the force yields, per ampere",
            at_zero="vy",
        ),
        shape_parameter("v0", "m/s", 0.01, 1e-6, 10.0, "half-width of the loop, expressed as a speed"),
    )

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            share = s0 / max(p[6] + p[7] * current, LEAST_M_S)
            yielding = (p[4] + p[5] * current) * max(-1.0, min(1.0, share))
            return float(p[0] * u + (p[1] + p[2] * current) * v + p[3] + yielding)

        @njit()
        def step(p: FloatArray, state: FloatArray, motion: Motion, current: float, dt: float) -> bool:
            v_end = motion[1] + dt * (motion[2] + dt * (motion[3] + dt * motion[4]))
            state[0] = max(v_end - p[8], min(v_end + p[8], state[0]))
            return True

        return Kernel(force, step=step)

    def separation(self, scale: MotionScale) -> Separation:
        """See `DamperModel.separation`."""
        top, mean_A = scale.top_speed_m_s, max(scale.mean_current_A, 1e-3)
        first = YIELD_SPEEDS[1] * top
        shapes = {
            "vy": (1e-3 * top, 2.0 * top, [share * top for share in YIELD_SPEEDS]),
            "vy_b": (0.0, 2.0 * top / mean_A, [share * first / mean_A for share in PER_AMPERE]),
            "v0": (1e-3 * top, top, [share * top for share in OFFSET_SPEEDS]),
        }
        return UnitSeparation(self, ("ky",), shapes)


def _piece(name: str, where: str) -> tuple[Parameter, Parameter]:
    return (
        linear_parameter(name, "N s/m", 500.0, f"damping {where} at zero current", term="viscous", softens=True),
        linear_parameter(
            f"{name}_b", "N s/(m A)", 0.0, f"damping {where} per ampere", term="viscous", at_zero=name, softens=True
        ),
    )


class DigressiveBilinearModel(HystereticModel):
    """Digressive bi-linear damper (Dixon 2007, The Shock Absorber Handbook): a knee each in rebound and in jounce."""

    name: ClassVar[str] = "digressive_bilinear"
    states: ClassVar[int] = 0
    equation: ClassVar[str] = (
        "F = kx u + f0 + cl v + (ch - cl) (v - vk) for |v| > vk, with separate values for rebound and compression "
        "(Dixon 2007); cl, ch affine in I"
    )
    energy: ClassVar[str] = "dissipative at every instant if no slope is negative"
    knees: ClassVar[Mapping[str, tuple[str, ...]]] = {
        f"vk_{side}": tuple(f"{slope}_{side}{ampere}" for slope in ("cl", "ch") for ampere in ("", "_b"))
        for side in ("plus", "minus")
    }
    """Each knee with the slopes on its two sides."""
    demonstration: ClassVar[Mapping[str, float]] = {
        "kx": 300.0, "f0": -150.0, "cl_plus": 2000.0, "cl_plus_b": 3000.0, "ch_plus": 700.0, "ch_plus_b": 100.0,
        "cl_minus": 1200.0, "cl_minus_b": 2500.0, "ch_minus": 500.0, "ch_minus_b": 150.0, "vk_plus": 0.06,
        "vk_minus": 0.09,
    }  # fmt: skip
    parameters: tuple[Parameter, ...] = (
        BACKGROUND[0],
        BACKGROUND[3],
        *_piece("cl_plus", "in slow rebound"),
        *_piece("ch_plus", "in fast rebound"),
        *_piece("cl_minus", "in slow compression"),
        *_piece("ch_minus", "in fast compression"),
        shape_parameter("vk_plus", "m/s", 0.05, 1e-5, 10.0, "speed at the knee in rebound"),
        shape_parameter("vk_minus", "m/s", 0.05, 1e-5, 10.0, "speed at the knee in compression"),
    )

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            first = 2 if v >= 0.0 else 6
            knee = p[10] if v >= 0.0 else -p[11]
            slow = min(v, knee) if v >= 0.0 else max(v, knee)
            low, high = p[first] + p[first + 1] * current, p[first + 2] + p[first + 3] * current
            return float(p[0] * u + p[1] + low * slow + high * (v - slow))

        return Kernel(force)

    def separation(self, scale: MotionScale) -> Separation:
        """See `DamperModel.separation`."""
        top = scale.top_speed_m_s
        knee = (1e-3 * top, top, [share * top for share in KNEES])
        return UnitSeparation(
            self, ("cl_plus", "ch_plus", "cl_minus", "ch_minus"), {"vk_plus": knee, "vk_minus": knee}
        )
