"""From a run to a fit: prepare, examine, solve, judge; one model, or all of them compared."""

from __future__ import annotations

import itertools
import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import rig.dampers
from rig.dampers.algebraic import Hysteresis
from rig.dampers.model import DamperModel
from rig.errors import IdentificationFailed
from rig.identification.coil import find_lag, needs_lag, with_lag
from rig.identification.consistency import (
    contradictions,
    refuse_reversed_signs,
    refuse_seen,
    refuse_twice,
    runs_apart,
    some,
)
from rig.identification.current_lag import CurrentLag, lag_of
from rig.identification.fit import Estimate, Fit, ModelScore, SeriesSpring
from rig.identification.identifiability import examine
from rig.identification.judging import judged
from rig.identification.measurement import Measurement
from rig.identification.next_test import Allowance, bench_of, next_tests
from rig.identification.per_current import AFFINE, identify_per_current
from rig.identification.preparation import campaign_skews, prepare_all
from rig.identification.scoring import score
from rig.identification.selection import Candidate, compare
from rig.identification.separable import GivenUp
from rig.identification.solving import PARTLY_SEPARABLE, Method, solve
from rig.identification.uncertainty import DeclaredErrors, quantile
from rig.recording.quality.cross_checks import doubts
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

ALL = "all"


def identify(
    tests: Run | Sequence[RecordedPoint] | Sequence[Measurement],
    *,
    model: str = "asymmetric",
    method: str | Method = "separable",
    holdout: str | Run | Sequence[RecordedPoint] | Sequence[Measurement] | None = None,
    hysteresis: Hysteresis = "kwok",
    declared: DeclaredErrors | None = None,
    profile: bool | Sequence[str] = False,
    current: str = AFFINE,
    series_spring: bool = False,
    allowance: Allowance | None = None,
    campaign: Sequence[RecordedPoint] = (),
    told: Callable[[str], None] | None = None,
) -> Fit:
    """Fit a damper model to recorded tests.

    Args:
        tests: a run, its points, or measurements already prepared.
        model: a name in `rig.dampers.MODELS`, or "all" to compare them.
        method: "separable", one of the papers' algorithms, or a `Method` with its settings.
        holdout: tests kept out of the fit and scored apart: a filter such as "waveform=triangle" on `tests`, or others.
        hysteresis: form of the tanh models' argument.
        declared: scale and position errors to include in the intervals.
        profile: parameters whose profile likelihood is wanted; True: all nonlinear ones.
        current: how parameters depend on the current: "affine", in one fit; or one fit a current with
            "per-current-affine", "per-current-polynomial" (quadratic) or "per-current-lagrange" relations.
        series_spring: look for a spring in series with the damper, and fit the damper behind it; held-out tests are
            corrected by their own measured force.
        allowance: what the next test may ask of the machine; by default what a run's own bench and matrix allow, or
            what was tested.
        campaign: further points of the same campaigns, neither fitted nor held out: they know of the sensors' delays.
        told: called with a line of text before each model is fitted and each comparison.

    Returns:
        The fit; with "all", that of the recommended model.

    Raises:
        IdentificationFailed: nothing can be identified; the message names what the data lack.
    """
    started = time.perf_counter()
    if allowance is None and isinstance(tests, Run):
        allowance = bench_of(tests.path)
    settings = method if isinstance(method, Method) else Method(method)
    fitted, held_out, warnings = _split(tests, holdout, campaign)
    refuse_reversed_signs(fitted)
    warnings += contradictions(fitted)
    lag, unusable_steps = lag_of(_recorded(tests))
    warnings += unusable_steps
    if current != AFFINE:
        if model == ALL or profile or series_spring:
            raise IdentificationFailed(
                f"current dependence {current!r} goes with one model, without profiles and without a series spring"
            )
        chosen = _model(model, hysteresis)
        return identify_per_current(chosen, fitted, held_out, current, settings, warnings, declared, started, told)
    spring = None
    if series_spring:
        if model == ALL:
            raise IdentificationFailed("a series spring goes with one model: name it, such as `asymmetric`")
        spring, fitted, held_out = _behind_spring(_model(model, hysteresis), fitted, held_out, settings)
    names = list(rig.dampers.MODELS) if model == ALL else [model]
    models = [_model(name, hysteresis) for name in names]
    eta_1_s = _found_lag(models, fitted, settings, told) if needs_lag(fitted) else None
    if eta_1_s is not None:
        fitted, held_out = ([with_lag(each, eta_1_s) for each in tests] for tests in (fitted, held_out))
    candidates, refused, given_up = _candidates(models, fitted, settings, told)
    warnings += refused
    if told is not None and len(candidates) > 1:
        told("comparing the models on what they have not seen")
    ranking, best = compare(candidates, fitted, held_out, settings)
    ranking += given_up
    if eta_1_s is not None and "eta" in best.model.names:
        values = {**best.solution.values, "eta": eta_1_s}
        best = replace(best, solution=replace(best.solution, values=values))
    fit = judged(best, fitted, held_out, ranking, settings, warnings, declared, profile, started)
    if fit.adequate is False:
        apart = runs_apart(fitted, fit.error.rmse_N, _error_of(best, settings))
        fit = replace(fit, warnings=(*apart, *fit.warnings))
    if lag is not None and "eta" in fit.parameters:
        fit = _with_lag(fit, lag)
    if spring is not None:
        from rig.identification.series_spring import SMOOTHING

        spring = spring.widened(max((each.widening for each in fit.residuals), default=1.0), quantile() * SMOOTHING)
    return replace(fit, series=spring, next_tests=next_tests(best.model, fit, fitted, allowance))


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


