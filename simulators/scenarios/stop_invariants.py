"""What must hold of stops: each has a cause, is told first, sent, obeyed and proved, and stays."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from drivers.connection import modbus_line
from drivers.roles import Command
from rig.campaign.results import RigState
from rig.errors import EXIT_REFUSED
from rig.faults.matrix import MATRIX, REACTIONS
from rig.faults.row import Ending, StopKind
from simulators.beyond_limits import MOST_SLIP_M, SLIP_M_S
from simulators.scenarios.motion_invariants import motion_of
from simulators.scenarios.plan import DISK, OF_THE_STATION, OTHER_STOPS, SIGNALS
from simulators.scenarios.proof_invariants import moving_by_itself
from simulators.scenarios.scenario import Noted
from simulators.scenarios.view import (
    KILLING,
    NO_CURRENT_A,
    PLAIN,
    STUCK_CURRENT,
    WAY,
    Findings,
    View,
    bench_of,
    capabilities_of,
    points_of,
)

STILL_AFTER_S = 3.0
"""From a latched stop to standstill, at least: a fast motion's last cycles and a controller left to its watchdog; what
the station was kept from running comes on top."""
STOPPED_BY_S = 1.0
"""What is to spare where a controller left to its watchdog fades a slow motion out."""
CURRENT_AFTER_S = 1.5
CURRENT_AT_ONCE_S = 0.3
"""Where nothing is wrong with the way to the ECU, nor with the station."""
NOTICE_NS = 300e6
"""By then the station has looked at the controller again, whatever was sent meanwhile."""
SENT_S = 0.25
SHORTLY_NS = 10e6
HALTED_NS = 0.5e9
"""By then a halt by streamed set-points has brought the rod to rest; a fade takes its cycles besides."""
LATE_JOURNAL_S = 0.5
UNNOTICED_S, UNNOTICED_TIMES = 1.0, 10.0
"""So long the rod may move with a fault that is visible to all: that, or so many times what its row allows."""
STOPS = frozenset({Command.FADE_STOP.name, Command.HALT.name, Command.HYDRAULICS_OFF.name})
MOVING_M_S = 0.02
OVERRUN_S, STARTED_NS = 0.3, 1e9
SEEN_LATER = frozenset({
    "load-train", "stop-ignored", "current-stuck", "coil-open-short", "current-tracking", "second-master:jumps",
})  # fmt: skip
"""Rows that show only when a loop has changed, a motion is to end, or a current is to flow; jumps spoil the point."""
GROWS_S = {"actuator-frozen:slips": MOST_SLIP_M / SLIP_M_S}
"""For so long a slip may be smaller than what delays explain at the speed of the motion."""
OTHER_NAMES = {
    "can-busoff:lost": {"can-lost"},
    "current-tracking": {"load-train"},
    "current-tracking:over": {"overcurrent", "load-train"},
    "second-master:span": {"speed-limit", "stroke-limit", "load-train"},
    "second-master:offset": {"stroke-limit", "speed-limit", "load-train"},
    "second-master:jumps": {"load-train", "speed-limit"},
    "actuator-frozen:slips": {"position-disagreement", "speed-limit", "load-train"},
    "load-train:jammed": {"force-limit"},
    "ecu-overtemp:coil": {"coil-temperature"},
    "ecu-crc": {"current-unmeasured"},  # garbled answers of a supply hold no number
    "current-stuck:full": {"overcurrent", "load-train"},
    "sensor-stuck": {"sensor-saturated"},
    "sensor-stuck:lvdt": {"sensor-saturated"},
    "modbus-mismatch": {"rtu-crc"},
    "stop-ignored:pressure": {"hydraulics"},
    "setpoints-late": {"modbus-halfopen"},  # several slow answers in a row: no fresh value for as long
    "setpoints-lost": {"speed-limit"},  # a device that takes them again jumps to the newest one
    "sample-gap": {"loadcell-pulled"},
    "sample-gap:lvdt": {"lvdt-pulled"},
}
"""Faults that the station may name otherwise than their row; a gap of 16 ms is silence where a device hands over every
10 ms besides."""
PULLED = frozenset({"loadcell-pulled", "lvdt-pulled"})
OF_ITS_CURRENT = frozenset({"coil-open-short", "current-stuck"})
"""Rows that cannot be noticed while no current is requested and none flows."""
OF_ANY_FAULT = frozenset({"hybrid-unstable"})
"""What a hybrid test's own watch names: whatever is wrong with force, motion or current brings it about."""
GAPS_IN_SETPOINTS = {"setpoints-late", "setpoints-lost"}
"""What a fault of the way to the controller is called where it interrupts streamed set-points first."""
GAP_NS = 0.5e9
"""A gap in set-points is noticed by then."""
DISK_SLUGS = {"disk-full", "dir-readonly", "fsync-error", "disk-error", "recorder-unwell", "task-dies", "slow-consumer"}
SECOND_MASTER = {"second-master"}
SIGNAL_SLUGS = {"sigint", "sigterm", "sigint-storm"}
EXPLAINS: dict[str, set[str]] = {
    **dict.fromkeys(DISK, DISK_SLUGS),
    **dict.fromkeys(SIGNALS, SIGNAL_SLUGS),
    **dict.fromkeys(OTHER_STOPS, SECOND_MASTER),
    "clock-step": set(),
    "log-full": set(),
    "pause": set(),
    "converter-stalled": set(),
    "finaliser-stalled": set(),
    "converter-killed": set(),
    "finaliser-killed": {"task-dies"},
    "application-stalled": {*REACTIONS, *DISK_SLUGS} - {"host-silent"},
}
"""What around the devices explains a stop of these names; anything else explains any."""
EXPLAINS_FOR_S = {"application-stalled": 5.0}
"""So long after its end (s); what else happens around the devices explains for good."""
WATCHERS = {"application-stalled": 0.8, **dict.fromkeys(OF_THE_STATION, 0.2)}
"""So long (s) each may stand still unnoticed while the rod moves."""
MOVING_SHARE = 0.5
REST_NS = 0.2e9
OWN_SLUGS = frozenset({"host-late", "host-silent", "setpoints-late"})
SEEN_BY_STATION = frozenset(
    {
        "estop",
        "loadcell-pulled",
        "lvdt-pulled",
        "ecu-overtemp",
        "actuator-frozen",
        "current-stuck",
        "second-master",
    }
)
"""Causes that only the station's own detectors name."""
SPOILED = frozenset({"sensor-nan", "sample-gap", "rtu-stale"})


