"""From records as they came to channels on one time base: the displacement's samples on the controller's clock.

Each channel gets a clock model (`rig.recording.clock_model`), its declared delay is taken off, and force and current
are brought to the displacement's sample times. Nothing is interpolated over a gap: what was lost is missing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.quality import Quality
from rig.recording.channel import NUMBER, RING_CHANNELS
from rig.recording.clock_model import (
    IDENTITY,
    ClockModel,
    HostMap,
    by_edges,
    by_envelope,
    host_map,
)
from rig.recording.context import PointContext, SensorContext
from rig.recording.interpolation import cubic_at, flags_at, linear_at
from rig.recording.layout import FloatArray

CONTROLLER_CHANNELS = range(NUMBER["position"], NUMBER["controller_force"] + 1)
ECU_CLOCKED = ("coil_current", "ecu_state", "ecu_faults")
EDGE_OFFSET = NUMBER["force_edge"] - NUMBER["force"]
EDGE_COUNT_MODULO = 256
PULSE_COUNT_MODULO = 65536
BAD_VALUE = Quality.OVERLOAD | Quality.SENSOR_FAULT | Quality.NOT_A_NUMBER


class NothingRecorded(ValueError):
    """A point without displacement or force samples: there is nothing to align."""


@dataclass(frozen=True)
class TimedChannel:
    """A channel's records (n,) with each sample's time on the controller's clock, s; lost samples counted."""

    name: str
    records: NDArray[Any]
    time_s: FloatArray
    clock: ClockModel
    lost: int
    latency_s: float


@dataclass(frozen=True)
class Alignment:
    """The aligned point.

    Attributes:
        time_s: (n,) s from the first displacement sample; `origin_s` is that sample's controller clock.
        values: aligned channels (n,) by name.
        flags: (n,) `Quality` of each sample, all channels joined.
        timed: every channel with its own sample times (still on the controller's clock).
        skew_s: by how much force lagged displacement when paired by arrival; taken out here. None where the device
            clocks do not run at wall speed, since arrivals then say nothing.
        skew_std_s: one standard deviation of what remains.
        skew_method: the clock models that were used.
        host: the map from host time to the controller's clock.
    """

    time_s: FloatArray
    origin_s: float
    values: Mapping[str, FloatArray]
    flags: NDArray[np.int8]
    timed: Mapping[str, TimedChannel]
    skew_s: float | None
    skew_std_s: float
    skew_method: str
    host: HostMap


def align(records: NDArray[Any], context: PointContext) -> Alignment:
    """Align one point's records.

    Args:
        records: (n,) of `RECORD_DTYPE` in the order of arrival.
        context: rates, declared delays and the device rate.

    Raises:
        NothingRecorded: displacement or force has no sample at all.
    """
    by_name = split(records)
    for name in ("displacement", "force"):
        if name not in by_name:
            raise NothingRecorded(f"no {name} sample was recorded")
    host = _host_map(by_name, context.device_rate)
    timed = {name: _timed(name, channel, by_name, host, context) for name, channel in by_name.items()}
    base, force = timed["displacement"], timed["force"]
    values, flags = _on_base(timed, context)
    return Alignment(
        time_s=base.time_s - base.time_s[0], origin_s=float(base.time_s[0]), values=values, flags=flags, timed=timed,
        skew_s=force.latency_s - base.latency_s if context.device_rate == 1.0 else None,
        skew_std_s=float(np.hypot(force.clock.std_s, base.clock.std_s)),
        skew_method=f"force by {force.clock.method}, displacement by {base.clock.method}",
        host=host,
    )


