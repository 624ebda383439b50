"""What must hold of the rod's motion at every instant, also after a stop is latched, on the simulated physics' truth.

The allowances are those of the simulated machine, each with its reason; what excuses more is a fault by which the
machine itself moves the rod (`MOVED_BY_OTHERS`), from the moment on at which it begins.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.register_maps.map_file import controller
from drivers.streamed_actuator import LATEST_S
from rig.bench.model import Bench
from rig.matrix.streaming import JITTER_S, LOOP_1_S, SPEED_JITTER, peaks
from rig.test_point import HYBRID, TestPoint
from simulators.plant.records import FOLLOW_S
from simulators.scenarios.scenario import EVERY_S
from simulators.scenarios.view import SLIPPING, STILL_M_S, Findings, View, bench_of, points_of

Rows = NDArray[np.float64]

BEYOND_M = 1e-3
"""Past the travel limits: the servo loop (30 Hz, damping 0.7) overshoots a motion that turns at the limit by less."""
FASTER_SHARE, FASTER_M_S = 0.10, 0.03
"""Above the planned speed: the loop's overshoot at a corner (5 %), twice; and the noise of a rod at rest."""
CATCHES_UP_SHARE = 0.30
"""Above it where set-points are streamed: one that is taken 5 ms late leaves the rod `5 ms v` behind, and the loop
catches up with 0.46 times its corner frequency of 188 rad/s."""
LIMIT_SHARE, LIMIT_M_S = 0.10, 0.02
"""Above the bench's limit of speed, whatever is planned: the station's own margin, and its sensors' noise."""
SLOWEST_M_S = 0.06
"""Moves to the centre and of the sensors' proof are no faster, whatever the matrix asks for."""
HARDER_SHARE, HARDER_S = 0.10, 0.004
"""Above the limit of acceleration: as much as the speed's allowance; single milliseconds are the truth's resolution."""
SETPOINT_S = 0.010
"""Of streamed set-points the mean over one interval counts: how a device goes within it is its own loop's business."""
STOPS_ITSELF_S = 0.1
"""By then a servo loop to which no set-point comes has stopped the rod."""
ANSWERS_S = 0.030
"""By then a servo loop has answered a step: four of its time constants, and the interval over which the mean counts."""
MOST_ANSWERS = 6
"""So many set-points come within that time at most."""
STOPPING_M = 2e-3
"""Beyond the travel limits with the rest of a halt: the overshoot, and one poll at the speed of a turning rod."""
REACTION_S = 0.10
"""From a latched stop to the rod: a poll, a hand-over of the devices, three time constants of the servo loop."""
FADES_M_S = 0.03
"""A rod that comes to rest is no faster than that again: the loop's ripple, a held-up set-point of a fade."""
AT_REST_S, AT_REST_PERIODS = 0.08, 0.25
"""So long a rod is not at rest where a fade turns it round at 0.02 m/s or more; after such a rest it moves no more."""
RECONNECTED_NS = 0.5e9
"""A link that was broken for so long before a stop may still be opened again."""
UNHEARD_S = 0.15
"""After its watchdog, or after the last set-point, a controller that cannot be reached has begun its own stop."""
TAKEN_LATE_S = 0.030
"""Between the host's computing a set-point and its being taken: a poll, a hand-over, a time-out's repetition."""
LAG_S = 0.030
"""The rod follows its set-point so much later at most: the loop's lag of 7.4 ms, the filters, one poll."""
OFF_M, OFF_M_S = 2e-3, 0.03
MOVING_M_S = 0.02
STOPPED_M_S, TRIP_S = OFF_M / TAKEN_LATE_S, 0.003
"""After a stop and a gap a set-point is no faster than the rod was when it was measured, and so much; a measurement is
no older than a late set-point, and takes its trip."""
FOLLOWS_AGAIN_NS = 0.06e9
"""A gap in the set-points after which the controller, which goes on for 50 ms, has stopped by itself."""
MOVED_BY_OTHERS = frozenset({
    "second-master:span", "second-master:offset", "second-master:jumps", "setpoints-lost",
})  # fmt: skip
"""Another client that moves the rod, a device that acknowledges set-points and ignores them for a while: where the rod
goes meanwhile is not ours to say; `limits` checks how long it may stay there."""
LOST_UNSEEN = frozenset({"modbus-write-lost"})
"""Set-points that are acknowledged and lost on a drive that repeats no counter: with the next one it catches up by its
own loop, faster than planned, and no host can know in time (docs/safety.md)."""
LOOSE = frozenset({"load-train"})
"""A joint in whose play a rod that no pressure holds falls through."""
DISPLACED = MOVED_BY_OTHERS | SLIPPING
"""What moves the rod, or has it elsewhere than its transducer says: for checks of the position, and the jolt of it."""
FOLLOWS_AGAIN_S = 0.15
"""After such a fault has ended the rod is back at its set-points: by the servo loop, which no host can make softer."""
HALTED_S = 0.5
"""Another client's stop has brought the rod to rest, and is noticed."""
IGNORES = frozenset({"stop-ignored"})
"""The controller goes on after a stop command, until its pressure is taken away."""


