"""What the station is told when it starts: plain frozen values, written to and read from one JSON file.

The application builds a `StationConfig` from bench and matrix; the station knows neither of those files.
Every number is SI; durations are wall seconds unless the name says otherwise.
"""

from __future__ import annotations

import dataclasses
import json
import math
import types
import typing
from dataclasses import dataclass, field
from typing import Any, TypeVar

from rig.station.errors import ConfigProblem

T = TypeVar("T")

ECU_STATUS_Hz = 100.0


@dataclass(frozen=True)
class Limits:
    """What the rig may do; the interlocks trip beyond these values, speed and current beyond `Margins`."""

    position_min_m: float
    position_max_m: float
    speed_m_s: float
    acceleration_m_s2: float
    force_N: float
    current_A: float
    coil_temperature_degC: float


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


@dataclass(frozen=True)
class ActuatorConfig:
    """How to reach the actuator controller, and what it is told at `arm`."""

    url: str
    baudrate: int = 115_200
    parity: str = "N"
    device_id: int = 1
    register_map: str = "demo"
    poll_s: float = 0.010
    timeout_s: float = 0.040
    stale_after_s: float = 0.150
    watchdog_s: float = 0.500
    fade_out_cycles: float = 1.0
    halt_deceleration_m_s2: float = 20.0
    serial_number: str | None = None


@dataclass(frozen=True)
class EcuConfig:
    """How to reach the current ECU."""

    interface: str
    channel: str
    bitrate: int = 500_000
    dbc: str = "demo"
    command_period_s: float = 0.010
    stale_after_s: float = 0.030
    serial_number: int | None = None


@dataclass(frozen=True)
class SensorConfig:
    """One serial sensor: how to reach it, how to read it, how its wire value becomes SI.

    `format` is a preset's name or a line description (mapping). The SI value is `sensitivity * wire - offset`.
    `span` is the largest SI value it can show (saturation), `spike_jump` the change between two samples that physics
    cannot make (flagged; trips when three in a row stay there).
    """

    name: str
    url: str
    rate_Hz: float
    span: float
    stale_after_s: float
    baudrate: int = 921_600
    format: str | dict[str, Any] = "frame16"
    sensitivity: float = 1.0
    offset: float = 0.0
    spike_jump: float = math.inf


@dataclass(frozen=True)
class StationConfig:
    """Everything the station needs.

    `device_rate` is how fast the devices' clocks run against the wall (1 on hardware, the simulated rig's speed there).
    A time for which the station itself did not watch is recorded from `late_after_s` on and stops the rig beyond
    `late_limit_s`. `owner_id` is the lease at the controller, 1..65535; 0 has the station draw one at random.
    """

    actuator: ActuatorConfig
    ecu: EcuConfig
    load_cell: SensorConfig
    lvdt: SensorConfig
    limits: Limits
    ring_path: str
    auxiliary: tuple[SensorConfig, ...] = ()
    margins: Margins = field(default_factory=Margins)
    ring_capacity: int = 1 << 19
    device_rate: float = 1.0
    heartbeat_timeout_s: float = 0.500
    late_after_s: float = 0.020
    late_limit_s: float = 0.050
    disagreement_m: float = 0.005
    real_time: bool = True
    owner_id: int = 0
    disabled_detectors: tuple[str, ...] = ()

    @property
    def periods_s(self) -> list[float]:
        """At which periods the devices are heard (wall s): polls, samples, the ECU's status frames."""
        rates_Hz = [sensor.rate_Hz for sensor in (self.load_cell, self.lvdt, *self.auxiliary)]
        return [self.actuator.poll_s, *(1.0 / (rate_Hz * self.device_rate) for rate_Hz in (*rates_Hz, ECU_STATUS_Hz))]

    def to_json(self) -> str:
        """This configuration as JSON text."""
        return json.dumps(dataclasses.asdict(self), indent=1)


def from_json(text: str) -> StationConfig:
    """Read what `StationConfig.to_json` wrote.

    Raises:
        ConfigProblem: not JSON, or an entry is missing, unknown, of the wrong type or out of range; all are named.
    """
    try:
        data = json.loads(text)
    except ValueError as error:
        raise ConfigProblem(f"the station's configuration is not JSON: {error}") from error
    config = _build(StationConfig, data, "")
    _check_ranges(config)
    return config


def _build(cls: type[T], data: object, where: str) -> T:
    if not isinstance(data, dict):
        raise ConfigProblem(f"{where or 'configuration'}: expected a mapping, got {data!r}")
    hints = typing.get_type_hints(cls)
    known = {item.name: item for item in dataclasses.fields(cls)}  # type: ignore[arg-type]  # only dataclasses come here
    problems = [f"{where}{key}: unknown entry" for key in data if key not in known]
    values: dict[str, Any] = {}
    for name, item in known.items():
        if name in data:
            values[name] = _convert(hints[name], data[name], f"{where}{name}")
        elif item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING:
            problems.append(f"{where}{name}: missing")
    if problems:
        raise ConfigProblem("; ".join(problems))
    return cls(**values)


def _convert(hint: object, value: object, where: str) -> object:
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        return _build(hint, value, f"{where}.")
    origin = typing.get_origin(hint)
    if origin is tuple and isinstance(value, list):
        inner = typing.get_args(hint)[0]
        return tuple(_convert(inner, item, f"{where}[{index}]") for index, item in enumerate(value))
    choices = typing.get_args(hint) if origin is types.UnionType else (hint,)
    for choice in choices:
        if choice is float and isinstance(value, int) and not isinstance(value, bool):
            return float(value)
        if _fits(typing.get_origin(choice) or choice, value):
            return value
    raise ConfigProblem(f"{where}: expected {hint}, got {value!r}")


def _fits(kind: object, value: object) -> bool:
    if isinstance(value, bool):
        return kind is bool
    if isinstance(value, float) and math.isnan(value):
        return False
    return isinstance(kind, type) and isinstance(value, kind)


def _check_ranges(config: StationConfig) -> None:
    limits = config.limits
    positive = {
        "limits.speed_m_s": limits.speed_m_s,
        "limits.acceleration_m_s2": limits.acceleration_m_s2,
        "limits.force_N": limits.force_N,
        "limits.current_A": limits.current_A,
        "actuator.poll_s": config.actuator.poll_s,
        "actuator.timeout_s": config.actuator.timeout_s,
        "actuator.stale_after_s": config.actuator.stale_after_s,
        "actuator.watchdog_s": config.actuator.watchdog_s,
        "ecu.command_period_s": config.ecu.command_period_s,
        "ecu.stale_after_s": config.ecu.stale_after_s,
        "device_rate": config.device_rate,
        "heartbeat_timeout_s": config.heartbeat_timeout_s,
        "late_after_s": config.late_after_s,
        "late_limit_s": config.late_limit_s,
        "ring_capacity": config.ring_capacity,
    }
    for sensor in (config.load_cell, config.lvdt, *config.auxiliary):
        positive[f"{sensor.name}.rate_Hz"] = sensor.rate_Hz
        positive[f"{sensor.name}.stale_after_s"] = sensor.stale_after_s
        positive[f"{sensor.name}.span"] = sensor.span
    problems = [f"{key}: expected a value above 0, got {value}" for key, value in positive.items() if not value > 0]
    if not limits.position_min_m < limits.position_max_m:
        problems.append(f"limits: position_min_m {limits.position_min_m} is not below {limits.position_max_m}")
    if len(config.auxiliary) > 7:
        problems.append(f"auxiliary: at most 7 channels, got {len(config.auxiliary)}")
    if problems:
        raise ConfigProblem("; ".join(problems))
