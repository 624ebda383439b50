"""The ring's records made ready for charts: binary frames of the newest samples, thinned, and the loops' points.

A frame, little-endian, everything aligned to 4 bytes:

    u32 kind (1) | u32 number of blocks | f64 base | f64 now          s, host's monotonic clock
    u32 kind (2) | ...                                                s, a recorded point's own time; now: its end;
                                                                      after the blocks the point's id (UTF-8)
    block:  u16 channel | u16 0 | u32 n | n x f32 time after base (s) | n x f32 value (SI)

Channels are the ring's (`drivers.ring.Channel`), values as recorded. 201, 202, 203 are a loop's displacement (m),
velocity (m/s) and force (N), taken together: force at the displacement's times, on the devices' own clocks where both
have one; their delays are corrected in the recording, not here. A loop's times count by the displacement sensor's clock
from wherever it was first heard, and fall behind the host's on a simulated rig that is slower than it was asked to be.
"""

from __future__ import annotations

import math
import struct
from array import array
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import accumulate, pairwise
from operator import itemgetter, mul, sub
from statistics import median
from typing import NamedTuple

from drivers.ring import NO_DEVICE_TIME, Channel
from protocols.quality import NO_VALUE

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
SHOWN = tuple(map(int, (
    Channel.FORCE, Channel.DISPLACEMENT, *range(Channel.AUXILIARY_1, Channel.AUXILIARY_7 + 1), Channel.COIL_CURRENT,
    Channel.COIL_TEMPERATURE, Channel.ECU_TEMPERATURE, Channel.COMMANDED_CURRENT, Channel.POSITION, Channel.STATE,
    Channel.SUPPLY_PRESSURE,
)))  # fmt: skip
FORCE, DISPLACEMENT = int(Channel.FORCE), int(Channel.DISPLACEMENT)
SENSORS = range(int(Channel.FORCE), int(Channel.AUXILIARY_7) + 1)
_SHOWN, _NO_VALUE = frozenset(SHOWN), int(NO_VALUE)

Series = tuple[Sequence[float], Sequence[float]]
"""Times (s) and values, as long as each other."""


class Column(NamedTuple):
    """Records of one channel, oldest first: arrivals at the host (ns), device times (us), values (SI)."""

    host_ns: Sequence[int]
    device_us: Sequence[int]
    values: Sequence[float]

    @property
    def clocked(self) -> bool:
        """Whether the device has a clock of its own, as far as these say."""
        return not self.host_ns or self.device_us[0] != NO_DEVICE_TIME


NOTHING = Column((), (), ())


