"""Sequencer: what comes before a point's own motion so that it can be trusted, and what is learned after it.

Temperature gate, warming up, cooling down, demagnetising, trial programs. Where the campaign goes on afterwards is
handed in by the sequencer (`onwards`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from rig.campaign.results import Wait
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import amplitude_compensation, stopping
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer.state import Phase, State, demagnetising_currents
from rig.campaign.sequencer.stopping import Step
from rig.campaign.stop_cause import StopCause, because
from rig.campaign.words import say
from rig.faults.row import StopKind
from rig.matrix.point import TestPoint

Onwards = Callable[[State], Step]

TEMPERATURE_LIMIT_S = 5.0
CURRENT_LIMIT_S = 5.0
COOLING_PATIENCE = 2.0
COOLING_EXTRA_S = 60.0
PROGRAM_PATIENCE = 1.25
PROGRAM_EXTRA_S = 5.0


def program(state: State) -> TestPoint:
    """The motion the campaign prepares for: the current point's as it is commanded now, or the warm-up's."""
    if state.warming is not None:
        return state.warming
    point = state.point
    if not adapts(state):
        return point
    return amplitude_compensation.commanded(point, drive(state))


def drive(state: State) -> amplitude_compensation.Drive:
    """How the current point's motion is commanded."""
    return amplitude_compensation.drive_for(state.point, state.drives, state.conditions.ceiling(state.point))


def adapts(state: State) -> bool:
    """Whether the current point's command is compensated."""
    return state.conditions.tolerance is not None and state.point.kind == "loop"


def wants_trial(state: State) -> bool:
    """Whether a short program comes before the current point."""
    tolerance = state.conditions.tolerance
    if tolerance is None or not adapts(state):
        return False
    return amplitude_compensation.wants_trial(state.point, state.drives, tolerance)


def start(state: State, phase: Phase, motion: TestPoint, *actions: act.Action) -> Step:
    """Start a program in a phase of its own; `actions` go first."""
    state = replace(state, moved=True, held_at_m=None)
    limit_s = PROGRAM_PATIENCE * motion.motion_s + PROGRAM_EXTRA_S
    return stopping.enter(state, phase, *actions, act.Start(motion), device_s=limit_s)


def learn(state: State, event: ev.ProgramEnded) -> State:
    """Take what the sensors saw of the current point's motion into account."""
    tolerance, point, seen = state.conditions.tolerance, state.point, event.motion
    if tolerance is None or not adapts(state) or seen is None:
        return state
    tried = amplitude_compensation.learned(drive(state), point, seen, tolerance, state.conditions.ceiling(point))
    return replace(state, drives=amplitude_compensation.remembered(state.drives, tried))


def learned_note(state: State, event: ev.ProgramEnded) -> act.Note:
    """What a program out of tolerance leads to, in words."""
    point, seen, tried = state.point, event.motion, drive(state)
    if tried.cannot:
        return act.Note("warning", say("machine-cannot", why=tried.cannot))
    reached_mm = math.nan if seen is None else 1e3 * seen.amplitude_m
    values = {"point": point.id, "reached_mm": reached_mm, "wanted_mm": 1e3 * point.amplitude_m}
    if tried.settled:
        return act.Note("info", say("within-tolerance", **values), code="amplitude")
    text = say("corrected", **values, step=tried.steps, command_mm=1e3 * tried.command_m)
    return act.Note("info", text, code="amplitude")


def read_temperature(state: State) -> Step:
    """Ask for the coil's temperature; the gate follows."""
    return stopping.enter(state, Phase.GATING, act.ReadTemperature(), device_s=TEMPERATURE_LIMIT_S)


def gate(state: State, event: ev.TemperatureRead, onwards: Onwards) -> Step:
    """Let the point begin when the damper is warm enough and will end cool enough; else warm it, or let it cool."""
    thermal, now_degC = state.conditions.thermal, event.temperature_degC
    if thermal is None:
        return onwards(state)
    if now_degC < thermal.low_degC:
        return warm(state, now_degC, onwards)
    highest_degC = state.conditions.highest_start(state.point)
    if now_degC > highest_degC:
        return cool(state, now_degC, highest_degC)
    return onwards(replace(state, warming=None, warmed_s=0.0, warmed_with=None))


