"""`rig check` and `rig run` as commands, beside a simulated rig on real pseudo terminals."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from matrices import TWO_POINTS

pytestmark = pytest.mark.wire


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[str]:
    """The bench file of a simulated rig that runs meanwhile."""
    command = [sys.executable, "-m", "simulators", "--seed", "5"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as rig:
        assert rig.stdout is not None
        yield Path(rig.stdout.readline().strip()).read_text(encoding="utf-8")
        rig.terminate()


@pytest.mark.nightly
def test_a_wrong_baud_rate_is_named_with_the_one_that_reads_and_refused_by_a_campaign(
    tmp_path: Path, bench: str
) -> None:
    path, matrix = tmp_path / "bench.toml", tmp_path / "matrix.toml"
    path.write_text(bench.replace("baudrate = 921600", "baudrate = 9600", 1), encoding="utf-8")
    matrix.write_text(TWO_POINTS, encoding="utf-8")
    answers = []
    for arguments in (["check", str(path)], ["run", str(matrix), "--bench", str(path), "--out", str(tmp_path / "out")]):
        command = [sys.executable, "-m", "rig.cli.main", *arguments, "--json"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
        assert done.returncode == 3, done.stderr
        answers.append(json.loads(done.stdout))
    checked, ran = answers
    cell = next(device for device in checked["devices"] if device["name"] == "load_cell")
    assert cell["verdict"] == "failed"
    (seen,) = [finding for finding in cell["findings"] if finding["slug"] == "serial-baud"]
    assert "baudrate = 921600 in [load_cell]" in seen["fix"]
    assert {"slug", "text", "fix"} <= seen.keys()
    assert ran["stopped_by"] == "serial-baud"
