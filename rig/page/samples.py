"""The ring's records made ready for charts: binary frames of the newest samples, thinned, and the loops' points.

A frame, little-endian, everything aligned to 4 bytes:

    u32 kind (1) | u32 number of blocks | f64 base | f64 now          s, host's monotonic clock
    u32 kind (2) | ...                                                s, a recorded point's own time; now: its end
    block:  u16 channel | u16 0 | u32 n | n x f32 time after base (s) | n x f32 value (SI)

Channels are the ring's (`drivers.ring.Channel`), values as recorded. 201, 202, 203 are a loop's displacement (m),
velocity (m/s) and force (N), taken together: force at the displacement's times, on the devices' own clocks where both
have one; their delays are corrected in the recording, not here. A loop's times count by the displacement sensor's clock
from wherever it was first heard, and fall behind the host's on a simulated rig that is slower than it was asked to be.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import NO_DEVICE_TIME, Channel
from protocols.quality import NO_VALUE
from rig.recording.journal.ring_reader import RecordBlock
from rig.recording.layout import RECORD_DTYPE

HEADER = struct.Struct("<IIdd")
BLOCK = struct.Struct("<HHI")
SAMPLES, RECORDED = 1, 2
LOOP_X, LOOP_V, LOOP_F = 201, 202, 203
MOST_POINTS, MOST_LOOP_POINTS = 40, 240
"""Of one channel in one frame; more are thinned to the lowest and the highest of each group, loops evenly."""
FEWEST_FITTED, FITTED_S = 5, 0.016
"""Samples, and device seconds, over which the velocity is the displacement's slope."""
REMEMBERED = 6
"""Frames over which a device's clock is compared with the host's."""
RATE_OVER, CLOCKS_OVER, MEDIAN_EVERY = 50, 250, 25
"""Frames over which a rig's own rate is measured, and two devices' clocks are compared; how often that is looked at."""
FORCE, DISPLACEMENT = int(Channel.FORCE), int(Channel.DISPLACEMENT)
SHOWN = (
    FORCE, DISPLACEMENT, *range(Channel.AUXILIARY_1, Channel.AUXILIARY_7 + 1), Channel.COIL_CURRENT,
    Channel.COIL_TEMPERATURE, Channel.ECU_TEMPERATURE, Channel.COMMANDED_CURRENT, Channel.POSITION, Channel.STATE,
    Channel.SUPPLY_PRESSURE,
)  # fmt: skip
SENSORS = range(Channel.FORCE, Channel.AUXILIARY_7 + 1)

Floats = NDArray[np.float64]
Series = tuple[Floats, Floats]
"""Times (s) and values, (n,) each."""


class DeviceTime:
    """Device times on the host's clock: what arrived soonest after it was measured says how far the clocks are apart.

    Only the last moments count, and a rig faster than life is taken at the rate that it has: a simulated one on a busy
    machine falls behind the rate that it was asked for.

    Args:
        rate: device seconds in a host second.
    """

    def __init__(self, rate: float) -> None:
        self._scale_ns = 1000.0 / rate
        self._measured = rate != 1.0
        self._arrivals: deque[tuple[float, float]] = deque(maxlen=RATE_OVER)
        self._offsets_ns: deque[float] = deque(maxlen=REMEMBERED)
        self._last_s = -np.inf

    def host_s(self, records: NDArray[Any]) -> Floats:
        """Times of one channel's records, (n,), s; of a device without a clock the arrivals."""
        host_ns, device_us = records["host_ns"], records["device_us"]
        if device_us[0] == NO_DEVICE_TIME:
            arrivals: Floats = host_ns * 1e-9
            return arrivals
        if not self._measured:
            device_ns = device_us * self._scale_ns
            self._offsets_ns.append(float((host_ns - device_ns).min()))
            return self._onwards((device_ns + min(self._offsets_ns)) * 1e-9)
        self._arrivals.append((float(host_ns[-1]), float(device_us[-1])))
        (host_0, device_0), (host_1, device_1) = self._arrivals[0], self._arrivals[-1]
        scale_ns = self._scale_ns
        if device_1 > device_0 and host_1 > host_0:
            scale_ns = (host_1 - host_0) / (device_1 - device_0)
        since_ns = (device_us - device_us[-1]) * scale_ns
        self._offsets_ns.append(float((host_ns - since_ns).min()) - host_1)
        return self._onwards((since_ns + host_1 + self._soonest(scale_ns)) * 1e-9)

    def _onwards(self, times_s: Floats) -> Floats:
        """Never before what was shown already."""
        if times_s[0] < self._last_s:
            times_s = np.maximum(times_s, self._last_s)
        self._last_s = float(times_s[-1])
        return times_s

    def _soonest(self, scale_ns: float) -> float:
        """The least delay of the last moments, against the last sample's arrival (ns)."""
        host_1, device_1 = self._arrivals[-1]
        recent = zip(reversed(self._offsets_ns), reversed(self._arrivals), strict=False)
        return min(offset + (host - host_1) - (device - device_1) * scale_ns for offset, (host, device) in recent)


