"""A damper and one distortion of its measurement fitted together, by a few damped Gauss-Newton steps from the fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.model import DamperModel
from rig.dampers.parameter import Parameter
from rig.identification.diagnosis.distortions import Distortion
from rig.identification.diagnosis.stretches import Stretch
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import force_and_slopes, modelled_force
from rig.optimisers.least_squares import SINGULAR, Descent, Squares, descend, unit_scale

DESCENT = Descent(
    0.0, settled=1e-3, iterations=200, steps=12, damping=1e-6, less=0.1, more=10.0, smallest=1e-9, most_damping=1e3
)
FEWER_STEPS = 3  # of a model with internal states, whose slopes cost an integration each


@dataclass(frozen=True)
class Explained:
    """Where the search ended: the weighted sum of squares, the damper's values (SI), the distortion's amounts (k,)."""

    squares: float
    values: Mapping[str, float]
    amounts: FloatArray


@dataclass(frozen=True, eq=False)
class Damper:
    """A damper model, where searches begin (SI), and its free parameters.

    Many distortions are tried from one fit, so force and slopes there are kept for the next of them.
    """

    model: DamperModel
    start: Mapping[str, float]
    names: Sequence[str]
    _kept: dict[int, tuple[Measurement, tuple[FloatArray, FloatArray]]] = field(default_factory=dict)

    def force_and_slopes(self, values: Mapping[str, float], test: Measurement) -> tuple[FloatArray, FloatArray]:
        """Force (N), (n,), and its slopes over the free parameters, (n, p)."""
        if values is not self.start:
            return force_and_slopes(self.model, values, self.names, test)
        if id(test) not in self._kept:
            self._kept[id(test)] = test, force_and_slopes(self.model, values, self.names, test)
        return self._kept[id(test)][1]


def explain(
    damper: Damper, parts: Sequence[Stretch], distortion: Distortion, start: Mapping[str, float] | None = None
) -> Explained:
    """The damper's free parameters and the distortion's amounts that leave the least squares.

    Args:
        damper: the damper.
        parts: the samples.
        distortion: what may have happened to them.
        start: where to start instead of the damper's own start (SI).
    """
    squares = _Distorted(damper, parts, distortion, damper.start if start is None else start)
    descent = replace(DESCENT, steps=FEWER_STEPS) if damper.model.states else DESCENT
    theta, least = descend(squares, squares.start, descent)
    return replace(squares.at(theta), squares=least)


class _Distorted(Squares):
    """The weighted sum of squares over a damper's free parameters, and behind them the distortion's amounts."""

    def __init__(
        self, damper: Damper, parts: Sequence[Stretch], distortion: Distortion, values: Mapping[str, float]
    ) -> None:
        self._damper, self._parts, self._distortion, self._values = damper, parts, distortion, values
        here = [values[name] for name in damper.names]
        own = [_limits(damper.model.parameter(name), values[name]) for name in damper.names]
        amounts = np.transpose([np.broadcast_to(end, len(distortion.start)) for end in distortion.limits])
        self._limits = np.vstack([np.array(own).reshape(-1, 2), amounts])
        self.start = np.array([*here, *distortion.start], dtype=float)
        self._first = _normal(damper, self.at(self.start), parts, distortion)

    def at(self, theta: FloatArray) -> Explained:
        """The damper's values and the amounts."""
        count = len(self._damper.names)
        moved = dict(zip(self._damper.names, theta[:count].tolist(), strict=True))
        values = self._values if theta is self.start else {**self._values, **moved}
        return Explained(np.inf, values, theta[count:])

    def value(self, theta: FloatArray) -> float:
        """See `Squares.value`."""
        if theta is self.start:
            return self._first[0]
        return _squares(self._damper.model, self.at(theta), self._parts, self._distortion)

    def slopes(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Squares.slopes`."""
        if theta is self.start:
            return self._first[1:]
        return _normal(self._damper, self.at(theta), self._parts, self._distortion)[1:]

    def moved(self, theta: FloatArray, step: FloatArray) -> FloatArray:
        """See `Squares.moved`."""
        return np.asarray(np.clip(theta + step, self._limits[:, 0], self._limits[:, 1]))


@dataclass(frozen=True)
class Step:
    """What one step of the search would gain by a distortion beyond what the damper's parameters gain without it.

    Attributes:
        gain: less of the weighted sum of squares.
        amounts: of the distortion, shape (k,).
    """

    gain: float
    amounts: FloatArray


def first_step(damper: Damper, parts: Sequence[Stretch], distortion: Distortion) -> Step:
    """The first undamped step of `explain`, which takes one look at all samples."""
    here = Explained(np.inf, damper.start, np.array(distortion.start, dtype=float))
    _, normal, right = _normal(damper, here, parts, distortion)
    scale = unit_scale(normal)
    scaled, target, count = normal / np.outer(scale, scale), right / scale, len(damper.names)
    whole = np.linalg.lstsq(scaled, target, rcond=SINGULAR)[0]
    without = np.linalg.lstsq(scaled[:count, :count], target[:count], rcond=SINGULAR)[0]
    return Step(float(whole @ target - without @ target[:count]), here.amounts + (whole / scale)[count:])


def _limits(parameter: Parameter, value: float) -> tuple[float, float]:
    """A parameter's own limits, and beyond them as far as a fit found it: a search starts where it is."""
    return min(parameter.low, value), max(parameter.high, value)


def residual_N(
    model: DamperModel, values: Mapping[str, float], part: Stretch, distortion: Distortion, amounts: FloatArray
) -> FloatArray:
    """Measured force less what a damper with these values would show behind this distortion (N), shape (n,)."""
    force = modelled_force(model, values, _seen(part, distortion, amounts))
    return np.asarray(part.test.force_N - distortion.shown_N(part, force, amounts))


def _seen(part: Stretch, distortion: Distortion, amounts: FloatArray) -> Measurement:
    """What the damper sees: the test itself where nothing was moved."""
    return part.test if distortion.only_force or not np.any(amounts) else distortion.moved(part, amounts)


def _squares(model: DamperModel, at: Explained, parts: Sequence[Stretch], distortion: Distortion) -> float:
    total = 0.0
    with np.errstate(over="ignore", invalid="ignore"):  # a step too far; it is not taken
        for part in parts:
            weighted = part.weights * residual_N(model, at.values, part, distortion, at.amounts)
            total += float(weighted @ weighted)
    return total if np.isfinite(total) else np.inf


def _normal(
    damper: Damper, at: Explained, parts: Sequence[Stretch], distortion: Distortion
) -> tuple[float, FloatArray, FloatArray]:
    """Weighted sum of squares, normal matrix (p + k, p + k) and right side (p + k,)."""
    size = len(damper.names) + len(distortion.start)
    squares, normal, right = 0.0, np.zeros((size, size)), np.zeros(size)
    for part in parts:
        rows, force = slope_rows(damper, at, part, distortion)
        error = part.weights * (part.test.force_N - distortion.shown_N(part, force, at.amounts))
        squares += float(error @ error)
        normal += rows.T @ rows
        right += rows.T @ error
    return squares, normal, right


def slope_rows(
    damper: Damper, at: Explained, part: Stretch, distortion: Distortion
) -> tuple[FloatArray, FloatArray]:
    """Weighted slopes of what is shown, by the damper's parameters and then by the amounts, and the damper's force.

    Returns:
        The slopes, shape (n, p + k), and the force (N), (n,).
    """
    moved = _seen(part, distortion, at.amounts)
    if damper.names:
        force, slopes = damper.force_and_slopes(at.values, moved)
        columns = [slopes * distortion.gain(part, force, at.amounts)[:, None]]
    else:
        force, columns = modelled_force(damper.model, at.values, moved), []
    for number, step in enumerate(distortion.steps):
        sides = []
        for signed in (step, -step):
            amounts = at.amounts.copy()
            amounts[number] += signed
            behind = force
            if not distortion.only_force:
                behind = modelled_force(damper.model, at.values, distortion.moved(part, amounts))
            sides.append(distortion.shown_N(part, behind, amounts))
        columns.append(((sides[0] - sides[1]) / (2.0 * step))[:, None])
    return np.asarray(np.hstack(columns) * part.weights[:, None]), force
