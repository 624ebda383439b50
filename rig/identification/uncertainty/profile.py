"""Profile likelihood: how bad the best fit becomes when one parameter is held beside its estimate.

D(c) = (S(c) - S_min) / s^2, where S(c) is the weighted sum of squares with the parameter at c and all others fitted
anew; the 95 % interval is where D <= 3.84 (chi-square, one degree of freedom; Wilks 1938). s^2 is chosen so that D has
the curvature of the linear interval, which knows of correlated residuals and of skew: the adjustment of Kent (1982) for
one parameter. Where a model is linear in its parameters both intervals are the same; where not, this one is right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.model import DamperModel
from rig.errors import IdentificationFailed
from rig.fits.entries import Profile
from rig.identification.models.coil import with_lag
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import FittedModel, modelled_force, parameter_slopes
from rig.identification.models.projection import Weighting
from rig.identification.uncertainty.covariance import Information
from rig.optimisers.least_squares import Descent, Squares, descend, normal_equations

THRESHOLD = 3.841458820694124
STEP_ERRORS = 0.7  # standard errors between the first points
GROWTH = 1.5  # of the step, after the first few points
EVEN_POINTS = 4
FAR_ENOUGH = 2.4  # root of the deviance at which a side ends
MOST_POINTS = 14
UNKNOWN_STEP = 0.05  # first step of a parameter without standard error, relative to its value
DESCENT = Descent(0.0, iterations=25, damping=1e-6, less=0.1, more=10.0, least_damping=1e-6, most_damping=1e6)
TOLERANCE = 1e-4  # of the deviance


def profiles(
    fitted: FittedModel,
    known: Information,
    measurements: Sequence[Measurement],
    weighting: Weighting,
    names: Sequence[str],
    floors: Sequence[str] = (),
) -> dict[str, Profile]:
    """Profiles of some parameters.

    Args:
        fitted: the model and what was fitted.
        known: what is known of the fitted parameters.
        measurements: the tests of the fit.
        weighting: the weights of the fit.
        names: which parameters; all others of `known` are fitted anew at every point.
        floors: parameters that would be negative and are held at 0; only their own profile moves them, upwards.

    Raises:
        IdentificationFailed: a parameter was not fitted; the message names those that were.
    """
    for name in names:
        if name not in known.names:
            raise IdentificationFailed(
                f"no profile of {name!r}: this parameter was not fitted; fitted parameters: {', '.join(known.names)}"
            )
    free = tuple(name for name in known.names if name not in floors)
    walker = _Walker(fitted.model, dict(fitted.values), known, free, measurements, weighting)
    return {name: walker.profile(name, floor=0.0 if name in floors else -math.inf) for name in names}


class _Walker:
    """Walks away from the estimate on both sides, each fit starting from its neighbour's."""

    def __init__(
        self,
        model: DamperModel,
        values: dict[str, float],
        known: Information,
        free: tuple[str, ...],
        measurements: Sequence[Measurement],
        weighting: Weighting,
    ) -> None:
        self._model, self._best, self._known, self._free = model, values, known, free
        self._data = [(test, weighting.of(test, index)) for index, test in enumerate(measurements)]
        self._least = self.objective(values)
        self._ranges = {
            parameter.name: (parameter.low, parameter.high) for parameter in model.parameters if not parameter.linear
        }
        self._positive = {
            parameter.name for parameter in model.parameters if not parameter.linear and parameter.low >= 0.0
        }

    def profile(self, name: str, floor: float) -> Profile:
        """The profile of one parameter."""
        index = self._known.names.index(name)
        if name in self._known.partners:
            step = UNKNOWN_STEP * max(abs(self._best[name]), abs(self._model.parameter(name).start), 1e-6)
            scale = self._least / self._known.freedom
        else:
            error = self._known.standard_error(name)
            step, scale = STEP_ERRORS * error, float(self._known.curvature[index]) * error**2
        lowest, highest = self._ranges.get(name, (-math.inf, math.inf))
        lowest = max(floor, lowest if lowest < self._best[name] else -math.inf)
        highest = highest if highest > self._best[name] else math.inf
        below, low = self._side(name, -step, scale, lowest)
        above, high = self._side(name, step, scale, highest)
        points = sorted([*below, (self._best[name], 0.0), *above])
        if low is None and points[0][0] == floor:
            low = floor
        return Profile(tuple(x for x, _ in points), tuple(d for _, d in points), low, high)

    def _side(self, name: str, step: float, scale: float, end: float) -> tuple[list[tuple[float, float]], float | None]:
        """Points (value, deviance) of one side up to `end`, and where it crosses the threshold, None if nowhere."""
        points: list[tuple[float, float]] = []
        last, values = (self._best[name], 0.0), dict(self._best)
        for number in range(MOST_POINTS):
            at = last[0] + step * (GROWTH ** max(0, number - EVEN_POINTS))
            at = max(at, end) if step < 0.0 else min(at, end)
            if at == last[0]:
                break
            ahead = self._extrapolated(values, name, at) if number else {**values, name: at}
            values, least = self._fit(ahead, name, scale)
            if not math.isfinite(least):
                break
            point = (at, max(0.0, (least - self._least) / scale))
            points.append(point)
            if point[1] >= THRESHOLD > last[1]:
                crossing = self._crossing(values, name, last, point, scale)
                if crossing is not None:
                    points.append((crossing, THRESHOLD))
                return points, crossing
            last = point
            if math.sqrt(point[1]) > FAR_ENOUGH:
                break
        return points, None

    def _extrapolated(self, values: Mapping[str, float], name: str, at: float) -> dict[str, float]:
        """Where the line from the estimate through the neighbour leads; by logarithms where nonlinear."""
        further = (at - self._best[name]) / (values[name] - self._best[name])
        ahead = {}
        for key, value in values.items():
            best = self._best[key]
            if key in self._ranges and value * best > 0.0:
                ahead[key] = best * (value / best) ** further
            else:
                ahead[key] = best + further * (value - best)
        return {**ahead, name: at}

    def _crossing(
        self,
        values: Mapping[str, float],
        name: str,
        inside: tuple[float, float],
        outside: tuple[float, float],
        scale: float,
    ) -> float | None:
        """Where the deviance is 3.84: regula falsi on its root, nearly straight; two fits. None if not finite."""
        threshold = math.sqrt(THRESHOLD)
        at = inside[0]
        for _ in range(2):
            near, far = math.sqrt(inside[1]), math.sqrt(outside[1])
            at = inside[0] + (outside[0] - inside[0]) * (threshold - near) / (far - near)
            _, least = self._fit({**values, name: at}, name, scale)
            if not math.isfinite(least):
                return None
            here = (at, max(0.0, (least - self._least) / scale))
            if abs(here[1] - THRESHOLD) < 0.01 * THRESHOLD:
                break
            inside, outside = (here, outside) if here[1] < THRESHOLD else (inside, here)
        return at

    def _fit(self, values: dict[str, float], pinned: str, scale: float) -> tuple[dict[str, float], float]:
        """All parameters but one fitted anew; the fit and its sum of squares."""
        squares = _Pinned(self, values, tuple(name for name in self._free if name != pinned))
        descent = replace(DESCENT, absolute=TOLERANCE * scale)
        theta, least = descend(squares, squares.theta(values), descent)
        return squares.named(theta), least

    def admissible(self, values: Mapping[str, float]) -> bool:
        """Whether parameters that must be positive are."""
        return all(values[name] > 0.0 for name in self._positive if name in values)

    def _tests(self, values: Mapping[str, float]) -> Iterator[tuple[Measurement, FloatArray]]:
        """The tests and their weights, with the coil current of this eta where only its command is known."""
        for test, weight in self._data:
            yield (with_lag(test, values["eta"]) if "eta" in values else test), weight

    def objective(self, values: Mapping[str, float]) -> float:
        """The weighted sum of squares; infinite where the force is not finite."""
        total = 0.0
        for test, weight in self._tests(values):
            force = modelled_force(self._model, values, test)
            if not np.all(np.isfinite(force)):
                return math.inf
            residual = (test.force_N - force) * weight
            total += float(residual @ residual)
        return total if math.isfinite(total) else math.inf

    def slopes(self, values: Mapping[str, float], names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """J'W^2 J and J'W^2 r."""
        return normal_equations((
            (parameter_slopes(self._model, values, names, test) * weight[:, None],
             (test.force_N - modelled_force(self._model, values, test)) * weight)
            for test, weight in self._tests(values)
        ), len(names))  # fmt: skip


class _Pinned(Squares):
    """The sum of squares as a function of some of the parameters, the others as they are."""

    def __init__(self, walker: _Walker, values: Mapping[str, float], names: tuple[str, ...]) -> None:
        self._walker, self._values, self._names = walker, dict(values), names

    def theta(self, values: Mapping[str, float]) -> FloatArray:
        """The free parameters of named values, (p,)."""
        return np.array([values[name] for name in self._names])

    def named(self, theta: FloatArray) -> dict[str, float]:
        """All parameters by name."""
        return {**self._values, **dict(zip(self._names, theta.tolist(), strict=True))}

    def value(self, theta: FloatArray) -> float:
        """See `Squares.value`."""
        return self._walker.objective(self.named(theta))

    def slopes(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Squares.slopes`."""
        return self._walker.slopes(self.named(theta), self._names)

    def admissible(self, theta: FloatArray) -> bool:
        """See `Squares.admissible`."""
        return self._walker.admissible(self.named(theta))