@dataclass(frozen=True)
class Motion:
    """What a session's motions may be.

    Attributes:
        bench: of the session.
        points: of the matrix.
    """

    bench: Bench
    points: tuple[TestPoint, ...]

    @cached_property
    def speed_m_s(self) -> float:
        """The fastest planned motion; a hybrid test is bounded by the bench's limit.

        With corners that the controller's own generator makes; the ripple of streaming has a tolerance of its own.
        """
        limit_m_s = self.bench.limits.speed_m_s
        planned = (
            limit_m_s if point.kind == HYBRID else
            point.peak_speed_m_s if self.streamed else peaks(point, self.bench).speed_m_s for point in self.points
        )
        return min(limit_m_s, max(SLOWEST_M_S, *planned))

    @cached_property
    def period_s(self) -> float:
        """The longest period of a motion of cycles; 0 where there is none: then every stop is a halt."""
        cyclic = (point for point in self.points if point.has_frequency)
        return max((1.0 / point.frequency_Hz for point in cyclic if point.frequency_Hz > 0.0), default=0.0)

    @property
    def fades_s(self) -> float:
        """How long the station's own stop of cycles takes: their fade-out (s)."""
        return self.period_s * self.bench.actuator.fade_out_cycles

    @cached_property
    def fastest_m_s(self) -> float:
        """How fast the rod may ever be (m/s)."""
        share = FASTER_SHARE + (CATCHES_UP_SHARE if self.streamed else 0.0)
        limit_m_s = (1.0 + LIMIT_SHARE) * self.bench.limits.speed_m_s + LIMIT_M_S
        return min(limit_m_s, (1.0 + share) * self.speed_m_s + FASTER_M_S)

    @property
    def goes_on_s(self) -> float:
        """For how long a controller goes on after a set-point: with its speed, or to the position (simulated ones)."""
        has_speed = controller(self.bench.actuator.described).setpoint_has_speed
        return FOLLOW_S if has_speed else self.bench.actuator.setpoints_s or 0.0

    @property
    def streamed(self) -> bool:
        """The controller follows set-points."""
        return self.bench.actuator.setpoints_s is not None

    @property
    def at_their_own_speed(self) -> frozenset[str]:
        """Faults while which, and shortly after which, speed and acceleration are the drive's own."""
        hidden = self.streamed and not self.bench.actuator.capabilities.echo
        return MOVED_BY_OTHERS | LOST_UNSEEN if hidden else MOVED_BY_OTHERS


def motion_of(view: View) -> Motion | None:
    """The motions of a session; None where it has no bench or matrix."""
    points, bench = points_of(view), bench_of(view)
    if points is None or bench is None or not len(view.session.truth.arrays):
        return None
    return Motion(bench, points)


