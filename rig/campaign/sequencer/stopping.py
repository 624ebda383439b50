"""Sequencer: how a campaign stops and how it ends, independent of the order of points.

Every fault leads to a latch, from there to a confirmed standstill or to "unknown", and from both to the end; only a
stop of kind S2 with a cause that allows it leads back, through an explicit reset and every check of the preflight.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rig.campaign.results import RigState
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer.action import MIN_WALL_S, PATIENCE, PROOF_WALL_S, Action, Request
from rig.campaign.sequencer.state import Latch, Phase, State
from rig.campaign.stop_cause import COOLS_FIRST, StopCause, because, may_restart, stop_note
from rig.campaign.words import say
from rig.faults.row import StopKind
from rig.test_point import ENDURANCE

Step = tuple[State, tuple[Action, ...]]
Handler = Callable[[State, Any], Step]

STANDSTILL_LIMIT_S = 5.0
STOP_LIMIT_S = 20.0
"""Longer than any stop of the station: it fades out in at most 10 s of the rig's clock, or takes the pressure away."""
STOP_WALL_S = 15.0
STOP_PATIENCE = 2.0
RETURN_LIMIT_S = 1.0
COOLING_PAUSE_S = 20.0
COOLING_LIMIT_S = COOLING_PAUSE_S + 10.0


def enter(
    state: State, phase: Phase, *actions: Action, device_s: float, wall_s: float = MIN_WALL_S,
    patience: float = PATIENCE,
) -> Step:
    """Go to another phase: first its deadline (see `Deadline`), then `actions`. No phase is without one."""
    return replace(state, phase=phase), (act.Deadline(phase, device_s, wall_s, patience), *actions)


def request(state: State, phase: Phase, requested: Request) -> Step:
    """Go to a phase that waits for the station's proof of a request."""
    return enter(state, phase, act.Ask(requested), device_s=0.0, wall_s=PROOF_WALL_S[requested])


def end_recording(state: State, fault: StopCause | None) -> Step:
    """Close the current point's recording if it is open; a `fault` makes the point invalid.

    A block of an endurance test is awaited: its file states how many cycles are left of it.
    """
    if not state.recording:
        return state, ()
    attempt = state.attempts.count(state.point.id)
    if state.point.kind == ENDURANCE:
        state = replace(state, unjudged=(*state.unjudged, state.point.id))
    return replace(state, recording=False), (act.EndRecording(state.point, attempt, fault),)


def latch(state: State, stop: StopKind, cause: StopCause, *actions: Action) -> Step:
    """Latch the first cause and wait for the proof of standstill; `actions` go first."""
    return await_proof(replace(state, latch=Latch(stop, cause), held_at_m=None), stop, cause, *actions)


def await_proof(state: State, stop: StopKind, cause: StopCause, *actions: Action) -> Step:
    """Say why the rig stops and wait for the station's proof of it."""
    note = act.Note(*stop_note(stop, cause), stop=cause.slug)
    return enter(
        state, Phase.STOPPING, *actions, note, device_s=STOP_LIMIT_S, wall_s=STOP_WALL_S, patience=STOP_PATIENCE
    )


def tripped(state: State, event: ev.Tripped) -> Step:
    """The station tripped: it stops the rig already, so nothing is asked of it.

    A first trip during a reset came after the station had forgotten the one that is latched here: it is proved again.
    """
    if state.latch is None:
        return latch(state, event.stop, event.cause)
    restarts = may_restart(event.stop, event.cause)
    if event.first and state.phase is Phase.RESETTING:
        state = replace(state if restarts else without_restart(state), stopped=False)
        return await_proof(state, event.stop, event.cause)
    return (state, ()) if restarts else give_up_restart(state, event)


def without_restart(state: State) -> State:
    """After something that a restart may not follow: the first cause stays latched, and the campaign ends with it."""
    return replace(state, restart_withdrawn=True)


