"""What a point's journal says about itself in its header: everything the finaliser needs besides the samples.

What no rig records, although every check sum fits, is named and refused before anything is computed with it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from rig.recording.journal.journal_file import JournalProblem
from rig.recording.layout import Records
from rig.signals.chunked_column import parts
from rig.signals.waveform import is_waveform

CURRENT_STEP = "current_step"
Range = tuple[float, float]
POINT: dict[str, Range] = {
    "amplitude_m": (0.0, 10.0), "frequency_Hz": (1e-6, 1e4), "current_A": (-1e3, 1e3), "cycles": (0.0, 1e6),
}
SENSOR: dict[str, Range] = {
    "rate_Hz": (1e-3, 1e7), "delay_s": (-10.0, 10.0), "range_SI": (0.0, 1e12), "sensitivity": (-1e12, 1e12),
    "offset": (-1e12, 1e12),
}
CONTEXT: dict[str, Range] = {
    "device_rate": (1e-4, 1e5), "controller_delay_s": (-10.0, 10.0), "mid_stroke_m": (-10.0, 10.0),
    "moving_mass_kg": (0.0, 1e6), "current_tolerance_A": (0.0, 1e3),
}
HOST_NS: Range = (0, 1 << 60)
"""Monotonic time of the host: 36 years."""
DEVICE_US: Range = (-1, 1 << 50)
"""A device's own clock, -1 where it has none: 35 years."""
LONGEST_NS = 30 * 24 * 3600 * 10**9
"""From a point's first record to its last."""


@dataclass(frozen=True)
class SensorContext:
    """One sensor channel as the bench file declares it (SI units).

    `delay_s` is the declared group delay of its conditioner (None: not stated, taken as 0); `range_SI` the full scale
    (None: unknown); `sensitivity` is SI per unit on the wire, `offset` in SI; dates are ISO 8601 text.
    `bandwidth_Hz` is what its conditioner passes (-3 dB; None: not stated). `uncertainty_percent` is the standard
    uncertainty of the sensitivity (None: not stated); `overdue`: the calibration was past its due date. `format` names
    what it sends: a preset of `protocols.line_format`, or `frame16`.
    """

    sensor: str
    rate_Hz: float
    delay_s: float | None = 0.0
    range_SI: float | None = None
    unit: str = ""
    long_name: str = ""
    sensitivity: float = 1.0
    offset: float = 0.0
    serial_number: str = ""
    certificate: str = ""
    due: str = ""
    uncertainty_percent: float | None = None
    overdue: bool = False
    format: str = ""
    bandwidth_Hz: float | None = None

    @property
    def declared_s(self) -> float:
        """The delay to take off, s."""
        return 0.0 if self.delay_s is None else self.delay_s


@dataclass(frozen=True)
class WantedPoint:
    """What the matrix asked of a point, as far as a recording is judged by it.

    Attributes:
        id: the point's; `waveform`, `kind` as in `rig.matrix.point.TestPoint`.
        amplitude_m, frequency_Hz, current_A, cycles: the wanted values, 0 where there is none.
        commanded_amplitude_m: of the program that made the motion; None: not known.
        amplitude_tolerance: relative, of a command that was compensated; None: the usual limits.
        temperature_window_degC: of the coil; None: any.
        steps_A: levels of a current that is stepped.
    """

    id: str
    waveform: str
    kind: str
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    cycles: float
    commanded_amplitude_m: float | None
    amplitude_tolerance: float | None
    temperature_window_degC: tuple[float, float] | None
    steps_A: tuple[float, ...]

    @property
    def standing(self) -> bool:
        """Whether the rod stands still while the current is stepped."""
        return self.kind == CURRENT_STEP

    @classmethod
    def read(cls, point: Mapping[str, Any]) -> WantedPoint:
        """The point of a journal's header."""
        low, high = point.get("temperature_low_degC"), point.get("temperature_high_degC")
        kind, steps_A = str(point.get("kind", "loop")), str(point.get("steps_A", "")).split()
        return cls(
            id=str(point.get("id", "")), waveform=str(point.get("waveform", "sine")), kind=kind,
            amplitude_m=float(point.get("amplitude_m", 0.0)), frequency_Hz=float(point.get("frequency_Hz", 0.0)),
            current_A=float(point.get("current_A", 0.0)), cycles=float(point.get("cycles", 0.0)),
            commanded_amplitude_m=point.get("commanded_amplitude_m"),
            amplitude_tolerance=point.get("amplitude_tolerance"),
            temperature_window_degC=None if low is None or high is None else (float(low), float(high)),
            steps_A=tuple(map(float, steps_A)) if kind == CURRENT_STEP else (),
        )


