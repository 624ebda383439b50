"""How a signal was followed: against the target's motion, wherever that motion lies."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rig.recording.quality.tracking import tracking_of, tracking_reasons
from rig.signals.record import RecordFacts
from rig.test_point import TestPoint

REQUESTED = TestPoint("p001", "file", 0.035, 1.0, 0.0, kind="signal", record=RecordFacts("", 10.0, 1.0, 5.0))


def reasons_of(target_m: np.ndarray, rod_m: np.ndarray) -> list[str]:
    """The verdicts on a rod beside its target, both 10 s long, 100 a second."""
    time_s = 0.01 * np.arange(1001)
    channels = {
        name: SimpleNamespace(time_s=time_s, records=np.array([(value,) for value in values], [("value", float)]))
        for name, values in (("signal_time", time_s), ("signal_target", target_m))
    }
    alignment = SimpleNamespace(timed=channels, origin_s=0.0)
    seen = SimpleNamespace(time_s=time_s, displacement_m=rod_m)
    tracking = tracking_of(REQUESTED, cast("Any", alignment), cast("Any", seen))
    return [f"{reason.slug} {reason.kind.name}" for reason in tracking_reasons(REQUESTED, tracking, stopped=False)]


@pytest.mark.parametrize("centre_m", [0.0, 0.03])
def test_a_rod_that_only_stands_where_the_motion_lies_has_not_followed_it(centre_m: float) -> None:
    wave_m = 0.005 * np.sin(math.tau * 0.01 * np.arange(1001))
    assert reasons_of(centre_m + wave_m, centre_m + 0.95 * wave_m) == []
    assert reasons_of(centre_m + wave_m, centre_m + 0.85 * wave_m) == ["tracking SUSPECT"]
    assert reasons_of(centre_m + wave_m, np.full(1001, centre_m)) == ["tracking INVALID"]
