"""A rig whose load cell lags by 2 ms nobody declared and whose clock runs 300 ppm fast: what a campaign says of it.

One simulated rig of four times real time serves all tests here; its truth file decides.
"""

from __future__ import annotations

import numpy as np
import pytest
from matrices import matrix_text
from simulated_campaign import Ended, options, simulated
from true_states import Truth

from rig.recording.quality.campaign_delay import pooled_skews
from rig.recording.recorded_point import RecordedPoint

MATRIX = matrix_text("0 A", "1 A", "2 A", amplitude="30 mm", cycles=10)
LAG_S = 2e-3
COVERING = 4.0
"""Standard deviations: beyond them is a defect, not bad luck."""


@pytest.fixture(scope="module")
def lagging(tmp_path_factory: pytest.TempPathFactory) -> Ended:
    settings = options(f"load_cell.skew_s={LAG_S}", "load_cell.clock_ppm=300")
    ended = simulated(tmp_path_factory.mktemp("lagging"), MATRIX, *settings, speed=4.0, seed=11)
    assert ended.exit_code == 0, ended.output[-3000:]
    return ended


def true_time_s(truth: Truth, point: RecordedPoint) -> np.ndarray:
    """The rig's own time of each force sample of a point, as corrected."""
    clock_s = float(point.test["controller_clock_at_zero_s"]) + point.force_samples.time_s
    rate = 1.0 + 1e-6 * truth.clocks["clock_ppm_controller"]
    time_s = (clock_s - 1e-6 * truth.clocks["clock_offset_us_controller"]) / rate
    wrap_s = 2.0**32 * 1e-6 / rate
    return np.asarray(time_s + wrap_s * round((np.mean(truth.time_s) - np.mean(time_s)) / wrap_s))


def test_every_points_skew_is_what_was_set_as_far_as_it_is_known(lagging: Ended) -> None:
    for point in lagging.run.points:
        assert abs(point.skew_s - LAG_S) < COVERING * point.skew_std_s, point.id
        assert point.skew_std_s < 0.6e-3
    skews = [point["quality"]["skew_s"] for point in lagging.answer["points"]]
    assert skews == [point.skew_s for point in lagging.run.points]


def test_all_points_together_know_it_better(lagging: Ended) -> None:
    points = lagging.run.points
    skews = pooled_skews(points)
    (found_s,) = {skew.force.value_s - skew.displacement.value_s for skew in skews.values()}
    assert skews.keys() == {point.id for point in points}
    std_s = max(skew.std_s for skew in skews.values())
    assert abs(found_s - LAG_S) < COVERING * std_s
    assert std_s < min(0.3e-3, max(point.skew_std_s for point in points))


def test_the_drift_of_the_load_cells_clock_is_stated_with_its_uncertainty(lagging: Ended) -> None:
    true_ppm = 300.0 - lagging.truth.clocks["clock_ppm_controller"]
    for point in lagging.run.points:
        std_ppm = point.quality.force.clock_drift_std_ppm or 0.0
        assert abs((point.quality.force.clock_drift_ppm or 0.0) - true_ppm) < 3.0 * std_ppm + 0.1, point.id
        assert std_ppm < 5.0


def test_corrected_force_lies_over_the_true_force_within_what_is_left_uncertain(lagging: Ended) -> None:
    truth, lags_s = lagging.truth, np.linspace(-4e-3, 4e-3, 161)
    for point in lagging.run.points:
        time_s, force_N = true_time_s(truth, point), point.force_samples.force_N
        misfit = [np.sum((force_N - np.interp(time_s - lag_s, truth.time_s, truth.force_N)) ** 2) for lag_s in lags_s]
        left_s = abs(lags_s[int(np.argmin(misfit))])
        assert left_s < COVERING * point.skew_std_s + 0.1e-3, point.id
