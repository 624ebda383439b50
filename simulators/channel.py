"""A sensor of the simulated rig with its port."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from simulators.sensor import Sensor
from simulators.serial_port import SensorPort

MOST_WAITING = 4096
"""Requests that a device keeps; what comes beyond is forgotten."""


@dataclass
class Channel:
    """A sensor, its port, and the column of the plant's output it measures."""

    name: str
    sensor: Sensor
    port: SensorPort
    column: int
    _unfinished: bytes = field(default=b"", init=False)
    _requested_once: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        if self.sensor.requests is not None:
            self.port.listen()

    def hear(self, now_ns: int, start_s: float, end_s: float, speed: float) -> None:
        """Take the requests that have come to a sensor that is asked.

        At speed 1 each is answered by the sample of the moment it came at; at another, where the host cannot know that
        moment, by the next one of the sensor's own clock.

        Args:
            now_ns: host's monotonic clock, at the slice's end.
            start_s: the slice's begin, simulated time (s).
            end_s: its end.
            speed: of simulated time.
        """
        waiting, layout = self.sensor.requests, self.sensor.options.format
        if waiting is None or isinstance(layout, str):
            return
        request = layout.exchange.request
        for came_ns, data in self.port.heard():
            *requests, self._unfinished = (self._unfinished + data).split(request)
            self._unfinished = self._unfinished[-len(request) :]
            moment_s = min(end_s, max(start_s, end_s - (now_ns - came_ns) * 1e-9)) if speed == 1.0 else math.nan
            waiting += [moment_s] * len(requests)
            self._requested_once |= bool(requests)
        del waiting[MOST_WAITING:]

    @property
    def read_once(self) -> bool:
        """Whether a client has ever asked; the rig's clock may wait for it."""
        return self._requested_once

    def unread(self) -> int:
        """1 while a sensor that is asked waits for the next request; for whom the rig's clock may wait."""
        return int(self.sensor.requests is not None and not self.sensor.requests)
