"""Errors of a model on tests, and whether it describes them down to their noise.

And energy: what each test dissipated and what the model says, and whether the fitted model could drive the rod. A
damper's force apart from gas force and springs takes energy out: F v >= 0 at every speed and current. A model may be
fitted well and still not do so where no test asked it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.model import DamperModel
from rig.errors import some
from rig.fits.entries import ErrorSummary, Passivity, TestError
from rig.identification.models.measurement import Measurement, recorded_errors, samples_a_cycle
from rig.identification.models.model_slope import FittedModel, modelled_force, unseen_force
from rig.identification.models.projection import Weighting
from rig.identification.remarks import Remark, say
from rig.identification.uncertainty.residual_correction import corrected_residuals, motion_effects, thinned
from rig.identification.uncertainty.residuals import assess_residual, sum_of_squares

MISFIT_OF_NOISE = 0.6  # misfit beyond the noise, as a share of it, that still counts as describing the data
NEGLIGIBLE_OF_PEAK = 0.002  # misfit below this share of the peak force never matters
REPEATING_OF_NOISE = 0.15  # what repeats every cycle stands out of the noise long before it is as large
REPEATING_OF_PEAK = 0.003  # and below this share of the peak force never matters
FEWEST_CYCLES = 1.99  # two whole cycles, cut to samples
PREDICTED_WITHIN = 2.0  # factor within which errors of the motion are predicted
QUANTISED_WITHIN = 2.0  # where the force rests, rounding may have this many times its mean square of step^2/12


@dataclass(frozen=True)
class Misfit:
    """Error of the modelled force on one test.

    Attributes:
        samples: number of recorded samples with a measured force.
        mean_square_N2: mean square error of these samples (N^2).
        peak_force_N: largest deviation of the recorded force from its mean (N).
    """

    samples: int
    mean_square_N2: float
    peak_force_N: float

    @classmethod
    def of(cls, test: Measurement, error_N: FloatArray) -> Misfit:
        """The misfit of errors (N) of the samples with a measured force, shape (k,)."""
        mean_square_N2 = float(error_N @ error_N) / error_N.size + test.scatter_N**2
        return cls(round(error_N.size * test.recorded_each), mean_square_N2, test.peak_force_N)

    @property
    def nrmse_percent_of_peak(self) -> float:
        """Root mean square error relative to the peak force (%); NaN without a force."""
        return 100.0 * math.sqrt(self.mean_square_N2) / self.peak_force_N if self.peak_force_N > 0.0 else math.nan


def misfits(model: DamperModel, values: Mapping[str, float], measurements: Sequence[Measurement]) -> list[Misfit]:
    """Error of the modelled force on each test, without what `score` adds.

    Raises:
        KeyError: a parameter is missing.
    """
    errors = []
    for test in measurements:
        error_N = test.force_N - modelled_force(model, values, test)
        errors.append(Misfit.of(test, error_N if test.usable is None else error_N[test.usable]))
    return errors


def rmse_N(misfits: Sequence[Misfit]) -> float:
    """Root mean square error over all samples of the tests (N)."""
    squares_N2 = sum(one.samples * one.mean_square_N2 for one in misfits)
    return math.sqrt(squares_N2 / sum(one.samples for one in misfits))


def score(model: DamperModel, values: Mapping[str, float], measurements: Sequence[Measurement]) -> ErrorSummary:
    """Errors of the modelled force on tests.

    Raises:
        KeyError: a parameter is missing.
    """
    return score_forces(measurements, (modelled_force(model, values, test) for test in measurements))


def score_forces(measurements: Sequence[Measurement], modelled_N: Iterable[FloatArray]) -> ErrorSummary:
    """Errors of forces (N), one array (n,) a test, against the measured ones; one test's arrays at a time."""
    tests, counts, errors, squares, sizes = [], [], [], [], []
    forces, spreads = [], []
    for test, modelled in zip(measurements, modelled_N, strict=True):
        energies = cycle_energy_J(test, test.force_N), cycle_energy_J(test, modelled)
        force, model_N = (
            (test.force_N, modelled) if test.usable is None else (test.force_N[test.usable], modelled[test.usable])
        )
        error = np.subtract(force, model_N, out=model_N)  # what was modelled is not needed any more
        misfit = Misfit.of(test, error)
        mean_N, count = float(np.mean(force)), misfit.samples
        counts.append(count)
        errors.append(count * float(np.mean(error)))
        squares.append(count * misfit.mean_square_N2)
        sizes.append(count * float(np.mean(np.abs(recorded_errors(test, error)))))
        forces.append(mean_N)
        spreads.append(count * (float(np.var(force)) + test.scatter_N**2))
        tests.append(
            TestError(
                id=test.id,
                file=test.file,
                rmse_N=math.sqrt(misfit.mean_square_N2),
                mae_N=sizes[-1] / count,
                nrmse_percent_of_peak=misfit.nrmse_percent_of_peak,
                noise_N=None if math.isnan(test.noise_N) else test.noise_N,
                samples=count,
                energy_J=energies[0],
                modelled_energy_J=energies[1],
            )
        )
    total, weight = sum(counts), np.array(counts, dtype=float)
    mean_N = float(weight @ forces) / total
    variance = sum(spreads) + float(weight @ (np.array(forces) - mean_N) ** 2)
    return ErrorSummary(
        rmse_N=math.sqrt(sum(squares) / total),
        mae_N=sum(sizes) / total,
        sd_N=math.sqrt(max(0.0, sum(squares) - sum(errors) ** 2 / total) / max(1, total - 1)),
        r_squared=1.0 - sum(squares) / variance if variance > 0.0 else math.nan,
        nrmse_percent_of_peak=float(np.mean([test.nrmse_percent_of_peak for test in tests])),
        per_test=tuple(tests),
    )


