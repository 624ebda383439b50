"""An endurance test that is killed or stopped within a block: every cycle is run and counted once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matrices import matrix_text

from rig.recording.hdf5.reading import read_cycles
from simulators.scenarios.plan import FaultEvent, ScenarioPlan
from simulators.scenarios.runs import live

ENDURANCE = """
[[endurance]]
id = "wear"
amplitude = "10 mm"
frequency = "4 Hz"
current = "0.5 A"
cycles = 20
block = 10
"""


PROGRAM = ENDURANCE.replace(
    'current = "0.5 A"', 'current_program = [["0 s", "0.2 A"], ["1.25 s", "1 A"]]\ncurrent_period = "2.5 s"'
)
MIXED = ENDURANCE.replace('"4 Hz"', '"2 Hz"\nadd = [{ amplitude = "1 mm", frequency = "4 Hz" }]')
STREAMED = (Path(__file__).resolve().parents[3] / "examples" / "streamed-bench.toml").read_text(encoding="utf-8")


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("test", "bench", "event"),
    [
        (ENDURANCE, "", "application-killed@7.2"), (ENDURANCE, "", "station-killed@7.2"),
        (PROGRAM, "", "station-killed@7.2"), (MIXED, STREAMED, "application-killed@8"),
        (MIXED, STREAMED, "station-killed@8"),
    ],
    ids=["application", "station", "station-program", "application-record", "station-record"],
)
def test_a_killed_block_goes_on_with_the_cycles_that_are_left(
    tmp_path: Path, test: str, bench: str, event: str
) -> None:
    matrix = matrix_text("0.5 A", amplitude="10 mm", frequency="4 Hz" if test is not MIXED else "2 Hz") + test
    plan = ScenarioPlan(1, matrix, (FaultEvent.parse(event),), bench=bench, lasts_s=300.0 if bench else 0.0)
    scenario, ended = live(plan, tmp_path)
    assert ended.failed == ()
    answer = scenario.sessions[-1].answer
    assert answer is not None
    (counted,) = answer.endurance
    assert (counted["cycles_run"], counted["cycles_recorded"], counted["pieces"]) == (20, 20, 3)
    assert counted["cycles_unrecorded_at_most"] > 0
    files = sorted(tmp_path.rglob("points/wear-b*.h5"))
    numbers = np.concatenate([columns["number"] for file in files if (columns := read_cycles(file)) is not None])
    assert sorted(numbers.tolist()) == list(range(1, 21))


@pytest.mark.nightly
def test_a_disk_that_fills_up_within_a_block_leaves_no_cycle_unmentioned(tmp_path: Path) -> None:
    """Until the run is resumed, the cycles of the block count as run without a record."""
    matrix = matrix_text("0.5 A", amplitude="10 mm", frequency="4 Hz") + ENDURANCE
    scenario, ended = live(ScenarioPlan(1, matrix, (FaultEvent.parse("disk-full@6+3"),)), tmp_path)
    assert ended.failed == ()
    assert ended.sessions == (4, 0)
    first, last = (session.answer.endurance[0] for session in scenario.sessions)
    assert (first["cycles_run"], first["cycles_unrecorded_at_most"]) == (0, 10)
    assert (last["cycles_run"], last["cycles_recorded"], last["pieces"]) == (20, 20, 3)
    assert 0 < last["cycles_unrecorded_at_most"] <= 10


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("event", "slug", "column", "limit"),
    [
        ("ecu-overtemp:coil@3.5+2", "coil-temperature", 6, 120.0),
        ("load-train:jammed@3.5+2", "force-limit", 4, 5000.0),
        ("second-master:offset@3.5+2", "stroke-limit", 3, 0.085),
    ],
)
def test_a_limit_stops_a_block_in_progress_which_then_continues_with_resume(
    tmp_path: Path, event: str, slug: str, column: int, limit: float
) -> None:
    """The interlocks act in the block: S2, 0 A, no pressure, exit code 4. Despite retries, the operator resumes."""
    matrix = matrix_text("0.5 A", amplitude="10 mm", frequency="4 Hz", more="[campaign]\nretries = 2") + ENDURANCE
    scenario, ended = live(ScenarioPlan(1, matrix, (FaultEvent.parse(event),)), tmp_path)
    assert ended.failed == ()
    assert ended.sessions == (4, 0)
    first, last = scenario.sessions
    assert first.answer.stop.slug == slug
    assert (first.answer.stop.unfinished, first.answer.stop.current_zero, first.answer.stop.pressure_off) == (
        "wear-b1", True, True,
    )
    rows = first.truth.arrays
    beyond_ns = rows[np.abs(rows[:, column]) > limit, 0][0]
    trips = [line for line in scenario.journal if line.get("event") == "station" and line.get("what") == "trip"]
    assert 0.0 <= trips[0]["latched_ns"] - beyond_ns < 0.11e9
    (counted,) = last.answer.endurance
    assert (counted["cycles_run"], counted["pieces"], counted["cycles_unrecorded_at_most"]) == (20, 3, 0)
