"""One delay for one sensor: what each point saw of the sensors' delays, taken together over a campaign.

A point alone sees an undeclared delay to a fraction of a millisecond where the controller is polled seldom, and hardly
at all where the force is small; twenty points of the same sensors see it several times better, and what remains is one
error shared by all of them. The load train's compliance is one constant of the bench too: speed and force differ from
point to point, which tells it from a delay of the displacement.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.recording.recorded_point import RecordedPoint
from rig.signals.delay_estimation.delay_model import Delay, Seen, Skew, at_likely_compliance, weighed

SENSORS = ("force", "displacement")


@dataclass(frozen=True)
class PointSkew:
    """What to do to one point's force samples: move them by `shift_s`; `std_s` is then left uncertain (s).

    `trusted_std_s` is left for somebody who trusts what was declared; `delays` is what the campaign found.
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
