"""A fit as a value: what was found, how sure it is, how well it predicts, and what could not be found."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

import numpy as np

import rig.dampers
from rig.campaign_folder import CampaignFolder
from rig.dampers.arrays import FloatArray
from rig.dampers.model import DamperModel
from rig.dampers.parameter import Hysteresis
from rig.dampers.temperature_law import RATES, TemperatureLaw
from rig.errors import FileProblem, IdentificationFailed, RigError
from rig.fits.entries import (
    Cause,
    Corrections,
    Estimate,
    Evaluation,
    NextTest,
    SolverReport,
    TestedRange,
    Uncertainty,
)
from rig.fits.fit_file import FIX, fit_content, fit_text, read_fit
from rig.fits.formula import formula
from rig.fits.parameters import Parameters
from rig.fits.plain import APART, plain
from rig.fits.scores import Scores
from rig.signals.test_set import TestSetSummary

if TYPE_CHECKING:
    import pandas as pd

COIL = "eta"
"""The rate of the coil's lag: it belongs to the current, not to the force, and many tests do not determine it."""
Part = TypeVar("Part")


class _Of(Generic[Part]):
    """An attribute that one of the fit's parts has, under its own name: `fit.error` for `fit.evaluation.error`."""

    def __init__(self, get: Callable[[FitRecord], Part]) -> None:
        self._get = get

    def __get__(self, fit: FitRecord, kind: type[FitRecord]) -> Part:
        """The part's attribute."""
        return self._get(fit)


def fit_in(folder: Path) -> FitRecord | None:
    """The fit of a run by its folder; None when there is none.

    Raises:
        FileProblem: its `fit.json` is no fit; everything that is wrong with it.
    """
    return FitRecord.load(folder) if CampaignFolder(folder).fit.is_file() else None


