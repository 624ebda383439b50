"""Bouc-Wen models whose loop depends on the path alone: bouc_wen, normalized_bouc_wen, thinning_bouc_wen.

All are fitted in the normalised form (Ikhouane and Rodellar 2005):
w' = rho [v - sigma |v| |w|^(n-1) w + (sigma - 1) v |w|^n] has three shape parameters, rho, sigma, n, and
F = kx u + kv v + kw w + f0 is linear in the others. For `bouc_wen`: z = z0 w, z0 = (A/(beta + gamma))^(1/n),
rho = A/z0, sigma = gamma/(beta + gamma), alpha = kw/z0, with A = 1, because A only scales alpha, beta and gamma.
`thinning_bouc_wen` has one shape parameter more, vt, the bend of its viscous force.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.model import HystereticModel
from rig.dampers.parameter import Parameter, linear_parameter, shape_parameter
from rig.dampers.separation import Joinable, JoinedMotions, Motion, MotionScale, Separation

if TYPE_CHECKING:
    from rig.dampers.kernel import Kernel

YIELD_LENGTHS = np.geomspace(0.004, 0.5, 6)  # starts: 1/rho, as a share of the smallest amplitude
SIGMAS = (0.3, 0.8, 2.5)
EXPONENTS = (1.2, 2.0, 4.0)
BENDS = (0.1, 0.4)  # vt, as a share of the greatest speed
SLOWEST_BEND, FASTEST_BEND = 1e-3, 3.0
SIGMA_LIMITS = (0.02, 50.0)  # below 0.5 the loop's flanks feed energy back; published sets lie there too
LOWEST_EXPONENT = 1.0

EXPONENT = shape_parameter("n", "1", 2.0, 1.0, 10.0, "sharpness of the transition to yield")


class BoucWenModel(HystereticModel):
    """Bouc-Wen model (Spencer 1997, equations 2-3); alpha and c0 affine in the current."""

    name: ClassVar[str] = "bouc_wen"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = (
        "F = c0 v + k0 (u - x0) + alpha z, z' = -gamma |v| z |z|^(n-1) - beta v |z|^n + A v (Spencer 1997)"
    )
    energy: ClassVar[str] = (
        "dissipative over a closed loop for gamma + beta > 0 and gamma >= beta; the remaining energy is elastic and is "
        "recovered"
    )
    redundant: ClassVar[Mapping[str, tuple[str, ...]]] = {"A": ("alpha", "alpha_b", "gamma", "beta")}
    demonstration: ClassVar[Mapping[str, float]] = {
        "c0": 700.0, "c0_b": 110.0, "k0": 300.0, "x0": 0.5, "alpha": 1.2e5, "alpha_b": 4e5, "gamma": 1.5e6, "beta": 1e6,
        "A": 1.0, "n": 2.0,
    }  # fmt: skip
    parameters: tuple[Parameter, ...] = (
        linear_parameter(
            "c0", "N s/m", 500.0, "viscous damping at zero current", term="viscous", softens=True
        ),
        linear_parameter(
            "c0_b", "N s/(m A)", 0.0, "viscous damping per ampere", term="viscous", at_zero="c0", softens=True
        ),
        linear_parameter("k0", "N/m", 0.0, "stiffness"),
        shape_parameter("x0", "m", 0.0, -1.0, 1.0, "extension at which the spring force is zero"),
        linear_parameter(
            "alpha", "N/m", 1e5, "hysteretic force per hysteretic displacement at zero current", term="yield",
            softens=True,
        ),
        linear_parameter(
            "alpha_b", "N/(m A)", 0.0, "hysteretic force per hysteretic displacement and ampere",
            term="yield", at_zero="alpha", softens=True,
        ),
        shape_parameter("gamma", "m^-n", 1e6, 0.0, 1e9, "shape of the loop (factor of the term with |v|)"),
        shape_parameter("beta", "m^-n", 1e6, -1e9, 1e9, "shape of the loop"),
        shape_parameter("A", "1", 1.0, 1e-6, 1e6, "initial slope of z; redundant with alpha"),
        EXPONENT,
    )  # fmt: skip

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel, bouc_wen_rate  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            return float((p[0] + p[1] * current) * v + p[2] * (u - p[3]) + (p[4] + p[5] * current) * s0)

        @njit()
        def rates(p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
            return bouc_wen_rate(s0, v, p[6], p[7], p[8], p[9]), 0.0

        @njit()
        def fastest_rate(p: FloatArray, v: float, current: float) -> float:
            total = p[6] + p[7]
            if total <= 0.0 or p[8] <= 0.0:
                return float(abs(p[8]))
            return float(p[8] * p[9] * abs(v) / (p[8] / total) ** (1.0 / p[9]))

        @njit()
        def loop(p: FloatArray) -> tuple[float, float, float, float]:
            if p[6] + p[7] > 0.0 and p[8] > 0.0:
                scale = (p[8] / (p[6] + p[7])) ** (1.0 / p[9])
                return p[8] / scale, p[6] / (p[6] + p[7]), p[9], scale
            return 0.0, 0.0, 0.0, 1.0

        return Kernel(force, rates, fastest_rate, loop)

    def separation(self, scale: MotionScale) -> Separation:
        """See `DamperModel.separation`."""
        return BoucWenSeparation(scale)


class NormalizedBoucWenModel(HystereticModel):
    """Normalised Bouc-Wen model (Ikhouane and Rodellar 2005; Zhu et al.); kv and kw affine in the current."""

    name: ClassVar[str] = "normalized_bouc_wen"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = (
        "F = kx u + kv v + kw w + f0, w' = rho [v - sigma |v| |w|^(n-1) w + (sigma - 1) v |w|^n] (Ikhouane-Rodellar)"
    )
    energy: ClassVar[str] = (
        "dissipative over a closed loop for sigma >= 1/2; the remaining energy is elastic and is recovered"
    )
    speeds_tell_yield: ClassVar[bool] = True
    demonstration: ClassVar[Mapping[str, float]] = {
        "kx": 300.0, "kv": 700.0, "kv_b": 110.0, "kw": 80.0, "kw_b": 250.0, "f0": -150.0, "rho": 1500.0, "sigma": 0.6,
        "n": 2.0,
    }  # fmt: skip
    parameters: tuple[Parameter, ...] = (
        linear_parameter("kx", "N/m", 0.0, "stiffness"),
        linear_parameter("kv", "N s/m", 500.0, "viscous damping at zero current", term="viscous", softens=True),
        linear_parameter(
            "kv_b", "N s/(m A)", 0.0, "viscous damping per ampere", term="viscous", at_zero="kv", softens=True
        ),
        linear_parameter("kw", "N", 50.0, "yield force at zero current", term="yield", softens=True),
        linear_parameter("kw_b", "N/A", 200.0, "yield force per ampere", term="yield", at_zero="kw", softens=True),
        linear_parameter("f0", "N", 0.0, "force offset"),
        shape_parameter("rho", "1/m", 500.0, 1e-2, 1e6, "inverse of the yield displacement"),
        shape_parameter("sigma", "1", 0.6, 0.5, 100.0, "shape of the loop"),
        EXPONENT,
    )

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel, bouc_wen_rate  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            return float(p[0] * u + (p[1] + p[2] * current) * v + (p[3] + p[4] * current) * s0 + p[5])

        @njit()
        def rates(p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
            rho, sigma = p[6], p[7]
            return bouc_wen_rate(s0, v, rho * sigma, rho * (1.0 - sigma), rho, p[8]), 0.0

        @njit()
        def fastest_rate(p: FloatArray, v: float, current: float) -> float:
            return float(p[6] * p[8] * abs(v) * max(1.0, abs(2.0 * p[7] - 1.0)))

        @njit()
        def loop(p: FloatArray) -> tuple[float, float, float, float]:
            return p[6], p[7], p[8], 1.0

        return Kernel(force, rates, fastest_rate, loop)

    def separation(self, scale: MotionScale) -> Separation:
        """See `DamperModel.separation`."""
        return NormalizedSeparation(scale)


class ThinningBoucWenModel(NormalizedBoucWenModel):
    """Normalised Bouc-Wen model beside a shear-thinning viscous force, for real dampers.

    Above yield the force of a real MR damper grows ever more slowly with speed (Herschel-Bulkley), and yield force and
    viscous force saturate with the coil's field: kt tanh(v/vt) is the first, the cubic in the current the second.
    """

    name: ClassVar[str] = "thinning_bouc_wen"
    equation: ClassVar[str] = (
        "F = kx u + kv v + kt tanh(v/vt) + kw w + f0, w as in normalized_bouc_wen; kv affine, kt and kw cubic in I"
    )
    energy: ClassVar[str] = (
        "see normalized_bouc_wen; kt tanh(v/vt) is dissipative at every instant if kt is not negative"
    )
    demonstration: ClassVar[Mapping[str, float]] = {
        "kx": 300.0, "kv": 400.0, "kv_b": 40.0, "kw": 30.0, "kw_b": 250.0, "f0": -270.0, "rho": 900.0, "sigma": 0.8,
        "n": 1.6, "kw_c": 20.0, "kw_d": -12.0, "kt": 60.0, "kt_b": 60.0, "kt_c": 10.0, "kt_d": -5.0, "vt": 0.08,
    }  # fmt: skip
    parameters: tuple[Parameter, ...] = (
        *NormalizedBoucWenModel.parameters,
        linear_parameter("kw_c", "N/A^2", 0.0, "yield force per ampere squared", at_zero="kw", power=2),
        linear_parameter("kw_d", "N/A^3", 0.0, "yield force per ampere cubed", at_zero="kw", power=3),
        linear_parameter("kt", "N", 20.0, "saturating viscous force at zero current"),
        linear_parameter("kt_b", "N/A", 50.0, "saturating viscous force per ampere", at_zero="kt"),
        linear_parameter("kt_c", "N/A^2", 0.0, "saturating viscous force per ampere squared", at_zero="kt", power=2),
        linear_parameter("kt_d", "N/A^3", 0.0, "saturating viscous force per ampere cubed", at_zero="kt", power=3),
        shape_parameter("vt", "m/s", 0.02, 1e-4, 10.0, "speed at which the viscous force saturates"),
    )

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            yielding = p[3] + current * (p[4] + current * (p[9] + current * p[10]))
            thinning = p[11] + current * (p[12] + current * (p[13] + current * p[14]))
            viscous = (p[1] + p[2] * current) * v + thinning * math.tanh(v / p[15])
            return float(p[0] * u + viscous + yielding * s0 + p[5])

        loop = super().kernel()
        return Kernel(force, loop.rates, loop.fastest_rate, loop.loop)

    def separation(self, scale: MotionScale) -> Separation:
        """See `DamperModel.separation`."""
        return ThinningSeparation(scale)


class NormalizedSeparation(Joinable):
    """The normalised Bouc-Wen model split for projection (see `Separation`); n is searched as n - 1."""

    pointwise = False
    fixed_names: tuple[str, ...] = ("kx", "kv", "kv_b", "f0")
    yield_names: tuple[str, ...] = ("kw", "kw_b")
    powers: tuple[int, ...] = (2,)
    shape_names: tuple[str, ...] = ("rho", "sigma", "n - 1")
    bends: tuple[tuple[int, ...], ...] = ((0,), (0,), (0,))
    logarithmic: tuple[bool, ...] = (True, True, True)

    def __init__(self, scale: MotionScale) -> None:
        amplitude = scale.smallest_amplitude_m
        steepest = 2.0 / (YIELD_LENGTHS[0] * amplitude)
        self.limits = np.array([(1e-3 / amplitude, steepest), SIGMA_LIMITS, (1e-3, 15.0)])
        self.starts: Sequence[FloatArray] = [
            np.array([1.0 / (share * amplitude), sigma, n - LOWEST_EXPONENT])
            for share, sigma, n in product(YIELD_LENGTHS, SIGMAS, EXPONENTS)
        ]

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `Separation.fixed_columns`."""
        del a
        return np.column_stack((u, v, v * current, np.ones_like(u)))

    def yielding(
        self, source: Motion | JoinedMotions, rows: slice, shape: FloatArray, *, slope: bool
    ) -> list[FloatArray]:
        """See `Separation.yielding`."""
        from rig.dampers.loop_curve import hysteresis_of  # loads numba

        rho, sigma, n = float(shape[0]), float(shape[1]), LOWEST_EXPONENT + float(shape[2])
        return list(hysteresis_of(rho, sigma, n, source, slope=slope)[:, rows])

    def held_here(self, held: frozenset[str]) -> frozenset[str]:
        """See `Separation.held_here`."""
        return held

    def values(self, linear: FloatArray, shape: FloatArray) -> dict[str, float]:
        """See `Separation.values`."""
        names = (*self.fixed_names, *self.yield_names)
        values = {name: float(value) for name, value in zip(names, linear, strict=True)}
        return values | {"rho": float(shape[0]), "sigma": float(shape[1]), "n": LOWEST_EXPONENT + float(shape[2])}

    def shape_of(self, values: Mapping[str, float]) -> FloatArray:
        """See `Separation.shape_of`."""
        return self._inside(np.array([values["rho"], values["sigma"], values["n"] - LOWEST_EXPONENT]))

    def at_limit(self, met: Mapping[str, float]) -> dict[str, float]:
        """See `Separation.at_limit`."""
        named = dict(met)
        if "n - 1" in named:
            named["n"] = LOWEST_EXPONENT + named.pop("n - 1")
        return named

    def _inside(self, shape: FloatArray) -> FloatArray:
        return np.clip(shape, self.limits[:, 0], self.limits[:, 1])


