"""Start of motions: reading a start request, refusing it, informing the supervisor.

A motion of cycles starts here; motions that the station computes set-point by set-point (`signal_source`,
`hybrid_source`) share `read_order`, `refuse_beyond` and `begin`. Any motion is refused from which a halt could not come
to rest within the travel (`rig.signals.stopping`), as in the plan.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from drivers.roles import Command, Program, Waveform, state_name
from drivers.setpoint_generator import ComputedMotion
from rig.bench.settings import Limits, StationConfig
from rig.signals.stopping import CYCLE_STEPS, Cycles, Reach, reach
from rig.station.command_channel import CommandChannel
from rig.station.errors import StationRefused
from rig.station.interlocks.motion_interlock import SPEED_WINDOW_S
from rig.station.interlocks.setpoint_interlock import unfollowable
from rig.station.safe_stop import Movement
from rig.station.supervisor import Supervisor
from rig.station.threads.devices import Devices

TABLE_TIMEOUT_S = 60.0
LARGEST_AMPLITUDE_M = 10.0
MOST_RAMP_CYCLES = 1e3
ROUNDING = 1e-6
"""Share of a limit that a request's own arithmetic may add."""
Arguments = Mapping[str, object]
Answer = dict[str, object]
Order = TypeVar("Order")


class Extent(NamedTuple):
    """One quantity of a motion: what it is, its unit, how much of it there is, and how much is allowed."""

    what: str
    unit: str
    value: float
    limit: float


def number(arguments: Arguments, name: str, low: float, high: float) -> float:
    """A request's argument.

    Args:
        arguments: of the request.
        name: of the argument, with its unit.
        low: allowed at the least.
        high: allowed at the most.

    Raises:
        StationRefused: it is no number, or not within.
    """
    value = arguments.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
        raise StationRefused("bad-request", f"{name}: expected a number from {low:g} to {high:g}, got {value!r}")
    return float(value)


def read_order(given: object, what: str, from_json: Callable[[Mapping[str, Any]], Order]) -> Order:
    """The order of a start request.

    Args:
        given: what the request says.
        what: it should be, in words.
        from_json: reads it; raises KeyError, TypeError or ValueError.

    Raises:
        StationRefused: it is none.
    """
    if not isinstance(given, dict):
        raise StationRefused("bad-request", f"start: expected {what}, got a value that is not a table")
    try:
        return from_json(given)
    except (KeyError, TypeError, ValueError) as error:
        raise StationRefused("bad-request", f"start: expected {what}: {error!r}") from error


def refuse_beyond(extents: Sequence[Extent], what: str, rounding: float) -> None:
    """Nothing where every quantity is within its limit.

    Args:
        extents: of the motion; NaN is beyond every limit.
        what: is judged, in words.
        rounding: share of a limit that rounding may add.

    Raises:
        StationRefused: with each that is not.
    """
    wide = [
        f"{extent.what} {extent.value:.6g} {extent.unit}, allowed {extent.limit:g} {extent.unit}"
        for extent in extents
        if not extent.value <= extent.limit * (1.0 + rounding)
    ]
    if wide:
        raise StationRefused("matrix-infeasible", f"start: the machine's limits do not allow {what}: {'; '.join(wide)}")


def travel_extents(reached: Reach, limits: Limits) -> tuple[Extent, Extent]:
    """Both ends of what a motion and its halts reach (m, rig's coordinate), against the position limits."""
    return (
        Extent("travel above zero (including halts)", "m", reached.high_m, limits.position_max_m),
        Extent("travel below zero (including halts)", "m", -reached.low_m, -limits.position_min_m),
    )


def begin(
    source: ComputedMotion, duration_s: float, devices: Devices, supervisor: Supervisor, commands: CommandChannel
) -> Answer:
    """Begin a motion; the answer is that of any motion's start.

    Args:
        source: of its set-points.
        duration_s: of the motion.
        devices: of the rig.
        supervisor: is told how long the motion's halt takes.
        commands: to the actuator.

    Raises:
        StationRefused: the actuator does not begin it.
        DriverError: the actuator cannot be reached.
    """
    config = devices.config
    halted_s = config.limits.speed_m_s / config.actuator.halt_deceleration_m_s2
    supervisor.movement = Movement(halted_s + SPEED_WINDOW_S)
    devices.actuator.interlock.expect_program(duration_s, 1.0)
    status = commands.compute(source)
    return {"program_id": status.program_id, "state": state_name(status.state)}


