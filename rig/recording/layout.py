"""The recorded data of a point: its journal's header and the contents of its file (`docs/files.md`, "A point's file").

`hdf5_image` writes it as HDF5.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from protocols.quality import NO_VALUE
from rig.signals.arrays import FloatArray
from rig.signals.chunked_column import Values

FORMAT_VERSION = 1
CHUNK_SAMPLES = 16384
#: One record of the ring and of the journal (32 bytes, `drivers.ring.RECORD`).
RECORD_DTYPE = np.dtype([
    ("host_ns", "<i8"), ("device_us", "<i8"), ("value", "<f8"), ("sequence", "<u4"), ("channel", "<u2"),
    ("flags", "<u2"),
])
Attribute = str | int | float | bool | Sequence[str] | None


class Records(Protocol):
    """Ring records (n,) of `RECORD_DTYPE`: an array, or a file read in parts (`point_journal`)."""

    def __len__(self) -> int: ...

    def __getitem__(self, key: Any, /) -> Any: ...  # noqa: ANN401 - an array, or one field of it


@dataclass(frozen=True)
class AlignedChannel:
    """One channel on the common time base: `values` (n,), NaN where nothing was measured, in `unit`.

    `attributes` are written beside the units: calibration, serial number, method.
    """

    name: str
    values: Values
    unit: str
    long_name: str
    sensor: str = ""
    attributes: Mapping[str, Attribute] = field(default_factory=dict)


@dataclass(frozen=True)
class RawChannel:
    """One channel as received: `records` (m,) of `RECORD_DTYPE`; `time_s` (m,) the same samples on the common clock.

    `time_s` is None when the channel has no clock model; delays declared in the bench file are removed from it.
    `value_attributes` say what was on the wire and how the values were made from it.
    """

    name: str
    records: Records
    unit: str
    long_name: str
    time_s: Values | None = None
    attributes: Mapping[str, Attribute] = field(default_factory=dict)
    value_attributes: Mapping[str, Attribute] = field(default_factory=dict)


@dataclass(frozen=True)
class Event:
    """Something that happened: time on the file's time base (ns), a slug, one line for people.

    In a journal `time_ns` is the host's monotonic clock; a file keeps that too, as `host_ns` (-1: not known).
    """

    time_ns: int
    code: str
    text: str
    host_ns: int = -1


@dataclass(frozen=True)
class PointFile:
    """Everything one file holds. `time_s` (n,) in seconds; `flags` (n,) as `protocols.quality.Quality`, None: all 0."""

    time_s: Values
    sample_rate_hz: float
    channels: Sequence[AlignedChannel]
    flags: Values | None = None
    signal: str = "force"
    raw: Sequence[RawChannel] = ()
    events: Sequence[Event] = ()
    test: Mapping[str, Attribute] = field(default_factory=dict)
    quality: Mapping[str, Attribute] = field(default_factory=dict)
    provenance: Mapping[str, Attribute] = field(default_factory=dict)
    title: str = ""


def check_of(values: NDArray[Any]) -> int:
    """CRC-32 of a dataset's values: HDF5 checks its chunks, but not the index that finds them."""
    return zlib.crc32(np.ascontiguousarray(values).tobytes())


@dataclass(frozen=True)
class Description:
    """Name of a channel's group under `/entry/raw`, SI unit of its values, one line for people."""

    name: str
    unit: str
    long_name: str


#: Channel number in the ring (`drivers.ring.Channel`) -> description.
RING_CHANNELS: dict[int, Description] = {
    1: Description("force", "N", "Force at the load cell"),
    2: Description("displacement", "m", "Damper extension"),
    **{3 + n: Description(f"auxiliary_{n + 1}", "1", f"Auxiliary channel {n + 1}") for n in range(7)},
    10: Description("coil_current", "A", "Coil current"),
    11: Description("coil_temperature", "degC", "Coil temperature"),
    12: Description("ecu_temperature", "degC", "Temperature of the current source"),
    13: Description("ecu_supply", "V", "Supply voltage of the current source"),
    14: Description("ecu_state", "1", "State of the current source"),
    15: Description("ecu_faults", "1", "Fault bits of the current source"),
    16: Description("commanded_current", "A", "Commanded coil current"),
    20: Description("position", "m", "Position by the actuator controller's own sensor"),
    21: Description("velocity", "m/s", "Velocity by the actuator controller"),
    22: Description("setpoint", "m", "Set-point of the actuator controller"),
    23: Description("state", "1", "State of the actuator controller"),
    24: Description("cycles_done", "1", "Whole cycles of the running program"),
    25: Description("fault_bits", "1", "Fault bits of the actuator controller"),
    26: Description("supply_pressure", "Pa", "Hydraulic supply pressure"),
    27: Description("accumulator_pressure", "Pa", "Accumulator pressure"),
    28: Description("pulse", "1", "Cycle pulses: count and the controller's clock at the pulse"),
    29: Description("phase", "1", "Phase of the running program"),
    30: Description("inputs", "1", "Digital inputs of the actuator controller"),
    31: Description("servo_error", "m", "Following error of the servo loop"),
    32: Description("controller_force", "N", "Coarse force input of the actuator controller"),
    40: Description("force_edge", "1", "Cycle pulses latched in the load cell's clock"),
    41: Description("displacement_edge", "1", "Cycle pulses latched in the displacement sensor's clock"),
    **{42 + n: Description(f"auxiliary_{n + 1}_edge", "1", f"Cycle pulses latched by auxiliary channel {n + 1}")
       for n in range(7)},
    50: Description("trip", "1", "Interlock trips"),
    51: Description("loop_late", "s", "Lateness of the station's loop"),
    60: Description("hybrid_time", "s", "Hybrid test: time since the road's beginning, as computed"),
    61: Description("hybrid_target", "m", "Hybrid test: where the specimen should be, about its centre"),
    62: Description("hybrid_seen", "m", "Hybrid test: where the specimen was seen at that step, about its centre"),
    63: Description("hybrid_body", "m", "Hybrid test: computed height of the body"),
    64: Description("hybrid_wheel", "m", "Hybrid test: computed height of the wheel"),
    65: Description("signal_time", "s", "Signal: time since its beginning, of each set-point"),
    66: Description("signal_target", "m", "Signal: where the rod was to be at that time, about its centre"),
}
#: Channel name -> number in the ring.
NUMBER: dict[str, int] = {description.name: number for number, description in RING_CHANNELS.items()}


