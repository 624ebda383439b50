"""A bench whose load cell has a driver of another package, and a specimen of another package's model, in a world."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from rig.errors import FileProblem
from rig.recording.recorded_point import RecordedPoint
from simulators.scenarios.request import Files, request_for
from simulators.scenarios.runs import live

if TYPE_CHECKING:
    from conftest import Install

DEMO = (Path(__file__).resolve().parents[2] / "examples" / "demo-bench.toml").read_text(encoding="utf-8")
MATRIX = """format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo-my-lab-friction"
[matrix]
amplitude = ["20 mm"]
frequency = ["1 Hz"]
current = ["0.5 A"]
cycles = 4
[identify]
enabled = false
"""


def request_files(folder: Path, sensor: str, matrix: str = MATRIX) -> Files:
    """A bench with that load cell, and a matrix."""
    bench = DEMO.replace('format = "frame16"', f'format = "{sensor}"', 1)
    bench = bench.replace('range = "10 kN"\nstale_after = "20 ms"', 'range = "10 kN"\nstale_after = "40 ms"')
    (folder / "bench.toml").write_text(bench, encoding="utf-8")
    (folder / "matrix.toml").write_text(matrix, encoding="utf-8")
    return Files(folder / "matrix.toml", folder / "bench.toml")


@pytest.mark.nightly
def test_a_plug_ins_driver_records_the_force_of_a_plug_ins_model(my_lab: Path) -> None:
    plan = replace(request_for(request_files(my_lab, "my_lab_cell"), (), None).plan(3), events=())
    (my_lab / "world").mkdir()
    scenario, ended = live(plan, my_lab / "world")
    assert (ended.failed, ended.sessions) == ((), (0,))
    assert scenario.folder is not None
    (path,) = scenario.folder.glob("points/*.h5")
    point, truth = RecordedPoint.open(path), scenario.sessions[0].truth.arrays
    assert point.verdict == "valid"
    force_N = point.force_samples.force_N
    assert np.nanmax(force_N) == pytest.approx(truth[:, 4].max(), abs=25.0)
    # By hand: kv + kv_b/2 = 755 N s/m times 0.126 m/s, + 80 + 250/2 = 205 N of friction, - 150 N.
    assert np.nanpercentile(force_N, 97) == pytest.approx(755.0 * 0.02 * 2 * np.pi + 205.0 - 150.0, abs=15.0)


def test_a_driver_that_says_nothing_of_a_simulated_device_is_refused_by_name(install: Install) -> None:
    folder = install("mute-lab", {"mr_rig.sensors": {"mute": "mute_lab:make"}}, "def make(connection): ...")
    with pytest.raises(FileProblem, match=r"load_cell\.format.*'mute' has its own driver"):
        request_for(request_files(folder, "mute", MATRIX.replace("demo-my-lab-friction", "demo")), (), None)
