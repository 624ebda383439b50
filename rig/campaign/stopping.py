"""How a campaign stops and how it ends: the part of the sequencer that knows nothing of points' order.

Every fault leads to a latch, from there to a proof of standstill or to "not known", and from both to the end; only a
stop of kind S2 for a cause that allows it leads back, through an explicit reset and every proof of the preflight.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rig.campaign import action as act
from rig.campaign import event as ev
from rig.campaign.action import Action, Request
from rig.campaign.cause import COOLS_FIRST, Cause, StopKind, may_restart
from rig.campaign.state import Latch, Phase, RigState, State

Step = tuple[State, tuple[Action, ...]]
Handler = Callable[[State, Any], Step]

STANDSTILL_LIMIT_S = 5.0
STOP_LIMIT_S = 60.0
COOLING_PAUSE_S = 20.0
COOLING_LIMIT_S = COOLING_PAUSE_S + 10.0


def enter(state: State, phase: Phase, *actions: Action, device_s: float | None = None) -> Step:
    """Go to another phase: a deadline of `device_s` seconds of the rig's clock (None: no deadline), then `actions`."""
    return replace(state, phase=phase), (act.Deadline(phase, device_s), *actions)


def end_recording(state: State, fault: Cause | None) -> Step:
    """Close the current point's recording if it is open; a `fault` makes the point invalid."""
    if not state.recording:
        return state, ()
    return replace(state, recording=False), (act.EndRecording(state.point, state.attempt, fault),)


def latch(state: State, stop: StopKind, cause: Cause, *actions: Action) -> Step:
    """Latch the first cause and wait for the proof of standstill; `actions` go first."""
    return await_proof(replace(state, latch=Latch(stop, cause), held_at_m=None), stop, cause, *actions)


def await_proof(state: State, stop: StopKind, cause: Cause, *actions: Action) -> Step:
    """Say why the rig stops and wait for the station's proof of it."""
    period_s = 1.0 / state.queue[0].frequency_Hz if state.queue else 0.0
    note = act.Note("error", f"{stop}: {cause.slug}: {cause.detail}")
    return enter(state, Phase.STOPPING, *actions, note, device_s=STOP_LIMIT_S + 2.0 * period_s)


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
    return replace(state, retries=0)


def gave_up(state: State) -> bool:
    """Whether a restart that was begun has been taken away."""
    return state.retries == 0


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
    """Standstill and 0 A are proved: close the recording; repeat the point where that is allowed, else end."""
    if state.latch is None:
        return state, ()
    stop, cause = state.latch.stop, state.latch.cause
    state = replace(state, stopped=True)
    if stop is StopKind.S1:
        state = replace(state, pressurised=False, powered=False)
    if state.queue and not state.recording:
        state = replace(state, attempts=(*state.attempts, state.point.id))
    state, actions = end_recording(state, cause)
    repeat = state.refused is None and state.queue and state.may_repeat(state.point.id)
    if repeat and may_restart(stop, cause):
        state, more = cool_down(state) if cause.slug in COOLS_FIRST else reset(state)
    else:
        state, more = finish(state)
    return state, actions + more


def reset(state: State) -> Step:
    """The explicit reset edge: the station forgets the trip once it has proved again what a reset demands."""
    return enter(state, Phase.RESETTING, act.Ask(Request.RESET))


def cool_down(state: State) -> Step:
    """Stand still for a while at 0 A; whether that was enough is the ECU's word, when a reset is asked for."""
    state = replace(state, cooled_s=state.cooled_s + COOLING_PAUSE_S)
    longest_s = state.conditions.longest_s
    note = act.Note("info", f"waiting for the ECU to cool down: {state.cooled_s:g} s of at most {longest_s:g} s")
    return enter(state, Phase.COOLING_DOWN, note, act.Rest(COOLING_PAUSE_S), device_s=COOLING_LIMIT_S)


def reset_declined(state: State, cause: Cause) -> Step:
    """An ECU that is still too hot keeps its fault: the wait goes on; any other refusal ends the campaign."""
    waits = state.latch is not None and state.latch.cause.slug in COOLS_FIRST
    if gave_up(state) or not waits or cause.slug != "coil-not-ready" or state.cooled_s >= state.conditions.longest_s:
        return finish(state)
    return cool_down(state)


def give_up_restart(state: State, event: ev.Fault | ev.Abort | ev.Tripped) -> Step:
    """Something else came up during a stop: it goes on, a reset under way too, and then the campaign ends."""
    state = without_restart(state)
    return finish(state) if state.phase is Phase.COOLING_DOWN else (state, ())


