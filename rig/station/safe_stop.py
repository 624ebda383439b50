"""The safe stop as a pure step machine: `advance(stop, inputs) -> (stop, actions)`; no clock, no I/O.

Order: (1) at once and independently: coil current to 0 A and the controller's fade-out (its halt ramp on a hard limit
or when the position is not trusted); (2) prove standstill, by the LVDT and the controller, or by the one of them that
still says something; (3) hold where it stopped; (4) for S1 hydraulics low, then off; (5) prove the current. A step that
misses its deadline escalates: S2 -> S1 -> hydraulics off at once. What cannot be proved ends in UNKNOWN, never in SAFE.
What is stale, stands still by itself or is not known is no proof: a device that says nothing proves nothing.

Deadlines are wall time, except the fade-out and standstill, which the controller's and the sensor's clocks measure: the
fade may take its cycles on the device clock plus `STOP_MARGIN_S` of wall time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Protocol

from rig.faults.row import StopKind

STOP_MARGIN_S = 0.2
HALT_LIMIT_S = 0.3
CURRENT_LIMIT_S = 0.25
HYDRAULICS_LIMIT_S = 1.0
LOST_LIMIT_S = 2.0
ZERO_CURRENT_A = 0.05
STILL_S = 0.1
REPEAT_S = 0.1
POSITION_FAULTS = frozenset({"actuator-frozen", "feedback-lost"})
"""After these what the controller says of the rod is no proof by itself."""
LONGEST_FADE_S = 10.0
"""Device time: a motion whose fade-out would last longer is slow enough for the halt ramp."""
LONGEST_FALL_S = 5.0
"""A source that is not heard and goes to 0 A by itself later than that may still drive its current."""


class StopPhase(Enum):
    """Where a stop is."""

    STOPPING = auto()
    LOWERING = auto()
    OFF = auto()
    SAFE = auto()
    UNKNOWN = auto()


class StopAction(Enum):
    """What the supervisor does on the machine's behalf."""

    ZERO_CURRENT = auto()
    FADE = auto()
    HALT = auto()
    HYDRAULICS_LOW = auto()
    HYDRAULICS_OFF = auto()
    STOP_IGNORED = auto()
    CURRENT_STUCK = auto()


@dataclass(frozen=True)
class Movement:
    """What a stop has to expect of the motion that was last commanded (device seconds)."""

    fade_s: float = 0.0
    period_s: float = 0.0


@dataclass(frozen=True)
class StopInputs:
    """What is known at one moment; None where the value is stale.

    Attributes:
        now_ns: host time.
        still_s: seconds of device time for which the LVDT has shown standstill; None while it says nothing of the rod.
        controller_moving: the controller says it moves (its state and speed); None without a fresh status.
        controller_clock_s: the controller's unwrapped clock; None without a fresh status.
        hydraulics_low: pressure is low or off; None without a fresh status.
        hydraulics_off: hydraulics are off; None without a fresh status.
        current_A: measured coil current; None without a fresh ECU status.
        stop_taken: the controller has acknowledged the stop command; False while none gets through.
        period_s: device seconds of one cycle of the program that ran (0: none), for standstill without the controller.
        lvdt_changed: the LVDT's value has changed since the stop began, and still does now and then.
        left_place: LVDT or controller shows the rod away from where its standstill was proved.
    """

    now_ns: int
    still_s: float | None
    controller_moving: bool | None
    controller_clock_s: float | None
    hydraulics_low: bool | None
    hydraulics_off: bool | None
    current_A: float | None
    period_s: float = 0.0
    stop_taken: bool = True
    lvdt_changed: bool = False
    left_place: bool = False


