"""A sensor that stopped following the motion cannot be laid over the controller's record: that is said, not raised."""

from __future__ import annotations

import numpy as np

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
