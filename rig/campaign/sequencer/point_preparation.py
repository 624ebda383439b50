"""Sequencer: preparation of a point, and what is learned from its motion.

Temperature gate, warm-up, cooling, demagnetising, trial programs. The sequencer passes in the step that follows
(`onwards`).

Peak and valley of the commanded motion are compensated: the amplitude that was reached determines the next command. If
a machine reaches 46 mm with a command of 50 mm, the next command is 54.3 mm. A correction of a motion (waveform,
amplitude, frequency) at a current is used for every later point with both: at another current the damper loads the rod
with another force, and no servo is infinitely stiff. A new current starts with the prediction from the motion's known
currents, a new motion with the correction of the nearest known one. Without any correction, points run without a
trial: on a good machine this costs nothing.

A signal has no one amplitude to correct: its whole command is iterated, if the matrix requires it
(`rig.signals.drive_iteration`). Each trial is a full run; the next command is calculated while the rod is at rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from rig.campaign.results import Wait
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer import stopping
from rig.campaign.sequencer.state import Ceiling, Drive, Drives, Phase, State, demagnetising_currents
from rig.campaign.sequencer.stopping import Step
from rig.campaign.stop_cause import StopCause, because
from rig.campaign.words import say
from rig.faults.row import StopKind
from rig.signals.drive_iteration import CONVERGED, TARGET, SignalDrive, remembered_signal
from rig.test_point import SIGNAL, TestPoint

Onwards = Callable[[State], Step]

TEMPERATURE_LIMIT_S = 5.0
CURRENT_LIMIT_S = 5.0
COOLING_PATIENCE = 2.0
COOLING_EXTRA_S = 60.0
MOST_STEPS = 3
MIN_ANSWER = 0.25
"""A larger command that brings less than this share of itself is not answered."""
LARGEST_SHIFT_M = 5e-3
MIN_SHARE = 0.5
"""Share of the wanted amplitude that a shift of the centre always leaves room for."""
MIN_CHANGE = 0.1
"""A correction that a limit makes smaller than this share of the tolerance is none."""
TRIAL_CYCLES = 3
ITERATION_LIMIT_S = 120.0
"""Wall time: the samples of ten minutes are aligned and transformed on the host."""
TRIAL_RAMP_CYCLES = 1.0


def program(state: State) -> TestPoint:
    """The motion the campaign prepares for: the current point's as it is commanded now, or the warm-up's."""
    if state.warming is not None:
        return state.warming
    signal = signal_drive_of(state)
    if signal is not None:
        return commanded_signal(state.point, signal)
    return commanded(state.point, drive_of(state)) if adapts(state) else state.point


def adapts(state: State) -> bool:
    """Whether the current point's command is compensated: a motion at a constant current, which repeats itself."""
    return state.conditions.tolerance is not None and state.point.adapts


def iterates(state: State) -> bool:
    """Whether the current point's command is iterated."""
    return state.conditions.iteration is not None and state.point.kind == SIGNAL


def signal_drive_of(state: State) -> SignalDrive | None:
    """How the current point's signal is commanded; None: it is not iterated, or nothing is known yet."""
    record = state.point.record_samples
    if record is None or not iterates(state):
        return None
    own = (drive for drive in state.signal_drives if drive.is_for(record, state.point.current_A))
    return next(own, None)


def begin_iteration(state: State) -> Step | None:
    """Request the first command of a signal; None where nothing is to be iterated, or it is known."""
    if not iterates(state) or signal_drive_of(state) is not None:
        return None
    return _calculate(state, act.Iterate(state.point, known=(*state.signal_drives, *state.stored_drives)))


def iterate(state: State) -> Step:
    """A trial has ended: request the next command."""
    return _calculate(state, act.Iterate(state.point, signal_drive_of(state), program(state)))


def _calculate(state: State, action: act.Iterate) -> Step:
    return stopping.enter(state, Phase.CORRECTING, action, device_s=0.0, wall_s=ITERATION_LIMIT_S)


def iterated(state: State, event: ev.Iterated, onwards: Onwards) -> Step:
    """The next command is there: run it, or the point itself where it is final."""
    if event.point_id != state.point.id:
        return state, ()
    if event.drive is None:
        return give_up(state, event.cause or because("iteration", "no-command"))
    note = iterated_note(state.point, event.drive)
    state, actions = onwards(replace(state, signal_drives=remembered_signal(state.signal_drives, event.drive)))
    return state, (note, *actions)


