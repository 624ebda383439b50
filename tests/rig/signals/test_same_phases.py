"""A force that jumps at each reversal, in cycles that are all sampled at the same phases: what the lag is worth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rig.signals.arrays import FloatArray, TimeSeries
from rig.signals.delay_estimation.cycle_match import CycleStretch, cycle_series, match_cycles
from rig.signals.delay_estimation.same_phases import doubted
from rig.signals.delay_estimation.sample_match import Match

Force = Callable[[FloatArray, float], FloatArray]
SEEDS = range(24)
TURN_S = 1.5e-3
"""So fast the force changes its sign: tanh of time over this."""


def jumping_N(time_s: FloatArray, period_s: float) -> FloatArray:
    """A damper's force under a triangle: 800 N against the motion, whose sign changes twice a cycle."""
    quarter_s = 0.25 * period_s
    since_s = np.mod(time_s + quarter_s, 0.5 * period_s) - quarter_s
    sign = np.where(np.mod(time_s + quarter_s, period_s) < 0.5 * period_s, 1.0, -1.0)
    return 800.0 * sign * np.tanh(since_s / TURN_S)


def smooth_N(time_s: FloatArray, period_s: float) -> FloatArray:
    return 800.0 * np.sin(2.0 * np.pi * time_s / period_s)


def sprung_N(time_s: FloatArray, period_s: float) -> FloatArray:
    """The same of a damper behind a spring: the force gives way within 12 ms, faster and faster, then turns at once."""
    half_s = 0.5 * period_s
    since_s, sign = np.mod(time_s, half_s), np.where(np.mod(time_s, period_s) < half_s, 1.0, -1.0)
    return 250.0 * sign * np.where(since_s < 12e-3, 2.0 * (since_s / 12e-3) ** 2 - 1.0, 1.0)


def stiff_N(time_s: FloatArray, period_s: float) -> FloatArray:
    """The same within 6 ms, less than what lies between two polls."""
    half_s = 0.5 * period_s
    since_s, sign = np.mod(time_s, half_s), np.where(np.mod(time_s, period_s) < half_s, 1.0, -1.0)
    return 250.0 * sign * np.where(since_s < 6e-3, 2.0 * (since_s / 6e-3) ** 2 - 1.0, 1.0)


def even_s(first_s: float, last_s: float) -> FloatArray:
    """Polls every 10 ms."""
    return np.arange(first_s, last_s, 0.01)


def uneven_s(first_s: float, last_s: float) -> FloatArray:
    """Polls every 10 ms of a device that answers every 8: 8, 8, 8 and 16 ms apart."""
    return first_s + 0.008 * np.ceil(np.arange(0.0, last_s - first_s, 0.01) / 0.008 - 1e-9)


def laid(
    force: Force, period_s: float, seed: int, polls_s: Callable[[float, float], FloatArray] = even_s,
    sampled_s: float = 0.004,
) -> tuple[Match, Match, float]:
    """The match without and with the doubt, and the true lag (s)."""
    random = np.random.default_rng(seed)
    lag_s, began_s = random.uniform(-2e-3, 2e-3), random.uniform(0.0, period_s)
    time_s, at_s = np.arange(0.0, 12 * period_s, sampled_s), polls_s(random.uniform(0.0, 0.01), 12 * period_s)
    sensor = TimeSeries(time_s, force(time_s - lag_s + began_s, period_s) + 8.0 * random.standard_normal(len(time_s)))
    values = force(at_s + began_s, period_s) + 10.0 * random.standard_normal(len(at_s))
    reference, cycles = TimeSeries(at_s, values), CycleStretch(0.0, 12 * period_s, period_s)
    series = cycle_series(sensor.time_s, sensor.values, cycles)
    assert series is not None
    alone = match_cycles(reference, series, cycles, reach_s=0.03)
    assert alone is not None
    return alone, doubted(alone, reference, series, sensor, cycles), lag_s


@pytest.mark.few(1)
@pytest.mark.parametrize("period_s", [0.4, 0.5])
def test_jumps_between_two_phases_that_all_cycles_share_are_known_no_better_than_the_phases_tell(
    period_s: float
) -> None:
    tries = [laid(jumping_N, period_s, seed) for seed in SEEDS]
    before = np.array([(alone.lag_s - lag_s) / alone.lag_std_s for alone, _, lag_s in tries])
    stated = np.array([(sure.lag_s - lag_s) / sure.lag_std_s for _, sure, lag_s in tries])
    assert all(alone.lag_s == sure.lag_s for alone, sure, _ in tries), "only what is stated of the lag is another"
    assert np.sqrt(np.mean(before**2)) > 2.5, "12 cycles say no more than one, and it was taken for knowledge"
    assert np.sqrt(np.mean(stated**2)) < 1.8
    assert np.median([sure.lag_std_s for _, sure, _ in tries]) < 3e-3, "no more than the polls lie apart"


def test_a_flank_that_the_polls_step_over_is_known_no_better_than_the_samples_about_it() -> None:
    tries = [laid(sprung_N, 0.4, seed, uneven_s) for seed in range(40)]
    before = np.array([(alone.lag_s - lag_s) / alone.lag_std_s for alone, _, lag_s in tries])
    stated = np.array([(sure.lag_s - lag_s) / sure.lag_std_s for _, sure, lag_s in tries])
    assert np.max(np.abs(before)) > 6.0, "the match goes by two polls a cycle"
    assert np.sqrt(np.mean(stated**2)) < 1.5
    assert np.max(np.abs(stated)) < 4.0
    assert np.median([sure.lag_std_s for _, sure, _ in tries]) < 3e-3


@pytest.mark.few(1)
@pytest.mark.parametrize("polls_s", [uneven_s, even_s])
def test_a_flank_that_a_fast_sensor_resolves_and_the_polls_step_over_is_known_no_better(
    polls_s: Callable[[float, float], FloatArray],
) -> None:
    tries = [laid(stiff_N, 0.4, seed, polls_s, 0.001) for seed in range(20)]
    before = np.array([(alone.lag_s - lag_s) / alone.lag_std_s for alone, _, lag_s in tries])
    stated = np.array([(sure.lag_s - lag_s) / sure.lag_std_s for _, sure, lag_s in tries])
    assert np.max(np.abs(before)) > 6.0
    assert np.sqrt(np.mean(stated**2)) < 1.5
    assert np.max(np.abs(stated)) < 4.0


@pytest.mark.parametrize(("force", "period_s"), [(smooth_N, 0.4), (jumping_N, 0.4 * 1.0131)])
def test_nothing_is_added_where_there_are_no_jumps_or_every_cycle_has_phases_of_its_own(
    force: Force, period_s: float
) -> None:
    for seed in range(4):
        alone, sure, _ = laid(force, period_s, seed)
        assert sure == alone
