"""Which cycles of a motion have the same current of a repeated program."""

from __future__ import annotations

import numpy as np
import pytest

from rig.signals.program_cycles import RepeatedProgram

PROGRAM = RepeatedProgram((0.0, 2.0), (0.2, 1.0), 4.0, 16)


def test_the_cycles_at_a_step_are_not_compared() -> None:
    assert PROGRAM.groups.tolist() == [-1, *[0] * 6, -1, -1, *[1] * 6, -1]
    assert PROGRAM.means_A.tolist() == pytest.approx([0.2] * 8 + [1.0] * 8)


def test_without_a_cycle_at_constant_current_each_cycle_of_the_program_is_a_group() -> None:
    within = RepeatedProgram((0.0, 0.125), (0.0, 1.0), 4.0, 1)
    assert within.groups.tolist() == [0]
    assert within.means_A.tolist() == pytest.approx([0.5])


@pytest.mark.parametrize("begin_s", [0.25, 0.0, 0.7])
def test_the_program_is_read_from_the_steps_of_a_point(begin_s: float) -> None:
    steps = PROGRAM.steps(begin_s, 40)
    assert steps[0][:3] == (0.0, begin_s + 2.0, begin_s + 4.0)
    read = RepeatedProgram.of_steps(*steps, 4.0, begin_s, 16)
    assert read.time_s == pytest.approx(PROGRAM.time_s)
    assert read.current_A == PROGRAM.current_A


@pytest.mark.parametrize("missing", [0, 1, 2])
def test_a_first_cycle_that_was_not_recognised_is_noticed_by_the_current(missing: int) -> None:
    numbers = np.arange(40 - missing)
    measured_A = PROGRAM.means_A[(numbers + missing) % 16] + 0.01
    places = PROGRAM.places(numbers, measured_A)
    assert places.tolist() == ((numbers + missing) % 16 + 1).tolist()
    unknown = PROGRAM.places(numbers, np.full(numbers.size, np.nan))
    assert unknown[0] == 1.0
    groups = PROGRAM.groups_of(np.append(places, np.nan))
    assert groups[-1] == -1
    assert set(measured_A[groups[:-1] == 1].round(2)) == {1.01}
