"""The settings of load cell, LVDT and auxiliary channels, and their calibration: frozen values (see `settings`)."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import date
from typing import Annotated, Any, Literal

from drivers.catalogue import check_sensor_format, sensor_format_names
from drivers.connection import CanAddress, LineSettings
from drivers.plugins import BrokenPlugIn
from drivers.sensor_formats import described_format, is_can, registers_of
from protocols.binary_format import BinaryFormat
from protocols.descriptions import Problem
from protocols.near_miss import near_names
from protocols.sensor_format import modbus_framing, modbus_request
from rig import units
from rig.bench import address
from rig.files.described import DescribedBy, described
from rig.files.names import is_file
from rig.files.network_text import NETWORK
from rig.files.quantity import Check, Quantity, Settings, Text, Wording, key

# A limit outside these is a slip of the pen, not a damper test rig (fault row `config-absurd`).
Force = Annotated[float, Quantity("force", "0 N", "200 kN", above=True)]
Timeout = Annotated[float, Quantity("time", "5 ms", "5 s")]
Delay = Annotated[float, Quantity("time", "0 s", "100 ms")]

Name = Annotated[str, Text(64, r"^[^\x00-\x1f]+$", Wording("1 to 64 characters on one line", "bench 2"))]
ChannelName = Annotated[
    str,
    Text(
        32, r"^[a-z][a-z0-9_]*$",
        Wording("a lower-case letter, then lower-case letters, digits or _ (32 at most)", "oil_pressure"),
    ),
]  # fmt: skip
RESERVED_NAMES = frozenset({"time", "force", "displacement", "velocity", "current", "coil_temperature"})


def _positive(value: float) -> float:
    if value < 0:
        raise ValueError(f'too small; to invert the sign, write sensitivity = {-value:g} and polarity = "reversed"')
    if value == 0:
        raise ValueError("too small (allowed: greater than 0)")
    return value


WireValue = str | int | float
"""A value on the wire: a bare number, or one with its unit, such as "2 mV/V", which the format's unit must be."""
CalibrationPoint = tuple[WireValue, str]
_WIRE = re.compile(rf"\s*({units.NUMBER})\s*([^\s\d.+-]\S*)?\s*", re.ASCII)


def wire_number(value: WireValue) -> float:
    """The number of a value on the wire.

    Raises:
        rig.units.UnitProblem: there is no number.
    """
    if not isinstance(value, str):
        return float(value)
    match = _WIRE.fullmatch(value)
    if match is None:
        raise units.UnitProblem(f'{value!r} is not a valid sensor output, such as 1234 or "2 mV/V"')
    return float(match[1])


def wire_unit(value: WireValue) -> str:
    """The unit of a value on the wire; empty where none is written."""
    match = _WIRE.fullmatch(value) if isinstance(value, str) else None
    return match[2] or "" if match else ""


