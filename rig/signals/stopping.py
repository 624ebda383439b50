"""Stopping distance: where a motion comes to rest that is halted at this instant. Pure, no numpy.

A halt from position x at speed v ends at x + v |v| / (2 d). The plan, and the station once more at the start request,
keep that within the position limits at every instant of every motion. Both count on d = `[actuator] halt_deceleration`
alone. A halt that brakes harder near a limit (up to the acceleration limit) is a reserve that no plan relies on; a
device with a halt command of its own must be set to `halt_deceleration` at least.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

Numbers = TypeVar("Numbers", bound=Any)
"""A float, or an array of floats."""

CYCLE_STEPS = 120
"""Instants of a cycle at which a halt is looked at: 3 degrees, which miss 0.03 % of an amplitude at most."""

CORNER = 1.0
"""Of unit amplitude and frequency: where the speed changes by more from one instant to the next (a sine's by 0.33)."""


class Reach(NamedTuple):
    """Lowest and highest position (m) at which a halt comes to rest that begins at any instant of a motion."""

    low_m: float
    high_m: float


def halted_m(position_m: Numbers, velocity_m_s: Numbers, deceleration_m_s2: float) -> Numbers:
    """Where a halt comes to rest (m).

    Args:
        position_m: where it begins (m): one number, or an array.
        velocity_m_s: speed there (m/s), of the same shape.
        deceleration_m_s2: of the halt.
    """
    halted: Numbers = position_m + velocity_m_s * abs(velocity_m_s) / (2.0 * deceleration_m_s2)
    return halted


def reach(path: Iterable[tuple[float, float]], deceleration_m_s2: float) -> Reach:
    """The reach of a motion.

    Args:
        path: its positions (m) and speeds (m/s); at least one.
        deceleration_m_s2: of a halt.
    """
    low_m, high_m = math.inf, -math.inf
    for position_m, velocity_m_s in path:
        end_m = halted_m(position_m, velocity_m_s, deceleration_m_s2)
        low_m, high_m = min(low_m, end_m), max(high_m, end_m)
    return Reach(low_m, high_m)


class Cycles(NamedTuple):
    """A motion of cycles about its centre.

    Attributes:
        shape: one cycle of unit amplitude, (n,) evenly spaced: value, and its change a cycle.
        amplitude_m: m.
        frequency_Hz: Hz.
        ramp_in_cycles, ramp_out_cycles: linear in the phase, beside `cycles` at full amplitude.
        cycles: at full amplitude.
        fade_out_cycles: over which a stop fades the motion out.
    """

    shape: Sequence[tuple[float, float]]
    amplitude_m: float
    frequency_Hz: float
    ramp_in_cycles: float
    ramp_out_cycles: float
    cycles: float
    fade_out_cycles: float

    def path(self) -> Iterator[tuple[float, float]]:
        """Positions (m) about the centre and speeds (m/s): ramps, one full cycle, and a fade begun at any instant.

        At a corner the speeds before and after it are both there. Later in a fade all is smaller.
        """
        count, before = len(self.shape), self.shape[-1][1]
        for value, change in self.shape:
            yield self._at(1.0, value, change)
            yield self._at(1.0, value, change, -1.0 / self.fade_out_cycles)
            if abs(change - before) > CORNER:
                yield self._at(1.0, value, before)
            before = change
        total = self.ramp_in_cycles + self.cycles + self.ramp_out_cycles
        for ramp, direction, begin in (
            (self.ramp_in_cycles, 1.0, 0.0), (self.ramp_out_cycles, -1.0, total - self.ramp_out_cycles)
        ):
            for step in range(round(ramp * count) + 1 if ramp > 0.0 else 0):
                done = min(1.0, step / (ramp * count))
                share = done if direction > 0.0 else 1.0 - done
                value, change = self.shape[(round(begin * count) + step) % count]
                yield self._at(share, value, change, direction / ramp)

    def _at(self, share: float, value: float, change: float, slope: float = 0.0) -> tuple[float, float]:
        """Position and speed with a share of the amplitude that changes by `slope` a cycle."""
        speed_m_s = self.amplitude_m * self.frequency_Hz * (share * change + slope * value)
        return self.amplitude_m * share * value, speed_m_s
