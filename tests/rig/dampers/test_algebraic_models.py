"""The algebraic models against their equations, worked by hand."""

import math

import numpy as np
import pytest

from rig.dampers import MODELS, PARAMETER_SETS, UnknownName, model, parameter_set
from rig.dampers.algebraic import TanhModel
from rig.dampers.kernel import advance_of
from rig.identification.models.kernels import lagged_current

DEMO = parameter_set("demo").values


def one_force(
    name: str, values: dict[str, float], u: float, v: float, a: float, current: float, form: str = "kwok"
) -> float:
    return float(model(name, form).force(values, [u], [v], [a], current, 0.004)[0])


def test_asymmetric_force_in_rebound_is_the_sum_of_equation_3() -> None:
    u, v, a, current = 0.01, 0.2, -3.0, 1.5
    inertia, preload = 3.83 * -3.0, -270.0
    viscous = (900.0 + 46.0 * 1.5) * 0.2
    stiffness = (300.0 + 50.0 * 1.5) * 0.01
    hysteretic = (5.56 + 238.0 * 1.5) * math.tanh(50.0 * 0.2 + 1.0)
    assert one_force("asymmetric", DEMO, u, v, a, current) == pytest.approx(
        inertia + preload + viscous + stiffness + hysteretic
    )


def test_jounce_uses_the_minus_coefficients_and_the_loop_changes_side_with_u() -> None:
    expected = -270.0 + (500.0 + 178.0) * -0.1 + 350.0 * -0.02 + 243.56 * math.tanh(50.0 * -0.1 - 1.0)
    assert one_force("asymmetric", DEMO, -0.02, -0.1, 0.0, 1.0) == pytest.approx(expected)


def test_at_mid_stroke_the_sign_of_u_is_zero_not_one() -> None:
    assert one_force("asymmetric", DEMO, 0.0, 0.001, 0.0, 1.0) == pytest.approx(
        -270.0 + 0.946 + 243.56 * math.tanh(0.05)
    )


def test_printed_form_equals_kwoks_with_delta_equal_to_beta_lambda() -> None:
    printed = {name: value for name, value in DEMO.items() if name != "delta"} | {"lambda": 0.02}
    kwok = {**DEMO, "delta": 50.0 * 0.02}
    for u, v in ((0.01, 0.03), (-0.01, 0.03), (0.0, -0.2)):
        assert one_force("asymmetric", printed, u, v, 0.0, 1.0, "printed") == pytest.approx(
            one_force("asymmetric", kwok, u, v, 0.0, 1.0)
        )


def test_published_lambda_read_as_printed_dissipates_nothing_in_the_yield_force() -> None:
    phase = np.linspace(0.0, 2.0 * np.pi, 4001)[:-1] + 1e-4
    u, v = 0.05 * np.sin(phase), 0.05 * np.cos(phase) * 2.0 * np.pi
    yielding = {}
    for name, form in (("cfoa-table4-printed", "printed"), ("cfoa-table4", "kwok")):
        values = parameter_set(name).values
        shape = model("asymmetric", form).yield_shape(values, u, v)
        yielding[form] = float(np.mean(shape * v))
    assert abs(yielding["printed"]) < 1e-3 * yielding["kwok"]


def test_symmetric_is_asymmetric_with_equal_damping() -> None:
    symmetric = parameter_set("demo-symmetric").values
    both = {name: value for name, value in symmetric.items() if name not in {"Ca", "Cb"}}
    both |= {"Ca_plus": 700.0, "Ca_minus": 700.0, "Cb_plus": 110.0, "Cb_minus": 110.0}
    for v in (-0.3, 0.4):
        assert one_force("symmetric", symmetric, 0.01, v, 2.0, 1.2) == pytest.approx(
            one_force("asymmetric", both, 0.01, v, 2.0, 1.2)
        )


def test_bingham_force_worked_by_hand() -> None:
    values = parameter_set("spencer-bingham").values
    assert one_force("bingham", values, 0.0, 0.1, 0.0, 0.0) == pytest.approx(670.0 + 500.0 - 95.0)
    assert one_force("bingham", values, 0.0, -0.1, 0.0, 0.0) == pytest.approx(-670.0 - 500.0 - 95.0)
    assert one_force("bingham", values, 0.0, 0.0, 0.0, 0.0) == pytest.approx(-95.0)


def test_kwok_force_worked_by_hand() -> None:
    values = {**parameter_set("demo-kwok").values, "c_b": 0.0, "k_b": 0.0, "alpha_b": 0.0}
    expected = 700.0 * 0.05 + 300.0 * -0.01 + 60.0 * math.tanh(50.0 * 0.05 - 1.0) - 270.0
    assert one_force("kwok", values, -0.01, 0.05, 0.0, 1.0) == pytest.approx(expected)


@pytest.mark.few(6)
@pytest.mark.parametrize("name", [each.name for each in PARAMETER_SETS.values() if MODELS[each.model].states == 0])
def test_one_plant_step_gives_the_same_force_as_the_equation(name: str) -> None:
    chosen = parameter_set(name)
    damper = model(chosen.model, chosen.hysteresis)
    vector, state = damper.vector(chosen.values), damper.initial_state()
    for u, v, a, current in (
        (0.01, 0.2, -3.0, 0.7),
        (-0.02, -0.3, 5.0, 1.4),
        (0.0, 0.0, 0.0, 0.0),
        (0.03, -0.001, 7.0, 2.0),
    ):
        step = advance_of(damper)(vector, state, u, v, a, current, 1e-4)
        assert step == pytest.approx(damper.force(chosen.values, [u], [v], [a], current, 1e-4)[0], rel=1e-12, abs=1e-9)


