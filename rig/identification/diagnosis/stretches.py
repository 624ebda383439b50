"""The samples at which a misfit is looked at: thinned tests, or first and last cycles of models with states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.dampers.model import DamperModel
from rig.identification.models.measurement import Measurement, samples_a_cycle
from rig.identification.models.projection import Weighting
from rig.signals.loop_shape import noise_of

SAMPLES = 1000  # of a thinned test
FEWEST_A_CYCLE = 50
JUMP_S = 5e-3  # around a jump at mid-stroke, so that a delay does not have to move samples across it
CYCLES_AT_AN_END = 1  # of a test whose samples cannot be thinned
MEDIAN_OF_NORMAL = 0.6744897501960817


@dataclass(frozen=True, eq=False)
class Stretch:
    """A part of one test; arrays (n,).

    Attributes:
        test: its samples.
        index: number of the whole test.
        time: place in the whole test, -0.5 at its first sample to 0.5 at its last.
        order: place of the test in the campaign, -0.5 the first to 0.5 the last.
        weights: weight of each sample, 0 where it does not count.
        jerk_m_s3: rate of the acceleration (m/s^3).
        since_m: path since the motion last reversed (m).
        noise_N: standard deviation of the force's noise (N).
    """

    test: Measurement
    index: int
    time: FloatArray
    order: float
    weights: FloatArray
    jerk_m_s3: FloatArray
    since_m: FloatArray
    noise_N: float

    @property
    def floor(self) -> float:
        """Weighted sum of squares that noise alone leaves."""
        return float(self.weights @ self.weights) * self.noise_N**2


def stretches(
    model: DamperModel, tests: Sequence[Measurement], weighting: Weighting, spoiled: Sequence[BoolArray] | None = None
) -> list[Stretch]:
    """The samples of all tests that are looked at.

    Args:
        model: the fitted model.
        tests: the fitted tests.
        weighting: the weights of the fit.
        spoiled: samples that are left out, (n,) a test.
    """
    made = []
    last = max(1, len(tests) - 1)
    for index, test in enumerate(tests):
        jerk, since = np.gradient(test.a_m_s2, test.dt_s), path_since_reversal_m(test)
        weights = weighting.of(test, index)
        if model.jumps_at == "mid-stroke":
            weights = np.where(np.abs(test.u_m) < JUMP_S * np.abs(test.v_m_s), 0.0, weights)
        if spoiled is not None:
            weights = np.where(spoiled[index], 0.0, weights)
        time = np.linspace(-0.5, 0.5, test.u_m.size)
        noise_N = _noise_N(test)
        for rows in _rows(model, test):
            part, by = test.rows(rows), rows.step or 1
            cycle = min(test.samples_per_cycle // by, part.u_m.size)
            part = replace(part, dt_s=test.dt_s * by, samples_per_cycle=cycle)
            made.append(
                Stretch(part, index, time[rows], index / last - 0.5, weights[rows], jerk[rows], since[rows], noise_N)
            )
    return made


def _rows(model: DamperModel, test: Measurement) -> list[slice]:
    size, cycle = test.u_m.size, max(1, round(samples_a_cycle(test.u_m)))
    if model.states == 0:
        return [slice(0, size, max(1, min(size // SAMPLES, cycle // FEWEST_A_CYCLE)))]
    kept = CYCLES_AT_AN_END * cycle
    if size <= 2 * kept:
        return [slice(0, size)]
    start = size - kept
    return [slice(0, kept), slice(start, size)]


def _noise_N(test: Measurement) -> float:
    """Standard deviation of the force's noise (N): from cycle to cycle, else from sample to sample."""
    if not math.isnan(test.sample_noise_N):
        return max(test.sample_noise_N, test.force_step_N / math.sqrt(12.0))
    return noise_of(np.where(test.scored, test.force_N, np.nan))


def path_since_reversal_m(test: Measurement) -> FloatArray:
    """Path since the motion last reversed (m), shape (n,); before the first reversal, as after the last one."""
    path = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(test.u_m)))))
    reversals = np.flatnonzero(np.diff(np.sign(test.v_m_s)) != 0.0) + 1
    if not reversals.size:
        return path
    latest = np.maximum.accumulate(np.where(np.isin(np.arange(path.size), reversals), path, -1.0))
    half_m = float(np.ptp(test.u_m))
    return np.where(latest < 0.0, np.maximum(0.0, half_m - (path[reversals[0]] - path)), path - latest)
