"""What must hold in every world, whatever happens in it.

Each check looks at what really happened (`ScenarioTruth`), at what the program wrote (journal, files) and at what it
answered. Times are those of the virtual host's clock.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rig.campaign.results import RigState
from rig.campaign.sequencer.state import Phase
from rig.campaign.stop_cause import because
from rig.campaign_folder import CampaignFolder
from rig.errors import EXIT_STOPPED, FileProblem
from rig.faults.row import StopKind
from rig.recording.recorded_point import RecordedPoint
from rig.verdicts import INVALID, VALID
from simulators.scenarios.motion_invariants import MOTION_CHECKS
from simulators.scenarios.plan import DEATHS, DISK, OF_THE_STATION, SIGNALS
from simulators.scenarios.proof_invariants import PROOF_CHECKS, ZERO_A, source_is_hidden
from simulators.scenarios.scenario import EVERY_S, MOST_SESSIONS, Scenario
from simulators.scenarios.stop_invariants import STOP_CHECKS, STOPS
from simulators.scenarios.view import (
    KILLING,
    NO_CURRENT_A,
    STILL_M_S,
    STUCK_CURRENT,
    Findings,
    View,
    bench_of,
    description,
    read_once,
)

SUSPECT = "suspect"
KNOWN_CODES = frozenset({0, 3, 4, 5, 7})
WITHOUT_PRESSURE = frozenset({0, 3, 5})
"""Exit codes that promise a rig without pressure, whatever hides it; 4 promises what its stop says of the pressure."""
LINKS = frozenset({"modbus", "rtu"})
TRIES_NS = 5e9
"""For so long before everything is at rest the pressure is ordered off."""
WRITE_LOST = "modbus-write-lost"
"""Writes are acknowledged and change nothing: a link over which no command goes, whatever it answers."""
LEFT_NS = 0.3e9
SKEW_SIGMAS, SKEW_S = 4.5, 20e-6
TRUE_SHARE, TRUE_FORCE_N = 0.05, 60.0
"""So much may a recorded force's ends differ from the true ones: of its span, and noise beside."""
TRUE_TRAVEL_M = 0.5e-3
UNSTOPPED_S = 0.3
"""So long in all the rod, the force or the current may be beyond a limit before a stop is latched."""
UNSTOPPED_HOT_S = 1.0
"""Temperatures come every 0.1 s."""
FARTHER_M, FASTER_SHARE, FASTER_M_S, STRONGER_SHARE, MORE_A, HOTTER_K = 1e-3, 0.15, 0.02, 0.02, 0.25, 2.0
"""Beside the limits: the station's own allowances of 10 % of the speed and 0.15 A, and its sensors' noise."""
OTHER_CURRENT_A, OTHER_CURRENT_SHARE, OTHER_CURRENT_S = 0.06, 0.06, 0.25
"""The station's tolerance of the current and its sensor's noise, and for how long it may be otherwise in a point."""
BEGINS_WITHIN_S, BEGINS_M_S = 5.0, 3e-3
"""A motion begins so soon after its recording, and the rod is then faster than that."""
SETTLED_S, EARLY_S = 0.25, 0.05
"""A step of a current program has settled after the first; a movement is noticed later than it began by the second."""


def violations(scenario: Scenario) -> Iterator[tuple[str, str, float]]:
    """Everything that does not hold: invariant, words, when (s)."""
    if scenario.ended:
        yield "ends", scenario.ended, scenario.kernel.time_s
    for process in scenario.machine.processes.values():
        for error in process.errors:
            yield "no-crash", f"{process.name}: {error[-1500:]}", scenario.kernel.time_s
    for session in scenario.sessions:
        view = View(scenario, session)
        for name, check in CHECKS.items():
            for words, at_ns in check(view):
                yield name, f"session {session.number}: {words}", view.at_s(at_ns)
    for name, check_scenario in SCENARIO_CHECKS.items():
        for words in check_scenario(scenario):
            yield name, words, scenario.kernel.time_s


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
    for _, speed, current, _, _, pressure, _ in last:
        if abs(speed) > STILL_M_S:
            yield f"the rod is still moving at {speed:.3g} m/s", view.session.rest_ns
        if abs(current) > NO_CURRENT_A and not view.faults() & STUCK_CURRENT:
            yield f"the coil still has {current:.2f} A", view.session.rest_ns
        if pressure > 0 and (_without_pressure(view) or not _excused_pressure(view)):
            yield f"exit code {view.session.exit_code} although the pressure is on", view.session.rest_ns