@dataclass(frozen=True, kw_only=True)
class Calibration(Settings):
    """How the value on the wire becomes SI: `sensitivity * wire - offset`, times -1 where polarity is reversed.

    The polarity is applied in one place: all other code computes with a sensor's own `sensitivity` and `offset`. In
    place of a sensitivity there may be two points, or a rated output with its capacity.
    """

    sensitivity: Annotated[float, Check(_positive)] = field(
        default=1.0,
        metadata=key(description="SI units per unit sent by the sensor", json_schema_extra={"exclusiveMinimum": 0}),
    )
    polarity: Literal["normal", "reversed"] = field(
        default="normal", metadata=key(description="reversed: positive values mean compression")
    )
    offset: str | None = field(default=None, metadata=key(description="sensor reading at zero, with its unit"))
    points: tuple[CalibrationPoint, CalibrationPoint] | None = field(
        default=None,
        metadata=key(
            description="two points from the certificate instead of a sensitivity, each [value sent, true value]",
            examples=[[["0.002 mV/V", "0 N"], ["2.001 mV/V", "10 kN"]]],
        ),
    )
    rated_output: WireValue | None = field(
        default=None,
        metadata=key(description="value sent by the sensor at rated load (instead of a sensitivity)", examples=["2 "
            "mV/V"]),
    )
    capacity: str | None = field(default=None, metadata=key(description="load at the rated output", examples=["10 kN"]))
    zero: WireValue | None = field(
        default=None, metadata=key(description="value sent by the sensor at zero load, if a rated output is "
            "specified", examples=["0.01 mV/V"])
    )
    serial_number: Name = field(metadata=key(examples=["LC-1234"]))
    certificate: str = field(default="", metadata=key(max_length=128))
    uncertainty_percent: float | None = field(
        default=None,
        metadata=key(ge=0.0, le=20.0, description="standard uncertainty of the sensitivity, in % of the reading"),
    )
    due: date | None = None

    @property
    def sign(self) -> float:
        """-1 where the polarity is reversed."""
        return -1.0 if self.polarity == "reversed" else 1.0

    def line(self, dimension: str) -> tuple[float, float]:
        """Sensitivity (SI per unit on the wire) and offset (SI), the polarity not applied.

        Raises:
            rig.units.UnitProblem: a value has another dimension or unit.
        """
        if self.points is not None:
            (low, low_text), (high, high_text) = self.points
            low_wire, high_wire = wire_number(low), wire_number(high)
            low_SI, high_SI = units.parse(low_text, dimension), units.parse(high_text, dimension)
            slope = (high_SI - low_SI) / (high_wire - low_wire) if high_wire != low_wire else math.nan
            return slope, slope * low_wire - low_SI
        if self.rated_output is not None and self.capacity is not None:
            rated = wire_number(self.rated_output)
            slope = units.parse(self.capacity, dimension) / rated if rated else math.nan
            return slope, slope * wire_number(self.zero) if self.zero is not None else 0.0
        return self.sensitivity, 0.0 if self.offset is None else units.parse(self.offset, dimension)

    def problems_with(self, dimension: str) -> Iterator[Problem]:
        """What contradicts itself, or is not of the sensor's dimension."""
        ways = [name for name in ("points", "rated_output") if getattr(self, name) is not None]
        if len(ways) > 1:
            yield ("points",), "cannot be combined with a rated output. Fix: keep only one of the two"
        for name in ("sensitivity", "offset"):
            if ways and getattr(self, name) != (1.0 if name == "sensitivity" else None):
                yield (name,), f"cannot be combined with {ways[0]}. Fix: keep only one of the two"
        for name, needed in (("capacity", "rated_output"), ("zero", "rated_output"), ("rated_output", "capacity")):
            if getattr(self, name) is not None and getattr(self, needed) is None:
                yield (name,), f"requires {needed}"
        try:
            slope, _ = self.line(dimension)
        except units.UnitProblem as problem:
            yield (ways[0] if ways else "offset",), str(problem)
            return
        if not 0.0 < slope < math.inf:
            way_out = (
                "the load decreases as the value sent by the sensor increases. Fix: write the loads with the opposite "
                'sign, and polarity = "reversed"'
            )
            yield (ways[0] if ways else "sensitivity",), way_out if slope < 0.0 else (
                "the slope between the two points is zero"
            )


def _known_format(value: str) -> str:
    known = sensor_format_names()
    if value not in known:
        near = near_names(value, known)
        raise ValueError(
            f"unknown format; {f'did you mean {near[0]}? ' if near else ''}known: {', '.join(known)}, the name of a "
            ".toml file, or a table that describes the format"
        )
    try:
        check_sensor_format(value)
    except BrokenPlugIn as error:
        raise ValueError(str(error)) from error
    return value