class LoopClock:
    """Two sensors' samples on one clock, the displacement sensor's: exact within each, whatever the host's rate.

    How far the two clocks are apart is what most of the last frames say: one alone tells of the host's lateness too.

    Args:
        rate: device seconds in a host second.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._apart_s: deque[float] = deque(maxlen=CLOCKS_OVER)
        self._median_s = 0.0
        self._compared = 0
        self._anchor_s: float | None = None
        self._last_us = -1

    def times(self, displacement: NDArray[Any], force: NDArray[Any]) -> tuple[Floats, Floats]:
        """Times (s) of both sensors' records; of force none before both were heard."""
        if len(displacement):
            newest = displacement[-1]
            if self._anchor_s is None or displacement["device_us"][0] <= self._last_us:  # or switched off and on
                self._apart_s.clear()
                self._compared = 0
                self._anchor_s = float(newest["host_ns"]) * 1e-9 - float(newest["device_us"]) * 1e-6 / self._rate
            self._last_us = int(newest["device_us"])
            if len(force):
                self._compare(displacement, force)
        if self._anchor_s is None or not self._apart_s:
            force = force[:0]
        anchor_s = self._anchor_s or 0.0
        x_s: Floats = displacement["device_us"] * (1e-6 / self._rate) + anchor_s
        f_s: Floats = (force["device_us"] * 1e-6 + self._median_s) / self._rate + anchor_s
        return x_s, f_s

    def _compare(self, displacement: NDArray[Any], force: NDArray[Any]) -> None:
        self._apart_s.append(self._lag_s(force) - self._lag_s(displacement))
        self._compared += 1
        if self._compared <= MEDIAN_EVERY or self._compared % MEDIAN_EVERY == 0:
            self._median_s = float(np.median(self._apart_s))

    def _lag_s(self, records: NDArray[Any]) -> float:
        return float((records["host_ns"] * (1e-9 * self._rate) - records["device_us"] * 1e-6).min())