def columns(records: bytes) -> dict[int, Column]:
    """Columns of raw ring records of the displayed channels; for sensors, only records with a value."""
    # Item by item in C (`drivers.ring`: 8-byte words 0 to 2, 2-byte words 14 and 15 of a record): half the time.
    words, numbers = memoryview(records).cast("q"), memoryview(records).cast("H")
    host_ns, device_us = words[0::4].tolist(), words[1::4].tolist()
    values = memoryview(records).cast("d")[2::4].tolist()
    flags = numbers[15::16].tolist()
    places: dict[int, list[int]] = {}
    for place, channel in enumerate(numbers[14::16].tolist()):
        if channel in _SHOWN:
            if channel in places:
                places[channel].append(place)
            else:
                places[channel] = [place]
    by_channel = {}
    for channel, of_one in places.items():
        if channel in SENSORS:
            of_one = [place for place in of_one if not flags[place] & _NO_VALUE and math.isfinite(values[place])]
        if len(of_one) > 1:
            pick = itemgetter(*of_one)
            by_channel[channel] = Column(pick(host_ns), pick(device_us), pick(values))
        else:
            by_channel[channel] = Column(*([one[place] for place in of_one] for one in (host_ns, device_us, values)))
    return by_channel


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
        self._arrivals: deque[tuple[int, int]] = deque(maxlen=RATE_OVER)
        self._offsets_ns: deque[float] = deque(maxlen=REMEMBERED)
        self._last_s = -math.inf

    def host_s(self, column: Column) -> list[float]:
        """Times of one channel's records, s; of a device without a clock the arrivals."""
        host_ns, device_us = column.host_ns, column.device_us
        if not host_ns or device_us[0] == NO_DEVICE_TIME:
            return [at_ns * 1e-9 for at_ns in host_ns]
        scale_ns = self._scale_ns
        if not self._measured:
            self._offsets_ns.append(min(map(sub, host_ns, map(scale_ns.__mul__, device_us))))
            offset_ns = min(self._offsets_ns)
            return self._onwards([(at_us * scale_ns + offset_ns) * 1e-9 for at_us in device_us])
        self._arrivals.append((host_ns[-1], device_us[-1]))
        (host_0, device_0), (host_1, device_1) = self._arrivals[0], self._arrivals[-1]
        if device_1 > device_0 and host_1 > host_0:
            scale_ns = (host_1 - host_0) / (device_1 - device_0)
        since_ns = [(at_us - device_1) * scale_ns for at_us in device_us]
        self._offsets_ns.append(min(at_ns - host_1 - since for at_ns, since in zip(host_ns, since_ns, strict=True)))
        offset_ns = host_1 + self._soonest(scale_ns)
        return self._onwards([(since + offset_ns) * 1e-9 for since in since_ns])

    def _onwards(self, times_s: list[float]) -> list[float]:
        """Never before what was shown already."""
        last_s = self._last_s
        if times_s[0] < last_s:
            times_s = [max(time_s, last_s) for time_s in times_s]
        self._last_s = times_s[-1]
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

    def together(self, displacement: Column, force: Column) -> tuple[Series, Series]:
        """Both sensors' records on one clock (s); of force none before both were heard."""
        if displacement.host_ns:
            newest_us = displacement.device_us[-1]
            if self._anchor_s is None or displacement.device_us[0] <= self._last_us:  # or switched off and on
                self._apart_s.clear()
                self._compared = 0
                self._anchor_s = displacement.host_ns[-1] * 1e-9 - newest_us * 1e-6 / self._rate
            self._last_us = newest_us
            if force.host_ns:
                self._compare(displacement, force)
        if self._anchor_s is None or not self._apart_s:
            force = NOTHING
        anchor_s, scale_s = self._anchor_s or 0.0, 1e-6 / self._rate
        force_anchor_s = anchor_s + self._median_s / self._rate
        x_s = [at_us * scale_s + anchor_s for at_us in displacement.device_us]
        f_s = [at_us * scale_s + force_anchor_s for at_us in force.device_us]
        return (x_s, displacement.values), (f_s, force.values)

    def _compare(self, displacement: Column, force: Column) -> None:
        self._apart_s.append(self._lag_s(force) - self._lag_s(displacement))
        self._compared += 1
        if self._compared <= MEDIAN_EVERY or self._compared % MEDIAN_EVERY == 0:
            self._median_s = median(self._apart_s)

    def _lag_s(self, column: Column) -> float:
        scale_s = 1e-9 * self._rate
        lag_s: float = min(map(sub, map(scale_s.__mul__, column.host_ns), map((1e-6).__mul__, column.device_us)))
        return lag_s