def iterated_note(point: TestPoint, drive: SignalDrive) -> act.Note:
    """What an iteration has brought, in words."""
    if drive.cannot:
        return act.Note("warning", say("iteration-ended", point=point.id, why=drive.cannot), code="iteration")
    name, values = "identifying", dict[str, object]()
    if drive.trials:
        name = "converged" if drive.outcome == CONVERGED else "iterated"
        trial = drive.trials[-1]
        values = {"number": trial.number, "percent": 100.0 * trial.error, "delay_ms": 1e3 * trial.delay_s}
    elif drive.response is not None:
        band_Hz = drive.response.band_Hz
        name = "response-identified" if drive.start == TARGET else "kept-drive"
        band = "no frequency" if band_Hz is None else f"{band_Hz[0]:.3g} to {band_Hz[1]:.3g} Hz"
        values = {"band": band, "delay_ms": 1e3 * drive.response.delay_s}
    return act.Note("info", say(name, point=point.id, **values), code="iteration")


def drive_of(state: State) -> Drive:
    """How the current point's motion is commanded."""
    return drive_for(state.point, state.drives, state.conditions.ceilings.get(state.point.id, Ceiling()))


def trial_of(state: State) -> TestPoint | None:
    """The program that comes before the current point; None where none is worth its time."""
    signal = signal_drive_of(state)
    if signal is not None:
        return None if signal.settled else commanded_signal(state.point, signal)
    tolerance, point = state.conditions.tolerance, state.point
    if tolerance is None or not adapts(state) or not wants_trial(point, state.drives, tolerance):
        return None
    return trial(point, drive_of(state))


def learn(state: State, event: ev.ProgramEnded) -> State:
    """Take what the sensors saw of the current point's motion into account."""
    tolerance, point, seen = state.conditions.tolerance, state.point, event.motion
    if tolerance is None or not adapts(state) or seen is None:
        return state
    ceiling = state.conditions.ceilings.get(point.id, Ceiling())
    return replace(state, drives=remembered(state.drives, learned(drive_of(state), point, seen, tolerance, ceiling)))


def learned_note(state: State, event: ev.ProgramEnded) -> act.Note:
    """What a program out of tolerance leads to, in words."""
    point, seen, tried = state.point, event.motion, drive_of(state)
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
    program = state.conditions.warm_up_program(now_degC, state.warmed_with)
    if program is None or state.warmed_s > state.conditions.longest_s:
        cause = because(
            "temperature-window", "still-cold", now_degC=now_degC, warmed_s=state.warmed_s, low_degC=low_degC
        )
        return stopping.fault(state, ev.Fault(StopKind.FADE_OUT, cause))
    motion, motion_s = program
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
    actions = (act.GiveUpPoint(point, cause), act.SetCurrent(state.resting_A))
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


# Compensation of the commanded motion


def allowed(ceiling: Ceiling, point: TestPoint, amplitude_m: float, shift_m: float) -> tuple[float, float, str]:
    """Amplitude and shift of the centre (m) nearest to the wanted ones, and what keeps them from being commanded.

    The shift comes first: it is what keeps the measured motion in the middle of the limits.
    """
    least_m = MIN_SHARE * point.amplitude_m
    lowest_m = max(-LARGEST_SHIFT_M, ceiling.low_m + least_m - point.centre_m)
    highest_m = min(LARGEST_SHIFT_M, ceiling.high_m - least_m - point.centre_m)
    moved_m = max(lowest_m, min(highest_m, shift_m))
    centre_m = point.centre_m + moved_m
    room_m = min(ceiling.high_m - centre_m, centre_m - ceiling.low_m)
    why = ""
    if amplitude_m > min(room_m, ceiling.amplitude_m):
        limit = ceiling.where if room_m < ceiling.amplitude_m else ceiling.what
        why = say("beyond-room", command_mm=1e3 * amplitude_m, centre_mm=1e3 * centre_m, limit=limit)
    elif moved_m != shift_m:
        why = say("beyond-shift", wanted_mm=1e3 * shift_m, allowed_mm=1e3 * moved_m)
    return min(amplitude_m, room_m, ceiling.amplitude_m), moved_m, why


