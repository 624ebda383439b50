"""From a solution to a fit: errors, intervals, what cannot be found, and everything a reader should be warned of."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rig.dampers.model import DamperModel
from rig.errors import IdentificationFailed, some
from rig.fits.entries import Estimate, Evaluation, ModelScore, Profile, SolverReport, Uncertainty
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import FittedModel
from rig.identification.models.separable import Solution
from rig.identification.models.solving import SEPARABLE, SQUARES, Candidate, Method, without_outliers
from rig.identification.options import FitOptions
from rig.identification.remarks import QUANTITIES, Remark, say
from rig.identification.uncertainty.alternative_shapes import degenerate, explain
from rig.identification.uncertainty.covariance import Information, information, quantile
from rig.identification.uncertainty.drift import drifting
from rig.identification.uncertainty.fit import Fit
from rig.identification.uncertainty.profile import profiles
from rig.identification.uncertainty.residual_correction import corrected_residuals
from rig.identification.uncertainty.residuals import WORTH_WARNING, correlated
from rig.identification.uncertainty.scoring import describes, energy_warnings, passivity, score, together

NONLINEAR = "nonlinear"  # all nonlinear parameters, where parameters are named
LARGE_SHARE = 0.1  # of the force's root mean square: a parameter of unknown sign that may make up more is not known
SHARP = 0.01  # of a test's RMS speed; a sine rounded to 1 um has 0.003, triangles through a servo 0.03 to 0.04
UNFINISHED = 1.0  # standard errors from the least-squares solution beyond which a search has not reached it
NOTES = (
    "low, high: separate 95 % interval for each parameter; simultaneous_low, simultaneous_high: joint 95 % "
    "intervals for all identifiable parameters (Bonferroni)",
    "covariance: sandwich estimator for weighted least squares with a separate residual variance for each test. The "
    "covariance includes the autocorrelation of the residual and the misfit that repeats in every cycle. It also "
    "includes the stated uncertainties of the sensor delay, force zero and calibrations, and the errors of the Fourier "
    "series for the motion",
)


def judged(
    best: Candidate,
    fitted: Sequence[Measurement],
    held_out: Sequence[Measurement],
    ranking: tuple[ModelScore, ...],
    options: FitOptions,
    warnings: Sequence[str] = (),
) -> Fit:
    """Judge the chosen candidate.

    Args:
        best: the model and its solution.
        fitted: the tests it was fitted to.
        held_out: tests to score it on.
        ranking: the models compared, best first.
        options: how it was fitted, and what is asked of it.
        warnings: what was found before.

    Raises:
        IdentificationFailed: a profile is requested of a parameter that was not fitted, or of a fit that is not the
            least-squares solution.

    Returns:
        Errors, intervals, what cannot be found and why, what the residual and the energy say, warnings.
    """
    model, values, method = best.model, best.solution.values, options.how
    weighting, (looked_at, predicted) = method.weighting(model), (fitted, held_out)
    if method.loss != SQUARES:
        looked_at, predicted = (without_outliers(model, values, tests) for tests in (fitted, held_out))
    free = best.findings.free(name for name in model.names if name in values)
    fit = FittedModel(model, values, tuple(free))
    left = corrected_residuals(fit, looked_at, weighting)
    robust = replace(weighting, extra=best.solution.extra)
    known = information(fit, fitted, robust, options.declared, left)
    fits = describes(model, values, looked_at, weighting, left, known.motion_N2)
    predicts = describes(model, values, predicted, weighting)
    drift = drifting(looked_at, left)
    del left  # as large as the tests themselves
    found_in_fit = {
        **_too_wide(known, values),
        **_at_limits(model, best.solution),
        **explain(model, known, values, looked_at, weighting),
    }
    reasons = {**found_in_fit, **best.findings.reasons}
    quantities = {name: QUANTITIES[reason.slug].format(**reason.numbers)
                  for name, reason in best.findings.reasons.items()
                  if reason.slug in QUANTITIES and name not in found_in_fit}  # fmt: skip
    error, passive = score(model, values, fitted), passivity(model, values, fitted)
    doubts: list[str] = [*warnings, *_of_tests((*fitted, *held_out))]
    doubts += [*_of_model(fits, weighting.weight), *_unresolved(fitted)]
    doubts += [say("misses-held-out")] if fits is not False and predicts is False else []
    doubts += [*degenerate(model, values, fitted), *_unfinished(known, method, best.solution)]
    doubts += [*_correlated(known, fitted), *drift, *energy_warnings(error, passive)]
    return Fit(
        model=model.name,
        hysteresis=model.hysteresis,
        form=model.equation,
        parameters=_estimates(model, values, known, reasons, quantities, best.solution),
        solver=SolverReport(
            method=method.name,
            weight=weighting.weight,
            loss=method.loss,
            evaluations=best.solution.evaluations,
            objective=best.solution.objective,
        ),
        evaluation=Evaluation(
            error=error.with_residuals(known.residuals),
            holdout=score(model, values, held_out) if held_out else None,
            adequate=together((fits, predicts)),
            selection=ranking,
            passivity=passive,
        ),
        uncertainty=Uncertainty(
            _correlation(known), known.condition, NOTES, _profiles(best, known, fitted, method, options.profile)
        ),
        warnings=tuple(doubts),
    )


def _profiles(
    best: Candidate, known: Information, fitted: Sequence[Measurement], method: Method, requested: bool | Sequence[str]
) -> dict[str, Profile]:
    if requested is False or not (requested is True or len(requested)):
        return {}
    if method.loss != SQUARES:
        raise IdentificationFailed(f"no profile likelihood: got loss {method.loss!r}, expected least squares")
    if unfinished := _unfinished(known, method, best.solution):
        raise IdentificationFailed(f"no profile likelihood: {unfinished[0]}")
    given = [NONLINEAR] if requested is True else list(requested)
    for_a_choice = {name: fixed for fixed, scaled in best.findings.fixed.items() for name in scaled}
    for name in given:
        if name in for_a_choice:
            raise IdentificationFailed(
                f"no profile of {name!r}: this parameter is identified only for the chosen {for_a_choice[name]}"
            )
    nonlinear = [name for name in known.names if not best.model.parameter(name).linear and name not in for_a_choice]
    names = list(
        dict.fromkeys(
            name for name_given in given for name in (nonlinear if name_given == NONLINEAR else [name_given])
        )
    )
    weighting, solution = method.weighting(best.model), best.solution
    fit = FittedModel(best.model, solution.values, known.names)
    return profiles(fit, known, fitted, weighting, names, solution.at_bound)


def _of_tests(tests: Sequence[Measurement]) -> list[str]:
    """What the preparation found, the same finding of several tests together."""
    named: dict[str, list[str]] = {}
    for test in tests:
        for warning in test.warnings:
            named.setdefault(warning, []).append(test.id)
    return [f"{some(ids)}: {warning}" for warning, ids in named.items()]


def _of_model(fits: bool | None, weight: str) -> list[Remark]:
    warnings = []
    if fits is False:
        warnings.append(say("model-error"))
    if fits is None:
        warnings.append(say("no-two-cycles"))
    if weight == "v":
        warnings.append(say("weight-v"))
    return warnings


def _unresolved(fitted: Sequence[Measurement]) -> list[Remark]:
    """A warning when all tests reverse more sharply than the displacement's samples resolve."""
    worst_m_s = 0.0
    for test in fitted:
        unseen_m_s = 0.0 if test.unseen_v_m_s is None else float(np.max(np.abs(test.unseen_v_m_s)))
        if unseen_m_s < SHARP * float(np.sqrt(np.mean(test.v_m_s**2))):
            return []
        worst_m_s = max(worst_m_s, unseen_m_s)
    return [say("sharp-reversals", worst_mm_s=1e3 * worst_m_s)] if worst_m_s > 0.0 else []


