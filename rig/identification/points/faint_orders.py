"""Orders of a motion that are each too weak to stand out of the displacement sensor's noise, and matter together.

A servo gives way when the damper's force changes its sign, so the rod's motion has many small harmonics just where the
force changes fastest. They are in proportion to the force's own, which stand far out of its noise:

    X_k = H(k) F_k + D_k,    H(k) = sum over p of h_p (i k)^p,  p = 0, -1, -2,    h_p real

(what a position loop yields to a force: at once, by its flow, by its integral). The few h_p are found from all faint
orders together; their errors are common to all orders. What is left, D_k, is taken for a draw from a normal
distribution as wide as it and the next orders of the same parity show beyond their noise, and replaced by its
expectation (empirical Bayes; Efron and Morris 1973): the error of an expectation does not depend on it, so it does not
bias the parameters as measured noise would.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rig.dampers.arrays import BoolArray, ComplexArray, FloatArray
from rig.identification.models.measurement import MotionError
from rig.signals.derivatives import HarmonicFit, with_orders

FAINT_ORDERS = 48
"""The highest order that is looked for."""
NEIGHBOURS = 8
"""The next orders so near, of the same parity, are about as strong."""
CERTAIN = 2.0
"""Standard deviations of their noise's power by which they must be stronger together."""
FAINTEST = 0.1
"""Of an order's power, or of its noise, that it must have to be in the series."""
SIGNIFICANT = 5.0
"""Standard errors by which a harmonic of the force is known: its noise must not get into the motion."""
POWERS = (0, -1, -2)
WEAKEST = 1e-6
MINIMUM_FORCE_SHARE = 0.98
"""Share of the force's samples that must have been measured for its harmonics to be known."""


def expected(
    series: HarmonicFit, errors_m: FloatArray, certain: BoolArray, time_s: FloatArray, force_N: FloatArray
) -> tuple[HarmonicFit, MotionError]:
    """A motion's series with its faint orders as they are expected.

    Args:
        series: displacement, orders 1 to K and some more.
        errors_m: standard errors of the mean (first) and of each order's cosine and sine (K + 1,), m.
        certain: which orders stand as measured (K,).
        time_s: times of the force (n,), s.
        force_N: force (n,), N; NaN where it was not measured.

    Returns:
        The series of the orders that are known at all, and its errors.
    """
    orders, mean_error_m, errors_m = series.orders, float(errors_m[0]), errors_m[1:]
    rates = np.asarray(orders * series.omega_rad_s, np.float64)
    faint = ~certain
    if not np.any(faint):
        return series, MotionError(rates, errors_m, mean_error_m)
    measured = series.cosine_m - 1j * series.sine_m
    by_force, common = _by_force(series, errors_m, faint, time_s, force_N)
    left = np.where(faint, measured - by_force, 0.0)
    apart = orders - np.minimum(orders, orders[faint][-1] - NEIGHBOURS)[:, None]
    near = faint & (apart >= 0) & (apart <= NEIGHBOURS) & ((orders - orders[:, None]) % 2 == 0)
    count = np.maximum(1, np.sum(near, axis=1))
    prior = near @ (0.5 * np.abs(left) ** 2 - errors_m**2) / count
    prior[prior < CERTAIN * errors_m**2 / np.sqrt(count)] = 0.0
    share = np.where(faint, prior / np.maximum(prior + errors_m**2, 1e-300), 1.0)
    share = np.where(share < FAINTEST, 0.0, share)
    shown = np.where(faint, by_force + share * left, measured)
    kept = certain | (share > 0.0) | (np.abs(by_force) > FAINTEST * errors_m)
    known = replace(series, orders=orders[kept], cosine_m=np.real(shown[kept]), sine_m=-np.imag(shown[kept]))
    since_origin = np.exp(1j * rates * (time_s[0] - series.origin_s))
    together_m = ((1.0 - share) * common * since_origin)[:, kept]
    return known, MotionError(rates[kept], (np.sqrt(share) * errors_m)[kept], mean_error_m, together_m)


def _by_force(
    series: HarmonicFit, errors_m: FloatArray, faint: BoolArray, time_s: FloatArray, force_N: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """What the force's harmonics make of each order (K,), m, and one standard deviation of each h_p's error (q, K)."""
    orders, usable = series.orders, np.isfinite(force_N)
    none = np.zeros(orders.size, np.complex128), np.zeros((0, orders.size), np.complex128)
    if np.mean(usable) < MINIMUM_FORCE_SHARE or np.count_nonzero(faint) <= 2 * len(POWERS):
        return none
    try:
        force = with_orders(series, time_s[usable], force_N[usable], orders)
    except np.linalg.LinAlgError:
        return none
    noise_N = force.residual_m * math.sqrt(2.0 / force.samples)
    harmonics_N = force.cosine_m - 1j * force.sine_m
    harmonics_N[np.abs(harmonics_N) < SIGNIFICANT * noise_N] = 0.0
    columns = np.stack([harmonics_N * (1j * orders / FAINT_ORDERS) ** power for power in POWERS], axis=1)
    weighted = columns[faint] / errors_m[faint, None]
    design = np.vstack((weighted.real, weighted.imag))
    scaled = (series.cosine_m - 1j * series.sine_m)[faint] / errors_m[faint]
    values = np.concatenate((scaled.real, scaled.imag))
    scale = np.linalg.norm(design, axis=0)
    if not np.all(scale > 0.0):
        return none
    left, size, right = np.linalg.svd(design / scale, full_matrices=False)
    known = size > WEAKEST * size[0]
    directions = (columns / scale) @ (right[known].T / size[known])
    strengths = left[:, known].T @ values
    rest = values - left[:, known] @ strengths
    widening = math.sqrt(max(1.0, float(rest @ rest) / (values.size - np.count_nonzero(known))))
    return np.asarray(directions @ strengths), np.asarray(widening * np.where(faint, directions.T, 0.0))
