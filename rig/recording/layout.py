"""The recorded data of a point: its journal's header and the contents of its file (`docs/files.md`, "A point's file").

`hdf5_image` writes it as HDF5.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.recording.point_attributes import NAMES, NOT_STATED, Commanded, attributes_of, commanded_of, point_fields
from rig.recording.ring_records import Records
from rig.signals.chunked_column import Values
from rig.test_point import TestPoint

FORMAT_VERSION = 1
CHUNK_SAMPLES = 16384
Attribute = str | int | float | bool | Sequence[str] | None


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
class CycleTable:
    """Statistics of every cycle of an endurance block: `number` (k,) of each in its test, and `values` (k,) by name.

    `units` name unit and meaning of each statistic.
    """

    number: NDArray[np.int64]
    values: Mapping[str, NDArray[np.float64]]
    units: Mapping[str, tuple[str, str]]


@dataclass(frozen=True)
class PointFile:
    """Everything one file holds. `time_s` (n,) in seconds; `flags` (n,) as `protocols.quality.Quality`, None: all 0.

    `cycles`: only of an endurance block, whose samples are those of some cycles.
    """

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
    cycles: CycleTable | None = None


def check_of(values: NDArray[Any]) -> int:
    """CRC-32 of a dataset's values: HDF5 checks its chunks, but not the index that finds them."""
    return zlib.crc32(np.ascontiguousarray(values).tobytes())


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
class PointContext:
    """The header of a point's journal.

    Attributes:
        point: the test point; its id is the name of its files.
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
        current_delay_s: group delay of the filter in the measurement of the coil current (bench `[ecu] current_delay`).
        streamed: the motion was made of set-points sent one by one.
        calibration: what is known of the instruments before the point, by attribute of `/entry/quality`: what the bench
            allows them to differ by, and what they showed at rest before the first motion.
        provenance: flat text attributes: software version, bench and matrix names and hashes, device identities,
            start time (UTC, ISO 8601), operator.
        channels: by name the origin of each channel as its driver stated it: `source`, `from_wire`, `long_name`; a
            channel that is absent has none stated.
        commanded: how the point was commanded and accepted.
    """

    point: TestPoint
    sensors: Mapping[str, SensorContext]
    device_rate: float = 1.0
    controller_delay_s: float | None = None
    mid_stroke_m: float | None = None
    moving_mass_kg: float = 0.0
    current_tolerance_A: float = 0.02
    simulated: bool = False
    current_by_hand: bool = False
    current_unmeasured: bool = False
    current_delay_s: float = 0.0
    streamed: bool = False
    calibration: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)
    channels: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    commanded: Commanded = NOT_STATED

    @property
    def requested(self) -> dict[str, str | int | float]:
        """The point as it was requested and commanded, by attribute of `/entry/test`."""
        return attributes_of(self.point, self.commanded)

    @property
    def current_told_by(self) -> str:
        """The source of a current that is not measured: "operator", "set-point"; else empty."""
        return "operator" if self.current_by_hand else "set-point" if self.current_unmeasured else ""

    def to_json(self) -> str:
        """One line of JSON that `from_json` turns back into an equal context."""
        sensors = {name: asdict(sensor) for name, sensor in self.sensors.items()}
        others = {name: value for name, value in vars(self).items() if name not in {"point", "sensors", "commanded"}}
        return json.dumps({"point": self.requested, "sensors": sensors, **others}, allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> PointContext:
        """Read `to_json`'s line again.

        Raises:
            ValueError: the text is not JSON of this shape; the message says what is wrong.
        """
        try:
            raw = json.loads(text)
            sensors = {name: SensorContext(**entry) for name, entry in raw.pop("sensors").items()}
            requested = raw.pop("point")
            if unknown := requested.keys() - NAMES:
                raise ValueError(f"the journal header does not describe a point: unknown {sorted(unknown)}")
            context = cls(
                point=TestPoint(**point_fields(requested)), commanded=commanded_of(requested), sensors=sensors, **raw
            )
        except (AttributeError, KeyError, RecursionError, TypeError) as error:
            raise ValueError(f"the journal header does not describe a point: {error}") from error
        if not isinstance(context.provenance, dict):
            raise ValueError("the journal header does not describe a point: its provenance is not an object")
        stated = context.channels
        if not isinstance(stated, dict) or not all(isinstance(origin, dict) for origin in stated.values()):
            raise ValueError("the journal header does not describe a point: its channels are not objects")
        return context
