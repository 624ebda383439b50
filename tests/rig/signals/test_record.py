"""Records: a motion that does not repeat, against what it is by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rig.signals.record import STEP_S, NoRecord, SweepMotion, record_of, sweep_record, through_rows


def seconds(count: float) -> np.ndarray:
    return np.arange(round(count / STEP_S) + 1) * STEP_S


def test_a_linear_sweep_passes_the_cycles_between_its_frequencies() -> None:
    # 1 Hz to 3 Hz in 10 s: 1 * 10 + (3 - 1) * 10 / 2 = 20 cycles; half way (1 * 5 + 0.2 * 25 / 2) = 7.5 of them.
    sweep = SweepMotion(10.0, 1.0, 3.0, 0.02, 0.01)
    time_s = np.array([0.0, 5.0, 5.0 + 1e-4, 10.0])
    position_m = sweep.at(time_s)
    assert position_m[[0, 3]] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert position_m[1] == pytest.approx(0.0, abs=1e-12)  # 7.5 cycles
    slope_m_s = (position_m[2] - position_m[1]) / 1e-4
    assert slope_m_s == pytest.approx(-0.015 * 2.0 * math.pi * 2.0, rel=1e-3)  # 15 mm, 2 Hz, downwards


def test_a_logarithmic_sweep_at_falling_amplitude_keeps_its_speed() -> None:
    # Frequency times ten, amplitude a tenth: the peak speed 2 pi f A stays 2 pi * 0.5 * 0.02 = 62.8 mm/s.
    record = sweep_record(SweepMotion(20.0, 0.5, 5.0, 0.02, 0.002, logarithmic=True), ramp_s=1.0)
    _, velocity, _ = record.motion(record.amplitude_m)
    parts = np.array_split(np.abs(velocity[2000:-2000]), 4)
    assert [float(part.max()) for part in parts] == pytest.approx([0.0628] * 4, rel=0.03)


def test_both_ends_begin_and_end_at_rest_and_the_rest_is_untouched() -> None:
    time_s = seconds(10.0)
    position_m = 0.004 + 0.01 * np.sin(math.tau * 0.5 * time_s)  # off the centre where it begins
    record = record_of("own", position_m, 2.0, highest_Hz=None)
    u, v, a = record.motion(record.amplitude_m)
    assert (u[0], u[-1]) == (0.0, 0.0)
    assert max(abs(v[0]), abs(v[-1])) < 1e-4
    assert np.max(np.abs(a)) < 2.0 * 0.01 * (math.tau * 0.5) ** 2, "no jump where it begins"
    kept = (time_s >= 2.0) & (time_s <= 8.0)
    assert u[kept] == pytest.approx(position_m[kept], abs=1e-12)
    assert record.amplitude_m == pytest.approx(np.max(np.abs(position_m[kept])))
    assert record.duration_s == pytest.approx(10.0)


def test_peaks_are_those_of_the_sine_it_is() -> None:
    record = record_of("own", 0.03 * np.sin(math.tau * 2.0 * seconds(10.0)), 1.0, amplitude_m=0.01)
    assert record.peak_velocity * 0.01 == pytest.approx(math.tau * 2.0 * 0.01, rel=1e-3)
    assert record.peak_acceleration * 0.01 == pytest.approx((math.tau * 2.0) ** 2 * 0.01, rel=1e-3)
    assert record.mean_rate_Hz == pytest.approx(2.0, abs=0.06)
    assert record.highest_Hz == pytest.approx(2.0, abs=0.15)


def test_what_is_faster_is_taken_off_without_phase() -> None:
    time_s = seconds(20.0)
    slow_m = 0.01 * np.sin(math.tau * 0.5 * time_s)
    record = record_of("own", slow_m + 0.004 * np.sin(math.tau * 30.0 * time_s), 1.0, highest_Hz=5.0)
    u, _, _ = record.motion(record.amplitude_m)
    kept = (time_s >= 1.0) & (time_s <= 19.0)
    assert u[kept] == pytest.approx(slow_m[kept], abs=1e-5)
    assert record.highest_Hz == 5.0


def test_between_rows_the_motion_is_smooth() -> None:
    time_s = np.arange(0.0, 6.0 + 1e-9, 0.02)
    fine_m = through_rows(time_s, np.sin(math.tau * time_s))
    assert fine_m == pytest.approx(np.sin(math.tau * seconds(6.0)), abs=2e-6)


def test_rows_closer_than_a_sample_are_thinned_without_folding() -> None:
    time_s = np.arange(0.0, 4.0, 0.0002)
    fine_m = through_rows(time_s, np.sin(math.tau * time_s) + 0.2 * np.sin(math.tau * 1001.0 * time_s))
    inner = slice(200, -200)  # 1001 Hz every millisecond would look like 1 Hz
    assert fine_m[inner] == pytest.approx(np.sin(math.tau * STEP_S * np.arange(len(fine_m)))[inner], abs=2e-4)


def test_a_hole_in_the_rows_is_no_motion() -> None:
    time_s = np.concatenate((np.arange(0.0, 2.0, 0.01), np.arange(3.0, 5.0, 0.01)))
    with pytest.raises(NoRecord, match=r"between 1\.99 s and 3 s"):
        through_rows(time_s, np.sin(time_s))


@pytest.mark.parametrize(("length_s", "ramp_s"), [(2.5, 1.0), (601.0, 1.0)])
def test_too_short_for_its_ramps_or_too_long_is_refused(length_s: float, ramp_s: float) -> None:
    with pytest.raises(NoRecord, match=r"allowed 3 s .* to 600 s"):
        record_of("own", np.sin(seconds(length_s)), ramp_s)


def test_a_record_that_stands_is_refused() -> None:
    with pytest.raises(NoRecord, match="no motion"):
        record_of("own", np.zeros(5001), 1.0)
