"""What the data say about the parameters: covariance, intervals, correlation, and what they cannot say.

Covariance of the weighted least-squares estimate (sandwich form):
C = A^-1 (n/(n-p) sum_t q_t s_t^2 B_t + sum_k d_k d_k') A^-1, with A = sum J'W^2 J and B_t = J'W^4 J of test t, s_t its
residual's root mean square, q_t >= 1 what correlation in time and misfit that repeats every cycle add to it
(`residuals`), n the samples of all tests, each test's divided by its q_t, p the parameters, and d_k the effect
J'W^2 dF/dk of each error k that is stated: the skew left in each test, the scale of force and displacement, the zero of
the force, each coefficient of the motion's Fourier series (`motion_errors`), the motion that the displacement's samples
do not resolve at sharp reversals, the mean of each test's noisy readings of the current. Skew and zero are taken as
shared by all tests, which is the larger of the two possible effects; errors of the motion and of the current, whose
effects on the tests may cancel, count test by test. With
Huber's loss s_t is the root mean square of psi(r), the residual as the loss sees it, and A sums the samples whose psi'
is 1 (Huber 1964).

A combination of parameters without information is known only in so far as what each of them contributes cannot be many
times the whole measured force: it has that standard deviation, `BEYOND_FORCE`. A parameter that this leaves less sure
than the noise does cannot be told from the others of the combination; one that has next to no part in it is widened.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.fits.entries import Residual
from rig.identification.models.measurement import MeanCycles, Measurement
from rig.identification.models.model_slope import (
    FittedModel,
    current_slope,
    scale_slope,
    unseen_force,
)
from rig.identification.models.projection import Weighting
from rig.identification.options import DeclaredErrors
from rig.identification.uncertainty.residual_correction import corrected_residuals, motion_effects, pieces_of, thinned
from rig.identification.uncertainty.residuals import assess_residual

CONFIDENCE = 0.95
MINIMUM_FREEDOM = 4.0
INSEPARABLE = 1e-8  # smallest share of a parameter's own information that must be its alone
BEYOND_FORCE = 3.0  # standard deviation of a direction without information, in multiples of the measured force
MINIMUM_SHARE = 1e-6  # of a direction without information; a smaller one is rounding


@dataclass(frozen=True)
class Information:
    """The data's information about some parameters, in the order of `names`.

    Attributes:
        names: the parameters.
        covariance: their covariance (units of the parameters), shape (p, p); rows of inseparable ones are infinite.
        correlation: their correlation, shape (p, p).
        alone: share of each parameter's information that no other parameter can imitate (1 / variance inflation), (p,).
        condition: condition number of the scaled normal matrix.
        partners: for each inseparable parameter, those it cannot be told from.
        curvature: inverse of the variance that unit weighted noise would give each parameter, others free, (p,).
        step: how far each parameter lies from the least-squares solution, in its unit, (p,).
        residuals: what each test's residual consists of.
        freedom: independent residuals, less the parameters.
        share: what one standard error of each parameter, by itself, does to the force, as a share of its root mean
            square, (p,).
        motion_N2: mean square force (N^2) that errors of the motion make in each test.
    """

    names: tuple[str, ...]
    covariance: FloatArray
    correlation: FloatArray
    alone: FloatArray
    condition: float
    partners: Mapping[str, tuple[str, ...]]
    curvature: FloatArray
    step: FloatArray
    residuals: tuple[Residual, ...]
    freedom: float
    share: FloatArray
    motion_N2: tuple[float, ...]

    def standard_error(self, name: str) -> float:
        """Standard error in the parameter's unit; infinite where it cannot be told from others."""
        return float(np.sqrt(self.covariance[self.names.index(name), self.names.index(name)]))


