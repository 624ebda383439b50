"""What is fitted and what is held out lie on one time base: that of all points of the campaign."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.identification import identify
from rig.identification.points.preparation import campaign_skews, prepare_all
from rig.recording.quality.point_quality import PointQuality
from rig.recording.recorded_point import ForceSamples, RecordedPoint

LATE_S = 2e-3


def late(point: RecordedPoint, lag_s: float | None, std_s: float) -> RecordedPoint:
    """The point with a load cell 2 ms late, of which its own record says `lag_s`, and its file nothing yet."""
    quality = {
        f"{name}_{key}": value
        for name in ("force", "displacement")
        for key, value in (
            ("tie_std_s", 2e-6),
            ("compared", 1),
            ("declared_delay_s", 0.2e-3),
            ("undeclared_delay_s", 0.0),
            ("matched_lag_s", 0.0),
            ("matched_lag_std_s", 0.02e-3),
        )
    }
    quality |= {"force_matched_lag_s": lag_s, "force_matched_lag_std_s": std_s}
    if lag_s is None:
        del quality["force_matched_lag_s"]
    changed = replace(point, quality=PointQuality.read(quality), test={"controller_input_delay_s": 0.0})
    samples = point.force_samples
    changed.__dict__["force_samples"] = ForceSamples(samples.time_s + LATE_S, samples.force_N, samples.flags)
    return changed


@pytest.fixture(scope="module")
def campaign(
    demo_points: list[RecordedPoint], make_campaign: Callable[..., list[RecordedPoint]]
) -> list[RecordedPoint]:
    """Sines that know the delay well, triangles that know nothing of it or think of 20 ms."""
    triangles = make_campaign("demo", (0.5, 1.5), (1.0,), seed=5, waveform="triangle")
    known = [late(point, LATE_S, 0.05e-3) for point in demo_points]
    return [*known, *(late(point, lag_s, 12e-3) for point, lag_s in zip(triangles, (23.9e-3, None), strict=True))]


def test_held_out_points_are_aligned_by_all_points_of_the_campaign(campaign: list[RecordedPoint]) -> None:
    fit = identify(campaign, holdout="waveform=triangle")
    assert fit.holdout is not None
    assert fit.holdout.rmse_N < 10.0


def test_points_that_are_neither_fitted_nor_held_out_know_of_the_delay_too(campaign: list[RecordedPoint]) -> None:
    sines, triangles = campaign[:-2], campaign[-2:]
    skews = campaign_skews([*sines, *triangles])
    together, _ = prepare_all(triangles, skews)
    alone, _ = prepare_all(triangles)
    assert len({test.skew_std_s for test in together}) == 1
    assert together[0].skew_std_s < 0.1e-3 < 5e-3 < alone[0].skew_std_s
    fit = identify(triangles, campaign=sines)
    assert fit.error.rmse_N < 10.0


def test_one_skew_is_one_whatever_is_chosen_for_the_fit(campaign: list[RecordedPoint]) -> None:
    all_of_them = campaign_skews(campaign)
    shifts_s = np.array([skew.shift_s for skew in all_of_them.values()])
    assert np.ptp(shifts_s) == 0.0
    assert shifts_s[0] == pytest.approx(-LATE_S, abs=0.05e-3)
