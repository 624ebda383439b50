"""Cycles of tests as a fit keeps them in its file where the tests have none."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.errors import FileProblem
from rig.fits.entries import TestCycle
from rig.identification.models.measurement import Measurement

DIGITS = 7
"""Significant digits of the numbers in the file."""


def cycles_of(tests: Iterable[Measurement]) -> tuple[TestCycle, ...]:
    """Tests of one cycle each as values of a file."""
    return tuple(
        TestCycle(
            test.id, test.dt_s, _plain(test.u_m), _plain(test.v_m_s), _plain(test.a_m_s2),
            _plain(np.where(test.scored, test.force_N, 0.0)), _plain(test.current_A),
            tuple(np.flatnonzero(~test.scored).tolist()),
            () if test.temperature_degC is None else _plain(test.temperature_degC),
        ) for test in tests
    )  # fmt: skip


def tests_of(cycles: Sequence[TestCycle], file: str) -> list[Measurement]:
    """The tests again.

    Args:
        cycles: of `cycles_of`.
        file: where they were read, for messages.

    Raises:
        FileProblem: arrays of a cycle differ in length, or hold what no test has.
    """
    tests, problems = [], []
    for place, one in enumerate(cycles):
        usable = np.ones(len(one.displacement_m), dtype=bool)
        try:
            usable[list(one.missing)] = False
            tests.append(Measurement(
                one.id, np.array(one.displacement_m), np.array(one.velocity_m_s), np.array(one.acceleration_m_s2),
                np.array(one.force_N), np.array(one.current_A), one.dt_s, samples_per_cycle=len(one.displacement_m),
                usable=None if usable.all() else usable,
                temperature_degC=np.array(one.temperature_degC) if one.temperature_degC else None,
            ))  # fmt: skip
        except (ValueError, IndexError) as error:
            problems.append(f"cycles[{place}]: {error}")
    if problems:
        raise FileProblem(file, problems)
    return tests


def _plain(values: FloatArray) -> tuple[float, ...]:
    return tuple(float(f"{value:.{DIGITS}g}") for value in values.tolist())
