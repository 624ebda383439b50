"""One fit a current, then each parameter as a function of the current (paper 2): affine, polynomial or Lagrange.

Fitted at one current, a model needs no terms per ampere: the tests of a level are taken as tests without current, and
what a current-dependent parameter is there is its value at zero. Between the levels a parameter follows its relation;
parameters of the shape never leave the range of the fitted ones, because a polynomial may swing where a loop cannot.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.dampers.model import DamperModel
from rig.errors import IdentificationFailed
from rig.identification.models.measurement import Measurement, set_of
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.relation import CurrentRelations, Relation, relations
from rig.identification.models.solving import Candidate, solve
from rig.identification.models.undetermined import examine
from rig.identification.uncertainty.assessment import Wanted, judged
from rig.identification.uncertainty.fit import Fit
from rig.identification.uncertainty.fit_entries import Cause, Estimate
from rig.identification.uncertainty.scoring import describes, score_forces, together
from rig.identification.words import say
from rig.matrix.methods import DEPENDENCES
from rig.signals.test_set import rounded_levels

AFFINE = "affine"
PER_CURRENT = {name: name.removeprefix("per-current-") for name in DEPENDENCES if name != AFFINE}


@dataclass(frozen=True)
class Level:
    """The tests of one current, and the model fitted to them as if they ran without; `name_A` is its label."""

    current_A: float
    name_A: float
    tests: tuple[Measurement, ...]
    fit: Fit


def identify_per_current(
    model: DamperModel,
    fitted: Sequence[Measurement],
    held_out: Sequence[Measurement],
    dependence: str,
    wanted: Wanted,
    on_progress: Callable[[str], None] | None = None,
) -> Fit:
    """Fit a model at each current and relate its parameters to the current.

    Args:
        model: the damper model.
        fitted: tests at two or more constant currents.
        held_out: tests to score the relations on.
        dependence: a key of `PER_CURRENT`.
        wanted: how each current is fitted, and what is asked of the fit.
        on_progress: called with a line of text before each current.

    Returns:
        A fit whose parameters are named `NAME at I A`, with the relations in `current`.

    Raises:
        IdentificationFailed: fewer than two currents, a current that changes within a test, or a current at which
            nothing can be identified; the message names it.
    """
    if dependence not in PER_CURRENT:
        raise IdentificationFailed(f"unknown current dependence {dependence!r}; known: {', '.join(DEPENDENCES)}")
    levels = []
    for current_A, name_A, tests in _levels(fitted):
        if on_progress is not None:
            on_progress(f"fitting {model.name} at {name_A:g} A ({len(tests)} tests)")
        levels.append(Level(current_A, name_A, tuple(tests), _fit_level(model, name_A, tests, wanted)))
    if len(levels) < 2:
        raise IdentificationFailed(
            f"{dependence} needs tests at two or more currents, and all ran at {levels[0].name_A:g} A; add tests "
            "at another current, or fit without this option"
        )
    related = _relations(model, levels, PER_CURRENT[dependence])
    return _joined(model, levels, related, held_out, wanted)


def _levels(tests: Sequence[Measurement]) -> list[tuple[float, float, list[Measurement]]]:
    """Tests by their current (A), rising, with its label (A).

    Raises:
        IdentificationFailed: the current of a test changes.
    """
    levels = set_of(tests).currents
    for number in levels.changing[:1]:
        test = tests[number]
        raise IdentificationFailed(
            f"{test.id}: its current changes from {np.min(test.current_A):.2f} to {np.max(test.current_A):.2f} A; "
            "a fit for each current needs constant currents"
        )
    names_A = rounded_levels(levels.values_A)
    return [
        (levels.values_A[level], names_A[level], [tests[number] for number in levels.members(level)])
        for level in range(len(levels))
    ]


def _without_current(test: Measurement) -> Measurement:
    return replace(test, current_A=np.zeros_like(test.current_A), nominal_current_A=0.0)


def _fit_level(model: DamperModel, name_A: float, tests: Sequence[Measurement], wanted: Wanted) -> Fit:
    """One current's fit.

    Raises:
        IdentificationFailed: nothing can be identified at this current; the message names it.
    """
    still, method = [_without_current(test) for test in tests], wanted.method
    findings = examine(model, still)
    try:
        best = Candidate(model, findings, solve(model, still, method, findings))
        return judged(best, still, [], (), Wanted(method, wanted.declared))
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
    held_out: Sequence[Measurement],
    wanted: Wanted,
) -> Fit:
    """The levels and their relations as one fit, scored with the relations."""
    fitted = [test for level in levels for test in level.tests]

    def force(test: Measurement) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        values = related.values_at(model, float(np.mean(test.current_A)))
        return np.asarray(modelled_force(model, values, _without_current(test)))

    def fits(test: Measurement) -> bool | None:
        values = related.values_at(model, float(np.mean(test.current_A)))
        return describes(model, values, [_without_current(test)], wanted.method.weighting(model))

    outside = _outside(fitted, held_out)
    notes = list(wanted.warnings) + [
        f"at {level.name_A:g} A: {text}" for level in levels for text in level.fit.warnings
    ]
    notes += [f"{test.id}: {saying}" for test in held_out for saying in test.warnings]
    if outside:
        notes.append(say("relations-beyond", tests=", ".join(outside)))
    return Fit(
        model=model.name,
        hysteresis=levels[0].fit.hysteresis,
        method=wanted.method.name,
        weight=levels[0].fit.weight,
        loss=wanted.method.loss,
        parameters=_parameters(model, levels),
        error=score_forces(fitted, [force(test) for test in fitted]),
        holdout=score_forces(held_out, [force(test) for test in held_out]) if held_out else None,
        selection=(),
        adequate=together(fits(test) for test in (*fitted, *held_out)),
        warnings=tuple(notes),
        evaluations=sum(level.fit.evaluations for level in levels),
        wall_s=time.perf_counter() - wanted.started_s,
        objective=sum(level.fit.objective for level in levels),
        condition=max(level.fit.condition for level in levels),
        notes=(*levels[0].fit.notes, f"{related.dependence}: each current fitted alone, then related to the current"),
        current=related,
        diagnosis=_diagnosed(model, levels, wanted),
        form=model.equation,
    )


def _outside(fitted: Sequence[Measurement], held_out: Sequence[Measurement]) -> list[str]:
    """Held-out tests whose current lies beyond those of the fitted tests, at the lowest or highest of neither."""
    levels = set_of(fitted).currents
    room_A = levels.resolution_A[1]
    low, high = levels.values_A[0] - room_A, levels.values_A[-1] + room_A
    return [test.id for test in held_out if not low <= float(np.mean(test.current_A)) <= high]


def _diagnosed(model: DamperModel, levels: Sequence[Level], wanted: Wanted) -> tuple[Cause, ...]:
    """What probably explains the misfit at the current where it is largest; units and signs of all tests."""
    from rig.identification.diagnosis.ranking import diagnose
    from rig.identification.diagnosis.trials import Fitted

    worst = max(levels, key=lambda level: level.fit.error.nrmse_percent_of_peak)
    misfit = any(level.fit.adequate is False for level in levels) if wanted.diagnose is None else wanted.diagnose
    tests = [_without_current(test) for test in worst.tests]
    values = {name: value for name, value in worst.fit.values.items() if name != "eta"}
    names = tuple(examine(model, tests).free(values))
    fitted = Fitted(model, values, names, tests, wanted.method.weighting(model))
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
