"""Where the rod goes: the controller's set-point generator and the servo-hydraulic loop, compiled one step at a time.

Set-point (PHYSICS section 1): sine `A sin(2 pi f t)`, the exact triangle or a table, under an envelope that rises
linearly in phase over the ramp-in cycles and falls over the ramp-out cycles. Servo (section 11):
`x'' = g wn^2 (r - F/k - x) - 2 zeta wn x'`, integrated by the trapezoidal rule: the valve's gain
`g = sqrt((P - |pL|)/Ps)` falls with the accumulator's pressure P and the load `pL = F/area`, and force pushes the rod
against the loop's stiffness k. Its speed is limited to `rated g`, its acceleration to the controller's limit.

Nothing here is cached by itself: the cached loop of `step.py` contains it.
"""

from __future__ import annotations

import math
from typing import Any

from rig.dampers.compiled_cache import njit
from simulators.plant.records import (
    EVENT_FULL_AMPLITUDE,
    EVENT_PULSE,
    MODE_FADE,
    MODE_FOLLOW,
    MODE_HALT,
    MODE_HOLD,
    MODE_LOCKED,
    MODE_MOVE,
    MODE_OFF,
    MODE_PROGRAM,
    MODE_STOP,
    SINE,
    TRIANGLE,
)

SMALLEST_M_S = 1e-15
"""Slower than this is standstill: subnormal numbers would cost the loop ten times its speed."""

REST_M_S = 2e-4
"""In HOLD a slower rod stays where it is within the valve's overlap."""

Record = Any
"""A numpy record of `records`, seen by the compiler; Python's type checker has no name for its fields."""


def _shape(waveform: int, phase: float, table: Record) -> float:
    """The waveform at `phase` cycles: unit amplitude for sine and triangle, metres for a table."""
    fraction = phase - math.floor(phase)
    if waveform == SINE:
        return math.sin(2.0 * math.pi * fraction)
    if waveform == TRIANGLE:
        if fraction < 0.25:
            return 4.0 * fraction
        if fraction < 0.75:
            return 2.0 - 4.0 * fraction
        return 4.0 * fraction - 4.0
    place = fraction * len(table)
    index = int(place)
    value: float = table[index % len(table)]
    following: float = table[(index + 1) % len(table)]
    return value + (place - index) * (following - value)


shape = njit(cache=False)(_shape)


def _envelope(phase: float, ramp_in: float, full: float, ramp_out: float) -> float:
    """Share of full amplitude at `phase` cycles of a program."""
    if phase < ramp_in:
        return phase / ramp_in
    total = ramp_in + full + ramp_out
    if phase > ramp_in + full and ramp_out > 0.0:
        return max(0.0, (total - phase) / ramp_out)
    return 1.0


envelope = njit(cache=False)(_envelope)


def _note(events: Record, count: int, time_s: float, kind: int, value: float) -> int:
    """Append an event; a full table loses the event rather than the step."""
    if count < len(events):
        events[count, 0] = time_s
        events[count, 1] = kind
        events[count, 2] = value
        return count + 1
    return count


note = njit(cache=False)(_note)


def _pulse(s: Record, events: Record, count: int, time_s: float) -> int:
    """The controller's digital output fires once."""
    s.pulses += 1
    s.last_pulse_s = time_s
    return note(events, count, time_s, EVENT_PULSE, s.pulses)


pulse = njit(cache=False)(_pulse)


def _advance_phase(p: Record, c: Record, s: Record, end_s: float, last: float, events: Record, count: int) -> int:
    """Move the phase on by one step and fire a pulse, at its exact instant, for each cycle that begins."""
    if s.program_step == 0:
        count = pulse(s, events, count, end_s - p.dt_s)
    s.program_step += 1
    before = s.phase_cycles
    s.phase_cycles = s.program_step * p.dt_s * c.frequency_Hz
    crossed = math.floor(s.phase_cycles)
    while crossed > math.floor(before) and crossed < last:
        before = math.floor(before) + 1.0
        s.cycles_done = int(before)
        count = pulse(s, events, count, end_s - (s.phase_cycles - before) / c.frequency_Hz)
    return count


advance_phase = njit(cache=False)(_advance_phase)