def not_proved_safe(state: State, event: ev.Unknown) -> Step:
    """The station cannot prove standstill or 0 A."""
    if not state.armed:
        return refuse(state, Cause("state-unknown", event.detail))
    return lost(state, Cause("state-unknown", event.detail))


def station_gone(state: State, event: ev.StationGone) -> Step:
    """Nobody is left to ask; before arming nothing can move, afterwards the rig's dead-men act unseen."""
    cause = Cause("task-dies", event.detail)
    if not state.armed:
        return end(replace(state, refused=state.refused or cause))
    return lost(state, cause)


def stop_timed_out(state: State, event: ev.TimedOut) -> Step:
    """The stop took longer than any stop may."""
    return lost(state, Cause("stop-ignored", "the station did not prove standstill and 0 A in time"))


def lost(state: State, cause: Cause) -> Step:
    """End with the rig's state unknown; what was recorded is kept as invalid."""
    first = state.latch or Latch(StopKind.SO, cause)
    state, actions = end_recording(replace(state, latch=first, rig_state=RigState.UNKNOWN), first.cause)
    state, more = end(state)
    return state, (*actions, act.Note("error", f"the rig's state is not known: {cause.detail}"), *more)


def declined(state: State, event: ev.Declined) -> Step:
    """A request was refused: before any motion that refuses the campaign, afterwards it stops the rig."""
    if event.request is Request.DISARM and state.phase is Phase.FINISHING:
        return disarm_declined(state, event.cause)
    if state.latch is not None or state.phase is Phase.FINISHING:
        return declined_while_stopping(state, event)
    if not state.moved:
        return refuse(state, event.cause)
    return fault(state, ev.Fault(StopKind.S2, event.cause))


def disarm_declined(state: State, cause: Cause) -> Step:
    """A rig that cannot be shut down in good order is stopped; when that was not proved either, nothing is known.

    Without pressure there is nothing to shut down. After a proved S2 or SO the controller holds the rod, powered, as
    these stops demand: the rig is safe, and the operator is told that the pressure is still on.
    """
    if not state.pressurised:
        return end(state)
    if state.stopped:
        state, actions = end(state)
        text = f"the rig stands still at 0 A, but its hydraulics could not be switched off: {cause.detail}"
        return state, (act.Note("error", text), *actions)
    if state.latch is not None:
        return lost(state, cause)
    return latch(state, StopKind.S1, cause, act.Stop(StopKind.S1, cause))


def declined_while_stopping(state: State, event: ev.Declined) -> Step:
    """A refusal that comes while the rig is stopped: only those of the stop's own requests count."""
    if event.request is Request.STOP and state.phase is Phase.STOPPING:
        state, actions = end_recording(state, None if state.latch is None else state.latch.cause)
        state, more = finish(state)
        return state, actions + more
    if event.request is Request.RESET and state.phase is Phase.RESETTING:
        return reset_declined(state, event.cause)
    return state, ()


def refuse(state: State, cause: Cause) -> Step:
    """Refuse the campaign; once something has moved this is a fault like any other."""
    if state.moved:
        return fault(state, ev.Fault(StopKind.S2, cause))
    state, actions = finish(replace(state, refused=cause))
    return state, (act.Note("error", f"refused: {cause.slug}: {cause.detail}"), *actions)


def spoiled(state: State, event: ev.Spoiled) -> Step:
    """The running point goes on and cannot be valid any more."""
    if not state.recording or state.spoiled is not None:
        return state, ()
    return replace(state, spoiled=event.cause), (act.Note("warning", f"{event.cause.slug}: {event.cause.detail}"),)


def finish(state: State) -> Step:
    """Shut the rig down in good order: at standstill hydraulics off, disarm, end."""
    if not state.armed:
        return end(state)
    if state.powered and state.moved and state.latch is None:
        return enter(state, Phase.STANDING, act.AwaitStandstill(), device_s=STANDSTILL_LIMIT_S)
    return disarm(state)


def stands(state: State, event: ev.Standstill) -> Step:
    """The rig stands still: hydraulics off."""
    return disarm(state)


def disarm(state: State) -> Step:
    """0 A, hydraulics off, give the lease back."""
    return enter(state, Phase.FINISHING, act.Ask(Request.DISARM))


def end(state: State) -> Step:
    """Nothing follows."""
    return enter(state, Phase.ENDED, act.Finish())
