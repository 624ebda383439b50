"""Steps of the current during a motion: which of them were commanded, and which fell into the straight part."""

from __future__ import annotations

import numpy as np
import pytest

from rig.signals.arrays import FloatArray
from rig.signals.straight_steps import StepsInMotion, steps_in_motion

HALF_S, SPEED_M_S, START_S, STAGGER_S = 0.4, 0.2, 7.3, 0.00618
REPEATS = 5
"""The program of `examples/response.toml` at 0.2 m/s: six half strokes a repeat, up, down, none, up, down, none."""
STEPS = [
    (1.1033 + (6 * repeat + half) * HALF_S + STAGGER_S * (repeat % 2), current_A)
    for repeat in range(REPEATS) for half, current_A in ((0, 2.0), (1, 0.0), (3, 2.0), (4, 0.0))
]


def evaluated(late_s: FloatArray, kept: FloatArray) -> StepsInMotion:
    """The steps if those that are `kept` were commanded so late (s); each command is repeated every 0.1 s."""
    time_s = np.arange(0.0, 16.0, 0.004)
    velocity_m_s = SPEED_M_S * np.where((time_s / HALF_S - 0.5) % 2.0 < 1.0, 1.0, -1.0)
    steps_s, steps_A = (tuple(column) for column in zip((0.0, 0.0), *STEPS, strict=True))
    at_s = np.array(steps_s[1:]) + late_s
    cyclic_s = np.arange(0.0, 16.0, 0.1)
    held = np.concatenate(([0.0], np.array(steps_A[1:])[kept]))
    commands_s = np.concatenate((cyclic_s, at_s[kept]))
    commands_A = np.concatenate((held[np.searchsorted(at_s[kept], cyclic_s, "right")], held[1:]))
    order = np.argsort(commands_s, kind="stable")
    return steps_in_motion(
        (steps_s, steps_A), (commands_s[order] + START_S, commands_A[order]), (time_s + START_S, velocity_m_s),
        SPEED_M_S,
    )


def test_steps_of_a_busy_computer_are_not_counted_as_not_commanded_although_another_start_fits_them_better() -> None:
    """The first in time and the others 30 ms late: a start three half patterns later is 30 ms nearer to 14 of 20."""
    late_s = np.where(np.arange(len(STEPS)) > 0, 0.030, 0.0)
    steps = evaluated(late_s, np.ones(len(STEPS), bool))
    assert (steps.planned, steps.not_commanded, steps.outside, steps.wrong_speed) == (20, 0, 0, 0)
    commanded_s = np.array([at_s for at_s, _ in STEPS]) + START_S + late_s
    assert [step.at_s for step in steps.steps] == pytest.approx(commanded_s)


def test_steps_that_were_not_commanded_are_counted() -> None:
    kept = ~np.isin(np.arange(len(STEPS)), (6, 7, 12, 13))
    steps = evaluated(np.zeros(len(STEPS)), kept)
    assert (steps.not_commanded, len(steps.steps)) == (4, 16)
    assert list(steps.lost()) == ["4 of 20 steps were not commanded"]
