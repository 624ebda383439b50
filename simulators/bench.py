"""The bench file of the simulated rig: where its devices are and what they are, in the format of the user's own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.connection import ActuatorAddress, LinkKind
from drivers.devices.supply_file import supply
from protocols.binary_format import BinaryFormat
from rig.files.described import described as read_description
from rig.files.names import is_file
from simulators.conditioner import group_delay_s
from simulators.emulated_ecu import DEMO_ECU, EmulatedEcuFiles
from simulators.options import SI_UNITS, ControllerOptions, RigOptions, SensorOptions
from simulators.toml_text import toml_text

BY_HAND = "generic-scpi"
"""The supply that is adjusted in place of the operator who sets the current."""
SUPPLY_POLL_MS, FASTEST_POLL_MS = 100.0, 4.0
BITRATE = 500_000
"""Bit rate of the CAN bus (bit/s)."""
STATUS_S = 0.010
"""Usual period of an ECU's status, and of the commands to it."""
STALE_STATUSES = 3
COMMANDS_IN_TIME = 4
"""So many commands fit into the time after which an ECU gives up."""
STALE_SAMPLES = 5
STALE_S = 0.020
RELAXED_STALE_S = 0.600
"""Longer than `simulators.pace.LONGEST_WAIT_S`, for which the rig's clock may stand still."""
WAITING_STALE_S = 0.400
"""Where the host's time stands still with the rig's clock: twice as long as an answer is waited for."""
RELAXED_SETPOINT_S = 0.100


@dataclass(frozen=True)
class Addresses:
    """Where the sockets and ports of a running rig are."""

    actuator_url: str
    slcan_port: int
    load_cell_url: str
    lvdt_url: str
    auxiliary_urls: Sequence[str]
    supply_url: str = ""

    @property
    def slcan_url(self) -> str:
        """Where the CAN bus is."""
        return f"socket://127.0.0.1:{self.slcan_port}"

    @property
    def listed(self) -> tuple[str, ...]:
        """All of them, as the bench file has them."""
        supply = (self.supply_url,) if self.supply_url else ()
        return (self.actuator_url, self.slcan_url, self.load_cell_url, self.lvdt_url, *self.auxiliary_urls, *supply)


def bench_text(
    options: RigOptions, addresses: Addresses, speed: float, relaxed: bool, ecu: Sequence[str] = (),
    actuator: Sequence[str] = ('register_map = "demo"',), clock: Path | None = None,
) -> str:
    """The bench file as TOML text.

    Args:
        options: the rig's constants.
        addresses: its open ports.
        speed: rate of its device clocks against the wall.
        relaxed: time limits are widened against those of hardware; less, where the clock of a rig at speed 1 waits.
        ecu: lines of the current source's table; none: of the demo ECU.
        actuator: entries of [actuator] that say what the controller is.
        clock: file of the rig's clock, where it waits for the host.
    """
    limits, controller = options.limits, options.controller
    rtu = ActuatorAddress.parse(addresses.actuator_url).kind is LinkKind.MODBUS_RTU
    waits = waits_for_host(speed, clock)
    stale_s = least_stale_s(relaxed, waits)
    lines = [
        "format = 1",
        'name = "simulated rig"',
        "[limits]",
        f'position = ["{-1e3 * limits.position_m:g} mm", "{1e3 * limits.position_m:g} mm"]',
        f'speed = "{limits.speed_m_s:g} m/s"',
        f'acceleration = "{limits.acceleration_m_s2:g} m/s^2"',
        f'force = "{limits.force_N:g} N"',
        f'current = "{limits.current_A:g} A"',
        f'coil_temperature = "{limits.coil_temperature_degC:g} degC"',
        "[actuator]",
        f'url = "{addresses.actuator_url}"',
        f"device_id = {controller.device_id}",
        *actuator,
        f'poll = "{poll_ms(controller, rtu, speed):g} ms"',
        f'timeout = "{1e3 * actuator_timeout_s(rtu, relaxed, waits):g} ms"',
        f'stale_after = "{1000 if relaxed else 300 if rtu else 150} ms"',
        f'watchdog = "{1000 if relaxed and not waits else 500} ms"',
        f"fade_out_cycles = {controller.fade_out_cycles:.3f}",
        f'halt_deceleration = "{controller.halt_deceleration_m_s2:g} m/s^2"',
        *([] if controller.generator or not relaxed else [f'setpoint_late = "{1e3 * RELAXED_SETPOINT_S:g} ms"']),
        *_input_delay(options),
        *(ecu or ecu_lines(addresses, stale_s)),
    ]
    lines += _sensor("load_cell", options.load_cell, addresses.load_cell_url, stale_s)
    lines += _sensor("lvdt", options.lvdt, addresses.lvdt_url, stale_s)
    for number, url in enumerate(addresses.auxiliary_urls, start=1):
        lines += ["[[auxiliary]]", f'name = "auxiliary_{number}"', f'unit = "{SI_UNITS[options.auxiliary.unit]}"']
        lines += _sensor("auxiliary", options.auxiliary, url, stale_s)[1:]
    lines += [
        "[fixture]",
        f'moving_mass = "{options.moving_mass_kg:g} kg"',
        "[clock]",
        f"device_rate = {speed:.6g}" if speed != int(speed) else f"device_rate = {int(speed)}.0",
        *([] if clock is None else [f"shared = {toml_text(str(clock))}"]),
        "[station]",
        f'heartbeat_timeout = "{4000 if relaxed else 500} ms"',
        f'late_limit = "{500 if relaxed else 50} ms"',
        f"real_time = {'false' if relaxed else 'true'}",
        *(["[display]"] if options.display else []),
        *(f"{name} = {toml_text(value)}" for name, value in options.display.items()),
    ]
    return "\n".join(lines) + "\n"


