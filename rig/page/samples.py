"""The ring's records made ready for charts: binary frames of the newest samples, thinned, and the loops' points.

A frame, little-endian, everything aligned to 4 bytes:

    u32 kind (1) | u32 number of blocks | f64 base | f64 now          s, host's monotonic clock
    u32 kind (2) | ...                                                s, a recorded point's own time; now: its end
    block:  u16 channel | u16 0 | u32 n | n x f32 time after base (s) | n x f32 value (SI)

Channels are the ring's (`drivers.ring.Channel`), values as recorded. 201, 202, 203 are a loop's displacement (m),
velocity (m/s) and force (N), taken together: force at the displacement's times, on the devices' own clocks where they
have some; their delays are corrected in the recording, not here.
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
SHOWN = (
    Channel.FORCE, Channel.DISPLACEMENT, *range(Channel.AUXILIARY_1, Channel.AUXILIARY_7 + 1), Channel.COIL_CURRENT,
    Channel.COIL_TEMPERATURE, Channel.ECU_TEMPERATURE, Channel.COMMANDED_CURRENT, Channel.POSITION, Channel.STATE,
    Channel.FAULT_BITS, Channel.SUPPLY_PRESSURE, Channel.TRIP, Channel.LOOP_LATE,
)  # fmt: skip
SENSORS = range(Channel.FORCE, Channel.AUXILIARY_7 + 1)

Floats = NDArray[np.float64]


class DeviceTime:
    """Device times on the host's clock: what arrived soonest after it was measured says how far the clocks are apart.

    Only the last moments count: a simulated rig on a busy machine falls behind the rate that it was asked for.

    Args:
        rate: device seconds in a host second.
    """

    def __init__(self, rate: float) -> None:
        self._scale_ns = 1000.0 / rate
        self._offsets_ns: deque[float] = deque(maxlen=REMEMBERED)

    def host_s(self, records: NDArray[Any]) -> Floats:
        """Times of one channel's records, (n,), s; of a device without a clock the arrivals."""
        host_ns, device_us = records["host_ns"], records["device_us"]
        if device_us[0] == NO_DEVICE_TIME:
            arrivals: Floats = host_ns * 1e-9
            return arrivals
        device_ns = device_us * self._scale_ns
        self._offsets_ns.append(float((host_ns - device_ns).min()))
        times: Floats = (device_ns + min(self._offsets_ns)) * 1e-9
        return times


class Loop:
    """Displacement, velocity and force taken together.

    Args:
        rate_Hz: of the displacement sensor, its own clock.
    """

    def __init__(self, rate_Hz: float) -> None:
        half = max(FEWEST_FITTED, round(FITTED_S * rate_Hz)) // 2
        self._width = 2 * half + 1
        self._half = half
        self._weights = np.arange(-half, half + 1, dtype=float)
        self._rate_Hz = rate_Hz
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
        self._x, self._f = _joined(self._x, displacement), _joined(self._f, force)
        time, x = self._x
        ready = np.searchsorted(time, self._f[0][-1], "right") if len(self._f[0]) else 0
        count = min(len(time) - self._width + 1, int(ready) - self._half)
        if count <= 0:
            self._cut(max(0, len(time) - 10 * self._width - MOST_LOOP_POINTS))
            return np.empty(0), np.empty(0), np.empty(0), np.empty(0)
        windows = np.lib.stride_tricks.sliding_window_view(x, self._width)[:count]
        centre = slice(self._half, self._half + count)
        # By the sensor's own rate: arrivals at the host are no measure of a step of 4 ms.
        velocity = windows @ self._weights * (self._rate_Hz / float(self._weights @ self._weights))
        shown = time[centre], x[centre], velocity, np.interp(time[centre], *self._f)
        self._cut(count)
        return shown

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

    def frame(self, records: NDArray[Any], now_s: float) -> bytes:
        """One frame of new records of the ring, (n,) of `RECORD_DTYPE`."""
        block = RecordBlock(records)
        series = {channel: self._series(block, channel) for channel in SHOWN if channel in block}
        empty = np.empty(0), np.empty(0)
        time, *values = self._loop.points(
            series.get(Channel.DISPLACEMENT, empty), series.get(Channel.FORCE, empty)
        )
        stride = max(1, -(-len(time) // MOST_LOOP_POINTS))
        loop = {
            number: (time[::stride], value[::stride])
            for number, value in zip((LOOP_X, LOOP_V, LOOP_F), values, strict=True)
        }
        shown = {**{channel: thinned(*pair) for channel, pair in series.items()}, **(loop if len(time) else {})}
        return packed(shown, now_s)

    def _series(self, block: RecordBlock, channel: int) -> tuple[Floats, Floats]:
        records = block.of(channel)
        if channel not in self._clocks:
            return records["host_ns"] * 1e-9, records["value"]
        records = records[((records["flags"] & NO_VALUE) == 0) & np.isfinite(records["value"])]
        if len(records) == 0:
            return np.empty(0), np.empty(0)
        return self._clocks[channel].host_s(records), records["value"]


def packed(shown: Mapping[int, tuple[Floats, Floats]], now_s: float, kind: int = SAMPLES) -> bytes:
    """A frame of these series by channel: times (s, host) and values, (n,) each."""
    blocks = [(channel, time, value) for channel, (time, value) in shown.items() if len(time)]
    base_s = min((float(time[0]) for _, time, _ in blocks), default=now_s)
    parts: list[bytes] = [HEADER.pack(kind, len(blocks), base_s, now_s)]
    for channel, time, value in blocks:
        parts += (
            BLOCK.pack(channel, 0, len(time)), (time - base_s).astype("<f4").tobytes(), value.astype("<f4").tobytes(),
        )
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
