"""A hybrid test as a motion that is computed step by step, with its monitoring; pure numbers, no numpy.

    PROBE    a small sine with ramps: measures the delay of the rod behind its set-points
    PAUSE    the rod rests: measures the specimen's force at rest, which the springs carry
    TEST     the road: at each step the measured force enters the computed part; its response is sent, compensated
    RETURN   back to the centre within a second; then the test is over

A violation (`problem`) ends the test at once: the caller stops the rig. The set-point of that step is not sent: the rod
is decelerated from the last good one, so that a halt starts from there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, NamedTuple

from rig.hybrid.delay_probe import DelayMeasurement, Probe
from rig.hybrid.lead import Lead
from rig.hybrid.motion_bounds import Bounds, Measured, Problem, Watch
from rig.hybrid.substructure import Sent, Substructure, Target, dot
from rig.signals.stopping import halted_m
from rig.vehicle.laws import CONTROL, Control, requested_current

PAUSE_S = 0.5
RETURN_S = 1.0
RETURN_RATE_1_S = 12.0
"""Of the way back from rest: like a critically damped spring of this frequency; at its end 0.01 % of it is left."""
RETURN_BRAKE_M_S2 = 5.0
"""Before it, where there is travel enough; else as hard as a halt."""
LEAST_DELAY_S = 2e-4
HELD_STEPS = 2
"""So many steps are computed with the last force where none came; more than that is no test."""


class Phase(StrEnum):
    """Where in its course a test is."""

    PROBE = "probe"
    PAUSE = "pause"
    TEST = "test"
    RETURN = "return"
    OVER = "over"


@dataclass(frozen=True)
class HybridOrder:
    """Everything a test needs to know beforehand.

    Attributes:
        part: the computed part.
        bounds: what the test must keep to.
        probe: how the delay is measured.
        compensator: one of `rig.hybrid.lead.COMPENSATORS`.
        control: the law of the coil's current.
        centre_m: where the specimen's extension is 0, in the rig's coordinate.
    """

    part: Substructure
    bounds: Bounds
    probe: Probe
    compensator: str
    control: Control = CONTROL
    centre_m: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """All of it as plain values."""
        return asdict(self)

    @classmethod
    def from_json(cls, given: Mapping[str, Any]) -> HybridOrder:
        """The order of `to_json`.

        Raises:
            TypeError: something is missing, or there is something too much.
            KeyError: one of the tables is missing.
            ValueError: there is no such law of the current, or not with these numbers.
        """
        tables = {
            "part": Substructure.from_json(given["part"]), "bounds": Bounds(**given["bounds"]),
            "probe": Probe(**given["probe"]), "control": Control(**given["control"]),
        }
        return cls(**{**given, **tables})

    @property
    def duration_s(self) -> float:
        """With delay measurement and return, s."""
        return self.probe.duration_s + PAUSE_S + self.part.duration_s + RETURN_S


class Moment(NamedTuple):
    """What is recorded of a step: time since the road began (s); target, extension as seen, body and wheel (m)."""

    t_s: float
    target_m: float
    seen_m: float
    body_m: float
    wheel_m: float


class Outcome(NamedTuple):
    """What the test says of itself.

    Attributes:
        steps: of the computed part.
        delay_s: as measured; NaN before that.
        tracking: RMS of where the rod was against its target, as a share of the target's RMS.
        energy_share: the largest energy error, as a share of the work.
    """

    steps: int
    delay_s: float
    tracking: float
    energy_share: float


class HybridMotion:
    """One test, asked for a set-point with every poll.

    Args (construction):
        order: the test.

    Attributes:
        phase: where in its course it is.
        problem: why it must be stopped; None while nothing is found.
        moment: what is to be recorded of the last step; None outside of the test itself.
        delay_s: of the rod behind its set-points; NaN before it is known.
        current_A: that the law asks for now; outside of the test itself the one to begin with.
        fastest_m_s: largest planned speed.
    """

    def __init__(self, order: HybridOrder) -> None:
        self.phase = Phase.PROBE
        self.problem: Problem | None = None
        self.moment: Moment | None = None
        self.delay_s = math.nan
        self.current_A = order.control.current_A
        self.fastest_m_s = min(order.bounds.speed_m_s, order.bounds.planned_m_s)
        self._order = order
        self._law = order.control.vector
        self._part = order.part
        self._centre_m = order.centre_m
        self._begin_s = order.probe.duration_s + PAUSE_S
        self._delay = DelayMeasurement(order.probe)
        self._rest = [0.0, 0.0]
        self._state: list[float] = [0.0] * len(order.part.extension)
        self._force_N = 0.0
        self._unheard = 0
        self._step = 0
        self._lead = Lead(order.compensator, 0.0, order.part.step_s)
        self._watch = Watch(order.bounds)
        self._left = Sent(0.0, 0.0)
        self._good = (0.0, self._left)

    @property
    def outcome(self) -> Outcome:
        """What the test says of itself so far."""
        return Outcome(self._step, self.delay_s, self._watch.tracking, self._watch.worst_share)

    def at(self, t_s: float, seen: Measured) -> Sent | None:
        """The set-point of a moment, in the rig's coordinate; None once it is over.

        Args:
            t_s: since the motion began, never falling.
            seen: what the sensors say now.
        """
        self.moment = None
        here = Measured(seen.force_N, seen.extension_m - self._centre_m)
        test_s = t_s - self._begin_s
        if test_s >= self._part.duration_s + RETURN_S:
            self.phase, self.current_A = Phase.OVER, self._order.control.current_A
            return None
        sent = self._goes_on(t_s, test_s, here) if self.problem is None else self._left
        if self.problem is None:
            self._good = t_s, sent
        else:
            sent = self._braked(t_s)
        return Sent(self._centre_m + sent.position_m, sent.velocity_m_s)

    def _goes_on(self, t_s: float, test_s: float, here: Measured) -> Sent:
        """The set-point of a moment, about the centre, whatever it is."""
        if t_s < self._order.probe.duration_s:
            position_m, speed_m_s, share = self._order.probe.at(t_s)
            self._delay.add(t_s, here.extension_m, share)
            return Sent(position_m, speed_m_s)
        if test_s < 0.0:
            return self._pause(test_s, here)
        if test_s < self._part.duration_s:
            return self._test(test_s, here)
        return self._return(test_s - self._part.duration_s)

    def _braked(self, t_s: float) -> Sent:
        """From the last good set-point to rest."""
        good_s, (position_m, velocity_m_s) = self._good
        rate = math.copysign(self._order.bounds.acceleration_m_s2, velocity_m_s)
        gone_s = min(t_s - good_s, velocity_m_s / rate)
        left_m_s = velocity_m_s - rate * gone_s
        return Sent(position_m + 0.5 * (velocity_m_s + left_m_s) * gone_s, left_m_s)

    def _pause(self, test_s: float, here: Measured) -> Sent:
        """Stand at the centre; in the second half the force at rest is measured."""
        if self.phase is Phase.PROBE:
            self.phase = Phase.PAUSE
            self._know_delay(self._delay.delay_s)
        if test_s > -0.5 * PAUSE_S and math.isfinite(here.force_N):
            self._rest[0] += here.force_N
            self._rest[1] += 1.0
        return Sent(0.0, 0.0)

    def _know_delay(self, delay_s: float) -> None:
        self.delay_s, most_s = delay_s, self._order.bounds.delay_s
        if not LEAST_DELAY_S <= delay_s <= most_s:
            text = (
                f"the rod lags the set-points by {1e3 * delay_s:.1f} ms; allowed: {1e3 * LEAST_DELAY_S:g} to "
                f"{1e3 * most_s:.1f} ms"
            )
            self.problem = Problem(text, delay_s, most_s)
            return
        self._lead = Lead(self._order.compensator, delay_s, self._part.step_s)

    def _test(self, test_s: float, here: Measured) -> Sent:
        part = self._part
        if self.phase is Phase.PAUSE:
            self.phase = Phase.TEST
        force_N = self._heard(here.force_N)
        step = int(test_s / part.step_s + 1e-6)
        self._go_on(step, force_N)
        since_s = test_s - self._step * part.step_s
        now = part.target(self._state, self._force_N, self._step).after(since_s)
        self._check(now, here)
        self.current_A = self._target_A(self._state)
        self.moment = Moment(
            test_s, now.extension_m, here.extension_m,
            dot(part.body, self._state) + since_s * dot(part.body_speed, self._state),
            dot(part.wheel, self._state) + since_s * dot(part.wheel_speed, self._state),
        )
        self._left = self._lead.command(
            test_s, now, here.extension_m, lambda ahead_s: self._forecast(since_s + ahead_s)
        )
        self.problem = self.problem or self._watch.problem_of_sent(self._left)
        return self._left

    def _heard(self, force_N: float) -> float:
        """The specimen's force beyond that at rest and its inertia; the last one where none came."""
        if not math.isfinite(force_N):
            self._unheard += 1
            if self._unheard > HELD_STEPS:
                text = f"no new force value for {self._unheard} steps; allowed: {HELD_STEPS}"
                self.problem = self.problem or Problem(text, float(self._unheard), float(HELD_STEPS))
            return self._force_N
        self._unheard = 0
        total, count = self._rest
        target = self._part.target(self._state, self._force_N, self._step)
        return force_N - (total / count if count else 0.0) - self._part.inertia_kg * target.acceleration_m_s2

    def _go_on(self, step: int, force_N: float) -> None:
        """Compute up to a step; the force changes along a line from the last one known."""
        missing = step - self._step
        before_N = self._force_N
        for number in range(1, missing + 1):
            after_N = before_N + (force_N - before_N) * number / missing
            self._state = self._part.moved(self._state, (self._force_N, after_N), self._step)
            self._force_N = after_N
            self._step += 1

    def _forecast(self, ahead_s: float) -> Target:
        """The target so much after the last step, the force changing as the assumed damper's does."""
        part, current_A = self._part, self.current_A
        state, force_N, step = self._state, self._force_N, self._step
        now_N = part.assumed_N(dot(part.speed, state), current_A)
        steps = int(ahead_s / part.step_s)
        for _ in range(steps):
            going = part.moved(state, (force_N, force_N), step)
            after_N = self._force_N + part.assumed_N(dot(part.speed, going), current_A) - now_N
            state = part.moved(state, (force_N, after_N), step)
            force_N, step = after_N, step + 1
        return part.target(state, force_N, step).after(ahead_s - steps * part.step_s)

    def _target_A(self, state: list[float]) -> float:
        """The current that the law asks for in a state."""
        part = self._part
        speed_m_s = dot(part.speed, state)
        return requested_current(
            self._law, dot(part.body_speed, state), dot(part.wheel_speed, state), part.extension[0],
            part.assumed_N(speed_m_s, 0.0), part.assumed_N(speed_m_s, self._order.control.most_A),
        )

    def _check(self, now: Target, here: Measured) -> None:
        self._watch.add(now, here, self._force_N)
        self.problem = self.problem or self._watch.problem(now)

    def _return(self, since_s: float) -> Sent:
        """From where the test left the rod to rest, within the travel of a halt, and from there to the centre."""
        self.phase, self.current_A = Phase.RETURN, self._order.control.current_A
        left, bounds = self._left, self._order.bounds
        outwards_m = bounds.travel_m - math.copysign(1.0, left.velocity_m_s) * left.position_m
        needed = 0.5 * left.velocity_m_s**2 / max(outwards_m, 1e-9)
        deceleration = min(bounds.halt_deceleration_m_s2, max(needed, RETURN_BRAKE_M_S2))
        stop_s = abs(left.velocity_m_s) / deceleration
        if since_s < stop_s:
            slower_m_s = math.copysign(deceleration * since_s, left.velocity_m_s)
            return Sent(
                left.position_m + (left.velocity_m_s - 0.5 * slower_m_s) * since_s, left.velocity_m_s - slower_m_s
            )
        rest_m, angle = halted_m(*left, deceleration), RETURN_RATE_1_S * (since_s - stop_s)
        share = math.exp(-angle)
        return Sent(rest_m * (1.0 + angle) * share, -RETURN_RATE_1_S * rest_m * angle * share)