def warm(state: State, now_degC: float, onwards: Onwards) -> Step:
    """One more warm-up program; too many of them stop the campaign."""
    low_degC = math.nan if state.conditions.thermal is None else state.conditions.thermal.low_degC
    wanted = state.conditions.warm_up_program(now_degC, state.warmed_with)
    if wanted is None or state.warmed_s > state.conditions.longest_s:
        cause = because(
            "temperature-window", "still-cold", now_degC=now_degC, warmed_s=state.warmed_s, low_degC=low_degC
        )
        return stopping.fault(state, ev.Fault(StopKind.FADE_OUT, cause))
    motion, motion_s = wanted
    state = replace(
        state, warming=motion, warmed_s=state.warmed_s + motion_s, warmed_with=(motion_s, now_degC)
    )
    state, actions = onwards(state)
    wait = Wait(state.point.id, str(Phase.WARMING), now_degC, low_degC, motion_s)
    return state, (act.Note("info", wait.text, wait, "temperature"), *actions)


def cool(state: State, now_degC: float, highest_degC: float) -> Step:
    """Wait until the damper is cool enough; a point that would wait too long is given up."""
    thermal, point = state.conditions.thermal, state.point
    forecast_s = math.inf if thermal is None else thermal.heat.time_to(highest_degC, now_degC)
    if forecast_s > state.conditions.longest_s:
        message = "never-cool" if math.isinf(forecast_s) else "cool-too-late"
        values = {"now_degC": now_degC, "highest_degC": highest_degC, "forecast_s": forecast_s}
        return give_up(state, because("temperature-window", message, **values))
    wait = Wait(point.id, str(Phase.COOLING), now_degC, highest_degC, forecast_s)
    limit_s = COOLING_PATIENCE * forecast_s + COOLING_EXTRA_S
    note = act.Note("info", wait.text, wait, "temperature")
    actions = (note, act.SetCurrent(0.0), act.AwaitTemperature(highest_degC))
    return stopping.enter(state, Phase.COOLING, *actions, device_s=limit_s)


def give_up(state: State, cause: StopCause) -> Step:
    """The current point cannot be begun: it is invalid, and the campaign goes on."""
    point = state.point
    state = replace(state, queue=state.queue[1:], warming=None, warmed_s=0.0, warmed_with=None, demagnetising=())
    actions = (act.GiveUpPoint(point, cause), act.SetCurrent(0.0))
    return stopping.enter(state, Phase.CLEARING, *actions, device_s=CURRENT_LIMIT_S)


def cooling_overdue(state: State, event: ev.TimedOut) -> Step:
    """The damper did not cool as forecast."""
    return give_up(state, because("temperature-window", "cooling-overdue"))


def demagnetise(state: State, next_A: float) -> Step | None:
    """Begin to demagnetise before another current; None when there is nothing to take away."""
    if not state.conditions.demagnetise or state.magnetised_A == 0.0 or next_A == state.last_current_A:
        return None
    currents = demagnetising_currents(state.magnetised_A)
    state = replace(state, demagnetising=currents[1:], magnetised_A=0.0)
    return stopping.enter(state, Phase.DEMAGNETISING, act.SetCurrent(currents[0]), device_s=CURRENT_LIMIT_S)


def demagnetised(state: State, onwards: Onwards) -> Step:
    """The next current of the sequence, or onwards after the last."""
    if not state.demagnetising:
        return onwards(state)
    following, *rest = state.demagnetising
    state = replace(state, demagnetising=tuple(rest))
    return stopping.enter(state, Phase.DEMAGNETISING, act.SetCurrent(following), device_s=CURRENT_LIMIT_S)


def demagnetising_overdue(state: State, event: ev.TimedOut) -> Step:
    """The ECU does not drive the sequence."""
    return give_up(state, because("current-tracking", "no-negative-current"))
