"""One delay per sensor: the estimates of all points of a campaign, combined.

A single point determines an undeclared delay to a fraction of a millisecond if the controller is polled slowly, and
hardly at all if the force is small; twenty points of the same sensors determine it several times better, and the
remaining error is common to all of them. The load train's compliance is one constant of the bench too: speed and force
differ from point to point, which distinguishes it from a delay of the displacement.

Without edges the signals align each point's clocks, or arrival times if the force is too weak. The latency of arrivals
is a property of the bench too, so points with a strong force calibrate those with a weak one (`behind_arrivals`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.recording.recorded_point import RecordedPoint
from rig.signals.delay_estimation.delay_model import Delay, Seen, Skew, at_likely_compliance, weighed
from rig.signals.estimate import Estimate, next_member

SENSORS = ("force", "displacement")
LATENCY_SCATTER_S = 0.4e-3
"""Median of the prior of how much the difference of two links' least latencies changes from point to point (standard
deviation): each may lie anywhere in a USB frame of 1 ms."""


@dataclass(frozen=True)
class PointSkew:
    """What to do to one point's force samples: move them by `shift_s`; `std_s` is then left uncertain (s).

    `trusted_std_s` remains if the declarations are trusted; `delays` is what the campaign found.
    """

    shift_s: float
    std_s: float
    trusted_std_s: float
    delays: Skew

    @property
    def force(self) -> Delay:
        """Delay of the force beyond the declared one."""
        return self.delays.force

    @property
    def displacement(self) -> Delay:
        """Delay of the displacement beyond the declared one."""
        return self.delays.displacement


def pooled_skews(points: Sequence[RecordedPoint]) -> dict[str, PointSkew]:
    """Shift and uncertainty for each point whose clocks are tied by edges, by the point's id.

    Points whose file says nothing about it are not in the answer: they keep what they have.

    Args:
        points: all points of a campaign, whatever they are used for: every one knows something of the same sensors.
    """
    groups: dict[tuple[object, ...], list[RecordedPoint]] = {}
    for point in points:
        if all(point.quality.sensor(name).tie_std_s is not None for name in SENSORS):
            groups.setdefault(_sensors(point), []).append(point)
    skews: dict[str, PointSkew] = {}
    for group in groups.values():
        delays = weighed(_seen("force", group), _seen("displacement", group), _input_delay_s(group[0]))
        skews |= {point.id: _of_point(point, delays) for point in group}
    return skews


@dataclass(frozen=True)
class BehindArrivals:
    """What a campaign without edges knows of one point: `lag`, as `sensor_clock.timed_sensors` takes it (s).

    `std_s` is the standard deviation of the skew that is left with it, or without it where that is smaller (s).
    """

    lag: Estimate
    std_s: float


def behind_arrivals(points: Sequence[RecordedPoint]) -> dict[str, BehindArrivals]:
    """By how much force lags displacement if paired by their earliest arrivals, for points without edges, by their id.

    That is a property of the bench: the sensors' delays and the least latencies of their links. Points with a strong
    force signal measure it; points with a weak one are tied by it. Latencies differ from point to point by an unknown
    amount (`LATENCY_SCATTER_S`), so one strong point is not worth more than that.

    Args:
        points: all points of a campaign, whatever they are used for.
    """
    groups: dict[tuple[object, ...], list[RecordedPoint]] = {}
    for point in points:
        key = (point.provenance.get("bench_hash"), _input_delay_s(point), _device_rate(point))
        groups.setdefault(key, []).append(point)
    ties: dict[str, BehindArrivals] = {}
    for group in groups.values():
        known = [lag for lag in map(_behind_arrivals, group) if lag is not None]
        if known:
            common = next_member(known, LATENCY_SCATTER_S * _device_rate(group[0]))
            ties |= {point.id: tie for point in group if (tie := _tied(point, common)) is not None}
    return ties


def _device_rate(point: RecordedPoint) -> float:
    return float(point.test.get("device_rate", 1.0))


def _tied(point: RecordedPoint, common: Estimate) -> BehindArrivals | None:
    """One point tied by all; None where edges tie it, or its own signals tie neither sensor."""
    sure, weak = sorted((point.quality.sensor(name) for name in SENSORS), key=lambda sensor: sensor.clock_std_s or 0.0)
    if sure.arrival_lag is None or sure.arrival_scatter_s is None or weak.arrival_scatter_s is None:
        return None
    lag, sure_s = common.widened(math.hypot(sure.arrival_scatter_s, weak.arrival_scatter_s)), sure.clock_std_s or 0.0
    return BehindArrivals(lag, math.hypot(sure_s, min(weak.clock_std_s or 0.0, math.hypot(sure_s, lag.std))))


def _behind_arrivals(point: RecordedPoint) -> Estimate | None:
    """The same by one point's own signals; None where they do not tie both sensors."""
    force, displacement = (point.quality.sensor(name) for name in SENSORS)
    if force.arrival_lag is None or displacement.arrival_lag is None:
        return None
    stds = (force.arrival_lag.std, displacement.arrival_lag.std)
    scatters = (sensor.arrival_scatter_s or 0.0 for sensor in (force, displacement))
    return Estimate(force.arrival_lag.value - displacement.arrival_lag.value, math.hypot(*stds, *scatters))