def with_extrapolations(error: ErrorSummary, beyond: Iterable[tuple[str, ...]]) -> ErrorSummary:
    """Errors of unseen tests, each with the quantities in which it lies beyond the fitted ones."""
    tests = tuple(replace(test, beyond=names) for test, names in zip(error.per_test, beyond, strict=True))
    return replace(error, per_test=tests)


def describes(
    model: DamperModel,
    values: Mapping[str, float],
    measurements: Sequence[Measurement],
    weighting: Weighting,
    left: Sequence[FloatArray] | None = None,
    motion_N2: Sequence[float] | None = None,
) -> bool | None:
    """Whether what the model leaves is the tests' own scatter from cycle to cycle; None when no test has two cycles.

    Two things must be small, both over the samples that count in the fit and less what is known to be no misfit: the
    misfit, which is what the error has beyond the scatter, in squares; and what repeats with every cycle (`residuals`).
    The second sees far less than the noise, but no drifts; the first does. Known to be no misfit are what the stated
    skew explains (`residual_correction`), errors of the motion, motion that the samples do not
    resolve, and the force's quantisation. A test whose scatter was not measured is held against what does not repeat of
    its own residual.

    Args:
        model: the damper model.
        values: its parameters (SI).
        measurements: the tests.
        weighting: the weights of the fit.
        left: what the fit leaves of each test (`corrected_residuals`); by default of tests it was not fitted to.
        motion_N2: mean square force (N^2) that errors of the motion make in each test, where that is known already.

    Raises:
        KeyError: a parameter is missing.
    """
    samples, noise, beyond, repeating, peaks = 0.0, 0.0, 0.0, 0.0, []
    left = corrected_residuals(FittedModel(model, values, ()), measurements, weighting) if left is None else left
    for index, (test, error) in enumerate(zip(measurements, left, strict=True)):
        if math.isnan(test.sample_noise_N) and test.u_m.size < FEWEST_CYCLES * samples_a_cycle(test.u_m):
            continue
        counting = weighting.counting(test, index)
        residual = assess_residual(error, counting, test.u_m, test.dt_s, cycles_each=test.cycles_each)
        count = int(np.count_nonzero(counting))
        if count == 0:
            continue
        known = count * _no_misfit(model, values, test, None if motion_N2 is None else motion_N2[index])
        own_N = residual.noise_N if math.isnan(test.sample_noise_N) else test.sample_noise_N
        recorded_N = math.hypot(own_N, test.scatter_N) if math.isnan(test.noise_N) else test.noise_N
        step_N2, ratio = test.force_step_N**2 / 12.0, test.recorded_each
        samples += count * ratio
        noise += count * ratio * max(recorded_N**2, step_N2)
        beyond += ratio * (sum_of_squares(error, counting) - count * max(own_N**2, step_N2 / ratio) - known)
        repeating += ratio * max(0.0, count * residual.repeating_N**2 - known)
        peaks.append(test.peak_force_N)
    if samples == 0.0:
        return None
    noise_N, peak_N = math.sqrt(noise / samples), sum(peaks) / len(peaks)
    misfit_N, repeating_N = math.sqrt(max(0.0, beyond) / samples), math.sqrt(repeating / samples)
    return misfit_N <= max(MISFIT_OF_NOISE * noise_N, NEGLIGIBLE_OF_PEAK * peak_N) and repeating_N <= max(
        REPEATING_OF_NOISE * noise_N, REPEATING_OF_PEAK * peak_N
    )


