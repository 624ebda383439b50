"""What the record of a hybrid test says where something did not move: no number at all, never one without end."""

from __future__ import annotations

import json

import numpy as np
import pytest

from rig.hybrid.assessment import Record, assess

TIME_S = 0.01 * np.arange(200)
STILL_M = np.zeros(200)


def test_a_test_that_ended_before_its_bump_is_compared_with_nothing() -> None:
    """The car shakes a little by the load cell's noise, the reference stands."""
    shaken_m = 1e-5 * np.sin(12.0 * TIME_S)
    record = Record(TIME_S, shaken_m, 1.1 * shaken_m, shaken_m, shaken_m, np.column_stack([STILL_M] * 3))
    found = assess(record)
    assert found is not None
    assert found.tracking_nrms == pytest.approx(0.1)
    assert set(found.criteria) == {"J1", "J2", "J3"}
    json.dumps(found.criteria, allow_nan=False)


def test_of_a_target_that_stands_no_tracking_is_reported() -> None:
    moving_m = np.sin(12.0 * TIME_S)
    found = assess(Record(TIME_S, STILL_M, moving_m, STILL_M, STILL_M, np.column_stack([moving_m] * 3)))
    assert found is not None
    assert found.tracking_nrms is None
    assert "J2" not in found.criteria