def _still_after_s(view: View) -> float:
    """From a latched stop to standstill (s): a controller left alone notices it, and fades the slowest motion out."""
    points, bench = points_of(view), bench_of(view)
    if points is None or bench is None:
        return STILL_AFTER_S
    actuator = bench.actuator
    period_s = max((1.0 / point.frequency_Hz for point in points), default=0.0)
    fade_s = (actuator.fade_out_cycles + 1.0) * period_s
    return max(STILL_AFTER_S, actuator.watchdog_s + fade_s + STOPPED_BY_S)


def _cannot_be_stopped(view: View) -> bool:
    """The controller ignores stops and leaves the pressure on, and the campaign reports that the state is unknown."""
    answer = view.session.answer
    reported = answer is None or answer.rig_state is RigState.UNKNOWN
    return reported and view.faults_by_name() >= {"stop-ignored", "stop-ignored:pressure"}


def stop_stays_stopped(view: View) -> Findings:
    """After a latched stop the rod comes to rest and the current goes, and neither comes back without a restart.

    How far a controller may drive a rod whose standstill is proved is checked by `held`.
    """
    still_after_s = _still_after_s(view) + view.stalled_s
    for trip in view.station("trip"):
        t_ns = float(trip["t_ns"])
        until_ns = view.restarted_ns(t_ns)
        proved_ns = next((float(safe["t_ns"]) for safe in view.station("safe") if float(safe["t_ns"]) > t_ns), math.inf)
        late = moving_by_itself(view, t_ns + still_after_s * 1e9, min(until_ns, view.slips_ns(proved_ns)))
        if len(late) and not _cannot_be_stopped(view):
            after_s = 1e-9 * (late[0, 0] - t_ns)
            yield f"the rod is still moving {after_s:.1f} s after the stop for {trip['slug']}", late[0, 0]
        hidden = view.hidden or (bool(view.faults() & PULLED) and _share_a_device(view))
        gone_s = max(CURRENT_AFTER_S, _left_to_itself_s(view)) if hidden else CURRENT_AT_ONCE_S
        powered = view.between(float(trip["latched_ns"]) + gone_s * 1e9, until_ns)
        late = powered[np.abs(powered[:, 2]) > NO_CURRENT_A]
        if len(late) and not view.faults() & (STUCK_CURRENT | {"can-foreign"}) and not view.by_hand:
            after_s = 1e-9 * (late[0, 0] - t_ns)
            yield f"the current is {late[0, 2]:.2f} A {after_s:.1f} s after the stop for {trip['slug']}", late[0, 0]


