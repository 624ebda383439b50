"""What must hold in every world, whatever happens in it.

Each check looks at what really happened (`WorldTruth`), at what the program wrote (journal, files) and at what it
answered. Times are those of the virtual host's clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rig.campaign.results import INVALID, VALID
from rig.errors import FileProblem
from rig.recording.recorded_point import RecordedPoint
from simulators.world.plan import DEATHS, DISK
from simulators.world.stop_invariants import STOP_CHECKS
from simulators.world.view import NO_CURRENT_A, STILL_M_S, STUCK_CURRENT, Findings, View
from simulators.world.world import MOST_SESSIONS, World

KNOWN_CODES = frozenset({0, 3, 4, 5, 7})
SKEW_SIGMAS, SKEW_S = 4.5, 20e-6
TRUE_SHARE, TRUE_FORCE_N = 0.05, 60.0
"""So much may a recorded force's ends differ from the true ones: of its span, and noise beside."""
TRUE_TRAVEL_M = 0.5e-3


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
        if pressure > 0 and (view.session.exit_code in {0, 3, 5} or not view.hidden_pressure):
            yield f"exit code {view.session.exit_code} with the pressure on", view.session.rest_ns


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


def points_are_there(view: View) -> Findings:
    """Every point that was told to be finished is on the disk, opens, and says what was told."""
    if view.session is not view.world.sessions[-1] or view.world.folder is None:
        return
    told: dict[str, dict[str, Any]] = {}
    for line in view.world.journal:
        if line.get("event") == "judged" and line.get("file"):
            told[str(line["id"])] = line
        if line.get("event") == "retimed":
            told.pop(str(line.get("file")), None)
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


def recorded_points_are_written(view: View) -> Findings:
    """A point that was run has a file where nothing is wrong with the disk and with those who write files."""
    answer = view.session.answer
    if answer is None or any(happening.what in LOSING for _, happening in view.session.happened):
        return
    began = {str(line["point"]) for line in view.lines if line.get("event") == "point"}
    for point in answer.points:
        if point.file is None and point.id in began and not view.station("trip"):
            yield f"{point.id} has no file: {'; '.join(point.reasons)[:300]}", view.session.ended_ns


LOSING = frozenset({*DISK, *DEATHS, "power-cut"})


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


def recorded_is_what_was_there(view: View) -> Findings:
    """Where no device had a fault, force and displacement of a valid point reach as far as those of the rod."""
    if view.world.folder is None or view.faults() or view.world.plan.bench:
        return  # a user's own sensors may be too slow for the loop's ends
    began = {str(line["point"]): float(line["host_ns"]) for line in view.lines if line.get("event") == "point"}
    for line in view.lines:
        if line.get("event") != "judged" or line.get("verdict") != VALID or str(line["id"]) not in began:
            continue
        try:
            point = RecordedPoint.open(view.world.folder / "points" / str(line["file"]).rpartition("/")[2])
        except (OSError, FileProblem):
            continue  # told by another check
        began_ns = began[str(line["id"])]
        rows = view.between(began_ns, began_ns + 1e9 * float(point.time_s[-1] - point.time_s[0]))
        if not len(rows):
            continue
        force_N = TRUE_FORCE_N + TRUE_SHARE * np.ptp(rows[:, 4])
        for name, values, truth, allowed in (
            ("force", point.force_N, rows[:, 4], force_N),
            ("force at its own times", point.force_samples.force_N, rows[:, 4], force_N),
            ("displacement", point.displacement_m, rows[:, 3], TRUE_TRAVEL_M),
        ):
            for end in (np.nanmin, np.nanmax):
                recorded, true = float(end(values)), float(end(truth))
                if abs(recorded - true) > allowed:
                    yield f"{line['id']}: {name} {end.__name__[3:]} {recorded:.4g} recorded, {true:.4g} true", began_ns


def what_is_finished_is_not_run_again(view: View) -> Findings:
    """A point that an earlier session told to be finished is not begun by a later one."""
    finished: set[str] = set()
    for line in view.world.journal:
        earlier = int(line.get("host_ns", 0)) < view.session.began_ns
        if earlier and line.get("event") == "judged" and line.get("file") and line.get("verdict") != INVALID:
            finished.add(str(line["id"]))
        if line.get("event") == "retimed":
            finished.discard(str(line.get("file")))
    for line in view.lines:
        if line.get("event") == "point" and str(line["point"]) in finished:
            yield f"{line['point']} is run again, though it was finished", float(line["host_ns"])


CHECKS: dict[str, Callable[[View], Findings]] = {
    "exit-code": exit_code_is_known,
    "rest": rest_is_reached,
    "unarmed": unarmed_stands_still,
    **STOP_CHECKS,
    "points": points_are_there,
    "written": recorded_points_are_written,
    "answer": answer_agrees,
    "true-record": recorded_is_what_was_there,
    "run-again": what_is_finished_is_not_run_again,
}


def campaign_is_complete(world: World) -> Iterator[str]:
    """In the end every point has a file, and one that is not valid says what disturbed it."""
    folder = world.folder
    if world.ended or folder is None or world.most_sessions < MOST_SESSIONS:
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

