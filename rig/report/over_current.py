"""The report's section on how the fitted parameters depend on the coil's current."""

from __future__ import annotations

import math

import numpy as np

from rig.dampers import DamperModel
from rig.document.blocks import Blocks, Card, Cards, Figures, Heading, Keys
from rig.document.figure import Axis, Figure, Style, Trace
from rig.document.numbers import CONFIDENCE
from rig.document.style import FITTED, MEASURED, RESIDUAL
from rig.document.words import Key, Strong
from rig.errors import RigError
from rig.fits.fit_record import FitRecord
from rig.fits.relation import CurrentRelations
from rig.signals.arrays import FloatArray
from rig.signals.test_set import rounded_levels

CURRENT = Axis("Current", "A")
WIDTH, HEIGHT, PLACES = 300, 200, 61


def parameters_over_current(fit: FitRecord) -> Blocks:
    """Every parameter that changes with the current, with its 95 % band; nothing where none does."""
    drawn = parameter_figures(fit)
    if not drawn:
        return []
    by_current = fit.current is not None
    keys = (
        Key("relation" if by_current else "fitted", MEASURED),
        Key("separate fit at each current, 95 % interval", FITTED) if by_current else Key("95 % interval", RESIDUAL),
    )
    cards = tuple(Card(Strong(name), (Figures((figure,)),)) for name, figure in drawn.items())
    return [Heading("Parameters vs. current", 3), Keys(keys), Cards(cards)]


def parameter_figures(fit: FitRecord) -> dict[str, Figure]:
    """The figures by the parameters' names; empty for a fit at one current."""
    if fit.current is not None:
        return _by_relations(fit, fit.current)
    try:
        model = fit.damper
    except RigError:
        return {}
    low, high = (0.0, 0.0) if fit.tested is None else fit.tested.current_A
    if not high - low > 1e-2:
        return {}
    return _affine(fit, model, np.linspace(max(low, 0.0) if low > -1e-2 else low, high, PLACES))


def _affine(fit: FitRecord, model: DamperModel, current_A: FloatArray) -> dict[str, Figure]:
    """Base + slope I^power for every parameter with a slope, and its band by the covariance."""
    values, drawn = fit.values, {}
    bases = dict.fromkeys(parameter.at_zero for parameter in model.parameters if parameter.at_zero)
    for base in bases:
        members = [(base, 0), *((one.name, one.power) for one in model.parameters if one.at_zero == base)]
        if any(name not in values for name, _ in members):
            continue
        columns = np.array([current_A**power for _, power in members])
        line = np.array([values[name] for name, _ in members]) @ columns
        traces = [Trace(current_A, line, name=base)]
        covariance = fit.covariance_of([name for name, _ in members])
        if covariance is not None:
            half = CONFIDENCE * np.sqrt(np.maximum(np.einsum("ik,ij,jk->k", columns, covariance, columns), 0.0))
            least = 0.0 if base in model.non_negative else -math.inf
            traces += [
                Trace(current_A, np.maximum(line + side * half, least), Style.RESIDUAL, "95 %") for side in (-1.0, 1.0)
            ]
        title = _common(base, [name for name, power in members if power])
        axis = Axis(title, fit.parameters[base].unit)
        drawn[title] = Figure(CURRENT, axis, traces, WIDTH, HEIGHT, title=f"{title} vs. current")
    return drawn


def _common(base: str, slopes: list[str]) -> str:
    """"Fy" of "Fya" and "Fyb", "C_plus" of "Ca_plus" and "Cb_plus"; else the base's own name."""
    (first, mark, end), other = base.partition("_"), slopes[0]
    if first.endswith("a") and other == f"{first[:-1]}b{mark}{end}":
        return f"{first[:-1]}{mark}{end}"
    return base


def _by_relations(fit: FitRecord, current: CurrentRelations) -> dict[str, Figure]:
    """One fit a current: its values with their intervals, and the relation through them."""
    at_A, drawn = current.currents_A, {}
    for name, relation in current.relations.items():
        entries = [(value, fit.parameters.get(f"{name} at {label:g} A"))
                   for value, label in zip(at_A, rounded_levels(at_A), strict=True)]  # fmt: skip
        known = [(value, entry, entry.value) for value, entry in entries if entry and entry.value is not None]
        if not known:
            continue
        grid = np.linspace(min(at_A), max(at_A), PLACES)
        traces = [Trace(grid, relation.at(grid), name=f"{name}, relation")]
        reach = 0.006 * (max(at_A) - min(at_A) or 1.0)
        for current_A, entry, value in known:
            ends = [value if end is None else end for end in (entry.low, entry.high)]
            label = f"{name} at {current_A:g} A"
            traces.append(Trace(np.full(2, current_A), np.array(ends), name=label, colour=FITTED))
            tick = current_A + reach * np.array([-1.0, 1.0])
            traces.append(Trace(tick, np.full(2, value), name=label, colour=FITTED))
        axis = Axis(name, known[0][1].unit)
        drawn[name] = Figure(CURRENT, axis, traces, WIDTH, HEIGHT, title=f"{name} vs. current")
    return drawn
