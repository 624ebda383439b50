"""What the errors of a motion found as a Fourier series do to the force, and so to the parameters.

Each harmonic's cosine and sine, and the mean, have a standard error; all are independent, because the harmonics are
orthogonal over whole cycles. Where the force showed them (`faint_orders`) they have errors in common besides. An error
repeats with every cycle, so more samples of the same test do not average it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from rig.dampers.model import DamperModel
from rig.identification.measurement import Measurement, MotionError
from rig.identification.model_slope import force_change, motion_slopes

FloatArray = NDArray[np.float64]

MOST_SAMPLES = 32768  # of a test: sums over many cycles are foretold by every so-many-th sample,
FEWEST_A_CYCLE = 400  # so long as each cycle keeps so many
MOST_ORDERS = 10  # of a model with internal states, whose force has to be integrated anew for each


def thinned(each: Measurement, model: DamperModel) -> slice:
    """The samples that are enough for such sums; all where the model's force needs all."""
    spacing = min(each.u_m.size // MOST_SAMPLES, each.samples_per_cycle // FEWEST_A_CYCLE)
    return slice(0, each.u_m.size, 1 if model.states else max(1, spacing))


def motion_effects(
    model: DamperModel, values: Mapping[str, float], each: Measurement, weighted: FloatArray, dt_s: float
) -> tuple[FloatArray, float]:
    """Effects of the motion's errors.

    Args:
        model: the fitted model.
        values: its parameters (SI).
        each: the samples.
        weighted: the parameters' slopes times the squared weights, shape (n, p).
        dt_s: interval of these samples (s).

    Returns:
        Sum over the samples of `weighted` times the force's change with one standard error of each coefficient,
        shape (p, k); and the mean square force (N^2) of all of them together.
    """
    error = each.motion_error
    if error is None:
        return np.zeros((weighted.shape[1], 0)), 0.0
    if model.states:
        changes = list(_changes(model, values, each, error, dt_s))
        power = sum(float(np.mean(change**2)) for change in changes)
        return np.column_stack([weighted.T @ change for change in changes]), power
    by_u, by_v, by_a = motion_slopes(model, values, each)
    each_m = np.sqrt(error.errors_m**2 + 0.5 * np.sum(np.abs(error.common_m) ** 2, axis=0))
    power = _power(error, (by_u, by_v, by_a), each_m)
    if weighted.shape[1] == 0:
        return np.zeros((0, 0)), power
    phase = np.outer(dt_s * np.arange(each.u_m.size), error.rates_rad_s)
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
    model: DamperModel, values: Mapping[str, float], each: Measurement, error: MotionError, dt_s: float
) -> Iterator[FloatArray]:
    """The force's change (N), (n,), with one standard error of each coefficient; the orders that matter most."""
    time_s, none = dt_s * np.arange(each.u_m.size), np.zeros_like(each.u_m)
    weight = error.errors_m * error.rates_rad_s
    for order in np.argsort(-weight, kind="stable")[:MOST_ORDERS]:
        rate, size_m = float(error.rates_rad_s[order]), float(error.errors_m[order])
        cosine, sine = size_m * np.cos(rate * time_s), size_m * np.sin(rate * time_s)
        yield force_change(model, values, each, (cosine, -rate * sine, -(rate**2) * cosine))
        yield force_change(model, values, each, (sine, rate * cosine, -(rate**2) * sine))
    turning = np.exp(1j * np.outer(time_s, error.rates_rad_s))
    for row in error.common_m:
        u, v, a = (np.real(turning @ (row * (1j * error.rates_rad_s) ** derivative)) for derivative in range(3))
        yield force_change(model, values, each, (u, v, a))
    yield force_change(model, values, each, (none + error.mean_error_m, none, none))
