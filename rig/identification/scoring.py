"""Errors of a model on tests, and whether it describes them down to their noise."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rig.dampers.model import DamperModel
from rig.identification.energy import cycle_energy_J
from rig.identification.fit import ErrorSummary, TestError
from rig.identification.leftover import leftovers
from rig.identification.measurement import Measurement
from rig.identification.model_slope import modelled_force, unseen_force
from rig.identification.motion_errors import motion_effects, thinned
from rig.identification.projection import Weighting
from rig.identification.residuals import judge, samples_a_cycle, sum_of_squares

FloatArray = NDArray[np.float64]

MISFIT_OF_NOISE = 0.6  # misfit beyond the noise, as a share of it, that still counts as describing the data
NEGLIGIBLE_OF_PEAK = 0.002  # misfit below this share of the peak force never matters
REPEATING_OF_NOISE = 0.15  # what repeats every cycle stands out of the noise long before it is as large
REPEATING_OF_PEAK = 0.003  # and below this share of the peak force never matters
FEWEST_CYCLES = 1.99  # two whole cycles, cut to samples
FORETOLD_WITHIN = 2.0  # factor within which errors of the motion are foretold
QUANTISED_WITHIN = 2.0  # where the force rests, rounding may have this many times its mean square of step^2/12


def score(model: DamperModel, values: Mapping[str, float], measurements: Sequence[Measurement]) -> ErrorSummary:
    """Errors of the modelled force on tests.

    Raises:
        KeyError: a parameter is missing.
    """
    return score_forces(measurements, (modelled_force(model, values, each) for each in measurements))


def score_forces(measurements: Sequence[Measurement], modelled_N: Iterable[FloatArray]) -> ErrorSummary:
    """Errors of forces (N), one array (n,) a test, against the measured ones; one test's arrays at a time."""
    tests, counts, errors, squares, sizes = [], [], [], [], []
    forces, spreads = [], []
    for each, modelled in zip(measurements, modelled_N, strict=True):
        energies = cycle_energy_J(each, each.force_N), cycle_energy_J(each, modelled)
        force, model_N = (
            (each.force_N, modelled) if each.usable is None else (each.force_N[each.usable], modelled[each.usable])
        )
        error = np.subtract(force, model_N, out=model_N)  # what was modelled is not needed any more
        mean_N, peak = float(np.mean(force)), each.peak_force_N
        counts.append(error.size)
        errors.append(float(np.sum(error)))
        squares.append(float(error @ error))
        sizes.append(float(np.sum(np.abs(error, out=error))))
        forces.append(mean_N)
        spreads.append(float(np.var(force)) * force.size)
        rmse = math.sqrt(squares[-1] / error.size)
        tests.append(
            TestError(
                id=each.id,
                file=each.file,
                rmse_N=rmse,
                mae_N=sizes[-1] / error.size,
                nrmse_percent_of_peak=100.0 * rmse / peak if peak > 0.0 else math.nan,
                noise_N=None if math.isnan(each.noise_N) else each.noise_N,
                samples=int(error.size),
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
        nrmse_percent_of_peak=float(np.mean([each.nrmse_percent_of_peak for each in tests])),
        per_test=tuple(tests),
    )


def describes(
    model: DamperModel,
    values: Mapping[str, float],
    measurements: Sequence[Measurement],
    weighting: Weighting,
    left: Sequence[FloatArray] | None = None,
) -> bool | None:
    """Whether what the model leaves is the tests' own scatter from cycle to cycle; None when no test has two cycles.

    Two things must be small, both over the samples that count in the fit and less what is known to be no misfit: the
    misfit, which is what the error has beyond the scatter, in squares; and what repeats with every cycle (`residuals`).
    The second sees far less than the noise, but no drifts; the first does. Known to be no misfit are what the stated
    skew explains (`leftover`), what errors of the motion do to the force, motion that the displacement's samples do not
    resolve, and the force's quantisation. A test whose scatter was not measured is held against what does not repeat of
    its own residual.

    Args:
        model: the damper model.
        values: its parameters (SI).
        measurements: the tests.
        weighting: the weights of the fit.
        left: what the fit leaves of each test (`leftovers`); by default of tests it was not fitted to.

    Raises:
        KeyError: a parameter is missing.
    """
    samples, noise, beyond, repeating, peaks = 0, 0.0, 0.0, 0.0, []
    left = leftovers(model, values, (), measurements, weighting) if left is None else left
    for index, (each, error) in enumerate(zip(measurements, left, strict=True)):
        if math.isnan(each.noise_N) and each.u_m.size < FEWEST_CYCLES * samples_a_cycle(each.u_m):
            continue
        counting = weighting.counting(each, index)
        found = judge(error, counting, each.u_m, each.dt_s)
        count = int(np.count_nonzero(counting))
        if count == 0:
            continue
        known = count * _no_misfit(model, values, each)
        scatter_N = found.noise_N if math.isnan(each.noise_N) else each.noise_N
        scatter = max(scatter_N**2, each.force_step_N**2 / 12.0)
        samples += count
        noise += count * scatter
        beyond += sum_of_squares(error, counting) - count * scatter - known
        repeating += max(0.0, count * found.repeating_N**2 - known)
        peaks.append(each.peak_force_N)
    if samples == 0:
        return None
    noise_N, peak_N = math.sqrt(noise / samples), sum(peaks) / len(peaks)
    misfit_N, repeating_N = math.sqrt(max(0.0, beyond) / samples), math.sqrt(repeating / samples)
    return misfit_N <= max(MISFIT_OF_NOISE * noise_N, NEGLIGIBLE_OF_PEAK * peak_N) and repeating_N <= max(
        REPEATING_OF_NOISE * noise_N, REPEATING_OF_PEAK * peak_N
    )


def _no_misfit(model: DamperModel, values: Mapping[str, float], each: Measurement) -> float:
    """Mean square (N^2) that repeats and is no misfit: errors of the motion as foretold, and quantisation."""
    power = QUANTISED_WITHIN * each.force_step_N**2 / 12.0
    rows = thinned(each, model)
    some = each.rows(rows)
    if each.unseen_v_m_s is not None:
        power += FORETOLD_WITHIN**2 * float(np.mean(unseen_force(model, values, some) ** 2))
    if each.motion_error is not None:
        nothing = np.zeros((some.u_m.size, 0))
        power += FORETOLD_WITHIN**2 * motion_effects(model, values, some, nothing, each.dt_s * rows.step)[1]
    return power


def together(verdicts: Iterable[bool | None]) -> bool | None:
    """False when one of the verdicts is, None when nothing could be judged."""
    told = [each for each in verdicts if each is not None]
    return all(told) if told else None
