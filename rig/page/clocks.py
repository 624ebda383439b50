"""The ring's records by channel, and when they were measured: device clocks laid on the host's, and on each other's."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from operator import sub
from statistics import median
from typing import Any, NamedTuple

from drivers.ring import NO_DEVICE_TIME, RECORD, Channel
from protocols.quality import NO_VALUE

REMEMBERED = 6
"""Frames over which a device's clock is compared with the host's."""
RATE_OVER, CLOCKS_OVER, MEDIAN_EVERY = 50, 250, 25
"""Frames over which a rig's own rate is measured, and two devices' clocks are compared; how often that is looked at."""
SHOWN = tuple(map(int, (
    Channel.FORCE, Channel.DISPLACEMENT, *range(Channel.AUXILIARY_1, Channel.AUXILIARY_7 + 1), Channel.COIL_CURRENT,
    Channel.COIL_TEMPERATURE, Channel.ECU_TEMPERATURE, Channel.COMMANDED_CURRENT, Channel.POSITION, Channel.STATE,
    Channel.SUPPLY_PRESSURE,
)))  # fmt: skip
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


def columns(records: Any) -> dict[int, Column]:  # noqa: ANN401 - a buffer: records of the ring as they lie there
    """The shown channels' records; of sensors those that carry a value."""
    rows: dict[int, list[tuple[Any, ...]]] = {}
    for row in RECORD.iter_unpack(records):
        channel = row[4]
        if channel in _SHOWN:
            if channel in rows:
                rows[channel].append(row)
            else:
                rows[channel] = [row]
    return {channel: _column(channel, of_one) for channel, of_one in rows.items()}


def _column(channel: int, rows: Sequence[tuple[Any, ...]]) -> Column:
    host_ns, device_us, values, _, _, flags = zip(*rows, strict=True)
    if channel not in SENSORS or (not any(flags) and all(map(math.isfinite, values))):
        return Column(host_ns, device_us, values)
    known = [row[:3] for row in rows if not row[5] & _NO_VALUE and math.isfinite(row[2])]
    return Column(*zip(*known, strict=True)) if known else NOTHING


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