def fault(state: State, event: ev.Fault | ev.Abort) -> Step:
    """The application or the operator wants a stop: ask the station for it, or just end when nothing is armed.

    While a stop is under way it goes on undisturbed, but no restart follows it.
    """
    if state.latch is not None:
        return give_up_restart(state, event)
    if not state.armed:
        return finish(replace(state, latch=Latch(event.stop, event.cause)))
    return latch(state, event.stop, event.cause, act.Stop(event.stop, event.cause))


def note_abort_while_finishing(state: State, event: ev.Fault | ev.Abort) -> Step:
    """The rig is being shut down already: that goes on, and the cause is kept for the result."""
    return (replace(state, latch=Latch(event.stop, event.cause)) if state.latch is None else state), ()


def stopped(state: State, event: ev.Safe) -> Step:
    """Standstill and 0 A are proved: close the recording; repeat the point where that is allowed, else end.

    The pressure is off where the stop that was proved takes it away; the one that was asked for may be another.
    """
    if state.latch is None:
        return state, ()
    stop, cause = state.latch.stop, state.latch.cause
    state = replace(state, stopped=True)
    if event.stop is StopKind.PRESSURE_OFF:
        state = replace(state, pressurised=False, powered=False)
    if state.queue and not state.recording:
        state = replace(state, attempts=(*state.attempts, state.point.id))
    state, actions = end_recording(state, cause)
    allowed = state.refused is None and not state.restart_withdrawn and may_restart(stop, cause)
    allowed = allowed and not state.hand_flows
    if allowed and state.queue and state.attempts.count(state.point.id) <= state.retries:
        state, more = cool_down(state) if cause.slug in COOLS_FIRST else reset(state)
    else:
        state, more = finish(state)
    return state, actions + more


def reset(state: State) -> Step:
    """The explicit reset edge: the station forgets the trip once it has proved again what a reset demands."""
    return request(state, Phase.RESETTING, Request.RESET)


def cool_down(state: State) -> Step:
    """Stand still for a while at 0 A; whether that was enough is the ECU's word, when a reset is asked for."""
    state = replace(state, cooled_s=state.cooled_s + COOLING_PAUSE_S)
    longest_s = state.conditions.longest_s
    note = act.Note("info", say("cooling-ecu", cooled_s=state.cooled_s, longest_s=longest_s))
    return enter(state, Phase.COOLING_DOWN, note, act.Rest(COOLING_PAUSE_S), device_s=COOLING_LIMIT_S)


def reset_declined(state: State, cause: StopCause) -> Step:
    """An ECU that is still too hot keeps its fault: the wait goes on; any other refusal ends the campaign."""
    waits = state.latch is not None and state.latch.cause.slug in COOLS_FIRST
    still_hot = waits and cause.slug == "coil-not-ready" and state.cooled_s < state.conditions.longest_s
    return cool_down(state) if still_hot and not state.restart_withdrawn else finish(state)


def give_up_restart(state: State, event: ev.Fault | ev.Abort | ev.Tripped) -> Step:
    """Something else came up during a stop: it goes on, a reset under way too, and then the campaign ends."""
    state = without_restart(state)
    if state.phase is not Phase.COOLING_DOWN:
        return state, ()
    return disarm(state) if state.armed else end(state)


def not_proved_safe(state: State, event: ev.Unknown) -> Step:
    """The station cannot prove standstill or 0 A."""
    if not state.armed:
        return refuse(state, because("state-unknown", "said", text=event.detail))
    return lost(state, because("state-unknown", "said", text=event.detail))


def station_gone(state: State, event: ev.StationGone) -> Step:
    """There is no operator left to ask; before arming nothing can move, afterwards the rig's watchdogs act unseen."""
    return leave_to_station(state, because("task-dies", "said", text=event.detail))


def overdue(state: State, event: ev.TimedOut) -> Step:
    """What ends a stop, a reset or the campaign was not proved in time."""
    slug = "stop-ignored" if state.phase is Phase.STOPPING else "task-dies"
    return leave_to_station(state, because(slug, "unanswered", phase=state.phase))