def split(records: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Records by channel name, each in the order of arrival; numbers nobody knows are called `channel_<number>`."""
    found = {}
    for number in np.unique(records["channel"]):
        description = RING_CHANNELS.get(int(number))
        name = f"channel_{number}" if description is None else description.name
        found[name] = records[records["channel"] == number]
    return found


def _host_map(by_name: Mapping[str, NDArray[Any]], device_rate: float) -> HostMap:
    polls = by_name.get("position")
    if polls is None:
        polls = by_name["displacement"]
        polls = polls[polls["device_us"] >= 0]
    return host_map(polls["host_ns"], polls["device_us"], device_rate)


def _timed(
    name: str, channel: NDArray[Any], by_name: Mapping[str, NDArray[Any]], host: HostMap, context: PointContext,
) -> TimedChannel:
    arrival_s = host.time_s(channel["host_ns"])
    sensor = context.sensors.get(name)
    if sensor is not None:
        return _timed_sensor(name, channel, by_name, arrival_s, sensor, context.device_rate)
    device_s = channel["device_us"] * 1e-6
    if NUMBER.get(name) in CONTROLLER_CHANNELS and np.all(channel["device_us"] >= 0):
        clock = IDENTITY
    elif name in ECU_CLOCKED and np.all(channel["device_us"] >= 0):
        clock = by_envelope(device_s, arrival_s, device_rate=context.device_rate)
    else:
        return TimedChannel(name, channel, arrival_s, ClockModel(0.0, 0.0, 1.0, 0.0, "arrival"), 0, 0.0)
    time_s = clock.time_s(device_s)
    return TimedChannel(name, channel, time_s, clock, 0, float(np.median(arrival_s - time_s)))


def _timed_sensor(
    name: str, channel: NDArray[Any], by_name: Mapping[str, NDArray[Any]], arrival_s: FloatArray,
    sensor: SensorContext, device_rate: float,
) -> TimedChannel:
    has_clock = bool(np.all(channel["device_us"] >= 0))
    count = unwrapped(channel["sequence"])
    local_s = channel["device_us"] * 1e-6 if has_clock else count / sensor.rate_Hz
    pairs = matched_edges(by_name.get(f"{name}_edge"), by_name.get("pulse"))
    if has_clock and len(pairs):
        clock = by_edges(pairs[:, 0], pairs[:, 1])
    else:
        clock = by_envelope(local_s, arrival_s, device_rate=device_rate)
        if not has_clock:
            clock = ClockModel(clock.origin_s, clock.offset_s, clock.rate, clock.std_s, "nominal rate")
    time_s = clock.time_s(local_s) - sensor.delay_s
    order = np.flatnonzero(np.concatenate(([True], np.diff(np.maximum.accumulate(time_s)) > 0)))
    latency_s = float(np.median(arrival_s - time_s))
    return TimedChannel(name, channel[order], time_s[order], clock, lost_samples(channel["sequence"]), latency_s)


def unwrapped(sequence: NDArray[np.uint32]) -> FloatArray:
    """Sample count (n,) from 0, of a sequence modulo 2^32; steps back (a restarted device) count as no step."""
    steps = np.mod(np.diff(sequence.astype(np.int64)), 1 << 32)
    steps[steps >= 1 << 31] = 0
    return np.concatenate(([0.0], np.cumsum(steps, dtype=np.float64)))


def lost_samples(sequence: NDArray[np.uint32]) -> int:
    """Samples missing between the first and the last, by their sequence modulo 2^32."""
    if len(sequence) < 2:
        return 0
    steps = np.mod(np.diff(sequence.astype(np.int64)), 1 << 32)
    forward = steps[(steps > 0) & (steps < 1 << 31)]
    return int(np.sum(forward - 1))


def matched_edges(edges: NDArray[Any] | None, pulses: NDArray[Any] | None) -> FloatArray:
    """Pairs (k, 2) of latched time and pulse time, s, each in its own clock, matched by their counts.

    An edge frame counts pulses modulo 256. The first edge is matched with the pulse of that count nearest in arrival;
    from there on both counts are unwrapped.
    """
    if edges is None or pulses is None or len(edges) == 0 or len(pulses) == 0:
        return np.zeros((0, 2))
    counts = np.round(pulses["value"]).astype(np.int64) % PULSE_COUNT_MODULO
    pulse_count = counts[0] + np.concatenate(([0], np.cumsum(np.diff(counts) % PULSE_COUNT_MODULO)))
    edge_count = edges["sequence"].astype(np.int64)
    same = np.flatnonzero((edge_count[:, None] - pulse_count[None, :]) % EDGE_COUNT_MODULO == 0)
    if len(same) == 0:
        return np.zeros((0, 2))
    rows, columns = np.unravel_index(same, (len(edge_count), len(pulse_count)))
    apart = np.abs(edges["host_ns"][rows] - pulses["host_ns"][columns])
    best = int(np.argmin(apart))
    shift = int(edge_count[rows[best]] - pulse_count[columns[best]])
    _, at_edge, at_pulse = np.intersect1d(edge_count - shift, pulse_count, return_indices=True)
    return np.column_stack((edges["device_us"][at_edge], pulses["device_us"][at_pulse])) * 1e-6


def _on_base(
    timed: Mapping[str, TimedChannel], context: PointContext,
) -> tuple[dict[str, FloatArray], NDArray[np.int8]]:
    base = timed["displacement"]
    wanted = base.time_s
    values = {"displacement": good_values(base.records)}
    flags = base.records["flags"].astype(np.int8)
    for name, sensor in context.sensors.items():
        if name == "displacement" or name not in timed:
            continue
        channel = timed[name]
        values[name] = cubic_at(wanted, channel.time_s, good_values(channel.records), 1.0 / sensor.rate_Hz)
        if name == "force":
            flags |= flags_at(wanted, channel.time_s, channel.records["flags"].astype(np.int8))
            flags[np.isnan(values[name])] |= np.int8(Quality.NOT_A_NUMBER)
    for wanted_name, source in (("current", "coil_current"), ("coil_temperature", "coil_temperature")):
        values[wanted_name] = _status_at(wanted, timed.get(source))
    flags[np.isnan(values["displacement"])] |= np.int8(Quality.NOT_A_NUMBER)
    return values, flags


def good_values(records: NDArray[Any]) -> FloatArray:
    """Values (n,) in SI, NaN where the flags say that the value is not the physical quantity."""
    bad = (records["flags"] & np.uint16(BAD_VALUE)) != 0
    return np.where(bad, np.nan, records["value"])


def _status_at(wanted_s: FloatArray, channel: TimedChannel | None) -> FloatArray:
    """A status value at the wanted times; NaN across lost frames (period: the median of its own)."""
    if channel is None or len(channel.time_s) < 3:
        return np.full(len(wanted_s), np.nan)
    increasing = np.concatenate(([True], np.diff(np.maximum.accumulate(channel.time_s)) > 0))
    time_s, value = channel.time_s[increasing], channel.records["value"][increasing]
    if len(time_s) < 3:
        return np.full(len(wanted_s), np.nan)
    return linear_at(wanted_s, time_s, value, 2.0 * float(np.median(np.diff(time_s))))
