"""An imported record is as many tests as it holds motions, on the time base behind its stamps."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rig.errors import FileProblem
from rig.recording.importing import import_tests
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from rig.signals.cycles import measured_motion
from rig.signals.motions import motions_of
from rig.signals.sample_times import TimeBase

COLUMNS = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}


def imported(
    folder: Path, time_s: np.ndarray, x_mm: np.ndarray, *, digits: int = 6, current_A: np.ndarray | None = None,
    waveform: str = "sine",
) -> tuple[RecordedPoint, ...]:
    """The points of a file with these columns, its force that of a damper of 400 N s/m."""
    file = folder / "loops.csv"
    columns = [x_mm, 0.4 * np.gradient(x_mm, time_s), *([] if current_A is None else [current_A])]
    named = {**COLUMNS, **({} if current_A is None else {"current": "i_A"})}
    lines = [
        ",".join((f"{t:.{digits}f}", *(f"{value:.5f}" for value in row)))
        for t, row in zip(time_s, np.column_stack(columns), strict=True)
    ]
    file.write_text("\n".join(("t_s,x_mm,F_N,i_A" if current_A is not None else "t_s,x_mm,F_N", *lines)) + "\n")
    return Run.open(import_tests(
        [file], columns=named, out=folder, current_A=None if current_A is not None else 0.5, waveform=waveform
    )).points  # fmt: skip


def steps_of_frequency(time_s: np.ndarray) -> np.ndarray:
    """20 mm at 1 Hz for 10 s, then at 2 Hz."""
    return 20.0 * np.sin(2.0 * np.pi * np.where(time_s < 10.0, time_s, 2.0 * time_s - 10.0) - 0.3)


def test_steps_of_frequency_are_tests_and_each_says_what_it_uses(tmp_path: Path) -> None:
    slow, fast = imported(tmp_path, t := np.arange(0.0, 20.0, 0.005), steps_of_frequency(t))
    assert [(point.id, point.verdict) for point in (slow, fast)] == [("loops-1", "valid"), ("loops-2", "valid")]
    assert (slow.frequency_Hz, fast.frequency_Hz) == pytest.approx((1.0, 2.0), rel=0.02)
    record = fast.quality.record
    assert record is not None
    assert (record.motion, record.motions) == (2, 2)
    assert record.used_s == pytest.approx(9.5, abs=0.6)
    assert record.record_s == pytest.approx(20.0, abs=0.01)
    assert record.start_s == pytest.approx(10.0, abs=0.3)
    assert record.other_motions is not None
    assert "20 mm 1 Hz" in record.other_motions
    assert slow.time_s[0] == fast.time_s[0] == 0.0


def test_a_burst_before_a_slow_motion_of_less_stroke_hides_nothing_of_it(tmp_path: Path) -> None:
    """The last low of the burst is deeper than the slow motion goes: it is no part of that."""
    t = np.arange(0.0, 20.0, 0.01)
    x_mm = np.where(t < 2.0, 30.0 * np.sin(5.0 * np.pi * t), 12.0 * np.sin(3.0 * np.pi * (t - 2.0)))
    burst, slow = imported(tmp_path, t, x_mm)
    assert [point.verdict for point in (burst, slow)] == ["valid", "valid"]
    assert (burst.amplitude_m, burst.frequency_Hz) == pytest.approx((0.03, 2.5), rel=0.02)
    assert (slow.amplitude_m, slow.frequency_Hz) == pytest.approx((0.012, 1.5), rel=0.02)
    assert slow.quality.motion.cycles == pytest.approx(26, abs=1)


def test_steps_of_a_measured_current_are_tests_at_their_currents(tmp_path: Path) -> None:
    t = np.arange(0.0, 20.0, 0.005)
    current_A = np.where(t < 10.0, 0.25, 1.0)
    points = imported(tmp_path, t, 20.0 * np.sin(2.0 * np.pi * t - 0.3), current_A=current_A)
    assert [point.current_A for point in points] == [0.25, 1.0]


def test_a_sweep_called_a_sine_is_invalid_and_as_random_motion_it_stays_whole(tmp_path: Path) -> None:
    t = np.arange(0.0, 20.0, 0.005)
    x_mm = 10.0 * np.sin(2.0 * np.pi * (0.5 * t + 0.1 * t**2))
    (point,) = imported(tmp_path, t, x_mm)
    assert [reason.slug for reason in point.quality.verdict.entries] == ["unsteady-motion"]
    (point,) = imported(tmp_path, t, x_mm, waveform="random")
    assert (point.verdict, point.samples) == ("valid", t.size)


def test_one_motion_stays_one_test_with_every_row(tmp_path: Path) -> None:
    t = np.arange(0.0, 12.0, 0.005)
    (point,) = imported(tmp_path, t, 20.0 * np.clip(t / 2.0, 0.0, 1.0) * np.sin(2.0 * np.pi * t))
    assert (point.id, point.samples, point.verdict) == ("loops", t.size, "valid")
    record = point.quality.record
    assert record is not None
    assert (record.motion, record.other_s) == (None, pytest.approx(12.0 - (record.used_s or 0.0), abs=0.6))


def test_stamps_of_few_digits_are_the_uniform_rate_behind_them_in_the_file(tmp_path: Path) -> None:
    t = np.arange(0.0, 5.0, 0.0025)
    (point,) = imported(tmp_path, t, 20.0 * np.sin(4.0 * np.pi * t - 0.3), digits=3)
    times = point.quality.time
    assert times is not None
    assert (times.base, times.resolution_s) == (TimeBase.ROUNDED, pytest.approx(1e-3))
    assert times.rate_Hz == pytest.approx(400.0, rel=1e-5)
    assert np.max(np.abs(np.diff(point.time_s) - 0.0025)) < 1e-7
    assert "stamps in steps of 1 ms" in str(point.provenance["read_as"])


def test_several_samples_on_one_stamp_are_read_where_a_uniform_rate_is_behind_them(tmp_path: Path) -> None:
    t = np.arange(0.0, 5.0, 0.0005)
    (point,) = imported(tmp_path, t, 20.0 * np.sin(4.0 * np.pi * t - 0.3), digits=3)
    assert point.verdict == "valid"
    assert point.sample_rate_Hz == pytest.approx(2000.0, rel=1e-4)


def test_a_table_with_rounded_times_is_the_uniform_rate_behind_them() -> None:
    t = np.arange(0.0, 5.0, 0.0025)
    x_m = 0.02 * np.sin(4.0 * np.pi * t - 0.3)
    table = pd.DataFrame({"time_s": np.round(t, 3), "displacement_m": x_m, "force_N": 400.0 * np.gradient(x_m, t)})
    point = RecordedPoint.from_pandas(table, id="rounded", current_A=0.0)
    assert point.quality.time is not None
    assert point.quality.time.base == TimeBase.ROUNDED
    assert np.max(np.abs(np.diff(point.time_s) - 0.0025)) < 1e-7


def test_a_step_of_the_current_in_the_middle_of_a_cycle_is_in_neither_test(tmp_path: Path) -> None:
    t = np.arange(0.0, 20.0, 0.005)
    current_A = np.where(t < 10.3, 0.25, 1.0) + 0.002 * np.random.default_rng(2).standard_normal(t.size)
    low, high = imported(tmp_path, t, 20.0 * np.sin(2.0 * np.pi * t - 0.3), current_A=current_A)
    assert [point.verdict for point in (low, high)] == ["valid", "valid"]
    assert (low.current_A, high.current_A) == pytest.approx((0.25, 1.0), abs=1e-3)
    used = low.time_s < (low.quality.motion.end_s or 0.0)
    assert float(np.max(low.current_measured_A[used])) < 0.3
    used = high.time_s >= (high.quality.motion.start_s or 0.0)
    assert float(np.min(high.current_measured_A[used])) > 0.9


@pytest.mark.parametrize(("varying_A", "verdict"), [
    (lambda t: np.where((t > 4.0) & (t < 4.2), 0.0, 0.5), "invalid"),
    (lambda t: np.where(t % 1.0 < 0.15, 0.0, 0.5), "invalid"),
    (lambda t: 0.4 + 0.05 * t, "invalid"),
    (lambda t: (50.0 * t + 0.1) % 1.0 < 0.25, "invalid"),
    (lambda t: 0.5 + 0.015 * np.sin(2.0 * np.pi * t), "valid"),
    (lambda t: 0.5 + 0.0 * t, "valid"),
])
@pytest.mark.parametrize("noise_A", [0.0, 0.003])
def test_a_measured_current_that_is_not_one_makes_the_test_invalid(
    tmp_path: Path, varying_A: Callable[[np.ndarray], np.ndarray], verdict: str, noise_A: float
) -> None:
    """It was called by its median, and valid, with half a cycle without any current in it."""
    t = np.arange(0.0, 20.0, 0.005)
    current_A = varying_A(t) + noise_A * np.random.default_rng(2).standard_normal(t.size)
    (point,) = imported(tmp_path, t, 20.0 * np.sin(2.0 * np.pi * t - 0.3), current_A=current_A)
    assert point.verdict == verdict
    assert [reason.partition(":")[0] for reason in map(str, point.reasons)] == ["current-tracking"] * (
        verdict == "invalid"
    )


def test_steps_of_frequency_have_no_bias_where_they_meet() -> None:
    rate_Hz, pieces = 1000.0, []
    for frequency_Hz in (1.0, 2.0, 3.0):
        t = np.arange(round(6 * rate_Hz / frequency_Hz)) / rate_Hz
        pieces.append(0.02 * np.sin(2.0 * np.pi * frequency_Hz * t))
    x = np.concatenate(pieces)
    motions = motions_of(np.arange(x.size) / rate_Hz, x).steady
    for motion, frequency_Hz in zip(motions, (1.0, 2.0, 3.0), strict=True):
        first, last = np.round(np.array(motion.stretch_s) * rate_Hz).astype(int)
        measured = measured_motion(np.arange(first, last) / rate_Hz, x[first:last])
        assert measured is not None
        assert measured.frequency_Hz == pytest.approx(frequency_Hz, rel=5e-5)


def test_a_single_spike_makes_a_test_suspect(tmp_path: Path) -> None:
    t = np.arange(2000) * 0.004
    rows = np.column_stack([t, 20.0 * np.sin(9.0 * t), 72.0 * np.cos(9.0 * t)])
    rows[700, 2] = 300.0
    np.savetxt(tmp_path / "spike.csv", rows, "%.5f", ",", header="t_s,x_mm,F_N", comments="")
    columns = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}
    (point,) = Run.open(import_tests([tmp_path / "spike.csv"], columns=columns, out=tmp_path, current_A=0.0)).points
    assert point.verdict == "suspect"
    assert "sensor-spike" in point.reasons[0]
    assert "300 N" in point.reasons[0]


def test_a_table_of_several_motions_is_no_point_and_their_rows_are_named() -> None:
    t = np.arange(0.0, 20.0, 0.005)
    x_mm = steps_of_frequency(t)
    table = pd.DataFrame({"time_s": t, "displacement_mm": x_mm, "force_N": 0.4 * np.gradient(x_mm, t)})
    with pytest.raises(FileProblem, match=r"the table contains 2 motions.*rows [0-9]+ to [0-9]+.*Fix: create a "
        r"separate point"):
        RecordedPoint.from_pandas(table, id="a", current_A=0.5)
    assert RecordedPoint.from_pandas(table.iloc[:1950], id="a", current_A=0.5).frequency_Hz == pytest.approx(1.0, 0.02)
    with pytest.raises(FileProblem, match="force: none of 4000 rows contains a number"):
        RecordedPoint.from_pandas(table.assign(force_N=np.nan), id="a", current_A=0.5)


@pytest.mark.parametrize(("share", "verdict"), [(0.0, "valid"), (0.01, "valid"), (0.05, "suspect"), (-0.25, "suspect")])
def test_a_displacement_that_drifts_is_suspect(tmp_path: Path, share: float, verdict: str) -> None:
    """A middle that moves by 5 % of the amplitude in a cycle makes the damping wrong by 4 %."""
    t = np.arange(0.0, 6.0, 0.004)
    point = imported(tmp_path, t, 20.0 * np.sin(2.0 * np.pi * t) + 20.0 * share * t)[0]
    assert point.verdict == verdict
    assert [reason.partition(":")[0] for reason in point.reasons] == ["unsteady-motion"] * (verdict == "suspect")