@dataclass(frozen=True)
class SafeStop:
    """A stop under way.

    Attributes:
        kind: S2, SO or S1.
        halt: the halt ramp is used, not the fade-out.
        fade_s: device seconds the fade-out may take.
        device_rate: device clock against the wall.
        watchdog_s: wall seconds after which the controller stops by itself when no command reaches it.
        started_ns: host time of the trip.
        step_ns: host time at which the present step began.
        clock_start_s: the controller's clock at the first fresh status after the trip; None until seen.
        repeated_ns: host time of the last (re)sent stop command.
        standstill: proved.
        current_zero: True proved, False not (yet).
        current_checked: the current's deadline has been judged.
        current_left_A: the current last measured behind its deadline (A); None: none was measured, or it went to 0 A.
        current_s: that deadline (s).
        current_due_ns: host time from which it counts: the trip, or when a current that was gone came back.
        current_falls_s: after so long without commands the source is at 0 A by itself (s); None: it keeps its current.
        position_trusted: nothing speaks against what the controller says of the rod.
    """

    kind: StopKind
    halt: bool
    fade_s: float
    device_rate: float
    started_ns: int
    step: StopPhase = StopPhase.STOPPING
    step_ns: int = 0
    clock_start_s: float | None = None
    repeated_ns: int = 0
    standstill: bool = False
    current_zero: bool = False
    current_checked: bool = False
    current_left_A: float | None = None
    watchdog_s: float = 0.0
    current_s: float = CURRENT_LIMIT_S
    current_falls_s: float | None = 0.0
    current_due_ns: int = 0
    position_trusted: bool = True

    @property
    def finished(self) -> bool:
        """Nothing is left to do: safe, or known to be unknown."""
        return self.step in {StopPhase.SAFE, StopPhase.UNKNOWN}


def begin(
    kind: StopKind, now_ns: int, *, halt: bool, fade_s: float, device_rate: float, watchdog_s: float = 0.0
) -> tuple[SafeStop, tuple[StopAction, ...]]:
    """Start a stop; its actions are to be carried out at once and independently of each other."""
    halt = halt or kind is StopKind.HALT or fade_s > LONGEST_FADE_S
    stop = SafeStop(
        kind, halt, fade_s, device_rate, now_ns, step_ns=now_ns, repeated_ns=now_ns, watchdog_s=watchdog_s,
        current_due_ns=now_ns,
    )
    return stop, (StopAction.ZERO_CURRENT, stop_command(stop))


class Source(Protocol):
    """What a stop has to know of the coil's current source."""

    @property
    def zero_within_s(self) -> float:
        """After so long a commanded 0 A must be measured (wall s)."""

    @property
    def falls_within_s(self) -> float | None:
        """After so long without commands it is at 0 A (wall s); None: it keeps its current."""


def of_source(stop: SafeStop, source: Source | None) -> SafeStop:
    """The stop with the time and the fall of this current source."""
    if source is None:
        return stop
    falls_s = source.falls_within_s
    in_time = falls_s is not None and falls_s <= LONGEST_FALL_S
    return replace(stop, current_s=source.zero_within_s, current_falls_s=falls_s if in_time else None)


def after_fault(stop: SafeStop, slug: str) -> SafeStop:
    """The stop, with what this fault says of its witnesses: it may be the first or a later one.

    The same stop where it says nothing: another one is a stop taken up again.
    """
    return replace(stop, position_trusted=False) if stop.position_trusted and slug in POSITION_FAULTS else stop


def stop_command(stop: SafeStop) -> StopAction:
    """The controller command that stops this one's motion."""
    return StopAction.HALT if stop.halt else StopAction.FADE


def escalate(
    stop: SafeStop, kind: StopKind, now_ns: int, *, halt: bool = False
) -> tuple[SafeStop, tuple[StopAction, ...]]:
    """Turn a stop under way into a stronger one; a weaker kind changes nothing.

    A stop that has already ended is taken up again where the stronger kind goes further: it is commanded and proved
    anew, for what was proved then need not be so now.
    """
    halt = halt or kind is StopKind.HALT
    if stop.finished:
        if kind.severity <= stop.kind.severity:
            return stop, ()
        again, actions_again = begin(
            kind, now_ns, halt=halt or stop.halt, fade_s=stop.fade_s, device_rate=stop.device_rate,
            watchdog_s=stop.watchdog_s,
        )
        again = replace(
            again, current_s=stop.current_s, current_falls_s=stop.current_falls_s,
            position_trusted=stop.position_trusted,
        )
        return again, actions_again
    actions: list[StopAction] = []
    if halt and not stop.halt and not stop.standstill:
        stop = replace(stop, halt=True)
        actions.append(StopAction.HALT)
        if stop.step is StopPhase.STOPPING:
            # A pressure that is being taken away goes on going: its deadline is not given again.
            stop = replace(stop, step_ns=now_ns, clock_start_s=None)
    if kind.severity > stop.kind.severity:
        stop = replace(stop, kind=kind)
    return stop, tuple(actions)