def _left_to_itself_s(view: View) -> float:
    """Time from a stop to 0 A (s) if an analogue output receives no command: its watchdog switches the current off."""
    bench = bench_of(view)
    described = None if bench is None or bench.ecu.by_hand else bench.ecu.described_supply
    output = None if described is None else described.output
    return 0.0 if output is None or output.watchdog is None else output.watchdog.time_s + CURRENT_AT_ONCE_S


def _share_a_device(view: View) -> bool:
    """The output and a sensor of the motion are behind one Modbus address, where one request is under way at a time."""
    bench = bench_of(view)
    if bench is None or bench.ecu.url is None:
        return False
    return modbus_line(bench.ecu.url) in {modbus_line(sensor.port) for sensor in (bench.load_cell, bench.lvdt)}


def _of_a_shared_device(view: View, begun: set[str]) -> set[str]:
    """Fault codes that faults may have because sensors and output use the same connection."""
    if not _share_a_device(view):
        return set()
    waiting = PULLED if "ecu-silent" in begun else frozenset()  # their requests wait for the answer to the output's
    return {*waiting, *({"can-lost"} if begun & PULLED else ())}


def first_cause_is_named(view: View) -> Findings:
    """What the campaign names as its stop's cause is what the station latched first since the last restart."""
    trips = view.station("trip")
    answer = view.session.answer
    if answer is None or not trips or answer.exit_code != 4:
        return
    later = [line["slug"] for line in view.station("trip", "also")]
    signals_ns = [at_ns for at_ns, event in view.session.happened if event.what in SIGNALS]
    if answer.stopped_by in SIGNAL_SLUGS and any(at_ns < float(trips[-1]["latched_ns"]) for at_ns in signals_ns):
        return  # The operator came before the station knew of anything.
    slugs = {line["slug"] for line in view.station("trip", "also", "warning")}
    if answer.stopped_by in SEEN_BY_STATION - slugs:
        yield f"the rig was stopped by {answer.stopped_by}, which the station did not report", float(trips[-1]["t_ns"])
    if answer.stopped_by != trips[-1]["slug"] and answer.stopped_by in later[1:]:
        words = f"reported as stopped by {answer.stopped_by}, but the first cause was {trips[-1]['slug']}"
        yield words, float(trips[-1]["t_ns"])


