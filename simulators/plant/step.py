"""One slice of the plant: motion, damper in its mounting, coil, heat, the controller's limits; one compiled loop.

The loop is compiled once for all damper models and calls the model's step by its address (`model_step`).
Numba does not notice when a function that a cached one calls has changed, so only the whole loop is cached, and it is
built in a closure over the sources' fingerprint: another fingerprint, another cache entry.
"""

from __future__ import annotations

import inspect
import math
import sys
import zlib
from functools import cache

from rig.dampers.compiled_cache import njit
from rig.dampers.kernel import Compiled, cached
from simulators.plant import model_step, motion, records
from simulators.plant.model_step import advance_at
from simulators.plant.motion import Record, move_rod, note
from simulators.plant.records import (
    BIT_FOLLOWING,
    BIT_FORCE,
    BIT_POSITION,
    BIT_SPEED,
    EVENT_TRIP,
    MODE_HALT,
    MODE_HOLD,
    MODE_LOCKED,
    MODE_MOVE,
    MODE_OFF,
    MODE_PROGRAM,
)

COLUMNS = 11
"""Columns of the output: displacement (m) and velocity (m/s) where the LVDT sits, load-cell force (N), current (A),
coil temperature (degC), mode; piston position (m), the damper's own force (N) and its displacement about its mid-stroke
(m), accumulator pressure (Pa), body temperature (degC).
"""
DISPLACEMENT, VELOCITY, FORCE, CURRENT, COIL_TEMPERATURE, MODE = range(6)
PISTON, DAMPER_FORCE, DAMPER_DISPLACEMENT, ACCUMULATOR, BODY_TEMPERATURE = range(6, COLUMNS)

SPEED_MARGIN_M_S = 0.02
_MOUNT_ITERATIONS = 40


def _fittings_force(p: Record, u: float, v: float) -> float:
    """Force beside the model's: gas preload, seal friction, and the specimen's bump stops (N)."""
    force: float = p.gas_force_N + p.seal_friction_N * math.tanh(v / p.seal_speed_m_s)
    beyond = abs(u) - p.half_specimen_stroke_m
    if beyond > 0.0:
        force += math.copysign(p.bump_stiffness_N_m * beyond, u)
    return force


fittings_force = njit(cache=False)(_fittings_force)


def _mount_force(p: Record, stretch_m: float) -> float:
    """Force (N) through mounting and load train for their stretch: nothing inside the free play, then two springs."""
    gap = 0.5 * p.free_play_m
    if abs(stretch_m) <= gap:
        return 0.0
    compliance = 1.0 / p.mount_stiffness_N_m if p.mount_stiffness_N_m > 0.0 else 0.0
    if p.load_train_stiffness_N_m > 0.0:
        compliance += 1.0 / p.load_train_stiffness_N_m
    force: float = (stretch_m - math.copysign(gap, stretch_m)) / compliance
    return force


mount_force = njit(cache=False)(_mount_force)


def _rigid_force(p: Record, s: Record, advance: int, dp: Record, ds: Record) -> float:
    """Force (N) of a damper bolted to the rod without play; `advance` is its step's address."""
    s.damper_u_m = s.position_m - p.mid_stroke_m
    s.damper_v_m_s = s.velocity_m_s
    force = advance_at(advance, dp, ds, s.damper_u_m, s.damper_v_m_s, s.acceleration_m_s2, s.fluid_A, p.dt_s)
    total: float = p.force_scale * force + fittings_force(p, s.damper_u_m, s.damper_v_m_s)
    return total


rigid_force = njit(cache=False)(_rigid_force)


def _mounted_force(p: Record, s: Record, advance: int, dp: Record, ds: Record, scratch: Record) -> float:
    """Force (N) of a damper behind a spring with free play; `advance` is its step's address.

    By bisection on the damper's speed: the damper's force rises with its speed and the spring's falls, so the balance
    is bracketed; internal states are copied for each trial and kept for the last.
    """
    rod_u = s.position_m - p.mid_stroke_m
    reach = 2.0 + 10.0 * abs(s.velocity_m_s)
    low, high = s.damper_v_m_s - reach, s.damper_v_m_s + reach
    u, v, force = s.damper_u_m, s.damper_v_m_s, 0.0
    for _ in range(_MOUNT_ITERATIONS):
        v = 0.5 * (low + high)
        u = s.damper_u_m + 0.5 * (s.damper_v_m_s + v) * p.dt_s
        for place in range(ds.size):
            scratch[place] = ds[place]
        a = (v - s.damper_v_m_s) / p.dt_s
        force = p.force_scale * advance_at(advance, dp, scratch, u, v, a, s.fluid_A, p.dt_s)
        force += fittings_force(p, u, v)
        if force > mount_force(p, rod_u - u):
            high = v
        else:
            low = v
    for place in range(ds.size):
        ds[place] = scratch[place]
    s.damper_u_m = u
    s.damper_v_m_s = v
    return mount_force(p, rod_u - u)


mounted_force = njit(cache=False)(_mounted_force)


def _specimen_end(p: Record, s: Record) -> None:
    """Where the specimen's end is: behind the load train, which the force stretches."""
    before_m = s.specimen_m
    s.specimen_m = s.position_m
    s.specimen_m_s = s.velocity_m_s
    if p.load_train_stiffness_N_m > 0.0:
        s.specimen_m -= s.cell_force_N / p.load_train_stiffness_N_m
        s.specimen_m_s = (s.specimen_m - before_m) / p.dt_s


