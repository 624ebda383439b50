"""Where no model describes the tests to their noise, each test counts by its relative error."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import parameter_set
from rig.errors import IdentificationFailed
from rig.identification import Measurement, Method, identify

TRUTH = parameter_set("demo").values


@pytest.fixture
def tests(make_synthetic: Callable[..., list[Measurement]]) -> list[Measurement]:
    """Four tests of the asymmetric model with 5 N of noise."""
    made = make_synthetic(TRUTH, currents_A=(0.0, 2.0), frequencies_Hz=(0.5, 1.5), cycles=2, noise_N=5.0)
    return [replace(test, noise_N=5.0) for test in made]


def _with_stops(tests: list[Measurement]) -> list[Measurement]:
    """Rubber before the ends of the stroke, which the model does not have: up to 400 N in the tests with current."""
    return [replace(test, force_N=test.force_N + 4e4 * test.nominal_current_A * _beyond_m(test)) for test in tests]


def _beyond_m(test: Measurement) -> np.ndarray:
    return np.sign(test.u_m) * np.maximum(np.abs(test.u_m) - 0.6 * np.max(test.u_m), 0.0)


def test_noise_is_weighed_in_newtons(tests: list[Measurement]) -> None:
    fit = identify(tests, model="asymmetric")
    assert fit.weight == "1"
    assert not any("has equal weight" in text for text in fit.warnings)


def test_misfit_is_weighed_by_each_tests_peak_and_reported(tests: list[Measurement]) -> None:
    wrong = _with_stops(tests)
    fit = identify(wrong, model="asymmetric")
    assert fit.weight == "relative"
    assert any("times the measurement noise" in text for text in fit.warnings)
    plain = identify(wrong, model="asymmetric", method=Method(weight="1"))
    assert plain.weight == "1"
    assert fit.error.nrmse_percent_of_peak < plain.error.nrmse_percent_of_peak
    assert fit.error.rmse_N > plain.error.rmse_N


def test_the_relative_objective_is_the_sum_of_squared_relative_errors(tests: list[Measurement]) -> None:
    wrong = [tests[0].rows(slice(0, tests[0].u_m.size // 2)), *_with_stops(tests)[1:]]
    fit = identify(wrong, model="bingham", method=Method(weight="relative"))
    by_hand = 0.0
    for test, error in zip(wrong, fit.error.per_test, strict=True):
        peak_N = np.max(np.abs(test.force_N - np.mean(test.force_N)))
        by_hand += (100.0 * error.rmse_N / peak_N) ** 2
    counted = 1.0 - 4e-3 * 4 * np.pi  # bingham's reversals, 1 ms each side, do not count
    assert fit.objective == pytest.approx(by_hand, rel=1.0 - counted)


def test_where_the_scatter_is_not_known_all_samples_count_identical(tests: list[Measurement]) -> None:
    unknown = [replace(test, noise_N=math.nan) for test in _with_stops(tests)]
    assert identify(unknown, model="asymmetric").weight == "1"


def test_the_papers_algorithms_have_no_relative_weight() -> None:
    with pytest.raises(IdentificationFailed, match="equation"):
        Method("c_foa", weight="relative")


def test_samples_on_a_jump_of_the_model_are_no_misfit(make_synthetic: Callable[..., list[Measurement]]) -> None:
    """Bingham's force at a reversal: which side a sample shows is chance, and 500 N."""
    values, random = parameter_set("demo-bingham").values, np.random.default_rng(2)
    tests = []
    for test in make_synthetic(values, name="bingham", currents_A=(0.0, 2.0), frequencies_Hz=(0.5, 1.5), cycles=2):
        angle, rate = 2.0 * np.pi * test.frequency_Hz, test.amplitude_m * 2.0 * np.pi * test.frequency_Hz
        time_s = np.arange(test.u_m.size) * test.dt_s + 2e-4
        sine, cosine = np.sin(angle * time_s), np.cos(angle * time_s)
        moved = test.moved(test.amplitude_m * sine, rate * cosine, -rate * angle * sine)
        side = np.where(np.abs(moved.v_m_s) < 5e-4 * np.abs(moved.a_m_s2), -1.0, 1.0) * np.sign(cosine)
        yielding_N = values["fc"] + values["fc_b"] * test.current_A
        viscous = values["c0"] + values["c0_b"] * test.current_A
        force_N = yielding_N * side + viscous * moved.v_m_s + values["f0"] + random.normal(0.0, 2.0, side.size)
        tests.append(replace(moved, force_N=force_N, noise_N=2.0))
    fit = identify(tests, model="bingham")
    assert fit.adequate
    assert fit.error.rmse_N > 10.0
    assert fit.weight == "1"
    assert not any("has equal weight" in text for text in fit.warnings)
