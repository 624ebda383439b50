"""Sizes that no damper test has, and the unit of the numbers, probably: kN for N, ms for s, mm for m, mA for A.

The envelope is wide: motions of 1.5 m and 10 m/s, cycles of 5 ms to 200 s, forces of 10 N to 500 kN, currents of 20 A.
A motion both small and slow (below 0.5 mm and 1 mm/s) is outside too: metres read in mm are, hardly any damper test.
What is outside is not refused by its size alone, but is named with the likely unit. A test that stays inside may still
have a wrong unit: a damper of 20 kN read in kN is one of 20 N.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

LARGEST_SPAN_m, SMALLEST_SPAN_m = 1.5, 2e-5
LARGEST_SPEED_m_s, SMALLEST_SPEED_m_s = 10.0, 5e-5
SMALL_SPAN_m, SLOW_m_s = 5e-4, 1e-3
"""Tests have one or the other; both together are metres read in mm, of up to 500 mm at up to 1 m/s."""
LARGEST_FORCE_N, SMALLEST_FORCE_N = 500e3, 10.0
LARGEST_CURRENT_A, SMALLEST_CURRENT_A = 20.0, 0.01
LONGEST_CYCLE_s, SHORTEST_CYCLE_s = 200.0, 0.005


@dataclass(frozen=True)
class TestSize:
    """How large the channels of some tests are.

    Attributes:
        span_m: largest span of the displacement (m); None where unknown, as all of these.
        speed_m_s: greatest speed (m/s).
        force_N: greatest deviation of the force from its mean in any test (N).
        current_A: greatest current (A).
        cycle_s: median duration of a cycle (s).
    """

    __test__ = False  # pytest takes classes called Test for its own

    span_m: float | None = None
    speed_m_s: float | None = None
    force_N: float | None = None
    current_A: float | None = None
    cycle_s: float | None = None


@dataclass(frozen=True)
class Doubt:
    """A quantity outside the envelope.

    Attributes:
        slug: `units-force`, `units-time`, `units-displacement` or `units-current`.
        value: its size in the unit it is taken to be in.
        taken_as: that unit.
        likely: the unit that the numbers are probably in.
        factor: by which to multiply the numbers.
    """

    slug: str
    value: float
    taken_as: str
    likely: str
    factor: float


def doubts(size: TestSize) -> list[Doubt]:
    """What lies outside the envelope, the time first: a wrong one makes the speed wrong too."""
    outside = [*_time(size)]
    return [*outside, *_displacement(size, timed=not outside), *_force(size), *_current(size)]


def _time(size: TestSize) -> Iterator[Doubt]:
    if size.cycle_s is None:
        return
    if size.cycle_s > LONGEST_CYCLE_s:
        yield Doubt("units-time", size.cycle_s, "s", "ms", 1e-3)
    elif size.cycle_s < SHORTEST_CYCLE_s:
        yield Doubt("units-time", size.cycle_s, "s", "s, not ms", 1e3)


def _displacement(size: TestSize, *, timed: bool) -> Iterator[Doubt]:
    """With `timed` the speed tells too."""
    if size.span_m is None:
        return
    speed = size.speed_m_s if timed else None
    if size.span_m > LARGEST_SPAN_m or (speed is not None and speed > LARGEST_SPEED_m_s):
        yield Doubt("units-displacement", size.span_m, "m", "mm", 1e-3)
    elif 0.0 < size.span_m < SMALLEST_SPAN_m or (
        speed is not None and size.span_m > 0.0 and any(
            0.0 < speed < slow and size.span_m < small
            for slow, small in ((SMALLEST_SPEED_m_s, 1e3 * SMALLEST_SPAN_m), (SLOW_m_s, SMALL_SPAN_m))
        )
    ):
        yield Doubt("units-displacement", size.span_m, "m", "m, not mm", 1e3)


def _force(size: TestSize) -> Iterator[Doubt]:
    if size.force_N is None:
        return
    if 0.0 < size.force_N < SMALLEST_FORCE_N:
        yield Doubt("units-force", size.force_N, "N", "kN", 1e3)
    elif size.force_N > LARGEST_FORCE_N:
        yield Doubt("units-force", size.force_N, "N", "N, not kN", 1e-3)


def _current(size: TestSize) -> Iterator[Doubt]:
    if size.current_A is None:
        return
    if size.current_A > LARGEST_CURRENT_A:
        yield Doubt("units-current", size.current_A, "A", "mA", 1e-3)
    elif 0.0 < size.current_A < SMALLEST_CURRENT_A:
        yield Doubt("units-current", size.current_A, "A", "A, not mA", 1e3)