@pytest.mark.few(3)
@pytest.mark.parametrize("name", list(PARAMETER_SETS))
def test_sets_are_complete_and_fast_motion_dissipates(name: str) -> None:
    chosen = parameter_set(name)
    damper = model(chosen.model, chosen.hysteresis)
    assert set(chosen.values) == set(damper.names)
    t = np.arange(0.0, 4.0, 0.001)
    omega, amplitude = 2.0 * np.pi * 1.0, 0.02
    u, v, a = (
        amplitude * np.sin(omega * t),
        amplitude * omega * np.cos(omega * t),
        -amplitude * omega**2 * np.sin(omega * t),
    )
    force = damper.force(chosen.values, u, v, a, 1.0, 0.001)
    assert float(np.mean((force * v)[2000:])) > 0.0
    assert chosen.source


def test_published_spencer_numbers_are_converted_from_newton_and_centimetre() -> None:
    values = parameter_set("spencer-modified").values
    assert values["c0a"] == pytest.approx(21.0 * 100)
    assert values["alpha_b"] == pytest.approx(695.0 * 100)
    assert values["gamma"] == pytest.approx(363.0 * 100**2)
    assert values["x0"] == pytest.approx(14.3 / 100)


def test_lag_is_exact_for_any_step() -> None:
    whole = lagged_current(np.full(2, 2.0), 0.0, 25.0, 0.1)[-1]
    halves = lagged_current(np.full(3, 2.0), 0.0, 25.0, 0.05)[-1]
    assert whole == pytest.approx(2.0 * (1.0 - math.exp(-2.5)), rel=1e-14)
    assert halves == pytest.approx(whole, rel=1e-14)


def test_force_at_constant_speed_is_the_sliding_branch() -> None:
    force = model("asymmetric").force_at(DEMO, [0.1, -0.1], 1.0)
    upper = -270.0 + 94.6 + 243.56 * 0.5 * (math.tanh(6.0) + math.tanh(4.0))
    assert force[0] == pytest.approx(upper)
    assert force[1] < -270.0


def test_unknown_names_are_refused_with_what_would_fit() -> None:
    with pytest.raises(UnknownName, match="did you mean 'asymmetric'"):
        model("asymetric")
    with pytest.raises(UnknownName, match="did you mean 'demo-kwok'"):
        parameter_set("demo-kwock")
    with pytest.raises(UnknownName, match="no printed form"):
        model("bingham", "printed")
    with pytest.raises(UnknownName, match="expected kwok or printed"):
        model("asymmetric", "prnted")  # type: ignore[arg-type] - a user's typing error
    with pytest.raises(KeyError, match="missing \\['eta'\\]"):
        model("asymmetric").vector({name: value for name, value in DEMO.items() if name != "eta"})
    assert model("asymmetric").parameter("beta").unit == "s/m"
    with pytest.raises(KeyError, match="got parameter 'q'"):
        model("asymmetric").parameter("q")


def test_a_vector_and_its_values_are_inverse() -> None:
    damper = model("asymmetric")
    assert damper.values(damper.vector(DEMO)) == dict(DEMO)


def test_the_tanhs_argument_changes_with_its_shape_as_finite_differences_say() -> None:
    u, v = np.array([0.01, -0.02, 0.0]), np.array([0.005, 0.001, -0.015])
    for form, shape in (("kwok", {"beta": 50.0, "delta": 1.0}), ("printed", {"beta": 50.0, "lambda": 0.02})):
        damper = model("asymmetric", form)
        assert isinstance(damper, TanhModel)
        argument = np.arctanh(damper.yield_shape(shape, u, v))
        for name, slope in zip(shape, damper.argument_slopes(shape, u, v), strict=True):
            step = 1e-6 * shape[name]
            moved = np.arctanh(damper.yield_shape({**shape, name: shape[name] + step}, u, v))
            assert slope == pytest.approx((moved - argument) / step, rel=1e-3, abs=1e-7)


def test_a_parameter_the_model_does_not_have_is_named_with_those_it_has() -> None:
    with pytest.raises(KeyError, match="bingham: got parameter 'beta', expected one of fc, fc_b"):
        model("bingham").parameter("beta")


def test_values_by_name_come_in_the_kernels_order_and_a_wrong_set_of_names_is_reported() -> None:
    bingham = model("bingham")
    values = {"f0": 5.0, "c0_b": 4.0, "c0": 3.0, "fc_b": 2.0, "fc": 1.0}
    assert bingham.vector(values).tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    with pytest.raises(KeyError, match=r"missing \['fc'\], unknown \['Fc', 'mass'\]; expected fc, fc_b, c0, c0_b, f0"):
        bingham.vector({"f0": 5.0, "c0_b": 4.0, "c0": 3.0, "fc_b": 2.0, "Fc": 1.0, "mass": 0.0})
