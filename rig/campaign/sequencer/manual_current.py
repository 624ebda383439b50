"""Sequencer: manual current. Requested before each point that needs another one, switched off at the end.

While the operator is at the supply nothing moves, and the pressure is as the bench file states for this time;
afterwards it is restored and the campaign continues. A current that was requested may flow before it is confirmed: it
counts as flowing until the operator confirms that it was switched off.
"""

from __future__ import annotations

from dataclasses import replace

from rig.campaign.results import RigState
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer import stopping
from rig.campaign.sequencer.action import Request
from rig.campaign.sequencer.state import Phase, State
from rig.campaign.sequencer.stopping import Step
from rig.campaign.stop_cause import because
from rig.campaign.words import say
from rig.faults.row import StopKind

SET_LIMIT_S = 5.0


def due(state: State, target_A: float) -> bool:
    """Whether the operator has to be asked for this current (A) now."""
    return state.conditions.hand is not None and state.hand_A != target_A


def ask(state: State, target_A: float) -> Step:
    """Ask for a current (A), with the pressure as the bench wants it meanwhile."""
    hand = state.conditions.hand
    state = replace(state, requested_A=target_A)
    if hand is None or not state.powered or hand.pressure == "on":
        return _ask_now(state)
    lowered = Request.HYDRAULICS_LOW if hand.pressure == "low" else Request.HYDRAULICS_OFF
    return stopping.request(replace(state, held_at_m=None, powered=False, yielded=True), Phase.YIELDING, lowered)


def without_pressure(state: State) -> Step:
    """The pressure is off: ask."""
    return _ask_now(replace(state, pressurised=False)) if _wants(state, "off") else (state, ())


def with_low_pressure(state: State) -> Step:
    """The pressure is low: ask, where that is what the bench wants."""
    return _ask_now(state) if _wants(state, "low") else (state, ())


def _wants(state: State, pressure: str) -> bool:
    return state.conditions.hand is not None and state.conditions.hand.pressure == pressure


def _ask_now(state: State) -> Step:
    return stopping.enter(state, Phase.ASKING, *stopping.question(state), device_s=0.0, wall_s=stopping.answer_s(state))


def answered(state: State, event: ev.OperatorAnswered) -> Step:
    """The person has said that it is set: the station records it from now on."""
    stated_A = state.requested_A or 0.0
    note = act.Note("info", say("set-by-hand", said_A=stated_A), code="by-hand")
    return stopping.enter(state, Phase.CURRENT_SET, note, act.SetCurrent(stated_A), device_s=SET_LIMIT_S)


def settled(state: State) -> State:
    """The station has it."""
    return replace(state, hand_A=state.requested_A, requested_A=None)


def unanswered(state: State, event: ev.TimedOut) -> Step:
    """No answer in time: refused before arming, stopped afterwards."""
    limit_s = stopping.answer_s(state)
    cause = because("by-hand-unanswered", "by-hand-unanswered", wanted_A=state.requested_A, limit_s=limit_s)
    if not state.armed:
        return stopping.refuse(state, cause)
    return stopping.fault(state, ev.Fault(StopKind.FADE_OUT, cause))


def taken_away(state: State, event: ev.OperatorAnswered) -> Step:
    """The person has said that no current flows any more: the station records it, and nothing follows."""
    state = replace(state, hand_A=0.0, requested_A=None)
    note = act.Note("info", say("set-by-hand", said_A=0.0), code="by-hand")
    return stopping.enter(state, Phase.TAKEN_AWAY, note, act.SetCurrent(0.0), device_s=SET_LIMIT_S)


def left(state: State, event: ev.TimedOut | ev.Abort) -> Step:
    """Its removal was not confirmed: it may flow, and the rig's state is not known."""
    if isinstance(event, ev.Abort):
        state, _ = stopping.note_abort_while_finishing(state, event)
    return stopping.end(replace(state, rig_state=RigState.UNKNOWN))
