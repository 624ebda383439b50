"""Current that is not what was wanted: passing sags, sags that come back, steps at wrong levels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_rig import SyntheticRig

from drivers.ring import Channel
from rig.recording.conversion.conversion import build
from rig.recording.journal.journal_file import JournalContent
from rig.recording.point_attributes import Commanded
from rig.recording.quality.verdict import Verdict
from rig.signals.current_error import law_error_A, loop_error_A, program_error_A, steps_error_A

TIME_S = np.arange(0.0, 10.0, 0.004)
STARTS_S = np.arange(11.0)
LEVELS_A = (0.0, 1.0, 0.0, 2.0, 0.5, 1.5, 0.0)
HOLD_S = 0.6


def test_a_sag_over_some_of_the_cycles_is_not_outvoted_by_the_others() -> None:
    current_A = 1.5 - 0.3 * ((TIME_S > 3.0) & (TIME_S < 7.0))
    assert loop_error_A(TIME_S, current_A, 1.5, STARTS_S) == pytest.approx(0.3)


def test_a_sag_of_a_single_cycle_is_seen() -> None:
    current_A = 1.5 - 0.3 * ((TIME_S >= 3.0) & (TIME_S < 4.0))
    assert loop_error_A(TIME_S, current_A, 1.5, STARTS_S) == pytest.approx(0.3)


def test_a_sag_at_the_same_phase_of_every_cycle_is_seen() -> None:
    current_A = 1.5 - 0.3 * ((TIME_S % 1.0 > 0.3) & (TIME_S % 1.0 < 0.6))
    assert loop_error_A(TIME_S, current_A, 1.5, STARTS_S) == pytest.approx(0.3)


@pytest.mark.parametrize(("length_s", "expected_A"), [(0.28, 0.09), (0.1, 0.09), (0.04, 0.0)])
def test_a_sag_over_a_part_of_a_cycle_is_seen_and_a_spike_is_not(length_s: float, expected_A: float) -> None:
    """A supply that gave 0.21 A in place of 0.3 A for 0.28 s of 10 s."""
    current_A = 0.3 - 0.09 * ((TIME_S >= 3.4) & (3.4 + length_s > TIME_S))
    assert loop_error_A(TIME_S, current_A, 0.3, STARTS_S) == pytest.approx(expected_A)


def test_noise_about_the_right_current_is_no_error() -> None:
    current_A = 1.5 + 0.012 * np.random.default_rng(1).standard_normal(len(TIME_S))
    current_A[::7] = np.nan
    error_A = loop_error_A(TIME_S, current_A, 1.5, STARTS_S)
    assert error_A is not None
    assert error_A < 0.012


def test_no_current_is_no_statement() -> None:
    assert loop_error_A(TIME_S, np.full(len(TIME_S), np.nan), 1.5, STARTS_S) is None


def staircase(levels_A: tuple[float, ...], lag_s: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """Time, and current that follows the levels with a lag."""
    time_s = np.arange(0.0, len(levels_A) * HOLD_S, 0.004)
    held = np.array(levels_A)[np.minimum(time_s / HOLD_S, len(levels_A) - 1).astype(int)]
    current_A = np.empty(len(time_s))
    at_A = levels_A[0]
    for row, target_A in enumerate(held):
        at_A += (target_A - at_A) * (1.0 - np.exp(-0.004 / lag_s))
        current_A[row] = at_A
    return time_s, current_A


def test_a_staircase_of_many_levels_with_one_maximum_is_right() -> None:
    time_s, current_A = staircase(LEVELS_A)
    assert steps_error_A(time_s, current_A, LEVELS_A, HOLD_S) < 1e-3
    many_A = (*(0.1 * n for n in range(15)), 3.0, 0.0)
    time_s, current_A = staircase(many_A)
    assert steps_error_A(time_s, current_A, many_A, HOLD_S) < 1e-3


@pytest.mark.parametrize("wrong", range(len(LEVELS_A)))
def test_a_wrong_level_is_seen_wherever_it_stands(wrong: int) -> None:
    time_s, current_A = staircase(LEVELS_A)
    current_A[(time_s >= wrong * HOLD_S) & (time_s < (wrong + 1) * HOLD_S)] += 0.1
    assert steps_error_A(time_s, current_A, LEVELS_A, HOLD_S) == pytest.approx(0.1, abs=1e-3)


def test_holds_of_uneven_length_are_distinguished_by_the_current_itself() -> None:
    time_s, current_A = staircase((0.0, 1.0, 0.3, 2.0))
    uneven_s = np.interp(time_s, [0.0, 0.6, 1.2, 1.8, 2.4], [0.0, 0.55, 1.2, 1.45, 2.4])
    assert steps_error_A(uneven_s, current_A, (0.0, 1.0, 0.3, 2.0), HOLD_S) < 5e-3
    assert steps_error_A(uneven_s, current_A, (0.0, 1.0, 0.4, 2.0), HOLD_S) == pytest.approx(0.1, abs=5e-3)


def test_a_hold_cut_short_is_evaluated_by_the_level_its_current_was_on_its_way_to() -> None:
    time_s, current_A = staircase((0.0, 1.0, 0.3, 2.0))
    begun = time_s < 3.0 * HOLD_S + 0.1 * HOLD_S + 0.1
    for right_A, low_A, high_A in ((2.0, 0.0, 0.02), (1.9, 0.08, 0.12)):
        error_A = steps_error_A(time_s[begun], current_A[begun], (0.0, 1.0, 0.3, right_A), HOLD_S)
        assert low_A <= error_A < high_A, "0.16 s of 0.6 s, settling with 20 ms"


@pytest.mark.parametrize("hold_s", [0.2, 0.3, 0.5])
@pytest.mark.parametrize("wrong_A", [0.0, 0.06])
def test_the_begin_of_the_next_step_is_no_part_of_a_slow_coils_level(hold_s: float, wrong_A: float) -> None:
    """A coil of 40 ms crosses half of a step 28 ms after it; samples every 10 ms with 3 mA of noise."""
    time_s, current_A = staircase((0.0, 1.0, 0.2, 0.9), lag_s=0.04 * HOLD_S / hold_s)
    time_s = time_s * hold_s / HOLD_S
    sampled_s = np.arange(0.0, time_s[-1], 0.01)
    noise_A = 0.003 * np.random.default_rng(1).standard_normal(len(sampled_s))
    seen_s = np.arange(0.0, sampled_s[-1], 0.004)
    seen_A = np.interp(seen_s, sampled_s, np.interp(sampled_s, time_s, current_A) + noise_A)
    error_A = steps_error_A(seen_s, seen_A, (0.0, 1.0, 0.2 + wrong_A, 0.9), hold_s)
    assert error_A == pytest.approx(wrong_A, abs=0.016)


def test_a_hold_whose_current_was_not_measured_is_no_statement() -> None:
    time_s, current_A = staircase(LEVELS_A)
    assert steps_error_A(time_s, np.full(len(time_s), np.nan), LEVELS_A, HOLD_S) is None
    assert steps_error_A(time_s[:100], current_A[:100], LEVELS_A, HOLD_S) is None


def test_a_level_that_was_never_commanded_is_missed() -> None:
    time_s, current_A = staircase(LEVELS_A[:4])
    assert steps_error_A(time_s, current_A, LEVELS_A, HOLD_S) == pytest.approx(2.0, abs=1e-3)


def verdict_of(current_A: np.ndarray | None, **point: object) -> Verdict:
    """A synthetic point's verdict with another measured current (by controller time) and other wishes."""
    rig = SyntheticRig(current_A=1.5, cycles=10)
    records, context = rig.records(), rig.context()
    if current_A is not None:
        frames = records["channel"] == Channel.COIL_CURRENT
        records["value"][frames] = current_A[: np.count_nonzero(frames)]
    context = replace(context, point=replace(context.point, **point))
    return build(JournalContent("", records, end={"stopped_by": None, "lost_records": 0}), context)[1].verdict


