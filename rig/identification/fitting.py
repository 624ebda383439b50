"""From a run to a fit, in stages: prepare, correct the tests, fit and evaluate the model, complete, explain, propose.

Every stage is a function of a `FitState` that returns one: the tests as the model sees them, the options, the fit so
far. What a fit takes into account besides its model is a correction with stages of its own (`corrections`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import rig.dampers
from rig.dampers.current_law import AFFINE
from rig.dampers.current_law_model import PLUS, with_law
from rig.dampers.grey_box import GREY, SUFFIX, named_parts
from rig.dampers.model import DamperModel
from rig.errors import IdentificationFailed, RigError, evaluating, some
from rig.fits.entries import Cause, ErrorSummary
from rig.identification.application.tested_range import tested_range
from rig.identification.cross_validation import cross_validated, refuse_one_pair
from rig.identification.diagnosis.statement import Fitted
from rig.identification.fit_state import FitState, stages_of
from rig.identification.grey_box import compared_with_residual, refuse_residual
from rig.identification.models.coverage import beyond, recorded_degC
from rig.identification.models.law_search import laws_over, named_over
from rig.identification.models.measurement import Measurement, first_cycle, set_of, spaced
from rig.identification.models.solving import SQUARES, Candidate, Method, solve, splits
from rig.identification.models.undetermined import examine
from rig.identification.next_test import bench_of, next_tests
from rig.identification.options import ALL, FEW, FitOptions
from rig.identification.per_current import fit_per_current
from rig.identification.per_current import refuse as refuse_per_current
from rig.identification.points.consistency import contradictions, inconsistent_runs, without_reversed_signs
from rig.identification.points.inputs import fit_inputs
from rig.identification.reference import references
from rig.identification.remarks import UNTRIED, say
from rig.identification.resampling import bootstrap
from rig.identification.selection import candidates_of, compare, doubts_of, groups_of, weighted_by_misfit
from rig.identification.uncertainty.assessment import judged
from rig.identification.uncertainty.fit import Fit
from rig.identification.uncertainty.prediction_error import error_band, held_out_tests, left_out_tests
from rig.identification.uncertainty.scoring import misfits, rmse_N, with_extrapolations
from rig.jobs.time_left import TimeLeft
from rig.jobs.workers import HERE, Job
from rig.matrix.corrections import Correction
from rig.matrix.methods import FEW_MODELS
from rig.units import DIMENSIONS, si_suffix

if TYPE_CHECKING:
    from rig.identification.points.inputs import Tests

DRAWN_SAMPLES = 250  # samples of a cycle that figures show
DIAGNOSED_SAMPLES = 125  # of a cycle, of models with internal states: a cause costs an integration of all tests a step


def identify(tests: Tests, options: FitOptions | None = None, **changes: Any) -> Fit:  # noqa: ANN401 - by their names
    """Fit a damper model to recorded tests.

    Args:
        tests: a run, its points, or measurements already prepared.
        options: what is asked of the fit.
        changes: options by name in place of those, such as `model="few"` or `series_spring=True`: see `FitOptions`.

    Returns:
        The fit; of several models that of the recommended one.

    Raises:
        IdentificationFailed: nothing can be identified; the message names what the data lack.
        TypeError: there is no such option.
    """
    state = _started(tests, FitOptions.of(options, changes))
    if state.options.current != AFFINE:
        return _with_tested_range(fit_per_current(state)).so_far
    corrections = state.options.applied
    stages: tuple[Callable[[FitState], FitState], ...] = (
        *(partial(_prepared, one) for one in corrections), _fit_models,
        *(partial(_completed, one) for one in corrections),
        _with_tested_range, _with_diagnosis, _with_bootstrap, _with_cross_validation, _with_next_tests,
    )  # fmt: skip
    for stage in stages:
        state = stage(state)
    return state.so_far


def _started(tests: Tests, options: FitOptions) -> FitState:
    """The tests as measurements, and the models; options that do not go together are refused.

    Raises:
        IdentificationFailed: nothing can be fitted, or options do not go together.
    """
    started_s = time.perf_counter()
    options = replace(options, method=options.how)
    if options.allowance is None and not isinstance(tests, Sequence):
        options = replace(options, allowance=bench_of(tests.path))
    robust = options.how.loss != SQUARES
    known = fit_inputs(tests, options.holdout, options.campaign, every_sample=robust)
    resisting, reversed_tests = without_reversed_signs(known.fitted)
    known = replace(known, fitted=resisting, warnings=(*known.warnings, *reversed_tests))
    _refuse_unseen(options, known.fitted)
    laws = laws_over(known.fitted, options.current_law)
    _refuse_outside(options)
    refuse_residual(options)
    for one in options.applied:
        stages_of(one).refuse(options)
    if options.current != AFFINE:
        refuse_per_current(options)
    models = [_model(name, options) for name in _names(options.model, known.fitted)]
    if len(laws) == 1 and laws[0] != AFFINE:
        models = [with_law(one, laws[0]) for one in models]
    warnings = (*known.warnings, *known.unusable_steps)
    return FitState(
        options, known, tuple(models), laws, known.fitted, known.held_out, warnings, started_s=started_s
    )


def _prepared(correction: Correction, state: FitState) -> FitState:
    """The first stage of a correction.

    Raises:
        RigError: it changed tests to fit and left all held-out ones as they were: an error of its author.
    """
    after = stages_of(correction).prepare(state)
    pairs = ((state.fitted, after.fitted), (state.held_out, after.held_out))
    fitted, held_out = (any(old is not new for old, new in zip(*pair, strict=True)) for pair in pairs)
    if fitted and state.held_out and not held_out:
        raise RigError(
            f"correction {correction.name}: its stage `prepare` changed only the fitted tests, expected a change to "
            "the held-out tests, too. Fix: use `state.corrected(...)` in its module"
        )
    return after


def _completed(correction: Correction, state: FitState) -> FitState:
    """The last stage of a correction; one that stores nothing is stored with the number that was requested."""
    before, after = state.so_far.corrections, stages_of(correction).complete(state)
    if not correction.requestable or after.so_far.corrections != before:
        return after
    numbers = {}
    if correction.quantity is not None:
        unit = si_suffix(correction.quantity.dimension)
        numbers = {f"requested_{unit}": float(state.options.setting(correction.name))}
    return after.with_parts(corrections={"others": {**before.others, correction.name: numbers}})


def _refuse_outside(options: FitOptions) -> None:
    """Refuse a requested number outside the range of its correction.

    Raises:
        IdentificationFailed: it is, or it is no number.
    """
    for one in options.applied:
        if one.quantity is None:
            continue
        value = options.setting(one.name)
        try:
            finite = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
            one.quantity.check(float(value) if finite else math.inf)
        except ValueError as error:
            unit = DIMENSIONS[one.quantity.dimension].si
            raise IdentificationFailed(
                f"{one.name}: got {value!r}, expected a number in {unit}; {one.quantity.allowed}"
            ) from error
        if not finite:
            raise IdentificationFailed(f"{one.name}: got {value!r}, expected a finite number")


def _refuse_unseen(options: FitOptions, tests: Sequence[Measurement]) -> None:
    """Refuse an unknown split, options that it does not go with, and tests of which no motion can be left out.

    Raises:
        IdentificationFailed: one of these.
    """
    if options.unseen is None:
        return
    if options.unseen != "pairs":
        raise IdentificationFailed(f"unseen: got {options.unseen!r}, expected 'pairs'")
    conflicts = [
        *(["one fit per current"] if options.current != AFFINE else []),
        *(["series_spring"] if options.setting("series_spring") else []),
    ]
    if conflicts:
        raise IdentificationFailed(
            f"unseen: 'pairs' cannot be combined with {', '.join(conflicts)}. Fix: omit one of them"
        )
    refuse_one_pair(tests)


def _names(model: str, fitted: Sequence[Measurement]) -> list[str]:
    """Names of the models that `model` stands for."""
    if model == ALL:
        return list(rig.dampers.MODELS)
    grey = named_parts(model)
    return list(FEW_MODELS) if model in {FEW, GREY} else [named_over(model if grey is None else grey[0], fitted)]


def _model(name: str, options: FitOptions) -> DamperModel:
    """The model, in the requested form where it has one.

    Raises:
        UnknownName: no such model, or no such form.
        UnknownLaw: no such current law.
    """
    named = rig.dampers.MODELS.get(name.partition(PLUS)[0])
    only_kwok = named is not None and options.hysteresis == "printed" and options.hysteresis not in named.forms
    return rig.dampers.model(name, "kwok" if only_kwok else options.hysteresis)


def _fit_models(state: FitState) -> FitState:
    """The recommended model, fitted and evaluated.

    Raises:
        IdentificationFailed: no model can be fitted.
    """
    options, fitted, held_out = state.options, state.fitted, state.held_out
    workers = options.workers
    candidates, refused, given_up = candidates_of(state.models, fitted, options.how, options.on_progress, workers)
    candidates, method, ratio = weighted_by_misfit(candidates, fitted, options.how, workers)
    reweighted = [say("relative-weights", ratio=ratio)] if method.weight != options.how.weight else []
    options = replace(options, method=method)
    if len(candidates) > 1:
        options.report("comparing the models on validation tests")
    ranking, best = compare(candidates, fitted, held_out, method, workers)
    doubts = doubts_of(ranking, held_out)
    if len(state.laws) > 1:
        bent = [with_law(best.model, law) for law in state.laws if law != AFFINE]
        # State searches within the search for a law stop at a rival's error, which each of them must know.
        able = workers if splits(best.model, fitted) else HERE
        more, failed, _ = candidates_of(bent, fitted, method, options.on_progress, able)
        by_law, recommended = compare([best, *more], fitted, held_out, method, workers)
        doubts = doubts_of(by_law, held_out) or doubts
        ranking = (*by_law, *(one for one in ranking if one.model != best.model.name))
        best, refused = recommended, [*refused, *failed]
    remarks: tuple[str, ...] = ()
    if options.grey:
        compared = compared_with_residual(best, candidates, ranking, fitted, held_out, options)
        ranking, best, remarks = compared.ranking, compared.best, compared.remarks
    if own := {name: value for name, value in state.held.items() if name in best.model.names}:
        best = replace(best, solution=replace(best.solution, values={**best.solution.values, **own}))
    warnings = (*state.warnings, *contradictions(fitted), *reweighted, *refused, *doubts, *remarks)
    fit = judged(best, fitted, held_out, (*ranking, *given_up), options, warnings)
    if len(state.models) > 1:
        others = references(fitted, held_out, groups_of(fitted))
        fit = replace(fit, evaluation=replace(fit.evaluation, references=others))
    if fit.adequate is False:
        apart = inconsistent_runs(fitted, fit.error.rmse_N, _error_of(best, method))
        fit = replace(fit, warnings=(*apart, *fit.warnings))
    return state.fitted_as(fit, best)


def _error_of(best: Candidate, method: Method) -> Callable[[list[Measurement]], float]:
    """Root mean square error (N) of the chosen model fitted to some of the tests."""

    def error_N(tests: list[Measurement]) -> float:
        findings = examine(best.model, tests)
        solution = solve(best.model, tests, method, findings, best.solution.values)
        return rmse_N(misfits(best.model, solution.values, tests))

    return error_N


def _with_tested_range(state: FitState) -> FitState:
    """The fit with what its tests covered, a cycle of each of them, and which held-out ones lie beyond."""
    fit, (fitted, held_out) = state.so_far, state.described or (state.fitted, state.held_out)
    law, temperature_degC = fit.behind_spring.law, state.known.temperature_degC or recorded_degC(fitted)
    tested = tested_range(law, fitted, temperature_degC)
    left_out = [] if state.chosen is None else left_out_tests(state.chosen, state.fitted, fit.weight)
    validating = held_out_tests(law, held_out, tested)
    sources = ["cross-validation"] * bool(left_out) + ["validation tests"] * bool(validating)
    band = error_band(
        law, fitted, [*left_out, *validating], " and ".join(sources), to_the_noise=fit.adequate is True
    )
    tested = replace(tested, band=band)
    cycles = tuple(spaced(first_cycle(test), DRAWN_SAMPLES) for test in fitted)
    outside = [beyond(tested, test) for test in held_out]
    holdout = None if fit.holdout is None else with_extrapolations(fit.holdout, outside)
    return state.with_parts(
        tested=tested, tests=cycles, test_set=set_of(fitted).summary, evaluation={"holdout": holdout}
    )


def _with_diagnosis(state: FitState) -> FitState:
    """The fit with what probably explains its misfit; it is good without, if the data break the search for that."""
    try:
        with evaluating("the misfit"):
            return state.with_parts(diagnosis=_diagnosis(state))
    except IdentificationFailed as error:
        return state.with_parts(warnings=(*state.so_far.warnings, say("no-diagnosis", reason=str(error))))


def _diagnosis(state: FitState) -> tuple[Cause, ...]:
    """What probably explains the misfit of the fit."""
    from rig.identification.diagnosis.ranking import diagnose  # loads the search of each cause
    fit, best, diagnosed = state.so_far, state.chosen, state.options.diagnose
    if best is None:
        return ()
    values = best.solution.values
    names = tuple(best.findings.free(name for name in best.model.names if name in values and name != "eta"))
    weighting = Method(weight=fit.weight).weighting(best.model)
    tests = [spaced(test, DIAGNOSED_SAMPLES) for test in state.fitted] if best.model.states else state.fitted
    untried = "" if len(state.models) == len(rig.dampers.MODELS) else UNTRIED
    misfit = fit.adequate is False if diagnosed is None else diagnosed
    return diagnose(Fitted(best.model, values, names, tests, weighting, untried), misfit=misfit)


def _with_bootstrap(state: FitState) -> FitState:
    """The fit with the tests drawn again, where that was requested."""
    if not state.options.bootstrap:
        return state
    tests, _ = state.described or (state.fitted, state.held_out)
    options = state.options
    drawn = bootstrap(
        state.so_far, tests, count=options.bootstrap, workers=options.workers, on_progress=options.on_progress
    ).kept()
    return state.with_parts(uncertainty={"drawn": drawn})


def _with_cross_validation(state: FitState) -> FitState:
    """The fit with what its model predicts of each amplitude and frequency that is left out, where requested."""
    if state.options.unseen is None:
        return state
    fit, options = state.so_far, state.options
    alone = FitOptions(
        model=_chosen_again(fit.model), method=options.how.without_executor, hysteresis=fit.hysteresis_form,
        diagnose=False, corrections=options.corrections,
    )  # fmt: skip
    tests, workers = list(state.known.fitted), options.workers
    shared = workers.share(tests)

    def errors_of(groups: Sequence[Sequence[int]]) -> list[ErrorSummary]:
        names = [some([tests[number].id for number in group]) for group in groups]
        jobs = [Job(name, _predicted, (shared, group, alone)) for name, group in zip(names, groups, strict=True)]
        clock = TimeLeft(len(jobs))
        return workers.in_order(jobs, lambda job, done: options.report(f"predicted {job.name} ({clock.text(done)})"))

    return state.with_parts(evaluation={"unseen": cross_validated(tests, errors_of)})


def _chosen_again(model: str) -> str:
    """The model for the tests of a fold, whose parts of a residual are chosen without the test left out."""
    grey = named_parts(model)
    return model if grey is None else f"{grey[0]}{SUFFIX}"


def _predicted(tests: Sequence[Measurement], group: Sequence[int], options: FitOptions) -> ErrorSummary:
    """In a worker: the error on a group of tests (indices) of a fit to all other tests."""
    left_out = [tests[number] for number in group]
    fit = identify([test for number, test in enumerate(tests) if number not in group], options, holdout=left_out)
    return fit.error if fit.holdout is None else fit.holdout


def _with_next_tests(state: FitState) -> FitState:
    """The fit with the tests worth running next."""
    if state.chosen is None:
        return state
    proposed = next_tests(state.chosen.model, state.so_far, state.fitted, state.options.allowance)
    return state.with_parts(next_tests=proposed)