def _without_pressure(view: View) -> bool:
    """The session's end promises that the pressure is off."""
    code, answer = view.session.exit_code, view.session.answer
    if code in WITHOUT_PRESSURE or answer is None or answer.stop is None:
        return code in WITHOUT_PRESSURE
    return bool(answer.stop.pressure_off)


def _excused_pressure(view: View) -> bool:
    """Something keeps the station from taking the pressure away.

    Where the rig is called safe (exit code 4) that is a link over which no command goes, and nothing else: a controller
    that was heard and keeps its pressure leaves the rig in an unknown state.
    """
    if view.session.exit_code != EXIT_STOPPED:
        return view.hidden_pressure
    by_name = view.active(view.session.rest_ns - TRIES_NS, view.session.rest_ns)
    return bool(view.hiding_places(by_name) & LINKS) or WRITE_LOST in by_name or any(
        event.what in {"station-killed", "power-cut"} for _, event in view.session.happened
    )


def unarmed_is_at_rest(view: View) -> Findings:
    """Nothing moves and no pressure comes before the station is armed."""
    arming = [int(line["host_ns"]) for line in view.lines if line.get("phase") == "arming"]
    if not arming and any(event.what == "power-cut" for _, event in view.session.happened):
        return  # the cut took the line
    until_ns = arming[0] if arming else view.session.ended_ns
    rows = view.between(view.session.began_ns, until_ns)
    excused = view.faults_by_name() & {"second-master"}
    if len(rows) and not excused:
        if np.max(np.abs(rows[:, 1])) > STILL_M_S:
            yield "the rod moved before arming", rows[np.argmax(np.abs(rows[:, 1])), 0]
        if np.max(rows[:, 5]) > 0:
            yield "the pressure was on before arming", rows[np.argmax(rows[:, 5]), 0]


def points_are_there(view: View) -> Findings:
    """Every point that was reported as finished is on the disk, opens, and states what was reported of it last."""
    if view.session is not view.scenario.sessions[-1] or view.scenario.folder is None:
        return
    reported: dict[str, dict[str, Any]] = {}
    verdicts: dict[str, set[str]] = {}
    for line in view.scenario.journal:
        if line.get("event") == "judged" and line.get("file"):
            reported[str(line["id"])] = line
            # The zeros at the campaign's end may make a point suspect; the result tells so.
            verdicts[str(line["id"])] = {line["verdict"], SUSPECT if line["verdict"] == VALID else line["verdict"]}
        if line.get("event") == "retimed":
            reported.pop(str(line.get("file")), None)
        for point in line["points"] if line.get("event") == "result" else ():
            if point["file"] is not None:
                verdicts[point["id"]] = {point["verdict"]}
                # Recovery may have found a later attempt that was not evaluated in its session.
                if point["id"] in reported:
                    reported[point["id"]] = {**reported[point["id"]], "file": point["file"]}
    for name, line in reported.items():
        path = CampaignFolder(view.scenario.folder).points / Path(line["file"]).name
        try:
            point = read_once(RecordedPoint.open, path)
        except (OSError, FileProblem) as error:
            yield f"{name}: reported as finished, but {error}", float(line["host_ns"])
            continue
        verdict = str(point.quality.verdict.verdict)
        if verdict not in verdicts[name]:
            yield (
                f"{name}: reported {' or '.join(sorted(verdicts[name]))}, but its file contains {verdict}"
            ), float(line["host_ns"])


def recorded_points_are_written(view: View) -> Findings:
    """Of every attempt that was run a file is reported and present, if disk and writing processes are healthy."""
    answer, happened = view.session.answer, {event.what for _, event in view.session.happened}
    if answer is None or happened & LOSING:
        return
    began = {str(line["point"]) for line in view.lines if line.get("event") == "point"}
    last = view.session is view.scenario.sessions[-1]  # what earlier ones reported was set aside since
    hurried = UNFINISHED if happened & SIGNALS.keys() else None  # who stops again does not wait for files
    for point in answer.points:
        missing = point.file is None or (last and not point.file.exists())
        if point.id in began and missing and hurried not in point.reasons:
            yield f"{point.id} has no file: {'; '.join(point.reasons)[:300]}", view.session.ended_ns
    for line in view.lines:
        lost = [why for why in line.get("reasons") or () if why.startswith("not-written") and why != hurried]
        if line.get("event") == "judged" and line.get("file") is None and lost:
            yield f"{line['id']}: no file exists for one attempt: {'; '.join(lost)[:300]}", float(line["host_ns"])