def _sensors(point: RecordedPoint) -> tuple[object, ...]:
    """What makes two points' delays the same: the bench, and the delays it declared."""
    declared_s = (point.quality.sensor(name).declared_delay_s for name in SENSORS)
    return (point.provenance.get("bench_hash"), _input_delay_s(point), *declared_s)


def _input_delay_s(point: RecordedPoint) -> float | None:
    delay_s = point.test.get("controller_input_delay_s")
    return None if delay_s is None else float(delay_s)


def _tie_std_s(name: str, point: RecordedPoint) -> float:
    return point.quality.sensor(name).tie_std_s or 0.0


def _seen(name: str, group: Sequence[RecordedPoint]) -> Seen:
    declared_s = group[0].quality.sensor(name).declared_delay_s
    tie_s = math.sqrt(sum(_tie_std_s(name, point) ** 2 for point in group)) / len(group)
    pooled = _pooled(name, group)
    if pooled is not None:
        return Seen(declared_s, pooled[0], math.hypot(pooled[1], tie_s))
    return Seen(declared_s, input=any(bool(point.quality.sensor(name).compared) for point in group))


def _pooled(name: str, group: Sequence[RecordedPoint]) -> tuple[float, float] | None:
    """Lag and its standard deviation by all points; wider where they scatter more than they say; None without any."""
    information, weighted, seen = np.zeros((2, 2)), np.zeros(2), []
    for point in group:
        sensor = point.quality.sensor(name)
        lag = sensor.lag
        if lag is None or not lag.std > 0.0:
            continue
        values, inverse = np.array([lag.value, 0.0]), np.diag([lag.std**-2, 0.0])
        coupling, compliance_std = sensor.matched_coupling, sensor.reference_compliance_std_m_N
        if coupling is not None and compliance_std is not None and sensor.reference_compliance_m_N is not None:
            values[1] = sensor.reference_compliance_m_N
            inverse = np.linalg.inv(np.array([[lag.std**2, coupling], [coupling, compliance_std**2]]))
        seen.append((values, inverse))
        information += inverse
        weighted += inverse @ values
    if not seen:
        return None
    known = 2 if information[1, 1] > 0.0 else 1
    covariance = np.linalg.inv(information[:known, :known])
    together = np.zeros(2)
    together[:known] = covariance @ weighted[:known]
    chi = sum(float((values - together) @ inverse @ (values - together)) for values, inverse in seen)
    widening = max(1.0, chi / (known * (len(seen) - 1))) if len(seen) > 1 else 1.0
    std = np.sqrt(widening * np.diag(covariance))
    if known == 1:
        return float(together[0]), float(std[0])
    return at_likely_compliance(
        float(together[0]), float(std[0]), float(together[1]), float(std[1]), widening * float(covariance[0, 1])
    )


def _of_point(point: RecordedPoint, delays: Skew) -> PointSkew:
    applied = {name: point.quality.sensor(name).undeclared_delay_s or 0.0 for name in SENSORS}
    tie_s = math.hypot(*(_tie_std_s(name, point) for name in SENSORS))
    shift_s = (applied["force"] - delays.force.value_s) - (applied["displacement"] - delays.displacement.value_s)
    return PointSkew(shift_s, math.hypot(delays.std_s, tie_s), math.hypot(delays.trusted_std_s, tie_s), delays)
