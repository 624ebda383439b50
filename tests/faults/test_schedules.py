"""Random seeded schedules: whatever is drawn, the campaign ends as the rows of its faults say.

A few seeds by default; `python3 dev.py faults --schedules 0:40` runs those of a range.
"""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING

import h5py
import numpy as np
import pytest

from rig.fault_matrix import MATRIX, STOPS
from rig.recording.run import RecordedPoint

if TYPE_CHECKING:
    from conftest import Run
    from watched_campaign import Ending

pytestmark = pytest.mark.wire

SEEDS = "1 33 37"
"""Two stops at once, an ECU gone wrong in three ways, two refusals."""
SPEED = 10.0
STILL_M_S = 2e-3
NO_CURRENT_A = 0.05


def seeds() -> list[int]:
    wanted = os.environ.get("RIG_FAULT_SEEDS", SEEDS)
    first, colon, last = wanted.partition(":")
    return list(range(int(first), int(last))) if colon else [int(each) for each in wanted.split()]


def may_pass(slug: str) -> bool:
    """Rows whose fault only warns or spoils a point when it passes soon enough."""
    return MATRIX[slug].reaction.startswith(("W", "P"))


def drawn(ending: Ending) -> list[str]:
    """The schedule as the truth keeps it, in the words of `--fault`."""
    with h5py.File(ending.folder / "truth.h5") as file:
        faults = file["entry/test"].attrs["faults"]
    return [each.decode() if isinstance(each, bytes) else str(each) for each in np.atleast_1d(faults)]


def assert_exit_code_and_cause(ending: Ending, injected: list[str]) -> None:
    """The exit code follows the row of the first cause; without one, no row that stops may have been there for good."""
    cause = ending.answer["stopped_by"]
    if cause is None:
        passing = {each.partition("@")[0] for each in drawn(ending) if "+" in each}
        ignored = [slug for slug in injected if not may_pass(slug) and slug not in passing]
        assert not ignored, f"nothing stopped though {ignored} stay"
        assert ending.exit_code == (0 if set(ending.verdicts().values()) == {"valid"} else 5)
        return
    assert cause in injected
    row = MATRIX[cause]
    assert ending.exit_code == (3 if row.stop == "R" else 4)
    assert ending.trips() == ([] if row.stop == "R" else [(cause, row.stop)]), "one latched cause, the first"
    assert row.stop == "R" or row.stop in STOPS


def assert_at_rest(ending: Ending, injected: list[str]) -> None:
    """At the end the rod stands and no current flows, except where that is the fault."""
    truth = ending.truth
    assert np.abs(truth.velocity_m_s[-200:]).max() < STILL_M_S
    if "current-stuck" not in injected:
        assert np.abs(truth.current_A[-50:]).max() < NO_CURRENT_A


@pytest.mark.parametrize("seed", seeds())
def test_a_random_schedule_ends_as_its_rows_say(run: Run, seed: int) -> None:
    ending = run(simulator=("--fault-seed", str(seed), "--fault-within", "9"), speed=SPEED)
    injected = [each.text for each in ending.truth.all("FAULT")]
    assert set(injected) <= {each.partition("@")[0] for each in drawn(ending)}
    assert ending.answer["rig_state"] == "safe", ending.said
    assert_exit_code_and_cause(ending, injected)
    assert_at_rest(ending, injected)
    files = {each["id"]: each["file"] for each in ending.answer["points"]}
    for name, verdict in ending.verdicts().items():
        if files[name] is not None:
            point = RecordedPoint.open(ending.folder / "points" / f"{name}.h5")
            assert point.verdict == verdict
            assert point.time_s.size > 0


def test_what_was_drawn_can_be_written_as_faults_and_happens_again(run: Run) -> None:
    first = run(simulator=("--fault-seed", "2"), speed=SPEED)
    again = run(*drawn(first), speed=SPEED)
    assert drawn(again) == drawn(first)
    assert (again.exit_code, again.answer["stopped_by"]) == (first.exit_code, first.answer["stopped_by"])
    assert json.dumps(first.answer["stopped_by"]) != "null"
