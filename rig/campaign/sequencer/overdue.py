"""Sequencer: the reaction to a phase that exceeds its deadline; every phase has one."""

from __future__ import annotations

from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer import manual_current, point_preparation, stopping
from rig.campaign.sequencer.state import Phase, State
from rig.campaign.sequencer.stopping import Handler, Step
from rig.campaign.stop_cause import because
from rig.faults.row import StopKind

PAUSE_LIMIT_S = 7200.0
"""Wall time: a rig is not left under pressure for longer."""


def _stops(stop: StopKind, slug: str, message: str, **values: object) -> Handler:
    """The answer of a phase that lasts longer than it may: stop the rig for this cause."""
    return lambda state, _: stopping.fault(state, ev.Fault(stop, because(slug, message, **values)))


_program_overdue = _stops(StopKind.FADE_OUT, "modbus-write-lost", "program-overdue")


def _current_never_settled(state: State, event: ev.TimedOut) -> Step:
    target_A = point_preparation.program(state).first_current_A
    limit_s = point_preparation.CURRENT_LIMIT_S
    cause = because("current-tracking", "current-not-settled", wanted_A=target_A, limit_s=limit_s)
    return point_preparation.give_up(state, cause)


def _unanswered(state: State, event: ev.TimedOut) -> Step:
    """A station that proves nothing is asked for a stop; before arming there is nothing to stop."""
    cause = because("task-dies", "unanswered", phase=state.phase)
    if not state.armed:
        return stopping.leave_to_station(state, cause)
    return stopping.fault(state, ev.Fault(StopKind.PRESSURE_OFF, cause))


def _never_judged(state: State, event: ev.TimedOut) -> Step:
    """Verdicts at the end are not waited for any longer; without the count of a block its test cannot go on."""
    if not state.queue:
        return stopping.finish(state)
    return stopping.fault(state, ev.Fault(StopKind.FADE_OUT, because("not-written", "file-unfinished")))


OVERDUE: dict[Phase, Handler] = {
    Phase.CONNECTING: _unanswered,
    Phase.ARMING: _unanswered,
    Phase.PROVING_WATCHDOG: _unanswered,
    Phase.PRESSURE_LOW: _unanswered,
    Phase.PRESSURE_ON: _unanswered,
    Phase.YIELDING: _unanswered,
    Phase.ASKING: manual_current.unanswered,
    Phase.CURRENT_SET: _stops(StopKind.PRESSURE_OFF, "task-dies", "unanswered", phase=Phase.CURRENT_SET),
    Phase.TAKING_AWAY: manual_current.left,
    Phase.TAKEN_AWAY: lambda state, _: stopping.end(state),
    Phase.RESETTING: stopping.overdue,
    Phase.FINISHING: stopping.overdue,
    Phase.CHECKING_RETURN: lambda state, _: stopping.disarm(state),
    Phase.RESTING: _stops(StopKind.FADE_OUT, "data-stale", "rest-overdue"),
    Phase.PAUSED: _stops(StopKind.PRESSURE_OFF, "pause-ended", "pause-overdue", hours=PAUSE_LIMIT_S / 3600.0),
    Phase.GATING: _stops(StopKind.FADE_OUT, "temperature-window", "no-temperature"),
    Phase.COOLING: point_preparation.cooling_overdue,
    Phase.DEMAGNETISING: point_preparation.demagnetising_overdue,
    Phase.WARMING: _program_overdue,
    Phase.ADAPTING: _program_overdue,
    Phase.ITERATING: _program_overdue,
    Phase.CORRECTING: lambda state, _: point_preparation.give_up(state, because("iteration", "command-overdue")),
    Phase.STEPPING: _program_overdue,
    Phase.CHECKING_ZEROS: lambda state, _: stopping.refuse(state, because("not-tared", "few-rest-samples")),
    Phase.PROVING_SENSORS: _stops(StopKind.FADE_OUT, "modbus-write-lost", "no-proof-move"),
    Phase.CENTRING: _stops(StopKind.FADE_OUT, "modbus-write-lost", "centre-overdue"),
    Phase.SETTLING: _current_never_settled,
    Phase.RUNNING: _program_overdue,
    Phase.CLEARING: _stops(StopKind.PRESSURE_OFF, "current-stuck", "current-not-zero"),
    Phase.EVALUATING: _never_judged,
    Phase.STANDING: _stops(StopKind.PRESSURE_OFF, "stop-ignored", "standstill-overdue"),
    Phase.STOPPING: stopping.overdue,
    Phase.COOLING_DOWN: lambda state, _: stopping.finish(state),
}