def _not_ours(view: View, others: frozenset[str] = MOVED_BY_OTHERS) -> list[tuple[float, float]]:
    """From when to when (ns) something else moves the rod: a fault, a stop by another client."""
    spans = [(from_ns, to_ns + 1e9 * FOLLOWS_AGAIN_S) for from_ns, to_ns in view.spans(others)]
    halts = (float(line.host_ns) for line in view.session.truth.log if line.code == "FOREIGN")
    return [*spans, *((at_ns, at_ns + 1e9 * HALTED_S) for at_ns in halts)]


def _ours(view: View, others: frozenset[str] = MOVED_BY_OTHERS) -> Rows:
    """The session's rows without those in which something else moves the rod."""
    rows = view.session.truth.arrays
    ours = np.ones(len(rows), bool)
    for from_ns, to_ns in view.spans(LOOSE):
        ours &= (rows[:, 0] < from_ns) | (rows[:, 0] >= to_ns) | (rows[:, 5] > 0.0)
    for from_ns, to_ns in _not_ours(view, others):
        ours &= (rows[:, 0] < from_ns) | (rows[:, 0] >= to_ns)
    return rows[ours]


def _worst(rows: Rows, beyond: NDArray[np.bool_], of: Rows) -> tuple[float, float]:
    """The largest of a quantity where it is beyond, and when it first was (ns)."""
    place = np.flatnonzero(beyond)
    return float(of[place][np.argmax(np.abs(of[place]))]), float(rows[place[0], 0])


def travel_is_kept(view: View) -> Findings:
    """The rod never leaves the bench's travel."""
    motion, rows = motion_of(view), _ours(view, DISPLACED)
    if motion is None:
        return
    low_m, high_m = motion.bench.limits.position_m
    beyond = (rows[:, 3] < low_m - BEYOND_M) | (rows[:, 3] > high_m + BEYOND_M)
    if np.any(beyond):
        at_m, at_ns = _worst(rows, beyond, rows[:, 3])
        yield f"rod at {1e3 * at_m:.1f} mm, allowed {1e3 * low_m:g} to {1e3 * high_m:g} mm", at_ns


def speed_is_kept(view: View) -> Findings:
    """The rod is never faster than the fastest planned motion; no fade, halt or return is."""
    motion = motion_of(view)
    if motion is None:
        return
    rows = _ours(view, motion.at_their_own_speed)
    beyond = np.abs(rows[:, 1]) > motion.fastest_m_s
    if np.any(beyond):
        speed_m_s, at_ns = _worst(rows, beyond, rows[:, 1])
        words = f"{abs(speed_m_s):.3g} m/s, planned {motion.speed_m_s:.3g} m/s, allowed {motion.fastest_m_s:.3g} m/s"
        yield words, at_ns


def acceleration_is_kept(view: View) -> Findings:
    """The rod speeds up and slows down no harder than the bench allows, but where its pressure is gone.

    A controller with a generator keeps the limit that it was given for every client, so what another one makes it do
    counts as well.
    """
    motion = motion_of(view)
    if motion is None:
        return
    theirs = DISPLACED | motion.at_their_own_speed
    rows = _ours(view, theirs if motion.streamed else theirs - {"second-master:jumps"})
    limit_m_s2 = max(motion.bench.limits.acceleration_m_s2, motion.bench.actuator.halt_deceleration_m_s2)
    over = round(SETPOINT_S / EVERY_S) if motion.streamed else 1
    if len(rows) <= over:
        return
    before, after = rows[:-over], rows[over:]
    change_m_s2 = (after[:, 1] - before[:, 1]) / (over * EVERY_S)
    slowing = np.abs(after[:, 1]) < np.abs(before[:, 1])  # the valve closes: nothing is commanded any more
    whole = after[:, 0] - before[:, 0] < 1e9 * (over + 0.5) * EVERY_S
    allowed_m_s2 = np.full(len(change_m_s2), (1.0 + HARDER_SHARE) * limit_m_s2)
    if motion.streamed:
        fastest_m_s = np.maximum(np.abs(before[:, 1]), np.abs(after[:, 1]))
        steps_m = fastest_m_s * _irregular_s(view, motion, after[:, 0])
        allowed_m_s2 += SPEED_JITTER * LOOP_1_S * steps_m / SETPOINT_S
    harder = (np.abs(change_m_s2) > allowed_m_s2) & whole
    harder &= ~(slowing & (after[:, 5] == 0.0))
    harder &= ~(slowing & _left_alone(view, motion, after[:, 0]))
    if np.count_nonzero(harder) > HARDER_S / EVERY_S:
        worst_m_s2, at_ns = _worst(after, harder, change_m_s2)
        yield f"{abs(worst_m_s2):.4g} m/s^2, allowed {limit_m_s2:.4g} m/s^2", at_ns


