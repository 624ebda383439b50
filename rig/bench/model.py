"""The bench file as values: `Bench.load("bench.toml")`. Every number is SI; the ranges are the envelope of any rig."""

from __future__ import annotations

import hashlib
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from rig import units
from rig.bench import address
from rig.bench.address import known_actuator, known_current_source
from rig.bench.checks import Checks
from rig.bench.field import (
    RESERVED_NAMES,
    Acceleration,
    CanInterface,
    ChannelName,
    Current,
    Force,
    LineValue,
    ModbusUrl,
    Name,
    Position,
    SerialUrl,
    Speed,
    Temperature,
    Timeout,
)
from rig.bench.problems import load_section
from rig.bench.quantity import Quantity, Section

Problem = tuple[tuple[str | int, ...], str]


class Limits(Section):
    """What the machine may do; plan, station and controller hold every motion inside them."""

    position_m: tuple[Position, Position] = Field(alias="position", examples=[["-85 mm", "85 mm"]])
    speed_m_s: Speed = Field(alias="speed")
    acceleration_m_s2: Acceleration = Field(alias="acceleration")
    force_N: Force = Field(alias="force")
    current_A: Current = Field(alias="current")
    coil_temperature_degC: Temperature = Field(alias="coil_temperature")

    @field_validator("position_m")
    @classmethod
    def _ordered(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not value[0] < value[1]:
            raise ValueError("the first must be below the second")
        return value


class Actuator(Section):
    """The servo-hydraulic controller, over Modbus TCP or RTU."""

    url: ModbusUrl
    baudrate: int = Field(default=115_200, ge=1200, le=12_000_000, description="of a serial line (modbus-rtu)")
    parity: Literal["N", "E", "O"] = Field(default="N", description="of a serial line (modbus-rtu)")
    device_id: int = Field(default=1, ge=0, le=247)
    register_map: Annotated[str, AfterValidator(known_actuator)] = "demo"
    poll_s: Annotated[float, Quantity("time", "2 ms", "100 ms")] = Field(default=0.010, alias="poll")
    timeout_s: Timeout = Field(default=0.040, alias="timeout")
    stale_after_s: Timeout = Field(default=0.150, alias="stale_after")
    watchdog_s: Annotated[float, Quantity("time", "50 ms", "10 s")] = Field(default=0.500, alias="watchdog")
    fade_out_cycles: float = Field(default=1.0, ge=1.0, le=10.0)
    halt_deceleration_m_s2: Acceleration = Field(default=20.0, alias="halt_deceleration")
    input_delay_s: Annotated[float, Quantity("time", "0 s", "100 ms")] | None = Field(
        default=None, alias="input_delay",
        description="delay of the controller's own position and force inputs; sensors are checked against them",
    )
    serial_number: Name | None = None


class Ecu(Section):
    """The current controller of the coil, over CAN by any python-can interface."""

    interface: CanInterface
    channel: Name = Field(examples=["can0"])
    bitrate: int = Field(default=500_000, ge=10_000, le=1_000_000)
    dbc: Annotated[str, AfterValidator(known_current_source)] = "demo"
    command_period_s: Annotated[float, Quantity("time", "2 ms", "50 ms")] = Field(default=0.010, alias="command_period")
    stale_after_s: Timeout = Field(default=0.030, alias="stale_after")
    serial_number: int | None = Field(default=None, ge=0, le=0xFFFF_FFFF)

    @model_validator(mode="after")
    def _channel_is_a_port(self) -> Self:
        if self.interface == "slcan":
            try:
                address.serial_url(self.channel)
            except ValueError as problem:
                raise _located([(("channel",), str(problem))]) from problem
        return self


class Calibration(Section):
    """How the value on the wire becomes SI: `sensitivity * wire - offset`, times -1 where polarity is reversed.

    The sign is applied in `Sensor.sensitivity` and `Sensor.offset` and nowhere else: all others compute
    `sensitivity * wire - offset` with those two.
    """

    sensitivity: float = Field(
        default=1.0, description="SI units per unit on the wire", json_schema_extra={"exclusiveMinimum": 0}
    )
    polarity: Literal["normal", "reversed"] = Field(
        default="normal", description="reversed: the sensor counts jounce, or compression, as positive"
    )
    offset: str | None = Field(default=None, description="what the sensor shows at zero, with its unit")
    serial_number: Name = Field(examples=["LC-1234"])
    certificate: str = Field(default="", max_length=128)
    uncertainty_percent: float | None = Field(
        default=None, ge=0.0, le=20.0, description="standard uncertainty of the sensitivity, % of the reading"
    )
    due: date | None = None

    @field_validator("sensitivity")
    @classmethod
    def _positive(cls, value: float) -> float:
        if value < 0:
            raise ValueError(f'too small; for the other sign write sensitivity = {-value:g} and polarity = "reversed"')
        if value == 0:
            raise ValueError("too small (allowed: more than 0)")
        return value


class Sensor(Section):
    """What load cell, LVDT and auxiliary channels have in common."""

    url: SerialUrl
    baudrate: int = Field(default=921_600, ge=300, le=12_000_000)
    format: str | dict[str, LineValue] = Field(
        default="frame16", description="frame16, a line format preset, or a table that describes a line"
    )
    rate_Hz: Annotated[float, Quantity("frequency", "1 Hz", "50 kHz")] = Field(alias="rate")
    stale_after_s: Timeout = Field(default=0.020, alias="stale_after")
    delay_s: Annotated[float, Quantity("time", "0 s", "100 ms")] | None = Field(
        default=None, alias="delay",
        description="group delay of the conditioner's filter; not stated: taken as 0, and uncertain unless checked",
    )
    bandwidth_Hz: Annotated[float, Quantity("frequency", "0 Hz", "1000 kHz", above=True)] | None = Field(
        default=None, alias="bandwidth", description="where sensor and conditioner have lost 3 dB; the plan looks at it"
    )
    calibration: Calibration

    @field_validator("format", mode="plain", json_schema_input_type=str | dict[str, LineValue])
    @classmethod
    def _known_format(cls, value: object) -> str | dict[str, LineValue]:
        from drivers.catalogue import sensor_format_names
        from protocols.errors import LocalProtocolError
        from protocols.line_format import from_description

        if isinstance(value, str):
            known = list(sensor_format_names())
            if value not in known:
                raise ValueError(f"unknown format; known: {', '.join(known)}, or a table that describes a line")
            return value
        if not isinstance(value, dict):
            raise ValueError("must be the name of a format in quotes, or a table that describes a line")
        try:
            from_description(value)
        except LocalProtocolError as error:
            raise ValueError(str(error)) from error
        return value

    @property
    def dimension(self) -> str:
        """Dimension of the value, a key of `rig.units.DIMENSIONS`."""
        raise NotImplementedError

    @property
    def sensitivity(self) -> float:
        """SI units per unit on the wire; negative where the polarity is reversed."""
        return self._sign * self.calibration.sensitivity

    @property
    def offset(self) -> float:
        """What `sensitivity * wire` is at zero, in the SI unit of this sensor; its sign follows the polarity."""
        text = self.calibration.offset
        return 0.0 if text is None else self._sign * units.parse(text, self.dimension)

    @property
    def _sign(self) -> float:
        return -1.0 if self.calibration.polarity == "reversed" else 1.0

    @property
    def not_physics(self) -> dict[str, Any]:
        """What does not count for `Bench.digest`; a polarity that is as ever does not either."""
        link = dict.fromkeys(("url", "baudrate", "stale_after_s", "bandwidth_Hz"), True)
        return {**link, "calibration": {"polarity"} if self.calibration.polarity == "normal" else set()}

    @model_validator(mode="after")
    def _offset_fits(self) -> Self:
        try:
            _ = self.offset
        except units.UnitProblem as problem:
            raise _located([(("calibration", "offset"), str(problem))]) from problem
        return self


class LoadCell(Sensor):
    """The force sensor."""

    range_N: Force = Field(alias="range")

    @property
    def dimension(self) -> str:
        """Force."""
        return "force"


class Lvdt(Sensor):
    """The displacement sensor."""

    range_m: Annotated[float, Quantity("length", "0 m", "1 m", above=True)] = Field(alias="range")

    @property
    def dimension(self) -> str:
        """Length."""
        return "length"


class Auxiliary(Sensor):
    """One further channel: recorded beside the others, never used for control."""

    name: ChannelName
    unit: str
    range: str

    @property
    def dimension(self) -> str:
        """The dimension of `unit`."""
        return units.UNITS[units.ALIASES.get(self.unit, self.unit)].dimension

    @property
    def range_SI(self) -> float:
        """Full scale in the SI unit of `unit`."""
        return units.parse(self.range, self.dimension)

    @field_validator("unit")
    @classmethod
    def _known_unit(cls, value: str) -> str:
        if units.ALIASES.get(value, value) not in units.UNITS:
            raise ValueError(f"unknown unit; known: {', '.join(units.UNITS)}")
        return value

    @field_validator("name")
    @classmethod
    def _not_reserved(cls, value: str) -> str:
        if value in RESERVED_NAMES:
            raise ValueError(f"is the name of a channel every run has ({', '.join(sorted(RESERVED_NAMES))})")
        return value

    @model_validator(mode="after")
    def _range_fits(self) -> Self:
        try:
            if not self.range_SI > 0:
                raise units.UnitProblem("must be more than 0")
        except units.UnitProblem as problem:
            raise _located([(("range",), str(problem))]) from problem
        return self


class Fixture(Section):
    """What sits between load cell and damper."""

    moving_mass_kg: Annotated[float, Quantity("mass", "0 kg", "500 kg")] = Field(default=0.0, alias="moving_mass")


class Clock(Section):
    """At what rate device clocks run against the wall: 1 on hardware, the speed of a simulated rig."""

    device_rate: float = Field(default=1.0, ge=0.01, le=1000.0)


class Station(Section):
    """The I/O process."""

    heartbeat_timeout_s: Annotated[float, Quantity("time", "100 ms", "10 s")] = Field(
        default=0.500, alias="heartbeat_timeout"
    )
    late_limit_s: Annotated[float, Quantity("time", "20 ms", "1 s")] = Field(
        default=0.050, alias="late_limit",
        description="so long the station may be kept from running; beyond it the rig stops as host-late",
    )
    real_time: bool = True


class Bench(Section):
    """One rig: its devices, calibration and limits."""

    format: Literal[1]
    name: Name
    limits: Limits
    actuator: Actuator
    ecu: Ecu
    load_cell: LoadCell
    lvdt: Lvdt
    auxiliary: tuple[Auxiliary, ...] = Field(default=(), max_length=7)
    fixture: Fixture = Field(default_factory=Fixture)
    clock: Clock = Field(default_factory=Clock)
    station: Station = Field(default_factory=Station)
    checks: Checks = Field(default_factory=Checks)
    require_valid_calibration: bool = Field(
        default=False, description="refuse to run with a sensor whose calibration is past its due date"
    )

    @classmethod
    def load(cls, path: str | Path) -> Bench:
        """Read and check a bench file.

        Raises:
            FileProblem: with every wrong entry of the file.
        """
        return load_section(Path(path), cls, "bench")[0]

    @property
    def digest(self) -> str:
        """SHA-256 (hex) of physics, limits, calibration and identities; addresses and time limits do not count."""
        text = self.model_dump_json(
            exclude={
                "name": True,
                "actuator": {"url", "device_id", "poll_s", "timeout_s", "stale_after_s", "watchdog_s"},
                "ecu": {"interface", "channel", "bitrate", "command_period_s", "stale_after_s"},
                "load_cell": self.load_cell.not_physics,
                "lvdt": self.lvdt.not_physics,
                "auxiliary": {index: item.not_physics for index, item in enumerate(self.auxiliary)},
                "clock": True,
                "station": True,
                "checks": True,
            }
        )
        return hashlib.sha256(text.encode()).hexdigest()

    def overdue(self, today: date) -> tuple[str, ...]:
        """Names of the sensors whose calibration is past its due date."""
        sensors = {"load_cell": self.load_cell, "lvdt": self.lvdt, **{item.name: item for item in self.auxiliary}}
        return tuple(
            name for name, item in sensors.items() if item.calibration.due is not None and item.calibration.due < today
        )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        problems = [*self._shared_ports(), *self._shared_names(), *self._ranges(), *self._periods()]
        if problems:
            raise _located(problems)
        return self

    def _sensors(self) -> dict[tuple[str | int, ...], Sensor]:
        sensors: dict[tuple[str | int, ...], Sensor] = {("load_cell",): self.load_cell, ("lvdt",): self.lvdt}
        for index, item in enumerate(self.auxiliary):
            sensors["auxiliary", index] = item
        return sensors

    def _shared_ports(self) -> list[Problem]:
        problems: list[Problem] = []
        owners: dict[str, str] = {}
        for place, sensor in self._sensors().items():
            if (owner := owners.get(sensor.url)) is not None:
                problems.append(((*place, "url"), f"is already the port of {owner}; every sensor has its own"))
            owners.setdefault(sensor.url, str(place[0]))
        return problems

    def _shared_names(self) -> list[Problem]:
        names = [item.name for item in self.auxiliary]
        return [
            (("auxiliary", index, "name"), "is the name of another auxiliary channel; names are unique")
            for index, name in enumerate(names)
            if name in names[:index]
        ]

    def _ranges(self) -> list[Problem]:
        problems: list[Problem] = []
        if self.limits.force_N > self.load_cell.range_N:
            cell = units.show(self.load_cell.range_N, "kN")
            problems.append((("limits", "force"), f"is beyond the load cell's range; allowed: at most {cell}"))
        if max(map(abs, self.limits.position_m)) > self.lvdt.range_m:
            lvdt = units.show(self.lvdt.range_m, "mm")
            problems.append((("limits", "position"), f"is beyond the LVDT's range; allowed: within +-{lvdt}"))
        return problems

    def _periods(self) -> list[Problem]:
        problems: list[Problem] = []
        for place, sensor in self._sensors().items():
            shortest = 2.0 / (sensor.rate_Hz * self.clock.device_rate)
            if sensor.stale_after_s < shortest:
                message = f"is less than two samples; allowed: at least {units.show(shortest, 'ms')}"
                problems.append(((*place, "stale_after"), message))
        shortest = 2.0 * max(self.actuator.poll_s, self.actuator.timeout_s)
        if self.actuator.watchdog_s < shortest:
            message = f"is less than two polls or time-outs; allowed: at least {units.show(shortest, 'ms')}"
            problems.append((("actuator", "watchdog"), message))
        if self.ecu.stale_after_s < 2.0 * self.ecu.command_period_s:
            shortest = 2.0 * self.ecu.command_period_s
            message = f"is less than two status frames; allowed: at least {units.show(shortest, 'ms')}"
            problems.append((("ecu", "stale_after"), message))
        return problems


def _located(problems: list[Problem]) -> PydanticCustomError:
    """An error of a whole section that names the places inside it."""
    return PydanticCustomError("inconsistent", "entries contradict each other", {"problems": problems})
