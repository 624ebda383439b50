"""Clock models: from a device's own clock (or its sample count) to the controller's clock, with what is uncertain.

Methods, best first:
- `edges`: the controller's cycle pulse, latched in both clocks; straight line through the pairs.
- `signals`: the sensor's samples laid over the controller's own record of the same quantity (`signal_match`).
- `device clock`: lower envelope of arrival minus device time, since no sample arrives before it was taken.
- `campaign`: as the device clock, less what the campaign's other points measured its arrivals to be late by.
- `order of arrival`: what came last before each status of the controller, on a rig whose clocks outrun the wall.
- `nominal rate`: as the device clock, with sample count / nominal rate in place of a device clock.
- `arrival`: the arrival itself, for slow channels that carry neither.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.signals.arrays import FloatArray

if TYPE_CHECKING:
    from rig.signals.chunked_column import Values

ARRIVAL = "arrival"
EDGES = "edges"
CAMPAIGN = "campaign"
"""Method of a channel that carries neither clock nor sequence."""
LARGEST_DRIFT = 1e-3
"""Relative rate error beyond which a fitted drift is not believed (crystals: 1e-4)."""
EDGE_PRIOR_S = 5e-6
"""Latching scatter assumed before any is measured; weighs like `EDGE_PRIOR_COUNT` pairs."""
EDGE_PRIOR_COUNT = 2
CLOCK_RESOLUTION_S = 0.5e-6
"""Both clocks count whole microseconds: no number of edges shows less."""
UNKNOWN_LATENCY_S = 2e-3
"""One standard deviation of the least latency of a link that offers no edge: adapters (USB: 1 ms frames and a few of
them in low-latency mode), drivers, the host's wake-up."""
CRYSTAL_DRIFT = 1e-4
"""Relative rate error of a clock about which nothing is known."""
SHORTEST_SPAN_S = 0.2
"""Edges nearer together than this tell nothing about the drift."""
ENVELOPE_BLOCKS = 40
LOSS_PERIODS = 0.5
"""Arrivals that wander against a count of samples by more than this share of a period may hide a lost sample."""
FAST_RIG_LATENCIES = 4.0
"""On a rig that outruns the wall arrivals wander by so many unknown latencies though nothing was lost."""


@dataclass(frozen=True)
class ClockModel:
    """`controller time = offset_s + rate (local - origin_s)`, all s.

    `std_s` is one standard deviation of the result, typical over the test; `rate_std` that of the rate. `scatter_s` is
    how far the arrivals scatter about a lower envelope (s), which `std_s` includes.
    """

    origin_s: float
    offset_s: float
    rate: float
    std_s: float
    method: str
    rate_std: float = 0.0
    scatter_s: float = 0.0

    @property
    def rate_measured(self) -> bool:
        """Whether the rate is known better than that of any crystal."""
        return self.rate_std < CRYSTAL_DRIFT

    def time_s(self, local_s: FloatArray) -> FloatArray:
        """Controller time (n,) in s of local times (n,) in s."""
        return np.asarray(self.offset_s + self.rate * (local_s - self.origin_s))

    def moved(self, lag_s: float, drift: float, middle_s: float, std_s: float, drift_std: float) -> ClockModel:
        """The same clock once its times are known to be late by `lag_s + drift (time - middle_s)` (s)."""
        late_s = lag_s + drift * (self.offset_s - middle_s)
        return ClockModel(
            self.origin_s, self.offset_s - late_s, self.rate * (1.0 - drift), std_s, "signals", drift_std,
        )

    def late(self, lag_s: float, std_s: float) -> ClockModel:
        """The same clock once other points of its campaign have shown its times to be late by `lag_s` (s)."""
        return replace(self, offset_s=self.offset_s - lag_s, std_s=std_s, method=CAMPAIGN)


IDENTITY = ClockModel(0.0, 0.0, 1.0, 0.0, "controller clock")


@dataclass(frozen=True)
class HostMap:
    """Controller time at a host instant, from the status polls: piecewise straight, `host_s` and `clock_s` (m,).

    `lag_s` is the least round trip, by which a poll's clock is older than its arrival (controller seconds).
    """

    host_s: FloatArray
    clock_s: FloatArray
    lag_s: float

    def time_s(self, host_ns: NDArray[Any]) -> FloatArray:
        """Controller time (n,) in s at host times (n,) in ns; beyond the polls it continues straight."""
        host_s = np.asarray(host_ns, np.float64) * 1e-9
        if len(self.host_s) == 1:
            return np.asarray(host_s - self.host_s[0] + self.clock_s[0])
        inside = np.interp(host_s, self.host_s, self.clock_s)
        slope = (self.clock_s[-1] - self.clock_s[0]) / (self.host_s[-1] - self.host_s[0])
        before, after = host_s < self.host_s[0], host_s > self.host_s[-1]
        inside[before] = self.clock_s[0] + slope * (host_s[before] - self.host_s[0])
        inside[after] = self.clock_s[-1] + slope * (host_s[after] - self.host_s[-1])
        return np.asarray(inside)


