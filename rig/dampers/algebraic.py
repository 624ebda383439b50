"""Models without internal states: asymmetric, symmetric, kwok, bingham.

Given the shape parameters of the yield term, each force is linear in the rest. Its regressors are the one definition:
the identifier solves for their coefficients, `force` sums them.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from rig.dampers.arrays import FloatArray
from rig.dampers.kinds import (
    KIND_ASYMMETRIC,
    KIND_ASYMMETRIC_PRINTED,
    KIND_BINGHAM,
    KIND_KWOK,
    KIND_SYMMETRIC,
    KIND_SYMMETRIC_PRINTED,
)
from rig.dampers.model import DamperModel
from rig.dampers.parameter import Parameter

Hysteresis = Literal["kwok", "printed"]

MASS = Parameter("m", "m", "kg", 1.0, 0.0, 100.0, True, "inertia of the moving rod")
PRELOAD = Parameter("F0", "F0", "N", 0.0, -5e3, 5e3, True, "gas preload")
SLOPE = Parameter("beta", "beta", "s/m", 40.0, 0.1, 1e4, False, "steepness of the yield branch")
OFFSET = Parameter(
    "delta", "delta", "1", 0.5, -20.0, 20.0, False, "half width of the yield loop, as an argument of tanh"
)
OFFSET_SPEED = Parameter("lambda", "lambda", "m/s", 0.01, -2.0, 2.0, False, "half width of the yield loop, as a speed")
YIELD_A = Parameter("Fya", "Fya", "N", 50.0, -1e4, 1e4, True, "yield force at zero current")
YIELD_B = Parameter("Fyb", "Fyb", "N/A", 200.0, -1e4, 1e4, True, "yield force per ampere")
STIFFNESS_A = Parameter("Ka", "Kka", "N/m", 0.0, -1e6, 1e6, True, "stiffness at zero current")
STIFFNESS_B = Parameter("Kb", "Kkb", "N/(m A)", 0.0, -1e6, 1e6, True, "stiffness per ampere")
LAG = Parameter("eta", "eta", "1/s", 25.0, 0.1, 1e4, False, "rate of the coil current's first-order lag")


def _viscous(name: str, symbol: str, unit: str, start: float, meaning: str) -> Parameter:
    return Parameter(name, symbol, unit, start, -1e6, 1e6, True, meaning)


VISCOUS_ASYMMETRIC = (
    _viscous("Ca_plus", "Cca+", "N s/m", 500.0, "viscous damping in rebound at zero current"),
    _viscous("Ca_minus", "Cca-", "N s/m", 500.0, "viscous damping in jounce at zero current"),
    _viscous("Cb_plus", "Ccb+", "N s/(m A)", 50.0, "viscous damping in rebound per ampere"),
    _viscous("Cb_minus", "Ccb-", "N s/(m A)", 50.0, "viscous damping in jounce per ampere"),
)
VISCOUS_SYMMETRIC = (
    _viscous("Ca", "Cca", "N s/m", 500.0, "viscous damping at zero current"),
    _viscous("Cb", "Ccb", "N s/(m A)", 50.0, "viscous damping per ampere"),
)


class AlgebraicModel(DamperModel):
    """A model whose force follows from the motion and the current of the same instant.

    F = fixed_columns @ fixed values + (gain + gain_b I) * y, where only the yield shape y has shape parameters.

    Attributes:
        fixed_names: linear parameters whose regressors need no shape parameter, in the order of `fixed_columns`.
        yield_names: the two linear parameters of the yield shape: at zero current, and per ampere.
        shape_names: the nonlinear parameters of the yield shape.
    """

    states: ClassVar[int] = 0
    fixed_names: ClassVar[tuple[str, ...]]
    yield_names: ClassVar[tuple[str, str]]
    shape_names: tuple[str, ...]

    @abstractmethod
    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """Regressors of `fixed_names`, shape (n, len(fixed_names)).

        Args:
            u: extension about mid-stroke (m), shape (n,).
            v: velocity (m/s), shape (n,).
            a: acceleration (m/s^2), shape (n,).
            current: coil current (A), shape (n,).
        """

    @abstractmethod
    def yield_shape(self, shape: Mapping[str, float], u: FloatArray, v: FloatArray) -> FloatArray:
        """Yield shape between -1 and 1, shape (n,), from extension (m) and velocity (m/s).

        Raises:
            KeyError: a shape parameter is missing.
        """

    def force(
        self,
        parameters: Mapping[str, float],
        u: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        current: ArrayLike,
        dt_s: float,
    ) -> FloatArray:
        """See `DamperModel.force`.

        Raises:
            KeyError: a parameter is missing or unknown.
        """
        del dt_s
        self.vector(parameters)
        u_m, v_m_s, a_m_s2, current_A = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (u, v, a, current)))
        fixed = np.array([float(parameters[name]) for name in self.fixed_names])
        at_zero, per_ampere = (float(parameters[name]) for name in self.yield_names)
        yielding = (at_zero + per_ampere * current_A) * self.yield_shape(parameters, u_m, v_m_s)
        force: FloatArray = self.fixed_columns(u_m, v_m_s, a_m_s2, current_A) @ fixed + yielding
        return force

    def _sliding_force(self, parameters: Mapping[str, float], v_m_s: float, current_A: float) -> float:
        sides = np.array([-1e-12, 1e-12])
        return float(np.mean(self.force(parameters, sides, np.full(2, v_m_s), np.zeros(2), current_A, 1e-3)))


class TanhModel(AlgebraicModel):
    """Common part of the tanh models: the argument of the yield shape, in either published form.

    kwok:    tanh(beta v + delta sgn(u))        (Kwok et al. 2006)
    printed: tanh(beta (v + lambda sgn(u)))     (c-FOA paper, equations 4-5, as printed)
    """

    hysteresis: Hysteresis

    def __init__(self, hysteresis: Hysteresis = "kwok") -> None:
        self.hysteresis = hysteresis
        self.shape_names = ("beta", "delta" if hysteresis == "kwok" else "lambda")

    def yield_shape(self, shape: Mapping[str, float], u: FloatArray, v: FloatArray) -> FloatArray:
        """See `AlgebraicModel.yield_shape`.

        Raises:
            KeyError: a shape parameter is missing.
        """
        beta = shape["beta"]
        offset = shape["delta"] if self.hysteresis == "kwok" else beta * shape["lambda"]
        yielding: FloatArray = np.tanh(beta * v + offset * np.sign(u))
        return yielding

    def argument_slopes(
        self, shape: Mapping[str, float], u: FloatArray, v: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the tanh's argument with respect to the two shape parameters, each of shape (n,).

        Raises:
            KeyError: a shape parameter is missing.
        """
        side = np.sign(u)
        if self.hysteresis == "kwok":
            return v, side
        return v + shape["lambda"] * side, shape["beta"] * side