def information(
    fitted: FittedModel,
    measurements: Sequence[Measurement],
    weighting: Weighting,
    declared: DeclaredErrors | None = None,
    left: Sequence[FloatArray] | None = None,
) -> Information:
    """Information about the fitted parameters.

    Args:
        fitted: the model and what was fitted.
        measurements: the tests of the fit.
        weighting: the weights of the fit.
        declared: errors the data do not show; none by default.
        left: what the fit leaves of each test (`corrected_residuals`), where that is known already.
    """
    declared, size = declared or DeclaredErrors(), len(fitted.names)
    left = corrected_residuals(fitted, measurements, weighting) if left is None else left
    total, residuals, motion_N2 = _Sums(size), [], []
    independent = 0.0
    for index, test in enumerate(measurements):
        sums = _sums(fitted, test, weighting, index, declared)
        power = sums.power / max(1, sums.count)
        counting = weighting.counting(test, index)
        error = left[index] if weighting.extra is None else left[index] * weighting.extra[index] ** 2
        residual = assess_residual(
            error, counting, test.u_m, test.dt_s, known_power=sums.known_power, cycles_each=test.cycles_each
        )
        residuals.append(residual if test.means is None else _of_recorded(residual, test.means, power))
        motion_N2.append(sums.known_power)
        independent += sums.count / residual.widening
        total.force_power += sums.force_power
        total.normal += sums.normal
        total.noise += residual.widening * power * sums.noise
        total.gradient += sums.gradient
        total.shared += sums.shared
        total.alone += sums.alone
    freedom = max(MINIMUM_FREEDOM, independent - size)
    meat = total.noise * max(1.0, independent / freedom) + total.shared.T @ total.shared + total.alone
    return _invert(fitted.names, total, meat, (tuple(residuals), tuple(motion_N2)), freedom)


def _of_recorded(residual: Residual, means: MeanCycles, power_N2: float) -> Residual:
    """Convert the residual of mean cycles, with this mean square (N^2), to that of the recorded samples."""
    whole_N2 = power_N2 + means.scatter_N**2
    widening = residual.widening * means.samples * power_N2 / whole_N2 if whole_N2 > 0.0 else 1.0
    return replace(residual, noise_N=math.hypot(residual.noise_N, means.scatter_N), widening=max(1.0, widening))


class _Sums:
    """Sums over the samples of a test, or of all.

    `normal` J'W^2 J, `noise` J'W^4 J, `gradient` J'W^2 r; `shared` the effects of skew, scale of the force, scale of
    the displacement and zero of the force, (4, p); `alone` the outer products of the effects that each test has for
    itself; `power` of the residual (N^2) over `count` samples, `known_power` the part of its mean square that the
    motion's errors explain, `force_power` the weighted force's sum of squares.
    """

    def __init__(self, size: int) -> None:
        self.normal, self.noise, self.alone = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
        self.gradient, self.shared = np.zeros(size), np.zeros((4, size))
        self.power = self.force_power = self.known_power = 0.0
        self.count = 0


def _sums(
    fitted: FittedModel, test: Measurement, weighting: Weighting, index: int, declared: DeclaredErrors
) -> _Sums:
    model, values, size = fitted.model, fitted.values, len(fitted.names)
    sums, unseen, of_current = _Sums(size), np.zeros(size), np.zeros(size)
    plain = replace(weighting, extra=None)
    for rows, piece in pieces_of(model, test):
        squared = plain.of(test, index, rows) ** 2
        robust = np.ones_like(squared) if weighting.extra is None else weighting.extra[index][rows] ** 2
        force, slopes = fitted.force_and_slopes(piece)
        full, counting = slopes * squared[:, None], squared > 0.0
        weighted = full if weighting.extra is None else full * (robust >= 1.0)[:, None]
        error = robust * (piece.force_N - force)
        sums.normal += slopes.T @ weighted
        sums.noise += full.T @ full
        sums.gradient += full.T @ error
        sums.power += float(error[counting] @ error[counting])
        sums.count += int(np.count_nonzero(counting))
        sums.force_power += float(squared @ np.where(counting, piece.force_N, 0.0) ** 2)
        if test.skew_std_s > 0.0:
            sums.shared[0] += test.skew_std_s * (weighted.T @ fitted.time_slope(piece))
        if declared.force_gain > 0.0:
            sums.shared[1] += declared.force_gain * (weighted.T @ force)
        if declared.displacement_gain > 0.0:
            sums.shared[2] += declared.displacement_gain * (weighted.T @ scale_slope(model, values, piece))
        sums.shared[3] += test.force_zero_std_N * np.sum(weighted, axis=0)
        if test.unseen_v_m_s is not None:
            unseen += weighted.T @ unseen_force(model, values, piece)
        if test.current_std_A > 0.0:
            of_current += test.current_std_A * (weighted.T @ current_slope(model, values, piece))
    sums.alone = np.outer(unseen, unseen) + np.outer(of_current, of_current)
    if test.motion_error is not None:
        effects, sums.known_power = _of_motion(fitted, test, weighting, index)
        sums.alone += effects @ effects.T
    return sums


