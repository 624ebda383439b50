"""Worlds of a bench whose coil is commanded by an analogue output on Modbus: the rig's rows hold there too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

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

ROOT = Path(__file__).resolve().parents[3]
DEMO = (ROOT / "examples/demo-bench.toml").read_text(encoding="utf-8")
MATRIX = matrix_text("0.5 A", amplitude="6 mm", frequency="4 Hz")
OUTPUT = """maker = "Acme"
[range]
current_A = [0, 5]
[modbus]
first_address = {holding = 40001, input = 30001, coil = 1}
[quantities]
current = {address = 40001, scale = 0.0005, offset = -1.0, unit = "A"}
enable = {address = 5, function = "coil"}
kind = {address = 30100, function = "input"}
[identity]
kind = 77
"""
MEASURED = OUTPUT.replace(
    "kind = {", 'measured_current = {address = 30001, function = "input", type = "f32", unit = "mA"}\nkind = {'
)
ECU = """[ecu]
url = "modbus-tcp://192.168.0.30:502"
supply = "my-output.toml"
device_id = 7
poll = "20 ms"
timeout = "100 ms"
stale_after = "400 ms"

"""


def lived(folder: Path, output: str, *events: str) -> tuple[Scenario, Ended]:
    bench = DEMO[: DEMO.index("[ecu]")] + ECU + DEMO[DEMO.index("[load_cell]") :]
    (folder / "my-output.toml").write_text(output, encoding="utf-8")
    (folder / "my-bench.toml").write_text(bench, encoding="utf-8")
    (folder / "my-matrix.toml").write_text(MATRIX, encoding="utf-8")
    files = Files(folder / "my-matrix.toml", folder / "my-bench.toml")
    plan = request_for(files, events or ("nothing",), None).plan(3)
    (folder / "world").mkdir()
    return live(replace(plan, events=tuple(map(FaultEvent.parse, events))), folder / "world")


def test_a_matrix_runs_by_an_output_that_nobody_measures_and_says_so(tmp_path: Path) -> None:
    scenario, ended = lived(tmp_path, OUTPUT)
    assert ended.failed == ()
    session = scenario.sessions[0]
    assert scenario.folder is not None
    (point,) = Run.open(scenario.folder).points
    assert (point.verdict, point.quality.current.mean_A, point.quality.current.told_by) == ("valid", None, "set-point")
    assert np.max(session.truth.arrays[:, 2]) == pytest.approx(0.5, abs=0.01), "the coil really had it"
    slugs = {line["slug"] for line in scenario.journal if "-without-" in str(line.get("slug"))}
    assert {"ecu-without-timeout", "ecu-without-measurement", "ecu-without-coil-temperature"} <= slugs
    shown = fragment(unsupported(read_log(scenario.folder)))
    assert "ecu-without-timeout: no output watchdog is specified" in shown


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("event", "slug"),
    [("ecu-silent@0.4", "ecu-silent"), ("ecu-restart@0.4", "ecu-restart")],
)
def test_rows_of_the_current_source_end_as_they_say(tmp_path: Path, event: str, slug: str) -> None:
    scenario, ended = lived(tmp_path, MEASURED, event)
    assert ended.failed == ()
    (trip, *_) = [line for line in scenario.journal if line.get("what") == "trip"]
    assert (trip["slug"], trip["stop"]) == (slug, "S2")
    rows = scenario.sessions[0].truth.arrays
    after = rows[rows[:, 0] > trip["latched_ns"] + 0.5e9]
    assert np.max(np.abs(after[:, 2])) < 0.05, "no current half a second after the stop"