def broken(stop: SafeStop, inputs: StopInputs) -> bool:
    """The rod moves under full pressure although its standstill was proved.

    Either LVDT or controller shows that it has left its place, or every one of them that shows the rod says that it
    moves. One alone that says so may be mistaken: a reconnected controller's standstill has to be seen anew.
    """
    if stop.step is not StopPhase.SAFE or inputs.hydraulics_low is True:
        return False
    seen = inputs.controller_moving is not None or inputs.still_s is not None
    resting = inputs.controller_moving is False or (inputs.still_s is not None and inputs.still_s >= STILL_S)
    # Without pressure the rod is held by nothing; a pressure that is not seen is the one that the stop has proved.
    held = inputs.hydraulics_low is False or stop.kind is not StopKind.PRESSURE_OFF
    return (held and inputs.left_place) or (seen and not resting)


def advance(stop: SafeStop, inputs: StopInputs) -> tuple[SafeStop, tuple[StopAction, ...]]:
    """One step: judge what is proved and what is late.

    Returns:
        The stop as it now stands and what to do; call again on every tick until `finished`.
    """
    if stop.finished:
        return stop, ()
    stop, actions = _check_current(stop, inputs)
    if actions:
        # A current that stays asks for a stronger stop; nothing is concluded before that is under way.
        return stop, actions
    if stop.step is StopPhase.STOPPING:
        stop, more = _stopping(stop, inputs)
    else:
        stop, more = _hydraulics(stop, inputs)
    return stop, (*actions, *more)


def _elapsed_s(since_ns: int, inputs: StopInputs) -> float:
    return (inputs.now_ns - since_ns) / 1e9


def _check_current(stop: SafeStop, inputs: StopInputs) -> tuple[SafeStop, tuple[StopAction, ...]]:
    if inputs.current_A is not None and abs(inputs.current_A) < ZERO_CURRENT_A:
        return replace(stop, current_zero=True, current_checked=True, current_left_A=None), ()
    if stop.current_zero and inputs.current_A is not None:
        # It has come back, or one sample was noise: it is given the time that a current is given at first.
        stop = replace(stop, current_checked=False, current_due_ns=inputs.now_ns)
    stop = replace(stop, current_zero=False)
    silent_s = 0.0 if inputs.current_A is not None else stop.current_falls_s or 0.0
    allowed_s = max(stop.current_s, silent_s) / min(1.0, stop.device_rate)
    if _elapsed_s(stop.current_due_ns, inputs) <= allowed_s:
        return stop, ()
    first = stop.current_left_A is None
    stop = replace(stop, current_checked=True)
    if inputs.current_A is None:
        return stop, ()
    stop = replace(stop, current_left_A=inputs.current_A)
    return (stop, (StopAction.CURRENT_STUCK,)) if first else (stop, ())


def _standstill(stop: SafeStop, inputs: StopInputs) -> bool:
    """Standstill is proved: by the LVDT and a controller that agrees, or by the only one of them that is left.

    Alone, or beside a controller that is not trusted with its position, the LVDT has to show that it lives: one that
    repeats its value would prove the standstill of any rod, also where it did so at rest.
    """
    if inputs.still_s is None:
        return stop.position_trusted and inputs.controller_moving is False
    if inputs.controller_moving is None:
        return inputs.lvdt_changed and inputs.still_s >= max(STILL_S, inputs.period_s)
    seen = stop.position_trusted or inputs.lvdt_changed
    return seen and inputs.still_s >= STILL_S and not inputs.controller_moving


def _shows(inputs: StopInputs) -> bool:
    """The LVDT shows where the rod goes; what stands, and does not change now and then, may be stuck."""
    return inputs.still_s is not None and (inputs.lvdt_changed or inputs.still_s < STILL_S)


