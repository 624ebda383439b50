"""A sensor that stopped following the motion cannot be laid over the controller's record: that is said, not raised."""

from __future__ import annotations

import numpy as np
import pytest

from rig.signals.arrays import TimeSeries
from rig.signals.delay_estimation.sample_match import match


def test_a_sensor_that_is_stuck_but_for_a_few_samples_matches_nothing() -> None:
    reference_s = np.arange(0.0, 1.0, 0.01)
    reference = 0.02 * np.sin(2 * np.pi * reference_s)
    time_s = np.arange(0.0, 1.0, 0.004)
    values = np.full(time_s.size, 0.005225)
    values[::50] = 0.02 * np.sin(2 * np.pi * time_s[::50])
    sensor = TimeSeries(time_s, values)
    assert match(TimeSeries(reference_s, reference), sensor, 0.004, reach_s=0.05, with_drift=False) is None


@pytest.mark.parametrize(
    ("frequency_Hz", "end_s", "stuck_at"),
    [(1.0, 1.5, 2327.05), (2.0, 0.8, 0.0763), (3.0, 0.8, -0.2498), (5.0, 1.5, 0.005225)],
)
def test_no_line_is_laid_through_the_rounding_of_a_sensor_that_was_at_rest(
    frequency_Hz: float, end_s: float, stuck_at: float
) -> None:
    """A cubic through equal samples moves in its last digit: numpy warns of a line through that, and warnings raise."""
    reference_s, time_s = np.arange(0.0, end_s, 0.01), np.arange(0.0, end_s, 0.004)
    moving = 0.02 * np.sin(2 * np.pi * frequency_Hz * time_s)
    sensor = TimeSeries(time_s, np.where(time_s < 0.5 * end_s, stuck_at, moving))
    reference = TimeSeries(reference_s, 0.02 * np.sin(2 * np.pi * frequency_Hz * reference_s))
    assert match(reference, sensor, 0.004, reach_s=0.05, with_drift=False) is None
