"""The settings of load cell, LVDT and auxiliary channels, and their calibration: frozen values (see `settings`)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import date
from typing import Annotated, Any, Literal

from rig import units
from rig.bench import address
from rig.bench.quantity import Check, Problem, Quantity, Settings, Text, Wording, key

# A limit outside these is a slip of the pen, not a damper test rig (fault row `config-absurd`).
Force = Annotated[float, Quantity("force", "0 N", "200 kN", above=True)]
Timeout = Annotated[float, Quantity("time", "5 ms", "5 s")]
Delay = Annotated[float, Quantity("time", "0 s", "100 ms")]

LineValue = str | int | float | tuple[str, ...]
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
        raise ValueError(f'too small; for the other sign write sensitivity = {-value:g} and polarity = "reversed"')
    if value == 0:
        raise ValueError("too small (allowed: more than 0)")
    return value


@dataclass(frozen=True, kw_only=True)
class Calibration(Settings):
    """How the value on the wire becomes SI: `sensitivity * wire - offset`, times -1 where polarity is reversed.

    The polarity is applied in one place: everybody else computes with a sensor's own `sensitivity` and `offset`.
    """

    sensitivity: Annotated[float, Check(_positive)] = field(
        default=1.0,
        metadata=key(description="SI units per unit on the wire", json_schema_extra={"exclusiveMinimum": 0}),
    )
    polarity: Literal["normal", "reversed"] = field(
        default="normal", metadata=key(description="reversed: the sensor counts jounce, or compression, as positive")
    )
    offset: str | None = field(default=None, metadata=key(description="what the sensor shows at zero, with its unit"))
    serial_number: Name = field(metadata=key(examples=["LC-1234"]))
    certificate: str = field(default="", metadata=key(max_length=128))
    uncertainty_percent: float | None = field(
        default=None,
        metadata=key(ge=0.0, le=20.0, description="standard uncertainty of the sensitivity, % of the reading"),
    )
    due: date | None = None

    @property
    def sign(self) -> float:
        """-1 where the polarity is reversed."""
        return -1.0 if self.polarity == "reversed" else 1.0


def _known_format(value: object) -> str | dict[str, LineValue]:
    from drivers.catalogue import check_sensor_format, sensor_format_names
    from drivers.plugins import BrokenPlugIn
    from protocols.errors import LocalProtocolError
    from protocols.line_format import from_description

    if isinstance(value, str):
        known = list(sensor_format_names())
        if value not in known:
            raise ValueError(f"unknown format; known: {', '.join(known)}, or a table that describes a line")
        try:
            check_sensor_format(value)
        except BrokenPlugIn as error:
            raise ValueError(str(error)) from error
        return value
    if not isinstance(value, dict):
        raise ValueError("must be the name of a format in quotes, or a table that describes a line")
    try:
        from_description(value)
    except LocalProtocolError as error:
        raise ValueError(str(error)) from error
    return value


@dataclass(frozen=True, kw_only=True)
class SensorConfig(Settings):
    """What load cell, LVDT and auxiliary channels have in common: how to reach one, how to read it, its calibration."""

    url: Annotated[str, Text(256), Check(address.serial_url)] = field(
        metadata=key(examples=["/dev/ttyUSB0", "socket://192.168.0.7:4001"])
    )
    baudrate: int = field(default=921_600, metadata=key(ge=300, le=12_000_000))
    format: Annotated[str | dict[str, LineValue], Check(_known_format, alone=True)] = field(
        default="frame16",
        metadata=key(description="frame16, a line format preset, or a table that describes a line"),
    )
    rate_Hz: Annotated[float, Quantity("frequency", "1 Hz", "50 kHz")] = field(metadata=key("rate"))
    stale_after_s: Timeout = field(default=0.020, metadata=key("stale_after"))
    delay_s: Delay | None = field(
        default=None,
        metadata=key(
            "delay",
            description="group delay of the conditioner's filter; not stated: taken as 0, and uncertain unless checked",
        ),
    )
    bandwidth_Hz: Annotated[float, Quantity("frequency", "0 Hz", "1000 kHz", above=True)] | None = field(
        default=None,
        metadata=key("bandwidth", description="where sensor and conditioner have lost 3 dB; the plan looks at it"),
    )
    calibration: Calibration

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
        """SI units per unit on the wire; negative where the polarity is reversed."""
        return self.calibration.sign * self.calibration.sensitivity

    @property
    def offset(self) -> float:
        """What `sensitivity * wire` is at zero, in the SI unit of this sensor; its sign follows the polarity."""
        text = self.calibration.offset
        return 0.0 if text is None else self.calibration.sign * units.parse(text, self.dimension)

    @property
    def not_physics(self) -> dict[str, Any]:
        """What does not count for `Bench.digest`; a polarity that is as ever does not either."""
        link = dict.fromkeys(("url", "baudrate", "stale_after_s", "bandwidth_Hz"), True)
        return {**link, "calibration": {"polarity"} if self.calibration.polarity == "normal" else set()}

    def problems(self) -> Iterator[Problem]:
        """An offset has the sensor's own dimension."""
        try:
            _ = self.offset
        except units.UnitProblem as problem:
            yield ("calibration", "offset"), str(problem)


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
        raise ValueError(f"is the name of a channel every run has ({', '.join(sorted(RESERVED_NAMES))})")
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
                yield ("range",), "must be more than 0"
        except units.UnitProblem as problem:
            yield ("range",), str(problem)