def _late(stop: SafeStop, inputs: StopInputs) -> bool:
    """The motion outlasts its deadline, measured on the controller's clock while there is one."""
    allowed_s = HALT_LIMIT_S if stop.halt else stop.fade_s + STOP_MARGIN_S
    # A rod that may stand is given the period that is the proof behind a trip; one that is seen to move is late.
    may_stand = inputs.still_s is None or inputs.still_s >= STILL_S
    margin_s = max(STILL_S, inputs.period_s if may_stand else 0.0) + STOP_MARGIN_S * max(0.0, stop.device_rate - 1.0)
    wall_s = _elapsed_s(stop.step_ns, inputs)
    if inputs.controller_clock_s is None or stop.clock_start_s is None:
        return wall_s > (allowed_s + max(STILL_S, inputs.period_s)) / stop.device_rate + LOST_LIMIT_S
    return wall_s > STOP_MARGIN_S and inputs.controller_clock_s - stop.clock_start_s > allowed_s + margin_s


def _stopping(stop: SafeStop, inputs: StopInputs) -> tuple[SafeStop, tuple[StopAction, ...]]:
    # A controller that no command reaches begins to fade out when its watchdog trips.
    begun = inputs.stop_taken or _elapsed_s(stop.step_ns, inputs) > stop.watchdog_s
    if begun and stop.clock_start_s is None and inputs.controller_clock_s is not None:
        stop = replace(stop, clock_start_s=inputs.controller_clock_s)
    stop = replace(stop, standstill=_standstill(stop, inputs))
    if stop.standstill:
        if stop.kind is StopKind.PRESSURE_OFF:
            return replace(stop, step=StopPhase.LOWERING, step_ns=inputs.now_ns), (StopAction.HYDRAULICS_LOW,)
        return _conclude(stop, inputs)
    if _late(stop, inputs):
        if inputs.controller_moving is None and not _shows(inputs):
            return replace(stop, step=StopPhase.UNKNOWN), (StopAction.HYDRAULICS_OFF,)
        stop = replace(stop, kind=StopKind.PRESSURE_OFF, step=StopPhase.OFF, step_ns=inputs.now_ns)
        return stop, (StopAction.STOP_IGNORED, StopAction.HYDRAULICS_OFF)
    if _elapsed_s(stop.repeated_ns, inputs) > REPEAT_S and inputs.controller_moving is None:
        return replace(stop, repeated_ns=inputs.now_ns), (stop_command(stop),)
    return stop, ()


def _hydraulics(stop: SafeStop, inputs: StopInputs) -> tuple[SafeStop, tuple[StopAction, ...]]:
    late = _elapsed_s(stop.step_ns, inputs) > HYDRAULICS_LIMIT_S
    if stop.step is StopPhase.LOWERING:
        if inputs.hydraulics_low or late:
            return replace(stop, step=StopPhase.OFF, step_ns=inputs.now_ns), (StopAction.HYDRAULICS_OFF,)
        return stop, ()
    if inputs.hydraulics_off:
        if stop.standstill or _standstill(stop, inputs):
            return _conclude(replace(stop, standstill=True), inputs)
        if _elapsed_s(stop.step_ns, inputs) > HYDRAULICS_LIMIT_S + LOST_LIMIT_S:
            return replace(stop, step=StopPhase.UNKNOWN), ()
        return stop, ()
    if late:
        return replace(stop, step=StopPhase.UNKNOWN), (StopAction.HYDRAULICS_OFF,)
    return stop, ()


def _conclude(stop: SafeStop, inputs: StopInputs) -> tuple[SafeStop, tuple[StopAction, ...]]:
    """Motion is over: safe once the current is proved, or its deadline has passed and been judged.

    The state is unknown if the last measurement shows a current, or if the source is silent and has no time-out after
    which it goes to 0 A.
    """
    if not (stop.current_zero or stop.current_checked):
        return stop, ()
    silent = inputs.current_A is None and stop.current_falls_s is None
    flows = stop.current_left_A is not None or silent
    step = StopPhase.UNKNOWN if flows and not stop.current_zero else StopPhase.SAFE
    return replace(stop, step=step, step_ns=inputs.now_ns), ()