def _of_motion(
    fitted: FittedModel, test: Measurement, weighting: Weighting, index: int
) -> tuple[FloatArray, float]:
    """Effects of the motion's errors on J'W^2 r, shape (p, k), and the mean square force (N^2) they make."""
    rows = thinned(test, fitted.model)
    some = test.rows(rows)
    squared = replace(weighting, extra=None).of(test, index, rows) ** 2
    weighted = fitted.slopes(some) * squared[:, None]
    effects, power = motion_effects(fitted.model, fitted.values, some, weighted, test.dt_s * rows.step)
    return effects * rows.step, power


def _invert(
    names: tuple[str, ...],
    total: _Sums,
    meat: FloatArray,
    of_tests: tuple[tuple[Residual, ...], tuple[float, ...]],
    freedom: float,
) -> Information:
    size, normal, force_power = len(names), total.normal, total.force_power
    scale = np.sqrt(np.diag(normal))
    seen = scale > 0.0
    safe = np.where(seen, scale, 1.0)
    scaled = normal / np.outer(safe, safe)
    scaled[~seen, ~seen] = 0.0
    eigenvalues, vectors = np.linalg.eigh(scaled)
    empty = eigenvalues < INSEPARABLE * max(float(eigenvalues[-1]), 1e-300)
    inverse = np.where(empty, 0.0, 1.0 / np.where(empty, 1.0, eigenvalues))
    half = (vectors * inverse) @ vectors.T / np.outer(safe, safe)
    covariance = np.asarray(half @ meat @ half)
    null = vectors[:, empty] * (BEYOND_FORCE * math.sqrt(force_power))
    partners = _partners(names, vectors[:, empty], seen, np.abs(null) > (safe * np.sqrt(np.diag(covariance)))[:, None])
    covariance += null @ null.T / np.outer(safe, safe)
    determined = np.array([name not in partners for name in names])
    covariance[~determined, :] = covariance[:, ~determined] = 0.0
    deviation = np.sqrt(np.diag(covariance))
    spread = np.where(deviation > 0.0, deviation, 1.0)
    correlation = covariance / np.outer(spread, spread)
    share = deviation * scale / math.sqrt(force_power) if force_power > 0.0 else np.zeros(size)
    covariance[~determined, ~determined] = np.inf
    alone = np.zeros(size)
    full = np.diag((vectors * inverse) @ vectors.T)
    alone[determined] = 1.0 / np.maximum(full[determined], 1.0)
    condition = float(eigenvalues[-1] / eigenvalues[0]) if eigenvalues[0] > 0.0 else math.inf
    step = ((vectors * inverse) @ (vectors.T @ (total.gradient / safe))) / safe
    curvature = np.where(full > 0.0, safe**2 / np.where(full > 0.0, full, 1.0), 0.0)
    return Information(
        names,
        covariance,
        correlation,
        alone,
        condition,
        partners,
        curvature,
        np.asarray(step),
        of_tests[0],
        freedom,
        share,
        of_tests[1],
    )


def _partners(
    names: tuple[str, ...], null: FloatArray, seen: BoolArray, unsure: BoolArray
) -> dict[str, tuple[str, ...]]:
    """Members of the directions without information; a parameter without any effect has no partner.

    Args:
        names: the parameters.
        null: those directions, of length 1, shape (p, k).
        seen: which parameters have any effect, shape (p,).
        unsure: which parameters each direction leaves less sure than the noise does, shape (p, k).
    """
    partners: dict[str, tuple[str, ...]] = {name: () for k, name in enumerate(names) if not seen[k]}
    member = unsure & seen[:, None] & (np.abs(null) > MINIMUM_SHARE)
    for column in member.T:
        members = [name for k, name in enumerate(names) if column[k]]
        for name in members:
            others = {other for other in members if other != name} | set(partners.get(name, ()))
            partners[name] = tuple(sorted(others, key=names.index))
    return partners


def quantile(intervals: int = 1, freedom: float = math.inf) -> float:
    """Factor on the standard error for two-sided 95 % intervals that hold together for `intervals` parameters.

    Bonferroni's share of the error probability; Student's t by its expansion in 1/freedom (Fisher and Cornish 1960).
    """
    z = NormalDist().inv_cdf(1.0 - (1.0 - CONFIDENCE) / (2.0 * max(1, intervals)))
    if math.isinf(freedom):
        return z
    first = (z**3 + z) / 4.0
    second = (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0
    return z + first / freedom + second / freedom**2