def start_cycles(
    arguments: Arguments, devices: Devices, supervisor: Supervisor, commands: CommandChannel
) -> Answer:
    """Begin a motion of cycles.

    Args:
        arguments: of the start request.
        devices: of the rig.
        supervisor: is told how long the motion's fade-out takes.
        commands: to the actuator.

    Raises:
        StationRefused: it is no motion, is beyond the machine's limits, or the actuator does not begin it.
        DriverError: the actuator cannot be reached.
    """
    actuator, config = devices.actuator, devices.config
    program = _program(arguments, devices)
    problems = unfollowable(program, config.limits, config.actuator.poll_s * config.device_rate)
    if problems and not actuator.capabilities.generator:
        raise StationRefused("matrix-infeasible", f"start: {'; '.join(problems)}")
    period_s = 1.0 / program.frequency_Hz
    supervisor.movement = Movement(config.actuator.fade_out_cycles * period_s, period_s)
    actuator.interlock.expect_program(program.all_cycles * period_s, program.all_cycles)
    status = commands.command(Command.START, program)
    return {"program_id": status.program_id, "state": state_name(status.state)}


def _program(arguments: Arguments, devices: Devices) -> Program:
    """The motion of a start request; a table waveform is loaded.

    Raises:
        StationRefused: it is none, goes beyond the stroke, or is none that the actuator plays.
        DriverError: the actuator cannot be reached.
    """
    name = str(arguments.get("waveform")).upper()
    if name not in Waveform.__members__:
        raise StationRefused("bad-request", f"start: unknown waveform {arguments.get('waveform')!r}")
    waveform, limits = Waveform[name], devices.config.limits
    if waveform is Waveform.TRIANGLE and not devices.actuator.capabilities.triangle:
        raise StationRefused("matrix-infeasible", "start: this actuator generates only sine waveforms")
    if waveform is Waveform.SINE and not devices.actuator.capabilities.sine:
        raise StationRefused("matrix-infeasible", "start: this actuator generates only triangle waveforms")
    amplitude_m = number(arguments, "amplitude_m", 0.0, LARGEST_AMPLITUDE_M)
    frequency_Hz = number(arguments, "frequency_Hz", 1e-3, 1e3)
    centre_m = number(arguments, "centre_m", limits.position_min_m, limits.position_max_m)
    table_m = _table(arguments, devices) if waveform is Waveform.TABLE else []
    program = Program(
        waveform, amplitude_m, frequency_Hz, centre_m,
        cycles=number(arguments, "cycles", 0.0, 1e6),
        ramp_in_cycles=number(arguments, "ramp_in_cycles", 0.0, MOST_RAMP_CYCLES),
        ramp_out_cycles=number(arguments, "ramp_out_cycles", 0.0, MOST_RAMP_CYCLES),
        table_length=len(table_m),
    )  # fmt: skip
    refuse_without_travel(program, table_m, devices.config)
    if table_m:
        devices.actuator.call(lambda driver: driver.write_table(table_m), TABLE_TIMEOUT_S)
    return program


def refuse_without_travel(program: Program, table_m: Sequence[float], config: StationConfig) -> None:
    """Nothing where the motion, and a halt at any instant of it, stays within the position limits.

    Args:
        program: the motion.
        table_m: of a table waveform, its values about the centre (m); else empty.
        config: limits, halt deceleration and length of a fade-out.

    Raises:
        StationRefused: it does not.
    """
    cycles = Cycles(
        _unit_cycle(program.waveform, table_m), 1.0 if table_m else program.amplitude_m, program.frequency_Hz,
        program.ramp_in_cycles, program.ramp_out_cycles, program.cycles, config.actuator.fade_out_cycles,
    )  # fmt: skip
    reached, centre_m = reach(cycles.path(), config.actuator.halt_deceleration_m_s2), program.centre_m
    whole = Reach(centre_m + reached.low_m, centre_m + reached.high_m)
    refuse_beyond(travel_extents(whole, config.limits), "the motion", ROUNDING)


def _unit_cycle(waveform: Waveform, table_m: Sequence[float]) -> list[tuple[float, float]]:
    """One cycle of unit amplitude: value, and its change a cycle; of a table its own values (m)."""
    phases = [step / CYCLE_STEPS for step in range(CYCLE_STEPS)]
    if waveform is Waveform.SINE:
        return [(math.sin(math.tau * phase), math.tau * math.cos(math.tau * phase)) for phase in phases]
    if waveform is Waveform.TRIANGLE:
        table_m = [1.0 - abs(4.0 * ((phase + 0.25) % 1.0) - 2.0) for phase in phases]
    after = [*table_m[1:], table_m[0]]
    return [(value, (next_m - value) * len(table_m)) for value, next_m in zip(table_m, after, strict=True)]


def _table(arguments: Arguments, devices: Devices) -> list[float]:
    """The values of a table waveform (m about the centre).

    Raises:
        StationRefused: the actuator plays none, or the values are none.
    """
    if not devices.actuator.capabilities.table:
        raise StationRefused("matrix-infeasible", "start: this actuator does not support table waveforms")
    table = arguments.get("table")
    if not isinstance(table, list) or len(table) < 2:
        raise StationRefused("bad-request", "start: a waveform of type table requires `table`, a list of at least 2 "
            "values (m)")
    return [float(value) for value in table]
