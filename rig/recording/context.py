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

LOOP = "loop"
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
    """What the matrix asked of a point and how its motion was commanded. What nobody stated is None.

    Attributes:
        id: name of the point's files.
        waveform: as in `rig.matrix.point.TestPoint`, like all up to `steps_A`.
        amplitude_m, frequency_Hz, current_A, cycles: the wanted values, 0 where there is none.
        ramp_in_cycles, ramp_out_cycles, centre_m, repeat, rest_s: the rest of the program.
        kind: `loop` where it is not stated.
        steps_A: levels of a current that is stepped, as one text.
        commanded_amplitude_m, commanded_centre_m: of the program that made the motion.
        amplitude_tolerance: relative, of a command that was compensated; None: the usual limits.
        temperature_low_degC, temperature_high_degC: window of the coil's temperature; None: any.
    """

    id: str
    waveform: str
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    cycles: float
    ramp_in_cycles: float | None = None
    ramp_out_cycles: float | None = None
    centre_m: float | None = None
    repeat: int | None = None
    rest_s: float | None = None
    kind: str | None = None
    steps_A: str | None = None
    commanded_amplitude_m: float | None = None
    commanded_centre_m: float | None = None
    amplitude_tolerance: float | None = None
    temperature_low_degC: float | None = None
    temperature_high_degC: float | None = None

    @property
    def loop(self) -> bool:
        """Whether it is a loop at a constant current."""
        return self.kind is None or self.kind == LOOP

    @property
    def standing(self) -> bool:
        """Whether the rod stands still while the current is stepped."""
        return self.kind == CURRENT_STEP

    @property
    def levels_A(self) -> tuple[float, ...]:
        """Levels of a current that is stepped, in turn; none of any other point."""
        return tuple(map(float, (self.steps_A or "").split())) if self.standing else ()

    @property
    def temperature_window_degC(self) -> tuple[float, float] | None:
        """What the coil's temperature had to lie in; None: any."""
        low_degC, high_degC = self.temperature_low_degC, self.temperature_high_degC
        return None if low_degC is None or high_degC is None else (low_degC, high_degC)

    def to_json(self) -> dict[str, Any]:
        """What was stated, by name."""
        return {name: value for name, value in vars(self).items() if value is not None}


@dataclass(frozen=True)
class PointContext:
    """The header of a point's journal.

    Attributes:
        point: what the matrix asked of it.
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

    point: WantedPoint
    sensors: Mapping[str, SensorContext]
    device_rate: float = 1.0
    controller_delay_s: float | None = None
    mid_stroke_m: float | None = None
    moving_mass_kg: float = 0.0
    current_tolerance_A: float = 0.02
    simulated: bool = False
    calibration: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)

    def to_json(self) -> str:
        """One line of JSON that `from_json` turns back into an equal context."""
        return json.dumps({**asdict(self), "point": self.point.to_json()}, allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> PointContext:
        """Read `to_json`'s line again.

        Raises:
            ValueError: the text is not JSON of this shape; the message says what is wrong.
        """
        try:
            raw = json.loads(text)
            sensors = {name: SensorContext(**entry) for name, entry in raw.pop("sensors").items()}
            context = cls(point=WantedPoint(**raw.pop("point")), sensors=sensors, **raw)
        except (AttributeError, KeyError, RecursionError, TypeError) as error:
            raise ValueError(f"journal header is not a point's context: {error}") from error
        if not isinstance(context.provenance, dict):
            raise ValueError("journal header is not a point's context: provenance is no object")
        return context


def checked_context(context: PointContext, name: str) -> PointContext:
    """The context of the point called `name`, with numbers that a rig can have.

    Raises:
        JournalProblem: one line with each number that cannot be.
    """
    point = context.point
    problems = _outside("point", vars(point), POINT, needed=tuple(POINT))
    problems += _outside("header", vars(context), CONTEXT, needed=("device_rate",))
    if not is_waveform(point.waveform):
        problems.append(f"point: waveform = {point.waveform!r:.40}, expected its name")
    for channel in ("force", "displacement"):
        if channel not in context.sensors:
            problems.append(f"no sensor {channel}")
    for channel, sensor in context.sensors.items():
        problems += _outside(channel, vars(sensor), SENSOR, needed=("rate_Hz",))
        problems += [f"{channel}: {key} is no text" for key in ("sensor", "unit", "long_name")
                     if not isinstance(vars(sensor)[key], str)]
    if problems:
        raise JournalProblem("the header holds what no rig records: " + "; ".join(problems))
    return replace(context, point=replace(point, id=name))


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
