"""Cycles of a current program that is repeated during a cyclic motion: which of them have the same current.

The program repeats itself after a whole number of cycles. Cycles with the same constant current are compared with each
other; those during which the current changes are compared only where the program has no others: where in the cycle it
changes depends on some milliseconds of the start.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rig.signals.arrays import BoolArray, FloatArray, IntArray

PROGRAM_CYCLE = "program_cycle"
"""Name of the statistic that states the place of a cycle in the program, from 1."""
UNCERTAIN_S = 0.02
"""A step may come so much earlier or later in the motion than commanded: start of the motion, and status of the ECU."""
SLOW_SHARE = 0.3
"""Of the peak speed of a cycle."""
SETTLED_S = 0.2
"""Until then after a step, current and force of a usual coil still change, so that a cycle depends on when it began."""
MOST_SHIFT = 2
"""Cycles by which the first cycle that was recognised may be later than the first cycle of the program."""


@dataclass(frozen=True)
class RepeatedProgram:
    """A current program during a cyclic motion.

    Attributes:
        time_s: when each current begins, s since the start of the program; 0 first, rising, below `cycles` periods.
        current_A: the currents.
        frequency_Hz: of the motion.
        cycles: of the motion, after which the program repeats itself.
    """

    time_s: tuple[float, ...]
    current_A: tuple[float, ...]
    frequency_Hz: float
    cycles: int

    @classmethod
    def of_steps(
        cls, steps_s: Sequence[float], steps_A: Sequence[float], frequency_Hz: float, begin_s: float, cycles: int
    ) -> RepeatedProgram:
        """The program whose `steps` a test point has."""
        end_s = begin_s + cycles / frequency_Hz - 1e-6
        within = [
            (at_s - begin_s, level_A) for at_s, level_A in zip(steps_s, steps_A, strict=True) if begin_s < at_s < end_s
        ]
        return cls(
            (0.0, *(at_s for at_s, _ in within)), (steps_A[0], *(level_A for _, level_A in within)), frequency_Hz,
            cycles,
        )  # fmt: skip

    @property
    def period_s(self) -> float:
        """After which the program repeats itself (s)."""
        return self.cycles / self.frequency_Hz

    def steps(self, begin_s: float, cycles: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Times (s since the start of the motion, ramp included; 0 first) and currents (A) of the steps of a motion.

        Args:
            begin_s: of the program (s since the start of the motion); the first current applies before it.
            cycles: of the motion, at least one repetition of the program.
        """
        times_s, currents_A = [0.0], [self.current_A[0]]
        for repetition in range(math.ceil(cycles / self.cycles)):
            for at_s, level_A in zip(self.time_s, self.current_A, strict=True):
                since_s = repetition * self.period_s + at_s
                if level_A != currents_A[-1] and since_s < cycles / self.frequency_Hz - 1e-9:
                    times_s.append(round(begin_s + since_s, 6))
                    currents_A.append(level_A)
        return tuple(times_s), tuple(currents_A)

    @property
    def means_A(self) -> FloatArray:
        """Mean commanded current of each cycle of the program (cycles,), A."""
        ends_s = np.append(self.time_s[1:], self.period_s)
        charge = np.concatenate(([0.0], np.cumsum(np.asarray(self.current_A) * (ends_s - self.time_s))))
        edges_s = np.arange(self.cycles + 1) / self.frequency_Hz
        return np.diff(np.interp(edges_s, np.append(self.time_s, self.period_s), charge)) * self.frequency_Hz

    @property
    def _changes_s(self) -> FloatArray:
        """When the current changes (s since the start of the program)."""
        changed = np.append(self.current_A[0] != self.current_A[-1], np.diff(self.current_A) != 0.0)
        changes_s: FloatArray = np.asarray(self.time_s, np.float64)[changed]
        return changes_s

    @property
    def groups(self) -> IntArray:
        """Group of each cycle of the program (cycles,): cycles with the same current; -1: the current changes.

        In a program without a cycle at constant current each of its cycles is a group; see `steps_while_slow`.
        """
        time_s, current_A, changes_s = np.asarray(self.time_s), np.asarray(self.current_A), self._changes_s
        begins_s = np.arange(self.cycles) / self.frequency_Hz
        near = np.zeros(self.cycles, bool)
        for at_s in np.append(changes_s, changes_s + self.period_s):
            near |= (at_s > begins_s - SETTLED_S) & (at_s < begins_s + 1.0 / self.frequency_Hz + UNCERTAIN_S)
        if np.all(near):
            return np.arange(self.cycles)
        held = np.searchsorted(time_s, begins_s + 0.5 / self.frequency_Hz, side="right") - 1
        levels = np.unique(current_A)
        return np.where(near, -1, np.searchsorted(levels, current_A[held])).astype(np.int64)

    @property
    def held(self) -> bool:
        """Whether a cycle of the program has a constant current, so that `groups` are of equal currents."""
        return self.cycles > np.unique(self.groups).size or bool(np.any(self.groups < 0))

    @property
    def unwatched_A(self) -> FloatArray:
        """Currents (k,) that no group has, although other currents have one."""
        levels = np.unique(self.current_A)
        used: BoolArray = np.isin(np.arange(levels.size), self.groups) | (not self.held)
        unwatched_A: FloatArray = levels[~used]
        return unwatched_A

    def steps_while_slow(self, position: Callable[[FloatArray], FloatArray]) -> bool:
        """Whether the rod is so slow at every step that some milliseconds change neither peaks nor energy of a cycle.

        Cycles during which the current changes can then be compared with the same cycle of other repetitions.

        Args:
            position: position (n,) at times (n,), s since the start of a cycle of the motion, of either sign.
        """
        tick_s = UNCERTAIN_S / 20.0
        fastest = np.max(np.abs(np.diff(position(np.arange(0.0, 1.0 / self.frequency_Hz + tick_s, tick_s)))))
        near_s = np.arange(-UNCERTAIN_S, UNCERTAIN_S + 0.5 * tick_s, tick_s)
        return all(
            np.max(np.abs(np.diff(position(at_s + near_s)))) <= SLOW_SHARE * fastest for at_s in self._changes_s
        )

    def places(self, numbers: IntArray, current_A: FloatArray) -> FloatArray:
        """Cycle of the program, from 1, of each cycle of a motion (k,).

        Args:
            numbers: of the cycles in the motion, from 0, by what was recognised: the first may be missing.
            current_A: mean current that was measured in each; not-a-number where unknown.
        """
        means_A, known = self.means_A, np.isfinite(current_A)
        # Neighbouring cycles may have equal currents: the smallest shift that fits is taken.
        misses = [
            float(np.sum(np.abs(means_A[(numbers[known] + shift) % self.cycles] - current_A[known])))
            for shift in range(min(MOST_SHIFT, self.cycles - 1) + 1)
        ]
        shift = int(np.argmin(np.asarray(misses) - 1e-9 * np.arange(len(misses), 0, -1)))
        return ((numbers + shift) % self.cycles + 1).astype(np.float64)

    def groups_of(self, places: FloatArray) -> IntArray:
        """Group of each cycle (k,) by its place in the program; -1: in none."""
        known = np.isfinite(places)
        index = np.where(known, places, 1.0).astype(np.int64) - 1
        return np.where(known, self.groups[index % self.cycles], -1)
