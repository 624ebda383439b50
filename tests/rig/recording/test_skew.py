from __future__ import annotations

import numpy as np
import pytest
from synthetic_rig import SyntheticRig, with_controller_record

from rig.recording.alignment import align
from rig.recording.clock_model import by_order
from rig.recording.context import SensorContext
from rig.recording.conversion import build
from rig.recording.cycle_match import Cycles, match_cycles
from rig.recording.journal import JournalContent
from rig.recording.signal_match import match
from rig.recording.skew import pooled, tolerance_s, undeclared


def test_a_delay_nobody_declared_is_found_and_taken_out() -> None:
    rig = SyntheticRig(frequency_Hz=2.0, cycles=10)
    found = align(with_controller_record(rig, 0.002), rig.context(controller_delay_s=0.0))
    assert found.skew_s == pytest.approx(0.002, abs=3 * found.skew_std_s)
    assert found.skew_std_s < 0.2e-3
    force = found.timed["force"]
    lag_s = np.median(force.time_s - (rig.start_s - 0.5 + np.arange(len(force.time_s)) / 250.0 / (1 + 80e-6)))
    assert lag_s == pytest.approx(-0.002, abs=3 * found.skew_std_s)


def test_a_right_declaration_is_kept_to_its_tolerance() -> None:
    rig = SyntheticRig(frequency_Hz=2.0, cycles=10)
    found = align(with_controller_record(rig, 0.0), rig.context(controller_delay_s=0.0))
    assert abs(found.skew_s) < 20e-6
    assert found.skew_std_s < 30e-6


def test_without_edges_the_signals_tie_the_clocks_at_any_rate() -> None:
    rig = SyntheticRig(frequency_Hz=2.0, cycles=10, edges=False)
    records = with_controller_record(rig, 0.0)
    found = align(records, rig.context(controller_delay_s=0.0))
    assert found.skew_method == "force by signals, displacement by signals"
    assert found.skew_s is None
    assert found.skew_std_s < 0.3e-3
    assert 1e6 * (1.0 / found.timed["displacement"].clock.rate - 1.0) == pytest.approx(-120.0, abs=30.0)


def test_a_controller_whose_inputs_are_not_to_be_relied_on_is_not() -> None:
    rig = SyntheticRig(frequency_Hz=2.0, cycles=10)
    found = align(with_controller_record(rig, 0.002), rig.context(controller_delay_s=None))
    assert found.skew_s == 0.0
    assert found.timed["force"].sensor.match is None


def test_the_lag_of_two_noisy_signals_is_found_within_its_uncertainty() -> None:
    errors = []
    for seed in range(20):
        random = np.random.default_rng(seed)
        time_s = np.arange(0.0, 6.0, 0.004)
        at_s = np.sort(random.uniform(0.1, 5.9, 400))
        lag_s = random.uniform(-4e-3, 4e-3)
        values = 500.0 * np.sin(12.0 * (time_s - lag_s)) + 5.0 * random.standard_normal(len(time_s))
        reference = 480.0 * np.sin(12.0 * at_s) + 30.0 + 10.0 * random.standard_normal(len(at_s))
        found = match(at_s, reference, time_s, values, 0.004, reach_s=0.02, with_drift=False)
        assert found is not None
        errors.append((found.lag_s - lag_s) / found.lag_std_s)
    assert np.sqrt(np.mean(np.square(errors))) < 1.6


def jump_signal(time_s: np.ndarray) -> np.ndarray:
    """Force of a damper whose yield changes sign within milliseconds at each reversal, 2 Hz (N)."""
    speed = np.cos(4.0 * np.pi * time_s)
    return 100.0 * speed + 350.0 * np.tanh(18.0 * (speed + 0.05 * np.sign(np.sin(4.0 * np.pi * time_s))))