def _unfinished(known: Information, method: Method, solution: Solution) -> list[Remark]:
    """A warning when a search stopped before the least-squares solution, which is what the intervals are about."""
    if method.name == SEPARABLE or method.loss != SQUARES or solution.at_bound:
        return []
    determined = [k for k, name in enumerate(known.names) if name not in known.partners]
    away = [abs(float(known.step[k])) / known.standard_error(known.names[k]) for k in determined]
    far = [known.names[k] for k, errors in zip(determined, away, strict=True) if errors > UNFINISHED]
    if not far:
        return []
    return [say("unfinished", method=method.name, names=", ".join(far), errors=UNFINISHED)]


def _correlated(known: Information, fitted: Sequence[Measurement]) -> list[Remark]:
    """A warning when residuals are not white and the intervals had to be widened noticeably for it."""
    indices = correlated(known.residuals)
    widening = math.sqrt(sum(residual.widening for residual in known.residuals) / len(known.residuals))
    if not indices or widening < WORTH_WARNING:
        return []
    worst = max(indices, key=lambda k: known.residuals[k].repeating_N)
    repeats = known.residuals[worst].repeating_N
    where = f" (worst: {repeats:.3g} N, repeated in every cycle of {fitted[worst].id})" if repeats > 0.0 else ""
    count = len(indices)
    return [say("systematic-residuals", count=count, tests=len(fitted), worst=where, widening=widening)]


