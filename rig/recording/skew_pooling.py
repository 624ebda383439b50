"""One delay for one sensor: what each point saw of the sensors' delays, taken together over a campaign.

A point alone sees an undeclared delay to a fraction of a millisecond where the controller is polled seldom; twenty
points of the same sensors see it several times better, and what remains is one error shared by all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rig.recording.run import RecordedPoint
from rig.recording.skew import Delay, pooled, tolerance_s, undeclared


@dataclass(frozen=True)
class Skew:
    """What to do to one point's force samples: move them by `shift_s`; `std_s` is then left uncertain (s).

    `force` and `displacement` are the delays beyond the declared ones that the campaign as a whole found.
    """

    shift_s: float
    std_s: float
    force: Delay
    displacement: Delay


def pooled_skews(points: Sequence[RecordedPoint]) -> dict[str, Skew]:
    """Shift and uncertainty for each point whose sensors could be checked, by the point's id.

    Points whose file says nothing about it are not in the answer: they keep what they have.
    """
    groups: dict[tuple[object, ...], list[RecordedPoint]] = {}
    for point in points:
        if "force_tie_std_s" in point.quality and "displacement_tie_std_s" in point.quality:
            groups.setdefault(_sensors(point), []).append(point)
    found: dict[str, Skew] = {}
    for group in groups.values():
        if len(group) > 1:
            force, displacement = _delay("force", group), _delay("displacement", group)
            found |= {point.id: _skew(point, force, displacement) for point in group}
    return found


def _sensors(point: RecordedPoint) -> tuple[object, ...]:
    """What makes two points' delays the same: the bench, and the delays it declared."""
    names = ("force_declared_delay_s", "displacement_declared_delay_s")
    return (point.provenance.get("bench_hash"), *(point.quality.get(name) for name in names))


def _delay(name: str, group: Sequence[RecordedPoint]) -> Delay:
    seen = [
        (float(point.quality[f"{name}_matched_lag_s"]), float(point.quality[f"{name}_matched_lag_std_s"]))
        for point in group
        if f"{name}_matched_lag_s" in point.quality
    ]
    measured = pooled(seen)
    declared_s = group[0].quality.get(f"{name}_declared_delay_s")
    measured_s, std_s = (None, 0.0) if measured is None else measured
    return undeclared(tolerance_s(declared_s), measured_s, std_s, stated=declared_s is not None)


def _skew(point: RecordedPoint, force: Delay, displacement: Delay) -> Skew:
    applied = {name: float(point.quality[f"{name}_undeclared_delay_s"]) for name in ("force", "displacement")}
    ties = [float(point.quality[f"{name}_tie_std_s"]) for name in ("force", "displacement")]
    shift_s = (applied["force"] - force.value_s) - (applied["displacement"] - displacement.value_s)
    return Skew(shift_s, math.hypot(force.std_s, displacement.std_s, *ties), force, displacement)
