"""What tests cannot determine is named, with what would help."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.identification import Fit, Measurement, identify
from rig.identification.models.model_slope import FittedModel
from rig.identification.models.projection import Weighting
from rig.identification.models.undetermined import examine, only_at
from rig.identification.uncertainty.alternative_shapes import explain
from rig.identification.uncertainty.covariance import information

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)


def unknown(fit: Fit) -> set[str]:
    return {name for name, each in fit.parameters.items() if not each.identifiable}


def test_a_full_matrix_leaves_only_eta(make_synthetic: Make) -> None:
    fit = identify(make_synthetic(DEMO))
    assert unknown(fit) == {"eta"}
    assert "the current was constant in every test" in fit.parameters["eta"].reason
    assert fit.parameters["eta"].value is None


def test_one_current_says_which_sums_are_known(make_synthetic: Make) -> None:
    fit = identify(make_synthetic(DEMO, (1.0,), (0.5, 1.0, 2.0)))
    assert unknown(fit) == {"eta", "Fya", "Fyb", "Ca_plus", "Cb_plus", "Ca_minus", "Cb_minus", "Ka", "Kb"}
    assert "every test ran at 1.00 A" in fit.parameters["Fyb"].reason
    assert fit.parameters["Fya"].value == pytest.approx(DEMO["Fya"] + DEMO["Fyb"], rel=0.01)
    sum_at_1_A = fit.parameters["Fya"]
    assert (sum_at_1_A.identifiable, sum_at_1_A.quantity) == (False, "Fya + Fyb I at I = 1.00 A")
    assert sum_at_1_A.low < DEMO["Fya"] + DEMO["Fyb"] < sum_at_1_A.high  # type: ignore[operator] - has an interval
    assert 0.0 < sum_at_1_A.standard_error < 0.01 * sum_at_1_A.value  # type: ignore[operator] - the same
    assert fit.parameters["Fyb"].standard_error is None
    assert fit.covariance.loc["Fya", "Fya"] == pytest.approx(sum_at_1_A.standard_error**2)  # type: ignore[operator]
    assert "Fya: value and interval of Fya + Fyb I at I = 1.00 A" in str(fit)
    assert fit.error.rmse_N < 5.5


def test_without_current_the_values_at_zero_are_known(make_synthetic: Make) -> None:
    fit = identify(make_synthetic({**DEMO, "Fya": 100.0}, (0.0,), (0.5, 1.0, 2.0)))
    assert unknown(fit) == {"eta", "Fyb", "Cb_plus", "Cb_minus", "Kb"}
    assert "every test ran at 0 A" in fit.parameters["Fyb"].reason
    assert fit.parameters["Fya"].low < 100.0 < fit.parameters["Fya"].high  # type: ignore[operator] - identifiable, so not None


def test_a_finely_stepped_current_has_its_levels_and_a_badly_held_one_has_no_more(make_synthetic: Make) -> None:
    """Steps of 25 mA are levels, though each is near to the next; 20 mA about a requested current are its error."""
    model_with_cubic = model("thinning_bouc_wen")
    fine = make_synthetic(DEMO, tuple(np.arange(0.0, 0.21, 0.025).tolist()), (1.0,), cycles=2)
    assert examine(model_with_cubic, fine).held.isdisjoint({"kt_b", "kt_c", "kt_d"})
    assert only_at(model_with_cubic, fine) == ()
    held = make_synthetic(DEMO, (0.0, 0.02, -0.01, 0.98, 1.0, 1.02), (1.0,), cycles=2)
    badly = [replace(test, nominal_current_A=float(round(test.nominal_current_A))) for test in held]
    assert {"kt_c", "kt_d"} <= examine(model_with_cubic, badly).held
    assert only_at(model_with_cubic, badly) == pytest.approx((0.01 / 3.0, 1.0))


def test_one_frequency_cannot_determine_mass_from_stiffness(make_synthetic: Make) -> None:
    fit = identify(make_synthetic(DEMO, frequencies_Hz=(1.0,)))
    assert {"m", "Ka"} <= unknown(fit)
    assert "one frequency" in fit.parameters["m"].reason
    assert fit.parameters["Ka"].value == pytest.approx(300.0 - 3.83 * (2.0 * np.pi) ** 2, abs=10.0)
    assert fit.parameters["beta"].identifiable


def test_one_speed_cannot_determine_viscous_from_yield_force(make_synthetic: Make) -> None:
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


def triangles(values: dict[str, float], speeds_m_s: tuple[float, ...], seed: int) -> list[Measurement]:
    """Ideal triangles of 50 mm at 0, 1 and 2 A: every test runs at one speed, both ways; 5 N of noise."""
    rng, tests = np.random.default_rng(seed), []
    for current_A in (0.0, 1.0, 2.0):
        for speed_m_s in speeds_m_s:
            cycle_s = 0.2 / speed_m_s
            turns = (np.arange(round(6.0 * cycle_s * 250.0)) / 250.0 + 0.0013) / cycle_s
            u, v = (
                0.1 / np.pi * np.arcsin(np.sin(2.0 * np.pi * turns)),
                speed_m_s * np.sign(np.cos(2.0 * np.pi * turns)),
            )
            force = model("asymmetric").force(values, u, v, np.zeros_like(u), current_A, 0.004)
            tests.append(
                Measurement(
                    id=f"{speed_m_s:g} m/s {current_A:g} A", u_m=u, v_m_s=v, a_m_s2=np.zeros_like(u), dt_s=0.004,
                    force_N=force + rng.normal(0.0, 5.0, u.size), current_A=np.full_like(u, current_A), noise_N=5.0,
                    waveform="triangle", nominal_current_A=current_A, samples_per_cycle=round(250.0 * cycle_s),
                )
            )  # fmt: skip
    return tests


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("speeds_m_s", "beta_s_m", "identifiable"),
    [
        ((0.2, 0.4), 50.0, {"F0", "Ka"}),
        ((0.2, 0.4), 5.0, {"F0", "Ka", "beta", "delta", "Fyb", "Ca_plus", "Cb_minus"}),
        ((0.1, 0.2, 0.4), 50.0, {"F0", "Ka", "Fya", "Ca_plus", "Ca_minus"}),
        ((0.1, 0.2, 0.4), 20.0, {"F0", "Ka", "beta", "delta", "Fyb", "Ca_plus", "Cb_minus"}),
    ],
)
def test_intervals_at_a_few_constant_speeds_cover_the_truth_or_are_withdrawn(
    speeds_m_s: tuple[float, ...], beta_s_m: float, identifiable: set[str]
) -> None:
    values = {**DEMO, "beta": beta_s_m}
    covered: dict[str, list[bool]] = {}
    for seed in range(30):
        fit = identify(triangles(values, speeds_m_s, seed))
        for name in fit.identifiable:
            each = fit.parameters[name]
            covered.setdefault(name, []).append(each.low <= values[name] <= each.high)  # type: ignore[operator] - identifiable
    inside, stated = sum(map(sum, covered.values())), sum(map(len, covered.values()))
    assert inside >= 0.9 * stated
    for name, hits in covered.items():
        assert sum(hits) >= 0.75 * len(hits), (name, hits)  # of 20 or more with 95 %: fewer below 1 in 1,000
    assert {name for name, hits in covered.items() if len(hits) >= 27} >= identifiable


def test_a_small_part_in_a_direction_without_information_is_enough_to_be_undetermined() -> None:
    values = {**DEMO, "m": 0.0, "beta": 5.0, "delta": 0.0}  # Fya, beside the hundredfold yield force at 1 and 2 A
    names = [name for name in DEMO if name not in {"eta", "m"}]
    tests = triangles(values, (0.2, 0.4), 0)
    known = information(FittedModel(model("asymmetric"), values, tuple(names)), tests, Weighting())
    assert set(known.partners) == {"beta", "Fya", "Fyb", "Ca_plus", "Ca_minus", "Cb_plus", "Cb_minus"}
    assert known.standard_error("F0") < 0.3
    assert known.standard_error("Fya") == np.inf


def test_a_bent_tanh_at_two_speeds_is_not_distinguished_from_a_sign_function() -> None:
    fit = identify(triangles(DEMO, (0.2, 0.4), 0))
    assert {"beta", "delta", "Fya", "Fyb", "Ca_plus", "Ca_minus", "Cb_plus", "Cb_minus"} <= unknown(fit)
    assert "with different yield and viscous forces fit equally well" in fit.parameters["Fyb"].reason


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
def test_a_degenerate_hysteresis_is_warned_of_and_its_parameters_are_not_reported(
    delta: float, make_synthetic: Make
) -> None:
    fit = identify(make_synthetic({**DEMO, "delta": delta, "beta": 20.0}))
    assert {"beta", "delta", "Fya", "Fyb"} <= unknown(fit)
    assert any(text.startswith("degenerate hysteresis") for text in fit.warnings)


def test_a_tanh_without_a_bend_is_called_a_straight_line(make_synthetic: Make) -> None:
    values = {**DEMO, "beta": 0.1, "delta": 0.02, "Fyb": 2000.0}
    tests, names = make_synthetic(values), [name for name in DEMO if name != "eta"]
    known = information(FittedModel(model("asymmetric"), values, tuple(names)), tests, Weighting())
    reasons = explain(model("asymmetric"), known, values, tests, Weighting())
    assert {"beta", "delta", "Fya", "Fyb", "Ca_plus", "Ca_minus"} <= set(reasons)
    assert "linear in these tests (its argument is at most 0.08" in reasons["Fyb"]
