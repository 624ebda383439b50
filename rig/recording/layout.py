"""The layout of a recorded point (`docs/files.md`, "A point's file"); HDF5 is made by `hdf5_image`."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
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
    """Ring records (n,) of `RECORD_DTYPE`: an array, or a file read in parts (`rig.recording.channel_split`)."""

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
    10: Description("coil_current", "A", "Coil current measured by the ECU"),
    11: Description("coil_temperature", "degC", "Coil temperature reported by the ECU"),
    12: Description("ecu_temperature", "degC", "Temperature of the ECU itself"),
    13: Description("ecu_supply", "V", "Supply voltage of the ECU"),
    14: Description("ecu_state", "1", "State of the ECU"),
    15: Description("ecu_faults", "1", "Fault bits of the ECU"),
    16: Description("commanded_current", "A", "Coil current asked for"),
    20: Description("position", "m", "Position by the actuator controller's own sensor"),
    21: Description("velocity", "m/s", "Velocity by the actuator controller"),
    22: Description("setpoint", "m", "Position asked for by the actuator controller"),
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
