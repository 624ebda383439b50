"""Models with internal states: viscoelastic_plastic and the Bouc-Wen family; integrated by the compiled kernels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from rig.dampers.algebraic import LAG
from rig.dampers.arrays import FloatArray
from rig.dampers.kinds import (
    KIND_BOUC_WEN,
    KIND_MODIFIED_BOUC_WEN,
    KIND_NORMALIZED_BOUC_WEN,
    KIND_THINNING_BOUC_WEN,
    KIND_VISCOELASTIC_PLASTIC,
)
from rig.dampers.model import DamperModel
from rig.dampers.parameter import Parameter


def _gain(name: str, unit: str, start: float, meaning: str) -> Parameter:
    return Parameter(name, name, unit, start, -1e6, 1e6, True, meaning)


def _shape(name: str, unit: str, start: float, low: float, high: float, meaning: str) -> Parameter:
    return Parameter(name, name, unit, start, low, high, False, meaning)


EXPONENT = _shape("n", "1", 2.0, 1.0, 10.0, "sharpness of the transition to yield")


class HystereticModel(DamperModel):
    """A model whose force depends on what happened before."""

    def force(
        self,
        parameters: Mapping[str, float],
        u: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        current: ArrayLike,
        dt_s: float,
    ) -> FloatArray:
        """See `DamperModel.force`; the first sample starts from `initial_state`.

        Raises:
            KeyError: a parameter is missing or unknown.
        """
        from rig.dampers.series import force_series

        motion = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (u, v, a, current)))
        u_m, v_m_s, a_m_s2, current_A = (np.ascontiguousarray(x) for x in motion)
        state = self.initial_state(float(u_m[0]))
        data = (u_m, v_m_s, a_m_s2, current_A)
        force: FloatArray = force_series(self.kind, self.vector(parameters), state, *data, dt_s, 0)
        return force


class BoucWenModel(HystereticModel):
    """Bouc-Wen model (Spencer 1997, equations 2-3); alpha and c0 affine in the current."""

    name: ClassVar[str] = "bouc_wen"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = (
        "F = c0 v + k0 (u - x0) + alpha z, z' = -gamma |v| z |z|^(n-1) - beta v |z|^n + A v (Spencer 1997)"
    )

    def __init__(self) -> None:
        self.kind = KIND_BOUC_WEN
        self.parameters = (
            _gain("c0", "N s/m", 500.0, "viscous damping at zero current"),
            _gain("c0_b", "N s/(m A)", 0.0, "viscous damping per ampere"),
            _gain("k0", "N/m", 0.0, "stiffness"),
            _shape("x0", "m", 0.0, -1.0, 1.0, "extension at which the spring is free"),
            _gain("alpha", "N/m", 1e5, "hysteretic force per hysteretic displacement at zero current"),
            _gain("alpha_b", "N/(m A)", 0.0, "the same per ampere"),
            _shape("gamma", "m^-n", 1e6, 0.0, 1e9, "shape of the loop, with the sign of the speed"),
            _shape("beta", "m^-n", 1e6, -1e9, 1e9, "shape of the loop"),
            _shape("A", "1", 1.0, 1e-6, 1e6, "initial slope of z; redundant with alpha"),
            EXPONENT,
        )


class NormalizedBoucWenModel(HystereticModel):
    """Normalised Bouc-Wen model (Ikhouane and Rodellar 2005; Zhu et al.); kv and kw affine in the current."""

    name: ClassVar[str] = "normalized_bouc_wen"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = (
        "F = kx u + kv v + kw w + f0, w' = rho [v - sigma |v| |w|^(n-1) w + (sigma - 1) v |w|^n] (Ikhouane-Rodellar)"
    )

    def __init__(self) -> None:
        self.kind = KIND_NORMALIZED_BOUC_WEN
        self.parameters = (
            _gain("kx", "N/m", 0.0, "stiffness"),
            _gain("kv", "N s/m", 500.0, "viscous damping at zero current"),
            _gain("kv_b", "N s/(m A)", 0.0, "viscous damping per ampere"),
            _gain("kw", "N", 50.0, "yield force at zero current"),
            _gain("kw_b", "N/A", 200.0, "yield force per ampere"),
            _gain("f0", "N", 0.0, "force offset"),
            _shape("rho", "1/m", 500.0, 1e-2, 1e6, "inverse of the yield displacement"),
            _shape("sigma", "1", 0.6, 0.5, 100.0, "shape of the loop"),
            EXPONENT,
        )


class ThinningBoucWenModel(HystereticModel):
    """Normalised Bouc-Wen model beside a shear-thinning viscous force, for real dampers.

    Above yield the force of a real MR damper grows ever more slowly with speed (Herschel-Bulkley), and yield force and
    viscous force saturate with the coil's field: kt tanh(v/vt) is the first, the cubic in the current the second.
    """

    name: ClassVar[str] = "thinning_bouc_wen"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = (
        "F = kx u + kv v + kt tanh(v/vt) + kw w + f0, w as in normalized_bouc_wen; kv affine, kt and kw cubic in I"
    )

    def __init__(self) -> None:
        self.kind = KIND_THINNING_BOUC_WEN
        self.parameters = (
            *NormalizedBoucWenModel().parameters,
            _gain("kw_c", "N/A^2", 0.0, "yield force per ampere squared"),
            _gain("kw_d", "N/A^3", 0.0, "yield force per ampere cubed"),
            _gain("kt", "N", 20.0, "saturating viscous force at zero current"),
            _gain("kt_b", "N/A", 50.0, "the same per ampere"),
            _gain("kt_c", "N/A^2", 0.0, "the same per ampere squared"),
            _gain("kt_d", "N/A^3", 0.0, "the same per ampere cubed"),
            _shape("vt", "m/s", 0.02, 1e-4, 10.0, "speed at which the viscous force has bent"),
        )


class ModifiedBoucWenModel(HystereticModel):
    """Modified Bouc-Wen model (Spencer 1997, equations 8-12); alpha, c0, c1 affine in the filtered input."""

    name: ClassVar[str] = "modified_bouc_wen"
    states: ClassVar[int] = 2
    equation: ClassVar[str] = (
        "F = c1 y' + k1 (u - x0), y' = [alpha z + c0 u' + k0 (u - y)]/(c0 + c1), "
        "z' = -gamma |u' - y'| z |z|^(n-1) - beta (u' - y') |z|^n + A (u' - y') (Spencer 1997)"
    )

    def __init__(self) -> None:
        self.kind = KIND_MODIFIED_BOUC_WEN
        self.parameters = (
            _gain("alpha_a", "N/m", 1e4, "hysteretic force per hysteretic displacement at zero current"),
            _gain("alpha_b", "N/(m A)", 5e4, "the same per ampere"),
            _gain("c0a", "N s/m", 1e3, "viscous damping at large speeds, zero current"),
            _gain("c0b", "N s/(m A)", 1e2, "the same per ampere"),
            _gain("c1a", "N s/m", 2e4, "dashpot of the roll-off at small speeds, zero current"),
            _gain("c1b", "N s/(m A)", 1e2, "the same per ampere"),
            _gain("k0", "N/m", 0.0, "stiffness at large speeds"),
            _gain("k1", "N/m", 0.0, "accumulator stiffness"),
            _shape("x0", "m", 0.0, -1.0, 1.0, "extension at which the accumulator spring is free"),
            _shape("gamma", "m^-n", 1e6, 0.0, 1e9, "shape of the loop, with the sign of the speed"),
            _shape("beta", "m^-n", 1e6, -1e9, 1e9, "shape of the loop"),
            _shape("A", "1", 100.0, 1e-6, 1e6, "initial slope of z; redundant with alpha, beta and gamma"),
            EXPONENT,
            LAG,
        )

    def initial_state(self, u_m: float = 0.0) -> FloatArray:
        """Internal state (y, z) at rest at extension `u_m` (m): y = u, z = 0."""
        return np.array([u_m, 0.0])


class ViscoelasticPlasticModel(HystereticModel):
    """Viscoelastic-plastic model of Gamota and Filisko 1991; fc and c0 affine in the current."""

    name: ClassVar[str] = "viscoelastic_plastic"
    states: ClassVar[int] = 2
    equation: ClassVar[str] = (
        "yielded (|F - f0| > fc): F = k1 (x2 - x1) + c1 (v2 - v1) + f0 = c0 v1 + fc sgn(v1) + f0 = k2 (x3 - x2) + f0; "
        "else v1 = 0; x3 = u (Gamota and Filisko 1991, as in Spencer 1997)"
    )

    def __init__(self) -> None:
        self.kind = KIND_VISCOELASTIC_PLASTIC
        self.parameters = (
            _shape("k1", "N/m", 1e4, 0.0, 1e8, "spring of the viscoelastic element"),
            _shape("c1", "N s/m", 2e3, 1.0, 1e7, "dashpot of the viscoelastic element"),
            _shape("k2", "N/m", 1e6, 1e2, 1e9, "series spring"),
            _shape("c0", "N s/m", 500.0, 1.0, 1e6, "viscous damping once yielded, at zero current"),
            _shape("fc", "N", 50.0, 0.0, 1e5, "yield force at zero current"),
            _shape("fc_b", "N/A", 200.0, 0.0, 1e5, "yield force per ampere"),
            _shape("c0_b", "N s/(m A)", 0.0, 0.0, 1e6, "viscous damping once yielded, per ampere"),
            _gain("f0", "N", 0.0, "force offset"),
        )

    def initial_state(self, u_m: float = 0.0) -> FloatArray:
        """Internal state (x1, x2) at rest at extension `u_m` (m): every spring free."""
        return np.array([u_m, u_m])
