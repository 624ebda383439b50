"""The campaign's order of things as a pure function: `step(state, event) -> (state, actions)`.

1. No clock, no I/O: everything that happens arrives as an event, everything wanted leaves as an action.
2. Nothing moves unless the rig is armed, watchdog and zeros are proved, pressure is on and no stop is latched.

The way through: connect, arm, prove the watchdog, check zeros, pressure low, pressure on, then for each point: centre,
settle the current, record and run, back to 0 A, rest; at the end hydraulics off. Two tables hold it: `NEXT` for the
phase an event belongs to, `ALWAYS` for what can come at any time. An event found in neither is late news and changes
nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rig.campaign import action as act
from rig.campaign import event as ev
from rig.campaign.action import Action, Request
from rig.campaign.cause import Cause, StopKind, may_restart
from rig.campaign.state import Latch, Phase, RigState, State

Step = tuple[State, tuple[Action, ...]]
Handler = Callable[[State, Any], Step]

CENTRING_LIMIT_S = 60.0
CURRENT_LIMIT_S = 5.0
ZEROS_LIMIT_S = 5.0
PROGRAM_LIMIT_S = 5.0
STOP_LIMIT_S = 60.0
JUDGING_LIMIT_S = 120.0


def step(state: State, event: ev.Event) -> Step:
    """The next state and what to do, in order.

    Args:
        state: where the campaign stands.
        event: what happened.
    """
    if state.phase is Phase.ENDED:
        return state, ()
    handler = NEXT.get((state.phase, type(event))) or ALWAYS.get(type(event))
    if handler is None:
        return state, ()
    return handler(state, event)


def _enter(state: State, phase: Phase, *actions: Action, device_s: float | None = None) -> Step:
    return replace(state, phase=phase), (act.Deadline(phase, device_s), *actions)


# Preflight


def _begin(state: State, event: ev.Begin) -> Step:
    return _enter(state, Phase.CONNECTING, act.Ask(Request.CONNECT))


def _arm(state: State) -> Step:
    return _enter(replace(state, armed=True, proved=False), Phase.ARMING, act.Ask(Request.ARM))


def _prove_watchdog(state: State) -> Step:
    return _enter(state, Phase.PROVING_WATCHDOG, act.Ask(Request.STARVE_WATCHDOG))


def _check_zeros(state: State) -> Step:
    return _enter(state, Phase.CHECKING_ZEROS, act.WatchZeros(), device_s=ZEROS_LIMIT_S)


def _zeros(state: State, event: ev.ZerosJudged) -> Step:
    if event.cause is not None:
        return _refuse(state, event.cause)
    return _enter(replace(state, proved=True), Phase.PRESSURE_LOW, act.Ask(Request.HYDRAULICS_LOW))


def _pressure_on(state: State) -> Step:
    return _enter(state, Phase.PRESSURE_ON, act.Ask(Request.HYDRAULICS_ON))


def _powered(state: State) -> Step:
    return _next_point(replace(state, powered=True))


PROVED: dict[tuple[Phase, Request], Callable[[State], Step]] = {
    (Phase.CONNECTING, Request.CONNECT): _arm,
    (Phase.ARMING, Request.ARM): _prove_watchdog,
    (Phase.PROVING_WATCHDOG, Request.STARVE_WATCHDOG): _check_zeros,
    (Phase.PRESSURE_LOW, Request.HYDRAULICS_LOW): _pressure_on,
    (Phase.PRESSURE_ON, Request.HYDRAULICS_ON): _powered,
    (Phase.RESETTING, Request.RESET): lambda state: _arm(state.unlatched()),
    (Phase.FINISHING, Request.DISARM): lambda state: _end(replace(state, armed=False, powered=False)),
}


def _done(state: State, event: ev.Done) -> Step:
    proved = PROVED.get((state.phase, event.request))
    return (state, ()) if proved is None else proved(state)


# One point after the other


def _next_point(state: State) -> Step:
    if not state.queue:
        if state.unjudged:
            return _enter(state, Phase.JUDGING, device_s=JUDGING_LIMIT_S)
        return _finish(state)
    if state.pause_asked:
        return _enter(state, Phase.PAUSED, act.Note("info", f"paused before {state.point.id}"))
    point = state.point
    if state.held_at_m == point.centre_m:
        return _settle(state)
    state = replace(state, moved=True, held_at_m=None)
    return _enter(state, Phase.CENTRING, act.Move(point.centre_m), device_s=CENTRING_LIMIT_S)


def _centred(state: State, event: ev.Centred) -> Step:
    return _settle(replace(state, held_at_m=state.point.centre_m))


def _settle(state: State) -> Step:
    return _enter(state, Phase.SETTLING, act.SetCurrent(state.point.current_A), device_s=CURRENT_LIMIT_S)


def _run(state: State, event: ev.CurrentSettled) -> Step:
    point = state.point
    state = replace(
        state, attempts=(*state.attempts, point.id), recording=True, moved=True, held_at_m=None, spoiled=None
    )
    actions = (act.BeginRecording(point, state.attempt), act.Start(point))
    return _enter(state, Phase.RUNNING, *actions, device_s=1.25 * point.motion_s + PROGRAM_LIMIT_S)


def _program_ended(state: State, event: ev.ProgramEnded) -> Step:
    point, spoiled = state.point, state.spoiled
    state, actions = _end_recording(state, spoiled)
    state = replace(state, held_at_m=point.centre_m if event.at_centre else None, spoiled=None, rest_s=point.rest_s)
    if spoiled is None:
        state = _await_verdict(state)
    elif not state.may_repeat(point.id):
        state = replace(state, queue=state.queue[1:])
    state, more = _enter(state, Phase.CLEARING, act.SetCurrent(0.0), device_s=CURRENT_LIMIT_S)
    return state, actions + more


def _await_verdict(state: State) -> State:
    point = state.point
    state = replace(state, queue=state.queue[1:])
    if state.may_repeat(point.id):
        return replace(state, unjudged=(*state.unjudged, point.id), given_back=(*state.given_back, point))
    return state


def _cleared(state: State, event: ev.CurrentSettled) -> Step:
    if state.rest_s > 0.0:
        return _enter(replace(state, rest_s=0.0), Phase.RESTING, act.Rest(state.rest_s))
    return _next_point(state)


def _rested(state: State, event: ev.RestOver) -> Step:
    return _next_point(state)


def _judged(state: State, event: ev.Judged) -> Step:
    if event.point_id not in state.unjudged:
        return state, ()
    again = tuple(point for point in state.given_back if point.id == event.point_id and not event.valid)
    state = replace(
        state,
        unjudged=tuple(name for name in state.unjudged if name != event.point_id),
        given_back=tuple(point for point in state.given_back if point.id != event.point_id),
        queue=state.queue + again,
    )
    return _next_point(state) if state.phase is Phase.JUDGING else (state, ())


def _current_never_settled(state: State, event: ev.TimedOut) -> Step:
    point = state.point
    cause = Cause("current-tracking", f"measured current did not reach {point.current_A:g} A in {CURRENT_LIMIT_S:g} s")
    state = replace(state, queue=state.queue[1:])
    return _enter(state, Phase.CLEARING, act.GiveUpPoint(point, cause), act.SetCurrent(0.0), device_s=CURRENT_LIMIT_S)


def _resume(state: State, event: ev.ResumeAsked) -> Step:
    return _next_point(replace(state, pause_asked=False))


# Stops


def _end_recording(state: State, fault: Cause | None) -> Step:
    if not state.recording:
        return state, ()
    return replace(state, recording=False), (act.EndRecording(state.point, state.attempt, fault),)


def _latch(state: State, stop: StopKind, cause: Cause, *actions: Action) -> Step:
    period_s = 1.0 / state.queue[0].frequency_Hz if state.queue else 0.0
    state = replace(state, latch=Latch(stop, cause), held_at_m=None)
    note = act.Note("error", f"{stop}: {cause.slug}: {cause.detail}")
    return _enter(state, Phase.STOPPING, *actions, note, device_s=STOP_LIMIT_S + 2.0 * period_s)


def _tripped(state: State, event: ev.Tripped) -> Step:
    if state.latch is not None:
        return state, ()
    return _latch(state, event.stop, event.cause)


def _fault(state: State, event: ev.Fault | ev.Abort) -> Step:
    if state.latch is not None:
        return state, ()
    if not state.armed:
        return _finish(replace(state, latch=Latch(event.stop, event.cause)))
    return _latch(state, event.stop, event.cause, act.Stop(event.stop, event.cause))


def _note_abort_while_finishing(state: State, event: ev.Fault | ev.Abort) -> Step:
    """The rig is being shut down already: that goes on, and the cause is kept for the result."""
    return (replace(state, latch=Latch(event.stop, event.cause)) if state.latch is None else state), ()


def _stopped(state: State, event: ev.Safe) -> Step:
    latch = state.latch
    if latch is None:
        return state, ()
    if state.queue and not state.recording:
        state = replace(state, attempts=(*state.attempts, state.point.id))
    state, actions = _end_recording(state, latch.cause)
    repeat = state.refused is None and state.queue and state.may_repeat(state.point.id)
    if repeat and may_restart(latch.stop, latch.cause):
        state, more = _enter(state, Phase.RESETTING, act.Ask(Request.RESET))
    else:
        state, more = _finish(state)
    return state, actions + more


def _give_up_restart(state: State, event: ev.Fault | ev.Abort) -> Step:
    return _finish(state)


def _not_proved_safe(state: State, event: ev.Unknown) -> Step:
    if not state.armed:
        return _refuse(state, Cause("state-unknown", event.detail))
    return _lost(state, Cause("state-unknown", event.detail))


def _station_gone(state: State, event: ev.StationGone) -> Step:
    cause = Cause("task-dies", event.detail)
    if not state.armed:
        return _end(replace(state, refused=state.refused or cause))
    return _lost(state, cause)


def _stop_timed_out(state: State, event: ev.TimedOut) -> Step:
    return _lost(state, Cause("stop-ignored", "the station did not prove standstill and 0 A in time"))


def _lost(state: State, cause: Cause) -> Step:
    latch = state.latch or Latch(StopKind.SO, cause)
    state, actions = _end_recording(replace(state, latch=latch, rig_state=RigState.UNKNOWN), latch.cause)
    state, more = _end(state)
    return state, (*actions, act.Note("error", f"the rig's state is not known: {cause.detail}"), *more)


def _declined(state: State, event: ev.Declined) -> Step:
    if event.request is Request.DISARM and state.phase is Phase.FINISHING:
        return _lost(state, event.cause)
    if state.latch is not None or state.phase is Phase.FINISHING:
        return _declined_while_stopping(state, event)
    if not state.moved:
        return _refuse(state, event.cause)
    return _fault(state, ev.Fault(StopKind.S2, event.cause))


def _declined_while_stopping(state: State, event: ev.Declined) -> Step:
    if event.request is Request.STOP and state.phase is Phase.STOPPING:
        state, actions = _end_recording(state, None if state.latch is None else state.latch.cause)
        state, more = _finish(state)
        return state, actions + more
    if event.request is Request.RESET and state.phase is Phase.RESETTING:
        return _finish(state)
    return state, ()


def _refuse(state: State, cause: Cause) -> Step:
    if state.moved:
        return _fault(state, ev.Fault(StopKind.S2, cause))
    state, actions = _finish(replace(state, refused=cause))
    return state, (act.Note("error", f"refused: {cause.slug}: {cause.detail}"), *actions)


def _spoiled(state: State, event: ev.Spoiled) -> Step:
    if not state.recording or state.spoiled is not None:
        return state, ()
    return replace(state, spoiled=event.cause), (act.Note("warning", f"{event.cause.slug}: {event.cause.detail}"),)


# The end


def _finish(state: State) -> Step:
    if not state.armed:
        return _end(state)
    return _enter(state, Phase.FINISHING, act.Ask(Request.DISARM))


def _end(state: State) -> Step:
    return _enter(state, Phase.ENDED, act.Finish())


# Deadlines

OVERDUE: dict[Phase, Handler] = {
    Phase.CHECKING_ZEROS: lambda state, _: _refuse(state, Cause("not-tared", "too few samples from the resting rig")),
    Phase.CENTRING: lambda state, _: _fault(
        state, ev.Fault(StopKind.S2, Cause("modbus-write-lost", "the actuator did not reach the centre"))
    ),
    Phase.SETTLING: _current_never_settled,
    Phase.RUNNING: lambda state, _: _fault(
        state, ev.Fault(StopKind.S2, Cause("modbus-write-lost", "the motion program did not run to its end in time"))
    ),
    Phase.CLEARING: lambda state, _: _fault(
        state, ev.Fault(StopKind.S1, Cause("current-stuck", "the measured current did not return to 0 A"))
    ),
    Phase.JUDGING: lambda state, _: _finish(state),
    Phase.STOPPING: _stop_timed_out,
}


def _timed_out(state: State, event: ev.TimedOut) -> Step:
    overdue = OVERDUE.get(state.phase) if event.phase == state.phase else None
    return (state, ()) if overdue is None else overdue(state, event)


NEXT: dict[tuple[Phase, type[ev.Event]], Handler] = {
    (Phase.NEW, ev.Begin): _begin,
    (Phase.CHECKING_ZEROS, ev.ZerosJudged): _zeros,
    (Phase.CENTRING, ev.Centred): _centred,
    (Phase.SETTLING, ev.CurrentSettled): _run,
    (Phase.RUNNING, ev.ProgramEnded): _program_ended,
    (Phase.CLEARING, ev.CurrentSettled): _cleared,
    (Phase.RESTING, ev.RestOver): _rested,
    (Phase.PAUSED, ev.ResumeAsked): _resume,
    (Phase.STOPPING, ev.Safe): _stopped,
    (Phase.RESETTING, ev.Fault): _give_up_restart,
    (Phase.RESETTING, ev.Abort): _give_up_restart,
    (Phase.FINISHING, ev.Fault): _note_abort_while_finishing,
    (Phase.FINISHING, ev.Abort): _note_abort_while_finishing,
}

ALWAYS: dict[type[ev.Event], Handler] = {
    ev.Done: _done,
    ev.Declined: _declined,
    ev.Judged: _judged,
    ev.TimedOut: _timed_out,
    ev.Spoiled: _spoiled,
    ev.Fault: _fault,
    ev.Abort: _fault,
    ev.Tripped: _tripped,
    ev.Unknown: _not_proved_safe,
    ev.StationGone: _station_gone,
    ev.PauseAsked: lambda state, _: (replace(state, pause_asked=True), ()),
    ev.ResumeAsked: lambda state, _: (replace(state, pause_asked=False), ()),
}