class BoucWenSeparation(NormalizedSeparation):
    """The Bouc-Wen model by its normalised form."""

    def held_here(self, held: frozenset[str]) -> frozenset[str]:
        """See `Separation.held_here`."""
        return frozenset({"c0_b": "kv_b", "alpha_b": "kw_b"}.get(name, name) for name in held)

    def values(self, linear: FloatArray, shape: FloatArray) -> dict[str, float]:
        """See `Separation.values`: with A = 1."""
        normalised = super().values(linear, shape)
        z0, n, sigma = 1.0 / normalised["rho"], normalised["n"], normalised["sigma"]
        total = z0**-n
        stiffness = normalised["kx"]
        return {
            "c0": normalised["kv"],
            "c0_b": normalised["kv_b"],
            "k0": stiffness,
            "x0": -normalised["f0"] / stiffness if stiffness != 0.0 else 0.0,
            "alpha": normalised["kw"] / z0,
            "alpha_b": normalised["kw_b"] / z0,
            "gamma": sigma * total,
            "beta": (1.0 - sigma) * total,
            "A": 1.0,
            "n": n,
        }

    def shape_of(self, values: Mapping[str, float]) -> FloatArray:
        """See `Separation.shape_of`."""
        total = values["gamma"] + values["beta"]
        rho = values["A"] * (total / values["A"]) ** (1.0 / values["n"])
        return self._inside(np.array([rho, values["gamma"] / total, values["n"] - LOWEST_EXPONENT]))