LOSING = frozenset({*DISK, *DEATHS, "power-cut"})
UNFINISHED = f"not-written: {because('not-written', 'file-unfinished').detail}"


def a_current_that_is_left_is_reported(view: View) -> Findings:
    """A coil with current until the rig is left leaves an unknown state, unless its source is not heard.

    Then 0 A is reported as not measured; more than the bench's limit is seen in the force at rest, but not after an S1.
    """
    answer, bench = view.session.answer, bench_of(view)
    if answer is None or bench is None or answer.rig_state is RigState.UNKNOWN or view.by_hand:
        return
    left = [float(line["host_ns"]) for line in view.lines if line.get("phase") == str(Phase.ENDED)]
    left_ns = min(left, default=view.session.ended_ns)
    rows = view.between(left_ns - LEFT_NS, left_ns)
    flows_A = float(np.min(np.abs(rows[:, 2]))) if len(rows) else 0.0
    if flows_A <= ZERO_A:
        return
    stop = answer.stop
    silent = stop is not None and not stop.current_zero and stop.current_left_A is None
    held = stop is not None and stop.kind != str(StopKind.PRESSURE_OFF)
    if (held and flows_A > bench.limits.current_A + MORE_A) or not (silent or source_is_hidden(view)):
        yield f"the coil current is {rows[-1, 2]:.2f} A at the end, but the rig is reported safe", rows[0, 0]


def answer_agrees(view: View) -> Findings:
    """What the program answers agrees with itself and with its journal."""
    answer = view.session.answer
    if answer is None:
        return
    valid = sum(point.verdict == "valid" for point in answer.points)
    if valid != answer.valid:
        yield f"{answer.valid} valid points reported, {valid} listed", view.session.ended_ns
    results = [line for line in view.lines if line.get("event") == "result"]
    if results and int(results[-1]["valid"]) != answer.valid:
        yield (
            f"{answer.valid} valid points reported, the journal contains {results[-1]['valid']}"
        ), view.session.ended_ns


def recorded_is_what_was_there(view: View) -> Findings:
    """Where no device had a fault, force and displacement of a valid point reach as far as those of the rod."""
    if view.scenario.folder is None or view.faults() or view.scenario.plan.of_a_user:
        return  # a user's own sensors may be too slow for the loop's ends
    began = {str(line["point"]): float(line["host_ns"]) for line in view.lines if line.get("event") == "point"}
    for line in view.lines:
        if line.get("event") != "judged" or line.get("verdict") != VALID or str(line["id"]) not in began:
            continue
        try:
            path = CampaignFolder(view.scenario.folder).points / str(line["file"]).rpartition("/")[2]
            point = read_once(RecordedPoint.open, path)
        except (OSError, FileProblem):
            continue  # reported by another check
        began_ns = began[str(line["id"])]
        rows = view.between(began_ns, began_ns + 1e9 * float(point.time_s[-1]))
        if not len(rows):
            continue
        force_N = TRUE_FORCE_N + TRUE_SHARE * np.ptp(rows[:, 4])
        for name, values, truth, allowed in (
            ("force", point.force_N, rows[:, 4], force_N),
            ("force at its own sample times", point.force_samples.force_N, rows[:, 4], force_N),
            ("displacement", point.displacement_m, rows[:, 3], TRUE_TRAVEL_M),
        ):
            for end in (np.nanmin, np.nanmax):
                recorded, true = float(end(values)), float(end(truth))
                if abs(recorded - true) > allowed:
                    yield f"{line['id']}: {name} {end.__name__[3:]} {recorded:.4g} recorded, {true:.4g} true", began_ns


def what_is_finished_is_not_run_again(view: View) -> Findings:
    """A point that an earlier session reported as finished is not begun by a later one."""
    finished: set[str] = set()
    for line in view.scenario.journal:
        earlier = int(line.get("host_ns", 0)) < view.session.began_ns
        if earlier and line.get("event") == "judged" and line.get("file") and line.get("verdict") != INVALID:
            finished.add(str(line["id"]))
        if line.get("event") == "retimed":
            finished.discard(str(line.get("file")))
    for line in view.lines:
        if line.get("event") == "point" and str(line["point"]) in finished:
            yield f"{line['point']} was repeated although it was finished", float(line["host_ns"])


