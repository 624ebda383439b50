from __future__ import annotations

import numpy as np
import pytest
from synthetic_rig import SyntheticRig, with_controller_record

from drivers.ring import Channel
from drivers.roles import ProgramPhase
from rig.recording.alignment.alignment import align
from rig.recording.conversion.conversion import build
from rig.recording.journal.journal_file import JournalContent
from rig.recording.layout import SensorContext
from rig.signals.arrays import FloatArray, TimeSeries
from rig.signals.clock_model import by_order
from rig.signals.delay_estimation.cycle_match import CycleStretch, cycle_series, match_cycles
from rig.signals.delay_estimation.delay_model import Seen, Skew, at_likely_compliance, weighed
from rig.signals.delay_estimation.sample_match import Course, Match, match


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
    assert found.skew_std_s < 0.3e-3
    assert found.skew_trusted_s < 10e-6


def test_without_edges_the_signals_tie_the_clocks_at_any_rate() -> None:
    rig = SyntheticRig(frequency_Hz=2.0, cycles=10, edges=False)
    records = with_controller_record(rig, 0.0)
    found = align(records, rig.context(controller_delay_s=0.0))
    assert found.skew_method == "force by signals, displacement by signals"
    assert found.skew_s is None
    assert found.skew_std_s < 0.3e-3
    assert 1e6 * (1.0 / found.timed["displacement"].clock.rate - 1.0) == pytest.approx(-120.0, abs=30.0)


def test_inputs_whose_delay_nobody_stated_move_nothing_and_leave_milliseconds_of_doubt() -> None:
    rig = SyntheticRig(frequency_Hz=2.0, cycles=10)
    found = align(with_controller_record(rig, 0.002), rig.context(controller_delay_s=None))
    assert abs(found.skew_s) < 0.1e-3
    assert not found.skew_checked
    assert 1e-3 < found.skew_std_s < 4e-3
    assert abs(found.skew_s - 0.002) < 2.0 * found.skew_std_s
    assert found.skew_trusted_s < 0.3e-3, "somebody who trusts the sensors' declared delays knows more"


def test_the_lag_of_two_noisy_signals_is_found_within_its_uncertainty() -> None:
    errors = []
    for seed in range(20):
        random = np.random.default_rng(seed)
        time_s = np.arange(0.0, 6.0, 0.004)
        at_s = np.sort(random.uniform(0.1, 5.9, 400))
        lag_s = random.uniform(-4e-3, 4e-3)
        values = 500.0 * np.sin(12.0 * (time_s - lag_s)) + 5.0 * random.standard_normal(len(time_s))
        reference = 480.0 * np.sin(12.0 * at_s) + 30.0 + 10.0 * random.standard_normal(len(at_s))
        found = match(TimeSeries(at_s, reference), TimeSeries(time_s, values), 0.004, reach_s=0.02, with_drift=False)
        assert found is not None
        errors.append((found.lag_s - lag_s) / found.lag_std_s)
    assert np.sqrt(np.mean(np.square(errors))) < 1.6


def jump_signal(time_s: np.ndarray) -> np.ndarray:
    """Force of a damper whose yield changes sign within milliseconds at each reversal, 2 Hz (N)."""
    speed = np.cos(4.0 * np.pi * time_s)
    return 100.0 * speed + 350.0 * np.tanh(18.0 * (speed + 0.05 * np.sign(np.sin(4.0 * np.pi * time_s))))


def laid_over(
    at_s: FloatArray, reference: FloatArray, time_s: FloatArray, values: FloatArray, cycles: CycleStretch | None = None,
) -> Match | None:
    cycles = CycleStretch(0.0, 6.0, 0.5) if cycles is None else cycles
    series = cycle_series(time_s, values, cycles)
    return None if series is None else match_cycles(TimeSeries(at_s, reference), series, cycles, reach_s=0.03)


def test_all_cycles_together_see_the_lag_at_the_reversals_several_times_better_than_sample_by_sample() -> None:
    errors, together_s, single_s = [], [], []
    for seed in range(10):
        random = np.random.default_rng(seed)
        lag_s, began_s = random.uniform(-4e-3, 4e-3), random.uniform(0.0, 0.5)
        time_s, at_s = np.arange(-1.0, 7.0, 0.004), np.arange(random.uniform(0.0, 0.01), 6.0, 0.01)
        values = jump_signal(time_s - lag_s + began_s) + 5.0 * random.standard_normal(len(time_s))
        reference = 0.97 * jump_signal(at_s + began_s) + 30.0 + 10.0 * random.standard_normal(len(at_s))
        found = laid_over(at_s, reference, time_s, values)
        sensor = TimeSeries(time_s, values)
        alone = match(TimeSeries(at_s, reference), sensor, 0.004, reach_s=0.03, with_drift=False, course=Course(0.5))
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
    assert laid_over(time_s, growing, time_s, growing) is None


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
    reference, sensor = TimeSeries(time_s[::3], noise[::3]), TimeSeries(time_s, noise[::-1].copy())
    assert match(reference, sensor, 0.004, reach_s=0.02, with_drift=False) is None