def slugs(verdict: Verdict) -> list[str]:
    return [reason.partition(":")[0] for reason in verdict.reasons]


def test_a_point_whose_current_sags_over_four_of_ten_cycles_is_invalid() -> None:
    assert slugs(verdict_of(None)) == []
    sagging_A = np.full(1320, 1.5)
    sagging_A[460:860] = 1.2
    found = verdict_of(sagging_A)
    assert (found.verdict, slugs(found)) == ("invalid", ["current-tracking"])


@pytest.mark.parametrize(("lost", "expected"), [(slice(0, 0), []), (slice(0, 60), ["no-temperature"]),
                                                (slice(0, None), ["no-temperature"])])
def test_a_window_without_a_temperature_is_reported(lost: slice, expected: list[str]) -> None:
    rig = SyntheticRig(cycles=10)
    records, context = rig.records(), rig.context()
    context = replace(context, commanded=Commanded(low_degC=15.0, high_degC=45.0))
    frames = np.flatnonzero(records["channel"] == Channel.COIL_TEMPERATURE)
    content = JournalContent("", np.delete(records, frames[lost]), end={"stopped_by": None, "lost_records": 0})
    found = build(content, context)[1].verdict
    assert slugs(found) == expected
    assert found.verdict == ("suspect" if expected else "valid")


