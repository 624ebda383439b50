"""An endurance test whose application is killed within a block: every cycle is run and counted once."""

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
