"""How a signal was followed: against the target's motion, wherever that motion lies."""

from __future__ import annotations

import math
from dataclasses import replace
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


def test_a_force_target_is_compared_with_the_force_without_the_means() -> None:
    time_s = 0.01 * np.arange(1001)
    target_N = 300.0 * np.sin(math.tau * time_s)
    channels = {
        name: SimpleNamespace(time_s=time_s, records=np.array([(value,) for value in values], [("value", float)]))
        for name, values in (("signal_time", time_s), ("signal_target", 0.0 * time_s), ("signal_force", target_N))
    }
    point = replace(REQUESTED, record=RecordFacts("", 10.0, 1.0, 5.0, of_force=True))
    alignment = SimpleNamespace(timed=channels, origin_s=0.0)
    for share, reasons in ((0.97, []), (0.8, ["RMS tracking error of the force: 20 % of the target"])):
        seen = SimpleNamespace(time_s=time_s, displacement_m=0.0 * time_s, force_N=share * target_N - 250.0)
        tracking = tracking_of(point, cast("Any", alignment), cast("Any", seen))
        assert tracking is not None
        assert tracking.nrms == pytest.approx(1.0 - share, abs=1e-3)
        assert tracking.mean_m is None
        assert tracking.mean_N == pytest.approx(-250.0, abs=1.0)
        texts = [reason.text[:55] for reason in tracking_reasons(point, tracking, stopped=False, tolerance=0.05)]
        assert [text[:len(reason)] for text, reason in zip(texts, reasons, strict=True)] == reasons


@pytest.mark.parametrize("centre_m", [0.0, 0.03])
def test_a_rod_that_only_stands_where_the_motion_lies_has_not_followed_it(centre_m: float) -> None:
    wave_m = 0.005 * np.sin(math.tau * 0.01 * np.arange(1001))
    assert reasons_of(centre_m + wave_m, centre_m + 0.95 * wave_m) == []
    assert reasons_of(centre_m + wave_m, centre_m + 0.85 * wave_m) == ["tracking SUSPECT"]
    assert reasons_of(centre_m + wave_m, np.full(1001, centre_m)) == ["tracking INVALID"]
