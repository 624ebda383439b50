"""Set-points of moves and motion programs, for an actuator that follows set-points but has no function generator.

A driver asks for the set-point of the moment (`at`) each time it speaks to its device, and sends position and velocity.
Whether the device can reach it from where it is now is checked afterwards (`drivers.setpoint_guard`).
Pure: time is given, nothing is sent.

    HOLD --move--> MOVING --> HOLD      RUNNING --fade--> FADING --> HOLD      any motion --halt--> HALTING --> HOLD
         --start-> RUNNING -> HOLD      MOVING ---fade--> HALTING -> HOLD      after a gap --halt_from--> HALTING
         --compute> RUNNING -> HOLD     a computed motion is not faded, it is halted
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol, runtime_checkable

from drivers.roles import Move, Program, ProgramPhase, State, Waveform
from protocols.errors import LocalProtocolError


class Setpoint(NamedTuple):
    """Where the rod is to be (m) and how fast it is to go there (m/s)."""

    position_m: float
    velocity_m_s: float


class RodLimits(NamedTuple):
    """What no set-point may exceed: position (m), speed (m/s) and acceleration (m/s^2) of the bench."""

    position_min_m: float = -math.inf
    position_max_m: float = math.inf
    speed_m_s: float = math.inf
    acceleration_m_s2: float = math.inf


UNLIMITED = RodLimits()
HALT_MARGIN_M = 1e-3
"""A halt ends so far before the end of travel: the rod overshoots its set-point, and its position has an error."""


class ComputedMotion(Protocol):
    """A motion that is not known in advance: it is computed as it goes.

    Attributes:
        fastest_m_s: largest planned speed; a motion that has to catch up does not exceed it.
    """

    fastest_m_s: float

    def at(self, elapsed_s: float) -> Setpoint | None:
        """The set-point at this time after the start (s, never falling); None after the end: the rod holds."""


@runtime_checkable
class KnownMotion(ComputedMotion, Protocol):
    """A computed motion whose future is known."""

    def position_m(self, elapsed_s: float) -> float:
        """Position (m) at any time after the start; nothing is recorded."""


class SetpointGenerator:
    """Makes one motion after the other; every motion ends by itself, in HOLD.

    Args:
        position_m: where the rod is, m.
        acceleration_m_s2: of moves.
        halt_deceleration_m_s2: of a halt with enough travel; near the end of travel it is as much larger as needed.
        fade_out_cycles: cycles over which a program fades out, >= 1; no faster than the program itself.
        limits: of the bench.

    Attributes:
        state: what it makes: HOLD, MOVING, RUNNING, FADING or HALTING.
        phase: where in its envelope the program is.
        cycles_done: whole cycles of the running or last program, ramps included.
    """

    def __init__(
        self, position_m: float, *, acceleration_m_s2: float = 2.0, halt_deceleration_m_s2: float = 20.0,
        fade_out_cycles: float = 1.0, limits: RodLimits = UNLIMITED,
    ) -> None:
        self.state = State.HOLD
        self.phase = ProgramPhase.IDLE
        self.cycles_done = 0
        self.acceleration_m_s2 = acceleration_m_s2
        self.halt_deceleration_m_s2 = halt_deceleration_m_s2
        self.fade_out_cycles = fade_out_cycles
        self.limits = limits
        self._halt_rate = halt_deceleration_m_s2
        self._last = Setpoint(position_m, 0.0)
        self._begin_s = 0.0
        self._from = self._last
        self._move = Move(position_m, 0.0)
        self._program = Program(Waveform.SINE, 0.0, 1.0)
        self._computed: ComputedMotion | None = None
        self._foreseen: KnownMotion | None = None
        self._fade_cycle, self._fade_share = 0.0, 0.0

    @property
    def last(self) -> Setpoint:
        """The set-point that was made last."""
        return self._last

    @property
    def fastest_m_s(self) -> float:
        """Largest planned speed of the motion (m/s); infinite where it is not known."""
        if self.state is State.MOVING:
            return self._move.speed_m_s
        if self.state in {State.RUNNING, State.FADING}:
            if self._computed is not None:
                return self._computed.fastest_m_s
            turn = 2.0 * math.pi if self._program.waveform is Waveform.SINE else 4.0
            return turn * self._program.frequency_Hz * abs(self._program.amplitude_m)
        return math.inf

    def rest(self, position_m: float) -> None:
        """Hold at a position (m), whatever was under way: the rod is at rest there, or has no pressure."""
        self.state, self.phase = State.HOLD, ProgramPhase.IDLE
        self._last = Setpoint(position_m, 0.0)

    def move(self, order: Move, now_s: float) -> None:
        """Begin a move.

        Raises:
            LocalProtocolError: something moves, or the order is not valid; nothing begins.
        """
        if self.state is not State.HOLD:
            raise LocalProtocolError(f"MOVE_TO while {self.state.name}")
        if not (math.isfinite(order.target_m) and order.speed_m_s > 0.0 and math.isfinite(order.speed_m_s)):
            raise LocalProtocolError(f"MOVE_TO {order.target_m} m at {order.speed_m_s} m/s is not valid")
        self._begin_s, self._from, self._move = now_s, self._last, order
        self.state = State.MOVING

    def start(self, program: Program, now_s: float) -> None:
        """Begin a program, from its centre.

        Raises:
            LocalProtocolError: something moves, or the program is none of these; nothing begins.
        """
        if self.state is not State.HOLD:
            raise LocalProtocolError(f"START while {self.state.name}")
        numbers = (program.amplitude_m, program.frequency_Hz, program.centre_m, program.all_cycles)
        if program.waveform is Waveform.TABLE or not all(map(math.isfinite, numbers)) or program.frequency_Hz <= 0.0:
            raise LocalProtocolError(f"{program.waveform.name} at {program.frequency_Hz} Hz is not supported here")
        self._begin_s, self._program, self._computed, self.cycles_done = now_s, program, None, 0
        self.state = State.RUNNING

    def compute(self, motion: ComputedMotion, now_s: float) -> None:
        """Begin a motion that is computed as it goes; it counts as one cycle.

        Raises:
            LocalProtocolError: something moves; nothing begins.
        """
        if self.state is not State.HOLD:
            raise LocalProtocolError(f"START while {self.state.name}")
        self._begin_s, self._computed, self.cycles_done = now_s, motion, 0
        self._foreseen = motion if isinstance(motion, KnownMotion) else None
        self.state, self.phase = State.RUNNING, ProgramPhase.FULL_AMPLITUDE

    def fade(self, now_s: float) -> None:
        """Fade the running program out, or bring a move or a computed motion to rest: what follows it is not known."""
        if self.state is State.RUNNING and self._computed is not None:
            self.halt(now_s)
        elif self.state is State.RUNNING:
            self._fade_cycle = (now_s - self._begin_s) * self._program.frequency_Hz
            self._fade_share = self._envelope(self._fade_cycle)[0]
            self.state = State.FADING
        elif self.state is State.MOVING:
            self.halt(now_s)

    def halt(self, now_s: float) -> None:
        """Bring whatever moves to rest, from the set-point of this moment."""
        begin = self.at(now_s)
        if self.state not in {State.HOLD, State.HALTING}:
            self.halt_from(begin, now_s)

    def halt_from(self, begin: Setpoint, now_s: float) -> None:
        """Bring the rod to rest from this position and speed, whatever it was to do.

        The deceleration is `halt_deceleration_m_s2`, more where the travel left requires it, and at most the
        acceleration limit.
        """
        self._from, self._begin_s, self._last = begin, now_s, begin
        self.state, self._computed = State.HALTING, None
        self._halt_rate = halting_rate(begin, self.halt_deceleration_m_s2, self.limits)

    def at(self, now_s: float) -> Setpoint:
        """The set-point of this moment; `now_s` never falls back."""
        elapsed_s = now_s - self._begin_s
        if self.state is State.RUNNING and self._computed is not None:
            self._last = self._computing(self._computed, elapsed_s)
        elif self.state is not State.HOLD:
            if self.state in {State.RUNNING, State.FADING}:
                self._follow_cycles(elapsed_s)
            self._last, ended = self._known(elapsed_s)
            if ended:
                self.state = State.HOLD
        if self.state is State.HOLD:
            self._last = Setpoint(self._last.position_m, 0.0)
            self.phase = ProgramPhase.IDLE
        return self._last

    def ahead(self, now_s: float) -> float | None:
        """Position (m) at a later moment, as far as it is known now; None where it is not."""
        elapsed_s = now_s - self._begin_s
        if self.state is State.HOLD:
            return self._last.position_m
        if self.state is State.RUNNING and self._computed is not None:
            return None if self._foreseen is None else self._foreseen.position_m(elapsed_s)
        return self._known(elapsed_s)[0].position_m

    def _known(self, elapsed_s: float) -> tuple[Setpoint, bool]:
        """Set-point of a motion that is known in advance, and whether it has ended; changes nothing."""
        if self.state is State.MOVING:
            return self._moving(elapsed_s)
        return self._halting(elapsed_s) if self.state is State.HALTING else self._cycling(elapsed_s)

    def _moving(self, elapsed_s: float) -> tuple[Setpoint, bool]:
        """A trapezoid of speed, or a triangle where the distance is short."""
        start_m, rate = self._from.position_m, self.acceleration_m_s2
        way_m = self._move.target_m - start_m
        sign, length_m = math.copysign(1.0, way_m), abs(way_m)
        top_m_s = min(self._move.speed_m_s, math.sqrt(rate * length_m))
        rise_s = top_m_s / rate
        cruise_s = length_m / top_m_s - rise_s if top_m_s > 0.0 else 0.0
        if elapsed_s >= 2.0 * rise_s + cruise_s:
            return Setpoint(self._move.target_m, 0.0), True
        if elapsed_s < rise_s:
            gone_m, speed_m_s = 0.5 * rate * elapsed_s**2, rate * elapsed_s
        elif elapsed_s < rise_s + cruise_s:
            gone_m, speed_m_s = top_m_s * (elapsed_s - 0.5 * rise_s), top_m_s
        else:
            left_s = 2.0 * rise_s + cruise_s - elapsed_s
            gone_m, speed_m_s = length_m - 0.5 * rate * left_s**2, rate * left_s
        return Setpoint(start_m + sign * gone_m, sign * speed_m_s), False

    def _computing(self, motion: ComputedMotion, elapsed_s: float) -> Setpoint:
        setpoint = motion.at(elapsed_s)
        if setpoint is not None:
            return setpoint
        self.state, self.cycles_done, self._computed = State.HOLD, 1, None
        return self._last

    def _follow_cycles(self, elapsed_s: float) -> None:
        """Phase and cycles of a program at this time."""
        program = self._program
        if self.state is State.FADING:
            self.phase = ProgramPhase.RAMP_OUT
            return
        cycles = elapsed_s * program.frequency_Hz
        self.phase = self._envelope(cycles)[2]
        self.cycles_done = math.floor(min(cycles, program.all_cycles) + 1e-9)

    def _cycling(self, elapsed_s: float) -> tuple[Setpoint, bool]:
        """The program under its envelope, or its fade."""
        program = self._program
        cycles, pace = elapsed_s * program.frequency_Hz, 1.0
        if self.state is State.FADING:
            gone = cycles - self._fade_cycle
            ended = gone >= self.fade_out_cycles
            share, slope = faded(gone, self.fade_out_cycles)
            share, slope = self._fade_share * share, self._fade_share * slope
            pace = fade_pace(program.waveform, self.fade_out_cycles)
            cycles = self._fade_cycle + pace * gone
        else:
            share, slope, _ = self._envelope(cycles)
            ended = cycles >= program.all_cycles
        if ended:
            return Setpoint(program.centre_m, 0.0), True
        value, change = _shape(program.waveform, cycles)
        amplitude_m = program.amplitude_m
        velocity_m_s = amplitude_m * program.frequency_Hz * (share * pace * change + slope * value)
        return Setpoint(program.centre_m + amplitude_m * share * value, velocity_m_s), False

    def _envelope(self, cycles: float) -> tuple[float, float, ProgramPhase]:
        """Share of full amplitude at so many cycles, its change a cycle, and the phase."""
        program = self._program
        left = program.all_cycles - cycles
        if cycles < program.ramp_in_cycles:
            return cycles / program.ramp_in_cycles, 1.0 / program.ramp_in_cycles, ProgramPhase.RAMP_IN
        if left < program.ramp_out_cycles:
            return max(0.0, left / program.ramp_out_cycles), -1.0 / program.ramp_out_cycles, ProgramPhase.RAMP_OUT
        return 1.0, 0.0, ProgramPhase.FULL_AMPLITUDE

    def _halting(self, elapsed_s: float) -> tuple[Setpoint, bool]:
        begin, rate = self._from, self._halt_rate
        stop_s = abs(begin.velocity_m_s) / rate
        sign = math.copysign(1.0, begin.velocity_m_s)
        if elapsed_s >= stop_s:
            return Setpoint(begin.position_m + 0.5 * sign * rate * stop_s**2, 0.0), True
        gone_m = begin.velocity_m_s * elapsed_s - 0.5 * sign * rate * elapsed_s**2
        return Setpoint(begin.position_m + gone_m, begin.velocity_m_s - sign * rate * elapsed_s), False


def faded(cycles: float, fade_out_cycles: float) -> tuple[float, float]:
    """Share of the amplitude that is left so many cycles after the begin of a fade, and its change a cycle.

    A raised cosine: no step of speed at either end. A sine never goes faster under it than without; its acceleration is
    at most 1 + 1 / (8 n^2) of its own for a fade over n cycles.
    """
    angle = math.pi * min(1.0, cycles / fade_out_cycles)
    return 0.5 * (1.0 + math.cos(angle)), -0.5 * math.pi / fade_out_cycles * math.sin(angle)


def fade_pace(waveform: Waveform, fade_out_cycles: float) -> float:
    """Share of its frequency at which a waveform goes on while it fades.

    A triangle on its way to the centre has its largest speed already, and loses amplitude beside that. Over n cycles
    its speed is at most 2 p + sqrt(4 p^2 + (pi / 2 n)^2) of unit amplitude, where a corner comes a quarter of the fade
    after its begin; that is the 4 of a triangle for p = 1 - (pi / 8 n)^2.
    """
    return 1.0 if waveform is Waveform.SINE else 1.0 - (math.pi / (8.0 * fade_out_cycles)) ** 2


def halting_rate(begin: Setpoint, usual_m_s2: float, limits: RodLimits) -> float:
    """Deceleration (m/s^2) of a halt: the usual one, or as much more as the travel left requires.

    Args:
        begin: where the rod is and how fast.
        usual_m_s2: where there is travel enough.
        limits: of the bench; its acceleration is the most.
    """
    speed_m_s, outwards = begin.velocity_m_s, begin.velocity_m_s > 0.0
    end_m = limits.position_max_m if outwards else limits.position_min_m
    left_m = (end_m - begin.position_m) if outwards else (begin.position_m - end_m)
    most = max(usual_m_s2, limits.acceleration_m_s2)
    if left_m <= HALT_MARGIN_M:
        return most if math.isfinite(most) else usual_m_s2
    return min(most, max(usual_m_s2, 0.5 * speed_m_s**2 / (left_m - HALT_MARGIN_M)))


def _shape(waveform: Waveform, cycles: float) -> tuple[float, float]:
    """Value of the waveform of amplitude 1 at a phase in cycles, and its change a cycle."""
    fraction = cycles % 1.0
    if waveform is Waveform.SINE:
        angle = 2.0 * math.pi * fraction
        return math.sin(angle), 2.0 * math.pi * math.cos(angle)
    if fraction < 0.25:
        return 4.0 * fraction, 4.0
    if fraction < 0.75:
        return 2.0 - 4.0 * fraction, -4.0
    return 4.0 * fraction - 4.0, 4.0
