"""Models whose linear fit has columns in closed form, and the three tanh models: asymmetric, symmetric, kwok.

Given the shape parameters of the yield term, each force is linear in the rest. Its regressors are the one definition:
the identifier solves for their coefficients, `force` sums them; the kernel is the same for one instant.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from rig.dampers.arrays import FloatArray
from rig.dampers.model import AlgebraicModel, DamperModel, Jump
from rig.dampers.parameter import LAG, Hysteresis, Parameter, linear_parameter, shape_parameter
from rig.dampers.separation import Joinable, OwnNames

if TYPE_CHECKING:
    from rig.dampers.kernel import Kernel
    from rig.dampers.separation import JoinedMotions, Motion, MotionScale, Search, Separation

BETA_LIMITS = (1e-3, 1e9)  # s/m: from a straight line to a sign function
STEEPNESS = np.geomspace(1.5, 1500.0, 11)  # starts: beta times the greatest speed
WIDTHS = np.array([0.0, 0.004, 0.01, 0.02, 0.04, 0.08, 0.16, 0.3, 0.55, 0.9])  # loop half width over the greatest speed

MASS = Parameter("m", "m", "kg", 1.0, 0.0, 100.0, True, "inertia of the moving rod", "inertia")
PRELOAD = linear_parameter("F0", "N", 0.0, "gas preload", limit=5e3)
SLOPE = shape_parameter("beta", "s/m", 40.0, 0.1, 1e4, "steepness of the yield branch", term="yield")
OFFSET = shape_parameter(
    "delta", "1", 0.5, -20.0, 20.0, "half-width of the yield loop, expressed as an argument of tanh", term="yield"
)
OFFSET_SPEED = shape_parameter(
    "lambda", "m/s", 0.01, -2.0, 2.0, "half-width of the yield loop, expressed as a speed", term="yield"
)


def yield_force(name: str, unit: str, start: float, meaning: str, at_zero: str = "") -> Parameter:
    """A yield force (N, N/A): weakened by warm oil."""
    return linear_parameter(name, unit, start, meaning, limit=1e4, term="yield", at_zero=at_zero, softens=True)


def viscous(name: str, unit: str, start: float, meaning: str, at_zero: str = "", symbol: str = "") -> Parameter:
    """A viscous damping (N s/m, N s/(m A)): weakened by warm oil."""
    return linear_parameter(name, unit, start, meaning, symbol=symbol, term="viscous", at_zero=at_zero, softens=True)


YIELD = (
    yield_force("Fya", "N", 50.0, "yield force at zero current"),
    yield_force("Fyb", "N/A", 200.0, "yield force per ampere", "Fya"),
)
VISCOUS_ASYMMETRIC = (
    viscous("Ca_plus", "N s/m", 500.0, "viscous damping in rebound at zero current", symbol="Cca+"),
    viscous("Ca_minus", "N s/m", 500.0, "viscous damping in compression at zero current", symbol="Cca-"),
    viscous("Cb_plus", "N s/(m A)", 50.0, "viscous damping in rebound per ampere", "Ca_plus", "Ccb+"),
    viscous("Cb_minus", "N s/(m A)", 50.0, "viscous damping in compression per ampere", "Ca_minus", "Ccb-"),
)
VISCOUS_SYMMETRIC = (
    viscous("Ca", "N s/m", 500.0, "viscous damping at zero current", symbol="Cca"),
    viscous("Cb", "N s/(m A)", 50.0, "viscous damping per ampere", "Ca", "Ccb"),
)
STIFFNESS = (
    linear_parameter("Ka", "N/m", 0.0, "stiffness at zero current", symbol="Kka", term="stiffness"),
    linear_parameter("Kb", "N/(m A)", 0.0, "stiffness per ampere", symbol="Kkb", term="stiffness", at_zero="Ka"),
)


def needs_kernel_only(name: str) -> str:
    """The message for the author of a `ColumnModel` that has its own shape parameters."""
    return (
        f"{name}: got a ColumnModel with shape parameters, expected no shape parameters or those of TanhModel. Fix: "
        "derive the model from rig.dampers.AlgebraicModel, which requires only parameters and kernel"
    )


class ColumnModel(AlgebraicModel):
    """An algebraic model that also supplies the columns of its linear fit as arrays: faster than by its kernel.

    It has no shape parameters, or those of `TanhModel`; a model with others is an `AlgebraicModel`.
    F = fixed_columns @ fixed values + (gain + gain_b I) * y, where only the yield shape y has shape parameters.

    Attributes:
        fixed_names: linear parameters whose regressors need no shape parameter, in the order of `fixed_columns`.
        yield_names: the two linear parameters of the yield shape: at zero current, and per ampere.
        shape_names: the nonlinear parameters of the yield shape.
        general: for each parameter, its coefficients in `GENERAL`, the form that all these models share; "" for none.
        steepness_s_m: beta of that form for a model that has none.
    """

    fixed_names: ClassVar[tuple[str, ...]]
    yield_names: ClassVar[tuple[str, str]]
    shape_names: tuple[str, ...]
    general: ClassVar[Mapping[str, tuple[str, ...]]]
    steepness_s_m: ClassVar[float] = 0.0

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if cls.__dict__.get("shape_names"):
            raise TypeError(needs_kernel_only(cls.__name__))

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

    def argument_slopes(self, shape: Mapping[str, float], u: FloatArray, v: FloatArray) -> tuple[FloatArray, ...]:
        """Derivatives of the tanh's argument with respect to the shape parameters, each of shape (n,); () for none."""
        del shape, u, v
        return ()

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

    def separation(self, scale: MotionScale) -> Separation:
        """See `DamperModel.separation`."""
        del scale
        return AlgebraicSeparation(self)

    def search(self) -> Search:
        """See `DamperModel.search`.

        Raises:
            NotImplementedError: always: the model splits.
        """
        return DamperModel.search(self)


