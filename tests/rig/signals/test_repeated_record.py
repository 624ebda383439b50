"""Records that repeat a cycle: sums of sines, and signals that begin and end at rest."""

from __future__ import annotations

import numpy as np
import pytest

from rig.signals.record import STEP_S, NoRecord, record_of
from rig.signals.repeated_record import SignalCycle, SineSum, common_periods, most_cycles, repeated_record

SINES = SineSum(((0.010, 3.0), (0.002, 12.0)), 1, 0.5)


@pytest.mark.parametrize(
    ("frequencies_Hz", "expected"),
    [((1.0, 12.0), 1), ((1.0, 12.5), 2), ((0.7, 12.3), 7), ((2.0, 3.0, 0.5), 4), ((1.0, np.pi), None)],
)
def test_the_cycle_of_sines_is_their_common_period(frequencies_Hz: tuple[float, ...], expected: int | None) -> None:
    assert common_periods(frequencies_Hz) == expected


def test_whole_cycles_lie_between_the_ramps_although_no_step_divides_them() -> None:
    """3 Hz: a cycle takes 333.33 ms, which is no whole number of steps."""
    record = repeated_record(SINES, 7)
    between_s = record.duration_s - 2.0 * record.ramp_s
    assert between_s == pytest.approx(7 / 3.0, abs=1e-12)
    assert record.duration_s / STEP_S == pytest.approx(round(record.duration_s / STEP_S))
    time_s = STEP_S * np.arange(len(record.shape)) - record.ramp_s
    inside = (time_s >= 0.0) & (time_s <= between_s)
    wanted_m = 0.010 * np.sin(2 * np.pi * 3.0 * time_s) + 0.002 * np.sin(2 * np.pi * 12.0 * time_s)
    assert record.amplitude_m * record.shape[inside] == pytest.approx(wanted_m[inside], abs=1e-12)
    assert record.shape[[0, -1]].tolist() == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_record_of_fewer_cycles_is_the_same_motion() -> None:
    long, short = repeated_record(SINES, 9), repeated_record(SINES, 9).of_cycles(4)
    assert short.duration_s < long.duration_s
    assert short.amplitude_m == pytest.approx(long.amplitude_m, rel=1e-4)
    assert short.mark != long.mark


def test_a_signal_is_repeated_sample_by_sample_and_rests_in_between() -> None:
    time_s = STEP_S * np.arange(2001)
    cycle = SignalCycle(record_of("road", 0.01 * np.sin(2 * np.pi * 1.3 * time_s) + 0.004, 0.4))
    record = repeated_record(cycle, 3)
    assert (record.duration_s, record.ramp_s) == (pytest.approx(6.0), 0.0)
    one_m = cycle.record.amplitude_m * cycle.record.shape
    repeated_m = record.amplitude_m * record.shape
    for number in range(3):
        assert repeated_m[2000 * number : 2000 * number + 2001] == pytest.approx(one_m, abs=1e-15)
    speed_m_s = record.motion(record.amplitude_m)[1]
    assert abs(speed_m_s[2000]) < 1e-4


def test_a_record_is_at_most_ten_minutes_long() -> None:
    assert most_cycles(SINES) == 1797
    with pytest.raises(NoRecord, match="1798 cycles"):
        repeated_record(SINES, 1798)
