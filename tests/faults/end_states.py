"""What must be true when a campaign of the fault suite has ended: exit code, first cause, times, 0 A, standstill.

Everything is judged on the simulated physics and on the files, as the row of the fault matrix says.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matrices import PERIOD_S
from true_states import FaultEvent, Truth

from drivers.roles import State
from rig.faults.matrix import MATRIX

if TYPE_CHECKING:
    from watched_campaign import Ending

COIL_LAG_S = 0.250
NO_CURRENT_A = 0.05
STILL_M_S = 2e-3
STOP_COMMANDS = ("FADE_STOP", "HALT", "HYDRAULICS_OFF")
OWN_STOPS = ("TRIP",)
"""The controller stops by itself, where no command reaches it."""
SETTLING_S = {"S2": 0.200, "S1": 0.200, "SO": 0.300}
EXIT_CODES = {"S2": 4, "S1": 4, "SO": 4, "R": 3, "P": 5, "W": 0}


@dataclass(frozen=True)
class Expected:
    """What a stop by a row of the matrix must look like.

    Attributes:
        finished, broken: the point that stays valid, and the one that was running.
        stop: kind of stop, where it is not the row's.
        speed: of the simulated rig.
        first: the motion's first stop command, where it is not the one of the kind of stop.
        settling_s: from that command to standstill; None as the kind of stop has it.
        injected_as: name of the fault in the truth.
        period_s: of the motion; a fade-out takes one.
        slug_of_station: what the station calls it, where a row has two names.
        allowed_s: from the fault to the first stop command; None: what a busy machine may need.
        logged: the journal has the cause; not on a disk that takes no further line.
    """

    finished: tuple[str, ...] = ("p001",)
    broken: str | None = "p002"
    stop: str | None = None
    speed: float = 5.0
    first: str | None = None
    settling_s: float | None = None
    injected_as: str | None = None
    period_s: float = PERIOD_S
    slug_of_station: str | None = None
    allowed_s: float | None = None
    logged: bool = True


def assert_stopped(ending: Ending, slug: str, **differing: object) -> None:
    """Assert the end state of a row whose reaction is a stop; what differs from `Expected` is given by name."""
    expected, row, truth = Expected(**differing), MATRIX[slug], ending.truth  # type: ignore[arg-type]  # by name
    kind, named = expected.stop or row.end, expected.slug_of_station or slug
    assert ending.exit_code == EXIT_CODES[kind], ending.output
    assert ending.answer["stopped_by"] == named
    assert ending.answer["rig_state"] == "safe"
    assert ending.trips() == ([(named, kind)] if expected.logged else []), "one latched cause, the first"
    fault_ns = ending.stopped_from_ns
    if fault_ns is None:
        fault_ns = truth.first("FAULT", text=expected.injected_as or slug).host_ns
    zero, motion = stop_commands(truth, fault_ns, OWN_STOPS if expected.first == "TRIP" else STOP_COMMANDS)
    assert motion.code == (expected.first or ("HALT" if kind == "SO" else "FADE_STOP"))
    allowed_s = max(10.0 * (row.limit_s or 0.1), 1.0) if expected.allowed_s is None else expected.allowed_s
    assert (min(zero.host_ns, motion.host_ns) - fault_ns) / 1e9 <= allowed_s
    assert no_motion_command_after(truth, motion)
    settling_s = settles_within_s(kind, expected.speed, expected.period_s)
    assert_quiet(ending, zero, motion, expected.settling_s or settling_s)
    if kind == "S1":
        # A latched trip stays the controller's state, with the pressure gone.
        assert truth.state[-1] in {State.OFF, State.TRIPPED}
        assert truth.all("HYDRAULICS_OFF", text="DONE", after=motion)
    for name in expected.finished:
        assert ending.verdicts()[name] == "valid"
        assert ending.point(name).verdict == "valid"
    if expected.broken is not None:
        point = ending.point(expected.broken)
        assert point.verdict == "invalid"
        assert any(reason.startswith(named) for reason in point.reasons), point.reasons


def settles_within_s(kind: str, speed: float, period_s: float) -> float:
    """Simulated time from the stop command to standstill: fade-out and 200 ms, or 300 ms; commands of a faster rig
    arrive up to one wall tick late on its clock."""
    fade_s = 0.0 if kind == "SO" else period_s
    return fade_s + SETTLING_S[kind] + 0.002 * speed


def stop_commands(truth: Truth, fault_ns: int, codes: tuple[str, ...]) -> tuple[FaultEvent, FaultEvent]:
    """The current's and the motion's first stop command after the fault."""
    later = [line for line in truth.log if line.host_ns >= fault_ns]
    zero = [line for line in later if line.code == "SET_CURRENT" and line.text.startswith(("0.000", "-0.000"))]
    zero += [line for line in later if line.code == "ECU_FAULT"]
    motion = [line for line in later if line.code in codes]
    assert motion, f"no stop command after the fault: {later}"
    return (min(zero, key=lambda line: line.host_ns) if zero else motion[0]), motion[0]


def no_motion_command_after(truth: Truth, stop: FaultEvent) -> bool:
    """Whether nothing that moves or raises the pressure was asked for after the stop (S1 lowers it first)."""
    return not truth.all("START", "MOVE_TO", "HYDRAULICS_ON", after=stop)


def assert_quiet(ending: Ending, zero: FaultEvent, motion: FaultEvent, settling_s: float) -> None:
    """|I| < 0.05 A within 250 ms of its command, standstill within `settling_s` of its command, and for good."""
    assert_no_current(ending.truth, zero.time_s)
    assert_still(ending.truth, motion.time_s + settling_s)


def assert_no_current(truth: Truth, commanded_s: float) -> None:
    """|I| < 0.05 A within 250 ms of the command, and for good."""
    current_A = np.abs(truth.current_A[truth.since(commanded_s + COIL_LAG_S)])
    assert current_A.size == 0 or current_A.max() < NO_CURRENT_A


def assert_still(truth: Truth, from_s: float) -> None:
    """The rod stands from then on."""
    speed_m_s = np.abs(truth.velocity_m_s[truth.since(from_s)])
    assert speed_m_s.size > 0
    assert speed_m_s.max() < STILL_M_S


def assert_never_moved(truth: Truth, still_m: float = 1e-6) -> None:
    """No motion program was started, the rod stayed where it was, no current flowed."""
    assert not truth.all("START")
    assert np.ptp(truth.displacement_m) <= still_m
    assert np.abs(truth.current_A).max() < NO_CURRENT_A


def assert_refused(ending: Ending, slug: str, *, still_m: float = 1e-6) -> None:
    """The end state of a row whose reaction is R: exit 3, the reason, nothing moved, a refusal record only."""
    assert ending.exit_code == 3, ending.output
    assert ending.answer["stopped_by"] == slug
    assert set(ending.verdicts().values()) <= {"not run"}
    assert not list((ending.folder / "points").iterdir())
    assert_never_moved(ending.truth, still_m)
    assert [line["slug"] for line in ending.log if line["event"] == "refused"] == [slug]


def assert_spoiled(ending: Ending, slug: str, reason: str = "", points: tuple[str, ...] = ("p001", "p002")) -> None:
    """Reaction P: the campaign goes on, its last point is invalid for this reason, the one before it stands."""
    assert ending.exit_code == 5, ending.output
    assert slug in ending.warned()
    assert ending.trips() == []
    assert ending.answer["stopped_by"] is None
    *before, spoiled = points
    assert ending.verdicts() == {**dict.fromkeys(before, "valid"), spoiled: "invalid"}
    point = ending.point(spoiled)
    assert any(words.startswith(reason or slug) for words in point.reasons), point.reasons


def assert_warned_only(ending: Ending, slug: str) -> None:
    """Reaction W: the campaign is not disturbed; the flag is in its journal."""
    assert ending.exit_code == 0, ending.output
    assert ending.answer["stopped_by"] is None
    assert slug in ending.warned()
    assert not ending.trips()
    assert set(ending.verdicts().values()) == {"valid"}