class AsymmetricModel(TanhModel):
    """Asymmetric model of the c-FOA paper, equations (3)-(11): viscous damping differs in jounce and rebound."""

    name: ClassVar[str] = "asymmetric"
    equation: ClassVar[str] = (
        "F = m a + C(I, sgn v) v + K(I) u + Fy(I) tanh(y) + F0, C = Ca + Cb I (plus for v >= 0), Fy = Fya + Fyb I, "
        "K = Ka + Kb I (c-FOA paper, equations 3-11)"
    )
    fixed_names: ClassVar[tuple[str, ...]] = ("m", "F0", "Ca_plus", "Ca_minus", "Cb_plus", "Cb_minus", "Ka", "Kb")
    yield_names: ClassVar[tuple[str, str]] = ("Fya", "Fyb")

    def __init__(self, hysteresis: Hysteresis = "kwok") -> None:
        super().__init__(hysteresis)
        self.kind = KIND_ASYMMETRIC if hysteresis == "kwok" else KIND_ASYMMETRIC_PRINTED
        loop = OFFSET if hysteresis == "kwok" else OFFSET_SPEED
        viscous = VISCOUS_ASYMMETRIC
        self.parameters = (MASS, PRELOAD, SLOPE, loop, YIELD_A, YIELD_B, *viscous, STIFFNESS_A, STIFFNESS_B, LAG)

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `AlgebraicModel.fixed_columns`."""
        rebound, jounce = np.maximum(v, 0.0), np.minimum(v, 0.0)
        one = np.ones_like(u)
        return np.array((a, one, rebound, jounce, rebound * current, jounce * current, u, u * current)).T


class SymmetricModel(TanhModel):
    """The asymmetric model with equal viscous damping both ways (c-FOA paper, Table 3)."""

    name: ClassVar[str] = "symmetric"
    equation: ClassVar[str] = (
        "F = m a + C(I) v + K(I) u + Fy(I) tanh(y) + F0 (c-FOA paper, equations 3-11 with C+ = C-)"
    )
    fixed_names: ClassVar[tuple[str, ...]] = ("m", "F0", "Ca", "Cb", "Ka", "Kb")
    yield_names: ClassVar[tuple[str, str]] = ("Fya", "Fyb")

    def __init__(self, hysteresis: Hysteresis = "kwok") -> None:
        super().__init__(hysteresis)
        self.kind = KIND_SYMMETRIC if hysteresis == "kwok" else KIND_SYMMETRIC_PRINTED
        loop = OFFSET if hysteresis == "kwok" else OFFSET_SPEED
        viscous = VISCOUS_SYMMETRIC
        self.parameters = (MASS, PRELOAD, SLOPE, loop, YIELD_A, YIELD_B, *viscous, STIFFNESS_A, STIFFNESS_B, LAG)

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `AlgebraicModel.fixed_columns`."""
        return np.array((a, np.ones_like(u), v, v * current, u, u * current)).T


