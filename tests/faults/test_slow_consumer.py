"""A recorder that cannot keep up: the limits are judged all the same, the point is spoiled, the campaign goes on."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from matrices import TWO_POINTS

from rig.recording.journal.campaign_log import read_log
from rig.recording.recorded_point import RecordedPoint

pytestmark = pytest.mark.wire


def test_what_the_recorder_could_not_take_spoils_the_point_and_nothing_else(tmp_path: Path) -> None:
    matrix, out = tmp_path / "matrix.toml", tmp_path / "out"
    matrix.write_text(TWO_POINTS, encoding="utf-8")
    out.mkdir()
    script = Path(__file__).with_name("slow_disk.py")
    done = subprocess.run(
        [sys.executable, str(script), "run", str(matrix), "--simulate", "--speed", "1", "--seed", "1", "--no-identify",
         "--json", "--out", str(out), "--", "--no-real-time", "--drop-unread"],
        capture_output=True, text=True, check=False, timeout=150, cwd=tmp_path,
    )  # fmt: skip
    answer = json.loads(done.stdout)
    assert done.returncode == 5, done.stderr
    assert answer["stopped_by"] is None
    assert {each["id"]: each["verdict"] for each in answer["points"]} == {"p001": "valid", "p002": "invalid"}
    (folder,) = out.iterdir()
    reasons = RecordedPoint.open(folder / "points" / "p002.h5").reasons
    assert any(reason.startswith("slow-consumer") for reason in reasons), reasons
    lines = read_log(folder)
    assert [line["slug"] for line in lines if line.get("what") == "trip"] == []
    assert "slow-consumer" in [line["slug"] for line in lines if line.get("what") == "warning"]
