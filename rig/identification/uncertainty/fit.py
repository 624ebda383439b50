"""A fit as a value: what was found, how sure it is, how well it predicts, and what could not be found."""

from __future__ import annotations

import math
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
from rig.identification.uncertainty.unseen import Unseen

if TYPE_CHECKING:
    from rig.identification.uncertainty.profile import Profile


INTERVAL = "95 % interval (each parameter by itself)"


@dataclass(frozen=True)
class Estimate:
    """One parameter.

    Attributes:
        value: estimate in `unit`; None where nothing can be said.
        unit: SI unit.
        low: lower end of the 95 % interval of this parameter by itself, the one that is shown; None when not
            identifiable.
        high: upper end; a parameter held at its lower limit has this end alone.
        simultaneous_low: lower end of the interval that holds for all identifiable parameters together with 95 %.
        simultaneous_high: upper end.
        standard_error: standard error in `unit`.
        identifiable: whether these tests determine it.
        reason: why not; empty when they do.
        variance_inflation: by how much the other parameters widen its variance (1: not at all).
    """

    value: float | None
    unit: str
    low: float | None = None
    high: float | None = None
    simultaneous_low: float | None = None
    simultaneous_high: float | None = None
    standard_error: float | None = None
    identifiable: bool = True
    reason: str = ""
    variance_inflation: float | None = None


@dataclass(frozen=True)
class TestError:
    """How well the model gives one test's force back.

    Attributes:
        id: the test's id.
        file: its file.
        rmse_N: root mean square error (N).
        mae_N: mean absolute error (N).
        nrmse_percent_of_peak: 100 rmse / max|F - mean F|.
        noise_N: scatter of the force from cycle to cycle (N); None when unknown.
        samples: number of samples.
        energy_J: energy dissipated in a mean cycle, measured (J); NaN where a stretch of every cycle has no force.
        modelled_energy_J: the same by the model (J).
    """

    __test__ = False  # pytest takes classes called Test for its own

    id: str
    file: str
    rmse_N: float
    mae_N: float
    nrmse_percent_of_peak: float
    noise_N: float | None
    samples: int
    energy_J: float
    modelled_energy_J: float


@dataclass(frozen=True)
class ErrorSummary:
    """Errors over some tests: all samples together, and each test.

    Attributes:
        rmse_N: root mean square error over all samples (N).
        mae_N: mean absolute error over all samples (N).
        sd_N: standard deviation of the error (N).
        r_squared: share of the force's variance that the model explains.
        nrmse_percent_of_peak: mean over tests of their relative errors.
        per_test: one entry a test.
    """

    rmse_N: float
    mae_N: float
    sd_N: float
    r_squared: float
    nrmse_percent_of_peak: float
    per_test: tuple[TestError, ...]


@dataclass(frozen=True)
class ModelScore:
    """One model in the comparison: held-out error (None without held-out tests) and Bayesian information criterion.

    A model that was not fitted to the end has its reason, and neither of them.
    """

    model: str
    holdout_nrmse_percent_of_peak: float | None
    bic: float
    rmse_N: float
    parameters: int
    method: str
    reason: str = ""


@dataclass(frozen=True)
class Passivity:
    """Where the fitted model takes energy out, over the tested speeds (both ways) and currents.

    Attributes:
        share: share of the envelope with F v >= 0, gas force and springs left out.
        worst: what happens elsewhere, in words; empty when `share` is 1.
    """

    share: float
    worst: str


@dataclass(frozen=True)
class NextTest:
    """A test worth running next.

    Attributes:
        parameter: whose interval it shrinks most.
        text: which test, and what it is expected to do.
        toml: lines to append to a matrix file.
        standard_error: of the parameter now, in its unit; None where it is not known.
        expected_error: the same after that test; None where there is none to compare with.
    """

    parameter: str
    text: str
    toml: str
    standard_error: float | None
    expected_error: float | None


@dataclass(frozen=True)
class Cause:
    """What probably explains a misfit, or data that no damper gives.

    Attributes:
        slug: which cause; see docs/json.md.
        text: what was found, with its numbers.
        explains: share of the misfit beyond the noise that it explains (0 to 1); 1 for units and signs, 0 for what
            these tests cannot show.
        next: what to measure or mend.
    """

    slug: str
    text: str
    explains: float
    next: str


@dataclass(frozen=True)
class SeriesSpring:
    """A spring in series with the damper, and its 95 % interval (N/m); all None where none is seen."""

    stiffness_N_m: float | None
    low: float | None
    high: float | None

    def widened(self, variance: float, relative: float) -> SeriesSpring:
        """The same where the residual's correlation and misfit multiply the variance of its compliance.

        Args:
            variance: that factor.
            relative: half width (1), as a share of the compliance, that is added to it in squares.
        """
        if self.stiffness_N_m is None or self.low is None or self.high is None:
            return self
        compliance = 1.0 / self.stiffness_N_m
        half = math.hypot(0.5 * math.sqrt(variance) * (1.0 / self.low - 1.0 / self.high), relative * compliance)
        high = 1.0 / (compliance - half) if half < compliance else math.inf
        return SeriesSpring(self.stiffness_N_m, 1.0 / (compliance + half), high)


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
        unseen: errors of tests foretold from the others, where that was asked for; None otherwise.
        form: the model's equation, as it was fitted, with its source; `equation` has the numbers too.
        tested: what the fitted tests covered, and how far the model was off; None in files of earlier versions.
        coil_eta_1_s: rate (1/s) at which the coil's current follows its command, found with the force model where the
            current was commanded and not measured; None otherwise.
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
    unseen: Unseen | None = None
    form: str = ""
    tested: TestedRange | None = None
    coil_eta_1_s: float | None = None
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
                selection=tuple(record(ModelScore, score) for score in content.get("selection") or ()),
                references=tuple(record(Reference, one) for one in content.get("references") or ()),
                residuals=tuple(record(Residual, entry) for entry in residuals),
                passivity=None if passive is None else record(Passivity, passive),
                profiles={name: record(Profile, entry) for name, entry in (content.get("profiles") or {}).items()},
                next_tests=tuple(record(NextTest, entry) for entry in content.get("next_tests") or ()),
                diagnosis=tuple(record(Cause, entry) for entry in content.get("diagnosis") or ()),
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
        error["holdout"] = None if self.holdout is None else summary_entry(self.holdout)
        scores = [
            {
                "model": score.model,
                "holdout_nrmse_percent_of_peak": number(score.holdout_nrmse_percent_of_peak),
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
            "unseen": None if self.unseen is None else self.unseen.to_json(),
            "diagnosis": [plain(cause) for cause in self.diagnosis],
            "current": {"dependence": "affine"} if self.current is None else self.current.to_json(),
            "current_law": self.model.partition(PLUS)[2] or AFFINE,
            "series_spring": None if self.series is None else plain(self.series),
            "tested": None if self.tested is None else self.tested.to_json(),
            "coil_eta_1_s": number(self.coil_eta_1_s),
            "notes": list(self.notes),
        }


def _read_summary(entry: Mapping[str, Any]) -> ErrorSummary:
    """The inverse of `summary_entry`."""
    return record(ErrorSummary, entry, per_test=tuple(record(TestError, test) for test in entry["per_test"]))
