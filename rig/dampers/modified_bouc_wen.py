"""The modified Bouc-Wen model (Spencer 1997): a Bouc-Wen element behind a dashpot, integrated by steps of its own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.bouc_wen import EXPONENT, LOWEST_EXPONENT, SIGMA_LIMITS
from rig.dampers.model import HystereticModel
from rig.dampers.parameter import LAG, linear_parameter, shape_parameter
from rig.dampers.separation import MotionScale, Search, Unknowns

if TYPE_CHECKING:
    from rig.dampers.kernel import Compiled, Kernel
    from rig.dampers.sampled_motion import Motion

STIFF_DASHPOTS = (5.0, 15.0, 40.0, 120.0)  # c1 over c0
STIFFNESS_SHARE = 0.5  # k0 over k0 + k1
BENDS = ((0.5, 1.0), (0.6, 0.3))  # sigma and n - 1 beside those of the Bouc-Wen solution
SMALLEST_BEND = 0.01  # of n - 1 at a start
QUICKER = 4.0  # states than others' may be: its own steps are short only where the loop bends
LIMITING_BEND = 2e-3  # of n - 1, below which it is at its limit


class ModifiedBoucWenModel(HystereticModel):
    """Modified Bouc-Wen model (Spencer 1997, equations 8-12); alpha, c0, c1 affine in the filtered input."""

    name: ClassVar[str] = "modified_bouc_wen"
    states: ClassVar[int] = 2
    positions: ClassVar[int] = 1
    equation: ClassVar[str] = (
        "F = c1 y' + k1 (u - x0), y' = [alpha z + c0 u' + k0 (u - y)]/(c0 + c1), "
        "z' = -gamma |u' - y'| z |z|^(n-1) - beta (u' - y') |z|^n + A (u' - y') (Spencer 1997)"
    )
    energy: ClassVar[str] = (
        "the dashpots c0 and c1 dissipate energy; the hysteresis is as in bouc_wen; the springs k0 and k1 return energy"
    )
    redundant: ClassVar[Mapping[str, tuple[str, ...]]] = {"A": ("alpha_a", "alpha_b", "gamma", "beta")}
    speeds_tell_yield: ClassVar[bool] = True
    demonstration: ClassVar[Mapping[str, float]] = {
        "alpha_a": 14000.0, "alpha_b": 50000.0, "c0a": 800.0, "c0b": 110.0, "c1a": 14000.0, "c1b": 2000.0, "k0": 1000.0,
        "k1": 500.0, "x0": 0.15, "gamma": 3.63e6, "beta": 3.63e6, "A": 100.0, "n": 2.0, "eta": 25.0,
    }  # fmt: skip
    parameters = (
        linear_parameter(
            "alpha_a", "N/m", 1e4, "hysteretic force per hysteretic displacement at zero current", softens=True
        ),
        linear_parameter(
            "alpha_b", "N/(m A)", 5e4, "hysteretic force per hysteretic displacement and ampere",
            at_zero="alpha_a", softens=True,
        ),
        linear_parameter("c0a", "N s/m", 1e3, "viscous damping at high speeds and zero current", softens=True),
        linear_parameter(
            "c0b", "N s/(m A)", 1e2, "viscous damping at high speeds per ampere", at_zero="c0a", softens=True
        ),
        linear_parameter("c1a", "N s/m", 2e4, "damping of the roll-off at low speeds and zero current", softens=True),
        linear_parameter(
            "c1b", "N s/(m A)", 1e2, "damping of the roll-off at low speeds, per ampere", at_zero="c1a", softens=True
        ),
        linear_parameter("k0", "N/m", 0.0, "stiffness at high speeds"),
        linear_parameter("k1", "N/m", 0.0, "accumulator stiffness"),
        shape_parameter("x0", "m", 0.0, -1.0, 1.0, "extension at which the force of the accumulator spring is zero"),
        shape_parameter("gamma", "m^-n", 1e6, 0.0, 1e9, "shape of the loop (factor of the term with |u' - y'|)"),
        shape_parameter("beta", "m^-n", 1e6, -1e9, 1e9, "shape of the loop"),
        shape_parameter("A", "1", 100.0, 1e-6, 1e6, "initial slope of z; redundant with alpha, beta and gamma"),
        EXPONENT,
        LAG,
    )

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel, bouc_wen_rate  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            alpha, c0, c1 = p[0] + p[1] * current, p[2] + p[3] * current, p[4] + p[5] * current
            y_rate = (alpha * s1 + c0 * v + p[6] * (u - s0)) / (c0 + c1)
            return float(c1 * y_rate + p[7] * (u - p[8]))

        @njit()
        def rates(p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
            alpha, c0, c1 = p[0] + p[1] * current, p[2] + p[3] * current, p[4] + p[5] * current
            y_rate = (alpha * s1 + c0 * v + p[6] * (u - s0)) / (c0 + c1)
            return y_rate, bouc_wen_rate(s1, v - y_rate, p[9], p[10], p[11], p[12])

        @njit()
        def fastest_rate(p: FloatArray, v: float, current: float) -> float:
            alpha, c0, c1 = p[0] + p[1] * current, p[2] + p[3] * current, p[4] + p[5] * current
            relax = (abs(alpha * p[11]) + abs(p[6])) / (c0 + c1)
            total = p[9] + p[10]
            if total <= 0.0 or p[11] <= 0.0:
                return float(relax)
            return float(relax + p[11] * p[12] * abs(v) / (p[11] / total) ** (1.0 / p[12]))

        return Kernel(force, rates, fastest_rate, step=_own_step(rates))

    def search(self) -> Search:
        """See `DamperModel.search`."""
        return ModifiedSearch(self)


def _own_step(rates: Compiled) -> Compiled:
    """An integrator for this model, in steps as long as the loop's bend allows: see `Kernel.step`.

    With z saturated, only y moves, and z closes up as exp(-n rho s) with the distance s; a step then ends at the next
    reversal of u' - y' at the latest. Elsewhere classical Runge-Kutta, by the fastest rate of the state as it is.
    """
    from rig.dampers.compiled_cache import njit  # loads numba
    from rig.dampers.kernel import MAXIMUM_SUBSTEPS, SATURATED, SUBSTEP_RATE, runge_kutta  # loads numba

    bend = runge_kutta(rates)

    @njit()
    def until_reversal(
        p: FloatArray, state: FloatArray, motion: Motion, current: float, t: float, h: float, slip: float
    ) -> float:
        """Time (s) until u' - y' reverses with z held, `h` if it does not; by one chord."""
        u0, v0, c1, c2, c3 = motion
        end = t + h
        u = u0 + end * (v0 + end * (c1 / 2.0 + end * (c2 / 3.0 + end * c3 / 4.0)))
        v = v0 + end * (c1 + end * (c2 + end * c3))
        c0, c_sum = p[2] + p[3] * current, p[2] + p[3] * current + p[4] + p[5] * current
        later = v - ((p[0] + p[1] * current) * state[1] + c0 * v + p[6] * (u - state[0])) / c_sum
        return float(h if later * slip > 0.0 else h * slip / (slip - later))

    @njit()
    def step(p: FloatArray, state: FloatArray, motion: Motion, current: float, dt: float) -> bool:
        if not (p[9] + p[10] > 0.0 and p[11] > 0.0 and p[12] >= 1.0):
            return False
        u0, v0, c1, c2, c3 = motion
        alpha, c_sum = p[0] + p[1] * current, p[2] + p[3] * current + p[4] + p[5] * current
        c0, n, z0 = p[2] + p[3] * current, p[12], (p[11] / (p[9] + p[10])) ** (1.0 / p[12])
        steepness = p[11] / z0 * n * max(1.0, abs(p[9] - p[10]) / (p[9] + p[10]))
        relaxing = (abs(alpha * p[11]) + abs(p[6])) / c_sum
        shortest = dt / MAXIMUM_SUBSTEPS
        t = 0.0
        while t < dt:
            y, z, left = state[0], state[1], dt - t
            u = u0 + t * (v0 + t * (c1 / 2.0 + t * (c2 / 3.0 + t * c3 / 4.0)))
            v = v0 + t * (c1 + t * (c2 + t * c3))
            slip = v - (alpha * z + c0 * v + p[6] * (u - y)) / c_sum
            direction = 1.0 if slip >= 0.0 else -1.0
            if direction * z / z0 > SATURATED:
                smooth = min(left, SUBSTEP_RATE * c_sum / max(abs(p[6]), 1e-30))
                h = min(left, max(until_reversal(p, state, motion, current, t, smooth, slip), shortest))
                middle = t + 0.5 * h
                u_b = u0 + middle * (v0 + middle * (c1 / 2.0 + middle * (c2 / 3.0 + middle * c3 / 4.0)))
                v_b = v0 + middle * (c1 + middle * (c2 + middle * c3))
                y_b = y + 0.5 * h * (v - slip)
                rate = (alpha * z + c0 * v_b + p[6] * (u_b - y_b)) / c_sum
                state[0] = y + h * rate
                close = math.exp(-n * p[11] / z0 * abs(v_b - rate) * h)
                state[1] = direction * z0 * (1.0 - (1.0 - direction * z / z0) * close)
                t += h
                continue
            end = t + left
            fastest = max(abs(slip), abs(v0 + end * (c1 + end * (c2 + end * c3)) - v + slip))
            h = min(left, max(SUBSTEP_RATE / (relaxing + steepness * fastest), shortest))
            bend(p, state, motion, current, t, h)
            t += h
        return True

    return step


class ModifiedSearch(Search):
    """From the normalised Bouc-Wen solution with a stiff dashpot in series, for several stiffnesses of it.

    Searched are the yield force kw at the loop's limit and rho, sigma, n - 1 instead of alpha, gamma, beta, n; A stays
    as it is; f1 = k1 x0.
    """

    simpler = "normalized_bouc_wen"
    simpler_names: Mapping[str, str] = {"alpha_b": "kw_b", "c0b": "kv_b"}
    family = 4

    def starts(self, simple: Mapping[str, float], scale: MotionScale) -> list[dict[str, float]]:
        """See `Search.starts`."""
        del scale
        viscous = max(abs(simple["kv"]), 1e-3 * abs(simple["kw"]), 1.0)
        own = (min(max(simple["sigma"], 0.4), 19.0), max(simple["n"] - LOWEST_EXPONENT, SMALLEST_BEND))
        return [
            {
                "kw": simple["kw"], "kw_b": simple["kw_b"], "c0a": simple["kv"], "c0b": simple["kv_b"],
                "c1a": ratio * viscous, "c1b": ratio * max(simple["kv_b"], 0.0), "k0": STIFFNESS_SHARE * simple["kx"],
                "k1": (1.0 - STIFFNESS_SHARE) * simple["kx"], "f1": -simple["f0"], "rho": simple["rho"],
                "sigma": sigma, "n - 1": bend,
            }
            for (sigma, bend), ratio in product((own, *BENDS), STIFF_DASHPOTS)
        ]  # fmt: skip

    def named(self, values: Mapping[str, float]) -> dict[str, float]:
        """See `Search.named`."""
        total, n = values["gamma"] + values["beta"], values["n"]
        z0 = (values["A"] / total) ** (1.0 / n)
        kept = {name: values[name] for name in ("c0a", "c0b", "c1a", "c1b", "k0", "k1")}
        loop = {"rho": values["A"] / z0, "sigma": values["gamma"] / total, "n - 1": max(n - LOWEST_EXPONENT, 1e-3)}
        force = {"kw": values["alpha_a"] * z0, "kw_b": values["alpha_b"] * z0, "f1": values["k1"] * values["x0"]}
        return force | kept | loop

    def unknowns(self, start: Mapping[str, float], held: frozenset[str]) -> Unknowns:
        """See `Search.unknowns`."""
        left_out = {{"alpha_b": "kw_b"}.get(name, name) for name in held}
        names = tuple(name for name in start if name not in left_out)
        logarithmic = np.array([name in {"rho", "sigma", "n - 1", "c1a"} for name in names])
        beside = {"kw_b": "kw", "c0b": "c0a", "c1b": "c1a", "k0": "k1", "f1": "kw"}
        sizes = [max(abs(start[name]), 0.3 * abs(start[beside.get(name, name)]), 1e-6) for name in names]
        return Unknowns(names, logarithmic, np.array(sizes), self.model, held, _from_normalised)

    def admissible(self, values: Mapping[str, float], scale: MotionScale) -> bool:
        """See `Search.admissible`: dashpots positive at every current, no rate beyond reason."""
        currents = (scale.low_current_A, scale.high_current_A)
        dashpots = [values["c1a"] + values["c1b"] * amps for amps in currents]
        dashpots += [values["c0a"] + values["c0b"] * amps + c1 for amps, c1 in zip(currents, dashpots, strict=True)]
        if min(dashpots) <= 0.0:
            return False
        strongest = max(abs(values["alpha_a"]), abs(values["alpha_a"] + values["alpha_b"] * scale.high_current_A))
        rate = (strongest * values["A"] + abs(values["k0"])) / min(dashpots)
        sigma = values["gamma"] / (values["gamma"] + values["beta"])
        return rate < QUICKER * scale.fastest_1_s and SIGMA_LIMITS[0] <= sigma <= SIGMA_LIMITS[1]

    def at_limit(self, unknowns: Unknowns, theta: FloatArray) -> dict[str, float]:
        """See `Search.at_limit`: the exponent, where it has gone to its limit."""
        if "n - 1" not in unknowns.names:
            return {}
        bend = math.exp(float(theta[unknowns.names.index("n - 1")]))
        return {"n": LOWEST_EXPONENT} if bend <= LIMITING_BEND else {}


def _from_normalised(starts: dict[str, float], named: dict[str, float]) -> dict[str, float]:
    """The model's own values from rho, sigma, n - 1 and the yield force; A and eta stay at their starts."""
    values = starts | named
    a, n = values["A"], LOWEST_EXPONENT + named["n - 1"]
    z0 = a / named["rho"]
    total = a * z0**-n
    return values | {
        "n": n,
        "gamma": named["sigma"] * total,
        "beta": (1.0 - named["sigma"]) * total,
        "alpha_a": named["kw"] / z0,
        "alpha_b": named.get("kw_b", 0.0) / z0,
        "x0": named["f1"] / named["k1"] if named["k1"] != 0.0 else 0.0,
    }