def leave_to_station(state: State, cause: StopCause) -> Step:
    """End by closing the station's link; how the station then ends says whether the rig is safe.

    Before arming nothing can move: that is a refusal. What was recorded is kept as invalid.
    """
    if not state.armed:
        return end(replace(state, refused=state.refused or cause) if state.latch is None else state)
    first = state.latch or Latch(StopKind.PRESSURE_OFF, cause)
    state, actions = end_recording(replace(state, latch=first, left_to_station=True), first.cause)
    state, more = end(state)
    note = act.Note("error", say("left-to-station", detail=cause.detail))
    return state, (act.LeaveToStation(), note, *actions, *more)


def lost(state: State, cause: StopCause) -> Step:
    """The same where it is known that nothing can be proved: the rig's state is unknown."""
    state, actions = leave_to_station(state, cause)
    note = act.Note("error", say("state-unknown", detail=cause.detail))
    return replace(state, rig_state=RigState.UNKNOWN), (note, *actions)


def action_failed(state: State, event: ev.ActionFailed) -> Step:
    """Something could not be done: the rig is stopped; when that cannot be done either, it is left to its station."""
    if state.phase is Phase.ENDED:
        return state, ()
    state = _without_recording(state, event)
    essential = isinstance(event.action, act.Ask | act.Stop | act.Deadline | act.AwaitStandstill)
    if event.phase == state.phase and essential and state.phase in ENDING:
        return leave_to_station(state, event.cause)
    if state.phase in ENDING:
        return without_restart(state), ()
    if state.phase is Phase.CHECKING_RETURN:
        watches = isinstance(event.action, act.WatchZeros | act.Deadline)
        return disarm(state) if watches else (without_restart(state), ())
    if state.latch is not None or state.armed:
        return fault(state, ev.Fault(StopKind.FADE_OUT, event.cause))
    return refuse(state, event.cause)


PRESSURE_STAYS = frozenset({"hydraulics", "controller-refused"})
"""Refusals of a controller that was heard and has taken, or refused, the order to take its pressure away."""
ENDING = frozenset({Phase.STOPPING, Phase.RESETTING, Phase.FINISHING})
"""Phases that wait for the station, and that no further stop can make safer."""


def _without_recording(state: State, event: ev.ActionFailed) -> State:
    """A recording that could not be begun is not open, and no verdict follows one that could not be ended."""
    action = event.action
    if isinstance(action, act.BeginRecording):
        return replace(state, recording=False)
    if isinstance(action, act.EndRecording):
        return replace(state, unjudged=tuple(name for name in state.unjudged if name != action.point.id))
    return state


def declined(state: State, event: ev.Declined) -> Step:
    """A request was refused: before any motion that refuses the campaign, afterwards it stops the rig."""
    if event.request is Request.DISARM and state.phase is Phase.FINISHING:
        return disarm_declined(state, event.cause)
    if state.latch is not None or state.phase is Phase.FINISHING:
        return declined_while_stopping(state, event)
    if not state.moved:
        return refuse(state, event.cause)
    return fault(state, ev.Fault(StopKind.FADE_OUT, event.cause))


def disarm_declined(state: State, cause: StopCause) -> Step:
    """A rig that cannot be shut down in good order is stopped; when that was not proved either, nothing is known.

    Without pressure there is nothing to shut down. After a proved S2 or SO the controller holds the rod, powered, as
    these stops demand: where it takes no command any more, the rig is as safe as the stop promised, and the operator
    is told that the pressure is still on. A controller that takes the command and keeps its pressure is another
    matter: what it says of itself proves nothing, and the rig's state is unknown.
    """
    if not state.pressurised:
        return end(state)
    if state.stopped:
        promised_off = state.latch is not None and state.latch.stop is StopKind.PRESSURE_OFF
        if promised_off or cause.slug in PRESSURE_STAYS:
            state = replace(state, rig_state=RigState.UNKNOWN)
        state, actions = end(state)
        return state, (act.Note("error", say("hydraulics-on", detail=cause.detail)), *actions)
    if state.latch is not None:
        return lost(state, cause)
    return latch(state, StopKind.PRESSURE_OFF, cause, act.Stop(StopKind.PRESSURE_OFF, cause))


