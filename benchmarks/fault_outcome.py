"""What became of one fault: its times, and everything that is not as its row of the fault matrix says.

Read from outside: the exit code and answer of `rig run`, the campaign's journal and files, and the truth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from fault_case import Case
from true_states import FaultEvent, Truth
from watched_campaign import Ending

from drivers.roles import State
from rig.errors import FileProblem
from rig.recording.conversion.recovery import recover

COIL_LAG_S = 0.250
NO_CURRENT_A = 0.05
STILL_M_S = 2e-3
HARD_STOP_S = 0.3
MARGIN_S = 0.2
SAME_MOMENT_NS = 5_000_000
"""The simulated rig serves its wires in turns of 2 ms; what comes within two of them comes together."""
LOST_AT_MOST_S = 0.1
PROOF_MOVE_M = 5e-3
EXIT_CODES = {"S2": 4, "S1": 4, "SO": 4, "R": 3, "P": 5, "W": 0}
KILLED = -9
STOP_CODES = ("FADE_STOP", "HALT", "HYDRAULICS_OFF")
ABANDONED = frozenset({"disk-full", "fsync-error"})
"""The point's file is made by recovery only."""
KNOWN_LATE = frozenset({"slow-consumer"})
"""The moment of the fault is not seen from outside."""


@dataclass
class Outcome:
    """Times of one fault (s; NaN where there is none) and what was wrong.

    Attributes:
        detected_s: from the fault to the station's finding, or the flag.
        stop_s: to the host's first stop command on the wire; to the controller's own trip where no command reaches it.
        standstill_s, current_s: from its command until the rod stands, until the coil is empty, for good.
        wrong: what is not as the row says.
    """

    detected_s: float = math.nan
    stop_s: float = math.nan
    standstill_s: float = math.nan
    current_s: float = math.nan
    wrong: list[str] = field(default_factory=list)

    def expect(self, true: bool, otherwise: str) -> None:
        """Note what is wrong."""
        if not true:
            self.wrong.append(otherwise)


class Disturbed(Exception):
    """Something else stopped the campaign before the fault was there: on a busy machine a device was not heard."""


def outcome_of(case: Case, ending: Ending) -> Outcome:
    """Judge one ending.

    Args:
        case: the row and how it was brought about.
        ending: what came of it.

    Raises:
        Disturbed: the run says nothing about the row.
    """
    row, outcome = case.row, Outcome()
    _undisturbed(case, ending)
    code = KILLED if row.slug == "sigkill" else EXIT_CODES[row.end]
    outcome.expect(
        ending.exit_code == code, f"exit {ending.exit_code}, expected {code}: {ending.output.strip()[-300:]}"
    )
    fault_ns = _fault_ns(case, ending)
    if row.end == "R":
        _refused(case, ending, outcome)
        return outcome
    if row.slug == "sigkill":
        recover(ending.folder)
    if row.end in {"W", "P"}:
        _flagged(case, ending, fault_ns, outcome)
    else:
        _stopped(case, ending, fault_ns, outcome)
    _points(case, ending, fault_ns, outcome)
    return outcome


def _undisturbed(case: Case, ending: Ending) -> None:
    trips = [line for line in ending.log if line.get("what") == "trip" and line["slug"] != case.cause]
    faults = ending.truth.all("FAULT", text=case.row.slug)
    begun_ns = ending.stopped_from_ns or (faults[0].host_ns if faults else 0)
    if trips and (begun_ns == 0 or trips[0]["latched_ns"] < begun_ns):
        raise Disturbed(f"{trips[0]['slug']}: {trips[0]['detail']}")


def _fault_ns(case: Case, ending: Ending) -> int:
    """Host time from which the row's maximum runs (ns)."""
    if ending.stopped_from_ns is not None:
        return ending.stopped_from_ns
    truth = ending.truth
    if case.row.slug in KNOWN_LATE:
        return truth.all("START")[-1].host_ns
    fault = truth.first("FAULT", text=case.row.slug)
    if case.timed_from == "zero":
        return truth.first("SET_CURRENT", text="0.000", after=fault).host_ns
    if case.timed_from == "end":
        return truth.all("START")[-1].host_ns + int(case.matrix.motion_s * 1e9)
    return fault.host_ns