GENERAL = ("m", "F0", "beta", "delta", "Fya", "Fyb", "Ca_plus", "Ca_minus", "Cb_plus", "Cb_minus", "Ka", "Kb")
"""F = m a + F0 + (Fya + Fyb I) tanh(beta v + delta sgn u) + (Ca + Cb I) v + (Ka + Kb I) u, plus for v > 0."""


def general_coefficients(model: ColumnModel, names: Sequence[str], candidates: FloatArray) -> FloatArray:
    """Candidates (N, p) of the parameters `names` in the coefficients `GENERAL`, shape (N, 12)."""
    general = np.zeros((candidates.shape[0], len(GENERAL)))
    general[:, 2] = model.steepness_s_m
    for column, name in enumerate(names):
        for target in model.general.get(name, ()):
            general[:, GENERAL.index(target)] = candidates[:, column]
    if model.hysteresis == "printed":
        general[:, 3] *= general[:, 2]
    return general


class AlgebraicSeparation(OwnNames, Joinable):
    """An algebraic model split for projection: see `Separation`."""

    pointwise = True
    powers: tuple[int, ...] = (2,)
    starts: Sequence[FloatArray] = ()

    def __init__(self, model: ColumnModel) -> None:
        self.model = model
        self.fixed_names: tuple[str, ...] = model.fixed_names
        self.yield_names: tuple[str, ...] = model.yield_names
        self.shape_names = model.shape_names
        self.bends = ((0,),) * len(model.shape_names)
        self.logarithmic = tuple(name == "beta" for name in model.shape_names)
        self.limits = np.array([BETA_LIMITS if name == "beta" else (-np.inf, np.inf) for name in model.shape_names])

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `Separation.fixed_columns`."""
        return self.model.fixed_columns(u, v, a, current)

    def yielding(
        self, source: Motion | JoinedMotions, rows: slice, shape: FloatArray, *, slope: bool
    ) -> list[FloatArray]:
        """See `Separation.yielding`."""
        values = dict(zip(self.shape_names, shape, strict=True))
        u, v = source.u_m[rows], source.v_m_s[rows]
        yielding = self.model.yield_shape(values, u, v)
        if not slope or not self.shape_names:
            return [yielding]
        rate = 1.0 - yielding**2
        return [yielding, *(rate * change for change in self.model.argument_slopes(values, u, v))]

    def shape_of(self, values: Mapping[str, float]) -> FloatArray:
        """See `Separation.shape_of`."""
        return np.array([values[name] for name in self.shape_names])


class TanhModel(ColumnModel):
    """Common part of the tanh models: the argument of the yield shape, in either published form.

    kwok:    tanh(beta v + delta sgn(u))        (Kwok et al. 2006)
    printed: tanh(beta (v + lambda sgn(u)))     (c-FOA paper, equations 4-5, as printed)
    """

    jumps_at: ClassVar[Jump] = "mid-stroke"

    def __init__(self, hysteresis: Hysteresis = "kwok") -> None:
        self.hysteresis = hysteresis
        self.shape_names = ("beta", "delta" if hysteresis == "kwok" else "lambda")

    def yield_shape(self, shape: Mapping[str, float], u: FloatArray, v: FloatArray) -> FloatArray:
        """See `ColumnModel.yield_shape`.

        Raises:
            KeyError: a shape parameter is missing.
        """
        beta = shape["beta"]
        offset = shape["delta"] if self.hysteresis == "kwok" else beta * shape["lambda"]
        yielding: FloatArray = np.tanh(beta * v + offset * np.sign(u))
        return yielding

    def argument_slopes(self, shape: Mapping[str, float], u: FloatArray, v: FloatArray) -> tuple[FloatArray, ...]:
        """See `ColumnModel.argument_slopes`.

        Raises:
            KeyError: a shape parameter is missing.
        """
        side = np.sign(u)
        if self.hysteresis == "kwok":
            return v, side
        return v + shape["lambda"] * side, shape["beta"] * side

    def start_grid(self, top_speed_m_s: float) -> FloatArray:
        """Shapes over steepness and loop width from which a search starts, shape (b, w, 2), for tests of this speed."""
        beta, width = np.meshgrid(STEEPNESS / top_speed_m_s, WIDTHS * top_speed_m_s, indexing="ij")
        return np.stack((beta, width if self.hysteresis == "printed" else beta * width), axis=-1)


class AsymmetricModel(TanhModel):
    """Asymmetric model of the c-FOA paper, equations (3)-(11): viscous damping differs in jounce and rebound."""

    name: ClassVar[str] = "asymmetric"
    equation: ClassVar[str] = (
        "F = m a + C(I, sgn v) v + K(I) u + Fy(I) tanh(y) + F0, C = Ca + Cb I (Ca_plus, Cb_plus for v >= 0), Fy = Fya "
        "+ Fyb I, K = Ka + Kb I, y = beta v + delta sgn u; printed form: y = beta (v + lambda sgn u) (c-FOA paper, "
        "equations 3-11)"
    )
    energy: ClassVar[str] = (
        "the viscous and yield terms dissipate energy when they have the sign of the velocity; the tanh term with "
        "delta returns energy between mid-stroke and -delta/beta; K and m are conservative"
    )
    forms: ClassVar[tuple[Hysteresis, ...]] = ("kwok", "printed")
    fixed_names: ClassVar[tuple[str, ...]] = ("m", "F0", "Ca_plus", "Ca_minus", "Cb_plus", "Cb_minus", "Ka", "Kb")
    yield_names: ClassVar[tuple[str, str]] = ("Fya", "Fyb")
    general: ClassVar[Mapping[str, tuple[str, ...]]] = {**{name: (name,) for name in GENERAL}, "lambda": ("delta",)}
    demonstration: ClassVar[Mapping[str, float]] = {
        "m": 3.83, "F0": -270.0, "beta": 50.0, "delta": 1.0, "Fya": 5.56, "Fyb": 238.0, "Ca_plus": 900.0,
        "Ca_minus": 500.0, "Cb_plus": 46.0, "Cb_minus": 178.0, "Ka": 300.0, "Kb": 50.0, "eta": 25.0,
    }  # fmt: skip

    def __init__(self, hysteresis: Hysteresis = "kwok") -> None:
        super().__init__(hysteresis)
        loop = OFFSET if hysteresis == "kwok" else OFFSET_SPEED
        self.parameters = (MASS, PRELOAD, SLOPE, loop, *YIELD, *VISCOUS_ASYMMETRIC, *STIFFNESS, LAG)

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `ColumnModel.fixed_columns`."""
        rebound, jounce = np.maximum(v, 0.0), np.minimum(v, 0.0)
        one = np.ones_like(u)
        return np.array((a, one, rebound, jounce, rebound * current, jounce * current, u, u * current)).T

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel, sign  # loads numba

        printed = self.hysteresis == "printed"

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            y = p[2] * v + (p[2] * p[3] if printed else p[3]) * sign(u)
            viscous = p[6] + p[8] * current if v >= 0.0 else p[7] + p[9] * current
            stiffness = p[10] + p[11] * current
            return float(p[0] * a + p[1] + (p[4] + p[5] * current) * math.tanh(y) + viscous * v + stiffness * u)

        return Kernel(force)