def declined_while_stopping(state: State, event: ev.Declined) -> Step:
    """A refusal that comes while the rig is stopped: only those of the stop's own requests count."""
    if event.request is Request.STOP and state.phase is Phase.STOPPING:
        state, actions = end_recording(state, None if state.latch is None else state.latch.cause)
        state, more = finish(state)
        return state, actions + more
    if event.request is Request.RESET and state.phase is Phase.RESETTING:
        return reset_declined(state, event.cause)
    return state, ()


def refuse(state: State, cause: StopCause) -> Step:
    """Refuse the campaign; once something has moved this is a fault like any other."""
    if state.moved:
        return fault(state, ev.Fault(StopKind.FADE_OUT, cause))
    state, actions = finish(replace(state, refused=cause))
    return state, (act.Note("error", say("refused", slug=cause.slug, detail=cause.detail)), *actions)


def spoiled(state: State, event: ev.Spoiled) -> Step:
    """The running point goes on and cannot be valid any more."""
    if not state.recording or state.spoiled is not None:
        return state, ()
    note = act.Note("warning", say("spoiled", slug=event.cause.slug, detail=event.cause.detail))
    return replace(state, spoiled=event.cause), (note,)


def finish(state: State) -> Step:
    """Shut the rig down in good order: at standstill hydraulics off, disarm, end."""
    if not state.armed:
        return end(state)
    if state.powered and state.moved and state.latch is None:
        return enter(state, Phase.STANDING, act.AwaitStandstill(), device_s=STANDSTILL_LIMIT_S)
    held = state.stopped and state.latch is not None and state.latch.stop is StopKind.FADE_OUT
    returns = state.powered and state.moved and held and not state.hand_flows
    return check_return(state) if returns else disarm(state)


def check_return(state: State) -> Step:
    """The rod rests at 0 A: compare the sensors' zeros with those of the start, before the pressure goes."""
    return enter(
        state, Phase.CHECKING_RETURN, act.WatchZeros(again=True), device_s=RETURN_LIMIT_S, wall_s=RETURN_LIMIT_S
    )


def abort_while_checking_return(state: State, event: ev.Fault | ev.Abort | ev.Tripped) -> Step:
    """The zeros are not worth a moment's delay."""
    if isinstance(event, ev.Tripped):
        return tripped(state, event) if state.latch is None else disarm(state)
    return fault(state, event) if state.latch is None else disarm(state)


def disarm(state: State) -> Step:
    """0 A, hydraulics off, give the lease back."""
    return request(state, Phase.FINISHING, Request.DISARM)


def question(state: State) -> tuple[Action, ...]:
    """Ask the operator for the requested current, so that it is in the journal too."""
    target_A = state.requested_A or 0.0
    note = act.Note("warning", say("ask-current" if target_A else "ask-zero", wanted_A=target_A), code="by-hand")
    return note, act.AskOperator(target_A)


def answer_s(state: State) -> float:
    """How long the operator may take for that (wall s)."""
    hand = state.conditions.hand
    return 0.0 if hand is None else hand.answer_s


def end(state: State) -> Step:
    """Nothing follows; but a current set by hand is taken away by hand first, unless the rig could not be disarmed."""
    if not state.hand_flows:
        return replace(state, phase=Phase.ENDED), (act.Finish(),)
    if state.armed or state.left_to_station or state.rig_state is RigState.UNKNOWN:
        state = replace(state, phase=Phase.ENDED, rig_state=RigState.UNKNOWN)
        return state, (act.Note("error", say("current-left"), code="by-hand"), act.Finish())
    state = replace(state, requested_A=0.0, hand_A=state.hand_A or state.requested_A)
    return enter(state, Phase.TAKING_AWAY, *question(state), device_s=0.0, wall_s=answer_s(state))