def _program_setpoint(p: Record, c: Record, s: Record, table: Record, end_s: float, events: Record, count: int) -> int:
    """Set-point of the running program or of its fade-out; ends in HOLD at the centre."""
    total = c.ramp_in_cycles + c.full_cycles + c.ramp_out_cycles
    was = s.phase_cycles
    count = advance_phase(p, c, s, end_s, total if c.mode == MODE_PROGRAM else math.inf, events, count)
    phase = s.phase_cycles
    if c.mode == MODE_PROGRAM:
        if (was < c.ramp_in_cycles or s.program_step == 1) and phase >= c.ramp_in_cycles:
            count = note(events, count, end_s, EVENT_FULL_AMPLITUDE, s.cycles_done)
        share = envelope(phase, c.ramp_in_cycles, c.full_cycles, c.ramp_out_cycles)
        if phase >= total - 1e-9:
            s.cycles_done = math.floor(total + 1e-9)
            count = pulse(s, events, count, end_s - (phase - total) / c.frequency_Hz)
            share = 0.0
            c.mode = MODE_HOLD
    else:
        share = s.fade_envelope * (1.0 - (phase - s.fade_from_cycles) / c.fade_cycles)
        if share <= 0.0:
            share = 0.0
            c.mode = MODE_HOLD
    scale = c.amplitude_m if c.waveform in (SINE, TRIANGLE) else 1.0
    setpoint = c.centre_m + (share * scale * shape(c.waveform, phase, table) if share > 0.0 else 0.0)
    s.setpoint_velocity_m_s = (setpoint - s.setpoint_m) / p.dt_s if c.mode != MODE_HOLD else 0.0
    s.setpoint_m = setpoint
    return count


program_setpoint = njit(cache=False)(_program_setpoint)


def _move_setpoint(p: Record, c: Record, s: Record) -> None:
    """Trapezoidal move to the target, or its stop within the halt deceleration."""
    if c.mode == MODE_STOP:
        target, rate = 0.0, c.halt_deceleration_m_s2
    else:
        rate = c.move_acceleration_m_s2
        left = c.target_m - s.setpoint_m
        target = math.copysign(min(c.move_speed_m_s, math.sqrt(2.0 * rate * abs(left))), left)
    change = max(-rate * p.dt_s, min(rate * p.dt_s, target - s.setpoint_velocity_m_s))
    s.setpoint_velocity_m_s += change
    s.setpoint_m += s.setpoint_velocity_m_s * p.dt_s
    slow = abs(s.setpoint_velocity_m_s) <= 2.0 * rate * p.dt_s
    if c.mode == MODE_STOP and slow:
        s.setpoint_velocity_m_s = 0.0
        c.mode = MODE_HOLD
    elif c.mode == MODE_MOVE and slow and abs(c.target_m - s.setpoint_m) <= 2.0 * rate * p.dt_s * p.dt_s + 1e-7:
        s.setpoint_velocity_m_s = 0.0
        s.setpoint_m = c.target_m
        c.mode = MODE_HOLD


move_setpoint = njit(cache=False)(_move_setpoint)


def _followed_setpoint(c: Record, s: Record, end_s: float) -> None:
    """The last set-point that has come by this step, continued at its speed.

    A set-point comes between two slices of the plant; until that instant the one before it counts.
    """
    from_m, speed_m_s, from_s, longest_s = c.target_m, c.move_speed_m_s, c.told_s, c.follow_s
    if end_s < c.told_s:
        from_m, speed_m_s, from_s, longest_s = c.before_m, c.before_m_s, c.before_s, c.before_follow_s
    age_s = end_s - from_s
    s.setpoint_m = from_m + speed_m_s * min(age_s, longest_s)
    s.setpoint_velocity_m_s = speed_m_s if age_s < longest_s else 0.0


followed_setpoint = njit(cache=False)(_followed_setpoint)


def _pushed(p: Record, s: Record) -> float:
    """How far force and friction push the rod away from its set-point (m)."""
    if p.servo_stiffness_N_m <= 0.0:
        return 0.0
    friction_N = p.actuator_friction_N * math.tanh(s.velocity_m_s / p.actuator_friction_speed_m_s)
    away: float = (s.cell_force_N + friction_N) / p.servo_stiffness_N_m
    return away


pushed = njit(cache=False)(_pushed)


