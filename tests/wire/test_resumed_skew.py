"""A campaign resumed by a relative path: what all its points know of the skew reaches the books of the kept ones."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.recording.journal.campaign_log import read_log
from rig.recording.recorded_point import RecordedPoint

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
current = ["1 A", "1.5 A", "2 A", "0.5 A", "1.2 A"]
cycles = 6
[identify]
enabled = false
"""


def rig_run(*arguments: str, folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "rig.cli.main", "run", "--json", *arguments], cwd=folder,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def begun(folder: Path) -> Path:
    """A campaign stopped when its first point was done."""
    (folder / "matrix.toml").write_text(MATRIX, encoding="utf-8")
    arguments = ("matrix.toml", "--simulate", "--speed", "10", "--seed", "7", "--out", "out", "--", "--no-real-time")
    with rig_run(*arguments, folder=folder) as first:
        assert first.stderr is not None
        for line in first.stderr:
            if "p001" in line and "valid" in line:
                first.send_signal(signal.SIGINT)
                break
        output, _ = first.communicate(timeout=60)
    return folder / json.loads(output)["campaign"]


def suspect_for_its_skew(file: Path) -> None:
    """The point as it would be had it seen too little of the skew alone."""
    with h5py.File(file, "r+") as content:
        quality = content["entry/quality"].attrs
        quality["verdict"], quality["skew_std_s"] = "suspect", 0.01
        quality["reasons"] = np.array([b"skew: force and displacement are tied together to 10 ms only"])
        quality["blamed"] = np.array([b"bench"])


def test_a_kept_point_judged_again_is_entered_as_its_file_says(tmp_path: Path) -> None:
    campaign = begun(tmp_path)
    kept = campaign / "points" / "p001.h5"
    assert RecordedPoint.open(kept).verdict == "valid"
    suspect_for_its_skew(kept)
    with rig_run("--resume", str(campaign.relative_to(tmp_path)), folder=tmp_path) as second:
        output, errors = second.communicate(timeout=100)
    assert output, errors[-3000:]
    assert {each["file"] for each in read_log(campaign) if each["event"] == "retimed"} >= {"p001"}
    first = next(point for point in json.loads(output)["points"] if point["id"] == "p001")
    assert RecordedPoint.open(kept).verdict == "valid"
    assert (first["verdict"], first["reasons"]) == ("valid", [])
    assert Path(first["file"]) == kept.resolve()
    assert first["quality"]["skew_std_s"] == RecordedPoint.open(kept).skew_std_s
    assert second.returncode == 0, errors[-2000:]
