"""One fit a current, then each parameter as a function of the current (paper 2): affine, polynomial or Lagrange.

Fitted at one current, a model needs no terms per ampere: the tests of a level are taken as tests without current, and
what a current-dependent parameter is there is its value at zero. Between the levels a parameter follows its relation;
parameters of the shape never leave the range of the fitted ones, because a polynomial may swing where a loop cannot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.dampers.current_law import AFFINE
from rig.dampers.current_law_model import PLUS
from rig.dampers.model import DamperModel
from rig.errors import IdentificationFailed
from rig.fits.entries import Cause, Corrections, Estimate, Evaluation, SolverReport, Uncertainty
from rig.fits.relation import CurrentRelations, Relation, relations
from rig.identification.diagnosis.ranking import diagnose
from rig.identification.diagnosis.statement import Fitted
from rig.identification.fit_state import FitState
from rig.identification.models.measurement import Measurement, set_of
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.solving import Candidate, solve
from rig.identification.models.undetermined import examine
from rig.identification.options import FitOptions
from rig.identification.points.consistency import contradictions
from rig.identification.remarks import say
from rig.identification.uncertainty.assessment import judged
from rig.identification.uncertainty.fit import Fit
from rig.identification.uncertainty.scoring import describes, score_forces, together
from rig.matrix.methods import DEPENDENCES
from rig.signals.test_set import rounded_levels

EACH_ALONE = "each current is fitted separately; the parameters are then fitted as functions of the current"
PER_CURRENT = {name: name.removeprefix("per-current-") for name in DEPENDENCES if name != AFFINE}


@dataclass(frozen=True)
class Level:
    """The tests of one current, and the model fitted to them as if they ran without; `name_A` is its label."""

    current_A: float
    name_A: float
    tests: tuple[Measurement, ...]
    fit: Fit


def refuse(options: FitOptions) -> None:
    """Refuse options that do not go with a fit for each current.

    Raises:
        IdentificationFailed: one of these.
    """
    conflicts = [
        *(["several models"] if options.several else []),
        *(["profiles"] if options.profile else []),
        *options.corrections,
        *(["bootstrap"] if options.bootstrap else []),
        *(["a current law"] if PLUS in options.model or options.current_law != AFFINE else []),
    ]
    if conflicts:
        raise IdentificationFailed(
            f"current: {options.current!r} cannot be combined with {', '.join(conflicts)} and needs one named model. "
            "Fix: omit one of the options"
        )
    if options.current not in PER_CURRENT:
        raise IdentificationFailed(f"current: got {options.current!r}, expected one of {', '.join(DEPENDENCES)}")


def fit_per_current(state: FitState) -> FitState:
    """Fit a model at each current and relate its parameters to the current.

    The fit's parameters are named `NAME at I A`, with the relations in `current`.

    Raises:
        IdentificationFailed: fewer than two currents, a current that changes within a test, or a current at which
            nothing can be identified; the message names it.
    """
    (model,), options, levels = state.models, state.options, []
    for current_A, name_A, tests in _levels(state.fitted):
        options.report(f"fitting {model.name} at {name_A:g} A ({len(tests)} tests)")
        levels.append(Level(current_A, name_A, tuple(tests), _fit_level(model, name_A, tests, options)))
    if len(levels) < 2:
        raise IdentificationFailed(
            f"current: {options.current} needs tests at two or more currents, but all tests ran at "
            f"{levels[0].name_A:g} A. Fix: add tests at another current, or fit without this option"
        )
    related = _relations(model, levels, PER_CURRENT[options.current])
    return state.fitted_as(_joined(model, levels, related, state))


def _levels(tests: Sequence[Measurement]) -> list[tuple[float, float, list[Measurement]]]:
    """Tests by their current (A), rising, with its label (A).

    Raises:
        IdentificationFailed: the current of a test changes.
    """
    levels = set_of(tests).currents
    for number in levels.changing[:1]:
        test = tests[number]
        raise IdentificationFailed(
            f"{test.id}: its current changes from {np.min(test.current_A):.2f} to {np.max(test.current_A):.2f} A; one "
            "fit per current needs constant currents"
        )
    names_A = rounded_levels(levels.values_A)
    return [
        (levels.values_A[level], names_A[level], [tests[number] for number in levels.members(level)])
        for level in range(len(levels))
    ]


def _without_current(test: Measurement) -> Measurement:
    return replace(test, current_A=np.zeros_like(test.current_A), nominal_current_A=0.0)


def _fit_level(model: DamperModel, name_A: float, tests: Sequence[Measurement], options: FitOptions) -> Fit:
    """One current's fit.

    Raises:
        IdentificationFailed: nothing can be identified at this current; the message names it.
    """
    still, method = [_without_current(test) for test in tests], options.how
    findings = examine(model, still)
    try:
        best = Candidate(model, findings, solve(model, still, method, findings))
        return judged(best, still, [], (), FitOptions(method=method, declared=options.declared))
    except IdentificationFailed as error:
        raise IdentificationFailed(f"at {name_A:g} A: {error}") from error


def _relations(model: DamperModel, levels: Sequence[Level], kind: str) -> CurrentRelations:
    currents_A = np.array([level.current_A for level in levels])
    names = [parameter.name for parameter in model.parameters if parameter.name != "eta" and parameter.power == 0]
    names = [name for name in names if all(level.fit.parameters[name].value is not None for level in levels)]
    related: dict[str, Relation] = {}
    ranges = {}
    for name in names:
        values = np.array([level.fit.values[name] for level in levels])
        related[name] = next(relation for relation in relations(currents_A, values) if relation.kind == kind)
        ranges[name] = (float(np.min(values)), float(np.max(values)))
    return CurrentRelations(f"per-current-{kind}", tuple(currents_A.tolist()), related, ranges)


def _joined(
    model: DamperModel,
    levels: Sequence[Level],
    related: CurrentRelations,
    state: FitState,
) -> Fit:
    """The levels and their relations as one fit, scored with the relations."""
    method, held_out = state.options.how, state.held_out
    fitted = [test for level in levels for test in level.tests]

    def force(test: Measurement) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        values = related.values_at(model, float(np.mean(test.current_A)))
        return np.asarray(modelled_force(model, values, _without_current(test)))

    def fits(test: Measurement) -> bool | None:
        values = related.values_at(model, float(np.mean(test.current_A)))
        return describes(model, values, [_without_current(test)], method.weighting(model))

    outside = _outside(fitted, held_out)
    notes = [*state.warnings, *contradictions(state.fitted)] + [
        f"at {level.name_A:g} A: {text}" for level in levels for text in level.fit.warnings
    ]
    notes += [f"{test.id}: {warning}" for test in held_out for warning in test.warnings]
    if outside:
        notes.append(say("relations-beyond", tests=", ".join(outside)))
    return Fit(
        model=model.name,
        hysteresis=levels[0].fit.hysteresis,
        form=model.equation,
        parameters=_parameters(model, levels),
        solver=SolverReport(
            method=method.name,
            weight=levels[0].fit.weight,
            loss=method.loss,
            evaluations=sum(level.fit.evaluations for level in levels),
            objective=sum(level.fit.objective for level in levels),
        ),
        evaluation=Evaluation(
            error=score_forces(fitted, [force(test) for test in fitted]),
            holdout=score_forces(held_out, [force(test) for test in held_out]) if held_out else None,
            adequate=together(fits(test) for test in (*fitted, *held_out)),
        ),
        uncertainty=Uncertainty(
            condition=max(level.fit.condition for level in levels),
            notes=(*levels[0].fit.notes, f"{related.dependence}: {EACH_ALONE}"),
        ),
        corrections=Corrections(current=related),
        diagnosis=_diagnosed(model, levels, state.options),
        warnings=tuple(notes),
    )


def _outside(fitted: Sequence[Measurement], held_out: Sequence[Measurement]) -> list[str]:
    """Held-out tests whose current lies beyond those of the fitted tests, at the lowest or highest of neither."""
    levels = set_of(fitted).currents
    room_A = levels.resolution_A[1]
    low, high = levels.values_A[0] - room_A, levels.values_A[-1] + room_A
    return [test.id for test in held_out if not low <= float(np.mean(test.current_A)) <= high]


def _diagnosed(model: DamperModel, levels: Sequence[Level], options: FitOptions) -> tuple[Cause, ...]:
    """What probably explains the misfit at the current where it is largest; units and signs of all tests."""
    worst = max(levels, key=lambda level: level.fit.error.nrmse_percent_of_peak)
    misfit = any(level.fit.adequate is False for level in levels) if options.diagnose is None else options.diagnose
    tests = [_without_current(test) for test in worst.tests]
    values = {name: value for name, value in worst.fit.values.items() if name != "eta"}
    names = tuple(examine(model, tests).free(values))
    fitted = Fitted(model, values, names, tests, options.how.weighting(model))
    causes = diagnose(fitted, misfit=misfit)
    return tuple(replace(cause, text=f"at {worst.name_A:g} A: {cause.text}") for cause in causes)


def _parameters(model: DamperModel, levels: Sequence[Level]) -> Mapping[str, Estimate]:
    names = [name for name in levels[0].fit.parameters if model.parameter(name).power == 0]
    return {
        f"{name} at {level.name_A:g} A": level.fit.parameters[name]
        for name in names
        for level in levels
        if name in level.fit.parameters
    }