def identify_run(
    paths: Sequence[Path | str],
    *,
    model: str = "asymmetric",
    method: str | Method = "separable",
    holdout: str | None = None,
    hysteresis: Hysteresis = "kwok",
    suspect: bool = False,
    profile: bool | Sequence[str] = False,
    current: str = AFFINE,
    series_spring: bool = False,
    told: Callable[[str], None] | None = None,
) -> Fit:
    """Fit recorded runs and write `fit.json` into the first of them, or beside the file it is.

    Args:
        paths: campaign directories, folders in which exactly one campaign lies, or point files.
        model: as in `identify`.
        method: as in `identify`.
        holdout: a filter on the points, or the path of another run.
        hysteresis: as in `identify`.
        suspect: take suspect points too, not only valid ones.
        profile: as in `identify`.
        current: as in `identify`.
        series_spring: as in `identify`.
        told: as in `identify`.

    Raises:
        IdentificationFailed: nothing can be identified.
        FileProblem: a path is no run.
    """
    runs = [Run.open(path) for path in paths]
    points = [point for run in runs for point in (run.usable if suspect else run.valid)]
    left_out = [line for run in runs for line in run.left_out if not (suspect and ": suspect (" in line)]
    if not points:
        hint = "; `--suspect` takes suspect points too" if any(": suspect (" in line for line in left_out) else ""
        raise IdentificationFailed(f"no point is valid: {some(left_out, '; ')}{hint}")
    other = Run.open(holdout) if holdout is not None and Path(holdout).exists() else holdout
    tested = [*runs, other] if isinstance(other, Run) else runs
    specimens = {str(run.campaign.get("specimen")) for run in tested if run.campaign.get("specimen") is not None}
    if len(specimens) > 1:
        raise IdentificationFailed(
            f"these runs tested different specimens ({', '.join(sorted(specimens))}); one fit describes one damper: "
            "identify them apart"
        )
    declared = declared_errors(points)
    fit = identify(
        points,
        model=model,
        method=method,
        holdout=other,
        hysteresis=hysteresis,
        declared=declared,
        profile=profile,
        current=current,
        series_spring=series_spring,
        allowance=bench_of(runs[0].path),
        campaign=[point for run in tested for point in run.usable],
        told=told,
    )
    doubted = [f"calibration in doubt, and in no interval: {line}" for line in doubts(points)]
    fit = replace(fit, warnings=(*doubted, *left_out, *fit.warnings))
    written, kept = write_fit(fit, runs[0].path)
    return replace(fit, path=written, kept=kept)


def declared_errors(points: Sequence[RecordedPoint]) -> DeclaredErrors:
    """What the calibrations in the recorded points leave uncertain; the largest where they differ."""

    def largest(name: str) -> float:
        return max((float(point.test.get(f"{name}_uncertainty_percent", 0.0)) for point in points), default=0.0) / 100.0

    return DeclaredErrors(force_gain=largest("force"), displacement_gain=largest("displacement"))