def _irregular_s(view: View, motion: Motion, at_ns: Rows) -> Rows:
    """By how much the set-points that the servo loop answers came early or late, beyond what the plan counts (s, sum).

    One that is taken j early or late is a step of v j, and the loop answers that with a speed of 0.46 w0 v j
    (`rig.matrix.streaming`): no host can send it otherwise, since it knows when it sends, not when the device takes it.
    After a longer silence than `LATEST_S` the station leads the rod back softly.
    """
    given = np.array(view.session.truth.setpoints)
    total_s = np.zeros(len(at_ns))
    if not len(given):
        return total_s
    period_s = motion.bench.actuator.setpoints_s or 0.0
    late_s = np.abs(1e-9 * np.diff(given[:, 0], prepend=given[0, 0]) - period_s)
    late_s[late_s > LATEST_S + JITTER_S] = late_s[0] = 0.0
    late_s = np.maximum(0.0, late_s - JITTER_S)
    last = np.searchsorted(given[:, 0], at_ns, side="right") - 1
    for number in range(MOST_ANSWERS):
        place = np.maximum(0, last - number)
        answered = (last >= number) & (1e-9 * (at_ns - given[place, 0]) < ANSWERS_S)
        total_s += np.where(answered, late_s[place], 0.0)
    open_s = 1e-9 * (at_ns - given[last, 0]) - period_s - JITTER_S
    total_s += np.where((last >= 0) & (open_s < LATEST_S), np.maximum(0.0, open_s), 0.0)
    return total_s


def _left_alone(view: View, motion: Motion, at_ns: Rows) -> NDArray[np.bool_]:
    """When a moving rod has gone on by itself as far as its controller lets it, since no set-point came.

    The controller then stops it by its own servo loop, and no host can make that softer (docs/safety.md).
    """
    given = np.array(view.session.truth.setpoints)
    if not len(given):
        return np.zeros(len(at_ns), bool)
    place = np.searchsorted(given[:, 0], at_ns, side="right") - 1
    since_s = 1e-9 * (at_ns - given[place, 0])
    moving = (place >= 0) & (np.abs(given[place, 2]) > MOVING_M_S)
    stopping = (since_s > motion.goes_on_s) & (since_s < motion.goes_on_s + STOPS_ITSELF_S)
    return np.asarray(moving & stopping)


def a_stop_has_its_travel(view: View) -> Findings:
    """At every instant there is travel left in which a halt brings the rod to rest."""
    motion, rows = motion_of(view), _ours(view, DISPLACED)
    if motion is None:
        return
    rows = rows[rows[:, 5] > 0.0]
    low_m, high_m = motion.bench.limits.position_m
    speed_m_s = np.clip(rows[:, 1], -motion.speed_m_s, motion.speed_m_s)  # its ripple is gone sooner than a halt ends
    rest_m = speed_m_s * np.abs(speed_m_s) / (2.0 * motion.bench.actuator.halt_deceleration_m_s2)
    ends_m = rows[:, 3] + rest_m
    beyond = (ends_m < low_m - STOPPING_M) | (ends_m > high_m + STOPPING_M)
    if np.any(beyond):
        end_m, at_ns = _worst(rows, beyond, ends_m)
        allowed = f"{1e3 * low_m:g} to {1e3 * high_m:g} mm"
        yield f"a halt at this time would end at {1e3 * end_m:.1f} mm; allowed: {allowed}", at_ns


