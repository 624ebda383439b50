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

from rig.faults.matrix import MATRIX, REACTIONS
from rig.recording.recorded_point import RecordedPoint

if TYPE_CHECKING:
    from conftest import Run
    from watched_campaign import Ending

SEEDS = "1 33 37"
"""Two stops at once, an ECU gone wrong in three ways, two refusals."""
SPEED = 10.0
LVDT_TELLS_NOTHING = frozenset({
    "lvdt-pulled", "usb-renumber:lvdt", "serial-garbage:lvdt", "serial-baud:lvdt", "sensor-saturated:lvdt",
    "sensor-nan:lvdt", "sensor-spike:lvdt", "sample-gap:lvdt-backwards", "sensors-swapped",
})
CONTROLLER_TELLS_NOTHING = frozenset({
    "modbus-busy", "modbus-reset", "modbus-halfopen", "modbus-mismatch", "modbus-wrong-tid", "rtu-stale", "rtu-crc",
    "actuator-frozen", "actuator-reboot", "register-layout",
})
CONTROLLER_TAKES_NO_COMMAND = CONTROLLER_TELLS_NOTHING | {"modbus-reject", "modbus-write-lost", "second-master"}
"""Where nobody who could see the rod is left, or no command can end its motion, "unknown" is the only true answer."""
STILL_M_S = 2e-3
NO_CURRENT_A = 0.05


def seeds() -> list[int]:
    wanted = os.environ.get("RIG_FAULT_SEEDS", SEEDS)
    first, colon, last = wanted.partition(":")
    return list(range(int(first), int(last))) if colon else [int(each) for each in wanted.split()]


def may_pass(name: str) -> bool:
    """Rows whose fault only warns or spoils a point when it passes soon enough; too much current always stops."""
    return MATRIX[name.partition(":")[0]].reaction.startswith(("W", "P")) and name != "current-tracking:over"


OTHER_NAMES = {
    "can-busoff:lost": ("can-lost",), "current-tracking:over": ("overcurrent",),
    # A value that stands at the greatest ever shown may be stuck or at its amplifier's end.
    "sensor-stuck": ("sensor-saturated",), "sensor-stuck:lvdt": ("sensor-saturated",),
}
"""Faults that the station may name otherwise than their row."""


def row_of(cause: str, injected: list[str]) -> str:
    """The row of the injected fault that the station named."""
    for name in injected:
        if cause in {name.partition(":")[0], *OTHER_NAMES.get(name, ())}:
            return name.partition(":")[0]
    raise AssertionError(f"{cause} was not injected: {injected}")


def drawn(ending: Ending) -> list[str]:
    """The schedule as the truth keeps it, in the words of `--fault`."""
    with h5py.File(ending.truth_path) as file:
        faults = file["entry/test"].attrs["faults"]
    return [each.decode() if isinstance(each, bytes) else str(each) for each in np.atleast_1d(faults)]


def may_be_unknown(injected: list[str]) -> bool:
    """Whether the faults together take away every proof of standstill, or every way to it."""
    faults = set(injected)
    unseen = faults & LVDT_TELLS_NOTHING and faults & CONTROLLER_TELLS_NOTHING
    return bool(unseen or ("stop-ignored" in faults and faults & CONTROLLER_TAKES_NO_COMMAND))


def assert_exit_code_and_cause(ending: Ending, injected: list[str]) -> None:
    """The exit code follows the row of the first cause; without one, no row that stops may have been there for good.

    Exit code 7 where the faults together leave nobody who could prove standstill, and only there.
    """
    cause = ending.answer["stopped_by"]
    known = ending.answer["rig_state"] == "safe"
    assert known or may_be_unknown(injected), ending.said
    if not known:
        assert (ending.exit_code, ending.answer["rig_state"]) == (7, "unknown")
        return
    if cause is None:
        passing = {each.partition("@")[0] for each in drawn(ending) if "+" in each}
        ignored = [name for name in injected if not may_pass(name) and name not in passing]
        assert not ignored, f"nothing stopped though {ignored} stay"
        assert ending.exit_code == (0 if set(ending.verdicts().values()) == {"valid"} else 5)
        return
    row = MATRIX[row_of(cause, injected)]
    assert ending.exit_code == (3 if row.end == "R" else 4)
    stop = REACTIONS[cause].stop if cause in REACTIONS else row.end
    assert ending.trips() == ([] if row.end == "R" else [(cause, stop)]), "one latched cause, the first"
    assert row.end in {"R", "P"} or row.stop is not None


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
