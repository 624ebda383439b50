"""The rig's settings: frozen values that are read from the bench file and used by the station unchanged.

Each entry is declared once, here and in `sensor_settings`: key in the file, unit, range, default. `rig.bench.model`
reads them from TOML and reports the location of every problem; `StationConfig.to_json` and `settings_json.from_json`
carry them to the station process, which loads no validator (0.1 s of its start) but checks the same ranges. Every
number is SI; durations are wall seconds unless the name states otherwise.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import date
from functools import cached_property
from typing import Annotated, Any, Literal

from drivers.capabilities import Capabilities
from drivers.catalogue import (
    DbcText,
    SupplyDescription,
    current_source_steps_A,
    current_source_timeout_s,
    make_actuator,
    supply,
    watchdog_time_s,
)
from drivers.connection import ActuatorConnection, CanAddress
from protocols.descriptions import Problem
from rig.bench import address
from rig.bench.manual_settings import manual_problems_of
from rig.bench.sensor_settings import (
    Auxiliary,
    Delay,
    Force,
    LoadCell,
    Lvdt,
    Name,
    SensorConfig,
    Timeout,
)
from rig.bench.supply_settings import supply_problems_of
from rig.files.described import DescribedBy, described
from rig.files.names import is_dbc
from rig.files.network_text import dbc_text
from rig.files.quantity import Check, Quantity, Settings, Text, key

ECU_STATUS_Hz = 100.0
HAND_SILENT_S = 0.5
MOST_AUXILIARY = 7
LATE_SETPOINT_S = 0.010
SPIKE_FORCE_SHARE = 0.6
"""A triangle's reversal turns the whole yield force round between two samples; a larger jump is no physics."""
SPIKE_SPEED_FACTOR = 2.0
SPIKE_DISPLACEMENT_M = 1e-3

# A limit outside these is a slip of the pen, not a damper test rig (fault row `config-absurd`).
Position = Annotated[float, Quantity("length", "-1 m", "1 m")]
Speed = Annotated[float, Quantity("speed", "0 m/s", "5 m/s", above=True)]
Acceleration = Annotated[float, Quantity("acceleration", "0 m/s^2", "500 m/s^2", above=True)]
Current = Annotated[float, Quantity("current", "0 A", "20 A", above=True)]
Temperature = Annotated[float, Quantity("temperature", "20 degC", "250 degC")]


def _ordered(value: tuple[float, float]) -> tuple[float, float]:
    if not value[0] < value[1]:
        raise ValueError("the first value must be less than the second")
    return value


@dataclass(frozen=True, kw_only=True)
class Limits(Settings):
    """What the machine may do; plan, station and controller hold every motion inside them.

    The interlocks trip beyond these values, speed and current beyond `Margins`.
    """

    position_m: Annotated[tuple[Position, Position], Check(_ordered)] = field(
        metadata=key("position", examples=[["-85 mm", "85 mm"]])
    )
    speed_m_s: Speed = field(metadata=key("speed"))
    acceleration_m_s2: Acceleration = field(metadata=key("acceleration"))
    force_N: Force = field(metadata=key("force"))
    current_A: Current = field(metadata=key("current"))
    coil_temperature_degC: Temperature = field(metadata=key("coil_temperature"))

    @property
    def position_min_m(self) -> float:
        """Lowest position (m, LVDT coordinate)."""
        return self.position_m[0]

    @property
    def position_max_m(self) -> float:
        """Highest position (m, LVDT coordinate)."""
        return self.position_m[1]

    def within_stroke(self, stroke_m: float, mid_stroke_m: float) -> Limits:
        """The same limits with the travel that machine and specimen both allow.

        Args:
            stroke_m: the specimen's whole stroke (m).
            mid_stroke_m: its middle in the LVDT's coordinate (m).
        """
        low_m = max(self.position_min_m, mid_stroke_m - 0.5 * stroke_m)
        high_m = min(self.position_max_m, mid_stroke_m + 0.5 * stroke_m)
        return dataclasses.replace(self, position_m=(low_m, high_m))


@dataclass(frozen=True)
class Margins:
    """How far beyond a limit the trip lies, for the two limits whose measurement is not the limited quantity itself.

    Position, force, acceleration and temperature trip at their limit; the plan keeps the headroom a point needs.
    `speed` is a share of the speed limit: the speed is a difference of LVDT samples, and sensor noise, latency jitter
    and the servo's ripple come with it. `current_A` is the ECU's tracking tolerance, so that a set-point at the limit
    can be held. The controller is given the same values.
    """

    speed: float = 0.10
    current_A: float = 0.15