def setpoints_go_on_from_each_other(view: View) -> Findings:
    """Each set-point that a controller takes can be reached from the last one it took, and is near where the rod is."""
    motion, given = motion_of(view), view.session.truth.setpoints
    if motion is None or len(given) < 2:
        return
    others = _not_ours(view, motion.at_their_own_speed)
    rows, displaced = _ours(view), view.spans(SLIPPING)
    if not len(rows):
        return
    gained_m_s = OFF_M_S + motion.bench.limits.acceleration_m_s2 * 2.0 * TAKEN_LATE_S
    setpoints = np.array(given)
    rod_m, rod_m_s = (np.interp(setpoints[:, 0], rows[:, 0], rows[:, column]) for column in (3, 1))
    last_ns = rows[-1, 0]
    for place, (before, now) in enumerate(pairwise(given), start=1):
        if now[0] > last_ns:
            return
        if any(from_ns <= before[0] < to_ns or from_ns <= now[0] < to_ns for from_ns, to_ns in others):
            continue
        passed_s, moving_m_s = 1e-9 * (now[0] - before[0]), max(abs(before[2]), abs(now[2]))
        step_m = abs(now[1] - before[1])
        allowed_m = motion.fastest_m_s * passed_s + moving_m_s * TAKEN_LATE_S + OFF_M
        if step_m > allowed_m:
            yield f"a set-point is {1e3 * step_m:.1f} mm from the previous one, {1e3 * passed_s:.0f} ms later", now[0]
            return
        off_m = abs(now[1] - rod_m[place])
        elsewhere = any(from_ns <= now[0] for from_ns, _ in displaced)
        if not elsewhere and off_m > OFF_M + max(moving_m_s, abs(rod_m_s[place])) * (LAG_S + TAKEN_LATE_S):
            words = f"a set-point is {1e3 * off_m:.1f} mm from the rod, {1e3 * passed_s:.0f} ms after the previous one"
            yield words, now[0]
            return
        if now[0] - before[0] > FOLLOWS_AGAIN_NS and abs(now[2] - rod_m_s[place]) > gained_m_s:
            words = f"after a gap, the set-point speed is {now[2]:.3g} m/s, the rod speed {rod_m_s[place]:.3g} m/s"
            yield words, now[0]
            return


def no_set_point_sets_a_stopped_rod_in_motion(view: View) -> Findings:
    """After a stop and a gap no set-point is faster than the rod was when it was measured: its drive may stop it."""
    motion, given = motion_of(view), view.session.truth.setpoints
    if motion is None:
        return
    rows, actuator = _ours(view), motion.bench.actuator
    seen_ns = 1e9 * ((actuator.setpoints_s or 0.0) + LATEST_S + TRIP_S)
    ended_ns = 1e9 * (actuator.longest_setpoint_gap_s + SETPOINT_S)
    stopped = [(ns, view.reset_ns(ns)) for ns in (float(trip["latched_ns"]) for trip in view.station("trip"))]
    for before, now in pairwise(given):
        seen = rows[(rows[:, 0] > now[0] - seen_ns) & (rows[:, 0] <= now[0]), 1]
        after_stop = any(from_ns < before[0] + ended_ns < to_ns for from_ns, to_ns in stopped)
        if now[0] - before[0] <= ended_ns or not after_stop or not len(seen):
            continue
        fastest_m_s = np.max(np.abs(seen))
        if abs(now[2]) > fastest_m_s + STOPPED_M_S:
            words = f"after a stop, the set-point speed is {now[2]:.3g} m/s, the rod's at most {fastest_m_s:.3g} m/s"
            yield words, now[0]
            return