def no_start_after_a_stop_by_another_master(view: View) -> Findings:
    """Once another client has stopped the rig, this program starts nothing."""
    stops_ns = [float(trip["t_ns"]) for trip in view.station("trip", "also") if trip["slug"] == "second-master"]
    stops_ns += [
        line.host_ns + NOTICE_NS for line in view.session.truth.log
        if line.code == "FOREIGN" and not _leaves_no_trace(view, line)
    ]
    for line in view.session.truth.log:
        if stops_ns and line.code in {Command.START.name, Command.MOVE_TO.name} and line.host_ns > min(stops_ns) + 20e6:
            yield f"{line.code} was sent after another master's stop", line.host_ns
            return
    motion = motion_of(view)
    ends_ns = HALTED_NS + (0.0 if motion is None else 1e9 * motion.fades_s)
    halted_ns = min(stops_ns, default=math.inf) + ends_ns
    for at_ns, _, velocity_m_s in view.session.truth.setpoints:
        if abs(velocity_m_s) > MOVING_M_S and halted_ns < at_ns < view.reset_ns(halted_ns - ends_ns):
            yield f"a set-point of {velocity_m_s:.3g} m/s was sent after another master's stop", at_ns
            return


def a_stop_by_another_master_is_noticed(view: View) -> Findings:
    """A stop by another client's command is that client's, and no end of the program."""
    if view.hidden_way or view.session.answer is None:
        return
    trips = [float(trip["latched_ns"]) for trip in view.station("trip")]
    for line in view.session.truth.log:
        noticed = any(at_ns < line.host_ns + 1e9 for at_ns in trips) or _leaves_no_trace(view, line)
        if line.code == "FOREIGN" and line.text == "foreign-stop" and not noticed:
            yield "another master's stop was not detected", line.host_ns


def _leaves_no_trace(view: View, stop: Noted) -> bool:
    """A halt that is over within two polls and is no command that the controller acknowledges.

    It is led on by the next set-point, as a controller is that follows set-points and was halted at its panel.
    """
    bench, can = bench_of(view), capabilities_of(view)
    rows = view.between(stop.host_ns - SHORTLY_NS, stop.host_ns + SHORTLY_NS)
    if bench is None or can is None or not len(rows):
        return False
    actuator = bench.actuator
    shows = can.acknowledge and (stop.text == "foreign-stop" or actuator.setpoints_s is None)
    halts_s = np.max(np.abs(rows[:, 1])) / actuator.halt_deceleration_m_s2
    return not shows and bool(halts_s < 2.0 * actuator.poll_s)


def a_stop_fault_is_noticed(view: View) -> Findings:
    """A fault whose row stops the rig, and that stays, does not end in a campaign that says that all is well."""
    answer = view.session.answer
    if answer is None or answer.exit_code != 0:
        return
    slugs = {str(line.get("slug")) for line in view.station("trip", "also", "warning")}
    reasons = " ".join(" ".join(line.get("reasons") or ()) for line in view.lines if line.get("event") == "judged")
    for line in view.session.truth.log:
        slug = line.text.partition(":")[0]
        row = MATRIX.get(slug)
        if line.code != "FAULT" or row is None or not isinstance(row.end, StopKind):
            continue
        if (slug in OF_ITS_CURRENT and view.without_current(line.host_ns)) or _shows_nothing(view, line.text):
            continue
        event = next((given for given in view.scenario.plan.events if given.what == line.text), None)
        running = view.between(line.host_ns + 1e9, view.session.ended_ns)
        moved = len(running) and np.max(np.abs(running[:, 1])) > MOVING_M_S
        if event is not None and event.lasts_s is None and moved and not slugs and slug not in reasons:
            yield f"{line.text} was not detected", line.host_ns


def _sees_the_chain(view: View) -> bool:
    """The controller has an input for the emergency stop chain."""
    can = capabilities_of(view)
    return can is None or can.e_stop_input


def _shows_nothing(view: View, fault: str) -> bool:
    """Another client takes the lease, and commands nothing, of a controller that shows neither lease nor command."""
    can = capabilities_of(view)
    return fault == "second-master" and can is not None and not (can.lease or can.acknowledge)


def _repeats_the_counter(view: View) -> bool:
    """The controller's status repeats the watchdog's counter."""
    can = capabilities_of(view)
    return can is None or can.echo


