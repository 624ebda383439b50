"""A model of real dampers: a yield loop and a force that grows with the logarithm of the speed, behind a spring.

Measured loops of MR dampers at several accelerations show the spring: plotted over the rod's speed, the force falls
behind near each reversal, the more the faster the rod turns; over v - F'/k the falling branches of all motions lie on
each other. The spring is what gives way under the whole force: mounts, the fluid in its chambers, the gas in it. The
damper's own piston moves less than the rod, by force over stiffness.

    F = f0 + k x + m a                     x the spring's stretch from where f0 holds it, m what moves with the rod
    k x = kx u_p + kv v_p + (ky + ku u_p) w + kt asinh(v_p / vt),   u_p = u - x, v_p = v - x'
    w' = rho (v_p - |v_p| |w| w / 2 - v_p w^2 / 2)

The loop w is Wen's (1976) with sigma = 1/2 and n = 2, which unloads elastically; the logarithm is the sinh law of flow
(Eyring 1936). kv and ku are affine in the current, ky is quadratic, kt cubic.

Energy: the springs k and kx, the mass and the offset give back what they take. kv and kt count as 0 at a current where
their polynomials are negative, so their terms dissipate at every instant, whatever was fitted. The yield force
dissipates over a loop where ky + ku u is not negative; while w unloads it gives back what the loop's flank stored.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.lost_motion import LostMotionModel
from rig.dampers.model import HystereticModel
from rig.dampers.parameter import Parameter, linear_parameter, shape_parameter
from rig.dampers.separation import MotionScale, Search, Unknowns

if TYPE_CHECKING:
    from rig.dampers.kernel import Compiled, Kernel

TAKEN = ("kx", "kv", "kv_b", "f0", "ky", "ky_b", "ky_c", "ku", "ku_b", "kt", "kt_b", "kt_c", "kt_d")
STIFFEST_N_m = 3e8
"""Gives way by 3 um at 1 kN, as fine as displacement sensors of test rigs are."""
GIVES_WAY = (0.01, 0.03, 0.1)  # starts: stretch at the mean yield force, as a share of the smallest amplitude
OPENS = (0.6, 3.0)  # starts: rho as a share of that of `lost_motion`, whose loop opens later
THINNING, EYRING = 0.1, 0.02  # start without a logarithmic force: kt over ky, and vt over the top speed
BENDS = (0.003, 0.01, 0.03)  # starts with little of it: vt over the top speed
VISCOUS = 0.05  # and the viscous force at the top speed over the yield force


class SprungBoucWenModel(HystereticModel):
    """Yield loop, viscous and logarithmic force behind a spring, and a mass at the rod; polynomials in I."""

    name: ClassVar[str] = "sprung_bouc_wen"
    states: ClassVar[int] = 2
    equation: ClassVar[str] = (
        "F = f0 + k x + m a, k x = kx u_p + kv v_p + (ky + ku u_p) w + kt asinh(v_p/vt), u_p = u - x, v_p = v - x', w' "
        "= rho (v_p - |v_p| |w| w / 2 - v_p w^2 / 2); kv, ku affine, ky quadratic, kt cubic in I, kv, kt not negative "
        "(Wen 1976; Eyring 1936)"
    )
    energy: ClassVar[str] = (
        "kv and kt are dissipative at every instant; the yield force is dissipative over a closed loop and returns "
        "energy while it unloads; the springs k and kx and the mass return energy"
    )
    speeds_tell_yield: ClassVar[bool] = True
    non_negative: ClassVar[tuple[str, ...]] = ("kv",)
    demonstration: ClassVar[Mapping[str, float]] = {
        "kx": 300.0, "kv": 300.0, "kv_b": 60.0, "f0": -150.0, "ky": 40.0, "ky_b": 200.0, "ky_c": 10.0, "ku": -200.0,
        "ku_b": 100.0, "kt": 15.0, "kt_b": 25.0, "kt_c": 6.0, "kt_d": -2.0, "rho": 1500.0, "vt": 2e-3, "k": 1.5e6,
        "m": 4.0,
    }  # fmt: skip
    parameters: tuple[Parameter, ...] = (
        *(LostMotionModel().parameter(name) for name in TAKEN),
        shape_parameter("rho", "1/m", 1000.0, 1e-2, 1e6, "inverse of the travel over which the yield force reverses"),
        shape_parameter("vt", "m/s", 0.005, 1e-6, 10.0, "speed above which the viscous force becomes logarithmic"),
        shape_parameter("k", "N/m", 1e6, 1e3, 1e10, "stiffness of the series spring"),
        linear_parameter("m", "kg", 0.0, "mass that moves with the rod", term="inertia"),
    )

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import ForceTarget, Instant, Kernel  # loads numba
        from rig.dampers.sprung_flow import MASS, OFFSET, SPRING, at_current, law, moved, remembered  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            return float(p[OFFSET] + p[SPRING] * s0 + p[MASS] * a)

        @njit()
        def held(p: FloatArray, state: FloatArray, motion: Instant, current: float, target: ForceTarget) -> float:
            u, v, a = motion
            place = u - (target[0] - p[OFFSET] - p[MASS] * a) / p[SPRING]
            at = at_current(p, current, remembered(state))
            piston = law(p, at, place, v - target[1] / p[SPRING], state[1])
            return float(p[OFFSET] + piston[0] + p[MASS] * a)

        return Kernel(force, step=moved, held=held)

    def slopes_along(self) -> Compiled:
        """See `DamperModel.slopes_along`."""
        from rig.dampers.sprung_slopes import slopes_along  # loads numba

        return slopes_along()

    def search(self) -> Search:
        """See `DamperModel.search`."""
        return SprungSearch(self)


class SprungSearch(Search):
    """From the fit of `lost_motion`, with springs that give way by several shares of the smallest amplitude.

    That fit makes up for the spring by forces of its own, kv or kt below 0 among them, from where no way leads to what
    is behind the spring. So there is a second family of starts, whose viscous and logarithmic forces are small and at
    no current below 0.
    """

    simpler = "lost_motion"
    simpler_names: Mapping[str, str] = {name: name for name in TAKEN}
    family = len(OPENS) * len(GIVES_WAY)

    def starts(self, simple: Mapping[str, float], scale: MotionScale) -> list[dict[str, float]]:
        """See `Search.starts`."""
        start = {name: simple[name] for name in TAKEN} | {"vt": simple["vt"], "m": 0.0}
        start["kv"] = max(start["kv"], 0.0)
        amps, top_m_s = scale.mean_current_A, scale.top_speed_m_s
        little = {name: THINNING * abs(start[f"ky{name[2:]}"]) for name in ("kt", "kt_b")} | {"kt_c": 0.0, "kt_d": 0.0}
        ends = (scale.low_current_A, amps, scale.high_current_A)
        if min(np.polyval([start[name] for name in ("kt_d", "kt_c", "kt_b", "kt")], ends)) < 0.0:
            # kt counts as 0 where it is negative, and a search does not find out of that
            start |= little | {"vt": max(start["vt"], EYRING * top_m_s)}
        yielding_N = abs(start["ky"] + amps * start["ky_b"])
        thinning_N = abs(start["kt"] + amps * start["kt_b"]) * math.asinh(0.25 * top_m_s / start["vt"])
        stretched_N, small_N = max(yielding_N + thinning_N, 1.0), max(yielding_N, 1.0)
        small = start | little | {"kv": VISCOUS * small_N / top_m_s, "kv_b": 0.0}
        small["k"] = small_N / (GIVES_WAY[1] * scale.smallest_amplitude_m)
        first = [start | {"k": stretched_N / (share * scale.smallest_amplitude_m)} for share in GIVES_WAY]
        second = [small | {"vt": bend * top_m_s} for bend in BENDS]
        return [
            values | {"rho": opens * simple["rho"]}
            for family in (first, second)
            for opens in OPENS
            for values in family
        ]

    def unknowns(self, start: Mapping[str, float], held: frozenset[str]) -> Unknowns:
        """See `Search.unknowns`: the terms of one polynomial move by the same size."""
        names = tuple(name for name in self.model.names if name not in held)
        logarithmic = np.array([name in {"rho", "vt", "k"} for name in names])
        sizes = []
        for name in names:
            family = [abs(start[other]) for other in start if other.split("_")[0] == name.split("_")[0]]
            sizes.append(max(0.3 * max(family), 1.0))
        return Unknowns(names, logarithmic, np.array(sizes), self.model, held, lambda starts, named: starts | named)

    def at_limit(self, unknowns: Unknowns, theta: FloatArray) -> dict[str, float]:
        """See `Search.at_limit`: a spring that gives way by less than any rig sees is none, whatever its interval."""
        values = unknowns.values(theta)
        stiff = {"k": STIFFEST_N_m} if values["k"] > STIFFEST_N_m else {}
        return super().at_limit(unknowns, theta) | stiff