@dataclass(frozen=True, kw_only=True)
class ActuatorConfig(Settings):
    """The servo-hydraulic controller, over Modbus TCP or RTU, and what it is told at `arm`."""

    url: Annotated[str, Text(256), Check(address.modbus_url)] = field(
        metadata=key(examples=["modbus-tcp://192.168.0.10:502", "modbus-rtu:/dev/ttyUSB0"])
    )
    baudrate: int = field(
        default=115_200, metadata=key(ge=1200, le=12_000_000, description="only for a serial line (modbus-rtu)")
    )
    parity: Literal["N", "E", "O"] = field(default="N", metadata=key(description="only for a serial line (modbus-rtu)"))
    device_id: int = field(default=1, metadata=key(ge=0, le=255, description="Modbus unit address; on a serial line, "
        "1 to 247"))
    register_map: Annotated[str | dict[str, Any], DescribedBy("register-map", address.known_actuator, tables=False)] = (
        "demo"
    )
    poll_s: Annotated[float, Quantity("time", "2 ms", "100 ms")] = field(default=0.010, metadata=key("poll"))
    timeout_s: Timeout = field(default=0.040, metadata=key("timeout"))
    stale_after_s: Timeout = field(default=0.150, metadata=key("stale_after"))
    watchdog_s: Annotated[float, Quantity("time", "50 ms", "10 s")] = field(default=0.500, metadata=key("watchdog"))
    fade_out_cycles: float = field(default=1.0, metadata=key(ge=1.0, le=10.0))
    halt_deceleration_m_s2: Acceleration = field(default=20.0, metadata=key("halt_deceleration"))
    input_delay_s: Delay | None = field(
        default=None,
        metadata=key(
            "input_delay",
            description="delay of the controller's own position and force inputs, against which the sensors are "
                "checked",
        ),
    )
    setpoint_late_s: Annotated[float, Quantity("time", "2 ms", "500 ms")] | None = field(
        default=None,
        metadata=key(
            "setpoint_late",
            description="only for an actuator with streamed set-points: delay beyond which a set-point counts as "
                "late; default: 10 ms, or one poll period if that is longer",
        ),
    )
    serial_number: Name | None = None

    @property
    def not_physics(self) -> dict[str, Any]:
        """What does not count for `Bench.digest`: addresses and times."""
        link = ("url", "device_id", "poll_s", "timeout_s", "stale_after_s", "watchdog_s", "setpoint_late_s")
        return dict.fromkeys(link, True)

    @cached_property
    def described(self) -> str | dict[str, Any]:
        """Its register map as drivers take it: a name, or the table of a file.

        Raises:
            FileProblem: its file cannot be used any more.
        """
        table: str | dict[str, Any] = described("register-map", self.register_map)
        return table

    @property
    def map_name(self) -> str:
        """Its register map as the bench file names it; of a table the map's own name."""
        return self.register_map if isinstance(self.register_map, str) else str(self.register_map.get("name"))

    @cached_property
    def capabilities(self) -> Capabilities:
        """What the controller can do; looked up once: a plan asks for each of its points."""
        return make_actuator(self.described, ActuatorConnection(self.url, self.device_id, self.timeout_s)).capabilities

    @property
    def takes_pressure_away(self) -> bool:
        """It can be told to take the hydraulic pressure away."""
        return self.capabilities.hydraulics

    @property
    def has_low_pressure(self) -> bool:
        """It has a low pressure between off and full."""
        return self.capabilities.low_pressure

    @property
    def setpoints_s(self) -> float | None:
        """Period of the streamed set-points (wall s); None for a controller that generates motions itself."""
        return None if self.capabilities.generator else self.poll_s

    @property
    def makes_triangles(self) -> bool:
        """It moves in triangles, not in sines alone."""
        return self.capabilities.triangle

    @property
    def makes_sines(self) -> bool:
        """Whether it can generate sines (not only triangles)."""
        return self.capabilities.sine

    @property
    def watchdog_tested(self) -> str:
        """Pressure at which the watchdog works and is tested: "off", "low" or "on"."""
        return self.capabilities.watchdog_tested

    def problems(self) -> Iterator[Problem]:
        """A serial line has the device id, and the watchdog has tripped by the time the station counts on it."""
        if self.url.startswith("modbus-rtu") and not 1 <= self.device_id <= address.LAST_SERIAL_ID:
            yield ("device_id",), f"invalid on a serial line; allowed: 1 to {address.LAST_SERIAL_ID}"
        own_s = watchdog_time_s(self.described)
        if own_s > self.watchdog_s:
            yield ("watchdog",), (
                "is shorter than the controller's own watchdog, which according to its register map trips after "
                f"{1e3 * own_s:g} ms; allowed: at least {1e3 * own_s:g} ms"
            )

    @property
    def late_setpoint_s(self) -> float:
        """A set-point sent so much after its time is late (s)."""
        return max(self.poll_s, LATE_SETPOINT_S) if self.setpoint_late_s is None else self.setpoint_late_s

    @property
    def longest_setpoint_gap_s(self) -> float:
        """A streamed motion is not continued after a longer time without a set-point that was taken (s).

        As long as three late set-points in a row take, which stop the rig.
        """
        return self.late_setpoint_s + 3.0 * self.poll_s


