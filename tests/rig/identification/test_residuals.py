"""Residuals: noise and repeating misfit told apart, white or not at the right rate."""

from collections.abc import Callable

import numpy as np
import pytest

from rig.identification.models.measurement import samples_a_cycle
from rig.identification.uncertainty.residuals import Residual, assess_residual, autocovariance, correlated

PERIOD, CYCLES = 125.3, 8
TIME = np.arange(round(PERIOD * CYCLES))
ALL = np.ones(TIME.size, dtype=bool)
U = 0.05 * np.sin(2.0 * np.pi * (TIME + 0.4) / PERIOD)
BUMP = np.exp(-(((TIME % PERIOD) - 40.0) ** 2) / 50.0)


def residual_of(values: np.ndarray) -> Residual:
    return assess_residual(values, ALL, U, 0.004)


def smooth(values: np.ndarray, length: int) -> np.ndarray:
    return np.convolve(values, np.ones(length) / length**0.5, "valid")


def test_white_noise_is_white_and_one_fit_in_a_hundred_at_most_is_accused() -> None:
    rng = np.random.default_rng(5)
    fits = [[residual_of(rng.normal(0.0, 5.0, TIME.size)) for _ in range(9)] for _ in range(60)]
    assert sum(bool(correlated(fit)) for fit in fits) <= 5
    assert np.mean([each.widening for fit in fits for each in fit]) < 1.1
    assert np.mean([each.noise_N for fit in fits for each in fit]) == pytest.approx(5.0, rel=0.01)
    probabilities = np.array([each.portmanteau_p for fit in fits for each in fit])
    assert 0.4 < np.mean(probabilities) < 0.6


def test_a_misfit_far_below_the_noise_is_seen_because_it_repeats() -> None:
    rng = np.random.default_rng(2)
    found = residual_of(rng.normal(0.0, 5.0, TIME.size) + 8.0 * BUMP)
    assert found.repeating_N == pytest.approx(8.0 * np.sqrt(np.mean(BUMP**2)), rel=0.25)
    assert found.noise_N == pytest.approx(5.0, rel=0.05)
    assert found.widening > 4.0
    assert correlated([found]) == [0]


def test_noise_slower_than_the_sampling_widens_but_is_no_misfit() -> None:
    rng = np.random.default_rng(3)
    filtered = [residual_of(smooth(rng.normal(0.0, 5.0, TIME.size + 5), 6)) for _ in range(20)]
    assert len(correlated(filtered)) <= 1
    assert np.mean([each.widening for each in filtered]) == pytest.approx(6.0, rel=0.3)
    assert np.median([each.memory_s for each in filtered]) == pytest.approx(6 * 0.004, abs=0.009)


@pytest.mark.parametrize("factory", [np.zeros, lambda n: np.r_[np.zeros(n - 1), 1.0]])
def test_a_residual_without_noise_or_nearly_so_is_evaluated_without_a_failure(
    factory: Callable[[int], np.ndarray],
) -> None:
    found = residual_of(factory(TIME.size))
    assert found.widening >= 1.0
    assert np.isfinite([found.noise_N, found.repeating_N, found.memory_s]).all()


def test_samples_that_do_not_count_change_nothing() -> None:
    rng = np.random.default_rng(4)
    noise = rng.normal(0.0, 5.0, TIME.size) + 8.0 * BUMP
    counting = rng.random(TIME.size) > 0.05
    spoiled = np.where(counting, noise, 1e6)
    expected = pytest.approx(residual_of(noise).repeating_N, rel=0.15)
    assert assess_residual(spoiled, counting, U, 0.004).repeating_N == expected


def test_cycles_are_counted_without_rounding() -> None:
    assert samples_a_cycle(U) == pytest.approx(PERIOD, rel=1e-4)
    assert samples_a_cycle(np.ones(50)) == 50.0


def test_autocovariance_is_the_sum_of_products() -> None:
    rng = np.random.default_rng(6)
    values = rng.normal(size=40)
    gamma, pairs = autocovariance(values, 1.0)
    assert pairs[7] == 33
    assert gamma[7] == pytest.approx(np.mean(values[7:] * values[:-7]))


@pytest.mark.parametrize("cycles", [20, 40, 70])
def test_a_force_that_drifts_counts_as_what_repeats_in_neighbouring_cycles(cycles: int) -> None:
    """Over the whole test, the autocovariances of a drift without its mean add up to nearly zero."""
    time = np.arange(100 * cycles)
    drift = 20.0 * np.sin(2.0 * np.pi * time / 100) * np.linspace(-1.0, 1.0, time.size)
    values = drift + np.random.default_rng(4).normal(0.0, 5.0, time.size)
    residual = assess_residual(values, np.ones(time.size, bool), 0.05 * np.sin(2.0 * np.pi * (time + 0.4) / 100), 0.004)
    assert residual.repeating_N == pytest.approx(float(np.sqrt(np.mean(drift**2))), rel=0.25)
    assert residual.widening > cycles / 2