@dataclass(frozen=True, kw_only=True)
class SensorConfig(Settings):
    """What load cell, LVDT and auxiliary channels have in common: how to reach one, how to read it, its calibration."""

    url: Annotated[str, Text(256), Check(address.serial_url)] | None = field(
        default=None, metadata=key(
            examples=["/dev/ttyUSB0", "socket://192.168.0.7:4001"], description="port of the sensor; a sensor on CAN "
                "has interface and channel instead"
        )
    )
    interface: Annotated[str, Text(256), Check(address.can_interface)] | None = field(
        default=None, metadata=key(examples=["socketcan"], description="for a sensor on CAN only; can be the "
            "bus of the ECU")
    )
    channel: Name | None = field(default=None, metadata=key(examples=["can0"], description="for a sensor on CAN only"))
    bitrate: int = field(
        default=500_000, metadata=key(ge=10_000, le=1_000_000, description="for a sensor on CAN only")
    )
    interface_options: dict[str, str | int | float | bool] = field(
        default_factory=dict, metadata=key(description="further arguments for the CAN interface, named as in "
            "python-can")
    )
    baudrate: int = field(default=921_600, metadata=key(ge=300, le=12_000_000))
    parity: Literal["N", "E", "O"] = field(default="N", metadata=key(description="serial line only"))
    data_bits: Literal[7, 8] = field(default=8, metadata=key(description="serial line only"))
    stop_bits: Literal[1, 2] = field(default=1, metadata=key(description="serial line only"))
    format: Annotated[str | dict[str, Any], DescribedBy("sensor-format", _known_format)] = field(
        default="frame16",
        metadata=key(
            description="name of a format, name of a .toml file (relative to the bench file's folder), or a table "
                "(rig schema sensor-format)"
        ),
    )
    rate_Hz: Annotated[float, Quantity("frequency", "1 Hz", "50 kHz")] = field(metadata=key("rate"))
    stale_after_s: Timeout = field(default=0.020, metadata=key("stale_after"))
    delay_s: Delay | None = field(
        default=None,
        metadata=key(
            "delay",
            description="group delay of the conditioner's filter (default: 0, with an uncertainty unless checked)",
        ),
    )
    bandwidth_Hz: Annotated[float, Quantity("frequency", "0 Hz", "1000 kHz", above=True)] | None = field(
        default=None,
        metadata=key("bandwidth", description="-3 dB bandwidth of the sensor and conditioner; used by `rig plan`"),
    )
    calibration: Calibration

    @property
    def described(self) -> str | dict[str, Any]:
        """Its format as drivers take it: a name, or the table of a description.

        Raises:
            FileProblem: its file cannot be used any more.
        """
        table: str | dict[str, Any] = described("sensor-format", self.format)
        return table

    @property
    def bus(self) -> CanAddress | None:
        """CAN bus of the sensor; None for a sensor on a port."""
        if self.url is not None or self.interface is None or self.channel is None:
            return None
        return CanAddress(self.interface, self.channel, self.bitrate, self.interface_options)

    @property
    def port(self) -> str:
        """Port of the sensor, or its CAN bus in the notation of `EcuConfig.port`."""
        bus = self.bus
        return self.url or "" if bus is None else bus.text

    @property
    def reading(self) -> object | None:
        """Registers or signal that the sensor reads on a shared connection; None: not shareable."""
        table = self.described
        if is_can(table):
            made = described_format(table)
            return (made.can.key, made.fields["value"]) if isinstance(made, BinaryFormat) and made.can else None
        return modbus_request(table) or None

    @property
    def line(self) -> LineSettings:
        """Settings of its serial line."""
        return LineSettings(self.baudrate, self.data_bits, self.parity, self.stop_bits)

    @property
    def label(self) -> str:
        """Its name in messages and in the recording."""
        raise NotImplementedError

    @property
    def dimension(self) -> str:
        """Dimension of the value, a key of `rig.units.DIMENSIONS`."""
        raise NotImplementedError

    @property
    def span(self) -> float:
        """The largest SI value it can show (saturation)."""
        raise NotImplementedError

    @property
    def sensitivity(self) -> float:
        """SI units per unit sent by the sensor; negative where the polarity is reversed."""
        return self.calibration.sign * self.calibration.line(self.dimension)[0]

    @property
    def offset(self) -> float:
        """What `sensitivity * wire` is at zero, in the SI unit of this sensor; its sign follows the polarity."""
        return self.calibration.sign * self.calibration.line(self.dimension)[1]

    @property
    def not_physics(self) -> dict[str, Any]:
        """What does not count for `Bench.digest`; a polarity that is as ever does not either."""
        link = (
            "url", "baudrate", "parity", "data_bits", "stop_bits", "stale_after_s", "bandwidth_Hz", "interface",
            "channel", "bitrate", "interface_options",
        )
        given = self.calibration
        usual = {name for name in ("points", "rated_output", "capacity", "zero") if getattr(given, name) is None}
        usual |= {"polarity"} if given.polarity == "normal" else set()
        return {**dict.fromkeys(link, True), "calibration": usual}

    def problems(self) -> Iterator[Problem]:
        """A calibration has the sensor's own dimension."""
        for place, text in (*self.calibration.problems_with(self.dimension), *self._unit_problems()):
            yield ("calibration", *place), text
        yield from self._link_problems()
        if (self.url or "").startswith("modbus-tcp://") and modbus_framing(self.described) != "tcp":
            yield ("url",), (
                'modbus-tcp:// requires a format of kind "modbus" with framing "tcp". Fix: specify such a format, or '
                "write socket:// for another protocol"
            )
        yield from self._modbus_problems()

    def _modbus_problems(self) -> Iterator[Problem]:
        """Modbus TCP needs a network; on a serial line a device has one of the addresses of Modbus RTU."""
        framing, url = modbus_framing(self.described), self.url or ""
        if framing == "tcp" and url and not url.startswith(("modbus-tcp://", "socket://")):
            yield ("url",), (
                "is a serial port, but the format has framing \"tcp\" (the default). Fix: specify framing = \"rtu\" in "
                "the format"
            )
        registers = registers_of(self.described)
        if registers is not None and registers.rtu and not 1 <= registers.unit <= address.LAST_SERIAL_ID:
            yield ("format", "device_id"), (
                f"invalid for Modbus RTU; allowed: 1 to {address.LAST_SERIAL_ID}"
            )

    def _link_problems(self) -> Iterator[Problem]:
        """Check that a sensor has either a port or (on CAN) interface and channel."""
        if is_can(self.described):
            if self.url is not None:
                yield ("url",), "the format is a CAN message. Fix: specify interface and channel instead of url"
            for name, example in (("interface", "socketcan"), ("channel", "can0")):
                if getattr(self, name) is None:
                    yield (name,), f'is missing; the format is a CAN message. Fix: add it, such as {name} = "{example}"'
            return
        if self.url is None:
            yield ("url",), 'is missing; write the port of the sensor, such as url = "/dev/ttyUSB0"'
        for name in ("interface", "channel"):
            if getattr(self, name) is not None:
                yield (name,), "applies only to a sensor whose format is a CAN message (kind \"can\")"

    def _unit_problems(self) -> Iterator[Problem]:
        """The format's unit, where it states one, is the calibration's."""
        given, table = self.calibration, self.described
        unit = "" if isinstance(table, str) else str(table.get("unit", ""))
        if is_can(table):
            unit = described_format(table).unit
        if not unit:
            return
        for name in ("points", "rated_output", "zero"):
            values = getattr(given, name) or ()
            for value in [wire for wire, _ in values] if name == "points" else [values]:
                if wire_unit(value or 0) not in {"", unit}:
                    yield (name,), (
                        f"the format's unit is {unit}. Fix: write these values in this unit, or without a "
                        "unit"
                    )
                    break
        # A table stands beside its calibration; the numbers of a file are not known here.
        in_file = is_file(self.format) or (isinstance(table, dict) and NETWORK in table)
        known = units.UNITS.get(units.ALIASES.get(unit, unit)) if in_file else None
        usual = given.sensitivity == 1.0 and given.points is None and given.rated_output is None
        if known is not None and usual and not (known.dimension == self.dimension and known.scale == 1.0):
            if known.dimension == self.dimension:
                yield ("sensitivity",), f"the format's unit is {unit}; write sensitivity = {known.scale!r}"
            else:
                message = (
                    f"the format's unit is {unit}, which is not a unit of {self.dimension}. Fix: specify a "
                    "sensitivity"
                )
                yield ("sensitivity",), message


