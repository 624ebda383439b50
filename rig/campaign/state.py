"""Where a campaign stands: one frozen value, and the phases it goes through."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

from rig.campaign.adaptation import Drives
from rig.campaign.cause import MOST_RETRIES, Cause
from rig.campaign.conditions import NO_CONDITIONS, Conditions
from rig.faults.row import StopKind
from rig.matrix.point import TestPoint


class Phase(StrEnum):
    """What the campaign waits for."""

    NEW = "new"
    CONNECTING = "connecting"
    ARMING = "arming"
    PROVING_WATCHDOG = "proving the watchdog"
    CHECKING_ZEROS = "checking zeros"
    PRESSURE_LOW = "hydraulics to low pressure"
    PRESSURE_ON = "hydraulics to full pressure"
    PROVING_SENSORS = "proving the sensors by a slow move"
    CENTRING = "centring"
    GATING = "reading the temperature"
    COOLING = "cooling down"
    DEMAGNETISING = "demagnetising"
    SETTLING = "settling the current"
    WARMING = "warming up"
    ADAPTING = "adapting the amplitude"
    RUNNING = "running"
    STEPPING = "stepping the current"
    CLEARING = "back to 0 A"
    RESTING = "resting"
    PAUSED = "paused"
    JUDGING = "waiting for verdicts"
    STOPPING = "stopping"
    COOLING_DOWN = "standing still until the ECU has cooled down"
    RESETTING = "resetting after a stop"
    STANDING = "coming to rest"
    CHECKING_RETURN = "checking zeros again"
    FINISHING = "hydraulics off"
    ENDED = "ended"


class RigState(StrEnum):
    """What is known about the rig when a campaign has ended."""

    SAFE = "safe"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Latch:
    """The first cause of a stop; later causes never replace it."""

    stop: StopKind
    cause: Cause


@dataclass(frozen=True)
class State:
    """A campaign's state; made by `start_state`, changed only by `rig.campaign.sequencer.step`.

    Attributes:
        queue: the points still to be done; the first one is the current one.
        retries: how often a point may be repeated without the operator (0..2).
        phase: what the campaign waits for.
        attempts: point ids, one entry for each attempt begun.
        unjudged: ids whose file is being written and judged; only kept when a bad verdict could lead to a repeat.
        given_back: points kept for a repeat while their verdict is awaited.
        held_at_m: the centre at which the actuator is known to hold, None when not known.
        rest_s: rest still to be taken after the point that just ran (s, rig's clock).
        recording: the current point's journal is open.
        armed: the station was asked to arm; only a proved disarm undoes it.
        proved: watchdog and zeros were proved since the last arming.
        pressurised: pressure was asked for, and is not proved gone.
        powered: the hydraulics are at full pressure.
        moved: something was moved in this campaign.
        pause_asked: stop at the next point boundary.
        spoiled: why the running point cannot be valid, though it was not stopped.
        latch: the stop under way or done; None while nothing is wrong.
        stopped: standstill and 0 A were proved after the latch.
        cooled_s: how long the stopped rig has waited for the ECU to cool down (s, rig's clock).
        refused: why the campaign was refused before anything moved.
        left_to_station: the link was closed; whether the rig is safe is proved by how the station ends.
        rig_state: what is known about the rig.
        conditions: under what conditions points are measured.
        drives: how motions are commanded, as far as they were tried.
        warming: the warm-up program that comes before the current point, None when there is none.
        warmed_s: motion of warm-up programs before the current point (s).
        warmed_with: the last of them (s) and the temperature it began at (degC), None before the first.
        steps_left: currents still to come of a current-step point (A).
        demagnetising: currents still to come of the demagnetising sequence (A).
        magnetised_A: the largest current since the last demagnetising (A).
        last_current_A: the current of the last program (A).
    """

    queue: tuple[TestPoint, ...]
    retries: int
    phase: Phase = Phase.NEW
    attempts: tuple[str, ...] = ()
    unjudged: tuple[str, ...] = ()
    given_back: tuple[TestPoint, ...] = ()
    held_at_m: float | None = None
    rest_s: float = 0.0
    recording: bool = False
    armed: bool = False
    proved: bool = False
    pressurised: bool = False
    powered: bool = False
    moved: bool = False
    pause_asked: bool = False
    spoiled: Cause | None = None
    latch: Latch | None = None
    stopped: bool = False
    cooled_s: float = 0.0
    refused: Cause | None = None
    left_to_station: bool = False
    rig_state: RigState = RigState.SAFE
    conditions: Conditions = NO_CONDITIONS
    drives: Drives = ()
    warming: TestPoint | None = None
    warmed_s: float = 0.0
    warmed_with: tuple[float, float] | None = None
    steps_left: tuple[float, ...] = ()
    demagnetising: tuple[float, ...] = ()
    magnetised_A: float = 0.0
    last_current_A: float = 0.0

    @property
    def point(self) -> TestPoint:
        """The current point."""
        return self.queue[0]

    @property
    def attempt(self) -> int:
        """Attempts of the current point begun so far."""
        return self.attempts.count(self.point.id)

    def may_repeat(self, point_id: str) -> bool:
        """Whether another attempt of a point is allowed."""
        return self.attempts.count(point_id) <= self.retries

    def unlatched(self) -> State:
        """The state after an explicit reset: nothing is proved any more, the position is not known."""
        return replace(
            self, latch=None, stopped=False, proved=False, powered=False, held_at_m=None, rest_s=0.0, warming=None,
            warmed_with=None, cooled_s=0.0,
        )


def start_state(points: tuple[TestPoint, ...], retries: int, conditions: Conditions = NO_CONDITIONS) -> State:
    """The state before anything has happened.

    Args:
        points: the planned points in order.
        retries: automatic repeats of a point, 0..2.
        conditions: under what conditions points are measured; by default none.

    Raises:
        ValueError: no points, two points with one id, or `retries` out of range.
    """
    ids = [point.id for point in points]
    if not points or len(set(ids)) != len(ids):
        raise ValueError(f"expected at least one point and no id twice, got {ids}")
    if not 0 <= retries <= MOST_RETRIES:
        raise ValueError(f"retries: expected 0..{MOST_RETRIES}, got {retries}")
    return State(queue=points, retries=retries, conditions=conditions)
