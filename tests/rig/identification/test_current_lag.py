"""The coil's lag from synthetic current steps with noise, quantisation and unknown delays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rig.errors import IdentificationFailed
from rig.identification.points.current_steps import fit_lag, lag_of
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile, RawChannel
from rig.recording.recorded_point import RecordedPoint
from rig.recording.ring_records import RECORD_DTYPE

LEVELS_A = (0.0, 1.0, 0.0, 2.0, 0.5)


def step_point(
    folder: Path, eta_1_s: float, seed: int = 1, period_s: float = 0.01, levels_A: tuple[float, ...] = LEVELS_A
) -> RecordedPoint:
    """A recorded current-step point: 0.5 s a step, each taking effect 0 to 20 ms late, 2 mA noise, 1 mA resolution."""
    dice = np.random.default_rng(seed)
    time_s = np.arange(0.0, 0.5 * len(levels_A), period_s)
    current_A = np.full(len(time_s), levels_A[0])
    for number, level_A in enumerate(levels_A[1:], start=1):
        begun_s = 0.5 * number + dice.uniform(0.0, 0.02)
        after = time_s >= begun_s
        at_step_A = levels_A[number - 1]
        current_A[after] = level_A + (at_step_A - level_A) * np.exp(-eta_1_s * (time_s[after] - begun_s))
    records = np.zeros(len(time_s), RECORD_DTYPE)
    records["value"] = np.round(current_A + 0.002 * dice.standard_normal(len(time_s)), 3)
    content = PointFile(
        time_s,
        1.0 / period_s,
        [AlignedChannel("force", np.zeros(len(time_s)), "N", "Force")],
        raw=[RawChannel("coil_current", records, "A", "Coil current", time_s)],
        test={
            "id": "step1", "waveform": "hold", "kind": "current_step", "amplitude_m": 0.0, "frequency_Hz": 2.0,
            "current_A": max(levels_A), "steps_A": " ".join(f"{level:g}" for level in levels_A), "device_rate": 20.0,
        },
        quality={"verdict": "valid"},
    )  # fmt: skip
    write_file(folder / f"step{seed}.h5", content)
    return RecordedPoint.open(folder / f"step{seed}.h5")


@pytest.mark.parametrize("eta_1_s", [10.0, 25.0, 60.0])
def test_eta_is_found_with_an_interval_that_holds_it(tmp_path: Path, eta_1_s: float) -> None:
    lag = fit_lag(step_point(tmp_path, eta_1_s))
    assert abs(lag.eta_1_s - eta_1_s) < 4.0 * lag.std_1_s
    assert lag.std_1_s < 0.01 * eta_1_s
    assert lag.steps == 4
    assert lag.delay_s is None


@pytest.mark.nightly
def test_intervals_cover_the_truth_as_often_as_they_say(tmp_path: Path) -> None:
    inside = 0
    for seed in range(40):
        low, high = fit_lag(step_point(tmp_path, 25.0, seed)).interval_1_s
        inside += low <= 25.0 <= high
    # 95 % of 40; fewer than 33 would happen by chance once in 2000 times.
    assert inside >= 33


def test_points_are_pooled_and_what_cannot_be_used_is_named(tmp_path: Path) -> None:
    points = [step_point(tmp_path, 25.0, 1), step_point(tmp_path, 25.0, 2), step_point(tmp_path, 5000.0, 3)]
    lag, refused = lag_of(points)
    assert lag is not None
    assert lag.steps == 8
    assert lag.std_1_s < fit_lag(points[0]).std_1_s
    assert len(refused) == 1
    assert "eta is not determined" in refused[0]


def test_points_that_scatter_beyond_their_errors_are_pooled_with_their_scatter(tmp_path: Path) -> None:
    points = [step_point(tmp_path, eta_1_s, seed) for seed, eta_1_s in enumerate((20.0, 25.0, 30.0))]
    lag, _ = lag_of(points)
    assert lag is not None
    assert lag.std_1_s == pytest.approx(5.0 / 3.0**0.5, rel=0.2)  # of the mean of three, 5 1/s apart
    assert max(fit_lag(point).std_1_s for point in points) < 0.5


def test_a_step_that_is_cut_off_is_refused(tmp_path: Path) -> None:
    with pytest.raises(IdentificationFailed, match="hold the current longer"):
        fit_lag(step_point(tmp_path, 3.0))
