"""A damper that warm oil weakens: rates of the temperature found with the model, tests corrected to one temperature.

The model is fitted to forces as they were at the reference temperature, the mean of the tests: the measured force less
what the recorded temperature changes of the modelled one. Rates and model follow each other (the rates by the slopes of
the residual without what the model's own columns explain) until neither moves. What the rates leave uncertain is added
to the intervals of the parameters that they move, and what the form of the law does to both: an exponential, a straight
line and Arrhenius' law differ by less than such tests tell, and by more than their noise leaves open.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.current_law import AFFINE
from rig.dampers.model import DamperModel
from rig.dampers.temperature_law import COMMON, RATES, TemperatureLaw
from rig.errors import IdentificationFailed
from rig.fits.entries import Estimate, TemperatureTerm
from rig.identification.fit_state import FitState
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import modelled_force, parameter_slopes
from rig.identification.models.solving import SEPARABLE, SQUARES, Method, Refit
from rig.identification.models.temperature_effect import force_change_N
from rig.identification.models.undetermined import Undetermined, examine
from rig.identification.options import FitOptions
from rig.identification.uncertainty.covariance import quantile
from rig.identification.uncertainty.fit import Fit
from rig.identification.uncertainty.scoring import score_forces
from rig.optimisers.least_squares import SINGULAR, Eliminated

TEMPERATURE = "temperature_law"
LEAST_SPAN_K = 3.0  # of the recorded temperature, over all fitted tests
COLDEST_degC, WARMEST_degC = -60.0, 230.0  # of dampers; 0 degC is 273 K
ROUNDS = 15
SETTLED = 0.01  # standard errors by which a rate may still move
STEP_1_K = 1e-5
MOST_1_K = 0.2  # of any rate: oil ten times as thin in 12 K
UNIDENTIFIED = 0.5  # standard error of a rate times the span from which the tests do not tell it


@dataclass(frozen=True)
class TemperatureCorrection:
    """What the tests tell of a damper's temperature.

    Attributes:
        law: the rates at their reference.
        kind: which of `RATES`.
        values: of the model at the reference temperature.
        ends_degC: lowest and highest recorded temperature of the fitted tests.
        names: of the model's parameters that the rates move.
        covariance: of the rates, as if the residual were white, shape (k, k).
        moves: change of each of `names` with each rate, shape (p, k).
        form: change of `names` and then of the rates where the law is bent by one (`TemperatureLaw.bend`), (p + k,).
    """

    law: TemperatureLaw
    kind: str
    values: Mapping[str, float]
    ends_degC: tuple[float, float]
    names: tuple[str, ...]
    covariance: FloatArray
    moves: FloatArray
    form: FloatArray

    def corrected(self, model: DamperModel, tests: Sequence[Measurement]) -> list[Measurement]:
        """The tests with their force as it was at the reference temperature."""
        return _corrected(model, self.values, self.law, tests)


def refuse(options: FitOptions) -> None:
    """Refuse an unknown temperature law, and options that none goes with.

    Raises:
        IdentificationFailed: either.
    """
    law = options.setting(TEMPERATURE)
    if law not in RATES:
        raise IdentificationFailed(f"temperature law: got {law!r}, expected one of {', '.join(RATES)}")
    conflicts = [
        *(["one fit per current"] if options.current != AFFINE else []),
        *(["profiles"] if options.profile else []),
        *(["bootstrap"] if options.bootstrap else []),
        *(name for name in options.corrections if name != TEMPERATURE),
        *([f"method {options.how.name}"] if options.how.name != SEPARABLE else []),
    ]
    if conflicts:
        raise IdentificationFailed(
            f"temperature law: cannot be combined with {', '.join(conflicts)}. Fix: omit one of them; the method must "
            f"be {SEPARABLE}"
        )
    if options.several:
        raise IdentificationFailed("temperature law: needs one model. Fix: name one model, such as `asymmetric`")


def prepare(state: FitState) -> FitState:
    """What the temperature does, and the tests as they were at one temperature.

    Raises:
        IdentificationFailed: as `find_temperature_law`; a held-out test has no temperature.
    """
    refuse_without(state.held_out)
    model, options = state.models[0], state.options
    softening = find_temperature_law(model, state.fitted, options.how, options.setting(TEMPERATURE))
    measured = (softening, state.fitted, state.held_out)
    return state.with_found(TEMPERATURE, measured).corrected(lambda tests: softening.corrected(model, tests))


def refuse_without(tests: Sequence[Measurement]) -> list[FloatArray]:
    """The recorded temperatures (degC) of each test.

    Raises:
        IdentificationFailed: a test has none, or one that no damper has.
    """
    known = [_finite(test) for test in tests]
    missing = [test.id for test, values in zip(tests, known, strict=True) if not values.size]
    if missing:
        raise IdentificationFailed(
            f"temperature law: {len(missing)} of {len(tests)} tests have no recorded temperature "
            f"({', '.join(missing[:3])}). Fix: omit these tests, or fit without a temperature law"
        )
    strange = [
        f"{test.id}: {np.min(values):.4g} to {np.max(values):.4g}"
        for test, values in zip(tests, known, strict=True)
        if np.min(values) < COLDEST_degC or np.max(values) > WARMEST_degC
    ]
    if strange:
        raise IdentificationFailed(
            f"temperature law: {len(strange)} of {len(tests)} tests have implausible temperatures "
            f"({', '.join(strange[:3])} degC; expected {COLDEST_degC:g} to {WARMEST_degC:g}). Fix: specify kelvin "
            "on import (`--column temperature=NAME:K`), or omit tests with a failed sensor"
        )
    return known


def recorded_ends(tests: Sequence[Measurement]) -> tuple[float, float]:
    """Lowest and highest recorded temperature (degC) of the tests.

    Raises:
        IdentificationFailed: a test has none, or they hardly differ.
    """
    known = refuse_without(tests)
    low, high = (float(end([end(values) for values in known])) for end in (np.min, np.max))
    if high - low < LEAST_SPAN_K:
        raise IdentificationFailed(
            f"temperature law: the tests cover {low:.4g} to {high:.4g} degC, expected a span of at least "
            f"{LEAST_SPAN_K:g} K. Fix: add tests with the same motion on the warm damper"
        )
    return low, high


def find_temperature_law(
    model: DamperModel, tests: Sequence[Measurement], method: Method, kind: str
) -> TemperatureCorrection:
    """The rates that explain the tests best with this model.

    Raises:
        IdentificationFailed: no or hardly any temperature was recorded, the model cannot be fitted, no parameter of it
            softens, the loss is not that of least squares, or the tests do not tell the rates.
    """
    if method.loss != SQUARES:
        raise IdentificationFailed(f"temperature law: needs least squares, got loss {method.loss!r}")
    ends_degC = recorded_ends(tests)
    reference = float(np.mean([np.mean(_finite(test)) for test in tests]))
    search = _Search(model, tests, method, examine(model, tests))
    law = TemperatureLaw(reference, dict.fromkeys(RATES[kind], 0.0))
    if len(law.formula(model).split("; ")) < len(law.rates) or not law.formula(model):
        raise IdentificationFailed(
            f"temperature law {kind!r}: {model.name} has no parameter that depends on temperature in this way"
        )
    refit = Refit(model, method, search.findings)
    solution = refit(tests)
    for _ in range(ROUNDS):
        values = solution.values
        names = search.free(values, (*solution.at_bound, *solution.at_limit))
        step, covariance, moves, form = search.step(law, values, names)
        rates = {name: float(np.clip(rate + move, -MOST_1_K, MOST_1_K))
                 for (name, rate), move in zip(law.rates.items(), step, strict=True)}  # fmt: skip
        law = replace(law, rates=rates)
        solution = refit(_corrected(model, values, law, tests))
        if np.all(np.abs(step) <= SETTLED * np.sqrt(np.diag(covariance))):
            break
    _refuse_unidentified(law, covariance, ends_degC)
    return TemperatureCorrection(law, kind, solution.values, ends_degC, names, covariance, moves, form)


def _refuse_unidentified(law: TemperatureLaw, covariance: FloatArray, ends_degC: tuple[float, float]) -> None:
    errors = np.sqrt(np.diag(covariance)) * (ends_degC[1] - ends_degC[0])
    far = [name for name, error in zip(law.rates, errors, strict=True) if not error < UNIDENTIFIED]
    if far or any(abs(rate) >= MOST_1_K for rate in law.rates.values()):
        other = "" if len(law.rates) == 1 else f", or fit one common rate ('common', {COMMON!r})"
        raise IdentificationFailed(
            f"temperature law: {ends_degC[0]:.4g} to {ends_degC[1]:.4g} degC are not enough to identify "
            f"{', '.join(far or law.rates)}. Fix: add tests at the same speeds and currents at another "
            f"temperature{other}"
        )


class _Search:
    """The model's columns and the rates' on the tests."""

    def __init__(
        self, model: DamperModel, tests: Sequence[Measurement], method: Method, findings: Undetermined
    ) -> None:
        self._model, self._tests, self.findings = model, tests, findings
        self._weighting = method.weighting(model)

    def free(self, values: Mapping[str, float], bound: Sequence[str]) -> tuple[str, ...]:
        """Names of the parameters that were fitted."""
        left_out = {*bound, *self._model.redundant, "eta"}
        names = (name for name in self._model.names if name in values and name not in left_out)
        return tuple(self.findings.free(names))

    def step(
        self, law: TemperatureLaw, values: Mapping[str, float], names: Sequence[str]
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Gauss-Newton step of the rates (k,), their covariance (k, k), how they move the parameters (p, k), the form.

        The last is `TemperatureCorrection.form`, (p + k,).
        """
        size, count = len(names) + len(law.rates), 0
        normal, right, bent, left = np.zeros((size, size)), np.zeros(size), np.zeros(size), 0.0
        for index, test in enumerate(self._tests):
            weight = self._weighting.of(test, index)
            columns = np.column_stack((
                parameter_slopes(self._model, values, names, test), self._rate_columns(law, values, test),
            ))  # fmt: skip
            change_N = force_change_N(self._model, values, law, test)
            error = (test.force_N - modelled_force(self._model, values, test) - change_N) * weight
            off = (force_change_N(self._model, values, replace(law, bend=1.0), test) - change_N) * weight
            columns *= weight[:, None]
            normal += columns.T @ columns
            right += columns.T @ error
            bent += columns.T @ off
            left += float(error @ error)
            count += int(np.count_nonzero(weight))
        own, rates = len(names), Eliminated.of(normal, len(names))
        covariance = np.asarray(np.linalg.pinv(rates.normal, rcond=SINGULAR, hermitian=True), dtype=np.float64)
        step, form = (covariance @ rates.right(side) for side in (right, bent))
        form = np.concatenate((rates.inverse @ bent[:own] - rates.cross.T @ form, form))
        lost = rates.normal.diagonal() <= SINGULAR * normal.diagonal()[own:]
        covariance[lost, lost] = math.inf
        return step, covariance * (left / max(1, count - size)), -rates.cross.T, form

    def _rate_columns(self, law: TemperatureLaw, values: Mapping[str, float], test: Measurement) -> FloatArray:
        columns = np.empty((test.u_m.size, len(law.rates)))
        for place, (name, rate) in enumerate(law.rates.items()):
            sides = [replace(law, rates={**law.rates, name: rate + signed}) for signed in (STEP_1_K, -STEP_1_K)]
            above, below = (force_change_N(self._model, values, side, test) for side in sides)
            columns[:, place] = (above - below) / (2.0 * STEP_1_K)
        return columns


