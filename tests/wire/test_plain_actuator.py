"""A whole matrix on an actuator without lease, acknowledgement, echo, watchdog or function generator."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from in_process import rig as rig_here
from matrices import matrix_text
from scenario_campaign import SEED, Handle, ScenarioCampaign, rig_options

from drivers import catalogue
from rig.campaign import CampaignOptions
from rig.recording.journal.campaign_log import read_log
from simulators.scenarios.scenario import Silent
from simulators.scenarios.stage import Application, Stage

HERE = Path(__file__).parent / "plain_actuator"
LATE_S = 0.03
CROWDED = 2.0
"""Processes per core that wanted to run during the last minute."""
AGAIN = 3
TOO_BUSY = {"setpoints-late", "host-late"}
MATRIX = matrix_text("0.5 A", "1.0 A", amplitude="10 mm", frequency="2 Hz", cycles=5)


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


def rig(*arguments: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": f"{HERE}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    return subprocess.run(
        [sys.executable, "-m", "rig.cli.main", *arguments], env=environment, capture_output=True, text=True,
        timeout=170, check=False,
    )


def skip_where_the_host_was_held_up(folder: Path) -> None:
    """Nobody makes set-points for an actuator whose host does not run."""
    counted = [line for line in read_log(folder) if line.get("what") == "setpoints"]
    if counted and counted[-1]["worst_s"] > LATE_S:
        pytest.skip(f"this host was held up: a set-point came {1e3 * counted[-1]['worst_s']:.0f} ms late")
    if os.getloadavg()[0] > CROWDED * (os.cpu_count() or 1):
        pytest.skip(f"this host was too busy: {os.getloadavg()[0]:.0f} processes wanted to run")


def test_a_matrix_runs_in_virtual_time_on_an_actuator_that_only_follows_set_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the time limits of hardware; on real processes by night."""
    monkeypatch.syspath_prepend(str(HERE))
    plain_rig, plain_actuator = import_module("plain_rig"), import_module("plain_actuator")
    monkeypatch.setitem(catalogue._REGISTERED, "plain", plain_actuator.PlainActuator)
    matrix, truth = tmp_path / "matrix.toml", tmp_path / "truth.h5"
    matrix.write_text(MATRIX, encoding="utf-8")
    with Stage(SEED, tmp_path, tick_s=0.001) as stage:  # as often as the rig hands over on real wires
        for name in ("socket", "time"):
            stage.installed.put(plain_actuator, name, stage.installed.stand_in(getattr(plain_actuator, name)))
        options, run = rig_options("--speed", "1")
        bench = stage.serve(plain_rig.PlainRig(options, replace(run, truth=truth)))
        ran = Application(stage, CampaignOptions(matrix, tmp_path / "out", bench_path=bench), Silent())
        ending = ScenarioCampaign(Handle(stage, ran.process), tmp_path / "out", truth, stage, ran).finish()
        assert not stage.rig.plant.command["pressure"][0]
    assert_it_can_do_little(ending.log)
    assert (ending.exit_code, ending.answer["rig_state"]) == (0, "safe"), ending.answer["points"]
    assert ending.verdicts() == {"p001": "valid", "p002": "valid"}, ending.answer["points"]
    for run_of_it in ending.truth.runs():
        assert np.ptp(ending.truth.displacement_m[run_of_it]) == pytest.approx(0.02, rel=0.05)


def assert_it_can_do_little(story: list[dict[str, Any]]) -> None:
    """What the actuator lacks is reported by name."""
    named = {line["slug"] for line in story if str(line.get("slug", "")).startswith("actuator-without")}
    assert {"actuator-without-lease", "actuator-without-watchdog", "actuator-without-generator"} <= named


@pytest.mark.nightly
@pytest.mark.wire
def test_a_matrix_runs_on_an_actuator_that_only_follows_set_points(bench: Path, tmp_path: Path) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(MATRIX, encoding="utf-8")
    unknown = rig_here("plan", matrix, "--bench", bench)
    assert unknown.returncode == 2
    assert re.search(r'line 13: actuator.register_map = "plain": .*delta-rmc, demo', unknown.stderr), unknown.stderr
    for attempt in range(AGAIN):
        done = rig("run", str(matrix), "--bench", str(bench), "--out", str(tmp_path / f"out{attempt}"), "--json")
        answer = json.loads(done.stdout)
        if answer["stopped_by"] not in TOO_BUSY:  # for the time limits of hardware: once more
            break
    folder = Path(answer["campaign"])
    story = read_log(folder)
    assert_it_can_do_little(story)
    assert "actuator-without-lease" in done.stderr, "also on the terminal"
    assert answer["rig_state"] == "safe"
    for _ in range(AGAIN):
        # A busy host polls seldom, and ties force and displacement together less well: as it says, run again.
        reasons = [reason for point in answer["points"] for reason in point["reasons"]]
        if done.returncode == 5 and all(reason.startswith("skew: ") for reason in reasons):
            done = rig("run", "--resume", str(folder), "--json")
            answer = json.loads(done.stdout)
    if done.returncode != 0:
        # They move the rod otherwise; then its points, or the rig's stop, rightly say so.
        skip_where_the_host_was_held_up(folder)
    assert done.returncode == 0, done.stderr
    assert [(point["id"], point["verdict"]) for point in answer["points"]] == [("p001", "valid"), ("p002", "valid")]


@pytest.mark.nightly
@pytest.mark.wire
def test_ctrl_c_in_motion_fades_its_program_out_and_proves_the_rest(bench: Path, tmp_path: Path) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(MATRIX, encoding="utf-8")
    command = [sys.executable, "-m", "rig.cli.main", "run", str(matrix), "--bench", str(bench), "--json"]
    environment = os.environ | {"PYTHONPATH": f"{HERE}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    with subprocess.Popen(
        [*command, "--out", str(tmp_path / "out")], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    ) as running:
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            journals = list(tmp_path.glob("out/*/journal.jsonl"))
            if journals and '"phase": "running"' in journals[0].read_text(encoding="utf-8"):
                break
            time.sleep(0.05)
        time.sleep(2.5)
        running.send_signal(signal.SIGINT)
        details, shown = running.communicate(timeout=60)
    answer = json.loads(details)
    if answer["stopped_by"] != "sigint":
        skip_where_the_host_was_held_up(Path(answer["campaign"]))
    assert (running.returncode, answer["rig_state"], answer["stopped_by"]) == (4, "safe", "sigint"), shown
    story = read_log(Path(answer["campaign"]))
    assert next(line["action"] for line in story if line.get("what") == "sent") == "fade"
    (safe,) = [line for line in story if line.get("what") == "safe" and line["stop"] == "S2"]
    assert (safe["standstill"], safe["current_zero"]) == (True, True)
