"""A damper and one distortion of its measurement fitted together, by a few damped Gauss-Newton steps from the fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.model import DamperModel
from rig.dampers.parameter import Parameter
from rig.identification.diagnosis.distortions import Distortion
from rig.identification.diagnosis.stretches import Stretch
from rig.identification.models.model_slope import modelled_force, parameter_slopes

STEPS = 12
FEWER_STEPS = 3  # of a model with internal states, whose slopes cost an integration each
ENOUGH = 1e-3  # relative reduction of the sum of squares below which the search ends
LEAST_DAMPING, MOST_DAMPING = 1e-9, 1e3
SINGULAR = 1e-10  # of a scaled normal matrix, below which a direction carries no information


@dataclass(frozen=True)
class Explained:
    """Where the search ended: the weighted sum of squares, the damper's values (SI), the distortion's amounts (k,)."""

    squares: float
    values: Mapping[str, float]
    amounts: FloatArray


def explain(
    model: DamperModel,
    values: Mapping[str, float],
    names: Sequence[str],
    parts: Sequence[Stretch],
    distortion: Distortion,
) -> Explained:
    """The damper's free parameters and the distortion's amounts that leave the least squares.

    Args:
        model: the damper model.
        values: where to start (SI).
        names: the free parameters.
        parts: the samples.
        distortion: what may have happened to them.
    """
    here = Explained(np.inf, dict(values), np.array(distortion.start, dtype=float))
    limits = np.array([_limits(model.parameter(name), values[name]) for name in names]).reshape(-1, 2)
    squares, normal, right = _normal(model, here, names, parts, distortion)
    here, damping = Explained(squares, here.values, here.amounts), 1e-6
    for _ in range(FEWER_STEPS if model.states else STEPS):
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        scaled, target = normal / np.outer(scale, scale), right / scale
        moved = None
        while damping <= MOST_DAMPING:
            step = np.linalg.solve(scaled + damping * np.eye(scale.size), target) / scale
            trial = _stepped(here, names, step, limits, distortion)
            if (reached := _squares(model, trial, parts, distortion)) < here.squares:
                moved = Explained(reached, trial.values, trial.amounts)
                damping = max(LEAST_DAMPING, 0.1 * damping)
                break
            damping *= 10.0
        if moved is None:
            break
        gain, here = here.squares - moved.squares, moved
        if gain < ENOUGH * here.squares:
            break
        _, normal, right = _normal(model, here, names, parts, distortion)
    return here


@dataclass(frozen=True)
class Step:
    """What one step of the search would gain by a distortion beyond what the damper's parameters gain without it.

    Attributes:
        gain: less of the weighted sum of squares.
        amounts: of the distortion, shape (k,).
    """

    gain: float
    amounts: FloatArray


def first_step(
    model: DamperModel,
    values: Mapping[str, float],
    names: Sequence[str],
    parts: Sequence[Stretch],
    distortion: Distortion,
) -> Step:
    """The first undamped step of `explain`, which takes one look at all samples."""
    here = Explained(np.inf, dict(values), np.array(distortion.start, dtype=float))
    _, normal, right = _normal(model, here, names, parts, distortion)
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled, target, count = normal / np.outer(scale, scale), right / scale, len(names)
    whole = np.linalg.lstsq(scaled, target, rcond=SINGULAR)[0]
    without = np.linalg.lstsq(scaled[:count, :count], target[:count], rcond=SINGULAR)[0]
    return Step(float(whole @ target - without @ target[:count]), here.amounts + (whole / scale)[count:])


def _limits(parameter: Parameter, value: float) -> tuple[float, float]:
    """A parameter's own limits, and beyond them as far as a fit found it: a search starts where it is."""
    return min(parameter.low, value), max(parameter.high, value)


def _stepped(
    here: Explained, names: Sequence[str], step: FloatArray, limits: FloatArray, distortion: Distortion
) -> Explained:
    count = len(names)
    natural = np.array([here.values[name] for name in names]) + step[:count]
    natural = np.clip(natural, limits[:, 0], limits[:, 1])
    moved = {**here.values, **dict(zip(names, natural.tolist(), strict=True))}
    amounts = np.clip(here.amounts + step[count:], *distortion.limits) if distortion.start else here.amounts
    return Explained(np.inf, moved, amounts)


def residual_N(
    model: DamperModel, values: Mapping[str, float], part: Stretch, distortion: Distortion, amounts: FloatArray
) -> FloatArray:
    """Measured force less what a damper with these values would show behind this distortion (N), shape (n,)."""
    force = modelled_force(model, values, distortion.moved(part, amounts))
    return np.asarray(part.test.force_N - distortion.shown_N(part, force, amounts))


def _squares(model: DamperModel, at: Explained, parts: Sequence[Stretch], distortion: Distortion) -> float:
    total = 0.0
    with np.errstate(over="ignore", invalid="ignore"):  # a step too far; it is not taken
        for part in parts:
            weighted = part.weights * residual_N(model, at.values, part, distortion, at.amounts)
            total += float(weighted @ weighted)
    return total if np.isfinite(total) else np.inf


def _normal(
    model: DamperModel, at: Explained, names: Sequence[str], parts: Sequence[Stretch], distortion: Distortion
) -> tuple[float, FloatArray, FloatArray]:
    """Weighted sum of squares, normal matrix (p + k, p + k) and right side (p + k,)."""
    size = len(names) + len(distortion.start)
    squares, normal, right = 0.0, np.zeros((size, size)), np.zeros(size)
    for part in parts:
        rows = slope_rows(model, at, names, part, distortion)
        error = part.weights * residual_N(model, at.values, part, distortion, at.amounts)
        squares += float(error @ error)
        normal += rows.T @ rows
        right += rows.T @ error
    return squares, normal, right


def slope_rows(
    model: DamperModel, at: Explained, names: Sequence[str], part: Stretch, distortion: Distortion
) -> FloatArray:
    """Weighted slopes of what is shown, by the damper's parameters and then by the amounts, shape (n, p + k)."""
    moved = distortion.moved(part, at.amounts)
    force = modelled_force(model, at.values, moved)
    gain = distortion.gain(part, force, at.amounts)
    columns = [parameter_slopes(model, at.values, names, moved) * gain[:, None]] if names else []
    for number, step in enumerate(distortion.steps):
        sides = []
        for signed in (step, -step):
            amounts = at.amounts.copy()
            amounts[number] += signed
            behind = force
            if not distortion.only_force:
                behind = modelled_force(model, at.values, distortion.moved(part, amounts))
            sides.append(distortion.shown_N(part, behind, amounts))
        columns.append(((sides[0] - sides[1]) / (2.0 * step))[:, None])
    return np.asarray(np.hstack(columns) * part.weights[:, None])