def _refused(case: Case, ending: Ending, outcome: Outcome) -> None:
    """Exit 3, the reason in answer and journal, nothing moved but the proof, no current, no file of a point."""
    slug, truth = case.row.slug, ending.truth
    outcome.expect(ending.answer.get("stopped_by") == slug, f"refused for {ending.answer.get('stopped_by')}")
    outcome.expect(not truth.all("START"), "a program was started")
    outcome.expect(float(np.ptp(truth.displacement_m)) < PROOF_MOVE_M, "the rod moved")
    outcome.expect(float(np.abs(truth.current_A).max()) < NO_CURRENT_A, "current flowed")
    outcome.expect(not list((ending.folder / "points").iterdir()), "a point was recorded")
    refused = [line["slug"] for line in ending.log if line["event"] == "refused"]
    outcome.expect(refused == [slug], f"the journal says {refused}")


def is_flag(line: dict[str, Any], slug: str) -> bool:
    """Whether a line of the journal flags this row."""
    return line.get("slug") == slug and "warning" in {line["event"], line.get("what")}


def _flagged(case: Case, ending: Ending, fault_ns: int, outcome: Outcome) -> None:
    """The flag is in the journal under its name, and nothing stopped."""
    slug = case.row.slug
    flags = [line for line in ending.log if is_flag(line, slug)]
    outcome.expect(bool(flags), "the journal does not flag it")
    outcome.expect(ending.answer.get("stopped_by") is None, f"stopped by {ending.answer.get('stopped_by')}")
    if flags and slug not in KNOWN_LATE:
        outcome.detected_s = outcome.stop_s = (flags[0].get("t_ns", flags[0]["host_ns"]) - fault_ns) / 1e9


def _stopped(case: Case, ending: Ending, fault_ns: int, outcome: Outcome) -> None:
    """First cause, kind of stop, order of the commands, standstill and 0 A for good, nothing that moves afterwards."""
    row, truth = case.row, ending.truth
    trips = [line for line in ending.log if line.get("what") == "trip"]
    if row.slug != "sigkill":
        outcome.expect([trip["slug"] for trip in trips] == [case.cause], f"trips {[trip['slug'] for trip in trips]}")
        outcome.expect(ending.answer.get("stopped_by") == case.cause, f"stopped by {ending.answer.get('stopped_by')}")
        outcome.expect(ending.answer.get("rig_state") == "safe", f"rig state {ending.answer.get('rig_state')}")
        outcome.expect([trip["stop"] for trip in trips] == [row.end], f"stops {[trip['stop'] for trip in trips]}")
    latched_ns = trips[0]["latched_ns"] if trips else fault_ns
    if trips:
        flags_ns = [latched_ns] + [line["t_ns"] for line in ending.log if is_flag(line, row.slug)]
        outcome.detected_s = (min(moment_ns for moment_ns in flags_ns if moment_ns >= fault_ns) - fault_ns) / 1e9
    commands = [each for each in truth.all(*STOP_CODES, "TRIP") if each.host_ns >= fault_ns]
    zeros = [each for each in _zeros(truth) if each.host_ns >= fault_ns]
    if not commands:
        outcome.wrong.append("no stop on the wire")
        return
    motion = commands[0]
    # Before the station has latched, what stops is the device itself.
    by_host = [each for each in (*commands, *zeros) if each.host_ns >= latched_ns and each.code != "ECU_FAULT"]
    own_trips = [each for each in commands if each.code == "TRIP"]
    outcome.stop_s = (min(each.host_ns for each in (*by_host, *own_trips)) - fault_ns) / 1e9
    if motion.code in STOP_CODES and zeros and zeros[0].code == "SET_CURRENT":
        outcome.expect(zeros[0].host_ns <= motion.host_ns + SAME_MOMENT_NS, "the motion was stopped before the current")
    outcome.expect(not truth.all("START", "MOVE_TO", "HYDRAULICS_ON", after=motion), "moved on after the stop")
    _came_to_rest(case, truth, motion, zeros, outcome)
    if row.end == "S1":
        outcome.expect(truth.state[-1] in {State.OFF, State.TRIPPED}, f"ended in {State(int(truth.state[-1])).name}")
        outcome.expect(bool(truth.all("HYDRAULICS_OFF", text="DONE", after=motion)), "the pressure was not taken away")


