"""A user's bench in a world: the simulated rig is made as the file says, and the file gets the world's addresses.

What the file says stays as it is written, but for the addresses. Where the simulated rig cannot be what the file says,
the file is refused by name; where a wire becomes another one, that is told.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drivers import plugins
from drivers.connection import ActuatorAddress, LinkKind, modbus_line
from drivers.register_maps.map_file import controller_names
from drivers.sensor_formats import FRAME16, described_format
from protocols.errors import LocalProtocolError
from protocols.sensor_format import SensorFormat
from protocols.sensor_presets import TABLES
from rig.bench import named_files
from rig.bench.model import Bench
from rig.bench.sensor_settings import SensorConfig
from rig.bench.settings import ActuatorConfig
from rig.errors import FileProblem
from rig.files.names import is_dbc, is_file
from rig.matrix.assumed_damper import is_fit_file
from rig.matrix.model import Matrix
from rig.matrix.sections import Specimen
from simulators.bench import BY_HAND, Addresses
from simulators.conditioner import group_delay_s
from simulators.emulated_bench import appearing_as
from simulators.emulated_ecu import DEMO_ECU, EmulatedEcuFiles
from simulators.emulated_format import writer
from simulators.options import (
    AUXILIARY,
    LVDT,
    ControllerOptions,
    DamperOptions,
    HIGHEST_RATE_Hz,
    InputOptions,
    RigOptions,
    SensorOptions,
    ServoOptions,
)
from simulators.output_module import DEVICE_ID
from simulators.rig import LATE_SHARE, SimulatedRig
from simulators.toml_text import toml_text

DEMO = "demo"
LINKS = {LinkKind.MODBUS_TCP: "tcp", LinkKind.MODBUS_RTU: "rtu"}
NO_FILTER_HZ = 50_000.0
BURST_SHARE = 0.3
"""A line holds back for so much of the time after which its sensor counts as dead, at most."""
HAND_OVER_SHARE = 0.4
"""The devices hand over so often, as a share of the shortest such time ..."""
FINEST_S = 0.002
"""... but no more often than real adapters."""
BEYOND = 1.15
"""The machine reaches so much further than the limits."""
SHORTER_M = 0.020
"""A specimen's stroke as it is stated is shorter by so much than what it has."""
BITRATE = 500_000
LARGEST_BENCH = 1 << 20


@dataclass(frozen=True)
class UserBench:
    """The simulated rig for a user's bench.

    Attributes:
        options: what the rig is made of; `auxiliaries` of its further channels.
        actuator: "tcp" or "rtu".
        substitutes: what of the file a world has otherwise, in words.
        tick_s: how often the devices may hand over at most (s).
        supply: what drives the coil in place of an ECU; empty: an ECU does.
        streamed: the controller has no function generator and follows set-points.
        unmeasured: the coil's current is not measured.
    """

    options: RigOptions
    actuator: str
    emulated_ecu: EmulatedEcuFiles
    auxiliaries: tuple[SensorOptions, ...]
    substitutes: tuple[str, ...]
    tick_s: float
    timeout_s: float
    values: Mapping[str, Any]
    supply: str | Mapping[str, Any] = ""
    streamed: bool = False
    unmeasured: bool = False

    @property
    def supply_line(self) -> str:
        """Connection of an analogue output, which sensors may share."""
        return modbus_line(str(self.values["ecu"].get("url", "")))

    @property
    def by_hand(self) -> bool:
        """The current is set by hand."""
        return bool(self.values["ecu"].get("by_hand"))

    @classmethod
    def load(cls, path: Path, matrix: Matrix) -> UserBench:
        """The simulated rig for a bench file and a matrix's specimen.

        Raises:
            FileProblem: it is no bench file, or no simulated rig can stand in for it: all reasons.
        """
        bench = Bench.load(path)
        problems = list(_unlike(bench))
        if problems:
            raise FileProblem(str(path), problems)
        link = LINKS[ActuatorAddress.parse(bench.actuator.url).kind]
        values = named_files.with_paths(tomllib.loads(path.read_text(encoding="utf-8-sig")), path.absolute().parent)
        quickest_s = min(bench.ecu.silent_after_s, *map(_patience_s, _sensors(bench).values()))
        return cls(
            _options(bench, matrix), link, _emulated_ecu(bench), tuple(map(_auxiliary, bench.auxiliary)),
            tuple(_substitutes(bench)), max(FINEST_S, HAND_OVER_SHARE * quickest_s), bench.actuator.timeout_s, values,
            BY_HAND if bench.ecu.by_hand else bench.ecu.supply or "", bench.actuator.setpoints_s is not None,
            not bench.ecu.measured,
        )

    def text(self, rig: SimulatedRig, addresses: Addresses) -> str:
        """The user's file with the addresses of a rig; the rig answers late by what the file allows."""
        rig.modbus.late_s = LATE_SHARE * self.timeout_s
        own = dict(self.values)
        own["actuator"] = {**own["actuator"], "url": addresses.actuator_url}
        own["ecu"] = self._current_source(own["ecu"], addresses)
        own["load_cell"] = _at(own["load_cell"], addresses.load_cell_url)
        own["lvdt"] = _at(own["lvdt"], addresses.lvdt_url)
        further = zip(own.get("auxiliary", ()), addresses.auxiliary_urls, strict=True)
        own["auxiliary"] = [_at(sensor, url) for sensor, url in further]
        return _file(own)

    @staticmethod
    def _current_source(own: Mapping[str, Any], addresses: Addresses) -> dict[str, Any]:
        """The table of the current source with the address of a rig."""
        if own.get("by_hand"):  # the supply is the simulated hand's
            return {**own, "rehearsal": addresses.supply_url}
        if addresses.supply_url:
            unit = {} if addresses.supply_url.startswith("tcp:") else {"device_id": DEVICE_ID}
            return {**own, "url": addresses.supply_url, **unit}
        return _on_bus(own, addresses.slcan_url)

    def portable(self, text: str) -> str:
        """The user's file (`text`) as it can be read in any folder: files that it names have whole paths."""
        return _file(self.values) if any(named_files.named(self.values)) else text


