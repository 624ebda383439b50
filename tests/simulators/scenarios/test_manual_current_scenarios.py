"""Worlds of a bench whose current is set by hand: a simulated hand does what it is asked for, stops included."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pytest
from matrices import matrix_text

from rig.document.html import fragment
from rig.recording.journal.campaign_log import read_log
from rig.recording.run import Run
from rig.report.document import unsupported
from simulators.scenarios.plan import FaultEvent
from simulators.scenarios.request import Files, request_for
from simulators.scenarios.runs import Ended, live
from simulators.scenarios.scenario import Scenario

DEMO = (Path(__file__).resolve().parents[3] / "examples/demo-bench.toml").read_text(encoding="utf-8")
BY_HAND = DEMO[: DEMO.index("[ecu]")] + "[ecu]\nby_hand = true\n\n" + DEMO[DEMO.index("[load_cell]") :]


def files(folder: Path) -> Files:
    (folder / "my-bench.toml").write_text(BY_HAND, encoding="utf-8")
    (folder / "my-matrix.toml").write_text(matrix_text("0.5 A", amplitude="6 mm", frequency="4 Hz"), encoding="utf-8")
    return Files(folder / "my-matrix.toml", folder / "my-bench.toml")


def lived(folder: Path, *events: str) -> tuple[Scenario, Ended]:
    plan = request_for(files(folder), events or ("nothing",), None).plan(3)
    (folder / "world").mkdir()
    return live(replace(plan, events=tuple(map(FaultEvent.parse, events))), folder / "world")


def requested_currents(scenario: Scenario) -> list[str]:
    return [
        line["text"] for line in scenario.journal if line.get("code") == "by-hand" and line["text"].startswith("Set ")
    ]


def test_a_matrix_runs_and_its_files_say_that_nobody_measured_the_current(tmp_path: Path) -> None:
    scenario, ended = lived(tmp_path)
    assert ended.failed == ()
    assert [text.split(" on the supply")[0] for text in requested_currents(scenario)] == [
        "Set 0 A",
        "Set 0.50 A",
        "Set 0 A",
    ]
    truth = scenario.sessions[0].truth.arrays
    assert np.max(truth[:, 2]) == pytest.approx(0.5, abs=0.01)
    rises = np.flatnonzero(truth[:, 2] > 0.02)[0]
    falls = np.flatnonzero(truth[:, 2] > 0.48)[-1]
    assert list(truth[[rises, falls], 5]) == [0.0, 0.0], "no pressure while the knob is turned"
    assert scenario.folder is not None
    run = Run.open(scenario.folder)
    (point,) = run.points
    assert (point.verdict, point.quality.current.mean_A, point.quality.current.told_by) == ("valid", None, "operator")
    assert "ecu-without-measurement: the coil current is not measured" in fragment(unsupported(read_log(run.path)))


def test_a_stop_takes_the_pressure_away_and_then_has_the_current_taken_away(tmp_path: Path) -> None:
    scenario, ended = lived(tmp_path, "loadcell-pulled@0.4")
    assert ended.failed == ()
    first = scenario.sessions[0]
    assert (first.exit_code, first.answer.stop.slug, first.answer.stop.current_zero) == (4, "loadcell-pulled", True)
    (trip, *_) = [line for line in scenario.journal if line.get("what") == "trip"]
    truth = first.truth.arrays
    stopped = truth[truth[:, 0] > trip["latched_ns"]]
    gone = stopped[np.flatnonzero(np.abs(stopped[:, 2]) < 0.05)[0]]
    assert gone[5] == 0.0, "the pressure is off before anybody turns the knob"
    phases = [line["phase"] for line in scenario.journal if line.get("event") == "phase"]
    assert "waiting for the operator to switch the current off" in phases


def test_what_tells_of_the_coil_does_not_happen_here(tmp_path: Path) -> None:
    given = files(tmp_path)
    drawn = {event.what for seed in range(100) for event in request_for(given, (), None).plan(seed).events}
    assert drawn
    assert not drawn & {"ecu-silent", "coil-open-short", "current-stuck", "can-busoff", "application-killed"}
    with pytest.raises(click.BadParameter, match="if the current is not measured"):
        request_for(given, ("coil-open-short@1",), None)
