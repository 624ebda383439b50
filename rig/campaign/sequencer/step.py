"""The sequence of a campaign as a pure function: `step(state, event) -> (state, actions)`.

1. No clock, no I/O: all input arrives as events, all output leaves as actions.
2. Nothing moves unless the rig is armed, watchdog and zeros are checked, pressure is on and no stop is latched.

The sequence: connect, check zeros, arm, test the watchdog, pressure low, pressure on, check the sensors by a slow move,
then for each point: centre, settle the current, record and run, back to 0 A, rest; at the end hydraulics off.
Temperature, magnetic history and trial programs come in between if the matrix requires them (`point_preparation`),
the operator if the current is set manually (`manual_current`).
It is defined by tables: `NEXT` for the phase an event belongs to, `ALWAYS` for events that can come at any time,
`OVERDUE` (`overdue`) for phases that exceed their deadline. An event in none of them is late and has no effect.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import endurance, manual_current, point_preparation, stopping
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer.action import Action, Request
from rig.campaign.sequencer.overdue import OVERDUE, PAUSE_LIMIT_S
from rig.campaign.sequencer.state import Phase, State
from rig.campaign.sequencer.stopping import Handler, Step
from rig.campaign.stop_cause import because
from rig.campaign.words import say
from rig.faults.row import StopKind
from rig.test_point import ENDURANCE, TestPoint

CENTRING_LIMIT_S = 60.0
ZEROS_LIMIT_S = 5.0
PROOF_LIMIT_S = 10.0
PROGRAM_LIMIT_S = 5.0
PROGRAM_PATIENCE = 1.25
PROGRAM_EXTRA_S = 5.0
EVALUATION_LIMIT_S = 120.0
"""Wall time: files are written on the host."""
EVALUATION_SHARE = 0.5
"""Of a block's motion, in addition: a long block has a large file."""
REST_EXTRA_S = 5.0


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


# Preflight


def _begin(state: State, event: ev.Begin) -> Step:
    return stopping.request(state, Phase.CONNECTING, Request.CONNECT)


def _arm(state: State) -> Step:
    return stopping.request(replace(state, armed=True, proved=False), Phase.ARMING, Request.ARM)


def _prove_watchdog(state: State) -> Step:
    state = replace(state, pressurised=state.pressurised or state.conditions.powered_test)
    return stopping.request(state, Phase.PROVING_WATCHDOG, Request.STARVE_WATCHDOG)


def _connected(state: State) -> Step:
    return manual_current.ask(state, 0.0) if manual_current.due(state, 0.0) else _check_zeros(state)


def _check_zeros(state: State) -> Step:
    return stopping.enter(state, Phase.CHECKING_ZEROS, act.WatchZeros(), device_s=ZEROS_LIMIT_S)


def _begin_again(state: State) -> Step:
    """The trip is reset: every proof is made again, unless something has taken the restart away meanwhile."""
    return stopping.finish(state) if state.restart_withdrawn else _check_zeros(state.unlatched())


def _zeros(state: State, event: ev.ZerosJudged) -> Step:
    return _arm(state) if event.cause is None else stopping.refuse(state, event.cause)


def _pressure_low(state: State) -> Step:
    state = replace(state, proved=True, pressurised=True)
    return stopping.request(state, Phase.PRESSURE_LOW, Request.HYDRAULICS_LOW)


def _pressure_on(state: State) -> Step:
    return stopping.request(state, Phase.PRESSURE_ON, Request.HYDRAULICS_ON)


def _powered(state: State) -> Step:
    if state.yielded:
        return _go_on(replace(state, powered=True, yielded=False))
    return _prove_sensors(replace(state, powered=True), 0)


def _prove_sensors(state: State, leg: int) -> Step:
    return stopping.enter(state, Phase.PROVING_SENSORS, act.ProveSensors(leg), device_s=PROOF_LIMIT_S)


def _sensors_proved(state: State, event: ev.ProofJudged) -> Step:
    return _next_point(state) if event.cause is None else stopping.refuse(state, event.cause)


PROVED: dict[tuple[Phase, Request], Callable[[State], Step]] = {
    (Phase.CONNECTING, Request.CONNECT): _connected,
    (Phase.ARMING, Request.ARM): _prove_watchdog,
    (Phase.PROVING_WATCHDOG, Request.STARVE_WATCHDOG): _pressure_low,
    (Phase.PRESSURE_LOW, Request.HYDRAULICS_LOW): _pressure_on,
    (Phase.PRESSURE_ON, Request.HYDRAULICS_ON): _powered,
    (Phase.YIELDING, Request.HYDRAULICS_OFF): manual_current.without_pressure,
    (Phase.YIELDING, Request.HYDRAULICS_LOW): manual_current.with_low_pressure,
    (Phase.STOPPING, Request.STOP): lambda state: stopping.stopped(
        state, ev.Safe() if state.latch is None else ev.Safe(state.latch.stop)
    ),
    (Phase.RESETTING, Request.RESET): _begin_again,
    (Phase.FINISHING, Request.DISARM): lambda state: stopping.end(
        replace(state, armed=False, pressurised=False, powered=False)
    ),
}