def seen(lag_ms: float | None, std_ms: float = 0.05, declared_ms: float | None = 0.225) -> Seen:
    return Seen(
        None if declared_ms is None else 1e-3 * declared_ms, None if lag_ms is None else 1e-3 * lag_ms, 1e-3 * std_ms,
    )


def both(lag_ms: float | None, std_ms: float = 0.05, other_ms: float = 0.0, input_ms: float | None = 0.0) -> Skew:
    """Force lags by `lag_ms`, displacement by `other_ms`, known to 20 us."""
    return weighed(
        seen(lag_ms, std_ms), seen(other_ms, 0.02, 0.45), None if input_ms is None else 1e-3 * input_ms
    )


def test_a_measurement_that_agrees_leaves_the_declaration_and_one_far_off_replaces_it() -> None:
    assert abs(both(0.05).value_s) < 10e-6
    forgotten = both(2.0)
    assert forgotten.value_s == pytest.approx(2e-3, rel=0.02)
    assert forgotten.std_s == pytest.approx(0.055e-3, rel=0.2)
    between = both(0.3, 0.1)
    assert between.std_s > 0.2e-3, "three standard deviations off: neither certain"


def test_what_is_not_certainly_better_never_moves_the_declaration_and_its_doubt_is_what_the_signals_leave() -> None:
    for lag_ms, std_ms in ((10.9, 5.0), (-15.4, 7.0), (22.1, 9.0), (3.1, 1.6), (80.0, 60.0)):
        weak = both(lag_ms, std_ms)
        assert abs(weak.value_s) < 0.1e-3
        assert weak.std_s > 0.9e-3 * min(np.hypot(lag_ms, std_ms), 10.0)
        low_s, high_s = weak.interval_s
        assert low_s < 1e-3 * lag_ms < high_s


def test_where_the_signals_say_nothing_the_deviation_is_that_of_a_delay_of_which_nothing_is_known() -> None:
    silent = both(None)
    assert abs(silent.value_s) < 0.1e-3
    assert silent.std_s == pytest.approx(10e-3, rel=0.01)
    assert not silent.checked
    assert silent.interval_s is None


@pytest.mark.parametrize(("lag_ms", "std_ms", "state"), [
    (0.0, 0.1, "checked"), (2.0, 0.05, "checked"),
    (4.0, 3.3, "declared"),  # 5 ms late at 0.5 Hz and 0 A: the signals alone leave 6.5 ms open
    (1.62, 0.58, "doubted"),  # triangles, 1.5 ms late: their own interval is 0.48 to 2.76 ms
])
def test_a_declared_delay_is_checked_only_where_the_signals_show_it(lag_ms: float, std_ms: float, state: str) -> None:
    found = both(lag_ms, std_ms)
    assert found.state == state
    assert found.checked is (state == "checked")
    if state == "doubted":
        assert found.trusted_std_s > 1e-3 * lag_ms, "the uncertainty in use covers what the signals say"


@pytest.mark.parametrize("late", ["force input", "position input"])
def test_an_input_that_is_late_is_not_blamed_on_the_sensor_which_cannot_be_early(late: str) -> None:
    found = both(-2.0) if late == "force input" else both(0.0, other_ms=-2.0)
    assert abs(found.value_s) < 0.05e-3
    assert found.std_s > 1.5e-3, "the two disagree by 2 ms, and it is said"


def test_a_load_cell_and_a_displacement_sensor_that_are_late_are_distinguished() -> None:
    force, displacement = both(2.0), both(0.0, other_ms=2.0)
    assert (force.force.value_s, force.displacement.value_s) == pytest.approx((2e-3, 0.0), abs=0.05e-3)
    assert (displacement.force.value_s, displacement.displacement.value_s) == pytest.approx((0.0, 2e-3), abs=0.05e-3)


@pytest.mark.parametrize("input_ms", [0.0, None])
def test_a_delay_that_both_inputs_share_cancels_in_the_skew(input_ms: float | None) -> None:
    found = both(-3.0, other_ms=-3.0, input_ms=input_ms)
    assert abs(found.value_s) < 0.02e-3
    assert found.std_s < (0.1e-3 if input_ms is not None else 1.6e-3)


def test_inputs_without_a_stated_delay_leave_at_least_a_millisecond_open() -> None:
    found = both(0.0, input_ms=None)
    assert found.std_s > 1e-3
    assert not found.checked
    assert found.trusted_std_s < 0.1e-3