def test_all_cycles_together_see_the_lag_at_the_reversals_several_times_better_than_sample_by_sample() -> None:
    errors, together_s, single_s = [], [], []
    for seed in range(10):
        random = np.random.default_rng(seed)
        lag_s, began_s = random.uniform(-4e-3, 4e-3), random.uniform(0.0, 0.5)
        time_s, at_s = np.arange(-1.0, 7.0, 0.004), np.arange(random.uniform(0.0, 0.01), 6.0, 0.01)
        values = jump_signal(time_s - lag_s + began_s) + 5.0 * random.standard_normal(len(time_s))
        reference = 0.97 * jump_signal(at_s + began_s) + 30.0 + 10.0 * random.standard_normal(len(at_s))
        found = match_cycles(at_s, reference, time_s, values, Cycles(0.0, 6.0, 0.5), reach_s=0.03)
        alone = match(at_s, reference, time_s, values, 0.004, reach_s=0.03, with_drift=False, cycle_s=0.5)
        assert found is not None
        assert alone is not None
        errors.append((found.lag_s - lag_s) / found.lag_std_s)
        together_s.append(found.lag_s - lag_s)
        single_s.append(alone.lag_s - lag_s)
    assert np.sqrt(np.mean(np.square(together_s))) < 60e-6
    assert np.std(together_s) < 0.5 * np.std(single_s)
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 1.5


def test_cycles_that_differ_are_not_taken_together() -> None:
    time_s = np.arange(0.0, 6.0, 0.004)
    growing = (1.0 + 0.2 * time_s) * np.sin(4.0 * np.pi * time_s)
    assert match_cycles(time_s, growing, time_s, growing, Cycles(0.0, 6.0, 0.5), reach_s=0.03) is None


def test_on_a_fast_rig_the_ecus_clock_is_known_to_a_fraction_of_its_period_by_what_came_before_each_status() -> None:
    random = np.random.default_rng(4)
    # 20 times real time: the rig moves on in steps of 40 ms, and sends what is due when a step is done.
    steps_s = np.arange(0.0, 10.0, 0.04)
    frames_s = np.arange(0.0034, 9.9, 0.01)
    sent_s = steps_s[np.searchsorted(steps_s, frames_s)] / 20.0 + random.exponential(2e-4, len(frames_s))
    polls_s = np.sort(random.uniform(0.01, 0.49, 60))
    clock_s = steps_s[np.searchsorted(steps_s, 20.0 * polls_s) - 1]
    arrival_ns = np.round(1e9 * (polls_s + random.exponential(3e-4, len(polls_s)))).astype(np.int64)
    sent_ns = np.round(1e9 * np.maximum.accumulate(sent_s)).astype(np.int64)
    found = by_order(frames_s - 3.0, sent_ns, clock_s, arrival_ns)
    assert found is not None
    error_s = found.time_s(np.array([2.0]))[0] - 5.0
    assert abs(error_s) < 1.96 * found.std_s
    assert found.std_s < 0.006


def test_what_does_not_move_cannot_be_matched() -> None:
    time_s = np.arange(0.0, 2.0, 0.004)
    noise = np.random.default_rng(0).standard_normal(len(time_s))
    assert match(time_s[::3], noise[::3], time_s, noise[::-1].copy(), 0.004, reach_s=0.02, with_drift=False) is None


def test_a_measurement_that_agrees_leaves_the_declaration_and_one_far_off_replaces_it() -> None:
    tolerance = tolerance_s(0.4e-3)
    agreed = undeclared(tolerance, 0.1e-3, 0.1e-3)
    assert abs(agreed.value_s) < 30e-6
    forgotten = undeclared(tolerance, 2e-3, 0.1e-3)
    assert forgotten.value_s == pytest.approx(2e-3, rel=0.01)
    assert forgotten.std_s == pytest.approx(0.1e-3, rel=0.05)
    between = undeclared(tolerance, 0.35e-3, 0.1e-3)
    assert between.std_s > 0.1e-3


def test_a_weak_measurement_that_contradicts_the_declaration_leaves_doubt_and_not_the_declarations_tolerance() -> None:
    tolerance = tolerance_s(0.2e-3)
    doubtful = undeclared(tolerance, 2e-3, 0.6e-3)
    assert doubtful.checked
    assert doubtful.std_s > 20.0 * tolerance
    assert abs(doubtful.value_s - 2e-3) < 1.96 * doubtful.std_s