def _at(sensor: Mapping[str, Any], url: str) -> dict[str, Any]:
    """Table of a sensor with the address at a rig."""
    return _on_bus(sensor, url) if "interface" in sensor else {**sensor, "url": url}


def _on_bus(own: Mapping[str, Any], channel: str) -> dict[str, Any]:
    """Table of a device on CAN with the bus of a rig."""
    kept = {key: value for key, value in own.items() if key != "interface_options"}
    return {**kept, "interface": "slcan", "bitrate": BITRATE, "channel": channel}


def _file(values: Mapping[str, Any]) -> str:
    return "".join(f"{toml_text(key)} = {toml_text(value)}\n" for key, value in values.items())


def _sensors(bench: Bench) -> dict[str, SensorConfig]:
    named = {f"auxiliary[{number}]": sensor for number, sensor in enumerate(bench.auxiliary)}
    return {"load_cell": bench.load_cell, "lvdt": bench.lvdt, **named}


def _unlike(bench: Bench) -> Iterator[str]:
    """What of a bench no simulated rig can be, with the way out."""
    actuator, ecu = bench.actuator, bench.ecu
    if ActuatorAddress.parse(actuator.url).kind not in LINKS:
        yield (
            f"actuator.url = \"{actuator.url}\": a manufacturer's own protocol cannot be simulated; "
            "allowed in a scenario: modbus-tcp:// and modbus-rtu:. Fix: use a copy of this file with a Modbus "
            "controller"
        )  # fmt: skip
    for key, group, name, device in (
        ("actuator.register_map", plugins.ACTUATORS, actuator.map_name, "controller"),
        ("ecu.dbc", plugins.CURRENT_SOURCES, ecu.dbc_name, "current source"),
    ):
        if is_dbc(name) or (group == plugins.ACTUATORS and (is_file(name) or name in controller_names())):
            continue
        if name != DEMO and plugins.simulated_as(group, name) != DEMO:
            yield (
                f'{key} = "{name}": there is no simulated {device} for it; allowed in a scenario: "{DEMO}". Fix: use '
                f'a copy of this file with {key.partition(".")[2]} = "{DEMO}"; the device itself is then not tested'
            )
    if bench.clock.device_rate != 1.0:
        rate = bench.clock.device_rate
        yield (
            f"clock.device_rate = {rate:g}: devices in a scenario run in real time; allowed: 1. Fix: remove this "
            "entry"
        )
    for place, sensor in _sensors(bench).items():
        if sensor.rate_Hz > HIGHEST_RATE_Hz:
            yield (
                f"{place}.rate = {sensor.rate_Hz:g} Hz: simulated sensors send at most {HIGHEST_RATE_Hz:g} Hz. Fix: "
                "use a copy of this file with a lower rate"
            )
        try:
            _format(sensor)
        except LocalProtocolError as problem:
            yield f"{place}.format: a simulated sensor cannot write this format: {problem}"