class Loop:
    """Displacement, velocity and force taken together.

    Args:
        rate_Hz: of the displacement sensor, its own clock.
    """

    def __init__(self, rate_Hz: float) -> None:
        half = max(FEWEST_FITTED, round(FITTED_S * rate_Hz)) // 2
        self._half = half
        # By the sensor's own rate: arrivals at the host are no measure of a step of 4 ms.
        self._weight = 3.0 * rate_Hz / (half * (half + 1) * (2 * half + 1))
        self._x: tuple[list[float], list[float]] = [], []
        self._f: tuple[list[float], list[float]] = [], []

    def points(self, displacement: Series, force: Series) -> tuple[list[float], list[float], list[float], list[float]]:
        """New points from new samples, at most `MOST_LOOP_POINTS`.

        Args:
            displacement: times (s) and values (m); may be empty.
            force: times (s, the same clock) and values (N).

        Returns:
            Times (s), displacement (m), velocity (m/s), force (N), as long as each other.
        """
        if displacement[0] and self._x[0] and displacement[0][0] < self._x[0][-1]:
            self._x, self._f = ([], []), ([], [])  # its clock began anew
        for kept, came in ((self._x, displacement), (self._f, force)):
            kept[0].extend(came[0])
            kept[1].extend(came[1])
        (time_s, x_m), (force_s, _), half = self._x, self._f, self._half
        ready = bisect_right(time_s, force_s[-1]) if force_s else 0
        count = min(len(time_s) - 2 * half, ready - half)
        if count <= 0:
            self._cut(max(0, len(time_s) - 20 * half - MOST_LOOP_POINTS))
            return [], [], [], []
        places = range(half, half + count)
        if time_s[half] < force_s[0]:
            places = places[bisect_left(time_s, force_s[0], half, half + count) - half :]
        places = places[:: max(1, -(-len(places) // MOST_LOOP_POINTS))]
        shown_s = [time_s[place] for place in places]
        shown_m, slopes_m_s = [x_m[place] for place in places], self._slopes(places)
        forces_N = [self._force(at_s) for at_s in shown_s]
        self._cut(count)
        return shown_s, shown_m, slopes_m_s, forces_N

    def _slopes(self, places: range) -> list[float]:
        """The displacement's slope about each place (m/s), by least squares, from running sums."""
        if not places:
            return []
        half, x_m = self._half, self._x[1][: places[-1] + self._half + 1]
        sums = [0.0, *accumulate(x_m)]
        moments = [0.0, *accumulate(map(mul, x_m, range(len(x_m))))]
        slopes = []
        for place in places:
            begin, end = place - half, place + half + 1
            about = moments[end] - moments[begin] - place * (sums[end] - sums[begin])
            slopes.append(self._weight * about)
        return slopes

    def _force(self, at_s: float) -> float:
        """Between the two samples about a time (N)."""
        times_s, force_N = self._f
        after = bisect_left(times_s, at_s)
        if after == 0 or times_s[after] == at_s:
            return force_N[after]
        before_s, before_N = times_s[after - 1], force_N[after - 1]
        return before_N + (force_N[after] - before_N) * (at_s - before_s) / (times_s[after] - before_s)

    def _cut(self, count: int) -> None:
        for kept in self._x:
            del kept[:count]
        if self._x[0]:
            old = max(0, bisect_left(self._f[0], self._x[0][0]) - 1)
            for kept in self._f:
                del kept[:old]


class Frames:
    """Records in, frames out; in plain Python, which costs less than numpy for so few numbers now and then.

    Args:
        device_rate: device seconds in a host second.
        displacement_Hz: the displacement sensor's rate, its own clock.
    """

    def __init__(self, device_rate: float, displacement_Hz: float) -> None:
        self._clocks = {channel: DeviceTime(device_rate) for channel in SENSORS}
        self._loop = Loop(displacement_Hz)
        self._loop_clock = LoopClock(device_rate)

    def frame(self, records: bytes, now_s: float) -> bytes:
        """One frame of new raw ring records."""
        by_channel = columns(records)
        series: dict[int, Series] = {}
        for channel in SHOWN:
            column = by_channel.get(channel)
            if column is not None:
                clock = self._clocks.get(channel)
                times = [at_ns * 1e-9 for at_ns in column.host_ns] if clock is None else clock.host_s(column)
                series[channel] = times, column.values
        time, *values = self._loop.points(*self._together(by_channel, series))
        shown = {channel: thinned(*pair) for channel, pair in series.items()}
        for channel, value in zip((LOOP_X, LOOP_V, LOOP_F), values, strict=True):
            shown[channel] = time, value
        return packed(shown, now_s)

    def _together(self, by_channel: Mapping[int, Column], series: Mapping[int, Series]) -> tuple[Series, Series]:
        """Displacement and force on one clock; where one of them has none, as they arrived."""
        x, f = by_channel.get(DISPLACEMENT, NOTHING), by_channel.get(FORCE, NOTHING)
        if x.clocked and f.clocked:
            return self._loop_clock.together(x, f)
        empty: Series = (), ()
        return series.get(DISPLACEMENT, empty), series.get(FORCE, empty)


def packed(shown: Mapping[int, Series], now_s: float, kind: int = SAMPLES) -> bytes:
    """A frame of these series by channel: times (s, host) and values, as long as each other."""
    blocks = [(channel, time, value) for channel, (time, value) in shown.items() if len(time)]
    base_s = min([float(time[0]) for _, time, _ in blocks], default=now_s)
    parts = [HEADER.pack(kind, len(blocks), base_s, now_s)]
    for channel, time, value in blocks:
        if (count := len(time)) <= MOST_LOOP_POINTS:
            parts.append(_block(count)(channel, 0, count, *[at_s - base_s for at_s in time], *value))
        else:
            since_s = array("f", [at_s - base_s for at_s in time])
            parts += BLOCK.pack(channel, 0, count), since_s.tobytes(), array("f", value).tobytes()
    return b"".join(parts)


@cache
def _block(count: int) -> Callable[..., bytes]:
    """Structure that packs a block of `count` samples."""
    return struct.Struct(f"<HHI{2 * count}f").pack


def thinned(time: Sequence[float], value: Sequence[float], most: int = MOST_POINTS) -> Series:
    """At most `most` of a series: of each group the lowest and the highest, in their order."""
    count = len(time)
    if count <= most:
        return time, value
    groups = most // 2
    edges = [count * group // groups for group in range(groups + 1)]
    chosen: set[int] = set()
    for edge, then in pairwise(edges):
        places = range(edge, then)
        chosen |= {min(places, key=value.__getitem__), max(places, key=value.__getitem__)}
    kept = sorted(chosen)
    return [time[place] for place in kept], [value[place] for place in kept]
