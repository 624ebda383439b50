"""Models with a plastic yield: bingham, and viscoelastic_plastic, which is elastic before it yields."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from rig.dampers.algebraic import ColumnModel, viscous, yield_force
from rig.dampers.arrays import FloatArray
from rig.dampers.model import HystereticModel, Jump
from rig.dampers.parameter import linear_parameter, shape_parameter
from rig.dampers.separation import MotionScale, Search, Unknowns

if TYPE_CHECKING:
    from rig.dampers.kernel import Kernel

SIGN_SLOPE_S_M = 1e12  # tanh of so steep an argument is the sign function of the Bingham model
YIELD_SHARES = (0.004, 0.02, 0.1)  # deflection of the series spring at yield over the smallest amplitude
SPRING_RATIOS = (0.03, 0.5)  # k1 over k2
RETARDATIONS_S = (0.002, 0.02)  # c1 over k1
YIELDING = 0.8  # share of the force at the top speed in a second start: at one motion Bingham's solution does not tell
RIGID = 5.0  # dashpots of a start at least, in k2 over the fastest rate: nearer to its limit no step is admissible
LEAST_YIELD = 0.2  # of the yield force at the mean current, at 0 A: at 0 a search could go one way only


class BinghamModel(ColumnModel):
    """Bingham plastic model, its fc and c0 affine in the current."""

    name: ClassVar[str] = "bingham"
    equation: ClassVar[str] = "F = fc sgn(v) + c0 v + f0 (Stanway 1987, as in Spencer 1997); fc, c0 affine in I"
    energy: ClassVar[str] = "dissipative at every instant if fc and c0 are not negative"
    jumps_at: ClassVar[Jump] = "reversal"
    fixed_names: ClassVar[tuple[str, ...]] = ("c0", "c0_b", "f0")
    yield_names: ClassVar[tuple[str, str]] = ("fc", "fc_b")
    shape_names: tuple[str, ...] = ()
    general: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "fc": ("Fya",), "fc_b": ("Fyb",), "c0": ("Ca_plus", "Ca_minus"), "c0_b": ("Cb_plus", "Cb_minus"), "f0": ("F0",),
    }  # fmt: skip
    steepness_s_m: ClassVar[float] = SIGN_SLOPE_S_M
    demonstration: ClassVar[Mapping[str, float]] = {
        "fc": 60.0, "fc_b": 238.0, "c0": 700.0, "c0_b": 110.0, "f0": -270.0,
    }  # fmt: skip
    parameters = (
        yield_force("fc", "N", 50.0, "Coulomb force at zero current"),
        yield_force("fc_b", "N/A", 200.0, "Coulomb force per ampere", "fc"),
        viscous("c0", "N s/m", 500.0, "viscous damping at zero current"),
        viscous("c0_b", "N s/(m A)", 50.0, "viscous damping per ampere", "c0"),
        linear_parameter("f0", "N", 0.0, "force offset", limit=5e3),
    )

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `ColumnModel.fixed_columns`."""
        del u, a
        return np.array((v, v * current, np.ones_like(v))).T

    def yield_shape(self, shape: Mapping[str, float], u: FloatArray, v: FloatArray) -> FloatArray:
        """See `ColumnModel.yield_shape`; the sign of the velocity, without shape parameters."""
        del shape, u
        sign: FloatArray = np.sign(v)
        return sign

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel, sign  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            return float((p[0] + p[1] * current) * sign(v) + (p[2] + p[3] * current) * v + p[4])

        return Kernel(force)


