"""Bounds of a hybrid test, checked at each step; pure numbers, no numpy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from rig.hybrid.substructure import Sent, Target
from rig.signals.stopping import halted_m

LEAST_SQUARES_M2 = 1e-6
"""Sum of squares of the target from which on tracking is a share of it."""


@dataclass(frozen=True)
class Bounds:
    """What a test must keep to.

    Attributes:
        extension_m: largest, either way; a multiple of what is forecast, within the machine's travel.
        speed_m_s, acceleration_m_s2: of the target: the machine's.
        energy_share: largest energy that following errors bring into the computed part, or take from it, for good, as
            a share of the work that went through the specimen.
        delay_s: largest delay of the actuator with which the test is begun.
        travel_m: about the centre, either way, within which a halt from any set-point must come to rest.
        halt_deceleration_m_s2: of that halt.
        energy_floor_J: work from which on energy errors are a share of the work.
        planned_m_s: planned largest speed; set-points that catch up with the test after a gap are not faster.
    """

    extension_m: float
    speed_m_s: float
    acceleration_m_s2: float
    energy_share: float
    delay_s: float
    travel_m: float
    halt_deceleration_m_s2: float
    energy_floor_J: float
    planned_m_s: float


class Measured(NamedTuple):
    """What the sensors say at a step: force (N) and extension (m); NaN where nothing fresh came."""

    force_N: float
    extension_m: float


class Problem(NamedTuple):
    """Why a test does not go on: in words, with what was found and what is allowed."""

    text: str
    value: float
    limit: float


class Watch:
    """Checks each step: the target against its bounds, and the energy that following errors bring.

    Energy error: E = sum F (dx - dx*), x the measured extension, x* its target; work: W = sum |F dx*|. Mosqueda,
    Stojadinovic, Mahin 2007 (Earthquake Engineering and Structural Dynamics 36).

    E holds energy that comes back: a rod that lags by e = x - x* has E = F e while the force is constant (friction),
    F e / 2 with a viscous force, and 0 once it has stopped again. Within the first swing, when W is a quarter of a
    cycle's work, this was 20 to 70 % of W on healthy rigs. So what is bounded is the part that stays:

        |E - F e / 2| <= share max(W, floor) + max |F e| / 2        the maximum so far

    The floor is the work of half a second as it is forecast: a law that switches within the first swing left 0.6 J
    where W was 1 J, and 30 J later.
    """

    def __init__(self, bounds: Bounds) -> None:
        self.worst_share = 0.0
        self._bounds = bounds
        self._last: tuple[float, float, float] | None = None
        self._error_J = self._work_J = self._held_J = self._most_held_J = 0.0
        self._squares = [0.0, 0.0]

    @property
    def tracking(self) -> float:
        """RMS of the rod's distance from its target as a share of the target's RMS; 0 before it moves."""
        apart, targets = self._squares
        return math.sqrt(apart / targets) if targets > LEAST_SQUARES_M2 else 0.0

    def add(self, now: Target, here: Measured, force_N: float) -> None:
        """One step."""
        if not math.isfinite(here.extension_m):
            return
        if self._last is not None:
            was_m, target_m, before_N = self._last
            mean_N, requested_m = 0.5 * (force_N + before_N), now.extension_m - target_m
            self._error_J += mean_N * (here.extension_m - was_m - requested_m)
            self._work_J += abs(mean_N * requested_m)
        self._held_J = 0.5 * force_N * (here.extension_m - now.extension_m)
        self._most_held_J = max(self._most_held_J, abs(self._held_J))
        self._last = here.extension_m, now.extension_m, force_N
        self._squares[0] += (here.extension_m - now.extension_m) ** 2
        self._squares[1] += now.extension_m**2
        self.worst_share = max(self.worst_share, abs(self._lost_J) / self._reference_J)

    @property
    def _reference_J(self) -> float:
        return max(self._work_J, self._bounds.energy_floor_J)

    @property
    def _lost_J(self) -> float:
        """Energy error without what comes back, J: less than `_most_held_J` counts as 0."""
        error_J = self._error_J - self._held_J
        return math.copysign(max(abs(error_J) - self._most_held_J, 0.0), error_J)

    def problem(self, now: Target) -> Problem | None:
        """What speaks against going on."""
        bounds = self._bounds
        beyond = _beyond((
            ("computed extension", "mm", 1e3, now.extension_m, bounds.extension_m),
            ("computed speed", "m/s", 1.0, now.speed_m_s, bounds.speed_m_s),
            ("computed acceleration", "m/s^2", 1.0, now.acceleration_m_s2, bounds.acceleration_m_s2),
        ))  # fmt: skip
        if beyond is not None:
            return beyond
        lost_J = self._lost_J
        if not abs(lost_J) <= bounds.energy_share * self._reference_J:
            share = lost_J / self._reference_J
            text = (
                f"energy error of the rod relative to its target: {lost_J:.3g} J for {self._reference_J:.3g} J of work "
                f"({100 * share:.1f} %); allowed: +-{100 * bounds.energy_share:g} %"
            )
            return Problem(text, share, bounds.energy_share)
        return None

    def problem_of_sent(self, sent: Sent) -> Problem | None:
        """What speaks against sending a set-point, about the centre: a lead may go further than the target does."""
        bounds = self._bounds
        return _beyond((
            ("set-point", "mm", 1e3, sent.position_m, bounds.extension_m),
            ("speed of the set-point", "m/s", 1.0, sent.velocity_m_s, bounds.speed_m_s),
            ("rod position after a halt at this set-point", "mm", 1e3, halted_m(*sent, bounds.halt_deceleration_m_s2),
             bounds.travel_m),
        ))  # fmt: skip


def _beyond(checks: tuple[tuple[str, str, float, float, float], ...]) -> Problem | None:
    """The first value that is beyond its limit, or no number: name, unit, units of it in SI, value, limit."""
    for name, unit, scale, value, limit in checks:
        if not abs(value) <= limit:
            text = f"{name} {scale * value:.4g} {unit}; allowed: +-{scale * limit:.4g} {unit}"
            return Problem(text, value, limit)
    return None
