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


@pytest.mark.nightly
def test_a_killed_block_goes_on_with_the_cycles_that_are_left(tmp_path: Path) -> None:
    matrix = matrix_text("0.5 A", amplitude="10 mm", frequency="4 Hz") + ENDURANCE
    plan = ScenarioPlan(1, matrix, (FaultEvent.parse("application-killed@7.2"),))
    scenario, ended = live(plan, tmp_path)
    assert ended.failed == ()
    answer = scenario.sessions[-1].answer
    assert answer is not None
    (test,) = answer.endurance
    assert (test["cycles_run"], test["cycles_recorded"], test["pieces"]) == (20, 20, 3)
    assert test["cycles_unrecorded_at_most"] > 0
    files = sorted(tmp_path.rglob("points/wear-b*.h5"))
    numbers = np.concatenate([columns["number"] for file in files if (columns := read_cycles(file)) is not None])
    assert sorted(numbers.tolist()) == list(range(1, 21))
