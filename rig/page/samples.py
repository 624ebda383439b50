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
from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from itertools import accumulate, pairwise
from operator import mul
from typing import Any

from drivers.ring import Channel
from rig.page.clocks import NOTHING, SENSORS, SHOWN, Column, DeviceTime, LoopClock, Series, columns

HEADER = struct.Struct("<IIdd")
BLOCK = struct.Struct("<HHI")
SAMPLES, RECORDED = 1, 2
LOOP_X, LOOP_V, LOOP_F = 201, 202, 203
MOST_POINTS, MOST_LOOP_POINTS = 40, 240
"""Of one channel in one frame; more are thinned to the lowest and the highest of each group, loops evenly."""
FEWEST_FITTED, FITTED_S = 5, 0.016
"""Samples, and device seconds, over which the velocity is the displacement's slope."""
FORCE, DISPLACEMENT = int(Channel.FORCE), int(Channel.DISPLACEMENT)


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

    def frame(self, records: Any, now_s: float) -> bytes:  # noqa: ANN401 - a buffer
        """One frame of new records of the ring: a buffer of them as they lie there."""
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
        since_s = array("f", [at_s - base_s for at_s in time])
        parts += BLOCK.pack(channel, 0, len(since_s)), since_s.tobytes(), array("f", value).tobytes()
    return b"".join(parts)


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