def _closed_loop(p: Record, c: Record, s: Record, before_m: float, valve_gain: float) -> float:
    """Velocity at the end of the step under position control (m/s)."""
    h, wn, zeta = p.dt_s, p.servo_rad_s, p.servo_damping
    speed_limit_m_s = p.rated_speed_m_s * valve_gain
    mean = (0.5 * (before_m + s.setpoint_m) - p.position_zero_m) / p.position_gain - pushed(p, s)
    if c.mode == MODE_HOLD and abs(s.velocity_m_s) < REST_M_S and abs(mean - s.position_m) < p.overlap_m:
        s.saturated = 0
        return 0.0
    stiff = wn * wn * valve_gain
    reach = h * h * stiff / 4.0
    v = s.velocity_m_s * (1.0 - h * zeta * wn - reach) + h * stiff * (mean - s.position_m)
    v /= 1.0 + h * zeta * wn + reach
    largest = c.acceleration_max_m_s2 * h
    v = max(s.velocity_m_s - largest, min(s.velocity_m_s + largest, v))
    s.saturated = 1 if abs(v) > speed_limit_m_s else 0
    if abs(v) < SMALLEST_M_S:
        return 0.0
    limited: float = max(-speed_limit_m_s, min(speed_limit_m_s, v))
    return limited


closed_loop = njit(cache=False)(_closed_loop)


def _open_loop(p: Record, c: Record, s: Record) -> float:
    """Velocity at the end of the step with the position loop open: halt ramp, locked, or off and drifting (m/s)."""
    s.saturated = 0
    if c.mode == MODE_HALT:
        slower = abs(s.velocity_m_s) - c.halt_deceleration_m_s2 * p.dt_s
        if slower > 0.0:
            return math.copysign(slower, s.velocity_m_s)
        c.mode = MODE_LOCKED
    if c.mode == MODE_LOCKED:
        return 0.0
    drift = p.drift_m_s * s.accumulator_Pa / p.supply_Pa
    drifting: float = drift + (s.velocity_m_s - drift) * math.exp(-p.dt_s / p.valve_closing_s)
    return drifting


open_loop = njit(cache=False)(_open_loop)


def _move_rod(p: Record, c: Record, s: Record, table: Record, end_s: float, events: Record, count: int) -> int:
    """One step of set-point, servo and accumulator; returns the number of events so far."""
    before_m = s.setpoint_m
    if c.mode in (MODE_PROGRAM, MODE_FADE):
        count = program_setpoint(p, c, s, table, end_s, events, count)
    elif c.mode in (MODE_MOVE, MODE_STOP):
        move_setpoint(p, c, s)
    elif c.mode == MODE_FOLLOW:
        followed_setpoint(c, s, end_s)
    if c.mode in (MODE_OFF, MODE_HALT, MODE_LOCKED):
        v = open_loop(p, c, s)
    else:
        load_Pa = abs(s.cell_force_N) / p.piston_area_m2
        valve_gain = math.sqrt(max(0.0, (s.accumulator_Pa - load_Pa) / p.supply_Pa))
        v = closed_loop(p, c, s, before_m, valve_gain)
    s.acceleration_m_s2 = (v - s.velocity_m_s) / p.dt_s
    s.position_m += 0.5 * (s.velocity_m_s + v) * p.dt_s
    s.velocity_m_s = v
    if abs(s.position_m) > p.half_stroke_m:
        s.position_m = math.copysign(p.half_stroke_m, s.position_m)
        s.velocity_m_s = 0.0
    if c.mode in (MODE_OFF, MODE_HALT, MODE_LOCKED):
        s.setpoint_m = p.position_gain * s.position_m + p.position_zero_m
        s.setpoint_velocity_m_s = 0.0
    fed = p.supply_Pa if c.pressure == 2 else p.low_pressure_Pa if c.pressure == 1 else 0.0
    settle_s = p.accumulator_bleed_s if c.pressure == 0 else p.accumulator_recovery_s
    drawn_Pa = p.accumulator_sag_Pa_m3 * p.piston_area_m2 * abs(s.velocity_m_s) * p.dt_s
    s.accumulator_Pa = max(0.0, s.accumulator_Pa + (fed - s.accumulator_Pa) * p.dt_s / settle_s - drawn_Pa)
    return count


move_rod = njit(cache=False)(_move_rod)
