"""Steps of the current during a motion: which of them fell into the straight part of a half stroke.

The exact start of the motion is not known to the program of the current: where in the stroke a step fell is read from
the measured motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rig.signals.arrays import BoolArray, FloatArray

STRAIGHT = 0.9
"""Share of the speed of the straight part from which it begins and at which it ends."""
EDGE_S = 0.005
"""Taken off both ends of the straight part: the velocity is smoothed over some samples."""
BASELINE_SHARE = 0.6
"""Share of the straight part before a step, its end, that serves as the baseline: the rest is run-in."""
SHORTEST_S = 0.02
"""Least baseline and least window of a step that is used."""
SPEED_TOLERANCE = 0.2
SAME_CURRENT_A = 0.002
FEWEST_SAMPLES = 10
"""Of a straight part."""


@dataclass(frozen=True)
class StraightStep:
    """A step in the straight part of its half stroke.

    Attributes:
        at_s: when it was commanded (s).
        from_A, to_A: currents.
        velocity_m_s: of the straight part.
        begin_s, end_s: of the straight part (s).
    """

    at_s: float
    from_A: float
    to_A: float
    velocity_m_s: float
    begin_s: float
    end_s: float

    @property
    def kind(self) -> tuple[bool, float, float]:
        """Whether the rod moved in rebound, and the currents: steps of one kind are repeats of each other."""
        return self.velocity_m_s > 0.0, self.from_A, self.to_A


@dataclass(frozen=True)
class StepsInMotion:
    """Steps of a program, sorted by whether they can be evaluated.

    Attributes:
        steps: those that can be.
        planned: number of steps of the program.
        not_commanded, outside, wrong_speed: number of those that cannot be, by the reason.
        speed_m_s: planned speed.
    """

    steps: tuple[StraightStep, ...]
    planned: int
    not_commanded: int
    outside: int
    wrong_speed: int
    speed_m_s: float

    def lost(self) -> Iterator[str]:
        """One line for each reason why steps cannot be evaluated."""
        if self.not_commanded:
            yield f"{self.not_commanded} of {self.planned} steps were not commanded"
        if self.outside:
            yield f"{self.outside} of {self.planned} steps discarded: outside the constant-speed part of the stroke"
        if self.wrong_speed:
            yield (f"{self.wrong_speed} of {self.planned} steps discarded: the speed differs by more than "
                f"{100 * SPEED_TOLERANCE:g} % from {self.speed_m_s:.3g} m/s")


def steps_in_motion(
    program: tuple[Sequence[float], Sequence[float]], commands: tuple[FloatArray, FloatArray],
    motion: tuple[FloatArray, FloatArray], speed_m_s: float,
) -> StepsInMotion:
    """Find the steps of a program in the measured motion.

    Args:
        program: times (s since the start of the motion) and currents (A) of the steps, the initial current first.
        commands: times (s) and currents (A) that were commanded, (k,) each, on the time base of the motion.
        motion: times (s) and velocities (m/s), (n,) each.
        speed_m_s: planned speed.
    """
    steps_s, steps_A = program
    planned = max(0, len(steps_s) - 1)
    steps: list[StraightStep] = []
    outside = wrong_speed = 0
    commanded = _commanded(steps_s, steps_A, *commands) if planned else []
    for at_s, before_A, after_A in commanded:
        part = _straight_part(*motion, at_s)
        if part is None or at_s - part[0] < SHORTEST_S / BASELINE_SHARE or part[1] - at_s < SHORTEST_S:
            outside += 1
        elif abs(abs(part[2]) / speed_m_s - 1.0) > SPEED_TOLERANCE:
            wrong_speed += 1
        else:
            steps.append(StraightStep(at_s, before_A, after_A, part[2], part[0], part[1]))
    return StepsInMotion(tuple(steps), planned, planned - len(commanded), outside, wrong_speed, speed_m_s)


def _commanded(
    steps_s: Sequence[float], steps_A: Sequence[float], time_s: FloatArray, value_A: FloatArray
) -> list[tuple[float, float, float]]:
    """When each step of a program was commanded (s), and its currents; without those that were not."""
    placed = np.isfinite(time_s) & np.isfinite(value_A)
    time_s, value_A = time_s[placed].astype(np.float64), value_A[placed].astype(np.float64)
    changed = np.flatnonzero(np.abs(np.diff(value_A)) > SAME_CURRENT_A) + 1
    times_s, levels_A = time_s[changed], value_A[changed]
    if not len(times_s):
        return []
    start_s = _start_s(steps_s, steps_A, times_s, levels_A)
    return [
        (at_s, float(steps_A[number - 1]), float(steps_A[number]))
        for number, at_s in _near(start_s, steps_s, steps_A, times_s, levels_A)
    ]


def _near(
    start_s: float, steps_s: Sequence[float], steps_A: Sequence[float], times_s: FloatArray, levels_A: FloatArray
) -> list[tuple[int, float]]:
    """Steps of a program that started then: number, and time of the nearest change to its current (s), if one is near.

    Near: within half of the shortest time between two steps.
    """
    reach_s, near = 0.5 * float(np.min(np.diff(steps_s))), list[tuple[int, float]]()
    for number in range(1, len(steps_s)):
        off_s = np.abs(times_s - start_s - steps_s[number])
        off_s[np.abs(levels_A - steps_A[number]) > SAME_CURRENT_A] = np.inf
        nearest = int(np.argmin(off_s))
        if off_s[nearest] < reach_s:
            near.append((number, float(times_s[nearest])))
    return near


def _start_s(
    steps_s: Sequence[float], steps_A: Sequence[float], times_s: FloatArray, levels_A: FloatArray
) -> float:
    """Start of the program on the time base of the motion (s): the one that most commands fit; of several, the closest.

    The program repeats a pattern: a start that is some patterns late fits all but a few of the steps, and it may fit
    those better than the right start does.
    """
    starts_s = times_s[np.abs(levels_A - steps_A[1]) <= SAME_CURRENT_A] - steps_s[1]

    def fit(start_s: float) -> tuple[int, float]:
        near = _near(start_s, steps_s, steps_A, times_s, levels_A)
        return len(near), -float(np.median([abs(at_s - start_s - steps_s[number]) for number, at_s in near]))

    return max(map(float, starts_s), key=fit, default=float(times_s[0]) - steps_s[1])


def _straight_part(time_s: FloatArray, velocity_m_s: FloatArray, at_s: float) -> tuple[float, float, float] | None:
    """Begin and end (s) of the straight part of the half stroke around a time, and its velocity (m/s)."""
    place = int(np.searchsorted(time_s, at_s))
    near = velocity_m_s[max(0, place - 2) : place + 3]
    near = near[np.isfinite(near)]
    if not len(near):
        return None
    way = math.copysign(1.0, float(np.median(near)))
    ahead: BoolArray = np.asarray(way * velocity_m_s > 0.0) & np.isfinite(velocity_m_s)
    back, forth = np.flatnonzero(~ahead[:place]), np.flatnonzero(~ahead[place:])
    if not len(back) or not len(forth):
        return None
    rows = slice(int(back[-1]) + 1, place + int(forth[0]))
    within_s, speed_m_s = time_s[rows], way * velocity_m_s[rows]
    if len(within_s) < FEWEST_SAMPLES:
        return None
    middle = float(np.median(speed_m_s[len(speed_m_s) // 5 : -len(speed_m_s) // 5]))
    full = np.flatnonzero(speed_m_s >= STRAIGHT * middle)
    begin_s, end_s = float(within_s[full[0]]) + EDGE_S, float(within_s[full[-1]]) - EDGE_S
    return (begin_s, end_s, way * middle) if begin_s < at_s < end_s else None