def _moves_as(drive: Drive, point: TestPoint) -> bool:
    """Whether this is the point's motion, at whatever current."""
    motion = (point.waveform, point.amplitude_m, point.frequency_Hz)
    return (drive.waveform, drive.amplitude_m, drive.frequency_Hz) == motion


def _is_for(drive: Drive, point: TestPoint) -> bool:
    """Whether this is the point's motion at its current."""
    return _moves_as(drive, point) and drive.current_A == point.current_A


def drive_for(point: TestPoint, known: Drives, ceiling: Ceiling) -> Drive:
    """The drive known for a point's motion at its current, else one predicted from other currents or motions."""
    for drive in known:
        if _is_for(drive, point):
            return drive
    similar = [drive for drive in known if drive.waveform == point.waveform and not drive.cannot]
    same = [drive for drive in similar if _moves_as(drive, point)]
    nearest = min(same or similar, key=lambda drive: _apart(drive, point), default=None)
    shift_m = 0.0 if nearest is None else nearest.shift_m
    gain = _gain_at(same, point.current_A) if same else _predicted_gain(similar, point.frequency_Hz)
    command_m, shift_m, _ = allowed(ceiling, point, point.amplitude_m * gain, shift_m)
    return Drive(point.waveform, point.amplitude_m, point.frequency_Hz, point.current_A, command_m, shift_m)


def remembered(known: Drives, drive: Drive) -> Drives:
    """What is known, with this drive in place of an earlier one for the same motion and current."""
    key = (drive.waveform, drive.amplitude_m, drive.frequency_Hz, drive.current_A)
    kept = tuple(
        earlier for earlier in known
        if (earlier.waveform, earlier.amplitude_m, earlier.frequency_Hz, earlier.current_A) != key
    )
    return (*kept, drive)


def wants_trial(point: TestPoint, known: Drives, tolerance: float) -> bool:
    """Whether a short program is worth its time before the point: its drive is being corrected, or likely to be.

    A current between known ones needs none, nor does the first other current of a motion; beyond the known ones it does
    where the current is known to matter.
    """
    if any(_is_for(drive, point) for drive in known):
        return any(_is_for(drive, point) and not drive.settled for drive in known)
    same = [drive for drive in known if _moves_as(drive, point)]
    if same:
        currents_A, gains = [drive.current_A for drive in same], [drive.gain for drive in same]
        inside = min(currents_A) <= point.current_A <= max(currents_A)
        return not inside and max(gains) - min(gains) > 0.5 * tolerance
    return any(abs(drive.gain - 1.0) > 0.5 * tolerance for drive in known)


def commanded(point: TestPoint, drive: Drive) -> TestPoint:
    """The program that makes the point's motion."""
    return replace(point, amplitude_m=drive.command_m, centre_m=point.centre_m + drive.shift_m)


def commanded_signal(point: TestPoint, drive: SignalDrive) -> TestPoint:
    """The program of a signal's next run: noise that identifies the machine's response, or the iterated command."""
    record = drive.noise or drive.command or point.record_samples
    if record is None:
        return point
    target = point.record_samples if drive.noise is None else None
    return replace(point, record=record, amplitude_m=record.amplitude_m, target=target)


def trial(point: TestPoint, drive: Drive) -> TestPoint:
    """A short program of the point's motion."""
    return replace(
        commanded(point, drive),
        cycles=min(point.cycles, TRIAL_CYCLES),
        ramp_in_cycles=TRIAL_RAMP_CYCLES,
        ramp_out_cycles=TRIAL_RAMP_CYCLES,
    )


def within(point: TestPoint, seen: ev.MeasuredMotion, tolerance: float) -> bool:
    """Whether amplitude and mean are within `tolerance` of the wanted amplitude."""
    room_m = tolerance * point.amplitude_m
    return abs(seen.amplitude_m - point.amplitude_m) <= room_m and abs(seen.mean_m - point.centre_m) <= room_m


