"""`rig run` as a user meets it: the real processes on real wires, the JSON, Ctrl-C."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[3]
QUICK = str(ROOT / "examples" / "quick.toml")

pytestmark = pytest.mark.wire


def start(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "rig.cli.main", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def finish(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=150)
    return process.returncode, out, err


@pytest.mark.nightly
def test_a_simulated_run_ends_in_exit_0_with_the_documented_json_and_its_files(tmp_path: Path) -> None:
    code, out, err = finish(start("run", QUICK, "--simulate", "--speed", "20", "--out", str(tmp_path), "--json"))
    assert code == 0, out + err
    result: dict[str, Any] = json.loads(out)
    assert {
        "campaign", "points", "valid", "total", "rig_state", "stopped_by", "fit", "report", "wall_s", "motion_s",
    } <= result.keys()  # fmt: skip
    assert (result["valid"], result["total"], result["rig_state"], result["stopped_by"]) == (2, 2, "safe", None)
    assert result["motion_s"] == pytest.approx(9.0)
    for point, current_A in zip(result["points"], (0.5, 1.5), strict=True):
        assert point["verdict"] == "valid", point["reasons"]
        assert Path(point["file"]).is_absolute()
        assert Path(point["file"]).is_file()
        assert (point["waveform"], point["amplitude_m"], point["current_A"]) == ("sine", 0.03, current_A)
        assert point["lost_samples"] == 0
    assert Path(result["campaign"]).parent == tmp_path
    assert json.loads(Path(result["fit"]).read_text())["model"] == "asymmetric"
    assert "<html" in Path(result["report"]).read_text()
    assert "p002" in err


def test_ctrl_c_in_motion_ends_in_exit_4_with_the_rig_safe_and_the_point_not_valid(tmp_path: Path) -> None:
    process = start("run", QUICK, "--simulate", "--speed", "1", "--out", str(tmp_path), "--json")
    assert process.stderr is not None
    heard = []
    for line in process.stderr:
        heard.append(line)
        if line.strip() == "running":
            break
    assert heard
    assert process.poll() is None, "".join(heard)
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGINT)
    code, out, err = finish(process)
    assert code == 4, out + err
    result = json.loads(out)
    assert (result["stopped_by"], result["rig_state"], result["valid"]) == ("sigint", "safe", 0)
    assert [point["verdict"] == "valid" for point in result["points"]] == [False, False]
    assert result["fit"] is None


@pytest.mark.nightly
def test_a_matrix_beyond_the_simulated_rig_is_refused_before_anything_moves(tmp_path: Path) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(Path(QUICK).read_text().replace('"30 mm"', '"80 mm"'))
    code, out, err = finish(start("run", str(matrix), "--simulate", "--speed", "20", "--out", str(tmp_path), "--json"))
    assert code == 3, out + err
    refused = json.loads(out)
    assert refused.get("slug", refused.get("stopped_by")) == "matrix-infeasible"
    assert "largest amplitude that fits: 62.87 mm" in err + out  # 63.66 mm by 0.8 m/s / (2 pi 2 Hz), less for ramps
    assert not list(tmp_path.glob("*/points/*.h5"))


@pytest.mark.nightly
def test_the_demo_covers_the_simulated_truth_and_says_what_cannot_be_identified(tmp_path: Path) -> None:
    code, out, err = finish(start("demo", "--out", str(tmp_path)))
    assert code == 0, out + err
    for expected in ("all 8 points within limits", "p008", "truth", "eta not identifiable", "report.html", "fit.json"):
        assert expected in out, expected
    held = re.search(r"(\d+) of (\d+) identifiable parameters: true value within", out)
    assert held is not None
    assert int(held[2]) >= 10
    assert int(held[2]) - int(held[1]) <= 3, out  # of twelve 95 % intervals four miss in one demo of 400
    assert (next(tmp_path.iterdir()) / "report.html").is_file()
