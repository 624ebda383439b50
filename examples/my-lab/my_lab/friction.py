"""This lab's damper model: friction that turns round with the path (after Dahl), beside a viscous force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from rig.dampers.arrays import FloatArray
from rig.dampers.model import HystereticModel
from rig.dampers.parameter import Parameter, linear_parameter, shape_parameter

if TYPE_CHECKING:
    from rig.dampers.kernel import Kernel


class MyLabFriction(HystereticModel):
    """F = kx u + kv v + kw w + f0, w' = rho (v - |v| w); kv and kw affine in the current I."""

    name: ClassVar[str] = "my_lab_friction"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = "F = kx u + kv v + kw w + f0, w' = rho (v - |v| w) (after Dahl 1968); kv, kw affine in I"
    demonstration: ClassVar[Mapping[str, float]] = {
        "kx": 300.0, "kv": 700.0, "kv_b": 110.0, "kw": 80.0, "kw_b": 250.0, "f0": -150.0, "rho": 800.0,
    }  # fmt: skip
    parameters: tuple[Parameter, ...] = (
        linear_parameter("kx", "N/m", 0.0, "stiffness"),
        linear_parameter("kv", "N s/m", 500.0, "viscous damping at zero current", softens=True),
        linear_parameter("kv_b", "N s/(m A)", 0.0, "viscous damping per ampere", at_zero="kv", softens=True),
        linear_parameter("kw", "N", 50.0, "friction at zero current", softens=True),
        linear_parameter("kw_b", "N/A", 200.0, "friction per ampere", at_zero="kw", softens=True),
        linear_parameter("f0", "N", 0.0, "force offset"),
        shape_parameter("rho", "1/m", 500.0, 1e-2, 1e6, "inverse of the travel over which the friction reverses"),
    )

    def kernel(self) -> Kernel:
        """The equation compiled: force and rates of one instant."""
        from numba import njit

        from rig.dampers.kernel import Kernel

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            return float(p[0] * u + (p[1] + p[2] * current) * v + (p[3] + p[4] * current) * s0 + p[5])

        @njit()
        def rates(p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
            return p[6] * (v - abs(v) * s0), 0.0

        @njit()
        def fastest_rate(p: FloatArray, v: float, current: float) -> float:
            return float(p[6] * abs(v))

        return Kernel(force, rates, fastest_rate)