specimen_end = njit(cache=False)(_specimen_end)


def _coil_and_heat(p: Record, c: Record, s: Record) -> None:
    """Coil lag `I' = -eta (I - Icmd)`, exact over the step (9); `F v` heats the body, `I^2 R` the coil.

    The force follows the coil's current with a lag of the fluid of its own, where it has one: `fluid_A` is the current
    that the damper model gets.
    """
    ohm = p.coil_ohm * (1.0 + p.coil_ohm_per_K * (s.coil_degC - 20.0))
    largest = p.coil_voltage_V / ohm
    target_A = max(-largest, min(largest, c.coil_A))
    s.current_A = target_A + (s.current_A - target_A) * math.exp(-p.coil_eta_1_s * p.dt_s)
    before_A, s.fluid_A = s.fluid_A, s.current_A
    if p.fluid_lag_s > 0.0:
        s.fluid_A += (before_A - s.current_A) * math.exp(-p.dt_s / p.fluid_lag_s)
    power_W = s.damper_force_N * s.damper_v_m_s
    s.dissipated_J += power_W * p.dt_s
    passed_W = p.coil_to_body_W_K * (s.coil_degC - s.temperature_degC)
    lost_W = p.heat_loss_W_K * (s.temperature_degC - p.ambient_degC)
    s.coil_degC += (s.current_A * s.current_A * ohm - passed_W) * p.dt_s / p.coil_heat_capacity_J_K
    s.temperature_degC += (power_W + passed_W - lost_W) * p.dt_s / p.heat_capacity_J_K


coil_and_heat = njit(cache=False)(_coil_and_heat)


def _crossed_limit(c: Record, s: Record) -> int:
    """Bit number of the first limit that is crossed, -1 for none."""
    outwards_below = s.position_m < c.position_min_m and s.velocity_m_s < 0.0
    if outwards_below or (s.position_m > c.position_max_m and s.velocity_m_s > 0.0):
        return BIT_POSITION
    if abs(s.velocity_m_s) > 1.1 * c.speed_max_m_s + SPEED_MARGIN_M_S:
        return BIT_SPEED
    if abs(s.cell_force_N) > c.force_max_N:
        return BIT_FORCE
    moving = c.mode == MODE_PROGRAM or c.mode == MODE_MOVE
    if moving and abs(s.setpoint_m - s.position_m) > c.following_error_max_m:
        return BIT_FOLLOWING
    return -1


crossed_limit = njit(cache=False)(_crossed_limit)


def _guard(c: Record, s: Record, end_s: float, events: Record, count: int) -> int:
    """Latch a crossed limit once and halt."""
    if s.tripped != 0 or c.mode == MODE_OFF:
        return count
    bit = crossed_limit(c, s)
    if bit < 0:
        return count
    s.tripped = 1
    s.fault_bits |= 1 << bit
    if c.mode not in (MODE_HOLD, MODE_LOCKED):
        c.mode = MODE_HALT
    return note(events, count, end_s, EVENT_TRIP, bit)


guard = njit(cache=False)(_guard)


def _sources() -> int:
    """CRC-32 over every source the compiled loop is made of; a model's step is compiled separately."""
    crc = 0
    for module in (records, motion, model_step, sys.modules[__name__]):
        crc = zlib.crc32(inspect.getsource(module).encode(), crc)
    return crc


@cache
def plant_loop() -> Compiled:
    """The plant's loop, compiled.

    `(steps, constants, command, state, advance, damper, damper_state, scratch, table, out, events) -> number of
    events`. `advance` is `address_of` the damper's model. Arrays: records of `records` (length 1), `damper` parameters
    in the model's order, `out` (steps, `COLUMNS`), `events` (capacity, 3) of time (s), kind, value.
    """
    return cached(_loop(_sources()), error_model="numpy")


def _loop(key: int) -> Compiled:
    def run(
        steps: int,
        constants: Record,
        command: Record,
        state: Record,
        advance: int,
        damper: Record,
        damper_state: Record,
        scratch: Record,
        table: Record,
        out: Record,
        events: Record,
    ) -> int:
        p, c, s = constants[0], command[0], state[0]
        count = 0 * key
        for i in range(steps):
            s.step += 1
            end_s = s.step * p.dt_s
            count = move_rod(p, c, s, table, end_s, events, count)
            if p.mount_stiffness_N_m > 0.0 or p.load_train_stiffness_N_m > 0.0:
                s.damper_force_N = mounted_force(p, s, advance, damper, damper_state, scratch)
            else:
                s.damper_force_N = rigid_force(p, s, advance, damper, damper_state)
            s.cell_force_N = s.damper_force_N + p.moving_mass_kg * s.acceleration_m_s2
            specimen_end(p, s)
            coil_and_heat(p, c, s)
            count = guard(c, s, end_s, events, count)
            out[i, DISPLACEMENT] = s.specimen_m
            out[i, VELOCITY] = s.specimen_m_s
            out[i, FORCE] = s.cell_force_N
            out[i, CURRENT] = s.current_A
            out[i, COIL_TEMPERATURE] = s.coil_degC
            out[i, MODE] = c.mode + 16 * s.tripped
            out[i, PISTON] = s.position_m
            out[i, DAMPER_FORCE] = s.damper_force_N
            out[i, DAMPER_DISPLACEMENT] = s.damper_u_m
            out[i, ACCUMULATOR] = s.accumulator_Pa
            out[i, BODY_TEMPERATURE] = s.temperature_degC
        return count

    return run