def _emulated_ecu(bench: Bench) -> EmulatedEcuFiles:
    """The user's DBC and roles, if the current source has them; else the demo's."""
    dbc, roles = bench.ecu.dbc_name, bench.ecu.roles
    if not is_dbc(dbc) or roles is None:
        return DEMO_ECU
    return EmulatedEcuFiles(Path(dbc), Path(roles) if isinstance(roles, str) else roles)


def _substitutes(bench: Bench) -> Iterator[str]:
    """What a world has otherwise than the file says, in words."""
    yield "serial lines and networks are simulated as sockets without a baud rate"
    if bench.ecu.by_hand:
        yield "the manual current is set immediately; no process is killed and there is no power failure"
    elif bench.ecu.url is not None:
        yield (
            "the supply is connected over TCP; the station is not killed and there is no power failure, because the "
            "current would continue"
        )
    elif bench.ecu.interface != "slcan":
        yield f"the CAN bus is connected over slcan at {BITRATE // 1000} kbit/s instead of {bench.ecu.interface}"
    if bench.auxiliary:
        yield "auxiliary channels show the scaled rod travel"


def _patience_s(sensor: SensorConfig) -> float:
    """How long a sensor may be quiet (s): until it counts as dead; one that is asked, until it is asked again."""
    described = _format(sensor)
    on_request = not isinstance(described, str) and bool(described.exchange.request)
    return 1.0 / sensor.rate_Hz if on_request else sensor.stale_after_s


def _format(sensor: SensorConfig) -> str | SensorFormat:
    """The format a simulated sensor sends.

    Raises:
        LocalProtocolError: none can be written so.
    """
    given = sensor.described
    if isinstance(given, str) and given not in (FRAME16, *TABLES):
        given = _substitute_for(given)
    if given == FRAME16:
        return FRAME16
    if isinstance(given, str) and given not in TABLES:
        known = ", ".join((FRAME16, *TABLES))
        raise LocalProtocolError(f"{given!r} has its own driver; allowed in a scenario: {known}, a file or a table")
    described = described_format(given)
    slope, offset = sensor.calibration.line(sensor.dimension)
    writer(described, (offset - sensor.span) / slope, (offset + sensor.span) / slope)
    return described


def _substitute_for(name: str) -> str | dict[str, Any]:
    """What a simulated sensor writes for a plug-in's driver, where that says so; else the name as it is."""
    simulated = plugins.simulated_as(plugins.SENSORS, name)
    return name if simulated is None else simulated if isinstance(simulated, str) else dict(simulated)


def _sensor(sensor: SensorConfig, usual: SensorOptions, span_m: float = 0.0) -> SensorOptions:
    """A simulated sensor as a bench file describes it; noise and resolution are the usual shares of the range.

    Args:
        sensor: its table.
        usual: what it is like beside.
        span_m: the travel (m) that an auxiliary channel shows as half of its range; 0 for a sensor that measures in SI.
    """
    calibration = sensor.calibration
    slope, shown_at_zero = calibration.line(sensor.dimension)
    per_si = 1.0 / slope
    full = sensor.span * per_si
    described = _format(sensor)
    zero = shown_at_zero * per_si
    bandwidth_Hz, skew_s = _filter(sensor.delay_s, sensor.bandwidth_Hz or usual.bandwidth_Hz)
    own = described == FRAME16
    return replace(
        usual, unit="N", wire_per_si=0.5 * full / span_m if span_m else per_si, rate_Hz=sensor.rate_Hz,
        format=described, described="" if own else sensor.format, range=full, noise=usual.noise / usual.range * full,
        resolution=usual.resolution / usual.range * full, offset=zero if own else 0.0, wire_zero=0.0 if own else zero,
        reversed=calibration.sign < 0.0, bandwidth_Hz=bandwidth_Hz, skew_s=skew_s, baudrate=sensor.baudrate,
        serial_number=calibration.serial_number, line=modbus_line(sensor.port),
        burst_s=min(usual.burst_s, BURST_SHARE * _patience_s(sensor)),
    )  # fmt: skip


def _auxiliary(sensor: SensorConfig) -> SensorOptions:
    return _sensor(sensor, AUXILIARY, ServoOptions().half_stroke_m)


def _filter(delay_s: float | None, bandwidth_Hz: float) -> tuple[float, float]:
    """Corner (Hz) and further delay (s) of an input that is as late as was declared; undeclared is not late at all."""
    if not delay_s:
        return NO_FILTER_HZ, 0.0
    own_s = group_delay_s(bandwidth_Hz)
    return (bandwidth_Hz, delay_s - own_s) if own_s <= delay_s else (bandwidth_Hz * own_s / delay_s, 0.0)


