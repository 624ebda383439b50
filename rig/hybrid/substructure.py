"""The computed part of a hybrid test, one fixed step after the other; pure numbers, no numpy: it runs in the station.

A linear structure `x' = A x + b T + g w` with the state x (n,), the specimen's force T (N, resists extension, without
what it pulls at rest) and the road's force w (N). Both change along a line within a step, and so the step is exact:

    x[k+1] = transition x[k] + force_before T[k] + force_after T[k+1] + road_before w[k] + road_after w[k+1]

The specimen's extension is e = extension . x, its speed e' = speed . x, its acceleration e'' = acceleration . x +
acceleration_force T + acceleration_road w.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, NamedTuple

Vector = Sequence[float]


class Sent(NamedTuple):
    """A set-point: where the rod is to be (m) and how fast it is to go on (m/s)."""

    position_m: float
    velocity_m_s: float


class Target(NamedTuple):
    """Where the specimen should be: extension (m), speed (m/s), acceleration (m/s^2)."""

    extension_m: float
    speed_m_s: float
    acceleration_m_s2: float

    def after(self, time_s: float) -> Target:
        """The same so much later (s), at constant acceleration."""
        speed_m_s = self.speed_m_s + self.acceleration_m_s2 * time_s
        gone_m = 0.5 * (self.speed_m_s + speed_m_s) * time_s
        return Target(self.extension_m + gone_m, speed_m_s, self.acceleration_m_s2)


@dataclass(frozen=True)
class Substructure:
    """The numbers of a computed part; see the module.

    Attributes:
        step_s: length of a step, s.
        transition: (n, n).
        force_before, force_after, road_before, road_after: (n,) each, per N.
        road_N: the road's force at each step from t = 0 on (k,); 0 after that.
        extension, speed, acceleration: (n,) each.
        acceleration_force, acceleration_road: m/s^2 per N.
        body, wheel: (n,) each: heights of body and wheel, m.
        body_speed, wheel_speed: (n,) each, m/s.
        inertia_kg: of rod and fixture between load cell and damper, which is part of the computed masses and is taken
            off the measured force.
        force_speeds_m_s: speeds (m,), ascending, of `force_N`.
        force_N: what the assumed damper adds to its force at rest, as it is before the test, at these speeds, for each
            of `force_currents_A`.
        force_currents_A: ascending.
    """

    step_s: float
    transition: Sequence[Vector]
    force_before: Vector
    force_after: Vector
    road_before: Vector
    road_after: Vector
    road_N: Vector
    extension: Vector
    speed: Vector
    acceleration: Vector
    acceleration_force: float
    acceleration_road: float
    body: Vector
    wheel: Vector
    body_speed: Vector
    wheel_speed: Vector
    inertia_kg: float
    force_speeds_m_s: Vector
    force_currents_A: Vector
    force_N: Sequence[Vector]

    @classmethod
    def from_json(cls, given: Mapping[str, Any]) -> Substructure:
        """The numbers of `to_json`.

        Raises:
            TypeError: one is missing, or there is one too many.
        """
        unknown = given.keys() - {field.name for field in fields(cls)}
        if unknown:
            raise TypeError(f"unknown values: {', '.join(sorted(unknown))}")
        return cls(**given)

    def to_json(self) -> dict[str, Any]:
        """All numbers by name."""
        return asdict(self)

    @property
    def duration_s(self) -> float:
        """Until the last of the road's forces, s."""
        return (len(self.road_N) - 1) * self.step_s

    def road_at(self, step: int) -> float:
        """The road's force at a step, N."""
        return self.road_N[step] if 0 <= step < len(self.road_N) else 0.0

    def moved(self, state: Vector, forces_N: tuple[float, float], step: int) -> list[float]:
        """The state (n,) at `step` + 1.

        Args:
            state: at `step`.
            forces_N: the specimen's force at `step` and at the next one.
            step: its number.
        """
        before, after = forces_N
        road, road_next = self.road_at(step), self.road_at(step + 1)
        out = []
        for row, f, g, r, s in zip(
            self.transition, self.force_before, self.force_after, self.road_before, self.road_after, strict=True
        ):
            total = f * before + g * after + r * road + s * road_next
            for share, value in zip(row, state, strict=True):
                total += share * value
            out.append(total)
        return out

    def target(self, state: Vector, force_N: float, step: int) -> Target:
        """Where the specimen should be in a state at a step."""
        acceleration = dot(self.acceleration, state) + self.acceleration_force * force_N
        acceleration += self.acceleration_road * self.road_at(step)
        return Target(dot(self.extension, state), dot(self.speed, state), acceleration)

    def assumed_N(self, speed_m_s: float, current_A: float) -> float:
        """What the assumed damper adds to its force at rest, N; constant beyond the table."""
        forces = [between(self.force_speeds_m_s, row, speed_m_s) for row in self.force_N]
        return between(self.force_currents_A, forces, current_A)


def dot(row: Vector, state: Vector) -> float:
    """Sum of products."""
    return sum(share * value for share, value in zip(row, state, strict=True))


def between(places: Vector, values: Vector, at: float) -> float:
    """Straight lines through values (n,) at ascending places (n,); constant beyond them."""
    if len(places) == 1 or at <= places[0]:
        return values[0]
    if at >= places[-1]:
        return values[-1]
    low, high = 0, len(places) - 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if places[middle] <= at else (low, middle)
    share = (at - places[low]) / (places[high] - places[low])
    return values[low] + share * (values[high] - values[low])
