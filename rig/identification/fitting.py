"""From a run to a fit: prepare, examine, solve, judge; one model, or all of them compared (`selection`)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import rig.dampers
from rig.dampers import Hysteresis
from rig.dampers.covered import Ends
from rig.dampers.lawed_model import PLUS, with_law
from rig.dampers.model import DamperModel
from rig.dampers.temperature_law import NONE as NO_LAW
from rig.errors import IdentificationFailed, evaluating
from rig.identification.application.tested_range import tested_range
from rig.identification.models.coil import find_lag, needs_lag, with_lag
from rig.identification.models.coverage import beyond, recorded_degC
from rig.identification.models.law_search import laws_over, named_over
from rig.identification.models.measurement import Measurement, first_cycle, set_of, spaced
from rig.identification.models.solving import Candidate, Method, solve
from rig.identification.models.undetermined import examine
from rig.identification.next_test import Allowance, bench_of, next_tests
from rig.identification.per_current import AFFINE, identify_per_current
from rig.identification.points.consistency import contradictions, runs_apart, without_reversed_signs
from rig.identification.points.given import given
from rig.identification.selection import candidates_of, compare, doubts_of, groups_of, weighted_by_misfit
from rig.identification.temperature import at_one_temperature, refuse_beside, softened
from rig.identification.uncertainty.assessment import Wanted, judged
from rig.identification.uncertainty.covariance import DeclaredErrors, quantile
from rig.identification.uncertainty.fit import Fit
from rig.identification.uncertainty.fit_entries import Cause, ErrorSummary, Estimate, SeriesSpring
from rig.identification.uncertainty.scoring import score, told_apart
from rig.identification.words import UNTRIED, say, some
from rig.matrix.methods import FEW_MODELS

if TYPE_CHECKING:
    from rig.identification.points.current_steps import CurrentLag
    from rig.identification.points.given import Tests
    from rig.identification.uncertainty.unseen import Unseen
    from rig.recording.recorded_point import RecordedPoint

ALL, FEW = "all", "few"
DRAWN_SAMPLES = 250  # samples of a cycle that figures show
DIAGNOSED_SAMPLES = 125  # of a cycle, of models with internal states: a cause costs an integration of all tests a step


def identify(
    tests: Tests,
    *,
    model: str = "asymmetric",
    method: str | Method = "separable",
    holdout: str | Tests | None = None,
    hysteresis: Hysteresis = "kwok",
    declared: DeclaredErrors | None = None,
    profile: bool | Sequence[str] = False,
    current: str = AFFINE,
    current_law: str = AFFINE,
    series_spring: bool = False,
    allowance: Allowance | None = None,
    campaign: Sequence[RecordedPoint] = (),
    diagnose: bool | None = None,
    bootstrap: int = 0,
    unseen: str | None = None,
    temperature_law: str = NO_LAW,
    on_progress: Callable[[str], None] | None = None,
) -> Fit:
    """Fit a damper model to recorded tests.

    Args:
        tests: a run, its points, or measurements already prepared.
        model: a name in `rig.dampers.MODELS`, with a current law or without (`asymmetric+saturating`), "few" to
            compare `FEW_MODELS`, or "all" to compare every one.
        method: "separable", one of the papers' algorithms, or a `Method` with its settings.
        holdout: tests kept out of the fit and scored apart: a filter such as "waveform=triangle" on `tests`, or others;
            of motion without cycles also "last 30 %" of the time of each test.
        hysteresis: form of the tanh models' argument.
        declared: scale and position errors to include in the intervals.
        profile: parameters whose profile likelihood is wanted; True: all nonlinear ones.
        current: how parameters depend on the current: "affine", in one fit; or one fit a current with
            "per-current-affine", "per-current-polynomial" (quadratic) or "per-current-lagrange" relations.
        current_law: what the fluid feels of the current: "affine" (the current itself), "saturating", "polynomial",
            "per-current" (a table over the tested currents), or "all": those laws of the model, or of the best model,
            compared as models are.
        series_spring: look for a spring in series with the damper, and fit the damper behind it; held-out tests are
            corrected by their own measured force.
        allowance: what the next test may ask of the machine; by default what a run's own bench and matrix allow, or
            what was tested.
        campaign: further points of the same campaigns, neither fitted nor held out: they know of the sensors' delays.
        diagnose: look for what explains the misfit; None: where the model is not adequate. Units and signs are looked
            at in any case.
        bootstrap: draw the tests so often again, for intervals that know of misfit (`rig.identification.bootstrap`); 0
            for not at all.
        unseen: "pairs": also fit the model to all but one amplitude and frequency, each in turn, and score it there.
        temperature_law: how warm oil weakens the damper, where a temperature was recorded: "none", or rates of the
            "viscous" parameters, the "yield" parameters, one "common" rate, or "both" (`rig.dampers.temperature_law`).
        on_progress: called with a line of text before each model is fitted and each comparison.

    Returns:
        The fit; with "few" or "all", that of the recommended model.

    Raises:
        IdentificationFailed: nothing can be identified; the message names what the data lack.
    """
    started = time.perf_counter()
    settings = method if isinstance(method, Method) else Method(method)
    if allowance is None and not isinstance(tests, Sequence):
        allowance = bench_of(tests.path)
    known = given(tests, holdout, campaign)
    resisting, reversed_tests = without_reversed_signs(known.fitted)
    known = replace(known, fitted=resisting, warnings=(*known.warnings, *reversed_tests))
    fitted, held_out = known.fitted, known.held_out
    _refuse_unseen(unseen, fitted, alone=current == AFFINE and not series_spring)
    laws = laws_over(fitted, current_law)
    refuse_beside(temperature_law, settings, bare=not (current != AFFINE or series_spring or profile or bootstrap))
    warnings = (*known.warnings, *known.unusable_steps)
    wanted = Wanted(settings, declared, profile, warnings, started, laws, diagnose)
    if current != AFFINE:
        if model in {ALL, FEW} or profile or series_spring or bootstrap or PLUS in model or current_law != AFFINE:
            raise IdentificationFailed(
                f"current dependence {current!r} goes with one model, without profiles, without a series spring, "
                "without a bootstrap and without a current law"
            )
        wanted = replace(wanted, warnings=(*warnings, *contradictions(fitted)))
        chosen = _model(model, hysteresis)
        related = identify_per_current(chosen, fitted, held_out, current, wanted, on_progress)
        return _usable(related, fitted, held_out, known.temperature_degC)
    names = _names(model, fitted)
    models = [_model(name, hysteresis) for name in names]
    if len(wanted.laws) == 1 and wanted.laws[0] != AFFINE:
        models = [with_law(one, wanted.laws[0]) for one in models]
    spring = None
    if series_spring:
        if len(models) > 1:
            raise IdentificationFailed("a series spring goes with one model: name it, such as `asymmetric`")
        spring, fitted, held_out = _behind_spring(models[0], fitted, held_out, settings)
    eta_1_s = _found_lag(models, fitted, settings, on_progress) if needs_lag(fitted) else None
    if eta_1_s is not None:
        fitted, held_out = ([with_lag(test, eta_1_s) for test in tests] for tests in (fitted, held_out))
    softening, alike, alike_out = at_one_temperature(models, fitted, held_out, settings, temperature_law)
    wanted = replace(wanted, warnings=(*warnings, *contradictions(alike)))
    best, fit = _best_fit(models, alike, alike_out, wanted, eta_1_s, on_progress)
    fit = replace(fit, coil_eta_1_s=eta_1_s)
    if known.lag is not None and "eta" in fit.parameters:
        fit = _with_lag(fit, known.lag)
    if spring is not None:
        from rig.identification.series_spring import SMOOTHING

        spring = spring.widened(
            max((residual.widening for residual in fit.residuals), default=1.0), quantile() * SMOOTHING
        )
    fit = _usable(softened(fit, softening, fitted, held_out), fitted, held_out, known.temperature_degC)
    untried = "" if len(models) == len(rig.dampers.MODELS) else UNTRIED
    fit = _diagnosed(best, fit, alike, untried, misfit=fit.adequate is False if diagnose is None else diagnose)
    if bootstrap:
        from rig.identification.bootstrap import bootstrap as drawn_again

        fit = replace(fit, drawn=drawn_again(replace(fit, series=spring), fitted, count=bootstrap).kept())
    fit = replace(fit, unseen=None if unseen is None else _foretold(fit, known.fitted, settings, on_progress))
    return replace(fit, series=spring, next_tests=next_tests(best.model, fit, alike, allowance))


def _refuse_unseen(unseen: str | None, tests: Sequence[Measurement], *, alone: bool) -> None:
    """Refuse a split that there is not, beside what it does not go with, or of tests that have none.

    Raises:
        IdentificationFailed: one of these.
    """
    if unseen is None:
        return
    if unseen != "pairs":
        raise IdentificationFailed(f"unseen = {unseen!r}; known: 'pairs'")
    if not alone:
        raise IdentificationFailed("unseen 'pairs' goes without a series spring and without a fit for each current")
    from rig.identification.pairs import refuse_one_pair

    refuse_one_pair(tests)


def _foretold(
    fit: Fit, tests: Sequence[Measurement], method: Method, on_progress: Callable[[str], None] | None
) -> Unseen:
    """What the fit's model foretells of each amplitude and frequency that is left out."""
    from rig.identification.pairs import foretold

    form: Hysteresis = "printed" if fit.hysteresis == "printed" else "kwok"

    def error_of(rest: list[Measurement], group: list[Measurement]) -> ErrorSummary:
        if on_progress is not None:
            on_progress(f"foretelling {some([test.id for test in group])}")
        law = NO_LAW if fit.temperature is None else fit.temperature.law
        apart = identify(
            rest, model=fit.model, method=method, holdout=group, hysteresis=form, diagnose=False, temperature_law=law
        )
        return apart.error if apart.holdout is None else apart.holdout

    return foretold(tests, error_of)


