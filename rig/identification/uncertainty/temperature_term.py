"""How a fitted damper follows its temperature, as a value of the fit; the rates are among its parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import rig.dampers
from rig.dampers.temperature_law import RATES, TemperatureLaw
from rig.errors import IdentificationFailed


@dataclass(frozen=True)
class TemperatureTerm:
    """A fit's temperature law.

    Attributes:
        law: which (`rig.dampers.temperature_law.RATES`).
        reference_degC: temperature (degC) at which the other parameters hold.
        lowest_degC: lowest recorded temperature of the fitted tests.
        highest_degC: highest.
    """

    law: str
    reference_degC: float
    lowest_degC: float
    highest_degC: float

    @classmethod
    def from_json(cls, entry: Mapping[str, Any] | None) -> TemperatureTerm | None:
        """The inverse of `vars`; None where there is none.

        Raises:
            KeyError, TypeError, ValueError: the entry is not what a fit writes.
        """
        if entry is None:
            return None
        ends = (float(entry[name]) for name in ("reference_degC", "lowest_degC", "highest_degC"))
        return cls(str(entry["law"]), *ends)


def at_temperature(fit: Any, temperature_degC: float) -> Any:  # noqa: ANN401 - a Fit, whose module imports this one
    """A fit with its values, intervals and correlations at another temperature (degC): see `Fit.at`.

    Values follow the rates exactly; errors by the slopes with values and rates, which know one another.

    Raises:
        IdentificationFailed: the fit has no temperature law, or this is no temperature.
    """
    term: TemperatureTerm | None = fit.temperature
    if term is None:
        raise IdentificationFailed("this fit has no temperature law: fit again with --temperature-law")
    if not -273.15 < temperature_degC < math.inf:
        raise IdentificationFailed(f"{temperature_degC:g} degC is no temperature")
    model = rig.dampers.model(fit.model, "printed" if fit.hysteresis == "printed" else "kwok")
    law = TemperatureLaw(term.reference_degC, {name: fit.values[name] for name in RATES[term.law]})
    warmer_K = temperature_degC - term.reference_degC
    names = [name for name in fit.correlation if fit.parameters[name].standard_error is not None]
    factors = {one.name: math.exp(-law.rate_1_K(one) * warmer_K) for one in model.parameters}
    slopes = np.diag([factors.get(name, 1.0) for name in names])
    for parameter in (one for one in model.parameters if one.name in names):
        for rate in (name for name in law.rates if name in names and law.follows(parameter, name)):
            slope = -warmer_K * factors[parameter.name] * fit.values[parameter.name]
            slopes[names.index(parameter.name), names.index(rate)] = slope
    errors, correlation = _moved(fit, names, slopes)
    there = replace(law, reference_degC=temperature_degC)
    return replace(
        fit,
        temperature=replace(term, reference_degC=temperature_degC),
        form=fit.form.replace(law.formula(model), there.formula(model)),
        parameters={
            name: _scaled(one, factors.get(name, 1.0), errors.get(name)) for name, one in fit.parameters.items()
        },
        correlation=correlation,
    )


def _moved(
    fit: Any,  # noqa: ANN401 - as above
    names: list[str],
    slopes: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
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


def _scaled(one: Any, factor: float, error: float | None) -> Any:  # noqa: ANN401 - an Estimate, as above
    """An estimate times a factor, its interval as wide as its error has become."""
    if one.value is None:
        return one
    value = factor * one.value
    wider = factor if error is None or not one.standard_error else error / one.standard_error
    ends = {
        name: None if (end := getattr(one, name)) is None else value + wider * (end - one.value)
        for name in ("low", "high", "simultaneous_low", "simultaneous_high")
    }
    known = None if one.standard_error is None else wider * one.standard_error
    return replace(one, value=value, standard_error=known, **ends)