@dataclass(frozen=True, repr=False)
class FitRecord:
    """A model fitted to a run; `fit["beta"]` is the estimate of a parameter.

    What the parts hold is also an attribute of the fit: `fit.error` is `fit.evaluation.error`.

    Attributes:
        model: name in `rig.dampers.MODELS`, a current law behind it (`asymmetric+saturating`).
        parameters: name to estimate, in the model's order.
        solver: how it was fitted.
        evaluation: errors on fitted and held-out tests, the models compared.
        uncertainty: correlation, profiles, bootstrap.
        corrections: series spring, relations to the current, temperature, the coil's lag.
        hysteresis: form of the tanh argument.
        form: the model's equation, as it was fitted, with its source; `equation` has the numbers too.
        diagnosis: what probably explains the misfit, most first; implausible units and signs before all.
        next_tests: tests worth running next.
        warnings: everything the reader should know before using the numbers.
        tested: what the fitted tests covered, and how far the model was off; None in files of earlier versions.
        test_set: currents and motions of the fitted tests as they are grouped, and the resolution of the current; None
            in files of earlier versions.
        path: where it was written; None when it was not.
        kept: where an older fit at that place is now; None when there was none.
        sha256: of the file it was read from (hex); empty otherwise.
    """

    model: str
    parameters: Mapping[str, Estimate]
    solver: SolverReport = field(default_factory=SolverReport)
    evaluation: Evaluation = field(default_factory=Evaluation)
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    corrections: Corrections = field(default_factory=Corrections)
    hysteresis: str = "kwok"
    form: str = ""
    diagnosis: tuple[Cause, ...] = ()
    next_tests: tuple[NextTest, ...] = ()
    warnings: tuple[str, ...] = ()
    tested: TestedRange | None = None
    test_set: TestSetSummary | None = field(default=None, repr=False)
    path: Path | None = field(default=None, metadata=APART)
    kept: Path | None = field(default=None, metadata=APART)
    sha256: str = field(default="", repr=False, compare=False, metadata=APART)

    method = _Of(lambda fit: fit.solver.method)
    weight = _Of(lambda fit: fit.solver.weight)
    loss = _Of(lambda fit: fit.solver.loss)
    evaluations = _Of(lambda fit: fit.solver.evaluations)
    wall_s = _Of(lambda fit: fit.solver.wall_s)
    objective = _Of(lambda fit: fit.solver.objective)
    error = _Of(lambda fit: fit.evaluation.error)
    holdout = _Of(lambda fit: fit.evaluation.holdout)
    adequate = _Of(lambda fit: fit.evaluation.adequate)
    selection = _Of(lambda fit: Scores(fit.evaluation.selection))
    references = _Of(lambda fit: fit.evaluation.references)
    residual_parts = _Of(lambda fit: fit.evaluation.error.residuals)
    passivity = _Of(lambda fit: fit.evaluation.passivity)
    unseen = _Of(lambda fit: fit.evaluation.unseen)
    correlation = _Of(lambda fit: fit.uncertainty.correlation)
    condition = _Of(lambda fit: fit.uncertainty.condition)
    notes = _Of(lambda fit: fit.uncertainty.notes)
    profiles = _Of(lambda fit: fit.uncertainty.profiles)
    drawn = _Of(lambda fit: fit.uncertainty.drawn)
    series = _Of(lambda fit: fit.corrections.series)
    current = _Of(lambda fit: fit.corrections.current)
    temperature = _Of(lambda fit: fit.corrections.temperature)
    coil_eta_1_s = _Of(lambda fit: fit.corrections.coil_eta_1_s)

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """A written fit: the path of a `fit.json`, or of the folder that holds it.

        Raises:
            FileProblem: there is no such file, or it is no fit; everything that is wrong with it.
        """
        return read_fit(cls, Path(path))

    def to_json(self) -> dict[str, Any]:
        """The keys of `rig identify --json`: plain types, no NaN or infinity (null instead)."""
        return fit_content(plain(self), self.evaluation, self.equation)

    @property
    def text(self) -> str:
        """The fit as it is written to a file."""
        return fit_text(self.to_json())

    def __repr__(self) -> str:
        """One line: model, number of tests, error, where it was written."""
        where = "" if self.path is None else f", {str(self.path)!r}"
        error = f"{len(self.error.per_test)} tests, RMSE {self.error.rmse_N:.3g} N"
        return f"{type(self).__name__}({self.model!r}, {len(self.parameters)} parameters, {error}{where})"

    def __getitem__(self, name: str) -> Estimate:
        """The estimate of a parameter: `fit["beta"].value`, `.standard_error`, `.low`, `.high`, `.unit`.

        Raises:
            NoSuchEntry: the model has no such parameter.
        """
        return self.params[name]

    def __iter__(self) -> Iterator[str]:
        """The names of the parameters."""
        return iter(self.parameters)

    def __contains__(self, name: object) -> bool:
        return name in self.parameters

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.parameters)

    @property
    def params(self) -> Parameters:
        """The parameters as a mapping with arrays, a printed table and `to_pandas()`."""
        return Parameters(self.parameters)

    @property
    def covariance(self) -> pd.DataFrame:
        """Covariance (SI) of the parameters and sums that these tests determine, (p, p), rows and columns by names."""
        import pandas as pd  # half a second that reading a fit does not need

        names, matrix = self.known_covariance()
        return pd.DataFrame(matrix, index=names, columns=names)

    def known_covariance(self) -> tuple[list[str], FloatArray]:
        """Names of the parameters that have standard errors, and their covariance (SI), shape (names, names)."""
        rows, known = self.correlation, self.parameters
        errors = {name: one.standard_error for name, one in known.items() if one.determined}
        names = [name for name, error in errors.items() if name in rows and error is not None]
        matrix = self.covariance_of(names)
        return ([], np.zeros((0, 0))) if matrix is None else (names, matrix)

    @property
    def values(self) -> dict[str, float]:
        """Parameter name to value (SI), those without a value left out."""
        return {name: estimate.value for name, estimate in self.parameters.items() if estimate.value is not None}

    @property
    def identifiable(self) -> tuple[str, ...]:
        """Names of the parameters that these tests determine."""
        return tuple(name for name, estimate in self.parameters.items() if estimate.identifiable)

    @property
    def equation(self) -> str:
        """The model's equation with the fitted numbers and units."""
        values = {name: (estimate.value, estimate.unit) for name, estimate in self.parameters.items()}
        return formula(self.form, values, self.current)

    @property
    def damper(self) -> DamperModel:
        """The fitted model.

        Raises:
            UnknownName: the model is not known here, such as a plug-in's that is not installed.
        """
        return rig.dampers.model(self.model, self.hysteresis_form)

    @property
    def hysteresis_form(self) -> Hysteresis:
        """The form of the tanh argument, as models take it; an unknown one is refused there."""
        return self.hysteresis  # type: ignore[return-value]  # a text of the file, checked where it is used

    @property
    def temperature_law(self) -> TemperatureLaw | None:
        """How warm oil weakens the damper; None where that was not fitted."""
        if self.temperature is None:
            return None
        rates = {name: self.values.get(name, 0.0) for name in RATES[self.temperature.law]}
        return TemperatureLaw(self.temperature.reference_degC, rates)

    def known_values(self, eta_1_s: float | None = None) -> dict[str, float]:
        """Values of all parameters of the model (SI), from one fit over all currents.

        Args:
            eta_1_s: rate of the coil's lag where the fit has none; None: the model's usual one.

        Raises:
            FileProblem: there is one fit for each current, or a parameter has no value; everything that is missing.
            UnknownName: the model is not known here.
        """
        file, model = str(self.path or "fit"), self.damper
        missing = [name for name in model.names if name not in self.values and name != COIL]
        reasons = {name: self.parameters[name].reason for name in missing if name in self.parameters}
        if self.current is not None:
            raise FileProblem(file, [
                f"got one fit per current ({self.current.dependence}), expected one fit for all currents. Fix: "
                "identify the run again with --current affine"
            ])  # fmt: skip
        if missing:
            raise FileProblem(file, [_without_values(model, missing, reasons, self.parameters), FIX])
        known = {name: self.values[name] for name in model.names if name in self.values}
        usual = model.parameter(COIL).start if COIL in model.names else 0.0
        return {name: known.get(name, usual if eta_1_s is None else eta_1_s) for name in model.names}

    def known_damper(self, eta_1_s: float | None = None) -> tuple[DamperModel, dict[str, float]]:
        """The fitted model with the values of all its parameters (SI), as a file that must hold a damper.

        Args:
            eta_1_s: as in `known_values`.

        Raises:
            FileProblem: the model is not known here, or as `known_values`.
        """
        try:
            model = self.damper
        except RigError as error:
            raise FileProblem(str(self.path or "fit"), [f"model: {error}", FIX]) from error
        return model, self.known_values(eta_1_s)

    def covariance_of(self, names: list[str]) -> FloatArray | None:
        """Covariance (SI), shape (names, names), of some parameters; None where one has no standard error."""
        errors = [self.parameters[name].standard_error if name in self.parameters else None for name in names]
        scale = np.array([math.nan if error is None else error for error in errors])
        if not np.all(np.isfinite(scale)):
            return None
        return np.asarray(self.correlation_matrix(names) * scale[:, None] * scale)

    def correlation_matrix(self, names: list[str]) -> FloatArray:
        """Correlations, shape (names, names), of some parameters; 0 where one is not known."""
        rows = self.correlation
        known = np.array([[rows.get(a, {}).get(b, 1.0 if a == b else 0.0) for b in names] for a in names])
        return np.asarray(np.nan_to_num(known.reshape(len(names), len(names))))

    def draws(self, names: Sequence[str], count: int, random: np.random.Generator) -> FloatArray:
        """Values (SI) of some parameters that the same tests could have given, by their covariance, (count, names).

        Each of them needs a value and a standard error.
        """
        rates, vectors = np.linalg.eigh(self.correlation_matrix(list(names)))
        root = vectors * np.sqrt(np.maximum(rates, 0.0))
        scale = np.array([self.parameters[name].standard_error for name in names], dtype=float)
        centre = np.array([self.values[name] for name in names])
        return np.asarray(centre + (random.standard_normal((count, len(names))) @ root.T) * scale)

    def at(self, temperature_degC: float) -> Self:
        """The same fit with its values, intervals and correlations at another temperature (degC).

        Values follow the rates exactly; errors follow by the slopes with values and rates, which are correlated.
        What takes no temperature (`simulate`, `inverse`, `controller`, `control_range`, a table without one) is then at
        that temperature, and states where it lies beyond the tests.

        Raises:
            IdentificationFailed: the fit has no temperature law, or the temperature is not valid.
        """
        term, law = self.temperature, self.temperature_law
        if term is None or law is None:
            raise IdentificationFailed("this fit has no temperature law. Fix: fit again with --temperature-law")
        if not -273.15 < temperature_degC < math.inf:
            raise IdentificationFailed(f"{temperature_degC:g} degC is not a valid temperature")
        model, warmer_K = self.damper, temperature_degC - term.reference_degC
        names = [name for name in self.correlation if self.parameters[name].standard_error is not None]
        factors = {one.name: math.exp(-law.rate_1_K(one) * warmer_K) for one in model.parameters}
        slopes = np.diag([factors.get(name, 1.0) for name in names])
        for parameter in (one for one in model.parameters if one.name in names):
            for rate in (name for name in law.rates if name in names and law.follows(parameter, name)):
                slope = -warmer_K * factors[parameter.name] * self.values[parameter.name]
                slopes[names.index(parameter.name), names.index(rate)] = slope
        errors, correlation = _moved(self, names, slopes)
        there = replace(law, reference_degC=temperature_degC)
        return replace(
            self,
            corrections=replace(self.corrections, temperature=replace(term, reference_degC=temperature_degC)),
            form=self.form.replace(law.formula(model), there.formula(model)),
            parameters={
                name: _scaled(one, factors.get(name, 1.0), errors.get(name)) for name, one in self.parameters.items()
            },
            uncertainty=replace(self.uncertainty, correlation=correlation),
        )