@dataclass(frozen=True, kw_only=True)
class LoadCell(SensorConfig):
    """The force sensor."""

    range_N: Force = field(metadata=key("range"))

    @property
    def label(self) -> str:
        """`load_cell`."""
        return "load_cell"

    @property
    def dimension(self) -> str:
        """Force."""
        return "force"

    @property
    def span(self) -> float:
        """Its range (N)."""
        return self.range_N


@dataclass(frozen=True, kw_only=True)
class Lvdt(SensorConfig):
    """The displacement sensor."""

    range_m: Annotated[float, Quantity("length", "0 m", "1 m", above=True)] = field(metadata=key("range"))

    @property
    def label(self) -> str:
        """`lvdt`."""
        return "lvdt"

    @property
    def dimension(self) -> str:
        """Length."""
        return "length"

    @property
    def span(self) -> float:
        """Its range (m)."""
        return self.range_m


def _not_reserved(value: str) -> str:
    if value in RESERVED_NAMES:
        raise ValueError(f"is reserved for a standard channel; reserved names: {', '.join(sorted(RESERVED_NAMES))}")
    return value


def _known_unit(value: str) -> str:
    if units.ALIASES.get(value, value) not in units.UNITS:
        raise ValueError(f"unknown unit; known: {', '.join(units.UNITS)}")
    return value


@dataclass(frozen=True, kw_only=True)
class Auxiliary(SensorConfig):
    """One further channel: recorded beside the others, never used for control."""

    name: Annotated[ChannelName, Check(_not_reserved)]
    unit: Annotated[str, Check(_known_unit)]
    range: str

    @property
    def label(self) -> str:
        """Its name."""
        return self.name

    @property
    def dimension(self) -> str:
        """The dimension of `unit`."""
        return units.UNITS[units.ALIASES.get(self.unit, self.unit)].dimension

    @property
    def span(self) -> float:
        """Full scale in the SI unit of `unit`."""
        return units.parse(self.range, self.dimension)

    def problems(self) -> Iterator[Problem]:
        """Range and offset have the dimension of `unit`."""
        yield from super().problems()
        try:
            if not self.span > 0:
                yield ("range",), "must be greater than 0"
        except units.UnitProblem as problem:
            yield ("range",), str(problem)
