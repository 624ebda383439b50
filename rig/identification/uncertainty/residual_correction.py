"""What a fit leaves of each test, less what the stated skew explains; and what errors of the motion do to the force.

A skew s with standard uncertainty sigma changes the force by T s, T = dF/dt. The fit has turned part of that into its
parameters; the rest looks like misfit that repeats every cycle. With z = s/sigma standard normal in each test and the
parameters free, z follows from (H + S - D'A^-1 D) z = g: A = sum J'W^2 J, D = sigma J'W^2 T, H = sigma^2 T'W^2 T,
g = sigma T'W^2 r, S the noise's power. What is returned is r - z sigma T + J A^-1 D z.

The errors of a motion found as a Fourier series: each harmonic's cosine and sine, and the mean, have a standard error;
all are independent, because the harmonics are orthogonal over whole cycles. Where the force showed them
(`faint_orders`) they have errors in common besides. An error repeats with every cycle, so more samples of the same test
do not average it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.dampers.arrays import FloatArray
from rig.dampers.model import DamperModel
from rig.identification.models.inner_least_squares import white
from rig.identification.models.measurement import Measurement, MotionError, first_cycle
from rig.identification.models.model_slope import (
    FittedModel,
    force_change,
    modelled_force,
    motion_slopes,
)
from rig.identification.models.projection import Weighting

MANY = 2_000_000  # samples from which residuals are kept in single precision, far below any force's noise
WORTHWHILE = 1.0  # reduction of the weighted sum of squares, in variances of the noise, below which nothing changes


def corrected_residuals(
    fitted: FittedModel, measurements: Sequence[Measurement], weighting: Weighting
) -> list[FloatArray]:
    """Residual force (N) of each test, shape (n,), less what its stated skew explains.

    Args:
        fitted: the model, and what was fitted to these tests; nothing for tests held out.
        measurements: the tests.
        weighting: the weights of the fit.

    Raises:
        KeyError: a parameter is missing.
    """
    many = sum(test.u_m.size for test in measurements) > MANY
    left: list[NDArray[Any]] = []
    for test in measurements:
        residual = fitted.force(test)
        np.subtract(test.force_N, residual, out=residual)
        left.append(residual.astype(np.float32) if many else residual)
    skewed = [k for k, test in enumerate(measurements) if test.skew_std_s > 0.0]
    if not skewed:
        return left
    right, own, noise = (np.zeros(len(measurements)) for _ in range(3))
    for k in skewed:
        test = measurements[k]
        for rows, piece in pieces_of(fitted.model, test):
            squared = weighting.of(test, k, rows) ** 2
            slope = test.skew_std_s * fitted.time_slope(piece)
            right[k] += float(slope @ (squared * left[k][rows]))
            own[k] += float(slope @ (squared * slope))
        noise[k] = _noise_power(test, left[k]) * mean_weight(weighting, test, k)
    if float(np.sum(right[skewed] ** 2 / noise[skewed])) < WORTHWHILE:
        return left
    return _cleaned(fitted, measurements, weighting, left, (right, own, noise))


def pieces_of(model: DamperModel, test: Measurement) -> Iterator[tuple[slice, Measurement]]:
    """A test in pieces where a sample's force needs no other sample, else as a whole."""
    if model.states or test.u_m.size == 0:
        yield slice(0, test.u_m.size), test
        return
    for rows in test.pieces():
        yield rows, test.rows(rows)