class SymmetricModel(TanhModel):
    """The asymmetric model with equal viscous damping both ways (c-FOA paper, Table 3)."""

    name: ClassVar[str] = "symmetric"
    equation: ClassVar[str] = (
        "F = m a + C(I) v + K(I) u + Fy(I) tanh(y) + F0, C = Ca + Cb I, Fy = Fya + Fyb I, K = Ka + Kb I, y = beta v + "
        "delta sgn u; printed form: y = beta (v + lambda sgn u) (c-FOA paper, equations 3-11 with C+ = C-)"
    )
    energy: ClassVar[str] = "see asymmetric"
    forms: ClassVar[tuple[Hysteresis, ...]] = ("kwok", "printed")
    fixed_names: ClassVar[tuple[str, ...]] = ("m", "F0", "Ca", "Cb", "Ka", "Kb")
    yield_names: ClassVar[tuple[str, str]] = ("Fya", "Fyb")
    general: ClassVar[Mapping[str, tuple[str, ...]]] = {
        **{name: (name,) for name in ("m", "F0", "beta", "delta", "Fya", "Fyb", "Ka", "Kb")},
        "lambda": ("delta",),
        "Ca": ("Ca_plus", "Ca_minus"),
        "Cb": ("Cb_plus", "Cb_minus"),
    }
    demonstration: ClassVar[Mapping[str, float]] = {
        "m": 3.83, "F0": -270.0, "beta": 50.0, "delta": 1.0, "Fya": 5.56, "Fyb": 238.0, "Ca": 700.0, "Cb": 110.0,
        "Ka": 300.0, "Kb": 50.0, "eta": 25.0,
    }  # fmt: skip

    def __init__(self, hysteresis: Hysteresis = "kwok") -> None:
        super().__init__(hysteresis)
        loop = OFFSET if hysteresis == "kwok" else OFFSET_SPEED
        self.parameters = (MASS, PRELOAD, SLOPE, loop, *YIELD, *VISCOUS_SYMMETRIC, *STIFFNESS, LAG)

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `ColumnModel.fixed_columns`."""
        return np.array((a, np.ones_like(u), v, v * current, u, u * current)).T

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel, sign  # loads numba

        printed = self.hysteresis == "printed"

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            y = p[2] * v + (p[2] * p[3] if printed else p[3]) * sign(u)
            viscous, stiffness = p[6] + p[7] * current, p[8] + p[9] * current
            return float(p[0] * a + p[1] + (p[4] + p[5] * current) * math.tanh(y) + viscous * v + stiffness * u)

        return Kernel(force)


class KwokModel(TanhModel):
    """Hyperbolic tangent model of Kwok et al. 2006, its c, k and alpha affine in the current."""

    name: ClassVar[str] = "kwok"
    equation: ClassVar[str] = (
        "F = c v + k u + alpha z + f0, z = tanh(beta v + delta sgn u) (Kwok 2006); c, k, alpha affine in I"
    )
    energy: ClassVar[str] = "as for `asymmetric`, but without inertia"
    fixed_names: ClassVar[tuple[str, ...]] = ("c", "c_b", "k", "k_b", "f0")
    yield_names: ClassVar[tuple[str, str]] = ("alpha", "alpha_b")
    general: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "c": ("Ca_plus", "Ca_minus"), "c_b": ("Cb_plus", "Cb_minus"), "k": ("Ka",), "k_b": ("Kb",), "alpha": ("Fya",),
        "alpha_b": ("Fyb",), "beta": ("beta",), "delta": ("delta",), "f0": ("F0",),
    }  # fmt: skip
    demonstration: ClassVar[Mapping[str, float]] = {
        "c": 700.0, "c_b": 110.0, "k": 300.0, "k_b": 50.0, "alpha": 60.0, "alpha_b": 238.0, "beta": 50.0, "delta": 1.0,
        "f0": -270.0,
    }  # fmt: skip

    def __init__(self) -> None:
        super().__init__("kwok")
        self.parameters = (
            viscous("c", "N s/m", 500.0, "viscous damping at zero current"),
            viscous("c_b", "N s/(m A)", 50.0, "viscous damping per ampere", "c"),
            linear_parameter("k", "N/m", 0.0, "stiffness at zero current", term="stiffness"),
            linear_parameter("k_b", "N/(m A)", 0.0, "stiffness per ampere", term="stiffness", at_zero="k"),
            yield_force("alpha", "N", 50.0, "hysteretic force at zero current"),
            yield_force("alpha_b", "N/A", 200.0, "hysteretic force per ampere", "alpha"),
            SLOPE,
            OFFSET,
            linear_parameter("f0", "N", 0.0, "force offset", limit=5e3),
        )

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `ColumnModel.fixed_columns`."""
        del a
        return np.array((v, v * current, u, u * current, np.ones_like(u))).T

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import Kernel, sign  # loads numba

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            z = math.tanh(p[6] * v + p[7] * sign(u))
            return float((p[0] + p[1] * current) * v + (p[2] + p[3] * current) * u + (p[4] + p[5] * current) * z + p[8])

        return Kernel(force)