@dataclass(frozen=True, kw_only=True)
class EcuConfig(Settings):
    """The coil's current source: a current controller on CAN, a supply by its `url`, or a person (`by_hand`).

    `dbc` is a known kind, or the name of a DBC file; then `roles` says what its signals mean: the name of a TOML file,
    or the same as a table. `supply` is a supply's language: a preset, a file, a table.
    """

    interface: Annotated[str, Text(256), Check(address.can_interface)] | None = field(
        default=None, metadata=key(examples=["socketcan"])
    )
    channel: Name | None = field(default=None, metadata=key(examples=["can0"]))
    bitrate: int = field(default=500_000, metadata=key(ge=10_000, le=1_000_000))
    interface_options: dict[str, str | int | float | bool] = field(
        default_factory=dict, metadata=key(description="further arguments for the interface, named as in python-can")
    )
    dbc: Annotated[str | DbcText, Check(address.known_current_source, written=str)] = field(
        default="demo", metadata=key(
            examples=["ecu.dbc"], description="name of a built-in ECU, or a DBC, KCD, SYM or ARXML file"
        )
    )
    roles: str | dict[str, Any] | None = field(
        default=None, metadata=key(examples=["ecu-roles.toml"], description="meaning of the signals in a DBC file")
    )
    command_period_s: Annotated[float, Quantity("time", "2 ms", "50 ms")] = field(
        default=0.010, metadata=key("command_period")
    )
    stale_after_s: Timeout = field(default=0.030, metadata=key("stale_after"))
    serial_number: int | None = field(default=None, metadata=key(ge=0, le=0xFFFF_FFFF))
    url: Annotated[str, Text(256), Check(address.supply_url)] | None = field(
        default=None, metadata=key(examples=["tcp://192.168.0.20:5025", "/dev/ttyUSB2"], description="address of a "
            "supply")
    )
    supply: Annotated[str | dict[str, Any], DescribedBy("supply", address.known_supply)] | None = field(
        default=None,
        metadata=key(
            examples=["generic-scpi", "my-supply.toml"],
            description="commands for a supply: a preset, a file in the bench file's folder, or a table",
        ),
    )
    baudrate: int | None = field(
        default=None, metadata=key(ge=300, le=12_000_000, description="only for a supply on a serial line; default: "
            "the value in the supply's description")
    )
    poll_s: Annotated[float, Quantity("time", "2 ms", "1 s")] = field(
        default=0.100, metadata=key("poll", description="interval at which the supply's current is read")
    )
    timeout_s: Timeout = field(default=0.500, metadata=key("timeout", description="time-out for each answer from a "
        "supply"))
    voltage_limit_V: Annotated[float, Quantity("voltage", "0 V", "200 V", above=True)] | None = field(
        default=None, metadata=key("voltage_limit", description="highest voltage that a supply may apply to the coil")
    )
    slew_limit_A_s: Annotated[float, Quantity("current rate", "0.01 A/s", "1000000 A/s")] | None = field(
        default=None, metadata=key("slew_limit", description="highest rate at which the source changes the current; "
            "the plan rejects steps that the source cannot make in time")
    )
    current_delay_s: Delay | None = field(
        default=None, metadata=key("current_delay", description="group delay of the filter in the measurement of the "
            "coil current, as for the sensors; response times of the current are corrected for it")
    )
    identity: Name | None = field(
        default=None, metadata=key(description="text that a supply's identity (*IDN?) must contain")
    )
    device_id: int = field(
        default=1, metadata=key(ge=0, le=255, description="Modbus unit address of an analogue output (if its url "
            "is modbus-tcp: or modbus-rtu:)")
    )
    by_hand: bool = field(
        default=False, metadata=key(description="the operator sets the current manually, on request")
    )
    pressure_while_asked: Literal["off", "low", "on"] = field(
        default="off", metadata=key(description="hydraulic pressure while the operator is at the supply")
    )
    answer_within_s: Annotated[float, Quantity("time", "10 s", "1 h")] = field(
        default=600.0, metadata=key("answer_within", description="maximum time for the operator to set a "
            "current")
    )
    rehearsal: Annotated[str, Text(256), Check(address.supply_url)] | None = field(
        default=None, metadata=key(description="address of the simulated supply; written by a simulated rig with "
            "manual current")
    )

    @property
    def dbc_name(self) -> str:
        """Its DBC, or its kind, as the bench file names it; of the station's the file's own name."""
        return self.dbc if isinstance(self.dbc, str) else self.dbc.name

    @property
    def described_source(self) -> tuple[str | DbcText, dict[str, Any] | None]:
        """A current controller on CAN as drivers take it: its name, or its DBC with the table of its roles.

        Raises:
            FileProblem: a file cannot be used any more.
        """
        dbc = dbc_text(self.dbc) if isinstance(self.dbc, str) and is_dbc(self.dbc) else self.dbc
        return dbc, described("ecu-roles", self.roles)

    @property
    def own_timeout_s(self) -> float | None:
        """Time without a command after which an ECU goes to 0 A itself (s), where a roles file states it."""
        dbc, roles = self.described_source
        return current_source_timeout_s(dbc, roles) if isinstance(dbc, DbcText) else None

    @property
    def described_supply(self) -> SupplyDescription | None:
        """The description of its supply; None where it is none.

        Raises:
            FileProblem: its file cannot be used any more.
        """
        return None if self.supply is None else supply(described("supply", self.supply))

    @property
    def port(self) -> str:
        """Where it is: the supply's port, a serial CAN adapter's, interface and channel; empty: set manually."""
        if self.by_hand:
            return self.rehearsal or ""
        if self.url is not None:
            return self.url
        return self.bus.text

    @property
    def bus(self) -> CanAddress:
        """CAN bus of the current controller."""
        return CanAddress(self.interface or "", self.channel or "", self.bitrate, self.interface_options)

    @property
    def measured(self) -> bool:
        """Whether the current is measured: else it is what the operator confirmed or what an output was sent."""
        source = None if self.by_hand else self.described_supply
        return not self.by_hand and (source is None or source.measures)

    @cached_property
    def steps_A(self) -> tuple[float, float]:
        """Resolution (A) of its set-point and of its measured current; 0 if not stated or if nothing is measured."""
        if not self.measured:
            return 0.0, 0.0
        source = self.described_supply
        if source is None:
            return current_source_steps_A(*self.described_source)
        return (0.0, 0.0) if source.output is None else source.output.steps_A

    @property
    def silent_after_s(self) -> float:
        """Age at which its last value is stale (wall s); a person is not heard, but asked."""
        return HAND_SILENT_S if self.by_hand else self.stale_after_s

    @property
    def status_period_s(self) -> float:
        """How often its current is told (s)."""
        return 1.0 / ECU_STATUS_Hz if self.url is None else self.poll_s

    @property
    def not_physics(self) -> dict[str, Any]:
        """What does not count for `Bench.digest`: addresses, times, what is not stated of a supply or a person."""
        link = (
            "interface", "channel", "bitrate", "interface_options", "command_period_s", "stale_after_s", "url",
            "baudrate", "poll_s", "timeout_s", "pressure_while_asked", "answer_within_s", "rehearsal", "device_id",
        )
        new = ("roles", "supply", "voltage_limit_V", "slew_limit_A_s", "current_delay_s", "identity", "by_hand")
        unsaid = (name for name in new if getattr(self, name) in (None, False))
        return dict.fromkeys((*link, *unsaid), True)

    def problems(self) -> Iterator[Problem]:
        """Which kind of source it is, and what that kind needs."""
        yield from manual_problems_of(self)
        if self.by_hand:
            return
        if self.url is not None or self.supply is not None:
            yield from supply_problems_of(self)
            if (self.url or "").startswith("modbus-rtu") and not 1 <= self.device_id <= address.LAST_SERIAL_ID:
                yield ("device_id",), f"invalid on a serial line; allowed: 1 to {address.LAST_SERIAL_ID}"
            return
        for name, example in (("interface", "socketcan"), ("channel", "can0")):
            if getattr(self, name) is None:
                yield (name,), f'missing; write, for example, {name} = "{example}", a supply\'s url, or by_hand = true'
        if self.interface == "slcan" and self.channel is not None:
            try:
                address.serial_url(self.channel)
            except ValueError as problem:
                yield ("channel",), str(problem)
        for name in self.interface_options.keys() & {"interface", "channel", "bitrate"}:
            yield ("interface_options", name), f"belongs in [ecu]. Fix: write {name} = ... under [ecu]"
        yield from address.ecu_problems(self.dbc, self.roles)