def mean_weight(weighting: Weighting, test: Measurement, index: int) -> float:
    """Mean squared weight of the samples that count, weighted by itself: what scales noise in the weighted sum."""
    squared = weighting.of(test, index, slice(0, test.u_m.size, max(1, test.u_m.size // 65536))) ** 2
    total = float(np.sum(squared))
    return float(squared @ squared) / total if total > 0.0 else 1.0


def _noise_power(test: Measurement, residual_N: FloatArray) -> float:
    kept = residual_N[test.scored] if test.usable is not None else residual_N
    power = float(kept @ kept) / max(1, kept.size)
    if not math.isnan(test.sample_noise_N):
        power = min(power, test.sample_noise_N**2)
    return max(power, test.force_step_N**2 / 12.0, 1e-300)


def _cleaned(
    fitted: FittedModel,
    measurements: Sequence[Measurement],
    weighting: Weighting,
    left: list[FloatArray],
    sums: tuple[FloatArray, FloatArray, FloatArray],
) -> list[FloatArray]:
    """The residuals, less what a skew of each test explains, all parameters following."""
    right, own, noise = sums
    size, count = len(fitted.names), len(measurements)
    normal, cross = np.zeros((size, size)), np.zeros((size, count))
    for k, test in enumerate(measurements):
        for rows, piece in pieces_of(fitted.model, test) if size else ():
            squared = weighting.of(test, k, rows) ** 2
            slopes = fitted.slopes(piece)
            weighted = slopes * squared[:, None]
            normal += slopes.T @ weighted
            if test.skew_std_s > 0.0:
                cross[:, k] += test.skew_std_s * (weighted.T @ fitted.time_slope(piece))
    half = white(normal, size) if size else np.zeros((0, 0))
    absorbed = half.T @ cross
    table = np.diag(own + np.where(noise > 0.0, noise, 1.0)) - absorbed.T @ absorbed
    z = np.linalg.solve(table, right)
    moved = half @ (absorbed @ z)
    for k, test in enumerate(measurements):
        for rows, piece in pieces_of(fitted.model, test):
            if test.skew_std_s > 0.0:
                left[k][rows] -= z[k] * test.skew_std_s * fitted.time_slope(piece)
            if size:
                left[k][rows] += fitted.slopes(piece) @ moved
    return left


MOST_SAMPLES = 32768  # of a test: sums over many cycles are predicted by every so-many-th sample,
FEWEST_A_CYCLE = 400  # so long as each cycle keeps so many
MOST_ORDERS = 10  # of a model with internal states, whose force has to be integrated anew for each


def thinned(test: Measurement, model: DamperModel) -> slice:
    """The samples that are enough for such sums; all where the model's force needs all."""
    spacing = min(test.u_m.size // MOST_SAMPLES, test.samples_per_cycle // FEWEST_A_CYCLE)
    return slice(0, test.u_m.size, 1 if model.states else max(1, spacing))


def motion_effects(
    model: DamperModel, values: Mapping[str, float], test: Measurement, weighted: FloatArray, dt_s: float
) -> tuple[FloatArray, float]:
    """Effects of the motion's errors.

    Args:
        model: the fitted model.
        values: its parameters (SI).
        test: the samples.
        weighted: the parameters' slopes times the squared weights, shape (n, p).
        dt_s: interval of these samples (s).

    Returns:
        Sum over the samples of `weighted` times the force's change with one standard error of each coefficient,
        shape (p, k); and the mean square force (N^2) of all of them together.
    """
    error = test.motion_error
    if error is None:
        return np.zeros((weighted.shape[1], 0)), 0.0
    if model.states:
        one = first_cycle(test)  # the errors repeat with every cycle
        changes = list(_changes(model, values, one, error, dt_s))
        power = sum(float(np.mean(change**2)) for change in changes)
        cycles = test.u_m.size / one.u_m.size
        return np.column_stack([cycles * (weighted[: one.u_m.size].T @ change) for change in changes]), power
    by_u, by_v, by_a = motion_slopes(model, values, test)
    each_m = np.sqrt(error.errors_m**2 + 0.5 * np.sum(np.abs(error.common_m) ** 2, axis=0))
    power = _power(error, (by_u, by_v, by_a), each_m)
    if weighted.shape[1] == 0:
        return np.zeros((0, 0)), power
    phase = np.outer(dt_s * np.arange(test.u_m.size), error.rates_rad_s)
    cosine, sine, rate = np.cos(phase), np.sin(phase), error.rates_rad_s
    with_cosine = [(weighted * slope[:, None]).T @ cosine for slope in (by_u, by_v, by_a)]
    with_sine = [(weighted * slope[:, None]).T @ sine for slope in (by_u, by_v, by_a)]
    of_cosine = with_cosine[0] - rate * with_sine[1] - rate**2 * with_cosine[2]
    of_sine = with_sine[0] + rate * with_cosine[1] - rate**2 * with_sine[2]
    of_mean = (weighted.T @ by_u)[:, None] * error.mean_error_m
    shared = of_cosine @ error.common_m.real.T - of_sine @ error.common_m.imag.T
    return np.hstack((of_cosine * error.errors_m, of_sine * error.errors_m, shared, of_mean)), power


def _power(error: MotionError, slopes: tuple[FloatArray, FloatArray, FloatArray], errors_m: FloatArray) -> float:
    """Mean square (N^2) of what errors of each order (K,), m, do to a force with these slopes of its motion."""
    (by_u, by_v, by_a), rate = slopes, error.rates_rad_s
    second = [float(np.mean(product)) for product in (by_u**2, by_u * by_a, by_a**2, by_v**2)]
    spread = second[0] - 2.0 * rate**2 * second[1] + rate**4 * second[2] + rate**2 * second[3]
    return float(errors_m**2 @ spread) + error.mean_error_m**2 * second[0]


def _changes(
    model: DamperModel, values: Mapping[str, float], test: Measurement, error: MotionError, dt_s: float
) -> Iterator[FloatArray]:
    """The force's change (N), (n,), with one standard error of each coefficient; the orders that matter most."""
    time_s, none = dt_s * np.arange(test.u_m.size), np.zeros_like(test.u_m)
    force_N = modelled_force(model, values, test)
    weight = error.errors_m * error.rates_rad_s
    for order in np.argsort(-weight, kind="stable")[:MOST_ORDERS]:
        rate, size_m = float(error.rates_rad_s[order]), float(error.errors_m[order])
        cosine, sine = size_m * np.cos(rate * time_s), size_m * np.sin(rate * time_s)
        yield force_change(model, values, test, (cosine, -rate * sine, -(rate**2) * cosine), force_N)
        yield force_change(model, values, test, (sine, rate * cosine, -(rate**2) * sine), force_N)
    turning = np.exp(1j * np.outer(time_s, error.rates_rad_s))
    for row in error.common_m:
        u, v, a = (np.real(turning @ (row * (1j * error.rates_rad_s) ** derivative)) for derivative in range(3))
        yield force_change(model, values, test, (u, v, a), force_N)
    yield force_change(model, values, test, (none + error.mean_error_m, none, none), force_N)