def _shows_a_reboot(view: View) -> bool:
    """The controller shows a counter of its starts, a clock of its own, or a lease."""
    can = capabilities_of(view)
    return can is None or can.settings_hash or can.clock or can.lease


def _gap_in_setpoints(view: View, at_ns: float) -> bool:
    """Shortly before, no set-point may have come to the controller, or it was halted by another client.

    It takes none then, and may not show why.
    """
    from_ns = at_ns - GAP_NS
    halted = any(line.code == "FOREIGN" and from_ns <= line.host_ns <= at_ns for line in view.session.truth.log)
    return halted or bool(view.hiding_places(view.active(from_ns, at_ns)) & WAY)


def stops_have_a_cause(view: View) -> Findings:
    """The rig is stopped in the name of something that has happened."""
    for trip in view.station("trip")[:1]:
        latched_ns = float(trip["latched_ns"])
        around = [
            event.what for at_ns, event in view.session.happened
            if at_ns <= latched_ns <= at_ns + 1e9 * (
                (event.lasts_s or 0.0) + EXPLAINS_FOR_S.get(event.what, math.inf)
            )
        ]
        if any(what not in EXPLAINS for what in around):
            return
        causes = set().union(*(EXPLAINS[what] for what in around))
        begun = {fault for _, fault in view.begun(latched_ns)}
        for fault in begun:
            causes |= {fault.partition(":")[0]} | OTHER_NAMES.get(fault, set())
        if _gap_in_setpoints(view, latched_ns):
            causes |= GAPS_IN_SETPOINTS
        if any(_shows_nothing(view, fault) for fault in begun):
            causes.add("hydraulics")  # a controller that obeys another client takes no pressure command
        causes |= _of_a_shared_device(view, begun)
        if "modbus-write-lost" in begun and not _repeats_the_counter(view):
            causes.add("host-silent")  # the watchdog, which is no longer fed, is the first to show it
        if "actuator-reboot" in begun and not _shows_a_reboot(view):
            causes.add("second-master")  # a pressure that is gone, which was not ordered here, is all that is seen
        if "estop" in begun and not _sees_the_chain(view):
            causes |= {"controller-trip", "ecu-overtemp"}  # its trip has no name, and the ECU loses its supply
        if "estop" in begun and view.hiding_places(begun - {"estop"}) & WAY:
            causes.add("ecu-overtemp")  # What opens the contactor too was not to be heard of: the ECU's own word is.
        if trip["slug"] not in causes and not (begun and trip["slug"] in OF_ANY_FAULT):
            yield (
                f"the rig stopped for {trip['slug']} ({trip['detail']}), but the events explain only {sorted(causes)}"
            ), latched_ns


def the_first_is_reported_first(view: View) -> Findings:
    """The station tells of nothing that came after a stop's first cause before it tells of that cause."""
    causes = view.station("trip", "also")
    for line, following in pairwise(causes):
        if float(following["latched_ns"]) < float(line["latched_ns"]):
            yield (
                f"{line['slug']} was reported before {following['slug']}, which occurred first"
            ), float(line["latched_ns"])


def a_stop_is_sent(view: View) -> Findings:
    """A latched stop reaches the controller at once, where nothing is wrong with the way to it."""
    if view.hidden_way:
        return
    sent = [float(line["t_ns"]) for line in view.station("sent") if line.get("action") in {"fade", "halt"}]
    last_ns = max((float(line["host_ns"]) for line in view.lines), default=0.0)
    for trip in view.station("trip"):
        latched_ns = float(trip["latched_ns"])
        if last_ns < latched_ns + LATE_JOURNAL_S * 1e9:
            continue
        if not any(latched_ns - 1e6 <= at_ns <= latched_ns + SENT_S * 1e9 for at_ns in sent):
            yield f"no stop was sent to the controller within {SENT_S:g} s of {trip['slug']}", latched_ns


