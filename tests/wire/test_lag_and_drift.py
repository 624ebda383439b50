"""A rig whose load cell lags by 2 ms nobody declared and whose clock runs 300 ppm fast: what a campaign says of it.

One simulated rig of four times real time serves all tests here; its truth file decides.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import pytest

from rig.recording.run import RecordedPoint, Run

if TYPE_CHECKING:
    from conftest import Truth

pytestmark = pytest.mark.wire

MATRIX = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
amplitude = ["30 mm"]
frequency = ["2 Hz"]
current = ["0 A", "1 A", "2 A"]
cycles = 10
[identify]
enabled = false
"""
LAG_S = 2e-3
COVERING = 2.6
"""Standard deviations: 99 %."""


@dataclass(frozen=True)
class Lagging:
    answer: dict[str, Any]
    run: Run
    truth: Truth
    clocks: dict[str, float]
    """Offset (us) and rate (ppm) of every device's clock, as the truth file says them."""

    def true_time_s(self, point: RecordedPoint) -> np.ndarray:
        """The rig's own time of each force sample of a point, as corrected."""
        clock_s = float(point.test["controller_clock_at_zero_s"]) + point.force_samples.time_s
        rate = 1.0 + 1e-6 * self.clocks["clock_ppm_controller"]
        time_s = (clock_s - 1e-6 * self.clocks["clock_offset_us_controller"]) / rate
        wrap_s = 2.0**32 * 1e-6 / rate
        return np.asarray(time_s + wrap_s * round((np.mean(self.truth.time_s) - np.mean(time_s)) / wrap_s))


@pytest.fixture(scope="module")
def lagging(tmp_path_factory: pytest.TempPathFactory, truth_of: Callable[[Path], Truth]) -> Lagging:
    folder = tmp_path_factory.mktemp("lagging")
    matrix = folder / "matrix.toml"
    matrix.write_text(MATRIX, encoding="utf-8")
    command = [sys.executable, "-m", "rig.cli.main", "run", str(matrix), "--simulate", "--speed", "4", "--seed", "11"]
    options = ["--option", f"load_cell.skew_s={LAG_S}", "--option", "load_cell.clock_ppm=300"]
    done = subprocess.run(
        [*command, "--json", "--out", str(folder / "out"), "--", *options],
        capture_output=True, text=True, timeout=170, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    answer = json.loads(done.stdout)
    campaign = Path(answer["campaign"])
    with h5py.File(campaign / "truth.h5") as file:
        said = dict(file["entry/provenance"].attrs)
    clocks = {name: float(value) for name, value in said.items() if name.startswith("clock_")}
    return Lagging(answer, Run.open(campaign), truth_of(campaign / "truth.h5"), clocks)


def test_the_points_agree_on_the_skew_and_its_interval_covers_what_was_set(lagging: Lagging) -> None:
    numbers = [point["quality"] for point in lagging.answer["points"]]
    assert np.ptp([quality["skew_s"] for quality in numbers]) < numbers[0]["skew_std_s"]
    assert abs(numbers[0]["skew_s"] - LAG_S) < COVERING * numbers[0]["skew_std_s"]
    assert numbers[0]["skew_std_s"] < 0.5e-3
    assert [point.skew_s for point in lagging.run.points] == [quality["skew_s"] for quality in numbers]


def test_the_drift_of_the_load_cells_clock_is_stated_with_its_uncertainty(lagging: Lagging) -> None:
    wanted_ppm = 300.0 - lagging.clocks["clock_ppm_controller"]
    for point in lagging.run.points:
        std_ppm = float(point.quality["force_clock_drift_std_ppm"])
        assert abs(float(point.quality["force_clock_drift_ppm"]) - wanted_ppm) < 3.0 * std_ppm + 0.1, point.id
        assert std_ppm < 5.0


def test_corrected_force_lies_over_the_true_force_within_what_is_left_uncertain(lagging: Lagging) -> None:
    truth, lags_s = lagging.truth, np.linspace(-4e-3, 4e-3, 161)
    for point in lagging.run.points:
        time_s, force_N = lagging.true_time_s(point), point.force_samples.force_N
        misfit = [np.sum((force_N - np.interp(time_s - lag_s, truth.time_s, truth.force_N)) ** 2) for lag_s in lags_s]
        left_s = abs(lags_s[int(np.argmin(misfit))])
        assert left_s < COVERING * point.skew_std_s + 0.1e-3, point.id