class ViscoelasticPlasticModel(HystereticModel):
    """Viscoelastic-plastic model of Gamota and Filisko 1991; fc and c0 affine in the current."""

    name: ClassVar[str] = "viscoelastic_plastic"
    states: ClassVar[int] = 2
    positions: ClassVar[int] = 2
    equation: ClassVar[str] = (
        "yielded (|F - f0| > fc): F = k1 (x2 - x1) + c1 (v2 - v1) + f0 = c0 v1 + fc sgn(v1) + f0 = k2 (x3 - x2) + f0; "
        "else v1 = 0; x3 = u (Gamota and Filisko 1991, as in Spencer 1997)"
    )
    energy: ClassVar[str] = (
        "the dashpots c0 and c1 and the friction fc dissipate energy; the springs k1 and k2 return energy"
    )
    demonstration: ClassVar[Mapping[str, float]] = {
        "k1": 1.5e5, "c1": 1500.0, "k2": 3e5, "c0": 700.0, "fc": 60.0, "fc_b": 238.0, "c0_b": 110.0, "f0": -270.0,
    }  # fmt: skip
    parameters = (
        shape_parameter("k1", "N/m", 1e4, 0.0, 1e8, "stiffness of the viscoelastic element"),
        shape_parameter("c1", "N s/m", 2e3, 1.0, 1e7, "damping of the viscoelastic element", softens=True),
        shape_parameter("k2", "N/m", 1e6, 1e2, 1e9, "series spring"),
        shape_parameter(
            "c0", "N s/m", 500.0, 1.0, 1e6, "viscous damping after yield at zero current", term="viscous",
            softens=True,
        ),
        shape_parameter("fc", "N", 50.0, 0.0, 1e5, "yield force at zero current", term="yield", softens=True),
        shape_parameter(
            "fc_b", "N/A", 200.0, 0.0, 1e5, "yield force per ampere", term="yield", at_zero="fc", softens=True
        ),
        shape_parameter(
            "c0_b", "N s/(m A)", 0.0, 0.0, 1e6, "viscous damping after yield per ampere", term="viscous",
            at_zero="c0", softens=True,
        ),
        linear_parameter("f0", "N", 0.0, "force offset"),
    )  # fmt: skip

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel, sign  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            return float(p[2] * (u - s1) + p[7])

        @njit()
        def rates(p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
            spring = p[2] * (u - s1)
            coulomb = p[4] + p[5] * current
            yields = abs(spring) > coulomb
            slip = (spring - coulomb * sign(spring)) / (p[3] + p[6] * current) if yields else 0.0
            return slip, slip + (spring - p[0] * (s1 - s0)) / p[1]

        @njit()
        def fastest_rate(p: FloatArray, v: float, current: float) -> float:
            return float(p[2] * (1.0 / p[1] + 1.0 / (p[3] + p[6] * current)) + p[0] / p[1])

        return Kernel(force, rates, fastest_rate)

    def search(self) -> Search:
        """See `DamperModel.search`."""
        return PlasticSearch(self)


class PlasticSearch(Search):
    """From the Bingham solution, with springs and a dashpot before yield, for several of each.

    And from one whose force at the top speed is yield force for the most part.
    """

    simpler = "bingham"
    simpler_names: Mapping[str, str] = {"fc_b": "fc_b", "c0_b": "c0_b"}
    family = 8

    def starts(self, simple: Mapping[str, float], scale: MotionScale) -> list[dict[str, float]]:
        """See `Search.starts`."""
        top_m_s, starts = scale.top_speed_m_s, []
        whole, whole_b = simple["fc"] + simple["c0"] * top_m_s, simple["fc_b"] + simple["c0_b"] * top_m_s
        own = simple["fc"], simple["fc_b"], simple["c0"], simple["c0_b"]
        viscous = (1.0 - YIELDING) / top_m_s
        parted = YIELDING * whole, YIELDING * whole_b, viscous * whole, viscous * whole_b
        for deflection, ratio, retardation_s in product(YIELD_SHARES, SPRING_RATIOS, RETARDATIONS_S):
            for fc, fc_b, c0, c0_b in (own, parted):
                yield_N = max(abs(fc + fc_b * scale.mean_current_A), 1.0)
                k2 = yield_N / (deflection * scale.smallest_amplitude_m)
                least = RIGID * k2 / scale.fastest_1_s
                starts.append({
                    "k1": ratio * k2, "c1": max(ratio * k2 * retardation_s, least), "k2": k2,
                    "c0": max(c0, least, 1.0), "fc": max(fc, LEAST_YIELD * yield_N), "fc_b": fc_b,
                    "c0_b": max(c0_b, 0.0), "f0": simple["f0"],
                })  # fmt: skip
        return starts

    def unknowns(self, start: Mapping[str, float], held: frozenset[str]) -> Unknowns:
        """See `Search.unknowns`."""
        names = tuple(name for name in self.model.names if name not in held)
        logarithmic = np.array([name in {"k1", "c1", "k2", "c0"} for name in names])
        beside = {"fc_b": "fc", "c0_b": "c0", "f0": "fc"}
        sizes = [max(abs(start[name]), 0.3 * abs(start[beside.get(name, name)]), 1e-6) for name in names]
        return Unknowns(names, logarithmic, np.array(sizes), self.model, held, lambda starts, named: starts | named)

    def admissible(self, values: Mapping[str, float], scale: MotionScale) -> bool:
        """See `Search.admissible`."""
        currents = (scale.low_current_A, scale.high_current_A)
        dashpot = min(values["c0"] + values["c0_b"] * amps for amps in currents)
        yielding = min(values["fc"] + values["fc_b"] * amps for amps in currents)
        if dashpot <= 0.0 or yielding < 0.0:
            return False
        rate = values["k2"] * (1.0 / values["c1"] + 1.0 / dashpot) + values["k1"] / values["c1"]
        return rate < scale.fastest_1_s

    def at_limit(self, unknowns: Unknowns, theta: FloatArray) -> dict[str, float]:
        """See `Search.at_limit`: none of them has one in the search."""
        del unknowns, theta
        return {}