def host_map(host_ns: NDArray[Any], device_us: NDArray[Any], device_rate: float) -> HostMap:
    """The map from host time to controller time.

    At speed 1 the two clocks drift but never jump, so the map is one straight envelope. A simulated rig may fall
    behind: then the polls are followed one by one.

    Args:
        host_ns: arrival of each status (m,), ns, monotonic.
        device_us: the controller's clock in it (m,), us.
        device_rate: seconds of device clock per second of wall time.
    """
    if len(host_ns) == 0:
        return HostMap(np.zeros(1), np.zeros(1), 0.0)
    host_s, clock_s = host_ns * 1e-9, device_us * 1e-6
    keep = np.concatenate(([True], np.diff(host_s) > 0))
    host_s, clock_s = host_s[keep], clock_s[keep]
    if device_rate == 1.0 and len(host_s) > 2:
        line = by_envelope(clock_s, host_s)
        return HostMap(line.time_s(clock_s[[0, -1]]), clock_s[[0, -1]], line.std_s)
    return HostMap(host_s, clock_s, UNKNOWN_LATENCY_S * device_rate)


def by_edges(local_s: FloatArray, reference_s: FloatArray) -> ClockModel:
    """Straight line through latched pairs (k,), s.

    The scatter is pooled with a prior (`EDGE_PRIOR_S`), so that two pairs, which always fit, claim no perfection. A
    single pair fixes the offset only, and the drift is then a crystal's (`CRYSTAL_DRIFT`). Pairs more than 6 robust
    deviations off are left out.

    Raises:
        ValueError: there is no pair.
    """
    if len(local_s) == 0:
        raise ValueError("no pair of edges is available for fitting the clock")
    difference = reference_s - local_s
    slope_known = len(local_s) >= 2 and float(np.ptp(local_s)) >= SHORTEST_SPAN_S
    rough = difference - (_median_slope(local_s, difference) if slope_known else 0.0) * local_s
    rough -= np.median(rough)
    keep = np.abs(rough) <= 6.0 * max(1.4826 * float(np.median(np.abs(rough))), EDGE_PRIOR_S)
    line = _line(local_s[keep], difference[keep], slope_known)
    residual = difference - (line[0] + line[1] * (local_s - line[2]))
    count = int(keep.sum())
    freedom = max(count - 2, 0)
    squares = float(np.sum(residual[keep] ** 2)) if freedom else 0.0
    scatter = float(np.sqrt((squares + EDGE_PRIOR_COUNT * EDGE_PRIOR_S**2) / (freedom + EDGE_PRIOR_COUNT)))
    offset, slope, origin = line
    spread = float(np.sum((local_s[keep] - origin) ** 2))
    rate_std = scatter / np.sqrt(spread) if slope_known and spread > 0.0 else CRYSTAL_DRIFT
    std_s = max(scatter / np.sqrt(count), CLOCK_RESOLUTION_S)
    return ClockModel(origin, origin + offset, 1.0 + slope, std_s, EDGES, float(rate_std))


def _median_slope(x: FloatArray, y: FloatArray) -> float:
    """Median of the slopes between points half the record apart: no few wild points move it."""
    half = len(x) // 2
    slope = float(np.median((y[half:] - y[:len(y) - half]) / (x[half:] - x[:len(x) - half])))
    return slope if abs(slope) <= LARGEST_DRIFT else 0.0


def _line(x: FloatArray, y: FloatArray, with_slope: bool) -> tuple[float, float, float]:
    origin = float(np.mean(x))
    centred = x - origin
    spread = float(np.sum(centred**2))
    slope = float(np.sum(centred * y)) / spread if with_slope and spread > 0 else 0.0
    return float(np.mean(y)), slope if abs(slope) <= LARGEST_DRIFT else 0.0, origin


def by_envelope(local_s: Values, arrival_s: Values, *, device_rate: float = 1.0) -> ClockModel:
    """Lower envelope of arrival over local time: the straight line nearest below all points.

    Its uncertainty is the scatter of the block minima about the line together with a least latency that cannot be seen
    from arrivals alone (`UNKNOWN_LATENCY_S`, in device seconds).

    Args:
        local_s: sample times in the device's clock (n,), s.
        arrival_s: the same samples' arrival, s, in the clock to go to.
        device_rate: device seconds per wall second; above 1 the drift is not fitted.
    """
    x, y = _block_minima(local_s, arrival_s)
    first_s, last_s = float(local_s[0]), float(local_s[-1])
    origin = 0.5 * (first_s + last_s)
    slope = _hull_slope(x - origin, y) if len(x) > 2 and device_rate == 1.0 else 0.0
    offset = float(np.min(y - slope * (x - origin)))
    scatter = float(np.median(y - slope * (x - origin) - offset))
    span_s = max(last_s - first_s, 1e-3)
    std = float(np.hypot(scatter, UNKNOWN_LATENCY_S * device_rate))
    rate_std = CRYSTAL_DRIFT if slope == 0.0 else 2.0 * scatter / span_s
    return ClockModel(origin, origin + offset, 1.0 + slope, std, "device clock", rate_std, scatter)