def nothing_is_commanded_while_stopped(view: View) -> Findings:
    """Between a latched stop and the next start this host orders no motion or pressure."""
    energising = {Command.START.name, Command.MOVE_TO.name, Command.HYDRAULICS_ON.name}
    for trip in view.station("trip"):
        latched_ns = float(trip["latched_ns"])
        until_ns = view.resetting_ns(latched_ns)
        for line in view.session.truth.log:
            if line.code in energising and latched_ns + 20e6 < line.host_ns < until_ns:
                yield (
                    f"{line.code} was sent {1e-9 * (line.host_ns - latched_ns):.2f} s after the stop for "
                    f"{trip['slug']}",
                    (line.host_ns),
                )


def a_fault_ends_the_motion(view: View) -> Findings:
    """The rod is not moved for long with a fault that stops the rig, while it lasts and nothing else has stopped it.

    Of a session that was killed the journal may lack the end: it counts until then, or until a stop has arrived.
    """
    stops = [float(trip["latched_ns"]) for trip in view.station("trip")]
    if view.session.answer is None:
        if view.hidden_devices:
            return
        stops += [line.host_ns for line in view.session.truth.log if line.code in STOPS]
        stops += [at_ns for at_ns, event in view.session.happened if event.what in KILLING]
    until_ns = min(stops, default=view.session.ended_ns)
    for at_ns, fault in view.begun(until_ns):
        row = MATRIX.get(fault.partition(":")[0])
        if row is None or not isinstance(row.end, StopKind) or SEEN_LATER & {row.slug, fault}:
            continue
        if row.slug in OF_ITS_CURRENT and view.without_current(at_ns):
            continue
        if row.slug == "ecu-restart" and _supply_at_rest(view, at_ns):
            continue
        if _shows_nothing(view, fault) or fault in PLAIN:  # PLAIN: shows only beyond a limit, which `limits` checks
            continue
        rows = view.between(at_ns, min(until_ns, at_ns + 1e9 * view.lasts_s(fault)))
        moved_s = 1e-3 * np.count_nonzero(np.abs(rows[:, 1]) > MOVING_M_S)
        if moved_s > max(UNNOTICED_S, UNNOTICED_TIMES * (row.limit_s or 0.0)) + GROWS_S.get(fault, 0.0):
            yield f"{fault}: the rod continued to move for {moved_s:.1f} s", at_ns


def _supply_at_rest(view: View, at_ns: float) -> bool:
    """A power supply delivers nothing: a restart then changes nothing, and the next current switches it on again."""
    bench, rows = bench_of(view), view.between(at_ns - REST_NS, at_ns + REST_NS)
    return bench is not None and bench.ecu.url is not None and not np.any(np.abs(rows[:, 2]) > NO_CURRENT_A)


def a_program_ends(view: View) -> Findings:
    """A controller does not run on for long after the end of the program that was ordered."""
    points, log = points_of(view), view.session.truth.log
    if view.session.answer is None or points is None:
        return
    motion_s = {point.id: point.motion_s for point in points}
    latched = [float(trip["latched_ns"]) for trip in view.station("trip")]
    starts = [line.host_ns for line in log if line.code == Command.START.name]
    motions = [*starts, *(line.host_ns for line in log if line.code == Command.MOVE_TO.name)]
    for line in view.lines:
        if line.get("event") != "point":
            continue
        reported_ns = float(line["host_ns"])
        # A motion of streamed set-points has no start that the controller knows.
        begun_ns = next((at_ns for at_ns in starts if reported_ns < at_ns < reported_ns + STARTED_NS), math.inf)
        ends_ns = begun_ns + 1e9 * (motion_s.get(str(line["point"]), math.inf) + view.stalled_s)
        later = (at_ns for at_ns in (*latched, *motions) if at_ns > begun_ns)
        rows = view.between(ends_ns, min(later, default=view.session.ended_ns))
        moved_s = 1e-3 * np.count_nonzero(np.abs(rows[:, 1]) > MOVING_M_S)
        if moved_s > OVERRUN_S:
            yield f"{line['point']}: the rod continued to move for {moved_s:.1f} s after its program's end", ends_ns


