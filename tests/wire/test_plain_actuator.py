"""A whole matrix on an actuator without lease, acknowledgement, echo, watchdog or function generator."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rig.recording.campaign_log import read_log

pytestmark = pytest.mark.wire

HERE = Path(__file__).parent / "plain_actuator"
MATRIX = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
mid_stroke = "0 mm"
prior = "demo"
[matrix]
waveform = ["sine"]
amplitude = ["10 mm"]
frequency = ["1 Hz"]
current = ["0.5 A", "1.0 A"]
cycles = 5
[identify]
enabled = false
"""


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "bench.toml"
    with subprocess.Popen(
        [sys.executable, str(HERE / "plain_rig.py"), str(path)], stdout=subprocess.PIPE, text=True
    ) as rig:
        assert rig.stdout is not None
        assert rig.stdout.readline() == "ready\n"
        yield path
        rig.terminate()
        rig.wait(30)


def rig(*arguments: str, plain: bool = True) -> subprocess.CompletedProcess[str]:
    path = os.environ.get("PYTHONPATH", "")
    environment = os.environ | ({"PYTHONPATH": f"{HERE}{os.pathsep}{path}"} if plain else {})
    return subprocess.run(
        [sys.executable, "-m", "rig.cli.main", *arguments], env=environment, capture_output=True, text=True,
        timeout=170, check=False,
    )


def test_a_matrix_runs_on_an_actuator_that_only_follows_set_points(bench: Path, tmp_path: Path) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(MATRIX, encoding="utf-8")
    unknown = rig("plan", str(matrix), "--bench", str(bench), plain=False)
    assert unknown.returncode == 2
    assert "'plain' is not known; known: demo" in unknown.stderr + unknown.stdout
    done = rig("run", str(matrix), "--bench", str(bench), "--out", str(tmp_path / "out"), "--json")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    story = read_log(Path(answer["campaign"]))
    said = {line["slug"]: line["detail"] for line in story if str(line.get("slug", "")).startswith("actuator-without")}
    assert {"actuator-without-lease", "actuator-without-watchdog", "actuator-without-generator"} <= set(said)
    assert "actuator-without-lease" in done.stderr, "also on the terminal"
    assert {point["verdict"] for point in answer["points"]} == {"valid"}