def channel_name(number: int) -> str:
    """Name of a channel by its number in the ring."""
    description = RING_CHANNELS.get(number)
    return f"channel_{number}" if description is None else description.name


def good_values(records: NDArray[Any]) -> FloatArray:
    """Values (n,) in SI, NaN where the flags say that the value is not the physical quantity."""
    bad = (records["flags"] & np.uint16(NO_VALUE)) != 0
    return np.where(bad, np.nan, records["value"])


LOOP = "loop"
CURRENT_STEP = "current_step"
HYBRID = "hybrid"
SIGNAL = "signal"


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
    """What the matrix asked of a point and how its motion was commanded. What is not stated is None.

    Attributes:
        id: name of the point's files.
        waveform: as in `rig.matrix.point.TestPoint`, like all up to `steps_A`.
        amplitude_m, frequency_Hz, current_A, cycles: the wanted values, 0 where there is none.
        ramp_in_cycles, ramp_out_cycles, centre_m, repeat, rest_s: the rest of the program.
        kind: `loop` where it is not stated.
        steps_A: levels of a current that is stepped, as one text; of one that a law commands the first.
        law: of the current of a hybrid test; `current_A` is then the most it asks for, but for `passive`.
        commanded_amplitude_m, commanded_centre_m: of the program that made the motion.
        amplitude_tolerance: relative, of a command that was compensated; None: the usual limits.
        temperature_low_degC, temperature_high_degC: window of the coil's temperature; None: any.
        record, record_sha256: of a signal the name of its record, and the SHA-256 (hex) of the file it came from.
        record_s, record_ramp_s, record_highest_Hz: its duration with both ramps, either ramp, its highest frequency.
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
    law: str | None = None
    commanded_amplitude_m: float | None = None
    commanded_centre_m: float | None = None
    amplitude_tolerance: float | None = None
    temperature_low_degC: float | None = None
    temperature_high_degC: float | None = None
    record: str | None = None
    record_sha256: str | None = None
    record_s: float | None = None
    record_ramp_s: float | None = None
    record_highest_Hz: float | None = None

    @property
    def standing(self) -> bool:
        """Whether the rod stands still while the current is stepped."""
        return self.kind == CURRENT_STEP

    @property
    def cyclic(self) -> bool:
        """Whether its motion repeats itself, so that its cycles can be counted and compared."""
        return self.kind not in {CURRENT_STEP, HYBRID, SIGNAL}

    @property
    def commanded_A(self) -> float | None:
        """The one current of the whole point; None where it is commanded anew at each step."""
        return None if self.kind == HYBRID and self.law not in {None, "", "passive"} else self.current_A

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
        sensors: sensor by channel name: `force`, `displacement`, `auxiliary_1` ... as in `rig.recording.layout`.
        device_rate: seconds of device clock per second of wall time (bench `[clock] device_rate`).
        controller_delay_s: delay of the controller's own position and force inputs (bench `[actuator] input_delay`),
            against which the sensors' delays are checked; None when it may not be relied on.
        mid_stroke_m: the specimen's mid-stroke in the displacement sensor's coordinate; None when unknown.
        moving_mass_kg: mass between load cell and damper; its inertia is part of the measured force.
        current_tolerance_A: largest deviation of measured from wanted current in a valid point.
        simulated: True when no real damper was tested.
        current_by_hand: the current is what the operator confirmed; it was not measured.
        current_unmeasured: the current is what an analogue output was sent; it was not measured.
        streamed: the motion was made of set-points sent one by one.
        calibration: what is known of the instruments before the point, by attribute of `/entry/quality`: what the bench
            allows them to differ by, and what they showed at rest before the first motion.
        provenance: flat text attributes: software version, bench and matrix names and hashes, device identities,
            start time (UTC, ISO 8601), operator.
        channels: by name the origin of each channel as its driver stated it: `source`, `from_wire`, `long_name`; a
            channel that is absent has none stated.
    """

    point: WantedPoint
    sensors: Mapping[str, SensorContext]
    device_rate: float = 1.0
    controller_delay_s: float | None = None
    mid_stroke_m: float | None = None
    moving_mass_kg: float = 0.0
    current_tolerance_A: float = 0.02
    simulated: bool = False
    current_by_hand: bool = False
    current_unmeasured: bool = False
    streamed: bool = False
    calibration: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)
    channels: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    @property
    def current_told_by(self) -> str:
        """The source of a current that is not measured: "operator", "set-point"; else empty."""
        return "operator" if self.current_by_hand else "set-point" if self.current_unmeasured else ""

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
            raise ValueError("journal header is not a point's context: provenance is not an object")
        stated = context.channels
        if not isinstance(stated, dict) or not all(isinstance(origin, dict) for origin in stated.values()):
            raise ValueError("journal header is not a point's context: channels are not objects")
        return context