def _no_misfit(
    model: DamperModel, values: Mapping[str, float], test: Measurement, motion_N2: float | None
) -> float:
    """Mean square (N^2) that repeats and is no misfit: errors of the motion as predicted, and quantisation."""
    power = QUANTISED_WITHIN * test.force_step_N**2 / 12.0
    rows = thinned(test, model)
    some = test.rows(rows)
    if test.unseen_v_m_s is not None:
        power += PREDICTED_WITHIN**2 * float(np.mean(unseen_force(model, values, some) ** 2))
    if motion_N2 is None and test.motion_error is not None:
        nothing = np.zeros((some.u_m.size, 0))
        motion_N2 = motion_effects(model, values, some, nothing, test.dt_s * rows.step)[1]
    return power + PREDICTED_WITHIN**2 * (motion_N2 or 0.0)


def together(verdicts: Iterable[bool | None]) -> bool | None:
    """False when one of the verdicts is, None when nothing could be judged."""
    verdicts_known = [verdict for verdict in verdicts if verdict is not None]
    return all(verdicts_known) if verdicts_known else None


SPEEDS, CURRENTS = 24, 5
NEGLIGIBLE = 0.005  # share of the greatest power below which power put in does not matter
DIFFERENT = 0.05  # share of the measured energy by which the model's may differ
LONGEST_UNSEEN = 0.05  # share of a cycle over which the power may be bridged: 0.2 % of a sine's energy at the worst


def cycle_energies_J(test: Measurement, force_N: FloatArray) -> FloatArray:
    """Energy (J) that a force (N), shape (n,), takes out in each cycle, shape (k,): the area of the loop.

    `E = integral of F v dt` over one measured period. Lost samples are bridged; NaN for a cycle in which the force is
    unknown for more than `LONGEST_UNSEEN` of the period at a stretch, as where the load cell was saturated: what was
    dissipated there is not known.
    """
    period = samples_a_cycle(test.u_m)
    count = test.u_m.size
    cycles = max(1, round(count / period))
    edges = period * np.arange(cycles + 1)
    mean_N = float(np.mean(force_N if test.usable is None else force_N[test.usable]))
    work = (force_N - mean_N) * test.v_m_s
    if test.usable is not None:
        known = np.flatnonzero(test.usable)
        work = np.interp(np.arange(count), known, work[known])
    # Exactly whole periods: where they begin the power is greatest, and a part of a sample more or less is seen.
    inside = min(count, math.ceil(edges[-1]))
    at = np.append(np.arange(inside, dtype=np.float64), edges[-1])
    work = np.append(work[:inside], work[0])
    total = np.concatenate(([0.0], np.cumsum(0.5 * (work[1:] + work[:-1]) * np.diff(at))))
    energies_J: FloatArray = np.diff(np.interp(edges, at, total)) * test.dt_s
    if test.usable is None:
        return energies_J
    seen = np.concatenate(([-1], known, [count]))
    for gap in np.flatnonzero(np.diff(seen) - 1 > LONGEST_UNSEEN * period):
        energies_J[(edges[:-1] < seen[gap + 1]) & (edges[1:] > seen[gap] + 1)] = np.nan
    return energies_J


