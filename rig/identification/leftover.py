"""What a fit leaves of each test, less what the stated skew between force and displacement explains.

A skew s with standard uncertainty sigma changes the force by T s, T = dF/dt. The fit has turned part of that into its
parameters; the rest looks like misfit that repeats every cycle. With z = s/sigma standard normal in each test and the
parameters free, z follows from (H + S - D'A^-1 D) z = g: A = sum J'W^2 J, D = sigma J'W^2 T, H = sigma^2 T'W^2 T,
g = sigma T'W^2 r, S the noise's power. What is returned is r - z sigma T + J A^-1 D z.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.dampers.model import DamperModel
from rig.identification.measurement import Measurement
from rig.identification.model_slope import modelled_force, parameter_slopes, time_slope
from rig.identification.projection import Weighting
from rig.identification.reduction import white

FloatArray = NDArray[np.float64]

MANY = 2_000_000  # samples from which residuals are kept in single precision, far below any force's noise
WORTHWHILE = 1.0  # reduction of the weighted sum of squares, in variances of the noise, below which nothing changes


def leftovers(
    model: DamperModel,
    values: Mapping[str, float],
    names: Sequence[str],
    measurements: Sequence[Measurement],
    weighting: Weighting,
) -> list[FloatArray]:
    """Residual force (N) of each test, shape (n,), less what its stated skew explains.

    Args:
        model: the fitted model.
        values: all its parameters (SI).
        names: those that were fitted to these tests; none for tests held out.
        measurements: the tests.
        weighting: the weights of the fit.

    Raises:
        KeyError: a parameter is missing.
    """
    many = sum(each.u_m.size for each in measurements) > MANY
    left: list[NDArray[Any]] = []
    for each in measurements:
        residual = modelled_force(model, values, each)
        np.subtract(each.force_N, residual, out=residual)
        left.append(residual.astype(np.float32) if many else residual)
    skewed = [k for k, each in enumerate(measurements) if each.skew_std_s > 0.0]
    if not skewed:
        return left
    right, own, noise = (np.zeros(len(measurements)) for _ in range(3))
    for k in skewed:
        each = measurements[k]
        for rows, piece in pieces_of(model, each):
            squared = weighting.of(each, k, rows) ** 2
            slope = each.skew_std_s * time_slope(model, values, piece)
            right[k] += float(slope @ (squared * left[k][rows]))
            own[k] += float(slope @ (squared * slope))
        noise[k] = _noise_power(each, left[k]) * mean_weight(weighting, each, k)
    if float(np.sum(right[skewed] ** 2 / noise[skewed])) < WORTHWHILE:
        return left
    return _cleaned(model, values, names, measurements, weighting, left, (right, own, noise))


def pieces_of(model: DamperModel, each: Measurement) -> Iterator[tuple[slice, Measurement]]:
    """A test in pieces where a sample's force needs no other sample, else as a whole."""
    if model.states or each.u_m.size == 0:
        yield slice(0, each.u_m.size), each
        return
    for rows in each.pieces():
        yield rows, each.rows(rows)


def mean_weight(weighting: Weighting, each: Measurement, index: int) -> float:
    """Mean squared weight of the samples that count, weighted by itself: what scales noise in the weighted sum."""
    squared = weighting.of(each, index, slice(0, each.u_m.size, max(1, each.u_m.size // 65536))) ** 2
    total = float(np.sum(squared))
    return float(squared @ squared) / total if total > 0.0 else 1.0


def _noise_power(each: Measurement, residual_N: FloatArray) -> float:
    kept = residual_N[each.scored] if each.usable is not None else residual_N
    power = float(kept @ kept) / max(1, kept.size)
    if not math.isnan(each.noise_N):
        power = min(power, each.noise_N**2)
    return max(power, each.force_step_N**2 / 12.0, 1e-300)


def _cleaned(
    model: DamperModel,
    values: Mapping[str, float],
    names: Sequence[str],
    measurements: Sequence[Measurement],
    weighting: Weighting,
    left: list[FloatArray],
    sums: tuple[FloatArray, FloatArray, FloatArray],
) -> list[FloatArray]:
    """The residuals, less what a skew of each test explains, all parameters following."""
    right, own, noise = sums
    size, count = len(names), len(measurements)
    normal, cross = np.zeros((size, size)), np.zeros((size, count))
    for k, each in enumerate(measurements):
        for rows, piece in pieces_of(model, each) if size else ():
            squared = weighting.of(each, k, rows) ** 2
            slopes = parameter_slopes(model, values, names, piece)
            weighted = slopes * squared[:, None]
            normal += slopes.T @ weighted
            if each.skew_std_s > 0.0:
                cross[:, k] += each.skew_std_s * (weighted.T @ time_slope(model, values, piece))
    half = white(normal, size) if size else np.zeros((0, 0))
    absorbed = half.T @ cross
    table = np.diag(own + np.where(noise > 0.0, noise, 1.0)) - absorbed.T @ absorbed
    z = np.linalg.solve(table, right)
    moved = half @ (absorbed @ z)
    for k, each in enumerate(measurements):
        for rows, piece in pieces_of(model, each):
            if each.skew_std_s > 0.0:
                left[k][rows] -= z[k] * each.skew_std_s * time_slope(model, values, piece)
            if size:
                left[k][rows] += parameter_slopes(model, values, names, piece) @ moved
    return left