def _done(state: State, event: ev.Done) -> Step:
    proved = PROVED.get((state.phase, event.request))
    return (state, ()) if proved is None else proved(state)


# One point after the other


def _next_point(state: State) -> Step:
    running = state.queue and not state.pause_requested
    target_A = point_preparation.program(state).first_current_A if running else 0.0
    if manual_current.due(state, target_A):
        return manual_current.ask(state, target_A)
    if not state.queue:
        if state.unjudged:
            return stopping.enter(state, Phase.EVALUATING, device_s=0.0, wall_s=EVALUATION_LIMIT_S)
        return stopping.finish(state)
    if state.pause_requested:
        note = act.Note("info", say("paused", point=state.point.id))
        return stopping.enter(state, Phase.PAUSED, note, device_s=0.0, wall_s=PAUSE_LIMIT_S)
    if endurance.awaited(state):
        limit_s = EVALUATION_LIMIT_S + EVALUATION_SHARE * state.point.motion_s
        return stopping.enter(state, Phase.EVALUATING, device_s=0.0, wall_s=limit_s)
    if state.conditions.thermal is not None:
        return point_preparation.read_temperature(state)
    return _approach(state)


def _approach(state: State) -> Step:
    begun = None if state.warming is not None else point_preparation.begin_iteration(state)
    if begun is not None:
        return begun
    centre_m = point_preparation.program(state).centre_m
    if state.held_at_m == centre_m:
        return _settle(state)
    state = replace(state, moved=True, held_at_m=None)
    return stopping.enter(state, Phase.CENTRING, act.Move(centre_m), device_s=CENTRING_LIMIT_S)


def _centred(state: State, event: ev.Centred) -> Step:
    return _settle(replace(state, held_at_m=point_preparation.program(state).centre_m))


def _settle(state: State) -> Step:
    program = point_preparation.program(state)
    demagnetising = point_preparation.demagnetise(state, program.first_current_A)
    if demagnetising is not None:
        return demagnetising
    largest_A = max(state.magnetised_A, program.current_A)
    state = replace(state, magnetised_A=largest_A, last_current_A=program.first_current_A)
    current = act.SetCurrent(program.first_current_A)
    return stopping.enter(state, Phase.SETTLING, current, device_s=point_preparation.CURRENT_LIMIT_S)


def _run(state: State, event: ev.CurrentSettled) -> Step:
    point, program = state.point, point_preparation.program(state)
    if state.warming is not None:
        return _start(state, Phase.WARMING, program)
    trial = point_preparation.trial_of(state)
    if trial is not None:
        return _start(state, Phase.ITERATING if point_preparation.iterates(state) else Phase.ADAPTING, trial)
    state = replace(state, attempts=(*state.attempts, point.id), recording=True, spoiled=None)
    drive = point_preparation.signal_drive_of(state)
    begin = act.BeginRecording(point, state.attempts.count(point.id), program, drive)
    if point.at_rest:
        state = replace(state, steps_left=point.steps_A[1:])
        return _hold_step(state, begin)
    if point.current_programmed:
        state = replace(state, last_current_A=point.steps_in_motion[-1][1])
    return _start(state, Phase.RUNNING, program, begin)


def _start(state: State, phase: Phase, motion: TestPoint, *actions: Action) -> Step:
    """Start a program in a phase of its own; `actions` go first."""
    state = replace(state, moved=True, held_at_m=None)
    limit_s = PROGRAM_PATIENCE * motion.motion_s + PROGRAM_EXTRA_S
    return stopping.enter(state, phase, *actions, act.Start(motion), device_s=limit_s)


def _hold_step(state: State, *actions: Action) -> Step:
    hold_s = 1.0 / state.point.frequency_Hz
    return stopping.enter(state, Phase.STEPPING, *actions, act.Rest(hold_s), device_s=hold_s + PROGRAM_LIMIT_S)


def _stepped(state: State, event: ev.RestOver) -> Step:
    if not state.steps_left:
        return _recorded(state, state.held_at_m)
    following, *rest = state.steps_left
    state = replace(state, steps_left=tuple(rest), last_current_A=following)
    return _hold_step(state, act.SetCurrent(following))


def _second_master(state: State, event: ev.ProgramEnded) -> Step:
    """A program that ended early, although it was not stopped here: nothing starts after it."""
    point = point_preparation.program(state).id
    cause = because("second-master", "ended-by-another", point=point, how=event.cut_short)
    return stopping.fault(state, ev.Fault(StopKind.FADE_OUT, cause))