def limits_stop_the_rig(view: View) -> Findings:
    """Rod, force, current and coil do not stay beyond the bench's limits."""
    bench = bench_of(view)
    if bench is None or not len(view.session.truth.arrays):
        return
    limits = bench.limits
    speed_m_s = (1.0 + FASTER_SHARE) * limits.speed_m_s + FASTER_M_S
    force_N = (1.0 + STRONGER_SHARE) * limits.force_N
    current_A, temperature_degC = limits.current_A + MORE_A, limits.coil_temperature_degC + HOTTER_K
    ranges = (
        ("rod", "m", 3, limits.position_min_m - FARTHER_M, limits.position_max_m + FARTHER_M, UNSTOPPED_S),
        ("speed", "m/s", 1, -speed_m_s, speed_m_s, UNSTOPPED_S), ("force", "N", 4, -force_N, force_N, UNSTOPPED_S),
        ("current", "A", 2, -current_A, current_A, UNSTOPPED_S),
        ("coil", "degC", 6, -math.inf, temperature_degC, UNSTOPPED_HOT_S),
    )
    for from_ns, to_ns in _unstopped(view):
        rows = view.between(from_ns, to_ns)
        for name, unit, column, low, high, allowed_s in ranges:
            beyond = rows[(rows[:, column] < low) | (rows[:, column] > high)]
            allowed = round(allowed_s / EVERY_S)
            if len(beyond) > allowed:
                worst = beyond[np.argmax(np.abs(beyond[:, column])), column]
                words = f"{name} {low:.4g} to {high:.4g} {unit} allowed, got {worst:.4g} {unit} without a stop"
                yield words, beyond[allowed, 0]


def _unstopped(view: View) -> Iterator[tuple[float, float]]:
    """From when to when (ns) the station watched the rig and no stop was latched."""
    session = view.session
    away = [
        at_ns for at_ns, event in session.happened
        if event.what in KILLING or (event.what in OF_THE_STATION)
    ]
    # A power cut, or a disk that takes nothing, costs the journal's last lines.
    if any(event.what == "power-cut" or event.what in DISK for _, event in session.happened):
        away += [line.host_ns for line in session.truth.log if line.code in STOPS]
    last_ns = min([*away, session.ended_ns])
    from_ns = float(session.began_ns)
    for trip in view.station("trip"):
        latched_ns = float(trip["latched_ns"])
        yield from_ns, min(latched_ns, last_ns)
        from_ns = max(from_ns, view.reset_ns(latched_ns))
    yield from_ns, last_ns


def valid_is_measured_with_the_requested_current(view: View) -> Findings:
    """The coil of a valid point truly had the current that was requested, or in turn those of its current program."""
    began = {str(line["point"]): float(line["host_ns"]) for line in view.lines if line.get("event") == "point"}
    for line in view.lines:
        if line.get("event") != "judged" or line.get("verdict") != VALID or str(line["id"]) not in began:
            continue
        point = _recorded(view, line)
        zero_ns = None if point is None else _zero_ns(point)
        if point is None or zero_ns is None:
            continue
        if point.current_programmed:
            rows, low_A, high_A = programmed_current(view, point, zero_ns)
            wanted = f"{min(point.steps_A):g} to {max(point.steps_A):g} A"
        else:
            rows, low_A, high_A = _constant(view, line, zero_ns)
            wanted = f"{line['current_A']:g} A"
        allowed_A = OTHER_CURRENT_A + OTHER_CURRENT_SHARE * np.maximum(np.abs(low_A), np.abs(high_A))
        other = rows[(rows[:, 2] < low_A - allowed_A) | (rows[:, 2] > high_A + allowed_A)]
        if len(other) > OTHER_CURRENT_S / EVERY_S:
            other_s = EVERY_S * len(other)
            words = f"valid at {wanted}, although the current was {other[0, 2]:.3g} A for {other_s:.2f} s"
            yield f"{line['id']}: {words}", other[0, 0]


def _recorded(view: View, line: dict[str, Any]) -> RecordedPoint | None:
    """The point that a line reports as finished; None where it cannot be read, which another check reports."""
    if view.scenario.folder is None:
        return None
    try:
        return read_once(description, CampaignFolder(view.scenario.folder).points / Path(str(line["file"])).name)
    except (OSError, FileProblem):
        return None


def _zero_ns(point: RecordedPoint) -> float | None:
    """When the time of a file was zero (ns of the host), by the stamps in it; None where it has none."""
    stamps = point.raw("displacement")
    if stamps is None or "time" not in stamps:
        return None
    # The stamps are of the arrival: a whole record of them tells when its own time was zero, to some milliseconds.
    return float(np.median(stamps["host_ns"] - 1e9 * stamps["time"]))