def _diagnosed(best: Candidate, fit: Fit, fitted: Sequence[Measurement], untried: str, *, misfit: bool) -> Fit:
    """The fit with what probably explains its misfit; it is good without, if the data break the search for that."""
    try:
        with evaluating("the misfit"):
            return replace(fit, diagnosis=_diagnosis(best, fit, fitted, untried, misfit=misfit))
    except IdentificationFailed as error:
        return replace(fit, warnings=(*fit.warnings, say("no-diagnosis", reason=str(error))))


def _diagnosis(
    best: Candidate, fit: Fit, fitted: Sequence[Measurement], untried: str, *, misfit: bool
) -> tuple[Cause, ...]:
    """What probably explains the misfit of the fit."""
    from rig.identification.diagnosis.ranking import diagnose
    from rig.identification.diagnosis.trials import Fitted

    values = best.solution.values
    names = tuple(best.findings.free(name for name in best.model.names if name in values and name != "eta"))
    weighting = Method(weight=fit.weight).weighting(best.model)
    tests = [spaced(test, DIAGNOSED_SAMPLES) for test in fitted] if best.model.states else list(fitted)
    return diagnose(Fitted(best.model, values, names, tests, weighting, untried), misfit=misfit)


def _usable(
    fit: Fit, fitted: Sequence[Measurement], held_out: Sequence[Measurement], temperature_degC: Ends | None
) -> Fit:
    """The fit with what its tests covered, a cycle of each of them, and which held-out ones lie beyond."""
    unseen = next((one.within_nrmse_percent_of_peak for one in fit.selection if one.model == fit.model), None)
    seen = fit.error.nrmse_percent_of_peak
    widened = 1.0 if unseen is None or not (math.isfinite(unseen) and seen > 0.0) else unseen / seen
    tested = tested_range(fit.law, fitted, held_out, temperature_degC or recorded_degC(fitted), widened)
    cycles = tuple(spaced(first_cycle(test), DRAWN_SAMPLES) for test in fitted)
    holdout = None if fit.holdout is None else told_apart(fit.holdout, [beyond(tested, test) for test in held_out])
    return replace(fit, tested=tested, tests=cycles, holdout=holdout, test_set=set_of(fitted).to_json())