def test_a_current_step_point_is_evaluated_by_its_own_levels() -> None:
    rig = SyntheticRig(amplitude_m=0.0, cycles=len(LEVELS_A) - 2, frequency_Hz=1.0 / HOLD_S)
    context = rig.context()
    expected = replace(context.point, kind="current_step", waveform="hold", steps_A=tuple(LEVELS_A), current_A=2.0)
    context = replace(context, point=expected)
    time_s, current_A = staircase(LEVELS_A)
    records = rig.records()
    frames = records["channel"] == Channel.COIL_CURRENT
    at_s = records["device_us"][frames] * 1e-6 + 42.0 - rig.start_s

    def verdict(offset_A: float) -> list[str]:
        shown_A = np.interp(at_s, time_s, current_A) + offset_A * ((at_s > 2 * HOLD_S) & (at_s < 3 * HOLD_S))
        records["value"][frames] = shown_A
        content = JournalContent("", records, end={"stopped_by": None, "lost_records": 0})
        return slugs(build(content, context)[1].verdict)

    assert verdict(0.0) == []
    assert verdict(0.2) == ["current-tracking"]


def test_every_level_of_a_current_program_is_checked_over_its_holds() -> None:
    """Holds of 0.15 to 2 s, a coil of 40 ms, 4 mA of noise: 3 mA; 5 % too little, or one level missed, is seen."""
    levels_A, levels_s = [0.0, 1.0, 0.0, 1.0, 2.0, 0.0], [0.0, 2.0, 2.15, 3.0, 3.5, 4.0]
    time_s, current_A, shown = np.arange(0.0, 5.0, 0.01), 0.0, []
    for t_s in time_s:
        target_A = levels_A[int(np.searchsorted(levels_s, t_s, side="right")) - 1]
        current_A += (1.0 - np.exp(-0.01 / 0.04)) * (target_A - current_A)
        shown.append(current_A)
    measured_A = np.array(shown) + 0.004 * np.random.default_rng(1).standard_normal(len(shown))
    assert program_error_A(time_s, measured_A, levels_A, levels_s) == pytest.approx(0.0, abs=0.012)
    assert program_error_A(time_s, 0.95 * measured_A, levels_A, levels_s) == pytest.approx(0.1, abs=0.012)
    assert program_error_A(time_s, np.minimum(measured_A, 1.0), levels_A, levels_s) == pytest.approx(1.0, abs=0.05)
    assert program_error_A(time_s, np.full(len(time_s), np.nan), levels_A, levels_s) is None


def test_a_current_that_follows_its_commands_late_has_their_mean() -> None:
    """Commands of 0 and 1 A by turns, 0.1 s each; measured 20 ms later, or 10 % too little."""
    commanded_s = np.arange(0.0, 10.0, 0.1)
    commanded_A = np.arange(100) % 2 * 1.0
    time_s = np.arange(0.005, 10.0, 0.01)
    late_A = np.where(time_s < 0.02, 0.0, commanded_A[np.clip(((time_s - 0.02) / 0.1).astype(int), 0, 99)])
    assert law_error_A(time_s, late_A, commanded_s, commanded_A) == pytest.approx(0.002, abs=1e-6)
    assert law_error_A(time_s, 0.9 * late_A, commanded_s, commanded_A) == pytest.approx(0.0518, abs=1e-6)
    assert law_error_A(time_s, np.full(len(time_s), np.nan), commanded_s, commanded_A) is None
    assert law_error_A(time_s, late_A, commanded_s[:0], commanded_A[:0]) is None
