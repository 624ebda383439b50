"""The chosen model and its residual: which of them is the fit, and how both are ranked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from rig.dampers.current_law import AFFINE
from rig.dampers.grey_box import GREY, named_parts
from rig.errors import IdentificationFailed
from rig.fits.entries import ModelScore, mean_within
from rig.identification.models.coverage import covered_by
from rig.identification.models.measurement import Measurement, set_of
from rig.identification.models.residual_fit import FEWEST_GROUPS, GAIN, NO_GAIN, ResidualFit, fit_residual
from rig.identification.models.solving import SEPARABLE, SQUARES, Candidate, Method, splits
from rig.identification.models.undetermined import Undetermined
from rig.identification.options import FitOptions
from rig.identification.remarks import Remark, say
from rig.identification.selection import describes, predicted
from rig.identification.uncertainty.scoring import misfits, rmse_N

NEARLY = 3.0  # times the error of the best physical model, on tests left out: a simpler one whose residual is tried


@dataclass(frozen=True)
class Ranked:
    """The fit's model after its residual was looked at.

    Attributes:
        ranking: the models compared, the fit's first.
        best: the fit's model: the physical one, alone or with a residual.
        remarks: why there is no residual, or what was done to it.
    """

    ranking: tuple[ModelScore, ...]
    best: Candidate
    remarks: tuple[Remark, ...] = ()


def refuse_residual(options: FitOptions) -> None:
    """Refuse options that do not go with a requested residual.

    Raises:
        IdentificationFailed: one of these.
    """
    if not options.grey or options.several:  # several models refuse these options themselves
        return
    conflicts = [
        *(["one fit per current"] if options.current != AFFINE else []),
        *options.corrections,
        *([f"loss {options.how.loss}"] if options.how.loss != SQUARES else []),
        *([f"method {options.how.name}"] if options.how.name != SEPARABLE else []),
    ]
    if conflicts:
        raise IdentificationFailed(
            f"model {options.model!r}: a residual cannot be combined with {', '.join(conflicts)}. Fix: omit one of "
            f"them; the method must be {SEPARABLE}"
        )


def compared_with_residual(
    best: Candidate, others: Sequence[Candidate], ranking: Sequence[ModelScore], tests: Sequence[Measurement],
    held_out: Sequence[Measurement], options: FitOptions,
) -> Ranked:
    """The chosen model, or a simpler one, with a residual if that predicts tests left out better, else alone.

    Held-out tests do not decide it: they validate the result.

    Args:
        best: the chosen model.
        others: all that were fitted; those that are fitted quickly and predict about as well are tried, too: what a
            simpler model leaves may be the easier to learn.
        ranking: the models compared.
        tests: the tests.
        held_out: held-out tests.
        options: what is asked of the fit.

    Raises:
        IdentificationFailed: the model cannot be fitted to the tests of a fold.
    """
    if named_parts(options.model) is None and options.model != GREY and describes(ranking[0], tests):
        return Ranked(tuple(ranking), best)  # nothing is left that a residual could learn
    options.report(f"fitting the residual of {best.model.name}")
    named = named_parts(options.model)
    parts = () if named is None else named[1]
    own = fit_residual(best.model, best.solution.values, tests, options.how, parts)
    tried = [(best, own)]
    for other in others if own.physical else ():
        if other.model is not best.model and splits(other.model, tests):
            residual = fit_residual(other.model, other.solution.values, tests, options.how, parts)
            if residual.grey and _mean(residual.physical) < NEARLY * _mean(own.physical):
                tried.append((other, residual))
    usable = [one for one in tried if not one[1].reason]
    base, residual = min(usable, key=lambda one: _mean(one[1].grey)) if usable else tried[0]
    reason = residual.reason
    if not reason and _mean(residual.grey) > (1.0 - GAIN) * _mean(own.physical):
        reason = NO_GAIN
    if reason:
        numbers = {"physical": _mean(own.physical), "grey": _mean(residual.grey), "model": base.model.name}
        remark = say(reason, **numbers, groups=len(set_of(tests).groups), needed=FEWEST_GROUPS)
        return Ranked(tuple(ranking), best, (remark,))
    grey = _candidate(base, residual)
    percent = 100.0 * residual.shrunk
    reduced = (say("residual-reduced", model=base.model.name, percent=percent),) if percent < 100.0 else ()
    score = _score(base, grey, residual, ranking, tests, held_out, options.how)
    return Ranked((score, *ranking), grey, reduced)


def _mean(errors: Sequence[float]) -> float:
    return sum(errors) / len(errors) if errors else math.nan


def _candidate(best: Candidate, residual: ResidualFit) -> Candidate:
    """The physical model's solution with the residual, whose parameters are kept from then on."""
    kept = tuple(residual.values)
    findings = Undetermined(
        set(best.findings.held),
        {**best.findings.fixed, **dict.fromkeys(kept, ())},
        {**best.findings.reasons, **{name: say("residual", name=name) for name in kept}},
    )
    solution = replace(best.solution, values={**best.solution.values, **residual.values})
    return Candidate(residual.model, findings, solution)


def _score(
    best: Candidate, grey: Candidate, residual: ResidualFit, ranking: Sequence[ModelScore],
    tests: Sequence[Measurement], held_out: Sequence[Measurement], method: Method,
) -> ModelScore:
    """How the model with its residual is ranked: by the tests left out, or by the held-out ones."""
    misfit = misfits(grey.model, grey.solution.values, tests)
    samples, error_N = sum(test.samples for test in misfit), rmse_N(misfit)
    free = len(best.findings.free(best.solution.values)) + sum(1 for name, value in residual.values.items()
                                                               if name.startswith("g_") and value)  # fmt: skip
    outside = next((one.beyond for one in ranking if one.model == best.model.name), {})
    errors = [(error, tuple(outside.get(test.id, ()))) for test, error in zip(tests, residual.grey, strict=True)]
    if held_out:
        unseen = predicted(grey.model, grey.solution.values, held_out, covered_by(tests))
        errors = [(one.nrmse_percent_of_peak, one.beyond) for one in unseen]
        outside = {one.id: one.beyond for one in unseen if one.beyond}
    return ModelScore(
        grey.model.name, _mean([error for error, _ in errors]),
        samples * math.log(max(error_N, 1e-300) ** 2) + free * math.log(samples), error_N, free, method.name,
        within_nrmse_percent_of_peak=mean_within(errors), beyond=outside,
    )  # fmt: skip