def _without_values(
    model: DamperModel, missing: Sequence[str], reasons: Mapping[str, str], given: Collection[str]
) -> str:
    """Why a file's parameters are not enough for its model; those of another model are named."""
    named = ", ".join(f"{name} ({reasons[name]})" if reasons.get(name) else name for name in missing)
    others = [name for name in given if name not in {*model.names, *chain(*RATES.values())}]
    if not others:
        return f"parameters: no value for {named}"
    return (
        f"parameters: got {', '.join(others)}, which model {model.name!r} does not have, and no value for {named}: the "
        "parameters belong to another model"
    )


def _moved(
    fit: FitRecord, names: list[str], slopes: FloatArray
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Standard errors and correlations of what has these slopes (n, n) with the fit's parameters `names`."""
    before = np.array([fit.parameters[name].standard_error for name in names], dtype=float)
    rows = [[fit.correlation[a].get(b) or 0.0 for b in names] for a in names]
    covariance = slopes @ (np.array(rows, dtype=float).reshape(slopes.shape) * np.outer(before, before)) @ slopes.T
    errors = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    known = np.clip(covariance / np.outer(errors, errors), -1.0, 1.0).tolist()
    return (
        dict(zip(names, errors.tolist(), strict=True)),
        {name: dict(zip(names, row, strict=True)) for name, row in zip(names, known, strict=True)},
    )


def _scaled(one: Estimate, factor: float, error: float | None) -> Estimate:
    """An estimate times a factor, its interval as wide as its error has become."""
    if one.value is None:
        return one
    value = factor * one.value
    wider = factor if error is None or not one.standard_error else error / one.standard_error
    middle = one.value

    def end(at: float | None) -> float | None:
        return None if at is None else value + wider * (at - middle)

    return replace(
        one, value=value, low=end(one.low), high=end(one.high), simultaneous_low=end(one.simultaneous_low),
        simultaneous_high=end(one.simultaneous_high),
        standard_error=None if one.standard_error is None else wider * one.standard_error,
    )  # fmt: skip