Requested = tuple[np.ndarray[Any, np.dtype[np.float64]], np.ndarray[Any, np.dtype[np.float64]],
    np.ndarray[Any, np.dtype[np.float64]]]
"""Rows of the truth (n, 7) while a point was measured, and the lowest and highest current requested at each, (n,) A."""


def _constant(view: View, line: dict[str, Any], zero_ns: float) -> Requested:
    """Of a point with one current, from its first judged instant to its last."""
    quality = line.get("quality") or {}
    names = "signal_judged" if quality.get("signal_judged_start_s") is not None else "cycles"
    start_s, end_s = (quality.get(f"{names}_{end}_s") for end in ("start", "end"))
    if start_s is None or end_s is None:
        start_s = end_s = 0.0
    rows = view.between(zero_ns + 1e9 * start_s, zero_ns + 1e9 * end_s)
    level_A = np.full(len(rows), float(line["current_A"]))
    return rows, level_A, level_A


def programmed_current(view: View, point: RecordedPoint, zero_ns: float) -> Requested:
    """Of a point with a current program, from the rod's first movement to the end of the motion."""
    rows = view.between(zero_ns, zero_ns + 1e9 * (BEGINS_WITHIN_S + point.motion_s))
    moving = np.flatnonzero(np.abs(rows[:, 1]) > BEGINS_M_S)
    rows = rows[moving[0] : moving[-1]] if len(moving) else rows[:0]
    since_s = 1e-9 * (rows[:, 0] - rows[:1, 0])
    at_s, levels_A = (np.asarray(column) for column in zip(*point.steps_in_motion, strict=True))
    rows, since_s = rows[since_s < point.motion_s], since_s[since_s < point.motion_s]
    first = np.maximum(0, np.searchsorted(at_s, since_s - SETTLED_S, side="right") - 1)
    last = np.maximum(0, np.searchsorted(at_s, since_s + EARLY_S, side="right") - 1)
    low_A, high_A = levels_A[first], levels_A[first]
    for step in range(1, int(np.max(last - first, initial=0)) + 1):
        meanwhile_A = levels_A[np.minimum(first + step, last)]
        low_A, high_A = np.minimum(low_A, meanwhile_A), np.maximum(high_A, meanwhile_A)
    return rows, low_A, high_A


CHECKS: dict[str, Callable[[View], Findings]] = {
    "exit-code": exit_code_is_known,
    "rest": rest_is_reached,
    "unarmed": unarmed_is_at_rest,
    **STOP_CHECKS,
    **PROOF_CHECKS,
    **MOTION_CHECKS,
    "limits": limits_stop_the_rig,
    "current-told": a_current_that_is_left_is_reported,
    "points": points_are_there,
    "written": recorded_points_are_written,
    "answer": answer_agrees,
    "true-record": recorded_is_what_was_there,
    "wanted-current": valid_is_measured_with_the_requested_current,
    "run-again": what_is_finished_is_not_run_again,
}


def campaign_is_complete(scenario: Scenario) -> Iterator[str]:
    """In the end every point has a file, and one that is not valid says what disturbed it."""
    folder = scenario.folder
    if scenario.ended or folder is None or scenario.most_sessions < MOST_SESSIONS:
        return
    answer = scenario.sessions[-1].answer
    if answer is None:
        return
    for point in answer.points:
        if point.verdict == "valid":
            continue
        # A user's own instruments may leave doubts without any fault.
        if point.verdict != "suspect" or not (scenario.plan.events or scenario.plan.bench):
            yield f"{point.id} is {point.verdict} at the end: {'; '.join(point.reasons)[:300]}"


def skew_covers_the_truth(scenario: Scenario) -> Iterator[str]:
    """The stated delay between the sensors covers the true one, which is none."""
    if scenario.folder is None:
        return
    for path in sorted(CampaignFolder(scenario.folder).points.glob("*.h5")):
        try:
            quality = read_once(description, path).quality
        except (OSError, FileProblem):
            continue
        skew = quality.skew
        if quality.verdict.verdict != "valid" or skew.value_s is None or not skew.std_s:
            continue
        if abs(skew.value_s) > SKEW_SIGMAS * skew.std_s + SKEW_S:
            yield f"{path.name}: skew {1e6 * skew.value_s:.0f} +- {1e6 * skew.std_s:.0f} us, true 0"


SCENARIO_CHECKS: dict[str, Callable[[Scenario], Iterator[str]]] = {
    "complete": campaign_is_complete,
    "skew": skew_covers_the_truth,
}

