"""What must hold in every world, whatever happens in it.

Each check looks at what really happened (`WorldTruth`), at what the program wrote (journal, files) and at what it
answered. Times are those of the virtual host's clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rig.errors import FileProblem
from rig.faults.matrix import MATRIX
from rig.faults.row import StopKind
from rig.recording.recorded_point import RecordedPoint
from simulators.controller_firmware import Command
from simulators.world.plan import STALLS
from simulators.world.world import Session, World

STILL_M_S = 5e-3
STILL_AFTER_S = 3.0
"""From a latched stop to standstill: the slowest motion's last cycles and a controller left to its watchdog; what the
station was kept from running comes on top."""
NO_CURRENT_A = 0.05
CURRENT_AFTER_S = 1.5
KNOWN_CODES = frozenset({0, 3, 4, 5, 7})
SKEW_SIGMAS, SKEW_S = 4.5, 20e-6
STARTING = ("centring", "proving the sensors by a slow move")


class View:
    """A session with its lines of the journal."""

    def __init__(self, world: World, session: Session) -> None:
        self.world = world
        self.session = session
        self.lines = [
            line for line in world.journal
            if session.began_ns <= int(line.get("host_ns", 0)) <= max(session.rest_ns, session.ended_ns)
        ]
        self.killed = any(happening.what in KILLING for _, happening in session.happened)

    @property
    def stalled_s(self) -> float:
        """For how long the station was kept from running (s)."""
        stalls = (happening for _, happening in self.session.happened if happening.what == "station-stalled")
        return sum(happening.lasts_s or 0.0 for happening in stalls)

    def station(self, *what: str) -> list[dict[str, Any]]:
        """Events of the station of these kinds."""
        return [line for line in self.lines if line.get("event") == "station" and line.get("what") in what]

    def between(self, from_ns: float, to_ns: float) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Rows of the truth in a time."""
        rows = self.session.truth.arrays
        return rows[(rows[:, 0] >= from_ns) & (rows[:, 0] < to_ns)]

    def at_s(self, host_ns: float) -> float:
        """Seconds since the world began."""
        return (host_ns - self.world.kernel.start_ns) * 1e-9

    def faults(self) -> set[str]:
        """Rows whose fault the devices had in this session."""
        return {line.text.partition(":")[0] for line in self.session.truth.log if line.code == "FAULT"}


KILLING = frozenset({"application-killed", "station-killed", "power-cut"})


def judged(world: World) -> Iterator[tuple[str, str, float]]:
    """Everything that does not hold: invariant, words, when (s)."""
    if world.ended:
        yield "ends", world.ended, world.kernel.time_s
    for process in world.machine.processes.values():
        for error in process.errors:
            yield "no-crash", f"{process.name}: {error[-1500:]}", world.kernel.time_s
    for session in world.sessions:
        view = View(world, session)
        for name, check in CHECKS.items():
            for words, at_ns in check(view):
                yield name, f"session {session.number}: {words}", view.at_s(at_ns)
    for name, check_world in WORLD_CHECKS.items():
        for words in check_world(world):
            yield name, words, world.kernel.time_s


Findings = Iterator[tuple[str, float]]


def exit_code_is_known(view: View) -> Findings:
    """The application ends with a code that it documents, or by the signal that killed it."""
    code = view.session.exit_code
    if code is not None and code not in KNOWN_CODES and not (code < 0 and view.killed):
        yield f"exit code {code}: {view.session.refusal[1][:300]}", view.session.ended_ns


def rest_is_reached(view: View) -> Findings:
    """When every process has ended, the rod stands, no current flows, and no good exit code stands beside pressure."""
    if view.session.exit_code is None:
        return
    last = view.session.truth.arrays[-1:]
    for _, speed, current, *_, pressure in last:
        if abs(speed) > STILL_M_S:
            yield f"the rod still moves, {speed:.3g} m/s", view.session.rest_ns
        if abs(current) > NO_CURRENT_A and not view.faults() & STUCK_CURRENT:
            yield f"the coil still has {current:.2f} A", view.session.rest_ns
        if pressure > 0 and view.session.exit_code in {0, 3, 5}:
            yield f"exit code {view.session.exit_code} with the pressure on", view.session.rest_ns


