"""A fit as a value: what was found, how sure it is, how well it predicts, and what could not be found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.dampers.current_law import AFFINE
from rig.dampers.lawed_model import PLUS
from rig.identification.application.tested_range import TestedRange
from rig.identification.models.measurement import Measurement
from rig.identification.models.relation import CurrentRelations
from rig.identification.uncertainty.drawn import Drawn
from rig.identification.uncertainty.fit_entries import (
    Cause,
    ErrorSummary,
    Estimate,
    ModelScore,
    NextTest,
    Passivity,
    SeriesSpring,
    TestError,
)
from rig.identification.uncertainty.fit_file import (
    entries_of,
    estimate_entry,
    number,
    plain,
    read_fit_object,
    record,
    summary_entry,
)
from rig.identification.uncertainty.fit_use import FitUse
from rig.identification.uncertainty.no_model import Reference
from rig.identification.uncertainty.residuals import Residual
from rig.identification.uncertainty.temperature_term import TemperatureTerm
from rig.identification.uncertainty.unseen import Unseen

if TYPE_CHECKING:
    from rig.identification.uncertainty.profile import Profile


INTERVAL = "95 % interval (each parameter by itself)"


@dataclass(frozen=True)
class Fit(FitUse):
    """A model fitted to a run.

    Attributes:
        model: name in `rig.dampers.MODELS`, a current law behind it (`asymmetric+saturating`).
        hysteresis: form of the tanh argument.
        method: how it was fitted.
        weight: "1" or "v" (equation 12), or "relative" (each test by its relative error).
        parameters: name to estimate, in the model's order.
        error: on the tests it was fitted to.
        holdout: on the tests it has not seen; None without any.
        selection: the models compared, best first.
        references: the mean cycle and a regression beside them; none where one model was fitted.
        adequate: whether the model describes the data down to their noise; None where no test has two cycles to tell.
        warnings: everything the reader should know before using the numbers.
        evaluations: evaluations of equation (12) that the solution took; comparing and judging are not counted.
        wall_s: wall time (s).
        objective: equation (12) at the solution, with the fit's weight and those of its loss.
        condition: condition number of the scaled normal matrix.
        correlation: parameter names to names to correlation.
        notes: how the intervals were made.
        residuals: what each fitted test's residual consists of, in the order of `error.per_test`.
        passivity: where the fitted model takes energy out; None when it was not looked at.
        profiles: profile likelihoods that were asked for, by parameter.
        next_tests: tests worth running next.
        diagnosis: what probably explains the misfit, most first; implausible units and signs before all.
        drawn: the tests drawn again, where a bootstrap was asked for.
        series: spring in series with the damper, where it was looked for; the parameters are the damper's behind it.
        current: relations to the current of parameters fitted at each current alone; None for a model affine in it.
        loss: "squares" or "huber".
        temperature: how the damper follows its temperature, by rates among `parameters`; None where not looked for.
        unseen: errors of tests foretold from the others, where that was asked for; None otherwise.
        form: the model's equation, as it was fitted, with its source; `equation` has the numbers too.
        tested: what the fitted tests covered, and how far the model was off; None in files of earlier versions.
        coil_eta_1_s: rate (1/s) at which the coil's current follows its command, found with the force model where the
            current was commanded and not measured; None otherwise.
        test_set: currents and motions of the fitted tests as they are grouped, and the resolution of the current
            (`rig.signals.test_set`); None in files of earlier versions.
        tests: one cycle of each fitted test, for figures; empty in a loaded fit.
        path: where it was written; None when it was not.
        kept: where an older fit at that place is now; None when there was none.
    """

    model: str
    hysteresis: str
    method: str
    weight: str
    parameters: Mapping[str, Estimate]
    error: ErrorSummary
    holdout: ErrorSummary | None
    selection: tuple[ModelScore, ...]
    adequate: bool | None
    warnings: tuple[str, ...]
    evaluations: int
    wall_s: float
    objective: float
    condition: float
    correlation: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    references: tuple[Reference, ...] = ()
    residuals: tuple[Residual, ...] = ()
    passivity: Passivity | None = None
    profiles: Mapping[str, Profile] = field(default_factory=dict)
    next_tests: tuple[NextTest, ...] = ()
    diagnosis: tuple[Cause, ...] = ()
    drawn: Drawn | None = None
    series: SeriesSpring | None = None
    current: CurrentRelations | None = None
    loss: str = "squares"
    temperature: TemperatureTerm | None = None
    unseen: Unseen | None = None
    form: str = ""
    tested: TestedRange | None = None
    coil_eta_1_s: float | None = None
    test_set: Mapping[str, Any] | None = field(default=None, repr=False)
    tests: tuple[Measurement, ...] = field(default=(), repr=False, compare=False)
    path: Path | None = None
    kept: Path | None = None

    @classmethod
    def load(cls, path: Path | str) -> Fit:
        """A written fit: the path of a `fit.json`, or of the campaign's folder that holds it.

        Raises:
            FileProblem: there is no such file, or it is no fit; everything that is wrong with it.
        """
        from rig.identification.uncertainty.profile import Profile

        file, content = read_fit_object(Path(path))
        with entries_of(file):
            error, holdout = content["error"], content["error"].get("holdout")
            related, tested, spring = (content.get(key) for key in ("current", "tested", "series_spring"))
            passive = content.get("passivity")
            parameters = {name: record(Estimate, entry) for name, entry in content["parameters"].items()}
            residuals = [test["residual"] for test in error["per_test"] if "residual" in test]
            return record(
                cls,
                content,
                parameters=parameters,
                error=_read_summary(error),
                holdout=None if holdout is None else _read_summary(holdout),
                selection=tuple(_read_score(score) for score in content.get("selection") or ()),
                references=tuple(record(Reference, one) for one in content.get("references") or ()),
                residuals=tuple(record(Residual, entry) for entry in residuals),
                passivity=None if passive is None else record(Passivity, passive),
                profiles={name: record(Profile, entry) for name, entry in (content.get("profiles") or {}).items()},
                next_tests=tuple(record(NextTest, entry) for entry in content.get("next_tests") or ()),
                diagnosis=tuple(record(Cause, entry) for entry in content.get("diagnosis") or ()),
                temperature=TemperatureTerm.from_json(content.get("temperature")),
                unseen=Unseen.from_json(content.get("unseen")),
                series=None if spring is None else record(SeriesSpring, spring),
                current=CurrentRelations.from_json(related),
                drawn=Drawn.from_json(content.get("bootstrap")),
                form=str(content.get("equation", "")),
                tested=None if tested is None else TestedRange.from_json(tested),
                path=file,
            )

    @property
    def values(self) -> dict[str, float]:
        """Parameter name to value (SI), those without a value left out."""
        return {name: estimate.value for name, estimate in self.parameters.items() if estimate.value is not None}

    @property
    def identifiable(self) -> tuple[str, ...]:
        """Names of the parameters that these tests determine."""
        return tuple(name for name, estimate in self.parameters.items() if estimate.identifiable)

    def to_json(self) -> dict[str, Any]:
        """The keys of `rig identify --json`: plain types, no NaN or infinity (null instead)."""
        error = summary_entry(self.error)
        for entry, residual in zip(error["per_test"], self.residuals, strict=False):
            entry["residual"] = plain(residual)
        error["holdout"] = None if self.holdout is None else summary_entry(self.holdout) | {
            "within_nrmse_percent_of_peak": number(self.holdout.within_nrmse_percent_of_peak),
        }  # fmt: skip
        scores = [
            {
                "model": score.model,
                "holdout_nrmse_percent_of_peak": number(score.holdout_nrmse_percent_of_peak),
                "within_nrmse_percent_of_peak": number(score.within_nrmse_percent_of_peak),
                "beyond": {test: list(names) for test, names in score.beyond.items()},
                "bic": number(score.bic),
                "rmse_N": number(score.rmse_N),
                "parameters": score.parameters,
                "method": score.method,
                "reason": score.reason,
            }
            for score in self.selection
        ]
        return {
            "model": self.model,
            "equation": self.form,
            "formula": self.equation,
            "interval": INTERVAL,
            "method": self.method,
            "hysteresis": self.hysteresis,
            "weight": self.weight,
            "loss": self.loss,
            "parameters": {name: estimate_entry(estimate) for name, estimate in self.parameters.items()},
            "error": error,
            "selection": scores,
            "references": [plain(reference) for reference in self.references],
            "adequate": self.adequate,
            "warnings": list(self.warnings),
            "evaluations": self.evaluations,
            "wall_s": self.wall_s,
            "objective": number(self.objective),
            "condition": number(self.condition),
            "correlation": {name: {k: number(v) for k, v in row.items()} for name, row in self.correlation.items()},
            "passivity": None if self.passivity is None else plain(self.passivity),
            "profiles": {name: vars(profile) for name, profile in self.profiles.items()},
            "next_tests": [plain(proposal) for proposal in self.next_tests],
            "bootstrap": None if self.drawn is None else self.drawn.to_json(),
            "temperature": None if self.temperature is None else plain(self.temperature),
            "unseen": None if self.unseen is None else self.unseen.to_json(),
            "diagnosis": [plain(cause) for cause in self.diagnosis],
            "current": {"dependence": "affine"} if self.current is None else self.current.to_json(),
            "current_law": self.model.partition(PLUS)[2] or AFFINE,
            "series_spring": None if self.series is None else plain(self.series),
            "tested": None if self.tested is None else self.tested.to_json(),
            "coil_eta_1_s": number(self.coil_eta_1_s),
            "test_set": None if self.test_set is None else dict(self.test_set),
            "notes": list(self.notes),
        }


def _read_score(entry: Mapping[str, Any]) -> ModelScore:
    """A model's score; an earlier version does not tell what lay beyond."""
    told = {test: tuple(names) for test, names in (entry.get("beyond") or {}).items()}
    return record(ModelScore, entry, beyond=told)


def _read_summary(entry: Mapping[str, Any]) -> ErrorSummary:
    """The inverse of `summary_entry`."""
    return record(ErrorSummary, entry, per_test=tuple(record(TestError, test) for test in entry["per_test"]))