def _zeros(truth: Truth) -> list[FaultEvent]:
    """Lines by which the coil goes to 0 A: commanded, or by the ECU itself."""
    commanded = [each for each in truth.all("SET_CURRENT") if each.text.startswith(("0.000", "-0.000"))]
    return sorted([*commanded, *truth.all("ECU_FAULT")], key=lambda each: each.host_ns)


def _came_to_rest(case: Case, truth: Truth, motion: FaultEvent, zeros: list[FaultEvent], outcome: Outcome) -> None:
    hard = case.row.end == "SO" or case.row.slug in {"estop", "stop-ignored"}
    if case.row.slug == "stop-ignored":
        motion = truth.first("HYDRAULICS_OFF", after=motion)
    outcome.standstill_s = max(0.0, _last(truth, np.abs(truth.velocity_m_s) >= STILL_M_S) - motion.time_s)
    allowed_s = HARD_STOP_S if hard else case.matrix.period_s + MARGIN_S
    outcome.expect(outcome.standstill_s <= allowed_s, f"standstill after {outcome.standstill_s:.3f} s")
    if case.row.slug == "current-stuck":
        return
    begun_s = zeros[0].time_s if zeros else motion.time_s
    outcome.current_s = max(0.0, _last(truth, np.abs(truth.current_A) >= NO_CURRENT_A) - begun_s)
    outcome.expect(outcome.current_s <= COIL_LAG_S, f"0 A after {outcome.current_s:.3f} s")


def _last(truth: Truth, present: np.ndarray) -> float:
    """The last moment at which it is so (s, the rig's clock); the beginning when it never is."""
    return float(truth.time_s[np.nonzero(present)[0][-1]]) if present.any() else float(truth.time_s[0])


def _points(case: Case, ending: Ending, fault_ns: int, outcome: Outcome) -> None:
    """Points that ended before the fault are valid and open; the one it hit says so, and holds what came before it."""
    row = case.row
    verdicts = {each["id"]: each for each in ending.answer.get("points", [])}
    names = ["p001", *(["p002"] if row.end == "W" and case.matrix.points > 1 else [])]
    for name in names:
        try:
            verdict = ending.point(name).verdict
        except FileProblem as error:
            verdict = str(error)
        outcome.expect(verdict == "valid", f"{name}: {verdict}")
    if row.end == "W" or case.timed_from == "zero":
        return
    if row.slug in ABANDONED:
        outcome.expect(verdicts["p002"]["reasons"][:1] != [] and verdicts["p002"]["file"] is None, "p002 has a file")
        recover(ending.folder)
    try:
        hit = ending.point("p002")
    except FileProblem as error:
        outcome.wrong.append(f"p002: {error}")
        return
    named = "INTERRUPTED" if row.slug == "sigkill" else case.cause
    reasons = hit.reasons if row.slug not in ABANDONED else tuple(verdicts["p002"]["reasons"])
    outcome.expect(hit.verdict == "invalid", f"p002: {hit.verdict}")
    outcome.expect(any(reason.startswith(named) for reason in reasons), f"p002 does not name it: {reasons}")
    force = hit.raw("displacement") or hit.raw("force")
    if force is not None and row.end != "P" and case.timed_from == "fault":
        missing_s = (fault_ns - int(force["host_ns"].max())) / 1e9
        outcome.expect(missing_s <= LOST_AT_MOST_S, f"p002 ends {missing_s:.3f} s before the fault")