STUCK_CURRENT = frozenset({"current-stuck"})


def unarmed_stands_still(view: View) -> Findings:
    """Nothing moves and no pressure comes before the station is armed."""
    arming = [int(line["host_ns"]) for line in view.lines if line.get("phase") == "arming"]
    if not arming and any(happening.what == "power-cut" for _, happening in view.session.happened):
        return  # the cut took the line
    until_ns = arming[0] if arming else view.session.ended_ns
    rows = view.between(view.session.began_ns, until_ns)
    foreign = view.faults() & {"second-master"}
    if len(rows) and not foreign:
        if np.max(np.abs(rows[:, 1])) > STILL_M_S:
            yield "the rod moved before arming", rows[np.argmax(np.abs(rows[:, 1])), 0]
        if np.max(rows[:, 5]) > 0:
            yield "the pressure came before arming", rows[np.argmax(rows[:, 5]), 0]


def stop_stays_stopped(view: View) -> Findings:
    """After a latched stop the rod comes to rest and the current goes, and neither comes back without a restart."""
    for trip in view.station("trip"):
        t_ns = float(trip["t_ns"])
        again = [
            int(line["host_ns"]) for line in view.lines if line.get("phase") in STARTING and int(line["host_ns"]) > t_ns
        ]
        until_ns = again[0] if again else view.session.rest_ns
        moving = view.between(t_ns + (STILL_AFTER_S + view.stalled_s) * 1e9, until_ns)
        late = moving[np.abs(moving[:, 1]) > STILL_M_S]
        if len(late) and not view.faults() & {"second-master"}:
            yield f"the rod moves {1e-9 * (late[0, 0] - t_ns):.1f} s after the stop for {trip['slug']}", late[0, 0]
        powered = view.between(t_ns + CURRENT_AFTER_S * 1e9, until_ns)
        late = powered[np.abs(powered[:, 2]) > NO_CURRENT_A]
        if len(late) and not view.faults() & (STUCK_CURRENT | {"can-foreign"}):
            yield f"{late[0, 2]:.2f} A {1e-9 * (late[0, 0] - t_ns):.1f} s after the stop for {trip['slug']}", late[0, 0]


def a_stop_is_proved(view: View) -> Findings:
    """A stop that the devices obey is proved: unknown is the rig's state only where something hides it."""
    rows = [MATRIX[slug] for slug in view.faults() if slug in MATRIX]
    hidden = any(row.place in UNSEEN for row in rows) or any(
        happening.what in KILLING or happening.what in STALLS for _, happening in view.session.happened
    )
    for unknown in () if hidden else view.station("unknown"):
        yield f"the stop is not proved: {unknown.get('reason', '')}", float(unknown["t_ns"])


UNSEEN = frozenset({"modbus", "rtu", "controller", "can", "ecu"})
"""Places of the fault matrix where a fault may hide whether the rig has stopped."""


def first_cause_is_named(view: View) -> Findings:
    """What the campaign names as its stop's cause is what the station latched first since the last restart."""
    trips = view.station("trip")
    answer = view.session.answer
    if answer is None or not trips or answer.exit_code != 4:
        return
    later = [line["slug"] for line in view.station("trip", "also")]
    if answer.stopped_by != trips[-1]["slug"] and answer.stopped_by in later[1:]:
        yield f"stopped by {answer.stopped_by}, the first cause was {trips[-1]['slug']}", float(trips[-1]["t_ns"])


def no_start_after_a_foreign_stop(view: View) -> Findings:
    """Once somebody else has stopped the rig, this program starts nothing."""
    foreign = [float(trip["t_ns"]) for trip in view.station("trip", "also") if trip["slug"] == "second-master"]
    for line in view.session.truth.log:
        if foreign and line.code in {Command.START.name, Command.MOVE_TO.name} and line.host_ns > foreign[0] + 20e6:
            yield f"{line.code} after another master's stop", line.host_ns
            return


