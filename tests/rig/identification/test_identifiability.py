"""What tests cannot determine is named, with what would help."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.identification import Fit, Measurement, identify
from rig.identification.identifiability import explain
from rig.identification.projection import Weighting
from rig.identification.uncertainty import information

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


@pytest.mark.parametrize("delta", [40.0, 200.0])
def test_a_degenerate_hysteresis_is_warned_of_and_its_parameters_are_not_told(
    delta: float, make_synthetic: Make
) -> None:
    fit = identify(make_synthetic({**DEMO, "delta": delta, "beta": 20.0}))
    assert {"beta", "delta", "Fya", "Fyb"} <= unknown(fit)
    assert any(text.startswith("degenerate hysteresis") for text in fit.warnings)


def test_a_tanh_without_a_bend_is_called_a_straight_line(make_synthetic: Make) -> None:
    values = {**DEMO, "beta": 0.1, "delta": 0.02, "Fyb": 2000.0}
    tests, names = make_synthetic(values), [name for name in DEMO if name != "eta"]
    reasons = explain(
        model("asymmetric"), information(model("asymmetric"), values, names, tests, Weighting()), values, tests
    )
    assert {"beta", "delta", "Fya", "Fyb", "Ca_plus", "Ca_minus"} <= set(reasons)
    assert "a straight line here (at most 0.08" in reasons["Fyb"]