def what_is_spoiled_is_not_valid(view: View) -> Findings:
    """A point that ran with a fault that spoils it is not valid."""
    began = {str(line["point"]): float(line["host_ns"]) for line in view.lines if line.get("event") == "point"}
    for line in view.lines:
        if line.get("event") != "judged" or line.get("verdict") != "valid" or str(line.get("id")) not in began:
            continue
        for at_ns, fault in view.begun(began[str(line["id"])]):
            row = MATRIX.get(fault.partition(":")[0])
            if row is not None and row.end is Ending.INVALID and row.slug in SPOILED and view.stays(fault):
                yield f"{line['id']} is valid although {fault} was present", at_ns


def refused_before_it_moves(view: View) -> Findings:
    """With a fault that is refused, there from the start, no program is started; a healthy rig is not refused."""
    refused = [
        (at_ns, fault)
        for at_ns, fault in view.begun(view.session.ended_ns)
        if (row := MATRIX.get(fault.partition(":")[0])) is not None and row.end is Ending.REFUSE
    ]
    if view.session.exit_code == EXIT_REFUSED and not view.faults() and not view.session.happened:
        yield f"a campaign on a rig without faults was rejected: {view.session.refusal[1][:200]}", view.session.ended_ns
    for line in view.session.truth.log:
        if line.code == Command.START.name and any(at_ns < line.host_ns for at_ns, _ in refused):
            yield f"a program was started despite {', '.join(fault for _, fault in refused)}", line.host_ns
            return


def a_stalled_watcher_is_noticed(view: View) -> Findings:
    """The rig is stopped when the application or the station stands still for long while the rod moves."""
    trips = [float(trip["latched_ns"]) for trip in view.station("trip")]
    if any(event.what in DISK for _, event in view.session.happened):  # the journal could not be written
        trips += [line.host_ns for line in view.session.truth.log if line.code in STOPS]
    stopping_ns = 1e9 * _still_after_s(view)
    for at_ns, event in view.session.happened:
        if (event.lasts_s or 0.0) < WATCHERS.get(event.what, math.inf):
            continue
        ends_ns = at_ns + 1e9 * (event.lasts_s or 0.0)
        rows = view.between(at_ns, ends_ns)
        moving = len(rows) and np.mean(np.abs(rows[:, 1]) > MOVING_M_S) > MOVING_SHARE
        stopped = any(at_ns - stopping_ns < trip_ns < ends_ns + NOTICE_NS for trip_ns in trips)
        if moving and not view.killed and not stopped:
            yield f"{event}: the rod continued to move without a stop", at_ns
        first = next((trip for trip in view.station("trip") if float(trip["latched_ns"]) > at_ns), None)
        own = event.what == "application-stalled" or first is None or first["slug"] in OWN_SLUGS
        if moving and not own and len(view.session.happened) == 1 and not view.begun(ends_ns + NOTICE_NS):
            yield (
                f"{event}: stopped for {first and first['slug']}, expected a stop because monitoring was paused"
            ), at_ns


STOP_CHECKS: dict[str, Callable[[View], Findings]] = {
    "refused": refused_before_it_moves,
    "watched": a_stalled_watcher_is_noticed,
    "stays-stopped": stop_stays_stopped,
    "cause": stops_have_a_cause,
    "first-cause": first_cause_is_named,
    "told-first": the_first_is_reported_first,
    "sent": a_stop_is_sent,
    "asked": nothing_is_commanded_while_stopped,
    "foreign-noticed": a_stop_by_another_master_is_noticed,
    "foreign-stop": no_start_after_a_stop_by_another_master,
    "noticed": a_stop_fault_is_noticed,
    "moves-on": a_fault_ends_the_motion,
    "overrun": a_program_ends,
    "spoiled": what_is_spoiled_is_not_valid,
}