def _ran_through(handler: Handler) -> Handler:
    return lambda state, event: _second_master(state, event) if event.cut_short else handler(state, event)


def _warmed(state: State, event: ev.ProgramEnded) -> Step:
    return _onwards(replace(state, held_at_m=_held(state, event), warming=None))


def _tried(state: State, event: ev.ProgramEnded) -> Step:
    held_at_m = _held(state, event)
    if event.motion is None:
        cause = because("amplitude", "no-full-cycle")
        return point_preparation.give_up(replace(state, held_at_m=held_at_m), cause)
    state = point_preparation.learn(replace(state, held_at_m=held_at_m), event)
    note = point_preparation.learned_note(state, event)
    state, actions = _onwards(state)
    return state, (note, *actions)


def _tried_signal(state: State, event: ev.ProgramEnded) -> Step:
    return point_preparation.iterate(replace(state, held_at_m=_held(state, event)))


def _held(state: State, event: ev.ProgramEnded) -> float | None:
    return point_preparation.program(state).centre_m if event.at_centre else None


def _onwards(state: State) -> Step:
    """After a program that is not recorded, current still on: back to 0 A only for a pause."""
    if state.pause_requested:
        return _clear(state)
    return _next_point(state)


def _clear(state: State) -> Step:
    """Back to 0 A; to what is set by hand, where it is."""
    current = act.SetCurrent(state.resting_A)
    return stopping.enter(state, Phase.CLEARING, current, device_s=point_preparation.CURRENT_LIMIT_S)


def _program_ended(state: State, event: ev.ProgramEnded) -> Step:
    held_at_m = _held(state, event)
    if state.spoiled is not None:
        return _recorded(state, held_at_m)
    signal = point_preparation.signal_drive_of(state)
    if signal is not None:
        return _recorded(state, held_at_m, *([act.Remark("iteration", signal.cannot)] if signal.cannot else []))
    state = point_preparation.learn(state, event)
    drive = point_preparation.drive_of(state) if point_preparation.adapts(state) else None
    if drive is None or event.motion is None or (drive.settled and not drive.cannot):
        return _recorded(state, held_at_m)
    note = point_preparation.learned_note(state, event)
    if drive.cannot or state.point.kind == ENDURANCE:  # the cycles of a block were run, whatever their amplitude
        remarks = (act.Remark("machine-cannot", drive.cannot),) if drive.cannot else ()
        state, actions = _recorded(state, held_at_m, *remarks)
        return state, (note, *actions)
    point = state.point
    state, actions = _onwards(replace(state.without_last_attempt(), recording=False, held_at_m=held_at_m))
    return state, (act.DropRecording(point, note.text), note, *actions)


def _recorded(state: State, held_at_m: float | None, *remarks: Action) -> Step:
    point, spoiled = state.point, state.spoiled
    if point.kind == ENDURANCE:
        state, actions = stopping.end_recording(state, spoiled)
        state, more = _clear(replace(state, held_at_m=held_at_m, spoiled=None, rest_s=point.rest_s))
        return state, (*remarks, *actions, *more)
    may_repeat = state.attempts.count(point.id) <= state.retries
    state, actions = stopping.end_recording(state, spoiled)
    actions = remarks + actions
    state = replace(state, held_at_m=held_at_m, spoiled=None, rest_s=point.rest_s)
    if spoiled is None or not may_repeat:
        state = replace(state, queue=state.queue[1:])
    if spoiled is None and may_repeat:
        # Its verdict decides.
        state = replace(state, unjudged=(*state.unjudged, point.id), given_back=(*state.given_back, point))
    state, more = _clear(state)
    return state, actions + more


def _cleared(state: State, event: ev.CurrentSettled) -> Step:
    return _go_on(state)


def _current_set(state: State, event: ev.CurrentSettled) -> Step:
    state = manual_current.settled(state)
    if not state.armed:
        return _check_zeros(state)
    if not state.yielded:
        return _go_on(state)
    return _pressure_on(state) if state.pressurised else _pressure_low(state)


def _go_on(state: State) -> Step:
    """To the rest after a point, at 0 A, or to the next point."""
    if state.rest_s > 0.0 and manual_current.due(state, 0.0):
        return manual_current.ask(state, 0.0)
    if state.rest_s > 0.0:
        limit_s = state.rest_s + REST_EXTRA_S
        return stopping.enter(replace(state, rest_s=0.0), Phase.RESTING, act.Rest(state.rest_s), device_s=limit_s)
    return _next_point(state)


def _rested(state: State, event: ev.RestOver) -> Step:
    return _next_point(state)


