"""The report's section on how the fitted parameters depend on the coil's current."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

import rig.dampers
from rig.dampers import DamperModel
from rig.document.blocks import Blocks, Card, Cards, Figures, Heading, Keys
from rig.document.figure import Axis, Figure, Style, Trace
from rig.document.numbers import CONFIDENCE
from rig.document.style import FITTED, MEASURED, RESIDUAL
from rig.document.words import Key, Strong
from rig.errors import RigError
from rig.signals.arrays import FloatArray
from rig.signals.test_set import rounded_levels

JsonObject = Mapping[str, Any]
CURRENT = Axis("Current", "A")
WIDTH, HEIGHT, PLACES = 300, 200, 61


def parameters_over_current(fit: JsonObject) -> Blocks:
    """Every parameter that changes with the current, with its 95 % band; nothing where none does."""
    drawn = parameter_figures(fit)
    if not drawn:
        return []
    by_current = "relations" in (fit.get("current") or {})
    keys = (
        Key("relation" if by_current else "fitted", MEASURED),
        Key("fit of each current, 95 %", FITTED) if by_current else Key("95 %", RESIDUAL),
    )
    cards = tuple(Card(Strong(name), (Figures((figure,)),)) for name, figure in drawn.items())
    return [Heading("Parameters over current"), Keys(keys), Cards(cards)]


def parameter_figures(fit: JsonObject) -> dict[str, Figure]:
    """The figures by the parameters' names; empty for a fit at one current."""
    current = fit.get("current") or {}
    if "relations" in current:
        return _by_relations(fit, current)
    low, high = ((fit.get("tested") or {}).get("current_A") or (0.0, 0.0))[:2]
    try:
        model = rig.dampers.model(str(fit.get("model")), fit.get("hysteresis", "kwok"))
    except RigError:
        return {}
    if not isinstance(low, (int, float)) or not isinstance(high, (int, float)) or not high - low > 1e-2:
        return {}
    return _affine(fit, model, np.linspace(max(low, 0.0) if low > -1e-2 else low, high, PLACES))


def _affine(fit: JsonObject, model: DamperModel, current_A: FloatArray) -> dict[str, Figure]:
    """Base + slope I^power for every parameter with a slope, and its band by the covariance."""
    values, drawn = fit.get("parameters") or {}, {}
    bases = dict.fromkeys(parameter.at_zero for parameter in model.parameters if parameter.at_zero)
    for base in bases:
        members = [(base, 0), *((one.name, one.power) for one in model.parameters if one.at_zero == base)]
        if any((values.get(name) or {}).get("value") is None for name, _ in members):
            continue
        columns = np.array([current_A**power for _, power in members])
        line = np.array([values[name]["value"] for name, _ in members]) @ columns
        traces = [Trace(current_A, line, name=base)]
        covariance = _covariance(fit, [name for name, _ in members])
        if covariance is not None:
            half = CONFIDENCE * np.sqrt(np.maximum(np.einsum("ik,ij,jk->k", columns, covariance, columns), 0.0))
            least = 0.0 if base in model.non_negative else -math.inf
            traces += [
                Trace(current_A, np.maximum(line + side * half, least), Style.RESIDUAL, "95 %") for side in (-1.0, 1.0)
            ]
        title = _common(base, [name for name, power in members if power])
        unit = values[base].get("unit", "")
        drawn[title] = Figure(CURRENT, Axis(title, str(unit)), traces, WIDTH, HEIGHT, title=f"{title} over current")
    return drawn


def _common(base: str, slopes: list[str]) -> str:
    """"Fy" of "Fya" and "Fyb", "C_plus" of "Ca_plus" and "Cb_plus"; else the base's own name."""
    (first, mark, end), other = base.partition("_"), slopes[0]
    if first.endswith("a") and other == f"{first[:-1]}b{mark}{end}":
        return f"{first[:-1]}{mark}{end}"
    return base


def _covariance(fit: JsonObject, names: list[str]) -> FloatArray | None:
    """Of some parameters; None where one has no standard error."""
    errors = [(fit["parameters"][name] or {}).get("standard_error") for name in names]
    if not all(isinstance(error, (int, float)) and math.isfinite(error) for error in errors):
        return None
    rows = fit.get("correlation") or {}
    matrix = np.array([
        [1.0 if a == b else float((rows.get(a) or {}).get(b) or 0.0) for b in names] for a in names
    ])  # fmt: skip
    scale = np.array(errors, float)
    return np.asarray(matrix * np.outer(scale, scale))


def _by_relations(fit: JsonObject, current: JsonObject) -> dict[str, Figure]:
    """One fit a current: its values with their intervals, and the relation through them."""
    at_A, drawn = [float(value) for value in current.get("currents_A") or ()], {}
    for name, relation in (current.get("relations") or {}).items():
        entries = [(value, (fit.get("parameters") or {}).get(f"{name} at {label:g} A"))
                   for value, label in zip(at_A, rounded_levels(at_A), strict=True)]  # fmt: skip
        known = [(value, entry) for value, entry in entries if entry and isinstance(entry.get("value"), (int, float))]
        if not known:
            continue
        grid = np.linspace(min(at_A), max(at_A), PLACES)
        line = np.polynomial.polynomial.polyval(grid, np.array(relation["coefficients"], float))
        traces = [Trace(grid, line, name=f"{name}, relation")]
        reach = 0.006 * (max(at_A) - min(at_A) or 1.0)
        for value, entry in known:
            ends = [entry[end] if isinstance(entry.get(end), (int, float)) else entry["value"]
                    for end in ("low", "high")]  # fmt: skip
            label = f"{name} at {value:g} A"
            traces.append(Trace(np.full(2, value), np.array(ends, float), name=label, colour=FITTED))
            tick = np.full(2, float(entry["value"]))
            traces.append(Trace(value + reach * np.array([-1.0, 1.0]), tick, name=label, colour=FITTED))
        unit = known[0][1].get("unit", "")
        drawn[name] = Figure(CURRENT, Axis(name, str(unit)), traces, WIDTH, HEIGHT, title=f"{name} over current")
    return drawn