def _best_fit(
    models: Sequence[DamperModel],
    fitted: list[Measurement],
    held_out: list[Measurement],
    wanted: Wanted,
    eta_1_s: float | None,
    on_progress: Callable[[str], None] | None,
) -> tuple[Candidate, Fit]:
    """The recommended model, fitted and assessed; `eta_1_s` where it was found with the commanded current.

    Raises:
        IdentificationFailed: no model can be fitted.
    """
    candidates, refused, given_up = candidates_of(models, fitted, wanted.method, on_progress)
    candidates, method, ratio = weighted_by_misfit(candidates, fitted, wanted.method)
    reweighted = [say("relative-weights", ratio=ratio)] if method.weight != wanted.method.weight else []
    wanted = replace(wanted, method=method, warnings=(*wanted.warnings, *reweighted))
    if on_progress is not None and len(candidates) > 1:
        on_progress("comparing the models on what they have not seen")
    ranking, best = compare(candidates, fitted, held_out, wanted.method)
    doubts = doubts_of(ranking, held_out)
    if len(wanted.laws) > 1:
        bent = [with_law(best.model, law) for law in wanted.laws if law != AFFINE]
        more, failed, _ = candidates_of(bent, fitted, wanted.method, on_progress)
        by_law, recommended = compare([best, *more], fitted, held_out, wanted.method)
        doubts = doubts_of(by_law, held_out) or doubts
        ranking = (*by_law, *(one for one in ranking if one.model != best.model.name))
        best, refused = recommended, [*refused, *failed]
    if eta_1_s is not None and "eta" in best.model.names:
        values = {**best.solution.values, "eta": eta_1_s}
        best = replace(best, solution=replace(best.solution, values=values))
    wanted = replace(wanted, warnings=(*wanted.warnings, *refused, *doubts))
    fit = judged(best, fitted, held_out, (*ranking, *given_up), wanted)
    if len(models) > 1:
        from rig.identification.reference import references

        fit = replace(fit, references=references(fitted, held_out, groups_of(fitted)))
    if fit.adequate is False:
        apart = runs_apart(fitted, fit.error.rmse_N, _error_of(best, wanted.method))
        fit = replace(fit, warnings=(*apart, *fit.warnings))
    return best, fit