def test_errors_stay_within_what_is_stated_whatever_is_forgotten_and_however_little_is_seen() -> None:
    random = np.random.default_rng(3)
    for truth_ms in (0.0, 0.3, 2.0, 10.0):
        errors, deviations = [], []
        for _ in range(400):
            std_ms = float(np.exp(random.uniform(np.log(0.02), np.log(50.0))))
            found = both(truth_ms + std_ms * random.standard_normal(), std_ms)
            errors.append(abs(found.value_s - 1e-3 * truth_ms))
            deviations.append(errors[-1] / found.std_s)
        assert np.mean(np.array(deviations) <= 3.0) >= 0.99
        assert max(deviations) < 5.0
        assert truth_ms > 0.0 or max(errors) < 1e-3


def test_a_compliance_the_signals_cannot_determine_from_a_delay_is_that_of_a_usual_load_train() -> None:
    lag_s, std_s = at_likely_compliance(1e-3, 5e-3, 2e-7, 1e-6, 5e-3 * 1e-6 * 0.999)
    assert std_s < 0.6e-3
    assert abs(lag_s) < 3.0 * std_s
    assert at_likely_compliance(1e-3, 5e-3, None, np.inf, 0.0) == (1e-3, 5e-3)


def test_a_delay_without_any_input_is_as_sure_as_its_statement_and_without_one_as_sure_as_any() -> None:
    stated = weighed(Seen(0.4e-3, input=False), Seen(0.0, input=False), None)
    assert stated.force.std_s == pytest.approx(20e-6)
    assert stated.displacement.std_s < 10e-6, "0 ms that somebody wrote down"
    unstated = weighed(Seen(None, input=False), Seen(0.0, input=False), None)
    assert (unstated.value_s, unstated.checked) == (0.0, False)
    assert unstated.std_s == pytest.approx(0.7e-3, rel=0.01)


@pytest.mark.parametrize(("delay_s", "verdict"), [(0.0, "valid"), (None, "suspect")])
def test_a_skew_that_was_not_checked_says_so_and_covers_what_was_not_stated(
    delay_s: float | None, verdict: str
) -> None:
    rig = SyntheticRig(frequency_Hz=4.0, cycles=10)
    sensors = {
        "force": SensorContext("load_cell", 250.0, delay_s), "displacement": SensorContext("lvdt", 250.0, delay_s),
    }
    content = JournalContent("", with_controller_record(rig, 0.002), end={"stopped_by": None, "lost_records": 0})
    blind, quality = build(content, rig.context(controller_delay_s=None, sensors=sensors))
    checked = quality.verdict
    assert blind.quality["skew_checked"] is False
    assert abs(blind.quality["skew_s"] - 0.002) < 2.0 * blind.quality["skew_std_s"]
    assert checked.verdict == verdict, checked.reasons
    seeing, quality = build(content, rig.context(controller_delay_s=0.0, sensors=sensors))
    checked = quality.verdict
    assert seeing.quality["skew_checked"] is True
    assert abs(seeing.quality["skew_s"] - 0.002) < 1.96 * seeing.quality["skew_std_s"] < 0.4e-3
    assert seeing.quality["skew_low_s"] < 0.002 < seeing.quality["skew_high_s"]
    assert checked.verdict == "valid", checked.reasons


def test_a_declared_delay_is_used_with_its_tolerance() -> None:
    rig = SyntheticRig()
    sensors = {"force": SensorContext("load_cell", 250.0, delay_s=1e-3), "displacement": SensorContext("lvdt", 250.0)}
    assert align(rig.records(), rig.context(sensors=sensors)).skew_std_s == pytest.approx(50e-6, rel=0.1)


@pytest.mark.parametrize("cycles", [3, 4])
def test_of_three_cycles_gain_and_zero_are_compared_too(cycles: int) -> None:
    rig = SyntheticRig(amplitude_m=0.01, frequency_Hz=3.0, cycles=cycles, damping=0.0, stiffness=0.0)
    records = with_controller_record(rig, 0.0)
    phase = rig.status(Channel.PHASE, ProgramPhase.RAMP_IN, 40.0, 0.0, 9)
    turn = 1e-6 * phase["device_us"] - rig.start_s
    phase["value"][turn * rig.frequency_Hz >= 1.0] = ProgramPhase.FULL_AMPLITUDE
    phase["value"][turn * rig.frequency_Hz >= 1.0 + cycles] = ProgramPhase.RAMP_OUT
    records["value"][records["channel"] == Channel.DISPLACEMENT] *= 1.03
    records = np.concatenate((records, phase))
    found = align(records[np.argsort(records["host_ns"], kind="stable")], rig.context(controller_delay_s=0.0))
    sensor = found.timed["displacement"].sensor
    assert sensor is not None
    assert sensor.match is not None
    assert sensor.match.gain == pytest.approx(1.03, abs=4.0 * sensor.match.gain_std)
    assert sensor.match.gain_std < 2e-3
