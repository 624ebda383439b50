"""Sensors mounted the other way round: said in the bench file they measure right, unsaid they are refused."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from rig.dampers import model, parameter_set
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

ROOT = Path(__file__).parents[2]
QUICK = ROOT / "examples" / "quick.toml"
SHOWN_AT_ZERO_N = 40.0

pytestmark = pytest.mark.wire


@pytest.fixture
def reversed_rig(tmp_path: Path) -> Iterator[str]:
    """A simulated rig whose load cell and LVDT count the other way, the load cell with an offset; its bench file."""
    command = [
        sys.executable, "-m", "simulators", "--speed", "10", "--seed", "3", "--truth", str(tmp_path / "truth.h5"),
        "--option", "load_cell.reversed=true", "--option", "lvdt.reversed=true",
        "--option", f"load_cell.offset={SHOWN_AT_ZERO_N}",
    ]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        yield Path(process.stdout.readline().strip()).read_text()
        process.terminate()


def run(bench: str, folder: Path) -> tuple[int, dict[str, Any]]:
    folder.mkdir()
    path = folder / "bench.toml"
    path.write_text(bench)
    command = [sys.executable, "-m", "rig.cli.main", "run", str(QUICK), "--bench", str(path), "--no-identify"]
    result = subprocess.run(
        [*command, "--out", str(folder), "--json"], capture_output=True, text=True, cwd=ROOT, timeout=120, check=False
    )
    return result.returncode, json.loads(result.stdout)


def with_polarity(bench: str, table: str) -> str:
    heading = f"[{table}.calibration]\n"
    assert heading in bench
    return bench.replace(heading, f'{heading}polarity = "reversed"\n')


def true_force_N(point: RecordedPoint) -> NDArray[np.float64]:
    """What the simulated damper answers to the recorded motion (N), (n,)."""
    prior, dt_s = parameter_set("demo"), 1.0 / point.sample_rate_Hz
    acceleration = np.gradient(point.velocity_m_s, dt_s)
    return model(prior.model).force(
        prior.values, point.displacement_m, point.velocity_m_s, acceleration, point.current_A, dt_s
    )


def test_reversed_sensors_measure_right_once_the_bench_file_says_so(reversed_rig: str, tmp_path: Path) -> None:
    zeroed = reversed_rig.replace('offset = "0 N"', f'offset = "{SHOWN_AT_ZERO_N:g} N"')
    both = with_polarity(with_polarity(zeroed, "load_cell"), "lvdt")
    for name, wrong in (("force", with_polarity(zeroed, "lvdt")), ("displacement", with_polarity(zeroed, "load_cell"))):
        code, said = run(wrong, tmp_path / name)
        assert (code, said["stopped_by"]) == (3, "sensors-swapped"), said
    code, said = run(both, tmp_path / "right")
    assert (code, said["valid"]) == (0, 2), said
    for point in Run.open(Path(said["campaign"])).points:
        assert np.nanmean(point.force_N - true_force_N(point)) == pytest.approx(0.0, abs=0.25 * SHOWN_AT_ZERO_N)
        assert np.nanstd(point.force_N - true_force_N(point)) < 0.1 * np.nanmax(np.abs(point.force_N))
        assert point.path is not None
        with h5py.File(point.path) as file:
            attributes = file["entry/data/force"].attrs
            assert (attributes["sensitivity"], attributes["offset"]) == (-1.0, -SHOWN_AT_ZERO_N)
            assert file["entry/data/displacement"].attrs["sensitivity"] == pytest.approx(-0.001)