class Loop:
    """Displacement, velocity and force taken together.

    Args:
        rate_Hz: of the displacement sensor, its own clock.
    """

    def __init__(self, rate_Hz: float) -> None:
        half = max(FEWEST_FITTED, round(FITTED_S * rate_Hz)) // 2
        self._width = 2 * half + 1
        self._half = half
        steps = np.arange(-half, half + 1, dtype=float)
        self._weights = steps * (rate_Hz / float(steps @ steps))
        self._x: tuple[Floats, Floats] = (np.empty(0), np.empty(0))
        self._f: tuple[Floats, Floats] = (np.empty(0), np.empty(0))

    def points(
        self, displacement: tuple[Floats, Floats], force: tuple[Floats, Floats]
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """New points from new samples.

        Args:
            displacement: times (s, host) and values (m), (n,) each; may be empty.
            force: times (s, host) and values (N).

        Returns:
            Times (s, host), displacement (m), velocity (m/s), force (N), (n,) each.
        """
        if len(displacement[0]) and len(self._x[0]) and displacement[0][0] < self._x[0][-1]:
            self._x = self._f = np.empty(0), np.empty(0)  # its clock began anew
        self._x, self._f = _joined(self._x, displacement), _joined(self._f, force)
        time, x = self._x
        ready = np.searchsorted(time, self._f[0][-1], "right") if len(self._f[0]) else 0
        count = min(len(time) - self._width + 1, int(ready) - self._half)
        if count <= 0:
            self._cut(max(0, len(time) - 10 * self._width - MOST_LOOP_POINTS))
            return np.empty(0), np.empty(0), np.empty(0), np.empty(0)
        centre = slice(self._half, self._half + count)
        # By the sensor's own rate: arrivals at the host are no measure of a step of 4 ms.
        velocity = np.correlate(x[: count + self._width - 1], self._weights, "valid")
        shown = time[centre], x[centre], velocity
        if shown[0][0] < self._f[0][0]:
            known = shown[0] >= self._f[0][0]
            shown = shown[0][known], shown[1][known], velocity[known]
        force_N = np.interp(shown[0], *self._f)
        self._cut(count)
        return *shown, force_N

    def _cut(self, count: int) -> None:
        time, x = self._x
        self._x = time[count:], x[count:]
        if len(self._x[0]):
            old = max(0, int(np.searchsorted(self._f[0], self._x[0][0])) - 1)
            self._f = self._f[0][old:], self._f[1][old:]


class Frames:
    """Records in, frames out.

    Args:
        device_rate: device seconds in a host second.
        displacement_Hz: the displacement sensor's rate, its own clock.
    """

    def __init__(self, device_rate: float, displacement_Hz: float) -> None:
        self._clocks = {channel: DeviceTime(device_rate) for channel in SENSORS}
        self._loop = Loop(displacement_Hz)
        self._loop_clock = LoopClock(device_rate)

    def frame(self, records: NDArray[Any], now_s: float) -> bytes:
        """One frame of new records of the ring, (n,) of `RECORD_DTYPE`."""
        block = RecordBlock(records)
        whole = {channel: _whole(block.of(channel)) for channel in SENSORS if channel in block}
        arrived_s, all_values = block.arrived_s, block.values
        series: dict[int, Series] = {}
        for channel in SHOWN:
            if channel in whole:
                series[channel] = self._placed(channel, whole[channel])
            elif channel in block:
                place = block.place(channel)
                series[channel] = arrived_s[place], all_values[place]
        time, *values = self._loop.points(*self._together(whole, series))
        stride = max(1, -(-len(time) // MOST_LOOP_POINTS))
        loop = {
            number: (time[::stride], value[::stride])
            for number, value in zip((LOOP_X, LOOP_V, LOOP_F), values, strict=True)
        }
        shown = {**{channel: thinned(*pair) for channel, pair in series.items()}, **(loop if len(time) else {})}
        return packed(shown, now_s)

    def _together(
        self, whole: Mapping[int, NDArray[Any]], series: Mapping[int, Series]
    ) -> tuple[Series, Series]:
        """Displacement and force on one clock; where one of them has none, as they arrived."""
        x, f = (whole.get(channel, _NONE) for channel in (DISPLACEMENT, FORCE))
        if all(len(one) == 0 or one["device_us"][0] != NO_DEVICE_TIME for one in (x, f)):
            x_s, f_s = self._loop_clock.times(x, f)
            return (x_s, x["value"]), (f_s, f["value"][: len(f_s)])
        empty = np.empty(0), np.empty(0)
        return series.get(DISPLACEMENT, empty), series.get(FORCE, empty)

    def _placed(self, channel: int, records: NDArray[Any]) -> Series:
        if len(records) == 0:
            return np.empty(0), np.empty(0)
        return self._clocks[channel].host_s(records), records["value"]


_NONE = np.zeros(0, RECORD_DTYPE)


def _whole(records: NDArray[Any]) -> NDArray[Any]:
    """Those that carry a value."""
    known: NDArray[np.bool_] = ((records["flags"] & NO_VALUE) == 0) & np.isfinite(records["value"])
    return records if known.all() else records[known]


def packed(shown: Mapping[int, tuple[Floats, Floats]], now_s: float, kind: int = SAMPLES) -> bytes:
    """A frame of these series by channel: times (s, host) and values, (n,) each."""
    blocks = [(channel, time, value) for channel, (time, value) in shown.items() if len(time)]
    if not blocks:
        return HEADER.pack(kind, 0, now_s, now_s)
    base_s = min(float(time[0]) for _, time, _ in blocks)
    times = (np.concatenate([time for _, time, _ in blocks]) - base_s).astype("<f4").tobytes()
    values = np.concatenate([value for _, _, value in blocks]).astype("<f4").tobytes()
    parts, begin = [HEADER.pack(kind, len(blocks), base_s, now_s)], 0
    for channel, time, _ in blocks:
        end = begin + 4 * len(time)
        parts += BLOCK.pack(channel, 0, len(time)), times[begin:end], values[begin:end]
        begin = end
    return b"".join(parts)


def thinned(time: Floats, value: Floats, most: int = MOST_POINTS) -> tuple[Floats, Floats]:
    """At most `most` of a series: of each group the lowest and the highest, in their order."""
    if len(time) <= most:
        return time, value
    groups = most // 2
    edges = np.linspace(0, len(time), groups + 1).astype(int)
    chosen = sorted({index for low, high in _pairs(edges) for index in (
        low + int(np.argmin(value[low:high])), low + int(np.argmax(value[low:high])))})  # fmt: skip
    return time[chosen], value[chosen]


def _pairs(edges: NDArray[np.int_]) -> Iterable[tuple[int, int]]:
    return zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)


def _joined(first: tuple[Floats, Floats], then: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    return np.concatenate((first[0], then[0])), np.concatenate((first[1], then[1]))