def write_fit(fit: Fit, folder: Path) -> tuple[Path, Path | None]:
    """Write `fit.json` into a campaign directory, whole or not at all.

    Returns:
        Its path, and where an older `fit.json` was kept: `fit-<UTC of its writing>.json`.
    """
    target = folder / "fit.json"
    kept = _kept(target)
    temporary = folder / "fit.json.tmp"
    temporary.write_text(json.dumps(fit.to_json(), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    temporary.replace(target)
    return target, kept


def _kept(target: Path) -> Path | None:
    """Give an older fit a name of its own, by the time it was written; None where there is none."""
    if not target.is_file():
        return None
    written = datetime.fromtimestamp(target.stat().st_mtime, UTC).strftime("%Y%m%dT%H%M%SZ")
    for number in itertools.count(1):
        name = target.with_name(f"fit-{written}{'' if number == 1 else f'-{number}'}.json")
        try:
            name.hardlink_to(target)
        except FileExistsError:
            continue
        except OSError:  # a file system without hard links
            name.write_bytes(target.read_bytes())
        return name
    return None


def _model(name: str, hysteresis: Hysteresis) -> DamperModel:
    """The model, in the wanted form where it has one.

    Raises:
        UnknownName: no such model, or no such form.
    """
    only_kwok = hysteresis == "printed" and name not in {"asymmetric", "symmetric"}
    return rig.dampers.model(name, "kwok" if only_kwok else hysteresis)


def _split(
    tests: Run | Sequence[RecordedPoint] | Sequence[Measurement],
    holdout: str | Run | Sequence[RecordedPoint] | Sequence[Measurement] | None,
    campaign: Sequence[RecordedPoint],
) -> tuple[list[Measurement], list[Measurement], list[str]]:
    """Measurements to fit, measurements held out, warnings; both aligned by all points of their campaigns.

    Raises:
        IdentificationFailed: nothing or everything is held out, or a test is there twice or on both sides.
    """
    given = list(tests.valid) if isinstance(tests, Run) else list(tests)
    points = [each for each in given if isinstance(each, RecordedPoint) and each.kind == "loop"]
    fitted = [each for each in given if isinstance(each, Measurement)]
    kept_out: list[RecordedPoint] = []
    held_out: list[Measurement] = []
    if isinstance(holdout, str):
        from rig.recording.run import Selection

        wanted = Selection.parse(holdout)
        kept_out = [point for point in points if wanted.holds(point)]
        points = [point for point in points if not wanted.holds(point)]
        if not kept_out:
            raise IdentificationFailed(f"holdout {holdout!r} matches none of the {len(points)} points")
        if not points:
            raise IdentificationFailed(f"holdout {holdout!r} matches every point; nothing is left to fit")
    elif holdout is not None:
        others = list(holdout.valid) if isinstance(holdout, Run) else list(holdout)
        kept_out = [each for each in others if isinstance(each, RecordedPoint) and each.kind == "loop"]
        held_out = [each for each in others if isinstance(each, Measurement)]
        if not others:
            where = f"the run {holdout.path} holds no valid point" if isinstance(holdout, Run) else "no test was given"
            raise IdentificationFailed(f"nothing is held out: {where}; leave holdout out to fit without")
        if not kept_out and not held_out:
            raise IdentificationFailed(f"none of the {len(others)} held-out points is a loop; only loops are scored")
    refuse_twice([*points, *fitted])
    refuse_seen([*points, *fitted], [*kept_out, *held_out])
    warnings: list[str] = []
    skews = campaign_skews([*_all_of(tests), *(() if isinstance(holdout, str) else _all_of(holdout or ())), *campaign])
    if points or not fitted:
        prepared, refused = prepare_all(points, skews)
        fitted += prepared
        warnings += refused
    if kept_out:
        prepared, refused = prepare_all(kept_out, skews)
        held_out += prepared
        warnings += refused
    return fitted, held_out, warnings


def _found_lag(
    models: Sequence[DamperModel],
    fitted: Sequence[Measurement],
    method: Method,
    told: Callable[[str], None] | None,
) -> float:
    """Eta (1/s) with the asked model where that is algebraic, else with the asymmetric one: it is the coil's alone."""
    if told is not None:
        told("finding the coil's lag from the commanded current")
    model = next((each for each in models if each.states == 0), _model("asymmetric", "kwok"))
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


def _recorded(tests: Run | Sequence[RecordedPoint] | Sequence[Measurement]) -> list[RecordedPoint]:
    """Every recorded point given, whatever it is for."""
    given = list(tests.valid) if isinstance(tests, Run) else list(tests)
    return [each for each in given if isinstance(each, RecordedPoint)]


def _all_of(tests: Run | Sequence[RecordedPoint] | Sequence[Measurement]) -> list[RecordedPoint]:
    """As `_recorded`, with a run's suspect points."""
    return list(tests.usable) if isinstance(tests, Run) else _recorded(tests)


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


def _candidates(
    models: Sequence[DamperModel],
    fitted: Sequence[Measurement],
    method: Method,
    told: Callable[[str], None] | None,
) -> tuple[list[Candidate], list[str], tuple[ModelScore, ...]]:
    """Every model that the method can fit, a line for each that it cannot, and those given up beside better ones.

    Raises:
        IdentificationFailed: no model can be fitted.
    """
    candidates, refused, given_up = [], [], []
    rival_N = math.inf
    for number, model in enumerate(sorted(models, key=_hardly_separable), 1):
        if told is not None:
            told(f"fitting {model.name} ({number} of {len(models)})")
        findings = examine(model, fitted)
        try:
            candidate = Candidate(model, findings, solve(model, fitted, method, findings, rival_N=rival_N))
            if len(models) > 1:
                rival_N = min(rival_N, score(model, candidate.solution.values, fitted).rmse_N)
            candidates.append(candidate)
        except GivenUp as reason:
            free = len(findings.free(model.names))
            given_up.append(ModelScore(model.name, None, math.nan, math.nan, free, method.name, str(reason)))
        except IdentificationFailed as error:
            refused.append(str(error))
    if not candidates:
        raise IdentificationFailed("; ".join(refused))
    return candidates, refused, tuple(given_up)


def _hardly_separable(model: DamperModel) -> bool:
    """Whether all parameters have to be searched at once; such models come last, when there are others to beat."""
    return model.states > 0 and model.name not in PARTLY_SEPARABLE
