"""A model of real dampers whose full force only comes back some tenths of a millimetre after each reversal.

Measured loops of MR dampers show a step there: the force turns round at once to a small viscous force that the current
hardly changes, stays on it while the piston makes up a lost motion (a floating ring or disc, a joint, trapped gas), and
then rises to the yield force. Above yield the force grows with the logarithm of the speed (the sinh law of flow, Eyring
1936) beside a plain viscous force.

The lost motion is a Bouc-Wen hysteresis w (Wen 1976) with sigma = 1/2 and n = 2, so elastic while it unloads, read as
h = w |w|^3: h leaves +-1 at once when the motion turns, is small in between and reaches the other end after about
2/rho. One state, independent of the rate, and two shape parameters, rho and vt; the force is linear in the rest.

Energy: the spring kx u and the offset f0 give back what they take. Where kv, kt and kg are not negative, their terms
have the sign of the speed and dissipate at every instant. (ky + ku u) h has the sign of w, not of the speed: while w
unloads it gives back what the loop's flank stored; over a whole loop it dissipates where ky + ku u is not negative.
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
from rig.dampers.separation import Joinable, JoinedMotions, Motion, MotionScale, OwnNames, Separation

if TYPE_CHECKING:
    from rig.dampers.kernel import Kernel

SIGMA, SHARPNESS = 0.5, 2.0  # of the loop: elastic unloading, n = 2
ENGAGED = 4.0  # power of |w| that h has
LENGTHS = np.geomspace(0.01, 0.6, 7)  # starts: 1/rho, as a share of the smallest amplitude
BENDS = (3e-3, 0.03, 0.3)  # starts: vt, as a share of the greatest speed
SLOWEST_BEND, FASTEST_BEND = 1e-4, 3.0


def _yield(name: str, unit: str, start: float, meaning: str, at_zero: str = "", power: int = 0) -> Parameter:
    return linear_parameter(name, unit, start, meaning, term="yield", at_zero=at_zero, power=power, softens=True)


def _viscous(name: str, unit: str, start: float, meaning: str, at_zero: str = "", power: int = 0) -> Parameter:
    return linear_parameter(name, unit, start, meaning, term="viscous", at_zero=at_zero, power=power, softens=True)


class LostMotionModel(HystereticModel):
    """Yield force that engages behind a lost motion, shear-thinning viscous force, viscous force inside the motion."""

    name: ClassVar[str] = "lost_motion"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = (
        "F = f0 + kx u + kv v + (ky + ku u) h + kt asinh(v/vt) + kg (1 - |h|) v, h = w |w|^3, "
        "w' = rho (v - |v| |w| w / 2 - v w^2 / 2); kv, ku affine, kg quadratic, ky, kt cubic in I "
        "(Wen 1976; Eyring 1936)"
    )
    energy: ClassVar[str] = (
        "kv, kg and kt are dissipative at every instant if not negative; the yield force is dissipative over a closed "
        "loop and returns energy while it unloads"
    )
    speeds_tell_yield: ClassVar[bool] = True
    demonstration: ClassVar[Mapping[str, float]] = {
        "kx": 300.0, "kv": 300.0, "kv_b": 40.0, "f0": -150.0, "ky": 40.0, "ky_b": 240.0, "ky_c": 30.0, "ky_d": -15.0,
        "ku": -200.0, "ku_b": 100.0, "kg": 1500.0, "kg_b": 700.0, "kg_c": -150.0, "kt": 15.0, "kt_b": 25.0,
        "kt_c": 6.0, "kt_d": -3.0, "rho": 800.0, "vt": 0.01,
    }  # fmt: skip
    parameters: tuple[Parameter, ...] = (
        linear_parameter("kx", "N/m", 0.0, "stiffness", term="stiffness"),
        _viscous("kv", "N s/m", 300.0, "viscous damping at zero current"),
        _viscous("kv_b", "N s/(m A)", 0.0, "viscous damping per ampere", "kv"),
        linear_parameter("f0", "N", 0.0, "force offset"),
        _yield("ky", "N", 50.0, "yield force at zero current, after the lost motion"),
        _yield("ky_b", "N/A", 200.0, "yield force per ampere, after the lost motion", "ky"),
        _yield("ky_c", "N/A^2", 0.0, "yield force per ampere squared, after the lost motion", "ky", 2),
        _yield("ky_d", "N/A^3", 0.0, "yield force per ampere cubed, after the lost motion", "ky", 3),
        _yield("ku", "N/m", 0.0, "change in the yield force along the stroke at zero current"),
        _yield("ku_b", "N/(m A)", 0.0, "change in the yield force along the stroke, per ampere", "ku"),
        _viscous("kg", "N s/m", 1000.0, "additional viscous damping within the lost motion at zero current"),
        _viscous("kg_b", "N s/(m A)", 0.0, "additional viscous damping within the lost motion, per ampere", "kg"),
        _viscous(
            "kg_c", "N s/(m A^2)", 0.0, "additional viscous damping within the lost motion, per ampere squared", "kg", 2
        ),
        _yield("kt", "N", 20.0, "amplitude of the logarithmic viscous force at zero current"),
        _yield("kt_b", "N/A", 50.0, "amplitude of the logarithmic viscous force per ampere", "kt"),
        _yield("kt_c", "N/A^2", 0.0, "amplitude of the logarithmic viscous force per ampere squared", "kt", 2),
        _yield("kt_d", "N/A^3", 0.0, "amplitude of the logarithmic viscous force per ampere cubed", "kt", 3),
        shape_parameter("rho", "1/m", 1000.0, 1e-2, 1e6, "twice the inverse of the lost motion"),
        shape_parameter("vt", "m/s", 0.005, 1e-6, 10.0, "speed above which the viscous force becomes logarithmic"),
    )

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel, bouc_wen_rate, sign  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            engaged = abs(s0) ** ENGAGED
            yielding = p[4] + current * (p[5] + current * (p[6] + current * p[7])) + (p[8] + p[9] * current) * u
            making_up = (p[10] + current * (p[11] + current * p[12])) * (1.0 - engaged)
            thinning = p[13] + current * (p[14] + current * (p[15] + current * p[16]))
            viscous = (p[1] + p[2] * current + making_up) * v + thinning * math.asinh(v / p[18])
            return float(p[0] * u + viscous + yielding * sign(s0) * engaged + p[3])

        @njit()
        def rates(p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
            return bouc_wen_rate(s0, v, p[17] * SIGMA, p[17] * (1.0 - SIGMA), p[17], SHARPNESS), 0.0

        @njit()
        def fastest_rate(p: FloatArray, v: float, current: float) -> float:
            return float(p[17] * SHARPNESS * abs(v))

        @njit()
        def loop(p: FloatArray) -> tuple[float, float, float, float]:
            return p[17], SIGMA, SHARPNESS, 1.0

        return Kernel(force, rates, fastest_rate, loop)

    def separation(self, scale: MotionScale) -> Separation:
        """See `DamperModel.separation`."""
        return LostMotionSeparation(scale)


class LostMotionSeparation(OwnNames, Joinable):
    """The model split for projection (see `Separation`): yield shapes h, u h, (1 - |h|) v and asinh(v/vt)."""

    pointwise = False
    fixed_names: tuple[str, ...] = ("kx", "kv", "kv_b", "f0")
    yield_names: tuple[str, ...] = (
        "ky", "ky_b", "ky_c", "ky_d", "ku", "ku_b", "kg", "kg_b", "kg_c", "kt", "kt_b", "kt_c", "kt_d",
    )  # fmt: skip
    powers: tuple[int, ...] = (4, 2, 3, 4)
    shape_names: tuple[str, ...] = ("rho", "vt")
    bends: tuple[tuple[int, ...], ...] = ((0, 1, 2), (3,))
    logarithmic: tuple[bool, ...] = (True, True)

    def __init__(self, scale: MotionScale) -> None:
        amplitude, top = scale.smallest_amplitude_m, scale.top_speed_m_s
        steepest = 4.0 / (LENGTHS[0] * amplitude)
        self.limits = np.array([(0.1 / amplitude, steepest), (SLOWEST_BEND * top, FASTEST_BEND * top)])
        self.starts: Sequence[FloatArray] = [
            np.array([1.0 / (length * amplitude), bend * top]) for length, bend in product(LENGTHS, BENDS)
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

        rho, bend = float(shape[0]), float(shape[1])
        u, v = source.u_m[rows], source.v_m_s[rows]
        thinning = np.arcsinh(v / bend)
        w, *by_shape = hysteresis_of(rho, SIGMA, SHARPNESS, source, slope=slope)[:, rows]
        columns = [*_engaged(w, u, v), thinning]
        if not slope:
            return columns
        opening = ENGAGED * np.abs(w) ** (ENGAGED - 1.0) * by_shape[0]
        by_bend = -v / (bend * np.hypot(bend, v))
        return [*columns, opening, opening * u, -np.sign(w) * opening * v, by_bend]


def _engaged(w: FloatArray, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """h, u h and (1 - |h|) v, (n,) each."""
    size = np.abs(w) ** ENGAGED
    h = np.copysign(size, w)
    return h, h * u, (1.0 - size) * v