def cycle_energy_J(test: Measurement, force_N: FloatArray) -> float:
    """Energy (J) that a force (N), shape (n,), takes out in one cycle, the mean of those known; NaN where none is."""
    energies_J = cycle_energies_J(test, force_N)
    known = energies_J[np.isfinite(energies_J)]
    return float(np.mean(known)) if known.size else math.nan


def passivity(model: DamperModel, values: Mapping[str, float], measurements: Sequence[Measurement]) -> Passivity:
    """Passivity of the fitted model at mid-stroke, over the tested speeds and currents.

    Raises:
        KeyError: a parameter is missing.
    """
    complete = {"eta": 1.0, **values} if "eta" in model.names else dict(values)
    top = max(float(np.max(np.abs(test.v_m_s))) for test in measurements)
    speeds = np.concatenate([sign * top * np.arange(1, SPEEDS + 1) / SPEEDS for sign in (-1.0, 1.0)])
    currents = _grid_A(measurements)
    grid_v, grid_A = np.meshgrid(speeds, currents)
    power_W = (_sliding(model, complete, grid_v, grid_A) - _sliding(model, complete, 0.0 * grid_v, grid_A)) * grid_v
    passive = power_W >= -NEGLIGIBLE * float(np.max(np.abs(power_W)))
    if np.all(passive):
        return Passivity(1.0, "")
    row, column = np.unravel_index(int(np.argmin(power_W)), power_W.shape)
    worst = f"{-power_W[row, column]:.3g} W at {grid_v[row, column]:.3g} m/s and {grid_A[row, column]:.3g} A"
    return Passivity(float(np.mean(passive)), worst)


def _grid_A(measurements: Sequence[Measurement]) -> FloatArray:
    """Currents (A) from the lowest to the highest of the tests, evenly spaced."""
    low = min(float(np.min(test.current_A)) for test in measurements)
    high = max(float(np.max(test.current_A)) for test in measurements)
    return np.linspace(low, high, CURRENTS if high > low else 1)


def _sliding(model: DamperModel, values: Mapping[str, float], v_m_s: FloatArray, current_A: FloatArray) -> FloatArray:
    """Force (N) on the sliding branch at mid-stroke; algebraic models all at once, as the mean of both sides of it."""
    if model.states:
        return model.force_at(values, v_m_s, current_A)
    zero = np.zeros(v_m_s.size)
    sides = [model.force(values, zero + side, v_m_s.ravel(), zero, current_A.ravel(), 1e-3) for side in (-1e-12, 1e-12)]
    return np.asarray(0.5 * (sides[0] + sides[1])).reshape(v_m_s.shape)


def energy_warnings(error: ErrorSummary, passive: Passivity) -> list[Remark]:
    """Warnings: a model that drives the rod, and tests whose energy it does not give back."""
    warnings = []
    if passive.share < 1.0:
        warnings.append(say("not-passive", percent=100.0 * (1.0 - passive.share), worst=passive.worst))
    off = [
        f"{test.id} (model {test.modelled_energy_J:.3g} J, measured {test.energy_J:.3g} J)"
        for test in error.per_test
        if abs(test.modelled_energy_J - test.energy_J) > DIFFERENT * abs(test.energy_J)
    ]
    unknown = [test.id for test in error.per_test if math.isnan(test.energy_J)]
    if unknown:
        warnings.append(say("energy-unknown", tests=some(unknown)))
    if off:
        warnings.append(say("energy-differs", percent=100.0 * DIFFERENT, tests=some(off)))
    return warnings