def _at_limits(model: DamperModel, solution: Solution) -> dict[str, Remark]:
    """Why parameters at a limit are not identified: those held at 0, and those whose search ended at its limit."""
    reasons = {name: say("would-be-negative", name=name) for name in solution.at_bound}
    reasons |= {
        name: say("at-limit", name=name, limit=limit)
        for name, limit in solution.at_limit.items()
        if name in model.names
    }
    return reasons


def _too_wide(known: Information, values: Mapping[str, float]) -> dict[str, Remark]:
    """Why parameters are not identified whose intervals exceed their values and stand for a large part of the force."""
    reasons, factor = {}, quantile(1, known.freedom)
    for name, share in zip(known.names, known.share.tolist(), strict=True):
        half = factor * known.standard_error(name)
        if math.isfinite(half) and half > abs(values[name]) and factor * share > LARGE_SHARE:
            percent = 100.0 * factor * share
            reasons[name] = say("too-wide", name=name, value=values[name], half=half, percent=percent)
    return reasons


def _estimates(
    model: DamperModel,
    values: dict[str, float],
    known: Information,
    reasons: dict[str, Remark],
    quantities: Mapping[str, str],
    solution: Solution,
) -> dict[str, Estimate]:
    """Every parameter of the model with its intervals, or the reason why it has none.

    Args:
        model: the fitted model.
        values: fitted values by parameter.
        known: what the tests tell.
        reasons: for each parameter that is not identifiable, why.
        quantities: what the tests determine in place of a parameter that is not identifiable.
        solution: of the fit.
    """
    identifiable = [name for name in known.names if name not in reasons]
    one, together = quantile(1, known.freedom), quantile(len(identifiable), known.freedom)
    estimates = {}
    for name in model.names:
        unit = model.parameter(name).unit
        quantity = quantities.get(name, "") if name in known.names else ""
        if (name in reasons and not quantity) or name not in known.names:
            entry = Estimate(values.get(name), unit, identifiable=False, reason=reasons.get(name, ""))
            if name in solution.at_bound and name in known.names and math.isfinite(known.standard_error(name)):
                error = known.standard_error(name)
                entry = replace(entry, high=one * error, simultaneous_high=together * error, standard_error=error)
            estimates[name] = entry
            continue
        value, error, parameter = values[name], known.standard_error(name), model.parameter(name)
        lowest, highest = min(parameter.low, value), max(parameter.high, value)
        estimates[name] = Estimate(
            value=value,
            unit=unit,
            low=max(lowest, value - one * error),
            high=min(highest, value + one * error),
            simultaneous_low=max(lowest, value - together * error),
            simultaneous_high=min(highest, value + together * error),
            standard_error=error,
            identifiable=name not in reasons,
            reason=reasons.get(name, ""),
            variance_inflation=1.0 / float(known.alone[known.names.index(name)]),
            quantity=quantity,
        )
    return estimates


def _correlation(known: Information) -> dict[str, dict[str, float]]:
    rows = known.correlation.tolist()
    return {name: dict(zip(known.names, row, strict=True)) for name, row in zip(known.names, rows, strict=True)}