def _corrected(
    model: DamperModel, values: Mapping[str, float], law: TemperatureLaw, tests: Sequence[Measurement]
) -> list[Measurement]:
    return [replace(test, force_N=test.force_N - force_change_N(model, values, law, test)) for test in tests]


def _finite(test: Measurement) -> FloatArray:
    recorded = np.zeros(0) if test.temperature_degC is None else test.temperature_degC
    return np.asarray(recorded[np.isfinite(recorded)])


def complete(state: FitState) -> FitState:
    """The fit to corrected tests with its rates, its errors on the tests as they were measured."""
    softening, fitted, held_out = state.found[TEMPERATURE]
    return replace(state, fit=_with_rates(state.so_far, softening, fitted, held_out), described=(fitted, held_out))


def _with_rates(
    fit: Fit, found: TemperatureCorrection, fitted: Sequence[Measurement], held_out: Sequence[Measurement]
) -> Fit:
    """The fit of the corrected tests with its rates, its errors on the tests as they were measured."""
    widening = max((residual.widening for residual in fit.residual_parts), default=1.0)
    own = len(found.names)
    covariance = widening * found.covariance + np.outer(found.form[own:], found.form[own:])
    parameters = {name: _moved(name, entry, found, widening) for name, entry in fit.parameters.items()}
    together, correlation = quantile(len(fit.identifiable) + len(found.law.rates)), dict(fit.correlation)
    for place, (name, rate) in enumerate(found.law.rates.items()):
        error = math.sqrt(covariance[place, place])
        half, wide = quantile() * error, together * error
        parameters[name] = Estimate(rate, "1/K", rate - half, rate + half, rate - wide, rate + wide, error)
        rows = {other: float(covariance[place, k] / error / math.sqrt(covariance[k, k]))
                for k, other in enumerate(found.law.rates)}  # fmt: skip
        common = widening * found.moves @ found.covariance[place] + found.form[:own] * found.form[own + place]
        for other, shared in zip(found.names, common.tolist(), strict=True):
            other_error = parameters[other].standard_error if other in parameters else None
            if other_error and other in correlation:
                rows[other] = float(np.clip(shared / error / other_error, -1.0, 1.0))
                correlation[other] = {**correlation[other], name: rows[other]}
        correlation[name] = rows
    low, high = found.ends_degC
    form = f"{fit.form}, {found.law.formula(fit.damper)}"
    term = TemperatureTerm(found.kind, found.law.reference_degC, low, high)
    fit = replace(
        fit, parameters=parameters, form=form, uncertainty=replace(fit.uncertainty, correlation=correlation),
        corrections=replace(fit.corrections, temperature=term),
    )  # fmt: skip
    law = fit.law
    seen = score_forces(fitted, (law.force_of(test) for test in fitted))
    unseen = score_forces(held_out, (law.force_of(test) for test in held_out)) if held_out else fit.holdout
    evaluation = replace(fit.evaluation, error=seen.with_residuals(fit.residual_parts), holdout=unseen)
    return replace(fit, evaluation=evaluation)


def _moved(name: str, entry: Estimate, found: TemperatureCorrection, widening: float) -> Estimate:
    """A parameter's estimate with what the rates leave uncertain of it."""
    if entry.standard_error is None or entry.value is None or name not in found.names or not entry.standard_error:
        return entry
    place = found.names.index(name)
    moves, bent = found.moves[place], float(found.form[place])
    error = math.sqrt(entry.standard_error**2 + widening * float(moves @ found.covariance @ moves) + bent**2)
    wider, value = error / entry.standard_error, entry.value

    def end(at: float | None) -> float | None:
        return None if at is None else value + wider * (at - value)

    return replace(
        entry, low=end(entry.low), high=end(entry.high), simultaneous_low=end(entry.simultaneous_low),
        simultaneous_high=end(entry.simultaneous_high), standard_error=error,
    )  # fmt: skip


