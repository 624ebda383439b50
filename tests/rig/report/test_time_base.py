"""What the report says of delays that nobody checked, or that nobody stated."""

from __future__ import annotations

import numpy as np
import pytest

from rig.document.html import fragment
from rig.recording.quality.point_quality import PointQuality
from rig.recording.recorded_point import RecordedPoint
from rig.report.point_tables import time_base
from rig.report.views import PointView


def a_point(*, checked: bool, **quality: float) -> PointView:
    time_s = np.arange(500) / 250.0
    return PointView(RecordedPoint.from_arrays(
        time_s=time_s, displacement_m=0.02 * np.sin(2 * np.pi * time_s), force_N=500.0 * np.cos(2 * np.pi * time_s),
        id="p001", waveform="sine", amplitude_m=0.02, frequency_Hz=1.0, current_A=0.5, skew_std_s=1e-3,
        quality=PointQuality.read({"force_clock_std_s": 1e-3, "skew_checked": int(checked), **quality}),
    ), None)


@pytest.mark.parametrize(("checked", "word"), [(True, "yes"), (False, "no")])
def test_each_point_says_whether_its_delays_were_checked(checked: bool, word: str) -> None:
    page = fragment(time_base([a_point(checked=checked)]))
    assert f">{word}</td>" in page


def test_a_sensor_whose_delay_nobody_stated_is_named() -> None:
    page = fragment(time_base([a_point(checked=False, displacement_declared_delay_s=0.0)]))
    missing = "<code>delay</code> for force"
    assert missing in page
    stated = a_point(checked=False, displacement_declared_delay_s=0.0, force_declared_delay_s=0.0002)
    assert missing not in fragment(time_base([stated]))
