"""A seed is a world bit by bit: in another process, another folder, with other hashes of Python's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from matrices import matrix_text

MATRIX = matrix_text("0.5 A", amplitude="6 mm", frequency="4 Hz", cycles=5)
EVENTS = (("sensor-spike@0.4+0.3",), ("application-killed@3.0",), ("ecu-silent@0.4",))
PROGRAM = """
import json, sys
from pathlib import Path
from simulators.scenarios.plan import FaultEvent, ScenarioPlan
from simulators.scenarios.runs import live
matrix, *worlds = json.load(sys.stdin)
for number, happenings in enumerate(worlds):
    folder = Path(sys.argv[1]) / str(number)
    folder.mkdir()
    world, ended = live(ScenarioPlan(number, matrix, tuple(map(FaultEvent.parse, happenings))), folder)
    print(json.dumps([world.digests(), ended.sessions, ended.failed]))
"""


def test_seeds_are_the_same_scenarios_wherever_they_live(tmp_path: Path, pytestconfig: pytest.Config) -> None:
    """By day the one that is killed and resumed."""
    events = EVENTS[1:2] if pytestconfig.getoption("--short") else EVENTS
    processes = []
    for number in ("1", "22"):
        folder = tmp_path / ("another-folder-" * int(number))[:200]
        folder.mkdir()
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env=os.environ | {"PYTHONHASHSEED": number, "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        assert process.stdin is not None
        process.stdin.write(json.dumps([MATRIX, *events]))
        process.stdin.close()
        process.stdin = None
        processes.append(process)
    reported = [process.communicate(timeout=170)[0].splitlines() for process in processes]
    one, other = (list(map(json.loads, lines)) for lines in reported)
    assert len(one) == len(events)
    assert one == other
    assert all(failed == [] for _, _, failed in one)
    journals = {digests["journal"] for digests, _, _ in one}
    assert len(journals) == len(events), "worlds of their own"
    resumed = [len(sessions) > 1 for _, sessions, _ in one]
    assert resumed == [event != EVENTS[0] for event in events]