@dataclass(frozen=True, kw_only=True)
class Clock(Settings):
    """At what rate device clocks run against the wall: 1 on hardware, the speed of a simulated rig.

    `shared` is written by a simulated rig alone: the file of its clock, which waits for a busy computer and to which
    all time limits apply (`drivers.clock`). It is refused at the start for a device that is not that rig's own.
    """

    device_rate: float = field(default=1.0, metadata=key(ge=0.01, le=1000.0))
    shared: Annotated[str, Text(1024)] | None = field(
        default=None,
        metadata=key(description="clock file, written by a simulated rig; this clock pauses while the computer "
            "is busy"),
    )


@dataclass(frozen=True, kw_only=True)
class Station(Settings):
    """The I/O process."""

    heartbeat_timeout_s: Annotated[float, Quantity("time", "100 ms", "10 s")] = field(
        default=0.500, metadata=key("heartbeat_timeout")
    )
    late_limit_s: Annotated[float, Quantity("time", "20 ms", "1 s")] = field(
        default=0.050,
        metadata=key(
            "late_limit",
            description="longest permitted pause in monitoring; a longer pause stops the rig (host-late)",
        ),
    )
    real_time: bool = True


@dataclass(frozen=True, kw_only=True)
class StationConfig(Station, Clock):
    """Everything the station needs: the bench's own settings, and what only the station knows.

    A time for which the station itself did not watch is recorded from `late_after_s` on and stops the rig beyond
    `late_limit_s`. `disagreement_m` is how far LVDT and controller position may be apart. `owner_id` is the lease at
    the controller, 1..65535; 0 has the station draw one at random. At `stop_socket` it takes a stop from others than
    its application; empty: none.
    """

    actuator: ActuatorConfig
    ecu: EcuConfig
    load_cell: LoadCell
    lvdt: Lvdt
    limits: Limits
    ring_path: str
    auxiliary: tuple[Auxiliary, ...] = field(default=(), metadata=key(max_length=MOST_AUXILIARY))
    margins: Margins = field(default_factory=Margins)
    ring_capacity: int = field(default=1 << 19, metadata=key(ge=1))
    late_after_s: float = 0.020
    disagreement_m: float = 0.005
    owner_id: int = field(default=0, metadata=key(ge=0, le=0xFFFF))
    stop_socket: str = ""
    disabled_detectors: tuple[str, ...] = ()

    @property
    def sensors(self) -> tuple[SensorConfig, ...]:
        """Load cell, LVDT and the auxiliary channels."""
        return (self.load_cell, self.lvdt, *self.auxiliary)

    @property
    def addresses(self) -> tuple[str, ...]:
        """Where the devices are, as the bench file states it."""
        source = (self.ecu.port,) if self.ecu.port else ()
        return (self.actuator.url, *source, *(sensor.port for sensor in self.sensors))

    @property
    def periods_s(self) -> list[float]:
        """At which periods the devices are heard (wall s): polls, samples, the ECU's status frames."""
        periods_s = [*(1.0 / sensor.rate_Hz for sensor in self.sensors), self.ecu.status_period_s]
        return [self.actuator.poll_s, *(period_s / self.device_rate for period_s in periods_s)]

    def spike_jump(self, sensor: SensorConfig) -> float:
        """The change between two samples (SI) that physics cannot make; none is known of an auxiliary channel."""
        if isinstance(sensor, LoadCell):
            return SPIKE_FORCE_SHARE * self.limits.force_N
        if isinstance(sensor, Lvdt):
            return SPIKE_DISPLACEMENT_M + SPIKE_SPEED_FACTOR * self.limits.speed_m_s / sensor.rate_Hz
        return math.inf

    def to_json(self) -> str:
        """This configuration as JSON text."""
        return json.dumps(dataclasses.asdict(self), indent=1, default=date.isoformat)
