"""Samples of the force that no damper made: single ones far from their neighbours, and flat ends of the channel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.dampers.model import DamperModel
from rig.identification.diagnosis.stretches import MEDIAN_OF_NORMAL
from rig.identification.models.measurement import Measurement, samples_a_cycle
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.projection import Weighting

NEIGHBOURS = 3  # samples at either side
FAR = 8.0  # standard deviations from the neighbours' median
OF_RESIDUAL = 3.0  # median residuals, which a sample that is far off must have besides
BESIDE_A_JUMP_S = 5e-3  # around mid-stroke and reversals, where a model that is a little late leaves single samples too
BESIDE_OF_ELSEWHERE = 3.0  # times as often beside a jump as elsewhere: what lies there is then no outlier
RECURS_WITHIN = 2  # samples
RECURS_OF = 0.4  # of a sample, which one of the cycle before or after must have to be the same thing again
SINGLE = 1000  # one sample of so many may lie anywhere
FLAT_WITHIN = 3.0  # standard deviations of the noise within which samples are at one end of the channel


def outliers(
    model: DamperModel, values: Mapping[str, float], tests: Sequence[Measurement], weighting: Weighting
) -> list[BoolArray]:
    """Which samples lie alone, (n,) a test.

    Compared are residuals, so that a steep force is none, with the median of their neighbours, so that misfit is none.
    What recurs every cycle is none, and where most lie beside jumps of the force, those are none.
    """
    lonely, beside = [], [_next_to_a_jump(test) for test in tests]
    for index, test in enumerate(tests):
        counting = weighting.counting(test, index)
        residual = np.where(counting, test.force_N - modelled_force(model, values, test), np.nan)
        away = np.abs(residual - _median_of_neighbours(residual))
        known = np.isfinite(away)
        if not np.any(known):
            lonely.append(np.zeros(away.size, dtype=bool))
            continue
        spread = max(float(np.median(away[known])) / MEDIAN_OF_NORMAL, test.force_step_N / 2.0)
        usual = float(np.median(np.abs(residual[known])))
        with np.errstate(invalid="ignore"):
            far = known & (away > FAR * spread) & (np.abs(residual) > OF_RESIDUAL * usual)
        lonely.append(_without_recurring(far, residual, round(samples_a_cycle(test.u_m))))
    inside, outside = (
        sum(int(np.count_nonzero(alone & near)) for alone, near in zip(lonely, sides, strict=True))
        / max(1, sum(int(np.count_nonzero(near)) for near in sides))
        for sides in (beside, [~near for near in beside])
    )
    if inside > BESIDE_OF_ELSEWHERE * outside:
        return [alone & ~near for alone, near in zip(lonely, beside, strict=True)]
    return lonely


def _without_recurring(far: BoolArray, residual_N: FloatArray, cycle: int) -> BoolArray:
    """Those of the samples whose like does not come one cycle earlier or later: what recurs is the damper's."""
    kept, size = far.copy(), residual_N.size
    around = np.arange(-RECURS_WITHIN, RECURS_WITHIN + 1)
    for at in np.flatnonzero(far):
        places = np.concatenate((at - cycle + around, at + cycle + around))
        places = places[(places >= 0) & (places < size)]
        like = residual_N[places] * np.sign(residual_N[at])
        kept[at] = not np.any(like > RECURS_OF * abs(residual_N[at]))
    return kept


def _next_to_a_jump(test: Measurement) -> BoolArray:
    reach_s, speed = max(BESIDE_A_JUMP_S, 2.0 * test.dt_s), np.abs(test.v_m_s)
    return np.asarray((np.abs(test.u_m) < reach_s * speed) | (speed < reach_s * np.abs(test.a_m_s2)))


def _median_of_neighbours(values: FloatArray) -> FloatArray:
    """Median of the samples at either side, without the sample itself, shape (n,); NaN counts for none."""
    padded = np.pad(values, NEIGHBOURS, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1)
    beside = np.delete(windows, NEIGHBOURS, axis=1)
    known = np.isfinite(beside)
    # medians of what is there, the rest at the far end
    ordered = np.sort(np.where(known, beside, np.inf), axis=1)
    count = np.count_nonzero(known, axis=1)
    low, high = (np.clip(index, 0, beside.shape[1] - 1) for index in ((count - 1) // 2, count // 2))
    rows = np.arange(values.size)
    with np.errstate(invalid="ignore"):
        middle = 0.5 * (ordered[rows, low] + ordered[rows, high])
    return np.where(count > 0, middle, np.nan)


def ends_N(test: Measurement, noise_N: float) -> tuple[float, float]:
    """Where the force of one test would end if its channel were clipped: what most of its extreme samples show."""
    force = np.sort(test.force_N[test.scored])
    few = max(1, force.size // 100)
    low, high = float(np.median(force[:few])), float(np.median(force[-few:]))
    at_low, at_high = (force[np.abs(force - end) < FLAT_WITHIN * noise_N] for end in (low, high))
    return float(np.median(at_low)) if at_low.size else low, float(np.median(at_high)) if at_high.size else high


def reached_N(test: Measurement, noise_N: float) -> tuple[float, float]:
    """Lowest and highest force (N) that a test certainly holds, noise and single samples apart."""
    force = np.sort(test.force_N[test.scored])
    few = force.size // SINGLE
    return float(force[few]) + FLAT_WITHIN * noise_N, float(force[-1 - few]) - FLAT_WITHIN * noise_N


def beyond(test: Measurement, ends: tuple[float, float], noise_N: float) -> BoolArray:
    """Samples at or beyond such ends, which a first fit does without, shape (n,)."""
    margin = FLAT_WITHIN * noise_N
    return (test.force_N < ends[0] + margin) | (test.force_N > ends[1] - margin)