def waits_for_host(speed: float, clock: Path | None) -> bool:
    """Whether all time limits apply to a clock that waits for the host (file `clock`), at speed 1 at most.

    Above speed 1, a millisecond that it does not wait is many of the rig's.
    """
    return clock is not None and speed <= 1.0


def least_stale_s(relaxed: bool, waits: bool) -> float:
    """Shortest time without data (s) after which host and ECU give each other, and sensors, up; 0: the hardware's."""
    return (WAITING_STALE_S if waits else RELAXED_STALE_S) if relaxed else 0.0


def ecu_lines(
    addresses: Addresses, stale_s: float, serial_number: int | None = None, emulated: EmulatedEcuFiles = DEMO_ECU
) -> list[str]:
    """Lines of the table of an ECU on CAN; how patient both sides are is the ECU's own, `stale_s` (s) at least."""
    described, entries = emulated.load().described, emulated.entries(serial_number)
    status_s, timeout_s = described.timing.status_s, described.command_timeout_s
    stale_s = max(stale_s, STALE_STATUSES * STATUS_S, STALE_STATUSES * status_s)
    command_s = min(STATUS_S, (timeout_s or math.inf) / COMMANDS_IN_TIME)
    return [
        "[ecu]",
        'interface = "slcan"',
        f'channel = "{addresses.slcan_url}"',
        f"bitrate = {BITRATE}",
        *entries,
        f'command_period = "{1e3 * command_s:g} ms"',
        f'stale_after = "{1e3 * stale_s:g} ms"',
    ]


def supply_lines(
    options: RigOptions, url: str, speed: float, given: str | Mapping[str, Any], by_hand: str = ""
) -> list[str]:
    """Lines of a supply's table; on a rig faster than life it is asked more often, as the ECU sends more often.

    Where the current is set by hand (`by_hand`: the pressure meanwhile) the supply is adjusted in the operator's place.
    """
    if by_hand:
        return ["[ecu]", "by_hand = true", f'pressure_while_asked = "{by_hand}"', f'rehearsal = "{url}"']
    described = supply(read_description("supply", given))
    name = str(Path(given).absolute()) if isinstance(given, str) and is_file(given) else given
    poll_ms = max(FASTEST_POLL_MS, SUPPLY_POLL_MS / max(1.0, speed))
    lines = [
        "[ecu]", f'url = "{url}"', f"supply = {toml_text(name)}", f'poll = "{poll_ms:g} ms"',
        'timeout = "500 ms"', f'stale_after = "{RELAXED_STALE_S * 1e3:g} ms"',
    ]
    if described.commands.set_voltage_limit:
        low_V, high_V = described.voltage_V or (0.0, options.coil.supply_V)
        lines.append(f'voltage_limit = "{max(low_V, min(high_V, options.coil.supply_V)):g} V"')
    return lines


def _input_delay(options: RigOptions) -> list[str]:
    """What the controller's data sheet says: its filters' group delay, where both inputs have the same filter."""
    position, force = (group_delay_s(given.bandwidth_Hz) for given in (options.position_input, options.force_input))
    return [f'input_delay = "{1e3 * position:.4f} ms"'] if position == force else []


def poll_ms(controller: ControllerOptions, rtu: bool, speed: float) -> float:
    """Period of the host's polls (wall ms): shorter on a fast rig, whose motion is seen at few instants otherwise."""
    if controller.poll_s > 0.0:
        return 1e3 * controller.poll_s
    if rtu:
        return 20
    return 10 if speed <= 1.0 else 4


def actuator_timeout_s(rtu: bool, relaxed: bool, waits: bool) -> float:
    """How long the host waits for one answer of the controller (wall s): twice fits into the watchdog's time."""
    if relaxed:
        return 0.2 if waits else 0.4
    return 0.06 if rtu else 0.04


def _range(options: SensorOptions) -> str:
    """The range in the sensor's usual unit."""
    if options.described:
        return f"{options.range / options.wire_per_si:.6g} {SI_UNITS[options.unit]}"
    return f"{options.range:g} {options.unit}"


def _link_lines(options: SensorOptions, url: str) -> list[str]:
    if isinstance(options.format, BinaryFormat) and options.format.can is not None:
        return ['interface = "slcan"', f'channel = "{url}"', f"bitrate = {BITRATE}"]
    return [f'url = "{url}"', f"baudrate = {options.baudrate}"]


def _sensor(table: str, options: SensorOptions, url: str, stale_s: float) -> list[str]:
    """Lines of one sensor's table; it is stale after `stale_s` (s) at least."""
    stale_s = max(stale_s, STALE_SAMPLES / options.rate_Hz, STALE_S)
    return [
        f"[{table}]",
        *_link_lines(options, url),
        f"format = {toml_text(options.described or options.format)}",
        f'rate = "{options.rate_Hz:g} Hz"',
        f'range = "{_range(options)}"',
        f'stale_after = "{1e3 * stale_s:g} ms"',
        f'delay = "{1e3 * group_delay_s(options.bandwidth_Hz):.4f} ms"',
        f"[{table}.calibration]",
        f"sensitivity = {1.0 / options.wire_per_si!r}",
        f'offset = "{options.wire_zero / options.wire_per_si:.9g} {SI_UNITS[options.unit]}"',
        f'serial_number = "{options.serial_number}"',
        'certificate = "SIM"',
        "due = 2030-01-01",
    ]