def learned(drive: Drive, point: TestPoint, seen: ev.MeasuredMotion, tolerance: float, ceiling: Ceiling) -> Drive:
    """The drive after one more program: settled, corrected, or given up with the reason."""
    if within(point, seen, tolerance):
        return replace(drive, settled=True, cannot="")
    if seen.amplitude_m <= 0.0:
        return _given_up(drive, point, seen, say("no-motion"))
    if drive.steps >= MOST_STEPS:
        return _given_up(drive, point, seen, say("not-within", percent=100 * tolerance, steps=MOST_STEPS))
    if _unanswered(drive, point, seen, tolerance):
        return _given_up(drive, point, seen, _machine(seen))
    target_m = drive.command_m * point.amplitude_m / seen.amplitude_m
    target_shift_m = drive.shift_m - (seen.mean_m - point.centre_m)
    command_m, shift_m, why = allowed(ceiling, point, target_m, target_shift_m)
    change_m = max(abs(command_m - drive.command_m), abs(shift_m - drive.shift_m))
    if why and change_m <= MIN_CHANGE * tolerance * point.amplitude_m:
        return _given_up(drive, point, seen, f"{why}; {_machine(seen)}" if seen.valve_saturated else why)
    tried = (drive.command_m, seen.amplitude_m)
    return replace(drive, command_m=command_m, shift_m=shift_m, steps=drive.steps + 1, tried=tried)


def _unanswered(drive: Drive, point: TestPoint, seen: ev.MeasuredMotion, tolerance: float) -> bool:
    """Whether a clearly larger command than before brought next to nothing."""
    if drive.tried is None or seen.amplitude_m >= point.amplitude_m:
        return False
    before_m, reached_m = drive.tried
    more_m = drive.command_m - before_m
    return more_m > 0.5 * tolerance * point.amplitude_m and seen.amplitude_m - reached_m < MIN_ANSWER * more_m


def _machine(seen: ev.MeasuredMotion) -> str:
    if seen.valve_saturated:
        return say("valve-saturated")
    if seen.disturbed:
        return seen.disturbed
    return say("no-answer", error_mm=1e3 * seen.following_error_m)


def _given_up(drive: Drive, point: TestPoint, seen: ev.MeasuredMotion, why: str) -> Drive:
    if seen.disturbed not in why:
        why = f"{why}; {seen.disturbed}"
    text = say(
        "cannot-reach", reached_mm=1e3 * seen.amplitude_m, wanted_mm=1e3 * point.amplitude_m,
        off=100.0 * (seen.amplitude_m / point.amplitude_m - 1.0), command_mm=1e3 * drive.command_m, why=why,
        aside_mm=1e3 * (seen.mean_m - point.centre_m),
    )
    return replace(drive, settled=True, cannot=text)


def _gain_at(same: list[Drive], current_A: float) -> float:
    """Gain of a motion at a current from its known currents: straight between two, beyond them as the last two say."""
    known = sorted((drive.current_A, drive.gain) for drive in same)
    if len(known) == 1:
        return known[0][1]
    upper = next((index for index, (at_A, _) in enumerate(known) if index and at_A >= current_A), len(known) - 1)
    (low_A, low), (high_A, high) = known[upper - 1], known[upper]
    straight = low + (high - low) * (current_A - low_A) / (high_A - low_A)
    room = max(gain for _, gain in known) - min(gain for _, gain in known)
    return max(min(low, high) - room, min(max(low, high) + room, straight))


def _predicted_gain(known: list[Drive], frequency_Hz: float) -> float:
    """Gain for a frequency from the known ones: `1 + b f^2`, a servo's droop well below its bandwidth.

    With two frequencies or more `a + b f^2` by least squares. Never extrapolated beyond twice the largest correction.
    """
    if not known:
        return 1.0
    squares = [drive.frequency_Hz**2 for drive in known]
    excess = [drive.gain - 1.0 for drive in known]
    mean_square, mean_excess = sum(squares) / len(squares), sum(excess) / len(excess)
    spread = sum((square - mean_square) ** 2 for square in squares)
    if spread > 0.0:
        slope = sum((s - mean_square) * e for s, e in zip(squares, excess, strict=True)) / spread
        predicted = mean_excess + slope * (frequency_Hz**2 - mean_square)
    else:
        predicted = mean_excess * frequency_Hz**2 / mean_square
    largest = 2.0 * max(map(abs, excess))
    return 1.0 + max(-largest, min(largest, predicted))


def _apart(drive: Drive, point: TestPoint) -> float:
    """How different two motions are: the servo answers to frequency first, then to speed, then to force."""
    motion = abs(math.log(drive.frequency_Hz / point.frequency_Hz)) + 0.3 * abs(
        math.log(drive.amplitude_m / point.amplitude_m)
    )
    return motion + 0.01 * abs(drive.current_A - point.current_A)
