"""Intervals: how often they cover the truth, and what widens them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.identification import Measurement
from rig.identification.models.model_slope import FittedModel
from rig.identification.models.projection import Weighting
from rig.identification.models.separable import solve_separable
from rig.identification.options import DeclaredErrors
from rig.identification.uncertainty.covariance import Information, information, quantile

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)
NAMES = [name for name in model("asymmetric").names if name != "eta"]
SHAPE = np.array([50.0, 1.0])


def thinned(each: Measurement, every: int) -> Measurement:
    sampled = {name: getattr(each, name)[::every] for name in ("u_m", "v_m_s", "a_m_s2", "force_N", "current_A")}
    return replace(each, **sampled, dt_s=every * each.dt_s, samples_per_cycle=0)


def known(tests: list[Measurement], weight: str = "1", declared: DeclaredErrors | None = None) -> Information:
    weighting = Weighting("v" if weight == "v" else "1")
    found = solve_separable(tests, model("asymmetric"), weighting, start=SHAPE)
    return information(FittedModel(model("asymmetric"), found.values, tuple(NAMES)), tests, weighting, declared)


@pytest.mark.parametrize("weight", ["1", "v"])
def test_intervals_cover_the_truth_as_often_as_they_say(weight: str, make_synthetic: Make) -> None:
    weighting = Weighting("v" if weight == "v" else "1")
    trials, inside, together = 40, 0, 0
    for seed in range(trials):
        tests = make_synthetic(DEMO, (0.0, 1.0, 2.0), (1.0, 2.0), seed=100 + seed)
        found = solve_separable(tests, model("asymmetric"), weighting, start=SHAPE)
        known_values = information(FittedModel(model("asymmetric"), found.values, tuple(NAMES)), tests, weighting)
        errors = np.array([(found.values[name] - DEMO[name]) / known_values.standard_error(name) for name in NAMES])
        inside += int(np.sum(np.abs(errors) < quantile()))
        together += bool(np.all(np.abs(errors) < quantile(len(NAMES))))
    assert 0.91 < inside / (trials * len(NAMES)) < 0.985
    assert together >= 34  # of 40 with 95 %: fewer has a probability below 1 in 1,000


def test_few_samples_pay_for_the_parameters_fitted_to_them(make_synthetic: Make) -> None:
    inside = 0
    for seed in range(60):
        tests = make_synthetic(DEMO, (0.0, 2.0), (1.0, 2.0), seed=seed, cycles=1)
        few = [thinned(each, 24) for each in tests]
        assert sum(each.u_m.size for each in few) < 3 * len(NAMES)
        known_values, found = known(few), solve_separable(few, model("asymmetric"), start=SHAPE).values
        errors = np.array([(found[name] - DEMO[name]) / known_values.standard_error(name) for name in NAMES])
        inside += int(np.sum(np.abs(errors) < quantile(1, known_values.freedom)))
    assert inside / (60 * len(NAMES)) > 0.9


def test_quantiles_are_those_of_the_tables() -> None:
    assert quantile() == pytest.approx(1.959964, abs=1e-6)
    assert quantile(12) == pytest.approx(2.865, abs=1e-3)
    assert quantile(1, 30.0) == pytest.approx(2.0423, abs=2e-4)


def test_skew_left_in_the_data_widens_the_intervals(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0))
    skewed = [replace(test, skew_std_s=1e-3) for test in tests]
    assert known(skewed).standard_error("m") > 10.0 * known(tests).standard_error("m")


def test_a_skew_moves_the_estimate_by_what_the_interval_allows(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0), noise_N=0.5)
    lag_s = 2e-4
    late = [
        replace(
            test,
            force_N=np.interp(np.arange(test.u_m.size) - lag_s / test.dt_s, np.arange(test.u_m.size), test.force_N),
        )
        for test in tests
    ]
    moved = solve_separable(late, model("asymmetric"), start=SHAPE).values["m"] - DEMO["m"]
    known_values = known([replace(test, skew_std_s=lag_s) for test in tests]).standard_error("m")
    assert abs(moved) == pytest.approx(known_values, rel=0.35)


def test_a_gain_error_widens_each_force_by_its_share(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0), noise_N=0.01)
    known_values = known(tests, declared=DeclaredErrors(force_gain=0.01))
    assert known_values.standard_error("Fyb") == pytest.approx(0.01 * DEMO["Fyb"], rel=0.01)
    assert known_values.standard_error("F0") == pytest.approx(0.01 * abs(DEMO["F0"]), rel=0.01)
    scaled = known(tests, declared=DeclaredErrors(displacement_gain=0.01))
    assert scaled.standard_error("Ca_plus") == pytest.approx(0.01 * DEMO["Ca_plus"], rel=0.2)


def test_correlated_residuals_widen_the_intervals(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0), noise_N=0.0)
    rng = np.random.default_rng(2)
    slow = [
        replace(
            test,
            force_N=test.force_N
            + np.convolve(rng.normal(0.0, 5.0, test.u_m.size + 19), np.ones(20) / 20**0.5, "valid"),
        )
        for test in tests
    ]
    assert np.mean([each.widening for each in known(slow).residuals]) > 8.0


def test_more_cycles_of_the_same_misfit_do_not_narrow_the_intervals(make_synthetic: Make) -> None:
    def errors(cycles: int) -> np.ndarray:
        tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0), cycles=cycles, noise_N=0.1)
        curved = [replace(test, force_N=test.force_N + 900.0 * test.v_m_s**3) for test in tests]
        known_values = known(curved)
        return np.array([known_values.standard_error(name) for name in NAMES])

    assert errors(24) == pytest.approx(errors(6), rel=0.25)


def test_a_parameter_off_the_solution_is_reported_by_how_much(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0))
    found = solve_separable(tests, model("asymmetric"), start=SHAPE).values
    beside = FittedModel(model("asymmetric"), {**found, "F0": found["F0"] + 3.0}, tuple(NAMES))
    off = information(beside, tests, Weighting())
    assert off.step[NAMES.index("F0")] == pytest.approx(-3.0, rel=0.01)
    assert np.max(np.abs(known(tests).step) / np.sqrt(np.diag(known(tests).covariance))) < 0.01
