"""A model defined outside the program: its parameters and kernel are enough, and errors of its definition are named."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from rig.dampers import MODELS, AlgebraicModel, ModelProblem, Parameter
from rig.dampers.algebraic import ColumnModel
from rig.dampers.arrays import FloatArray
from rig.dampers.catalogue import CATALOGUE, ORDINARY
from rig.dampers.kernel import Kernel
from rig.dampers.parameter import linear_parameter, shape_parameter
from rig.dampers.unit_columns import UnitSeparation
from rig.identification import Measurement, identify
from rig.identification.models.model_slope import modelled_force

Make = Callable[..., list[Measurement]]


class SmoothYield(AlgebraicModel):
    """One shape parameter, and linear ones with names of its own."""

    name: ClassVar[str] = "smooth_yield"
    equation: ClassVar[str] = "F = c v + (fya + fyb I) tanh(v / v0) + g"
    demonstration: ClassVar[Mapping[str, float]] = {"c": 700.0, "fya": 60.0, "fyb": 238.0, "v0": 0.02, "g": -270.0}
    parameters: tuple[Parameter, ...] = (
        linear_parameter("c", "N s/m", 500.0, "viscous damping"),
        linear_parameter("fya", "N", 50.0, "yield force at zero current"),
        linear_parameter("fyb", "N/A", 200.0, "yield force per ampere", at_zero="fya"),
        shape_parameter("v0", "m/s", 0.3, 1e-5, 10.0, "speed over which the yield force turns over"),
        linear_parameter("g", "N", 0.0, "force offset"),
    )

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            return float(p[0] * v + (p[1] + p[2] * current) * math.tanh(v / p[3]) + p[4])

        return Kernel(force)


def test_a_model_with_a_shape_parameter_is_fitted_from_its_parameters_and_kernel(
    make_synthetic: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    damper, truth = SmoothYield(), SmoothYield.demonstration
    monkeypatch.setitem(MODELS.own, damper.name, damper)  # type: ignore[attr-defined]  # as a line of the catalogue
    tests = make_synthetic(dict(MODELS["asymmetric"].demonstration), (0.0, 1.0), (1.0,))
    random = np.random.default_rng(3)
    measured = [
        replace(test, force_N=modelled_force(damper, truth, test) + random.normal(0.0, 5.0, test.u_m.size))
        for test in tests
    ]
    fit = identify(measured, model=damper.name, diagnose=False)
    assert fit.error.rmse_N == pytest.approx(5.0, rel=0.05)
    for name, value in truth.items():
        estimate = fit.parameters[name]
        assert estimate.standard_error is not None
        assert fit.values[name] == pytest.approx(value, abs=4.0 * estimate.standard_error)
        assert estimate.standard_error < 0.02 * abs(value)
    assert fit.solver.evaluations < 100


def test_a_column_model_with_a_shape_of_its_own_is_refused_at_definition() -> None:
    with pytest.raises(TypeError, match="AlgebraicModel"):
        type("Own", (ColumnModel,), {"shape_names": ("v0",)})


def test_a_separation_takes_every_linear_parameter_and_refuses_names_that_are_none() -> None:
    damper, shapes = SmoothYield(), {"v0": (1e-3, 1.0, [0.1])}
    form = UnitSeparation(damper, ("fya",), shapes)
    assert form.fixed_names == ()
    assert form.yield_names == ("fya", "fyb", "c", "g")
    with pytest.raises(ModelProblem, match="no_such"):
        UnitSeparation(damper, ("no_such",), shapes)
    with pytest.raises(ModelProblem, match="v0"):
        UnitSeparation(damper, ("fya",), {})


def test_every_model_of_the_program_splits_into_all_its_linear_and_shape_parameters() -> None:
    for damper in CATALOGUE:
        form = damper.separation(ORDINARY)
        if isinstance(form, UnitSeparation):
            split = (*form.fixed_names, *form.yield_names, *form.shape_names)
            assert sorted(split) == sorted(name for name in damper.names if name != "eta")
