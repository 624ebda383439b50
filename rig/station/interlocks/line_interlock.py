"""Interlocks on a sensor's line: the rate of damaged frames, and the drift of its clock; pure, no I/O."""

from __future__ import annotations

import math
import statistics
from collections import deque

from rig.station.interlocks.finding import Finding

WINDOW_S = 0.1
FEWEST_FRAMES = 25
FEWEST_DAMAGED = 3
DAMAGED_SHARE = 0.1
BLOCK_NS = 2_000_000_000
FEWEST_STEPS = 4
MOST_STEPS = 30
DRIFT_PPM = 250.0
"""Crystals keep 100 ppm of each other; a clock off by more is broken or not the one it is taken for."""


class LineInterlock:
    """Follows how many of the last frames came damaged: one is a warning, a tenth of them stops.

    A line that brings no good frame at all is not judged here: that is silence, or a wrong baud rate.

    Args (construction):
        name: of the sensor.
        rate_Hz: frames a second of the device's clock; the window is 0.1 s of them, at least 25.
    """

    def __init__(self, name: str, rate_Hz: float) -> None:
        self._name = name
        self._window = max(FEWEST_FRAMES, round(WINDOW_S * rate_Hz))
        self._batches: deque[tuple[int, int]] = deque()
        self._good = self._damaged = 0

    def check(self, good: int, damaged: int, t_ns: int) -> list[Finding]:
        """Take one read: `good` and `damaged` frames in it, arrived at `t_ns` (host monotonic)."""
        self._batches.append((good, damaged))
        self._good += good
        self._damaged += damaged
        while len(self._batches) > 1 and self._good + self._damaged - sum(self._batches[0]) >= self._window:
            before = self._batches.popleft()
            self._good -= before[0]
            self._damaged -= before[1]
        if not damaged:
            return []
        allowed = max(FEWEST_DAMAGED, DAMAGED_SHARE * max(self._window, self._good + self._damaged))
        detail = f"{self._name}: {self._damaged} of the last {self._good + self._damaged} frames damaged"
        stops = self._good > 0 and self._damaged >= allowed
        return [Finding("serial-garbage", detail, t_ns, self._damaged, allowed, warns=not stops)]


class ClockWatch:
    """Rate of a device's clock against the host's, by its least delayed samples.

    Each 2 s keep the least `arrival - device time`; the rate is the median of the steps between them, which neither a
    late host nor one leap of a clock moves. Host time means nothing to a device clock that does not run at the wall's
    rate: then nothing is watched.

    Args (construction):
        device_rate: device seconds a wall second.
    """

    def __init__(self, device_rate: float) -> None:
        self._watches = device_rate == 1.0
        self._begin_ns = -2 * BLOCK_NS
        self._least_ns: float = math.inf
        self._before_ns = math.inf
        self._steps: deque[float] = deque(maxlen=MOST_STEPS)

    @property
    def ppm(self) -> float:
        """How much faster than the host's the device's clock runs; NaN while not known."""
        if len(self._steps) < FEWEST_STEPS:
            return math.nan
        return -statistics.median(self._steps) / BLOCK_NS * 1e6

    def take(self, host_ns: int, device_us: int) -> bool:
        """Take one sample's arrival (host monotonic) and device time (unwrapped, -1: none); True when 2 s are full."""
        if not self._watches or device_us < 0:
            return False
        if host_ns - self._begin_ns < BLOCK_NS:
            self._least_ns = min(self._least_ns, host_ns - 1000.0 * device_us)
            return False
        full = host_ns - self._begin_ns < 2 * BLOCK_NS
        if full and math.isfinite(self._before_ns):
            self._steps.append(self._least_ns - self._before_ns)
        self._before_ns = self._least_ns if full else math.inf
        self._begin_ns, self._least_ns = host_ns, host_ns - 1000.0 * device_us
        return full


def drift(name: str, ppm: float, reference_ppm: float, t_ns: int) -> list[Finding]:
    """A finding when a sensor's clock is off the controller's; both in ppm of the host's, NaN while not known."""
    apart_ppm = ppm - reference_ppm
    if not abs(apart_ppm) > DRIFT_PPM:
        return []
    detail = f"{name}: clock differs by {apart_ppm:+.0f} ppm from the controller's clock, allowed: {DRIFT_PPM:.0f} ppm"
    return [Finding("clock-drift", detail, t_ns, apart_ppm, DRIFT_PPM)]


