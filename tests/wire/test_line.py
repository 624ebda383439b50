"""`rig line` on real processes: one specimen after another, a bad damper among them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from rig.errors import EXIT_NOT_ACCEPTED

ROOT = Path(__file__).parents[2]

pytestmark = [pytest.mark.wire, pytest.mark.nightly]


def test_a_list_of_serial_numbers_is_tested_on_the_simulated_rig(tmp_path: Path) -> None:
    """MR-103 has 20 % less yield force per ampere: rebound, compression and energy at 1.5 A are outside the bands."""
    done = subprocess.run(
        [sys.executable, "-m", "rig.cli.main", "line", "examples/line.toml", "--simulate", "--speed", "10", "--out",
         str(tmp_path), "--json"],
        input="MR-101\nMX-1\nMR-101\nMR-103\n", capture_output=True, text=True, cwd=ROOT,
        timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == EXIT_NOT_ACCEPTED, done.stderr
    answer = json.loads(done.stdout)
    assert [(one["serial_number"], one["verdict"], one["exit_code"]) for one in answer["specimens"]] == [
        ("MR-101", "ok", 0), ("MR-103", "not-ok", EXIT_NOT_ACCEPTED),
    ]  # fmt: skip
    assert [one["slug"] for one in answer["refused"]] == ["bad-serial-number", "tested-before"]
    bad = json.loads((Path(answer["specimens"][1]["campaign"]) / "acceptance.json").read_text())
    states = {(one["quantity"], one["motion"]["current_A"]): one["state"] for one in bad["acceptance"]["results"]}
    assert {key for key, state in states.items() if state == "fail"} == {
        ("rebound_force", 1.5), ("jounce_force", 1.5), ("energy", 1.5),
    }  # fmt: skip
    runs = [Path(one["campaign"]) for one in answer["specimens"]]
    assert all((run / "report.html").is_file() for run in runs), "written after the verdict"
    assert (tmp_path / ".rig-runs.sqlite").is_file(), "the results database"
