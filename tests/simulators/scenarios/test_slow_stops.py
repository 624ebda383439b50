"""How long a rod may move after a stop, as the judge of worlds sees it: it follows the matrix's longest period."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from matrices import matrix_text

from rig.campaign.results import RigState
from simulators.scenarios.stop_invariants import stop_stays_stopped
from simulators.scenarios.view import View

BENCH = Path(__file__).resolve().parents[3] / "examples" / "demo-bench.toml"
TRIP_NS = 1e12


def session(
    root: Path, frequency: str, moves_s: float, faults: frozenset[str] = frozenset(), state: RigState = RigState.SAFE
) -> View:
    """What a judge sees: a stop, after which the rod moves on for so long."""
    shutil.copy(BENCH, root / "bench.toml")
    (root / "matrix.toml").write_text(matrix_text("0 A", amplitude="10 mm", frequency=frequency), encoding="utf-8")
    t_s = np.arange(0.0, 20.0, 0.01)
    rows = np.zeros((len(t_s), 7))
    rows[:, 0], rows[:, 1] = TRIP_NS + 1e9 * t_s, np.where(t_s < moves_s, 0.01, 0.0)
    trip = {"t_ns": TRIP_NS, "latched_ns": TRIP_NS, "slug": "modbus-write-lost"}
    seen = SimpleNamespace(
        scenario=SimpleNamespace(root=root),
        session=SimpleNamespace(answer=SimpleNamespace(rig_state=state)),
        stalled_s=0.0,
        by_hand=False,
        hidden=False,
        station=lambda *what: [trip] if "trip" in what else [],
        between=lambda begin_ns, end_ns: rows[(rows[:, 0] >= begin_ns) & (rows[:, 0] < end_ns)],
        pressed_ns=lambda _: math.inf,
        slips_ns=lambda _: math.inf,
        restarted_ns=lambda _: TRIP_NS + 20e9,
        faults=set,
        faults_by_name=lambda: faults,
    )
    return cast("View", seen)


@pytest.mark.parametrize(
    ("frequency", "moves_s", "found"),
    [("4 Hz", 2.9, False), ("4 Hz", 3.1, True), ("0.25 Hz", 5.0, False), ("0.25 Hz", 12.0, True)],
)
def test_a_stopped_rod_is_given_the_time_of_its_slowest_motion_and_no_more(
    frequency: str, moves_s: float, found: bool, tmp_path: Path
) -> None:
    """Of 0.25 Hz a controller that is left alone fades out for 4 s, after its watchdog's time."""
    assert bool(list(stop_stays_stopped(session(tmp_path, frequency, moves_s)))) is found


@pytest.mark.parametrize(
    ("faults", "state", "found"),
    [
        ({"stop-ignored", "stop-ignored:pressure"}, RigState.UNKNOWN, False),
        ({"stop-ignored", "stop-ignored:pressure"}, RigState.SAFE, True),
        ({"stop-ignored"}, RigState.UNKNOWN, True),
    ],
)
def test_only_a_rod_that_nothing_stops_and_that_is_reported_so_may_move_on(
    faults: set[str], state: RigState, found: bool, tmp_path: Path
) -> None:
    assert bool(list(stop_stays_stopped(session(tmp_path, "4 Hz", 4.5, frozenset(faults), state)))) is found