def a_stopped_rod_only_slows_down(view: View) -> Findings:
    """After a latched stop the rod comes to rest: a halt only takes speed away, a fade's peaks only fall."""
    motion = motion_of(view)
    if motion is None:
        return
    rows = _ours(view)
    for trip in view.station("trip"):
        latched_ns = float(trip["latched_ns"])
        reaction_ns, ends_ns = 1e9 * _reaction_s(view, motion, latched_ns), _stopped_until(view, latched_ns)
        before = view.between(latched_ns - 1e9 * motion.period_s, latched_ns + reaction_ns)
        after = rows[(rows[:, 0] >= latched_ns + reaction_ns) & (rows[:, 0] < ends_ns)]
        if not len(before) or not len(after):
            continue
        cycles = motion.bench.actuator.fade_out_cycles
        per_ns = 1e-9 / motion.period_s if motion.period_s else math.inf  # without cycles nothing is faded
        passed = (after[:, 0] - after[0, 0] + 1.0) * per_ns
        fading_m_s = _fading_m_s(passed, float(np.max(np.abs(before[:, 1]))), cycles)
        slower_m_s = np.minimum.accumulate(np.abs(after[:, 1])) + FADES_M_S
        at_rest_s = max(AT_REST_S, AT_REST_PERIODS * motion.period_s)
        stopping = rows[(rows[:, 0] >= latched_ns) & (rows[:, 0] < ends_ns)]
        rested = _since_rest(stopping[:, 1], round(at_rest_s / EVERY_S)) + len(after) - len(stopping)
        fading_m_s[max(0, rested) :] = 0.0
        faster = np.abs(after[:, 1]) > np.maximum(fading_m_s, slower_m_s)
        if np.any(faster):
            speed_m_s, at_ns = _worst(after, faster, after[:, 1])
            since_s = 1e-9 * (at_ns - latched_ns)
            when = f"{since_s:.2f} s after the stop for {trip['slug']}"
            yield f"the rod moves at {abs(speed_m_s):.3g} m/s again {when}", at_ns


def _fading_m_s(passed: Rows, from_m_s: float, cycles: float) -> Rows:
    """How fast a rod may be in a fade-out over so many cycles, of which some have passed.

    The amplitude falls linearly, which is itself a speed: of a triangle `f A`, a quarter of its own.
    """
    share = np.clip(1.0 - passed / cycles, 0.0, 1.0)
    return from_m_s * (1.0 + FASTER_SHARE) * np.where(share > 0.0, share + 0.25 / cycles, 0.0)


def _since_rest(speed_m_s: Rows, count: int) -> int:
    """The first row by which the rod has been at rest for so many; the number of rows where it never has."""
    moves = np.flatnonzero(np.abs(speed_m_s) > STILL_M_S)
    ends = np.append(moves, len(speed_m_s))
    begins = np.concatenate(([-1], moves))
    long = np.flatnonzero(ends - begins - 1 >= count)
    return int(begins[long[0]]) + 1 + count if len(long) else len(speed_m_s)


def _reaction_s(view: View, motion: Motion, latched_ns: float) -> float:
    """From a latched stop until the controller has begun to stop the rod (s)."""
    if not view.way_hidden_between(latched_ns - RECONNECTED_NS, latched_ns + 1e9 * UNHEARD_S):
        return REACTION_S
    return UNHEARD_S + (0.0 if motion.streamed else motion.bench.actuator.watchdog_s)


def _stopped_until(view: View, latched_ns: float) -> float:
    """Until when (ns) a stop is checked: until the controller begins to ignore stops."""
    return min([view.reset_ns(latched_ns), *(from_ns for from_ns, _ in view.spans(IGNORES))])


MOTION_CHECKS: dict[str, Callable[[View], Findings]] = {
    "travel": travel_is_kept,
    "speed": speed_is_kept,
    "acceleration": acceleration_is_kept,
    "stopping-distance": a_stop_has_its_travel,
    "setpoints": setpoints_go_on_from_each_other,
    "set-in-motion": no_set_point_sets_a_stopped_rod_in_motion,
    "slows-down": a_stopped_rod_only_slows_down,
}
