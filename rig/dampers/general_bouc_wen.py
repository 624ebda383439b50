"""The generalised Bouc-Wen model, whose loop leans to one side.

Energy: with sigma >= 1/2 the flanks of the loop store and give back, what is left is dissipated; for |phi| < 1/2 both
ends of the loop are finite, and its force there has the sign of the speed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from rig.dampers.arrays import FloatArray
from rig.dampers.asymmetric_bouc_wen import LOOP, YIELD, loop_shapes
from rig.dampers.friction import BACKGROUND
from rig.dampers.model import HystereticModel
from rig.dampers.parameter import Parameter, shape_parameter
from rig.dampers.separation import MotionScale, Separation
from rig.dampers.unit_columns import UnitSeparation

if TYPE_CHECKING:
    from rig.dampers.kernel import Kernel
    from rig.dampers.sampled_motion import Motion

LEANING = (-0.15, 0.15)  # starts of phi
MOST_LEANING = 0.45  # below 1/2, where one end of the loop would be at infinity


class GeneralizedBoucWenModel(HystereticModel):
    """Generalised Bouc-Wen model (Wang and Wen 2000): its loop leans to one side by phi (sgn v + sgn w)."""

    name: ClassVar[str] = "generalized_bouc_wen"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = (
        "F = kx u + kv v + kw w + f0, w' = rho v [1 - |w|^n (sigma sgn(v w) + 1 - sigma + phi (sgn v + sgn w))] "
        "(Wang and Wen 2000); kv, kw affine in I"
    )
    energy: ClassVar[str] = "dissipative over a closed loop for sigma >= 1/2 and |phi| < 1/2"
    speeds_tell_yield: ClassVar[bool] = True
    demonstration: ClassVar[Mapping[str, float]] = {
        "kx": 300.0, "kv": 700.0, "kv_b": 110.0, "f0": -150.0, "kw": 80.0, "kw_b": 250.0, "rho": 900.0, "sigma": 0.8,
        "n": 1.8, "phi": 0.15,
    }  # fmt: skip
    parameters: tuple[Parameter, ...] = (
        *BACKGROUND,
        *YIELD,
        *LOOP,
        shape_parameter("phi", "1", 0.1, -MOST_LEANING, MOST_LEANING, "asymmetry of the loop"),
    )

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel, sign  # loads numba
        from rig.dampers.leaning_loop import leaning_travel  # loads numba
        from rig.dampers.loop_curve import turning_point  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            return float(p[0] * u + (p[1] + p[2] * current) * v + p[3] + (p[4] + p[5] * current) * s0)

        @njit()
        def rates(p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
            leaning = p[9] * (sign(v) + sign(s0))
            share = p[7] * sign(v * s0) + 1.0 - p[7] + leaning
            return p[6] * v * (1.0 - abs(s0) ** p[8] * share), 0.0

        @njit()
        def step(p: FloatArray, state: FloatArray, motion: Motion, current: float, dt: float) -> bool:
            u0, v0, c1, c2, c3 = motion
            v_end = v0 + dt * (c1 + dt * (c2 + dt * c3))
            turn = u_end = u0 + dt * (v0 + dt * (c1 / 2.0 + dt * (c2 / 3.0 + dt * c3 / 4.0)))
            if v0 * v_end < 0.0:
                turn = turning_point(u0, v0, u_end, v_end, dt)
            w = leaning_travel(state[0], p[6] * (turn - u0), p[7], p[8], p[9])
            state[0] = leaning_travel(w, p[6] * (u_end - turn), p[7], p[8], p[9])
            return True

        return Kernel(force, rates, step=step)

    def separation(self, scale: MotionScale) -> Separation:
        """See `DamperModel.separation`."""
        phi = (-MOST_LEANING, MOST_LEANING, list(LEANING))
        return UnitSeparation(self, ("kw",), {**loop_shapes(scale), "phi": phi})