def a_stop_fault_is_noticed(view: View) -> Findings:
    """A fault whose row stops the rig, and that stays, does not end in a campaign that says that all is well."""
    answer = view.session.answer
    if answer is None or answer.exit_code != 0:
        return
    told = {str(line.get("slug")) for line in view.station("trip", "also", "warning")}
    said = " ".join(" ".join(line.get("reasons") or ()) for line in view.lines if line.get("event") == "judged")
    for line in view.session.truth.log:
        slug = line.text.partition(":")[0]
        row = MATRIX.get(slug)
        if line.code != "FAULT" or row is None or not isinstance(row.end, StopKind):
            continue
        happening = next((given for given in view.world.plan.happenings if given.what == line.text), None)
        running = view.between(line.host_ns + 1e9, view.session.ended_ns)
        moved = len(running) and np.max(np.abs(running[:, 1])) > 0.02
        if happening is not None and happening.lasts_s is None and moved and not told and slug not in said:
            yield f"{line.text} was not noticed", line.host_ns


def points_are_there(view: View) -> Findings:
    """Every point that was told to be finished is on the disk, opens, and says what was told."""
    told: dict[str, dict[str, Any]] = {}
    for line in view.world.journal:
        if line.get("event") == "judged" and line.get("file"):
            told[str(line["id"])] = line
        if line.get("event") == "retimed":
            told.pop(str(line.get("file")), None)
    if view.session is not view.world.sessions[-1] or view.world.folder is None:
        return
    for name, line in told.items():
        path = view.world.folder / "points" / Path(line["file"]).name
        try:
            point = RecordedPoint.open(path)
        except (OSError, FileProblem) as error:
            yield f"{name}: told to be finished, and {error}", float(line["host_ns"])
            continue
        verdict = str(point.quality.verdict.verdict)
        if verdict != line["verdict"] and not {verdict, line["verdict"]} <= {"valid", "suspect"}:
            yield f"{name}: told {line['verdict']}, its file says {verdict}", float(line["host_ns"])


def answer_agrees(view: View) -> Findings:
    """What the program answers agrees with itself and with its journal."""
    answer = view.session.answer
    if answer is None:
        return
    valid = sum(point.verdict == "valid" for point in answer.points)
    if valid != answer.valid:
        yield f"{answer.valid} valid points answered, {valid} listed", view.session.ended_ns
    results = [line for line in view.lines if line.get("event") == "result"]
    if results and int(results[-1]["valid"]) != answer.valid:
        yield f"{answer.valid} valid points answered, the journal says {results[-1]['valid']}", view.session.ended_ns


CHECKS: dict[str, Callable[[View], Findings]] = {
    "exit-code": exit_code_is_known,
    "rest": rest_is_reached,
    "unarmed": unarmed_stands_still,
    "stays-stopped": stop_stays_stopped,
    "proved": a_stop_is_proved,
    "first-cause": first_cause_is_named,
    "foreign-stop": no_start_after_a_foreign_stop,
    "noticed": a_stop_fault_is_noticed,
    "points": points_are_there,
    "answer": answer_agrees,
}


def campaign_is_complete(world: World) -> Iterator[str]:
    """In the end every point has a file, and one that is not valid says what disturbed it."""
    folder = world.folder
    if world.ended or folder is None:
        return
    answer = world.sessions[-1].answer
    if answer is None:
        return
    for point in answer.points:
        if point.verdict == "valid":
            continue
        # A user's own instruments may leave doubts without any fault.
        if point.verdict != "suspect" or not (world.plan.happenings or world.plan.bench):
            yield f"{point.id} is {point.verdict} in the end: {'; '.join(point.reasons)[:300]}"


def skew_covers_the_truth(world: World) -> Iterator[str]:
    """The stated delay between the sensors covers the true one, which is none."""
    if world.folder is None:
        return
    for path in sorted((world.folder / "points").glob("*.h5")):
        try:
            quality = RecordedPoint.open(path, whole=False).quality
        except (OSError, FileProblem):
            continue
        skew = quality.skew
        if quality.verdict.verdict != "valid" or skew.value_s is None or not skew.std_s:
            continue
        if abs(skew.value_s) > SKEW_SIGMAS * skew.std_s + SKEW_S:
            yield f"{path.name}: skew {1e6 * skew.value_s:.0f} +- {1e6 * skew.std_s:.0f} us, true 0"


WORLD_CHECKS: dict[str, Callable[[World], Iterator[str]]] = {
    "complete": campaign_is_complete,
    "skew": skew_covers_the_truth,
}

