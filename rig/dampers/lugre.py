"""The LuGre model: bristles that bend, whose friction falls with the speed at which they slide.

Energy: |w| stays below 1 + s, so of the bristles' power kw w v the part rho |v| w^2 kw / g >= 0 does not come back, the
rest is elastic. The damping kd of the bristles keeps it passive at every instant only where kd is small enough
(Barahanov and Ortega 2000); over a loop it dissipates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.friction import BACKGROUND, BRISTLE, FRICTION, travel_rates
from rig.dampers.model import HystereticModel
from rig.dampers.parameter import Parameter, linear_parameter, shape_parameter
from rig.dampers.separation import Motion, MotionScale, Separation
from rig.dampers.unit_columns import UnitSeparation

if TYPE_CHECKING:
    from rig.dampers.kernel import Kernel
    from rig.dampers.sampled_motion import Motion as Step

PIECE = 0.25  # of the bristles' travel, 1/rho, that one piece of a step may be long
MOST_PIECES = 6  # a step; longer ones saturate inside, where a piece's length does not matter
STICTION = (0.1, 1.0)
STRIBECK = (0.03, 0.3)  # vs, as a share of the greatest speed
SHORTEST = 0.02  # 1/rho, as a share of the smallest amplitude


class LuGreModel(HystereticModel):
    """LuGre model (Canudas et al. 1995; for MR dampers Jimenez and Alvarez-Icaza 2005)."""

    name: ClassVar[str] = "lugre"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = (
        "F = kx u + kv v + kw w + kd w'/rho + f0, w' = rho (v - |v| w / g), g = 1 + s exp(-(v/vs)^2) "
        "(Canudas, Olsson, Astrom and Lischinsky 1995); kv, kw, kd affine in I"
    )
    energy: ClassVar[str] = (
        "dissipates rho |v| w^2 kw / g + kv v^2 + kd w' v / rho; the remaining energy is elastic and is recovered"
    )
    speeds_tell_yield: ClassVar[bool] = True
    demonstration: ClassVar[Mapping[str, float]] = {
        "kx": 300.0, "kv": 600.0, "kv_b": 90.0, "f0": -150.0, "kw": 60.0, "kw_b": 220.0, "kd": 200.0, "kd_b": 120.0,
        "rho": 700.0, "s": 0.5, "vs": 0.08,
    }  # fmt: skip
    parameters: tuple[Parameter, ...] = (
        *BACKGROUND,
        *FRICTION,
        linear_parameter("kd", "N s/m", 0.0, "damping of the bristles at zero current", softens=True),
        linear_parameter("kd_b", "N s/(m A)", 0.0, "damping of the bristles per ampere", at_zero="kd", softens=True),
        BRISTLE,
        shape_parameter("s", "1", 0.3, 1e-3, 10.0, "ratio of static to sliding friction, minus 1"),
        shape_parameter(
            "vs",
            "m/s",
            0.05,
            1e-5,
            10.0,
            ("speed of the transition from static to sliding friction (Stribeck velocity)"),
        ),
    )

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel  # loads numba

        @njit()
        def slip(p: FloatArray, s0: float, v: float) -> float:
            """w'/rho (m/s)."""
            share = v / p[10]
            return float(v - abs(v) * s0 / (1.0 + p[9] * math.exp(-share * share)))

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            bristles = (p[4] + p[5] * current) * s0 + (p[6] + p[7] * current) * slip(p, s0, v)
            return float(p[0] * u + (p[1] + p[2] * current) * v + p[3] + bristles)

        @njit()
        def rates(p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
            return p[8] * slip(p, s0, v), 0.0

        @njit()
        def step(p: FloatArray, state: FloatArray, motion: Step, current: float, dt: float) -> bool:
            """Exact for a constant speed, in pieces of at most `PIECE` of the bristles' travel."""
            u, v, c1, c2, c3 = motion
            top = max(abs(v), abs(v + dt * (c1 + dt * (c2 + dt * c3))))
            pieces = int(min(float(MOST_PIECES), max(2.0, math.ceil(p[8] * top * dt / PIECE))))
            before = u
            for k in range(pieces):
                t, half = dt * (k + 1) / pieces, dt * (k + 0.5) / pieces
                after = u + t * (v + t * (c1 / 2.0 + t * (c2 / 3.0 + t * c3 / 4.0)))
                share = (v + half * (c1 + half * (c2 + half * c3))) / p[10]
                limit = 1.0 + p[9] * math.exp(-share * share)
                end = limit if after >= before else -limit
                state[0] = end + (state[0] - end) * math.exp(-p[8] * abs(after - before) / limit)
                before = after
            return True

        return Kernel(force, rates, step=step)

    def separation(self, scale: MotionScale) -> Separation:
        """See `DamperModel.separation`."""
        top = scale.top_speed_m_s
        slowest, _, starts = travel_rates(scale)
        fastest = 1.0 / (SHORTEST * scale.smallest_amplitude_m)
        shapes = {
            "rho": (slowest, fastest, [rho for rho in starts if rho < fastest]),
            "s": (1e-3, 10.0, STICTION),
            "vs": (1e-3 * top, 3.0 * top, [share * top for share in STRIBECK]),
        }
        return LuGreSeparation(self, ("kw", "kd"), shapes)


class LuGreSeparation(UnitSeparation):
    """The LuGre model split for projection: both its columns follow from one run of the bristles."""

    def columns(self, source: Motion, shape: FloatArray) -> list[FloatArray]:
        """See `UnitSeparation.columns`."""
        w, v = self.column(source, "kw", shape), source.v_m_s
        static_share = float(shape[1]) * np.exp(-((v / float(shape[2])) ** 2))
        return [w, v - np.abs(v) * w / (1.0 + static_share)]