def test_a_weak_measurement_leaves_the_doubt_it_leaves_and_no_gap_between_weak_and_not_weak() -> None:
    tolerance = tolerance_s(0.0)
    weak = undeclared(tolerance, 2.0e-3, 1.1e-3)
    assert weak.checked
    assert weak.std_s > 0.2e-3
    last_s = 0.0
    for measured_s in np.linspace(0.0, 4e-3, 200):
        found = undeclared(tolerance, measured_s, 1.1e-3)
        assert 0.0 <= found.value_s - last_s < 0.1e-3
        last_s = found.value_s


def test_stated_standard_deviations_of_weakly_measured_delays_are_their_errors_over_the_prior() -> None:
    random, tolerance = np.random.default_rng(3), tolerance_s(0.3e-3)
    errors_s, stated_s = [], []
    for _ in range(20_000):
        width_s = random.choice([tolerance, 0.5e-3, 5e-3], p=[0.96, 0.02, 0.02])
        delay_s, std_s = width_s * random.standard_normal(), random.uniform(0.4e-3, 2e-3)
        found = undeclared(tolerance, delay_s + std_s * random.standard_normal(), std_s)
        errors_s.append(found.value_s - delay_s)
        stated_s.append(found.std_s)
    assert np.sqrt(np.mean(np.square(errors_s))) == pytest.approx(np.sqrt(np.mean(np.square(stated_s))), rel=0.1)


def test_a_delay_nobody_could_measure_is_as_sure_as_its_statement_and_without_one_as_sure_as_any() -> None:
    assert undeclared(tolerance_s(0.4e-3), None, 0.0).std_s == pytest.approx(20e-6)
    assert undeclared(tolerance_s(0.0), None, 0.0).std_s < 10e-6, "0 ms that somebody wrote down"
    nobody = undeclared(tolerance_s(None), None, 0.0, stated=False)
    assert (nobody.value_s, nobody.checked) == (0.0, False)
    assert nobody.std_s == pytest.approx(0.71e-3, rel=0.01)


@pytest.mark.parametrize(("delay_s", "std_s"), [(0.0, 3e-6), (None, 1e-3)])
def test_a_skew_that_was_not_checked_says_so_and_covers_what_was_not_stated(
    delay_s: float | None, std_s: float
) -> None:
    rig = SyntheticRig(frequency_Hz=4.0, cycles=10)
    sensors = {
        "force": SensorContext("load_cell", 250.0, delay_s), "displacement": SensorContext("lvdt", 250.0, delay_s),
    }
    content = JournalContent("", with_controller_record(rig, 0.002), end={"stopped_by": None, "lost_records": 0})
    blind, _, verdict = build(content, rig.context(controller_delay_s=None, sensors=sensors))
    assert blind.quality["skew_checked"] is False
    assert blind.quality["skew_std_s"] == pytest.approx(std_s, rel=0.5)
    assert verdict.verdict == ("valid" if delay_s is not None else "suspect"), verdict.reasons
    seeing, _, verdict = build(content, rig.context(controller_delay_s=0.0, sensors=sensors))
    assert seeing.quality["skew_checked"] is True
    assert abs(seeing.quality["skew_s"] - 0.002) < 1.96 * seeing.quality["skew_std_s"] < 0.4e-3
    assert verdict.verdict == "valid"


def test_points_of_one_sensor_are_taken_together() -> None:
    mean, std = pooled([(1e-3, 1e-4), (1.2e-3, 1e-4), (0.8e-3, 1e-4), (1e-3, 1e-4)])
    assert mean == pytest.approx(1e-3)
    assert 0.5e-4 <= std < 1.5e-4
    assert pooled([]) is None


def test_a_declared_delay_is_used_with_its_tolerance() -> None:
    rig = SyntheticRig()
    sensors = {"force": SensorContext("load_cell", 250.0, delay_s=1e-3), "displacement": SensorContext("lvdt", 250.0)}
    assert align(rig.records(), rig.context(sensors=sensors)).skew_std_s == pytest.approx(50e-6, rel=0.1)
