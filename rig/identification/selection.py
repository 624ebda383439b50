"""Which model: all that the method can fit, compared by what they have not seen, then by information.

And how tests count where no model describes them to their noise. Least squares with equal weights is right where what
is left is noise. Where it is misfit, samples of one test say the same again and again, and tests at high current have
the largest misfit in newtons: the test with the most samples and the greatest force would decide what all others get.
Then each test counts alike, by its error in % of its peak, which is also how models are ranked.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.dampers.covered import Covered, in_words
from rig.dampers.model import DamperModel
from rig.errors import IdentificationFailed, evaluating, some
from rig.fits.entries import ModelScore, mean_within
from rig.identification.cross_validation import folds_of
from rig.identification.models.coverage import beyond, covered_by
from rig.identification.models.measurement import Measurement, set_of, spanning
from rig.identification.models.separable import SCREENED, SearchAbandoned, SearchState, motion_scale
from rig.identification.models.solving import GUARD_S, SEPARABLE, SQUARES, Candidate, Method, solve, splits
from rig.identification.models.undetermined import examine
from rig.identification.remarks import Remark, say
from rig.identification.uncertainty.scoring import misfits, rmse_N
from rig.jobs.time_left import TimeLeft
from rig.jobs.workers import HERE, Job, Workers

RELATIVE = "relative"
MISFIT = 3.0  # times the tests' scatter: what the best model leaves is then misfit for nine tenths of its power
TO_THE_NOISE = 1.2  # times the tests' scatter: what a model may leave that describes them
EQUIVALENT = 0.01  # held-out errors within this share of the best are equal; the information criterion then decides


@dataclass(frozen=True)
class _Attempt:
    """Result of fitting one model: a candidate with its error, or the reason why there is none.

    Attributes:
        candidate: the fitted model; None without one.
        rmse_N: its root mean square error on the tests of `spanning`; infinite without one, or if no other model is
            compared.
        reached: state of its search when it was compared with a rival.
        free: number of its free parameters.
        refused: reason why the method cannot fit it; empty if it can.
    """

    candidate: Candidate | None
    rmse_N: float
    reached: SearchState | None
    free: int
    refused: str = ""


def _attempt(
    model: DamperModel, fitted: Sequence[Measurement], method: Method, rival_N: float, alone: bool
) -> _Attempt:
    """In a worker: fit one model; the error of one that is `alone` is not needed."""
    findings = examine(model, fitted)
    free = len(findings.free(model.names))
    try:
        with evaluating(f"the fit of {model.name}"):
            candidate = Candidate(model, findings, solve(model, fitted, method, findings, rival_N=rival_N))
            seen = spanning(fitted, SCREENED)
            error_N = math.inf if alone else rmse_N(misfits(model, candidate.solution.values, seen))
    except SearchAbandoned as error:
        return _Attempt(None, math.inf, error.reached, free)
    except IdentificationFailed as error:
        return _Attempt(None, math.inf, None, free, str(error))
    return _Attempt(candidate, error_N, candidate.solution.reached, free)


def candidates_of(
    models: Sequence[DamperModel],
    fitted: Sequence[Measurement],
    method: Method,
    on_progress: Callable[[str], None] | None,
    workers: Workers = HERE,
) -> tuple[list[Candidate], list[str], tuple[ModelScore, ...]]:
    """Models fitted by the method, a line for each that it cannot fit, and models abandoned for better ones.

    The result does not depend on the workers: a search that continued only because a far better earlier model was not
    yet known counts as abandoned.

    Raises:
        IdentificationFailed: no model can be fitted.
    """
    scale = motion_scale(fitted)
    order = sorted(models, key=lambda model: model.separation(scale) is None)
    candidates, refused, given_up = [], [], []
    rival_N = math.inf
    for model, attempt in zip(order, _attempts(order, fitted, method, on_progress, workers), strict=True):
        reason = attempt.reached.abandon_reason(model.name, rival_N) if attempt.reached is not None else None
        if reason is not None:
            given_up.append(ModelScore(model.name, None, math.nan, math.nan, attempt.free, method.name, str(reason)))
        elif attempt.candidate is None:
            refused.append(attempt.refused)
        else:
            candidates.append(attempt.candidate)
            rival_N = min(rival_N, attempt.rmse_N)
    if not candidates:
        raise IdentificationFailed("; ".join(refused))
    return candidates, refused, tuple(given_up)


def _attempts(
    order: Sequence[DamperModel],
    fitted: Sequence[Measurement],
    method: Method,
    on_progress: Callable[[str], None] | None,
    workers: Workers,
) -> list[_Attempt]:
    """Fit all models; each search is compared with the earlier models whose error is known by then."""
    alone = len(order) == 1
    if alone:
        workers = HERE  # a search may use the workers for its populations
    report, clock = on_progress or (lambda line: None), TimeLeft(len(order))
    known: dict[int, _Attempt] = {}
    shared = workers.share(list(fitted))
    sent = method if workers is HERE else method.without_executor

    def jobs() -> Iterator[Job[_Attempt]]:
        for number, model in enumerate(order):
            if workers is HERE:
                report(f"fitting {model.name} ({number + 1} of {len(order)})")
            yield Job(model.name, _attempt, (model, shared, sent, _rival_N(order, known), alone))

    places = {model.name: number for number, model in enumerate(order)}
    for job, attempt in workers.results(jobs()):
        known[places[job.name]] = attempt
        if workers is not HERE:
            report(f"fitted {job.name} ({clock.text(len(known))})")
    return [known[number] for number in range(len(order))]


def _rival_N(order: Sequence[DamperModel], known: Mapping[int, _Attempt]) -> float:
    """Smallest error of the leading models with known errors; infinite if there are none."""
    rival_N = math.inf
    for number, model in enumerate(order):
        if number not in known:
            break
        attempt = known[number]
        if attempt.reached is None or attempt.reached.abandon_reason(model.name, rival_N) is None:
            rival_N = min(rival_N, attempt.rmse_N)
    return rival_N


def compare(
    candidates: Sequence[Candidate],
    fitted: Sequence[Measurement],
    held_out: Sequence[Measurement],
    method: Method,
    workers: Workers = HERE,
) -> tuple[tuple[ModelScore, ...], Candidate]:
    """Rank the candidates, best first, and name the recommended one.

    With held-out tests each model's error on them decides. Without, models that describe all tests to their scatter
    come before those that do not; then each group of tests of the same waveform, amplitude and frequency is left out in
    turn (of the same current, if there is only one such group), and the error on those decides that lie within the data
    of the others: beyond them it is the error of an extrapolation. Models whose errors are equal
    to 1 %, and all where none lies within, are ranked by the Bayesian information criterion (Schwarz 1978). All are
    scored on the same samples: those where one of them jumps, and a fit of it does not look, count for none.
    """
    if len(candidates) > 1:
        models = [candidate.model for candidate in candidates]
        fitted = [_away_from_jumps(test, models) for test in fitted]
        held_out = [_away_from_jumps(test, models) for test in held_out]
    alone = len(candidates) == 1
    workers = HERE if alone else workers
    tests, unseen = workers.share(list(fitted)), workers.share(list(held_out))
    sent = method if workers is HERE else method.without_executor
    scores = workers.in_order(
        Job(candidate.model.name, _score, (candidate, tests, unseen, sent, alone)) for candidate in candidates
    )
    places = _ordered(scores, math.inf if held_out else _scatter_N(fitted), within=not held_out)
    return tuple(scores[place] for place in places), candidates[places[0]]


def _ordered(scores: Sequence[ModelScore], scatter_N: float = math.inf, *, within: bool) -> list[int]:
    """Places of the scores, best first, by the error on all unseen tests or on those within the data.

    Those that leave no more than the tests' scatter come first; NaN or infinite: that is not asked.
    """
    errors = [score.within_nrmse_percent_of_peak if within else score.holdout_nrmse_percent_of_peak for score in scores]
    missing = [score.rmse_N > TO_THE_NOISE * scatter_N for score in scores]
    reported = [error if error is not None and math.isfinite(error) else math.inf for error in errors]
    least = {True: math.inf, False: math.inf}
    for fails, error in zip(missing, reported, strict=True):
        least[fails] = min(least[fails], error)

    def rank(place: int) -> tuple[bool, float, float]:
        equal = reported[place] <= least[missing[place]] * (1.0 + EQUIVALENT)
        return missing[place], 0.0 if equal else reported[place], scores[place].bic

    return sorted(range(len(scores)), key=rank)


def doubts_of(scores: Sequence[ModelScore], held_out: Sequence[Measurement]) -> list[Remark]:
    """Warnings: that the first model is not the one that predicts best, or that an extrapolation decided."""
    if len(scores) < 2 or scores[0].holdout_nrmse_percent_of_peak is None:
        return []
    first, other, outside = scores[0], scores[_ordered(scores, within=True)[0]], scores[0].beyond
    errors = {"error": first.within_nrmse_percent_of_peak, "other_error": other.within_nrmse_percent_of_peak}
    numbers = {"model": first.model, "other": other.model, **errors}
    if not held_out and first is not other and None not in errors.values():
        return [say("described-first", times=other.rmse_N / first.rmse_N, **numbers)]
    if not outside:
        return []
    quantities = in_words(name for names in outside.values() for name in names)
    if first.within_nrmse_percent_of_peak is None:
        return [say("ranked-beyond" if held_out else "ranked-unseen-by-none", quantities=quantities)]
    if not held_out or first is other:
        return []
    return [say("ranked-by-those-beyond", tests=some(list(outside)), quantities=quantities, **numbers)]


def _away_from_jumps(test: Measurement, models: Sequence[DamperModel]) -> Measurement:
    """The measurement without the samples so close to a jump of a model that their side of it is unsure."""
    kept = test.scored.copy()
    jumps = {model.jumps_at for model in models}
    if "mid-stroke" in jumps:
        kept &= np.abs(test.u_m) >= GUARD_S * np.abs(test.v_m_s)
    if "reversal" in jumps:
        kept &= np.abs(test.v_m_s) >= GUARD_S * np.abs(test.a_m_s2)
    return replace(test, usable=kept)


def _score(
    candidate: Candidate, fitted: Sequence[Measurement], held_out: Sequence[Measurement], method: Method, alone: bool
) -> ModelScore:
    """In a worker: scores that rank a candidate; if it is `alone` without held-out tests, nothing is predicted."""
    model, values = candidate.model, candidate.solution.values
    misfit = misfits(model, values, fitted)
    if held_out:
        unseen = predicted(model, values, held_out, covered_by(fitted))
    else:
        unseen = [] if alone else cross_validated(model, fitted, method, values)
    errors = [(test.nrmse_percent_of_peak, test.beyond) for test in unseen]
    samples, error_N = sum(test.samples for test in misfit), rmse_N(misfit)
    free = len(candidate.findings.free(values))
    bic = samples * math.log(max(error_N, 1e-300) ** 2) + free * math.log(samples)
    return ModelScore(
        model.name,
        sum(one for one, _ in errors) / len(errors) if errors else None,
        bic,
        error_N,
        free,
        method.name,
        within_nrmse_percent_of_peak=mean_within(errors),
        beyond={test.id: test.beyond for test in unseen if test.beyond},
    )


@dataclass(frozen=True)
class _Predicted:
    """Error of a prediction of a test, and the quantities in which the test lies beyond the fitted ones."""

    id: str
    nrmse_percent_of_peak: float
    beyond: tuple[str, ...]


def predicted(
    model: DamperModel, values: Mapping[str, float], unseen: Sequence[Measurement], covered: Covered
) -> list[_Predicted]:
    """Errors on tests of a fit that has not seen them."""
    return [
        _Predicted(test.id, one.nrmse_percent_of_peak, beyond(covered, test))
        for test, one in zip(unseen, misfits(model, values, unseen), strict=True)
    ]


def cross_validated(
    model: DamperModel, measurements: Sequence[Measurement], method: Method, near: Mapping[str, float] | None = None
) -> list[_Predicted]:
    """Errors of groups of tests, each predicted from the others, beyond whose data it may lie (see `folds_of`)."""
    folds = folds_of(model, measurements, method, near)
    return [error for fold in folds for error in predicted(model, fold.values, fold.left_out, fold.covered)]


def groups_of(measurements: Sequence[Measurement]) -> list[list[Measurement]]:
    """Tests of the same motion; of the same current where all share one motion."""
    return [[measurements[number] for number in group] for group in set_of(measurements).groups]


def describes(score: ModelScore, tests: Sequence[Measurement]) -> bool:
    """Whether a model leaves no more than the tests' scatter; False where that is not known."""
    return score.rmse_N <= TO_THE_NOISE * _scatter_N(tests)