def _damper(usual: DamperOptions, specimen: Specimen) -> DamperOptions:
    """The damper that the matrix assumes."""
    assumed = specimen.assumed
    if assumed is None:
        return usual
    if not is_fit_file(specimen.prior):
        return replace(usual, set=assumed.key)
    fitted = assumed.model
    return replace(usual, model=fitted.name, hysteresis=fitted.hysteresis, values=dict(assumed.values))


def _start_position_m(specimen: Specimen, usual_m: float) -> float:
    """Where the rod is at first: as usual, or at mid-stroke if the damper cannot be installed there."""
    reached = abs(usual_m - specimen.mid_stroke_m) < 0.5 * specimen.stroke_m
    return usual_m if reached else specimen.mid_stroke_m


def _options(bench: Bench, matrix: Matrix) -> RigOptions:
    """The rig of a bench file, with the matrix's specimen in it."""
    usual, limits, specimen = RigOptions(), bench.limits, matrix.specimen
    reach_m = BEYOND * max(abs(limits.position_min_m), abs(limits.position_max_m))
    servo, controller, coil = usual.servo, usual.controller, usual.coil
    area_m2 = max(servo.piston_area_m2, 1.5 * limits.force_N / servo.supply_Pa)
    needed_V = 2.0 * coil.ohm * limits.current_A
    return replace(
        usual,
        moving_mass_kg=bench.fixture.moving_mass_kg,
        servo=replace(
            servo, half_stroke_m=max(servo.half_stroke_m, reach_m), piston_area_m2=area_m2,
            rated_speed_m_s=max(servo.rated_speed_m_s, 1.5 * limits.speed_m_s),
            start_position_m=_start_position_m(specimen, servo.start_position_m),
        ),
        controller=_controller(controller, bench, reach_m),
        position_input=_input(usual.position_input, bench.actuator),
        force_input=_input(usual.force_input, bench.actuator),
        damper=_damper(usual.damper, specimen),
        specimen=replace(
            usual.specimen, serial_number=specimen.serial_number, mid_stroke_m=specimen.mid_stroke_m,
            stroke_m=specimen.stroke_m + SHORTER_M,
        ),
        coil=replace(
            coil, limit_A=max(coil.limit_A, BEYOND * limits.current_A), supply_V=max(coil.supply_V, needed_V),
            over_temperature_degC=max(coil.over_temperature_degC, limits.coil_temperature_degC + 30.0),
            serial_number=coil.serial_number if bench.ecu.serial_number is None else bench.ecu.serial_number,
        ),
        load_cell=_sensor(bench.load_cell, usual.load_cell),
        lvdt=_sensor(bench.lvdt, LVDT),
    )  # fmt: skip


def _controller(usual: ControllerOptions, bench: Bench, reach_m: float) -> ControllerOptions:
    limits, number = bench.limits, bench.actuator.serial_number
    own = appearing_as(RigOptions(controller=usual), _map_of(bench)).controller
    return replace(
        own, device_id=bench.actuator.device_id, serial_number=usual.serial_number if number is None else number,
        position_limit_m=max(usual.position_limit_m, reach_m),
        speed_max_m_s=max(usual.speed_max_m_s, BEYOND * limits.speed_m_s),
        acceleration_max_m_s2=max(usual.acceleration_max_m_s2, BEYOND * limits.acceleration_m_s2),
        force_max_N=max(usual.force_max_N, BEYOND * limits.force_N),
    )  # fmt: skip


def _map_of(bench: Bench) -> str:
    """The register map as which the simulated controller appears: the bench's, or what stands for a plug-in's."""
    name = bench.actuator.map_name
    return name if is_file(name) or name in controller_names() else DEMO


def _input(usual: InputOptions, actuator: ActuatorConfig) -> InputOptions:
    """A controller's input as late as the file says; where it says nothing, as ever."""
    if actuator.input_delay_s is None:
        return usual
    bandwidth_Hz, delay_s = _filter(actuator.input_delay_s, usual.bandwidth_Hz)
    return replace(usual, bandwidth_Hz=bandwidth_Hz, delay_s=delay_s)


def longest_s(duration_s: float | None, motion_s: float, retries: int) -> float:
    """How long a campaign of that forecast takes at most (s), every point repeated as often as is allowed.

    Args:
        duration_s: forecast, or None where warming up and cooling down are unknown.
        motion_s: of all points.
        retries: how often a point may be repeated.
    """
    once_s = 2.0 * motion_s + 3600.0 if duration_s is None else duration_s
    return 2.0 * (1.0 + retries) * once_s if math.isfinite(once_s) else 0.0
