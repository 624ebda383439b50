"""A seed is a world bit by bit: in another process, another folder, with other hashes of Python's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from matrices import matrix_text

from simulators.scenarios.plan import FaultEvent, ScenarioPlan
from simulators.scenarios.runs import live

MATRIX = matrix_text("0.5 A", amplitude="6 mm", frequency="4 Hz", cycles=5)
EVENTS = (("sensor-spike@0.4+0.3",), ("application-killed@3.0",), ("ecu-silent@0.4",))
PROGRAM = """
import json, sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from test_determinism import lived
json.dump(lived(Path(sys.argv[1]), *json.load(sys.stdin)), sys.stdout)
"""


def lived(folder: Path, matrix: str, *scenarios: list[str]) -> list[list[Any]]:
    """Digests, exit codes and failed checks of each scenario, as JSON has them."""
    ended = []
    for number, events in enumerate(scenarios):
        (folder / str(number)).mkdir(parents=True)
        scenario, end = live(ScenarioPlan(number, matrix, tuple(map(FaultEvent.parse, events))), folder / str(number))
        ended.append([scenario.digests(), end.sessions, end.failed])
    return list(json.loads(json.dumps(ended)))


def test_seeds_are_the_same_scenarios_wherever_they_live(tmp_path: Path, pytestconfig: pytest.Config) -> None:
    """In this process, whatever ran in it before, and in a new one; by day the scenario that is killed and resumed."""
    events = EVENTS[1:2] if pytestconfig.getoption("--short") else EVENTS
    given = [MATRIX, *map(list, events)]
    folder = tmp_path / ("another-folder-" * 22)[:200]
    folder.mkdir()
    environment = {"PYTHONHASHSEED": "22", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(folder), str(Path(__file__).parent)], stdin=subprocess.PIPE,
        stdout=subprocess.PIPE, text=True, env=os.environ | environment,
    ) as process:  # fmt: skip
        assert process.stdin is not None
        json.dump(given, process.stdin)
        process.stdin.close()
        process.stdin = None
        one = lived(tmp_path / "here", *given)
        other = json.loads(process.communicate(timeout=170)[0])
    assert len(one) == len(events)
    assert one == other
    assert all(failed == [] for _, _, failed in one)
    journals = {digests["journal"] for digests, _, _ in one}
    assert len(journals) == len(events), "worlds of their own"
    resumed = [len(sessions) > 1 for _, sessions, _ in one]
    assert resumed == [event != EVENTS[0] for event in events]
