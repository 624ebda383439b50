"""From records as received to channels on one time base: the displacement's samples on the controller's clock.

Each channel gets a clock model (`rig.recording.alignment.sensor_clock`), its delay is removed, and force and current
are interpolated at the displacement's sample times. Nothing is interpolated over a gap: lost samples are missing. Long
channels are computed in parts (`rig.signals.chunked_column`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import CHANNELS, Channel, channel_name
from protocols.quality import Quality
from rig.recording.alignment.sensor_clock import SensorClock, timed_sensors
from rig.recording.layout import PointContext
from rig.recording.ring_records import Records, good_values
from rig.signals.arrays import FloatArray
from rig.signals.chunked_column import Column, Values, first_after, mapped, overlapping, thinned
from rig.signals.clock_model import ARRIVAL, EDGES, IDENTITY, ClockModel, HostMap, by_envelope, by_order, host_map
from rig.signals.delay_estimation.delay_model import Skew
from rig.signals.estimate import Estimate
from rig.signals.interpolation import flags_at, monotone_at, status_at

CONTROLLER_CHANNELS = range(Channel.POSITION, Channel.CONTROLLER_FORCE + 1)
ECU_CLOCKED = ("coil_current", "ecu_state", "ecu_faults")
OWN_SAMPLES = "the sensor's own samples"
RESAMPLED = "monotone cubic interpolation of the sensor's own samples, never beyond the two adjacent samples"
INTERPOLATED = "linear interpolation between the values received"
NEIGHBOURS = 4
MOST_FOR_A_MEDIAN = 20_000


class NothingRecorded(ValueError):
    """A point without displacement or force samples: there is nothing to align."""


@dataclass(frozen=True)
class TimedChannel:
    """A channel's records (n,) with each sample's time on the controller's clock, s; lost samples counted.

    `latency_s` is the median time from a sample to its arrival. `sensor` says how a sensor's clock was found; None for
    status channels. Samples whose device clock went back have no place in time: `disordered` counts them, and they are
    in `received` (m,) only, flagged, with `received_s` NaN. Normally there are none, and both are `records`, `time_s`.
    """

    name: str
    records: Records
    time_s: Values
    clock: ClockModel
    lost: int
    latency_s: float
    sensor: SensorClock | None = None
    disordered: int = 0
    disorder: tuple[Records, Values] | None = None

    @property
    def received(self) -> Records:
        """Every record of the channel, as it came."""
        return self.records if self.disorder is None else self.disorder[0]

    @property
    def received_s(self) -> Values:
        """Time of each of them on the controller's clock, s; NaN where the device's clock went back."""
        return self.time_s if self.disorder is None else self.disorder[1]


@dataclass(frozen=True)
class Alignment:
    """The aligned point.

    Attributes:
        time_s: (n,) s from the first displacement sample; `origin_s` is that sample's controller clock.
        values: aligned channels (n,) by name.
        methods: how each of them was brought to the displacement's sample times.
        flags: (n,) `Quality` of each sample, all channels joined.
        timed: every channel with its own sample times (still on the controller's clock).
        skew_s: by how much force lagged displacement beyond the declared delays, each on its device's own time base;
            taken out here. None where a clock could only be tied by signals or arrivals, which hide it.
        skew_std_s: one standard deviation of what remains, as the signals leave it open, whatever was declared.
        skew_trusted_s: the same if the bench file's declarations are trusted.
        delays: what is known of the sensors' delays.
        skew_checked: whether both sensors' delays were compared with the controller's own record of what they measure;
            else they are what the bench file declares, and `skew_std_s` what such a declaration is worth.
        skew_method: the clock models that were used.
        arrival_skew_s: by how much force would have lagged if paired by arrival, delays included. None where the device
            clocks do not run at wall speed, since arrivals then say nothing.
        host: the map from host time to the controller's clock.
    """

    time_s: Values
    origin_s: float
    values: Mapping[str, Values]
    methods: Mapping[str, str]
    flags: Values
    timed: Mapping[str, TimedChannel]
    skew_s: float | None
    skew_std_s: float
    skew_trusted_s: float
    delays: Skew
    skew_checked: bool
    skew_method: str
    arrival_skew_s: float | None
    host: HostMap

    def loss_counted_by(self, device_rate: float) -> str:
        """How a lost sample of load cell or LVDT would have been seen: `sequence`, `rate`, or `nothing`.

        A format without a sequence is counted against its rate, which only says something where clocks run at wall
        speed.
        """
        numbered = all(
            len(self.timed[name].records) == 0 or int(self.timed[name].records["device_us"][0]) >= 0
            for name in ("force", "displacement")
        )
        return "sequence" if numbered else "rate" if device_rate == 1.0 else "nothing"


def align(
    records: NDArray[Any] | Mapping[str, Records], context: PointContext, delays: Skew | None = None,
    behind_arrivals: Estimate | None = None,
) -> Alignment:
    """Align one point's records: the only way from what was received to aligned data.

    Args:
        records: (n,) of `RECORD_DTYPE` in the order of arrival, or already split by channel name.
        context: rates, declared delays and the device rate.
        delays: the sensors' delays beyond the declared ones where they are known from all points of a campaign; None:
            by what this point shows.
        behind_arrivals: by how much force lags displacement if paired by their earliest arrivals (s), by all points of
            a campaign without edges; None: by what this point shows.

    Raises:
        NothingRecorded: displacement or force has no sample at all.
    """
    by_name = records if isinstance(records, Mapping) else split(records)
    for name in ("displacement", "force"):
        if name not in by_name:
            raise NothingRecorded(f"no {name} samples were recorded")
    host = _host_map(by_name, context.device_rate)
    sensors, delays = timed_sensors(by_name, host, context, delays, behind_arrivals)
    timed = {
        name: _sensor(name, channel, host, sensors[name]) if name in sensors
        else _status(name, channel, by_name, host, context)
        for name, channel in by_name.items()
    }
    base, force = timed["displacement"], timed["force"]
    values, methods, flags = _on_base(timed, context)
    origin_s = float(base.time_s[0])
    tied = {base.clock.method, force.clock.method} == {EDGES}
    tie_s = math.hypot(*(0.0 if channel.sensor is None else channel.sensor.tie_std_s for channel in (force, base)))
    apart_s = float(np.hypot(force.clock.std_s, base.clock.std_s))
    return Alignment(
        time_s=mapped(base.time_s, lambda time_s: time_s - origin_s, np.float64), origin_s=origin_s, values=values,
        methods=methods, flags=flags, timed=timed, skew_s=delays.value_s if tied else None,
        skew_std_s=math.hypot(delays.std_s, tie_s) if tied else apart_s,
        skew_trusted_s=math.hypot(delays.trusted_std_s, tie_s) if tied else apart_s,
        delays=delays,
        skew_checked=all(channel.sensor is not None and channel.sensor.checked for channel in (force, base)),
        skew_method=f"force by {force.clock.method}, displacement by {base.clock.method}",
        arrival_skew_s=force.latency_s - base.latency_s if context.device_rate == 1.0 else None, host=host,
    )


def split(records: NDArray[Any]) -> dict[str, Records]:
    """Records by channel name, each in the order of arrival; unknown numbers are called `channel_<number>`."""
    return {
        channel_name(int(number)): records[records["channel"] == number] for number in np.unique(records["channel"])
    }


def _host_map(by_name: Mapping[str, Records], device_rate: float) -> HostMap:
    polls = by_name.get("position")
    if polls is None:
        polls = by_name["displacement"][:]
        polls = polls[polls["device_us"] >= 0]
    return host_map(np.asarray(polls["host_ns"]), np.asarray(polls["device_us"]), device_rate)


def _sensor(name: str, channel: Records, host: HostMap, sensor: SensorClock) -> TimedChannel:
    ordered, time_s, disorder = _in_order(channel, sensor.time_s)
    arrival_s = mapped(ordered["host_ns"], host.time_s, np.float64)
    late_s = thinned(arrival_s, MOST_FOR_A_MEDIAN) - thinned(time_s, MOST_FOR_A_MEDIAN)
    return TimedChannel(
        name, ordered, time_s, sensor.clock, lost_samples(channel["sequence"]), float(np.median(late_s)), sensor,
        len(channel) - len(ordered), disorder,
    )


def _status(
    name: str, channel: Records, by_name: Mapping[str, Records], host: HostMap, context: PointContext,
) -> TimedChannel:
    records = channel[:]
    delay_s = context.current_delay_s if name == "coil_current" else 0.0
    arrival_s, device_s = host.time_s(records["host_ns"]), records["device_us"] * 1e-6
    if CHANNELS.get(name) in CONTROLLER_CHANNELS and np.all(records["device_us"] >= 0):
        clock = IDENTITY
    elif name in ECU_CLOCKED and np.all(records["device_us"] >= 0):
        clock = _ecu_clock(device_s, arrival_s, by_name, context)
    else:
        return TimedChannel(name, records, arrival_s - delay_s, ClockModel(0.0, 0.0, 1.0, 0.0, ARRIVAL), 0, delay_s)
    time_s = clock.time_s(device_s) - delay_s
    return TimedChannel(name, records, time_s, clock, 0, float(np.median(arrival_s - time_s)))


def _ecu_clock(
    device_s: FloatArray, arrival_s: FloatArray, by_name: Mapping[str, Records], context: PointContext,
) -> ClockModel:
    """The ECU's clock: no edge ties it to the controller's, so arrivals do, on a fast rig their order."""
    frames, polls = by_name.get("coil_current"), by_name.get("position")
    if context.device_rate != 1.0 and frames is not None and polls is not None:
        sent, polls_sent = frames[:], polls[:]
        polls_sent = polls_sent[polls_sent["device_us"] >= 0]
        ordered = by_order(
            sent["device_us"] * 1e-6, sent["host_ns"], polls_sent["device_us"] * 1e-6, polls_sent["host_ns"]
        )
        if ordered is not None:
            return ordered
    return by_envelope(device_s, arrival_s, device_rate=context.device_rate)


def _in_order(records: Records, time_s: Values) -> tuple[Records, Values, tuple[Records, Values] | None]:
    """Records and times of the samples in order, and, where some are not, all records flagged and all times.

    What is out of order is the fewer of: those that do not come after all before, those that do not come before all
    after. One wild step of a clock, forward or back, then costs one sample.
    """
    if all(np.all(np.diff(time_s[rows]) > 0) for rows in overlapping(len(time_s))):
        return records, time_s, None
    times = np.asarray(time_s)
    after = np.diff(np.maximum.accumulate(times), prepend=-np.inf) > 0
    before = np.diff(np.minimum.accumulate(times[::-1]), prepend=np.inf)[::-1] < 0
    keep = after if np.count_nonzero(after) >= np.count_nonzero(before) else before
    received = np.array(records[:])
    received["flags"][~keep] |= np.uint16(Quality.CLOCK_BACK)
    return received[keep], times[keep], (received, np.where(keep, times, np.nan))


def lost_samples(sequence: Values) -> int:
    """Samples missing between the first and the last, by their sequence modulo 2^32."""
    lost = 0
    for rows in overlapping(len(sequence)):
        steps = np.mod(np.diff(np.asarray(sequence[rows]).astype(np.int64)), 1 << 32)
        forward = steps[(steps > 0) & (steps < 1 << 31)]
        lost += int(np.sum(forward - 1))
    return lost


def _on_base(
    timed: Mapping[str, TimedChannel], context: PointContext
) -> tuple[dict[str, Values], dict[str, str], Values]:
    """The aligned channels, how each was brought to the displacement's sample times, and their joined flags."""
    base = timed["displacement"]
    own = _along(base, lambda start, stop: good_values(base.records[start:stop]))
    values: dict[str, Values] = {"displacement": own}
    methods = {"displacement": OWN_SAMPLES}
    for name, sensor in context.sensors.items():
        if name != "displacement" and name in timed:
            values[name], methods[name] = _brought(base, timed[name], 1.0 / sensor.rate_Hz), RESAMPLED
    for requested, source in (("current", "coil_current"), ("coil_temperature", "coil_temperature")):
        values[requested], methods[requested] = _status_along(base, timed.get(source)), INTERPOLATED
    return values, methods, _flags(base, timed["force"], values)


def _along(base: TimedChannel, part: Any, kind: Any = np.float64) -> Values:  # noqa: ANN401 - a Part and a DTypeLike
    """A column (n,) beside the base's samples: computed at once where the base is in memory, else part by part."""
    if isinstance(base.time_s, Column):
        return Column(len(base.time_s), kind, part)
    return np.asarray(part(0, len(base.time_s)), kind)


def _near(channel: TimedChannel, query_s: FloatArray) -> tuple[FloatArray, NDArray[Any]]:
    """Times and records of a channel around the wanted times, with the neighbours an interpolation needs."""
    if len(query_s) == 0:
        return np.zeros(0), channel.records[:0]
    first = max(0, first_after(channel.time_s, float(query_s[0])) - NEIGHBOURS)
    last = first_after(channel.time_s, float(query_s[-1])) + NEIGHBOURS
    return np.asarray(channel.time_s[first:last]), channel.records[first:last]


def _brought(base: TimedChannel, channel: TimedChannel, period_s: float) -> Values:
    def part(start: int, stop: int) -> FloatArray:
        query_s = np.asarray(base.time_s[start:stop])
        time_s, records = _near(channel, query_s)
        return monotone_at(query_s, time_s, good_values(records), period_s)

    return _along(base, part)


def _flags(base: TimedChannel, force: TimedChannel, values: Mapping[str, Values]) -> Values:
    def part(start: int, stop: int) -> NDArray[np.int8]:
        query_s = np.asarray(base.time_s[start:stop])
        time_s, records = _near(force, query_s)
        flags: NDArray[np.int8] = base.records[start:stop]["flags"].astype(np.int8)
        flags |= flags_at(query_s, time_s, records["flags"].astype(np.int8))
        for name in ("force", "displacement"):
            flags[np.isnan(values[name][start:stop])] |= np.int8(Quality.NOT_A_NUMBER)
        return flags

    return _along(base, part, np.int8)


def _status_along(base: TimedChannel, channel: TimedChannel | None) -> Values:
    """A status value at the base's times, as `status_at`; NaN where the channel was not recorded."""
    values = None if channel is None else channel.records[:]["value"]

    def part(start: int, stop: int) -> FloatArray:
        query_s = np.asarray(base.time_s[start:stop])
        if channel is None or values is None:
            return np.full(len(query_s), np.nan)
        return status_at(query_s, np.asarray(channel.time_s), values, by_arrival=channel.clock.method == ARRIVAL)

    return _along(base, part)


@dataclass(frozen=True)
class Overview:
    """The aligned point thinned to what an examination needs, as arrays (n,): every sample of an ordinary point."""

    time_s: FloatArray
    displacement_m: FloatArray
    force_N: FloatArray
    current_A: FloatArray
    temperature_degC: FloatArray