def miscount_std_s(local_s: Values, arrival_s: Values, period_s: float, *, device_rate: float = 1.0) -> float:
    """How uncertain a count of samples is as a clock, for lost samples that were not counted (s); 0 where none can be.

    A sample that is missing in the count puts all that follow too early, so the lower envelope of their arrival steps
    up by a period and stays there; a single late block does not. Half of what it wanders is one standard deviation.

    Args:
        local_s: sample count over nominal rate (n,), s.
        arrival_s: the same samples' arrival, s, in the clock to go to.
        period_s: nominal sample period, s.
        device_rate: device seconds per wall second.
    """
    x, y = _block_minima(local_s, arrival_s)
    if len(x) < 3:
        return 0.0
    origin, slope, centre = _line(x, y, with_slope=True)
    wander = y - origin - slope * (x - centre)
    middle = np.median(np.lib.stride_tricks.sliding_window_view(wander, 3), axis=1)
    hidden_s = 0.0 if device_rate == 1.0 else FAST_RIG_LATENCIES * UNKNOWN_LATENCY_S * device_rate
    reach_s = float(np.ptp(middle))
    return 0.5 * reach_s if reach_s > max(LOSS_PERIODS * period_s, hidden_s) else 0.0


def by_order(
    local_s: FloatArray, host_ns: NDArray[Any], poll_clock_s: FloatArray, poll_host_ns: NDArray[Any],
) -> ClockModel | None:
    """The offset of a clock whose frames come periodically, by which of them had arrived before each status.

    On a simulated rig that outruns the wall, a wall millisecond is many of the rig's, and arrivals laid between
    statuses are off by that much. But both come from one rig at one instant: the last frame before a status is between
    none and one period older than its clock, and the median over all statuses half a period.

    Args:
        local_s: times of the frames in their device's clock (n,), s, increasing.
        host_ns: their arrival (n,), ns.
        poll_clock_s: the controller's clock in its statuses (m,), s.
        poll_host_ns: their arrival (m,), ns.

    Returns:
        None when no status came between two frames.
    """
    last = np.searchsorted(host_ns, poll_host_ns, side="right") - 1
    between = (last >= 0) & (last < len(host_ns) - 1)
    if not np.any(between):
        return None
    period_s = float(np.median(np.diff(local_s)))
    older_s = poll_clock_s[between] - local_s[last[between]]
    middle_s = float(np.median(older_s))
    scatter_s = 1.4826 * float(np.median(np.abs(older_s - middle_s)))
    std_s = float(np.hypot(period_s / np.sqrt(12.0), 1.25 * scatter_s / np.sqrt(len(older_s))))
    origin_s = 0.5 * float(local_s[0] + local_s[-1])
    return ClockModel(
        origin_s, origin_s + middle_s - 0.5 * period_s, 1.0, std_s, "order of arrival", CRYSTAL_DRIFT,
    )


def _block_minima(local_s: Values, arrival_s: Values) -> tuple[FloatArray, FloatArray]:
    """Local time and lateness (s) of the sample that arrived soonest in each of at most `ENVELOPE_BLOCKS` blocks."""
    blocks = min(ENVELOPE_BLOCKS, max(1, len(local_s) // 8))
    bounds = np.linspace(0, len(local_s), blocks + 1).astype(np.int64)
    lowest = np.array([_lowest(local_s[a:b], arrival_s[a:b]) for a, b in itertools.pairwise(bounds.tolist())])
    return lowest[:, 0], lowest[:, 1]


def _lowest(local_s: FloatArray, arrival_s: FloatArray) -> tuple[float, float]:
    """The sample that arrived soonest: its local time and how much later it arrived, s."""
    late_s = arrival_s - local_s
    at = int(np.argmin(late_s))
    return float(local_s[at]), float(late_s[at])


def _hull_slope(x: FloatArray, y: FloatArray) -> float:
    """Slope of the lower convex hull's edge over x = 0; 0 when it cannot be a drift."""
    hull: list[int] = []
    for i in range(len(x)):
        while len(hull) > 1 and _turns_down(x, y, hull[-2], hull[-1], i):
            hull.pop()
        hull.append(i)
    for left, right in itertools.pairwise(hull):
        if x[left] <= 0.0 <= x[right]:
            slope = float((y[right] - y[left]) / (x[right] - x[left]))
            return slope if abs(slope) <= LARGEST_DRIFT else 0.0
    return 0.0


def _turns_down(x: FloatArray, y: FloatArray, a: int, b: int, c: int) -> bool:
    return bool((x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a]) <= 0.0)


def unwrapped(sequence: NDArray[np.uint32]) -> FloatArray:
    """Sample count (n,) from 0, of a sequence modulo 2^32; steps back (a restarted device) count as no step."""
    steps = np.mod(np.diff(sequence.astype(np.int64)), 1 << 32)
    steps[steps >= 1 << 31] = 0
    return np.concatenate(([0.0], np.cumsum(steps, dtype=np.float64)))