def _behind_spring(
    model: DamperModel, fitted: list[Measurement], held_out: list[Measurement], method: Method
) -> tuple[SeriesSpring, list[Measurement], list[Measurement]]:
    """The spring, and the damper's own motion in all tests.

    Raises:
        IdentificationFailed: the force of a test cannot be differentiated, or the model cannot be fitted.
    """
    from rig.identification.series_spring import Softened, find_spring

    spring = find_spring(model, fitted, method)
    if spring.stiffness_N_m is None:
        return spring, fitted, held_out
    compliance_m_N = 1.0 / spring.stiffness_N_m
    return spring, Softened(fitted).by(compliance_m_N), Softened(held_out).by(compliance_m_N)


def _names(model: str, fitted: Sequence[Measurement]) -> list[str]:
    """Names of the models that `model` stands for."""
    if model == ALL:
        return list(rig.dampers.MODELS)
    return list(FEW_MODELS) if model == FEW else [named_over(model, fitted)]


def _model(name: str, hysteresis: Hysteresis) -> DamperModel:
    """The model, in the wanted form where it has one.

    Raises:
        UnknownName: no such model, or no such form.
        UnknownLaw: no such current law.
    """
    named = rig.dampers.MODELS.get(name.partition(PLUS)[0])
    only_kwok = named is not None and hysteresis == "printed" and hysteresis not in named.forms
    return rig.dampers.model(name, "kwok" if only_kwok else hysteresis)


def _found_lag(
    models: Sequence[DamperModel],
    fitted: Sequence[Measurement],
    method: Method,
    on_progress: Callable[[str], None] | None,
) -> float:
    """Eta (1/s) with the asked model where that is algebraic, else with the asymmetric one: it is the coil's alone."""
    if on_progress is not None:
        on_progress("finding the coil's lag from the commanded current")
    model = next((model for model in models if model.states == 0), _model("asymmetric", "kwok"))
    findings, quick = examine(model, fitted), Method(weight=method.weight)
    near: dict[str, float] = {}

    def objective(tests: list[Measurement]) -> float:
        solution = solve(model, tests, quick, findings, near or None)
        near.update(solution.values)
        return solution.objective

    return find_lag(fitted, objective)


def _error_of(best: Candidate, method: Method) -> Callable[[list[Measurement]], float]:
    """Root mean square error (N) of the chosen model fitted to some of the tests."""

    def error_N(tests: list[Measurement]) -> float:
        findings = examine(best.model, tests)
        solution = solve(best.model, tests, method, findings, best.solution.values)
        return score(best.model, solution.values, tests).rmse_N

    return error_N


def _with_lag(fit: Fit, lag: CurrentLag) -> Fit:
    """The fit with eta from the current steps in place of an eta that loops at constant current cannot show."""
    together = quantile(len(fit.identifiable) + 1) * lag.std_1_s
    low, high = lag.interval_1_s
    eta = Estimate(
        value=lag.eta_1_s,
        unit=fit.parameters["eta"].unit,
        low=low,
        high=high,
        simultaneous_low=lag.eta_1_s - together,
        simultaneous_high=lag.eta_1_s + together,
        standard_error=lag.std_1_s,
    )
    note = f"eta: from {lag.steps} current steps, commanded to measured current; the force model has no part in it"
    return replace(fit, parameters={**fit.parameters, "eta": eta}, notes=(*fit.notes, note))
