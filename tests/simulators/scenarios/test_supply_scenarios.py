"""Worlds of a bench whose coil is driven by a supply with a file of its own: the rig's rows hold there too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pytest
from matrices import matrix_text

from rig.document.html import fragment
from rig.recording.journal.campaign_log import read_log
from rig.report.document import unsupported
from simulators.scenarios.plan import FaultEvent
from simulators.scenarios.request import Files, request_for
from simulators.scenarios.runs import Ended, live
from simulators.scenarios.scenario import Scenario

ROOT = Path(__file__).resolve().parents[3]
DEMO = (ROOT / "examples/demo-bench.toml").read_text(encoding="utf-8")
MATRIX = matrix_text("0.5 A", amplitude="6 mm", frequency="4 Hz")
SUPPLY = """maker = "Acme"
settling_ms = 200
[link]
terminator = "\\r\\n"
echo = true
acknowledge = "^OK$"
[range]
current_A = [0, 5]
voltage_V = [0, 30]
[commands]
identify = "*IDN?"
remote = "SYST:REM"
set_current = "ISET1:{current_mA:.0f}"
set_voltage_limit = "VSET1:{voltage_V:.2f}"
output_on = "OUT1"
output_off = "OUT0"
measure_current = "IOUT1?"
measure_voltage = "VOUT1?"
read_output = "OUT?"
[answers]
current = '^(?P<value>[-+0-9.]+)A$'
"""
ECU = """[ecu]
url = "tcp://192.168.0.20:5025"
supply = "my-supply.toml"
poll = "50 ms"
timeout = "200 ms"
stale_after = "400 ms"
voltage_limit = "12 V"

"""


def files(folder: Path) -> Files:
    bench = DEMO[: DEMO.index("[ecu]")] + ECU + DEMO[DEMO.index("[load_cell]") :]
    (folder / "my-supply.toml").write_text(SUPPLY, encoding="utf-8")
    (folder / "my-bench.toml").write_text(bench, encoding="utf-8")
    (folder / "my-matrix.toml").write_text(MATRIX, encoding="utf-8")
    return Files(folder / "my-matrix.toml", folder / "my-bench.toml")


def lived(folder: Path, *events: str) -> tuple[Scenario, Ended]:
    request = request_for(files(folder), events or ("nothing",), None)
    plan = request.plan(3)
    (folder / "world").mkdir()
    return live(replace(plan, events=tuple(map(FaultEvent.parse, events))), folder / "world")


def test_a_matrix_runs_on_a_supply_described_by_a_file(tmp_path: Path) -> None:
    scenario, ended = lived(tmp_path)
    assert ended.failed == ()
    session = scenario.sessions[0]
    assert [point.verdict for point in session.answer.points] == ["valid"]
    current_A = session.truth.arrays[:, 2]
    assert np.max(current_A) == pytest.approx(0.5, abs=0.01)
    assert scenario.folder is not None
    slugs = {line["slug"] for line in scenario.journal if "-without-" in str(line.get("slug"))}
    assert {"ecu-without-timeout", "ecu-without-coil-temperature", "ecu-without-error-queue"} <= slugs
    assert "ecu-without-timeout: " in fragment(unsupported(read_log(scenario.folder)))


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("event", "slug", "stop"),
    [
        ("coil-open-short@0.4", "coil-open-short", "S2"),
        ("ecu-silent@0.4", "ecu-silent", "S2"),
        ("ecu-crc@0.4", "current-unmeasured", "S2"),
        ("ecu-restart@0.4", "ecu-restart", "S2"),
    ],
)
def test_rows_of_the_current_source_end_as_they_say(tmp_path: Path, event: str, slug: str, stop: str) -> None:
    scenario, ended = lived(tmp_path, event)
    assert ended.failed == ()
    (trip, *_) = [line for line in scenario.journal if line.get("what") == "trip"]
    assert (trip["slug"], trip["stop"]) == (slug, stop)
    rows = scenario.sessions[0].truth.arrays
    after = rows[rows[:, 0] > trip["latched_ns"] + 0.5e9]
    assert np.max(np.abs(after[:, 2])) < 0.05, "no current half a second after the stop"


def test_what_needs_a_bus_or_outlives_its_host_does_not_happen_here(tmp_path: Path) -> None:
    given = files(tmp_path)
    drawn = {event.what for seed in range(200) for event in request_for(given, (), None).plan(seed).events}
    assert drawn
    assert not drawn & {"can-busoff", "can-babble", "can-foreign", "ecu-overtemp", "station-killed", "power-cut"}
    for event in ("can-babble@1", "station-killed@1"):
        with pytest.raises(click.BadParameter, match="a power supply as the current source"):
            request_for(given, (event,), None)
