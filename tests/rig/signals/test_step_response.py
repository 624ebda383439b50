"""Response times of simulated plants: dead time and lag known, noise of 5 N, sampling from coarse to fine."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rig.signals.step_response.analysis import step_response
from rig.signals.step_response.lags import Lags
from rig.signals.step_response.onset import onsets
from rig.signals.step_response.records import Record, Seen
from rig.signals.step_response.result import LEVELS, State

NOISE_N, STEP_N = 5.0, 600.0
DRIFT_N_S, LATER_DRIFT_N_S = 120.0, 200.0
"""Of a spring at constant velocity, before the step and after it."""


def records(
    seed: int, lag_s: float, dead_s: float, rate_Hz: float, *, count: int = 5, noise_N: float = NOISE_N,
    step_N: float = STEP_N, window_s: float | None = None, bandwidth_Hz: float | None = None, second_s: float = 0.0,
) -> list[Record]:
    """Steps whose samples lie at another place after each; a second lag behind the first where it is given."""
    rng, length_s, made = np.random.default_rng(seed), window_s or max(0.1, 9.0 * (lag_s + second_s)), []
    for _ in range(count):
        time_s = np.arange(-0.1, length_s, 1.0 / rate_Hz) + rng.uniform(0.0, 1.0 / rate_Hz)
        total_s = lag_s + second_s
        share = Lags(dead_s, total_s, lag_s * second_s / total_s**2).reached(time_s, bandwidth_Hz)
        change_N = step_N + (LATER_DRIFT_N_S - DRIFT_N_S) * time_s
        force_N = -300.0 + DRIFT_N_S * time_s + change_N * share + noise_N * rng.standard_normal(len(time_s))
        made.append(Record(time_s, force_N))
    return made


def truth_s(lag_s: float, dead_s: float) -> list[float]:
    return [dead_s - lag_s * math.log1p(-level) for level in LEVELS]


@pytest.mark.parametrize(("lag_s", "rate_Hz"), [
    (0.001, 250.0), (0.001, 5000.0), (0.005, 1000.0), (0.015, 250.0), (0.03, 250.0), (0.03, 1000.0),
])  # fmt: skip
def test_every_time_lies_within_its_error_and_close_to_the_truth(lag_s: float, rate_Hz: float) -> None:
    seen = step_response(records(7, lag_s, 0.002, rate_Hz))
    assert seen.fits
    assert abs(seen.size - STEP_N) < 4.0 * seen.size_std
    assert seen.noise == pytest.approx(NOISE_N, rel=0.2)
    pairs = [(seen.dead, 0.002), (seen.lag, lag_s), *zip(seen.fit, truth_s(lag_s, 0.002), strict=True)]
    pairs += [pair for pair in zip(seen.crossing, truth_s(lag_s, 0.002), strict=True) if pair[0].measured]
    for time, true_s in pairs:
        assert abs(time.value_s - true_s) < 3.5 * time.std_s
        assert abs(time.value_s - true_s) < max(0.3e-3, 0.05 * true_s)


def test_a_response_between_two_samples_is_determined_by_the_fit_and_not_without_a_model() -> None:
    seen = step_response(records(3, 0.001, 0.002, 250.0))
    assert [time.state for time in seen.crossing] == [State.FASTER] * 3
    assert all(time.limit_s > 0.004 for time in seen.crossing)
    assert seen.lag.measured
    faster = step_response(records(3, 0.0001, 0.002, 250.0))
    assert faster.lag.state is State.FASTER
    assert 0.0001 < faster.lag.limit_s <= 0.004


def test_intervals_contain_the_truth_as_often_as_they_say() -> None:
    """40 plants and 5 quantities; the benchmark response_time.py has 500. One lag is taken for two in 1 %."""
    inside = total = taken_for_two = 0
    for seed in range(40):
        dead_s, lag_s = 0.001 + 0.0001 * seed, 0.004 + 0.0005 * seed
        seen = step_response(records(seed, lag_s, dead_s, 500.0, count=4))
        taken_for_two += seen.order == 2
        for time, true_s in zip(
            (seen.dead, seen.lag, *seen.crossing), (dead_s, lag_s, *truth_s(lag_s, dead_s)), strict=True
        ):
            inside += time.low_s <= true_s <= time.high_s
            total += 1
    assert 0.90 <= inside / total <= 0.99
    assert taken_for_two <= 1


def test_the_sensor_s_filter_is_removed() -> None:
    seen = step_response(records(1, 0.005, 0.003, 1000.0, bandwidth_Hz=50.0), Seen(bandwidth_Hz=50.0))
    blind = step_response(records(1, 0.005, 0.003, 1000.0, bandwidth_Hz=50.0))
    assert seen.lag.value_s == pytest.approx(0.005, rel=0.03)
    assert seen.crossing[0].value_s == pytest.approx(truth_s(0.005, 0.003)[0], abs=2e-4)
    assert abs(blind.lag.value_s - 0.005) > 10.0 * abs(seen.lag.value_s - 0.005)


def test_the_filter_delay_at_low_frequencies_is_removed_from_its_response() -> None:
    """A slow lag behind the filter is that lag: the area between response and end is the lag plus the dead time."""
    time_s = np.linspace(0.0, 3.0, 60_001)
    share = Lags(0.1, 0.2).reached(time_s, 30.0)
    assert float(np.sum(1.0 - share)) * 5e-5 == pytest.approx(0.3, abs=1e-4)
    assert Lags(0.1, 0.2).reached(time_s, 5000.0) == pytest.approx(Lags(0.1, 0.2).reached(time_s, None), abs=1e-3)


@pytest.mark.parametrize(("longer_s", "shorter_s", "window_s", "rate_Hz"), [
    (0.02, 0.005, 0.22, 1000.0), (0.04, 0.008, 0.25, 500.0), (0.012, 0.012, 0.13, 1000.0),
])  # fmt: skip
def test_two_lags_are_distinguished_and_their_times_are_true_in_short_windows(
    longer_s: float, shorter_s: float, window_s: float, rate_Hz: float
) -> None:
    """Coil and fluid in series: one lag would give a t95 that is up to 10 ms off where the window is that short."""
    total_s = longer_s + shorter_s
    plant = Lags(0.002, total_s, longer_s * shorter_s / total_s**2)
    given = records(2, longer_s, 0.002, rate_Hz, second_s=shorter_s, window_s=window_s)
    seen = step_response(given)
    assert (seen.order, seen.fits, seen.overshoots) == (2, True, False)
    results = [(seen.dead, 0.002), (seen.lag, longer_s), (seen.second_lag, shorter_s)]
    for place, level in enumerate(LEVELS):
        true_s = plant.time_to_s(level)
        results += [(time, true_s) for time in (seen.fit[place], seen.crossing[place]) if time.measured]
        assert seen.best(place).value_s == pytest.approx(true_s, rel=0.05)
    for time, true_s in results:
        assert abs(time.value_s - true_s) < 3.5 * time.std_s
    assert seen.settling_s[0] == pytest.approx(0.002 + total_s, abs=4.0 * seen.settling_s[1])


def test_a_response_beyond_its_end_has_no_lags_and_true_times() -> None:
    """Damping ratio 0.6: the overshoot is exp(-pi 0.6 / 0.8) = 9.5 % at the time pi / (omega 0.8)."""
    omega_1_s = 150.0
    plant = Lags(0.002, 1.2 / omega_1_s, 1.0 / 1.2**2)
    peak_s = 0.002 + math.pi / (0.8 * omega_1_s)
    assert plant.reached(np.array([peak_s]))[0] == pytest.approx(1.0 + math.exp(-0.75 * math.pi), rel=1e-9)
    rng, given = np.random.default_rng(3), []
    for _ in range(5):
        time_s = np.arange(-0.1, 0.1, 0.001) + rng.uniform(0.0, 0.001)
        given.append(Record(time_s, 400.0 * plant.reached(time_s) + NOISE_N * rng.standard_normal(len(time_s))))
    seen = step_response(given)
    assert (seen.overshoots, seen.fits, seen.lag.measured) == (True, True, False)
    for place, level in enumerate(LEVELS):
        assert seen.best(place).value_s == pytest.approx(plant.time_to_s(level), abs=3e-4)


def test_chains_of_lags_agree_with_their_limits() -> None:
    """Nearly equal lags are two equal ones, 1 - (1 + t / T) exp(-t / T); a product of 0 is one lag."""
    time_s = np.linspace(0.0, 0.2, 400)
    equal = 1.0 - (1.0 + time_s / 0.01) * np.exp(-time_s / 0.01)
    for product in (0.25, 0.25 - 1e-8, 0.25 + 1e-8):
        assert Lags(0.0, 0.02, product).reached(time_s) == pytest.approx(equal, abs=1e-5)
    assert Lags(0.0, 0.02, 1e-12).reached(time_s) == pytest.approx(Lags(0.0, 0.02).reached(time_s), abs=1e-9)
    assert Lags(0.001, 0.02, 0.2).time_to_s(2.0) == math.inf


def test_a_window_that_is_too_short_is_stated_with_its_limit() -> None:
    seen = step_response(records(1, 0.03, 0.002, 1000.0, window_s=0.08))
    assert {time.state for time in (*seen.fit, *seen.crossing)} == {State.SLOWER}
    assert seen.fit[2].limit_s == pytest.approx(0.08, abs=0.002)


def test_a_step_within_the_noise_says_so() -> None:
    seen = step_response(records(1, 0.015, 0.002, 250.0, step_N=3.0, noise_N=20.0))
    assert "noise" in seen.why
    assert not any(time.measured for time in (seen.dead, seen.lag, *seen.fit, *seen.crossing))


def test_a_noise_that_hides_the_course_of_the_response_says_so() -> None:
    seen = step_response(records(1, 0.015, 0.002, 100.0, step_N=100.0, noise_N=30.0, window_s=0.2))
    assert seen.why == "the noise is too high to show the shape of the response"
    assert not any(time.measured for time in (*seen.fit, *seen.crossing))


def test_a_sensor_with_a_few_steps_of_resolution_says_so_and_one_with_many_is_true() -> None:
    """A current of 1 A in steps of 0.25 A, and of 0.05 A, without noise."""
    rng = np.random.default_rng(0)
    for step, known in ((0.25, False), (0.05, True)):
        given = []
        for _ in range(5):
            time_s = np.arange(-0.1, 0.2, 0.002) + rng.uniform(0.0, 0.002)
            given.append(Record(time_s, np.round(Lags(0.002, 0.012).reached(time_s) / step) * step))
        seen = step_response(given, Seen(drifts=False))
        assert seen.best(0).measured is known
        assert ("resolution" in seen.why) is not known


def test_commands_that_scatter_widen_the_intervals() -> None:
    """Origins that are off by 2 ms: the noise alone would give a tenth of that."""
    steady = records(5, 0.015, 0.003, 1000.0, count=8)
    apart_s = 0.002 * np.random.default_rng(1).standard_normal(8)
    moved = [Record(one.time_s + shift_s, one.value) for one, shift_s in zip(steady, apart_s, strict=True)]
    before, after = step_response(steady), step_response(moved)
    assert (before.scatters, after.scatters) == (False, True)
    assert after.dead.std_s > 3.0 * before.dead.std_s
    assert after.crossing[0].std_s > 2.0 * before.crossing[0].std_s


def test_the_dead_time_of_a_fit_that_does_not_describe_the_response_is_not_stated() -> None:
    """A dip at 30 ms in a lag of 20 ms: no chain of lags has it; t63 is read without a model."""
    time_s = np.arange(-0.03, 0.25, 0.001)
    noise = np.random.default_rng(4)
    course = np.where(time_s > 0.0, 1.0 - np.exp(-np.maximum(time_s, 0.0) / 0.02), 0.0)
    course -= 0.25 * np.exp(-(((time_s - 0.035) / 0.008) ** 2))
    records = [Record(time_s, 500.0 * course + noise.normal(0.0, 2.0, len(time_s))) for _ in range(6)]
    found = step_response(records)
    assert (found.fits, found.scatters, found.dead.state) == (False, False, State.UNKNOWN)
    assert found.method(0) == "crossing"
    assert found.best(0).measured


def test_the_uncertainty_of_the_clocks_is_in_every_time_and_not_in_the_lag() -> None:
    given = records(5, 0.015, 0.003, 1000.0)
    sure, unsure = step_response(given), step_response(given, Seen(time_std_s=0.001))
    assert unsure.lag == sure.lag
    for time, other in ((unsure.dead, sure.dead), (unsure.crossing[1], sure.crossing[1])):
        assert time.std_s == pytest.approx(math.hypot(other.std_s, 0.001))


def test_the_onsets_of_a_current_are_found_step_by_step() -> None:
    """Coil of 40 ms, 10 ms sampling, 2 mA noise: 0.1 ms, although commands are known to 5 ms only."""
    rng, true_s, made = np.random.default_rng(4), [0.004, -0.003, 0.0012, 0.005], []
    for onset_s in true_s:
        time_s = np.arange(-0.2, 0.4, 0.01) + rng.uniform(0.0, 0.01)
        share = Lags(onset_s, 0.04).reached(time_s, None)
        made.append(Record(time_s, share + 0.002 * rng.standard_normal(len(time_s))))
    seen = onsets(made)
    assert seen is not None
    assert seen[0] == pytest.approx(true_s, abs=5e-4)
    assert seen[1] < 2e-4


def test_onsets_between_coarse_samples_are_not_known() -> None:
    """A supply that reports its current every 0.1 s, and a coil of 40 ms: any instant within 0.1 s is possible."""
    rng, made = np.random.default_rng(4), []
    for _ in range(4):
        time_s = np.arange(-0.5, 0.6, 0.1) + rng.uniform(0.0, 0.1)
        made.append(Record(time_s, Lags(0.0, 0.04).reached(time_s, None) + 0.002 * rng.standard_normal(len(time_s))))
    assert onsets(made) is None


def test_records_without_samples_on_one_side_are_not_used() -> None:
    late = Record(np.arange(0.0, 0.1, 0.004), np.ones(25))
    assert step_response([late]).why == "too few samples before or after the step"