class KwokModel(TanhModel):
    """Hyperbolic tangent model of Kwok et al. 2006, its c, k and alpha affine in the current."""

    name: ClassVar[str] = "kwok"
    equation: ClassVar[str] = (
        "F = c v + k u + alpha z + f0, z = tanh(beta v + delta sgn u) (Kwok 2006); c, k, alpha affine in I"
    )
    fixed_names: ClassVar[tuple[str, ...]] = ("c", "c_b", "k", "k_b", "f0")
    yield_names: ClassVar[tuple[str, str]] = ("alpha", "alpha_b")

    def __init__(self) -> None:
        super().__init__("kwok")
        self.kind = KIND_KWOK
        self.parameters = (
            _viscous("c", "c", "N s/m", 500.0, "viscous damping at zero current"),
            _viscous("c_b", "c_b", "N s/(m A)", 50.0, "viscous damping per ampere"),
            Parameter("k", "k", "N/m", 0.0, -1e6, 1e6, True, "stiffness at zero current"),
            Parameter("k_b", "k_b", "N/(m A)", 0.0, -1e6, 1e6, True, "stiffness per ampere"),
            Parameter("alpha", "alpha", "N", 50.0, -1e4, 1e4, True, "hysteretic force at zero current"),
            Parameter("alpha_b", "alpha_b", "N/A", 200.0, -1e4, 1e4, True, "hysteretic force per ampere"),
            SLOPE,
            OFFSET,
            Parameter("f0", "f0", "N", 0.0, -5e3, 5e3, True, "force offset"),
        )

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `AlgebraicModel.fixed_columns`."""
        del a
        return np.array((v, v * current, u, u * current, np.ones_like(u))).T


class BinghamModel(AlgebraicModel):
    """Bingham plastic model, its fc and c0 affine in the current."""

    name: ClassVar[str] = "bingham"
    equation: ClassVar[str] = "F = fc sgn(v) + c0 v + f0 (Stanway 1987, as in Spencer 1997); fc, c0 affine in I"
    fixed_names: ClassVar[tuple[str, ...]] = ("c0", "c0_b", "f0")
    yield_names: ClassVar[tuple[str, str]] = ("fc", "fc_b")

    def __init__(self) -> None:
        self.shape_names = ()
        self.kind = KIND_BINGHAM
        self.parameters = (
            Parameter("fc", "fc", "N", 50.0, -1e4, 1e4, True, "Coulomb force at zero current"),
            Parameter("fc_b", "fc_b", "N/A", 200.0, -1e4, 1e4, True, "Coulomb force per ampere"),
            _viscous("c0", "c0", "N s/m", 500.0, "viscous damping at zero current"),
            _viscous("c0_b", "c0_b", "N s/(m A)", 50.0, "viscous damping per ampere"),
            Parameter("f0", "f0", "N", 0.0, -5e3, 5e3, True, "force offset"),
        )

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `AlgebraicModel.fixed_columns`."""
        del u, a
        return np.array((v, v * current, np.ones_like(v))).T

    def yield_shape(self, shape: Mapping[str, float], u: FloatArray, v: FloatArray) -> FloatArray:
        """See `AlgebraicModel.yield_shape`; the sign of the velocity, without shape parameters."""
        del shape, u
        sign: FloatArray = np.sign(v)
        return sign