def _evaluated(state: State, event: ev.Judged) -> Step:
    if event.block is not None:
        state, actions = endurance.counted(state, event, event.block)
        state, more = _next_point(state) if state.phase is Phase.EVALUATING else (state, ())
        return state, (*actions, *more)
    if event.point_id not in state.unjudged:
        return state, ()
    again = tuple(point for point in state.given_back if point.id == event.point_id and not event.valid)
    state = replace(
        state,
        unjudged=tuple(name for name in state.unjudged if name != event.point_id),
        given_back=tuple(point for point in state.given_back if point.id != event.point_id),
        queue=state.queue + again,
    )
    return _next_point(state) if state.phase is Phase.EVALUATING else (state, ())


def _resume(state: State, event: ev.ResumeAsked) -> Step:
    return _next_point(replace(state, pause_requested=False))


def _timed_out(state: State, event: ev.TimedOut) -> Step:
    overdue = OVERDUE.get(state.phase) if event.phase == state.phase else None
    return (state, ()) if overdue is None else overdue(state, event)


NEXT: dict[tuple[Phase, type[ev.Event]], Handler] = {
    (Phase.NEW, ev.Begin): _begin,
    (Phase.CHECKING_ZEROS, ev.ZerosJudged): _zeros,
    (Phase.PROVING_SENSORS, ev.ProofLegDone): lambda state, _: _prove_sensors(state, 1),
    (Phase.PROVING_SENSORS, ev.ProofJudged): _sensors_proved,
    (Phase.CENTRING, ev.Centred): _centred,
    (Phase.GATING, ev.TemperatureRead): lambda state, event: point_preparation.gate(state, event, _approach),
    (Phase.COOLING, ev.CooledDown): lambda state, _: _next_point(state),
    (Phase.DEMAGNETISING, ev.CurrentSettled): lambda state, _: point_preparation.demagnetised(state, _settle),
    (Phase.SETTLING, ev.CurrentSettled): _run,
    (Phase.ASKING, ev.OperatorAnswered): manual_current.answered,
    (Phase.CURRENT_SET, ev.CurrentSettled): _current_set,
    (Phase.TAKING_AWAY, ev.OperatorAnswered): manual_current.taken_away,
    (Phase.TAKING_AWAY, ev.Abort): manual_current.left,
    (Phase.TAKING_AWAY, ev.Fault): stopping.note_abort_while_finishing,
    (Phase.TAKEN_AWAY, ev.CurrentSettled): lambda state, _: stopping.end(state),
    (Phase.TAKEN_AWAY, ev.Abort): stopping.note_abort_while_finishing,
    (Phase.TAKEN_AWAY, ev.Fault): stopping.note_abort_while_finishing,
    (Phase.WARMING, ev.ProgramEnded): _ran_through(_warmed),
    (Phase.ADAPTING, ev.ProgramEnded): _ran_through(_tried),
    (Phase.ITERATING, ev.ProgramEnded): _ran_through(_tried_signal),
    (Phase.CORRECTING, ev.Iterated): lambda state, event: point_preparation.iterated(state, event, _onwards),
    (Phase.RUNNING, ev.ProgramEnded): _ran_through(_program_ended),
    (Phase.STEPPING, ev.RestOver): _stepped,
    (Phase.CLEARING, ev.CurrentSettled): _cleared,
    (Phase.RESTING, ev.RestOver): _rested,
    (Phase.PAUSED, ev.ResumeAsked): _resume,
    (Phase.STANDING, ev.Standstill): lambda state, _: stopping.check_return(state),
    (Phase.CHECKING_RETURN, ev.ZerosReturned): lambda state, _: stopping.disarm(state),
    (Phase.CHECKING_RETURN, ev.Fault): stopping.abort_while_checking_return,
    (Phase.CHECKING_RETURN, ev.Abort): stopping.abort_while_checking_return,
    (Phase.CHECKING_RETURN, ev.Tripped): stopping.abort_while_checking_return,
    (Phase.STOPPING, ev.Safe): stopping.stopped,
    (Phase.COOLING_DOWN, ev.RestOver): lambda state, _: stopping.reset(state),
    (Phase.FINISHING, ev.Fault): stopping.note_abort_while_finishing,
    (Phase.FINISHING, ev.Abort): stopping.note_abort_while_finishing,
}

ALWAYS: dict[type[ev.Event], Handler] = {
    ev.Done: _done,
    ev.Declined: stopping.declined,
    ev.Judged: _evaluated,
    ev.TimedOut: _timed_out,
    ev.ActionFailed: stopping.action_failed,
    ev.Spoiled: stopping.spoiled,
    ev.Fault: stopping.fault,
    ev.Abort: stopping.fault,
    ev.Tripped: stopping.tripped,
    ev.Unknown: stopping.not_proved_safe,
    ev.StationGone: stopping.station_gone,
    ev.PauseAsked: lambda state, _: (replace(state, pause_requested=True), ()),
    ev.ResumeAsked: lambda state, _: (replace(state, pause_requested=False), ()),
}
