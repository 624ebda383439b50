"""Errors of a model on tests, and whether it describes them down to their noise."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rig.dampers.model import DamperModel
from rig.identification.energy import cycle_energy_J
from rig.identification.fit import ErrorSummary, TestError
from rig.identification.measurement import Measurement
from rig.identification.model_slope import modelled_force, unseen_force
from rig.identification.projection import Weighting
from rig.identification.residuals import judge, samples_a_cycle

FloatArray = NDArray[np.float64]

MISFIT_OF_NOISE = 0.6  # misfit beyond the noise, as a share of it, that still counts as describing the data
NEGLIGIBLE_OF_PEAK = 0.002  # misfit below this share of the peak force never matters
REPEATING_OF_NOISE = 0.15  # what repeats every cycle stands out of the noise long before it is as large
REPEATING_OF_PEAK = 0.003  # and below this share of the peak force never matters
FEWEST_CYCLES = 1.99  # two whole cycles, cut to samples
UNSEEN_WITHIN = 2.0  # motion that the samples do not resolve is foretold within this factor


def score(model: DamperModel, values: Mapping[str, float], measurements: Sequence[Measurement]) -> ErrorSummary:
    """Errors of the modelled force on tests.

    Raises:
        KeyError: a parameter is missing.
    """
    return score_forces(measurements, [modelled_force(model, values, each) for each in measurements])


def score_forces(measurements: Sequence[Measurement], modelled_N: Sequence[FloatArray]) -> ErrorSummary:
    """Errors of forces (N), one array (n,) a test, against the measured ones."""
    tests, errors, forces = [], [], []
    for each, modelled in zip(measurements, modelled_N, strict=True):
        scored = each.scored
        force = each.force_N[scored]
        error = force - modelled[scored]
        rmse = float(np.sqrt(np.mean(error**2)))
        peak = each.peak_force_N
        tests.append(
            TestError(
                id=each.id,
                file=each.file,
                rmse_N=rmse,
                mae_N=float(np.mean(np.abs(error))),
                nrmse_percent_of_peak=100.0 * rmse / peak if peak > 0.0 else math.nan,
                noise_N=None if math.isnan(each.noise_N) else each.noise_N,
                samples=int(error.size),
                energy_J=cycle_energy_J(each, each.force_N),
                modelled_energy_J=cycle_energy_J(each, modelled),
            )
        )
        errors.append(error)
        forces.append(force)
    error, force = np.concatenate(errors), np.concatenate(forces)
    variance = float(np.sum((force - np.mean(force)) ** 2))
    return ErrorSummary(
        rmse_N=float(np.sqrt(np.mean(error**2))),
        mae_N=float(np.mean(np.abs(error))),
        sd_N=float(np.std(error, ddof=1)),
        r_squared=1.0 - float(error @ error) / variance if variance > 0.0 else math.nan,
        nrmse_percent_of_peak=float(np.mean([each.nrmse_percent_of_peak for each in tests])),
        per_test=tuple(tests),
    )


def describes(
    model: DamperModel, values: Mapping[str, float], measurements: Sequence[Measurement], weighting: Weighting
) -> bool | None:
    """Whether what the model leaves is the tests' own scatter from cycle to cycle; None when no test has two cycles.

    Two things must be small, both over the samples that count in the fit and less what motion explains that the
    displacement's samples do not resolve: the misfit, which is what the error has beyond the scatter, in squares; and
    what repeats with every cycle (`residuals`). The second sees far less than the noise, but no drifts; the first does.
    A test whose scatter was not measured is held against what does not repeat of its own residual.

    Raises:
        KeyError: a parameter is missing.
    """
    samples, noise, beyond, repeating, peaks = 0, 0.0, 0.0, 0.0, []
    for index, each in enumerate(measurements):
        if math.isnan(each.noise_N) and each.u_m.size < FEWEST_CYCLES * samples_a_cycle(each.u_m):
            continue
        counting = weighting.of(each, index) > 0.0
        error = each.force_N - modelled_force(model, values, each)
        kept, found = error[counting], judge(error, counting, each.u_m, each.dt_s)
        unseen = UNSEEN_WITHIN**2 * float(np.sum(unseen_force(model, values, each)[counting] ** 2))
        scatter_N = found.noise_N if math.isnan(each.noise_N) else each.noise_N
        samples += kept.size
        noise += kept.size * scatter_N**2
        beyond += float(kept @ kept) - kept.size * scatter_N**2 - unseen
        repeating += max(0.0, kept.size * found.repeating_N**2 - unseen)
        peaks.append(each.peak_force_N)
    if samples == 0:
        return None
    noise_N, peak_N = math.sqrt(noise / samples), sum(peaks) / len(peaks)
    misfit_N, repeating_N = math.sqrt(max(0.0, beyond) / samples), math.sqrt(repeating / samples)
    return misfit_N <= max(MISFIT_OF_NOISE * noise_N, NEGLIGIBLE_OF_PEAK * peak_N) and repeating_N <= max(
        REPEATING_OF_NOISE * noise_N, REPEATING_OF_PEAK * peak_N
    )


def together(verdicts: Iterable[bool | None]) -> bool | None:
    """False when one of the verdicts is, None when nothing could be judged."""
    told = [each for each in verdicts if each is not None]
    return all(told) if told else None
