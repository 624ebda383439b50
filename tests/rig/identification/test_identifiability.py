"""What tests cannot determine is named, with what would help."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import parameter_set
from rig.identification import Fit, Measurement, identify

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)


def unknown(fit: Fit) -> set[str]:
    return {name for name, each in fit.parameters.items() if not each.identifiable}


def test_a_full_matrix_leaves_only_eta(make_synthetic: Make) -> None:
    fit = identify(make_synthetic(DEMO))
    assert unknown(fit) == {"eta"}
    assert "held its current constant" in fit.parameters["eta"].reason
    assert fit.parameters["eta"].value is None


def test_one_current_says_which_sums_are_known(make_synthetic: Make) -> None:
    fit = identify(make_synthetic(DEMO, (1.0,), (0.5, 1.0, 2.0)))
    assert unknown(fit) == {"eta", "Fya", "Fyb", "Ca_plus", "Cb_plus", "Ca_minus", "Cb_minus", "Ka", "Kb"}
    assert "every test ran at 1.00 A" in fit.parameters["Fyb"].reason
    assert fit.parameters["Fya"].value == pytest.approx(DEMO["Fya"] + DEMO["Fyb"], rel=0.01)
    assert fit.parameters["Fya"].low is None
    assert fit.error.rmse_N < 5.5


def test_without_current_the_values_at_zero_are_known(make_synthetic: Make) -> None:
    fit = identify(make_synthetic({**DEMO, "Fya": 100.0}, (0.0,), (0.5, 1.0, 2.0)))
    assert unknown(fit) == {"eta", "Fyb", "Cb_plus", "Cb_minus", "Kb"}
    assert "every test ran without current" in fit.parameters["Fyb"].reason
    assert fit.parameters["Fya"].low < 100.0 < fit.parameters["Fya"].high  # type: ignore[operator] - identifiable, so not None


def test_one_frequency_cannot_tell_mass_from_stiffness(make_synthetic: Make) -> None:
    fit = identify(make_synthetic(DEMO, frequencies_Hz=(1.0,)))
    assert {"m", "Ka"} <= unknown(fit)
    assert "one frequency" in fit.parameters["m"].reason
    assert fit.parameters["Ka"].value == pytest.approx(300.0 - 3.83 * (2.0 * np.pi) ** 2, abs=10.0)
    assert fit.parameters["beta"].identifiable


def test_one_speed_cannot_tell_viscous_from_yield_force(make_synthetic: Make) -> None:
    tests = []
    for test in make_synthetic(DEMO, (0.0, 1.0, 2.0), (1.0,)):
        t = np.arange(test.u_m.size) / 250.0 + 0.0013
        u = 0.05 * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * t))
        v = 0.2 * np.sign(np.cos(2.0 * np.pi * t))
        force = -270.0 + np.where(v > 0.0, 900.0, 500.0) * v + (5.0 + 238.0 * test.current_A) * np.sign(v) + 300.0 * u
        tests.append(replace(test, u_m=u, v_m_s=v, a_m_s2=np.zeros_like(u), force_N=force))
    fit = identify(tests)
    assert {"Fya", "Fyb", "Ca_plus", "Ca_minus", "beta"} <= unknown(fit)
    assert "one speed" in fit.parameters["Ca_plus"].reason


def test_a_saturated_tanh_is_called_a_sign_function(make_synthetic: Make) -> None:
    tests = make_synthetic({**DEMO, "beta": 5e6, "delta": 0.0})
    fit = identify(tests)
    assert {"beta", "delta"} <= unknown(fit)
    assert "saturated" in fit.parameters["beta"].reason


def test_a_models_scale_freedom_is_named(make_synthetic: Make) -> None:
    chosen = parameter_set("demo-bouc-wen")
    fit = identify(
        make_synthetic(dict(chosen.values), (0.0, 2.0), (1.0, 2.0), name="bouc_wen", cycles=4), model="bouc_wen"
    )
    assert {"A", "alpha", "beta", "gamma"} <= unknown(fit)
    assert "A = 1" in fit.parameters["alpha"].reason
    assert fit.parameters["n"].low < 2.0 < fit.parameters["n"].high  # type: ignore[operator] - identifiable, so not None
