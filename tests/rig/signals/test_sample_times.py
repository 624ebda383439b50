"""A uniform rate behind stamps with few digits is found, and stamps that are right are left alone."""

from __future__ import annotations

import numpy as np
import pytest

from rig.signals.sample_times import TimeBase, sample_times


def errors_s(found_s: np.ndarray, true_s: np.ndarray) -> float:
    """Largest error of the times about their mean error: a record's beginning is its own."""
    left = found_s - (true_s - true_s[0])
    return float(np.max(np.abs(left - np.mean(left))))


@pytest.mark.parametrize("rate_Hz", [96.0, 137.31, 400.0, 441.7, 1024.0, 2000.0, 5000.0])
@pytest.mark.parametrize("step_s", [1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("cut", [np.round, np.floor])
def test_a_rate_of_any_size_is_found_behind_stamps_of_any_digits(rate_Hz: float, step_s: float, cut: np.ufunc) -> None:
    true_s = 7.3 + 0.37 / rate_Hz + np.arange(1500) / rate_Hz
    found = sample_times(cut(true_s / step_s) * step_s)
    assert found.std_s == 0.0
    assert errors_s(found.time_s, true_s) < 0.02 * step_s
    assert found.rate_Hz == pytest.approx(rate_Hz, rel=0.05 * step_s * rate_Hz / 1500)


def test_the_rate_of_a_long_record_is_as_exact_as_it_is_long() -> None:
    true_s = np.arange(200_000) / 441.7
    assert sample_times(np.round(true_s, 3)).rate_Hz == pytest.approx(441.7, rel=1e-9)


def test_times_that_are_uniform_or_too_few_stay_as_they_are_bit_for_bit() -> None:
    for stamps_s in (np.arange(500) * 0.01, 3.0 + np.arange(500) / 3.0, np.array([0.0, 0.1, 0.3])):
        found = sample_times(stamps_s)
        assert found.base is TimeBase.AS_READ
        assert np.array_equal(found.time_s, stamps_s - stamps_s[0])
        assert found.description == ""


def test_missing_rows_stay_missing_and_a_pause_of_any_length_stays_a_pause() -> None:
    true_s = np.arange(2000) / 400.0
    kept = np.ones(2000, bool)
    kept[500:503] = kept[900] = kept[1200:1700] = False
    found = sample_times(np.round(true_s[kept], 3))
    assert found.base is TimeBase.ROUNDED
    assert errors_s(found.time_s, true_s[kept]) < 1e-5
    paused_s = np.where(np.arange(2000) < 1000, true_s, true_s + 0.31337)
    found = sample_times(np.round(paused_s, 3))
    assert found.base is TimeBase.ROUNDED
    assert errors_s(found.time_s, paused_s) < 5e-4  # the pause itself is known to the printing step


def test_single_precision_and_fixed_digits_are_few_digits_too() -> None:
    true_s = np.arange(80_000) / 1234.5
    for stamps_s in (true_s.astype(np.float32).astype(float), 1e-3 * (1e3 * true_s).astype(np.float32).astype(float)):
        found = sample_times(stamps_s)
        assert found.base is TimeBase.ROUNDED
        assert errors_s(found.time_s, true_s) < 1e-8
    slow_s = np.arange(2000) * 0.0925
    found = sample_times(np.array([float(f"{value:.5g}") for value in slow_s]))
    assert found.base is TimeBase.ROUNDED
    assert errors_s(found.time_s, slow_s) < 2e-4


def test_the_signal_decides_between_a_jittering_clock_and_samples_taken_irregularly() -> None:
    random, uniform_s = np.random.default_rng(0), np.arange(2000) / 400.0
    jittered_s = np.sort(uniform_s + random.normal(0.0, 3e-4, 2000))

    def signal(at_s: np.ndarray) -> np.ndarray:
        return np.sin(4.0 * np.pi * at_s) + random.normal(0.0, 1e-4, at_s.size)

    clock = sample_times(jittered_s, (signal(uniform_s),))
    assert (clock.base, clock.std_s) == (TimeBase.JITTER, 0.0)
    assert errors_s(clock.time_s, uniform_s) < 1e-4
    samples = sample_times(jittered_s, (signal(jittered_s),))
    assert (samples.base, samples.std_s) == (TimeBase.IRREGULAR, 0.0)
    assert np.array_equal(samples.time_s, jittered_s - jittered_s[0])
    unknown = sample_times(jittered_s, (random.normal(0.0, 1.0, 2000),))
    assert unknown.base is TimeBase.IRREGULAR
    assert unknown.std_s == pytest.approx(3e-4, rel=0.1)


def test_equal_stamps_of_samples_that_are_no_uniform_rate_are_left_to_be_refused() -> None:
    stamps_s = np.arange(500) * 0.01
    doubled = np.insert(stamps_s, 250, stamps_s[250])
    found = sample_times(doubled)
    assert found.base is TimeBase.AS_READ
    assert np.array_equal(found.time_s, doubled)
    one_missing = np.delete(stamps_s, 250)
    assert np.array_equal(sample_times(one_missing).time_s, one_missing)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("lost", [slice(0), slice(700, 721)])
def test_a_clock_that_jitters_by_much_of_a_period_does_not_change_the_rate(seed: int, lost: slice) -> None:
    """Its long steps were taken for missing rows, and the stretches between them, without any, gave 206 Hz for 200."""
    generator = np.random.default_rng(seed)
    true_s = np.arange(1600) / 200.0
    stamps_s = np.round(np.maximum.accumulate(true_s + 0.0015 * generator.standard_normal(1600)), 6)
    true_s, stamps_s = np.delete(true_s, lost), np.delete(stamps_s, lost)
    noise = 1e-4 * generator.standard_normal((2, true_s.size))
    signals = (np.sin(9.4 * true_s) + noise[0], np.cos(9.4 * true_s) + noise[1])
    found = sample_times(stamps_s, signals)
    assert found.base is TimeBase.JITTER
    assert found.rate_Hz == pytest.approx(200.0, rel=2e-4)


def test_the_signal_decides_between_missing_rows_at_equal_distances_and_a_lower_rate_that_is_rounded() -> None:
    """Every tenth row missing at 1 kHz leaves the stamps of 900 Hz in ms."""
    kept_s = np.arange(5000) / 1000.0
    kept_s = kept_s[np.arange(5000) % 10 != 7]
    lower_s = np.arange(4500) / 900.0
    noise = 1e-4 * np.random.default_rng(3).standard_normal(4500)
    found = sample_times(kept_s, (np.sin(9.4 * kept_s) + noise,))
    assert found.base is TimeBase.AS_READ
    assert np.array_equal(found.time_s, kept_s)
    found = sample_times(np.floor(1000.0 * lower_s) / 1000.0, (np.sin(9.4 * lower_s) + noise,))
    assert found.base is TimeBase.ROUNDED
    assert found.rate_Hz == pytest.approx(900.0, rel=1e-4)


@pytest.mark.parametrize("rate_Hz", [50.0, 200.0, 333.0])
@pytest.mark.parametrize("begin_s", [0.0, 0.31])
@pytest.mark.parametrize("length_s", [4.0, 6.0, 9.4])
def test_stamps_in_whole_seconds_give_the_rate_of_a_short_record(
    rate_Hz: float, begin_s: float, length_s: float
) -> None:
    """The least squares tilted: 205.7 Hz for 200 Hz in 6 s, which is 2.8 % of every speed."""
    true_s = begin_s + np.arange(round(length_s * rate_Hz)) / rate_Hz
    found = sample_times(np.floor(true_s))
    assert found.base is TimeBase.ROUNDED
    assert found.rate_Hz == pytest.approx(rate_Hz, rel=0.3 / rate_Hz)