class ThinningSeparation(NormalizedSeparation):
    """The thinning Bouc-Wen model split for projection; its second yield shape is tanh(v/vt)."""

    yield_names: tuple[str, ...] = ("kw", "kw_b", "kw_c", "kw_d", "kt", "kt_b", "kt_c", "kt_d")
    powers: tuple[int, ...] = (4, 4)
    shape_names: tuple[str, ...] = (*NormalizedSeparation.shape_names, "vt")
    bends: tuple[tuple[int, ...], ...] = ((0,), (0,), (0,), (1,))
    logarithmic: tuple[bool, ...] = (True, True, True, True)

    def __init__(self, scale: MotionScale) -> None:
        super().__init__(scale)
        top = scale.top_speed_m_s
        self.limits = np.vstack((self.limits, (SLOWEST_BEND * top, FASTEST_BEND * top)))
        self.starts = [np.append(shape, share * top) for shape, share in product(self.starts, BENDS)]

    def yielding(
        self, source: Motion | JoinedMotions, rows: slice, shape: FloatArray, *, slope: bool
    ) -> list[FloatArray]:
        """See `Separation.yielding`."""
        hysteretic = super().yielding(source, rows, shape[:3], slope=slope)
        argument = source.v_m_s[rows] / shape[3]
        thinning = np.tanh(argument)
        if not slope:
            return [hysteretic[0], thinning]
        return [hysteretic[0], thinning, *hysteretic[1:], -(1.0 - thinning**2) * argument / shape[3]]

    def values(self, linear: FloatArray, shape: FloatArray) -> dict[str, float]:
        """See `Separation.values`."""
        return {**super().values(linear, shape[:3]), "vt": float(shape[3])}

    def shape_of(self, values: Mapping[str, float]) -> FloatArray:
        """See `Separation.shape_of`."""
        loop = (values["rho"], values["sigma"], values["n"] - LOWEST_EXPONENT)
        return self._inside(np.array([*loop, values["vt"]]))