@dataclass(frozen=True)
class PointContext:
    """The header of a point's journal.

    Attributes:
        point: the fields of `rig.matrix.point.TestPoint` (`dataclasses.asdict`): `id`, `waveform`, `amplitude_m`,
            `frequency_Hz`, `current_A`, `cycles`, `ramp_in_cycles`, `ramp_out_cycles`, `centre_m`, `repeat`, `rest_s`.
        sensors: sensor by channel name: `force`, `displacement`, `auxiliary_1` ... as in `rig.recording.channel`.
        device_rate: seconds of device clock per second of wall time (bench `[clock] device_rate`).
        controller_delay_s: delay of the controller's own position and force inputs (bench `[actuator] input_delay`),
            against which the sensors' delays are checked; None when it may not be relied on.
        mid_stroke_m: the specimen's mid-stroke in the displacement sensor's coordinate; None when unknown.
        moving_mass_kg: mass between load cell and damper; its inertia is part of the measured force.
        current_tolerance_A: largest deviation of measured from wanted current in a valid point.
        simulated: True when no real damper was tested.
        calibration: what is known of the instruments before the point, by attribute of `/entry/quality`: what the bench
            allows them to differ by, and what they showed at rest before the first motion.
        provenance: flat text attributes: software version, bench and matrix names and hashes, device identities,
            start time (UTC, ISO 8601), operator.
    """

    point: Mapping[str, Any]
    sensors: Mapping[str, SensorContext]
    device_rate: float = 1.0
    controller_delay_s: float | None = None
    mid_stroke_m: float | None = None
    moving_mass_kg: float = 0.0
    current_tolerance_A: float = 0.02
    simulated: bool = False
    calibration: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)

    @property
    def wanted(self) -> WantedPoint:
        """What the matrix asked of the point."""
        return WantedPoint.read(self.point)

    def to_json(self) -> str:
        """One line of JSON that `from_json` turns back into an equal context."""
        return json.dumps(asdict(self), allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> PointContext:
        """Read `to_json`'s line again.

        Raises:
            ValueError: the text is not JSON of this shape; the message says what is wrong.
        """
        try:
            raw = json.loads(text)
            sensors = {name: SensorContext(**entry) for name, entry in raw.pop("sensors").items()}
            context = cls(sensors=sensors, **raw)
        except (AttributeError, KeyError, RecursionError, TypeError) as error:
            raise ValueError(f"journal header is not a point's context: {error}") from error
        if not isinstance(context.point, dict) or not isinstance(context.provenance, dict):
            raise ValueError("journal header is not a point's context: point and provenance are not both objects")
        return context


def checked_context(context: PointContext, name: str) -> PointContext:
    """The context of the point called `name`, with numbers that a rig can have.

    Raises:
        JournalProblem: one line with each number that cannot be.
    """
    point = context.point
    problems = _outside("point", point, POINT, needed=tuple(POINT))
    problems += _outside("header", vars(context), CONTEXT, needed=("device_rate",))
    if not is_waveform(point.get("waveform")):
        problems.append(f"point: waveform = {point.get('waveform')!r:.40}, expected its name")
    for channel in ("force", "displacement"):
        if channel not in context.sensors:
            problems.append(f"no sensor {channel}")
    for channel, sensor in context.sensors.items():
        problems += _outside(channel, vars(sensor), SENSOR, needed=("rate_Hz",))
        problems += [f"{channel}: {key} is no text" for key in ("sensor", "unit", "long_name")
                     if not isinstance(vars(sensor)[key], str)]
    if problems:
        raise JournalProblem("the header holds what no rig records: " + "; ".join(problems))
    return replace(context, point={**point, "id": name})


def _outside(
    place: str, values: Mapping[str, object], ranges: Mapping[str, Range], needed: tuple[str, ...],
) -> list[str]:
    problems = []
    for key, (low, high) in ranges.items():
        value = values.get(key)
        if value is None and key not in needed:
            continue
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not (is_number and low <= value <= high):  # type: ignore[operator] # a number where the first half holds
            problems.append(f"{place}: {key} = {value!r:.40}, expected {low:g} to {high:g}")
    return problems


def check_records(channels: Mapping[str, Records]) -> None:
    """Refuse times that no clock shows.

    Raises:
        JournalProblem: naming the channel, the time and the range.
    """
    for name, records in channels.items():
        for key, (low, high) in (("host_ns", HOST_NS), ("device_us", DEVICE_US)):
            least, greatest = _extremes(records, key)
            if least < low or greatest > high:
                raise JournalProblem(f"{name}: {key} from {least} to {greatest}, expected {low} to {high}")
            if key == "host_ns" and greatest - least > LONGEST_NS:
                raise JournalProblem(f"{name}: records {1e-9 * (greatest - least):.0f} s apart; a point takes a month")


def _extremes(records: Records, key: str) -> tuple[int, int]:
    columns = [np.asarray(records[rows][key]) for rows in parts(len(records))]
    return min(int(part.min()) for part in columns if len(part)), max(int(part.max()) for part in columns if len(part))