def _scatter_N(tests: Sequence[Measurement]) -> float:
    """Root mean square scatter of the tests from cycle to cycle; NaN where one's is not known."""
    samples = [test.u_m.size * test.recorded_each for test in tests]
    power = [test.noise_N**2 * count for test, count in zip(tests, samples, strict=True)]
    return math.sqrt(sum(power) / sum(samples))


def misfit_over_scatter(candidates: Sequence[Candidate], fitted: Sequence[Measurement]) -> float:
    """Root mean square error of the best candidate over the scatter of the tests (1); NaN where that is not known.

    Samples so near to a model's own jump that their side of it is unsure are misfit of none.
    """
    scatter_N = _scatter_N(fitted)
    errors_N = []
    for candidate in candidates:
        away = [_away_from_jumps(test, [candidate.model]) for test in fitted]
        errors_N.append(rmse_N(misfits(candidate.model, candidate.solution.values, away)))
    least_N = min(errors_N)
    return least_N / scatter_N if scatter_N > 0.0 else math.nan


def weighted_by_misfit(
    candidates: Sequence[Candidate], fitted: Sequence[Measurement], method: Method, workers: Workers = HERE
) -> tuple[list[Candidate], Method, float]:
    """Fit the candidates again with relative weights if even the best one leaves a misfit beyond noise.

    Args:
        candidates: models with their solutions.
        fitted: the tests.
        method: method of the fits; a requested weight is not changed.
        workers: fit the candidates again.

    Returns:
        The candidates and the method (unchanged or with relative weights), and the ratio of misfit to scatter.
    """
    applies = method.weight is not None or method.name != SEPARABLE or method.loss != SQUARES
    ratio = math.nan if applies or len(fitted) < 2 else misfit_over_scatter(candidates, fitted)
    if not MISFIT < ratio < math.inf:
        return list(candidates), method, ratio
    weighted = replace(method, weight=RELATIVE)
    workers = HERE if len(candidates) == 1 else workers
    shared, sent = workers.share(list(fitted)), weighted if workers is HERE else weighted.without_executor
    again = workers.in_order(
        Job(candidate.model.name, _fitted_again, (candidate, shared, sent)) for candidate in candidates
    )
    return again, weighted, ratio


def _fitted_again(candidate: Candidate, fitted: Sequence[Measurement], method: Method) -> Candidate:
    """In a worker: fit a candidate with another method, starting from its solution.

    A solution at a limit tells little about the optimum with other weights: then the search is repeated without a start
    (of models that split, for which this is quick), and the smaller objective decides.
    """
    model, findings = candidate.model, candidate.findings
    solution = solve(model, fitted, method, findings, candidate.solution.values, exact=True)
    evaluations = candidate.solution.evaluations + solution.evaluations
    if candidate.solution.at_limit and splits(model, fitted):
        other = solve(model, fitted, method, findings)
        solution, evaluations = min(solution, other, key=lambda one: one.objective), evaluations + other.evaluations
    return replace(candidate, solution=replace(solution, evaluations=evaluations))
