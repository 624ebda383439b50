"""Other yield shapes that fit as well as the tanh that was found: the data then do not tell its parameters.

The intervals of beta and delta are linear in them, and a tanh that saturates is not: from some steepness on all fit
alike. And where only two speeds were tested a bent tanh is a sign function and a viscous force, exactly. So shapes
without a bend, and with a bend at another speed, take the tanh's place, the linear parameters fitted anew. Here, too,
is why a fitted parameter is not identified: by its slopes, or because a simpler shape does as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rig.dampers.algebraic import TanhModel
from rig.dampers.arrays import BoolArray, FloatArray
from rig.dampers.bilinear import DigressiveBilinearModel
from rig.dampers.current_law_model import CurrentLawModel
from rig.dampers.model import DamperModel
from rig.identification.models.law_search import felt
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import parameter_slopes
from rig.identification.models.projection import Projection, Weighting
from rig.identification.models.separable import motion_scale
from rig.identification.remarks import Remark, say
from rig.identification.uncertainty.covariance import Information
from rig.identification.uncertainty.residual_correction import pieces_of

Shape = Callable[[Measurement], FloatArray]
Side = Callable[[Measurement], BoolArray]

DISTINGUISHABLE = 16.0  # times the residual's variance, by which another shape must fit worse: four standard errors
ROUNDING = 1e-12  # of the force's own sum of squares
BENT = (0.5, 1.0, 2.0, 4.0)  # arguments of a tanh at the greatest speed where it bends within the tested speeds
RESTS_ON = 2.0  # times its standard error, which a parameter may have without one side of mid-stroke
BEYOND = 2.0  # times the top speed, where a knee is none
TINIEST_SQUARE = 1e-100  # of a regressor without effect
RIDGE = 1e-12  # of a scaled normal matrix: keeps a variance without information finite, and very large


def alternative_shapes(
    model: TanhModel,
    known: Information,
    values: Mapping[str, float],
    measurements: Sequence[Measurement],
    weighting: Weighting,
) -> tuple[bool, bool]:
    """Whether a sign function fits as well as the tanh, and whether a bent tanh fits as well as a sign function.

    The sign function is tried everywhere, and for the motion towards and away from mid-stroke apart, because the loop's
    width may leave only one of the two bent; that matters where beta and delta cannot be told by the other one alone.

    Args:
        model: the fitted model.
        known: what is known of its parameters at `values`.
        values: the fit (SI).
        measurements: the tests of the fit.
        weighting: the weights of the fit.

    Returns:
        The second only where the first holds.
    """

    def fitted(test: Measurement) -> FloatArray:
        return model.yield_shape(values, test.u_m, test.v_m_s)

    def saturated(side: Side) -> Shape:
        return lambda entry: np.where(side(entry), np.sign(fitted(entry)), fitted(entry))

    def bent(slope_s_m: float) -> Shape:
        return lambda test: np.tanh(slope_s_m * test.v_m_s)

    def least(*shapes: Shape) -> tuple[list[float], float]:
        return _least_squares(model, known.names, shapes, measurements, weighting)

    def needed(side: Side) -> bool:
        whole, rest = (
            _shape_variances(model, known.names, values, without, measurements, weighting)
            for without in (_nowhere, side)
        )
        return bool(np.any(rest > RESTS_ON**2 * whole))

    (best, everywhere, *sides), power = least(fitted, *(saturated(side) for side in (_everywhere, _towards, _away)))
    limit = best * (1.0 + DISTINGUISHABLE / known.freedom) + ROUNDING * power
    one_sided = zip(sides, (_towards, _away), strict=True)
    steep = everywhere < limit or any(left < limit and needed(side) for left, side in one_sided)
    if not steep:
        return False, False
    top_m_s = max(float(max(np.max(test.v_m_s), -np.min(test.v_m_s))) for test in measurements)
    return True, min(least(*(bent(argument / top_m_s) for argument in BENT))[0]) < limit


def _everywhere(test: Measurement) -> BoolArray:
    return np.ones(test.u_m.size, dtype=bool)


def _nowhere(test: Measurement) -> BoolArray:
    return np.zeros(test.u_m.size, dtype=bool)


def _towards(test: Measurement) -> BoolArray:
    return test.u_m * test.v_m_s < 0.0


def _away(test: Measurement) -> BoolArray:
    return ~_towards(test)


def _least_squares(
    model: TanhModel,
    names: Sequence[str],
    shapes: Sequence[Shape],
    measurements: Sequence[Measurement],
    weighting: Weighting,
) -> tuple[list[float], float]:
    """Least weighted sum of squares over the linear parameters among `names` for each yield shape; the force's own."""
    free = [k for k, name in enumerate(model.fixed_names) if name in names]
    powers = [k for k, name in enumerate(model.yield_names) if name in names]
    size = len(free) + len(powers) + 1
    sums = np.zeros((len(shapes), size, size))
    for index, test in enumerate(measurements):
        for rows, piece in pieces_of(model, test):
            weight = weighting.of(test, index, rows)
            columns = np.empty((piece.u_m.size, size))
            fixed = model.fixed_columns(piece.u_m, piece.v_m_s, piece.a_m_s2, piece.current_A)
            columns[:, : len(free)] = fixed[:, free] * weight[:, None]
            columns[:, -1] = np.where(weight > 0.0, piece.force_N, 0.0) * weight
            for k, shape in enumerate(shapes):
                gain = shape(piece) * weight
                for at, power in enumerate(powers, len(free)):
                    columns[:, at] = gain * piece.current_A**power
                sums[k] += columns.T @ columns
    return [_left(part) for part in sums], float(sums[0, -1, -1])


def _left(sums: FloatArray) -> float:
    """Sum of squares that is left of the last column when the others are fitted to it, from their products."""
    scale = np.sqrt(np.maximum(np.diag(sums)[:-1], TINIEST_SQUARE))
    right = sums[:-1, -1] / scale
    solution = np.linalg.lstsq(sums[:-1, :-1] / np.outer(scale, scale), right, rcond=1e-12)[0]
    return float(sums[-1, -1] - right @ solution)


def _shape_variances(
    model: TanhModel,
    names: Sequence[str],
    values: Mapping[str, float],
    without: Side,
    measurements: Sequence[Measurement],
    weighting: Weighting,
) -> FloatArray:
    """Variances of the shape parameters under unit noise, if the force of some samples did not depend on them."""
    shaping = [k for k, name in enumerate(names) if name in model.shape_names]
    normal = np.zeros((len(names), len(names)))
    for index, test in enumerate(measurements):
        for rows, piece in pieces_of(model, test):
            slopes = parameter_slopes(model, values, names, piece) * weighting.of(test, index, rows)[:, None]
            slopes[:, shaping] *= ~without(piece)[:, None]
            normal += slopes.T @ slopes
    scale = np.sqrt(np.maximum(np.diag(normal), TINIEST_SQUARE))
    scaled = normal / np.outer(scale, scale) + RIDGE * np.eye(len(names))
    variances: FloatArray = (np.diag(np.linalg.inv(scaled)) / scale**2)[shaping]
    return variances


DEGENERATE = 0.03  # share of its possible energy that the yield force takes out, below which the tanh is sgn(u)
STRAIGHT = 0.15  # largest tanh up to which it is a straight line: its bend is then below 1 %


def explain(
    model: DamperModel,
    known: Information,
    values: Mapping[str, float],
    measurements: Sequence[Measurement],
    weighting: Weighting,
) -> dict[str, Remark]:
    """Reasons for parameters that the fitted model's own slopes cannot tell apart, or that another shape leaves open.

    Args:
        model: the fitted model.
        known: what is known of its parameters at `values`.
        values: the fit (SI).
        measurements: the tests of the fit.
        weighting: the weights of the fit.
    """
    reasons = {
        name: say("inseparable", name=name, partners=", ".join(partners)) if partners else say("no-effect", name=name)
        for name, partners in known.partners.items()
    }
    if isinstance(model, CurrentLawModel):
        known = replace(known, names=tuple(name for name in known.names if name in model.base.names))
    base, seen = _behind_law(model, values, measurements)
    if isinstance(base, TanhModel):
        reasons |= _tanh(base, known, values, seen, weighting)
    if isinstance(base, DigressiveBilinearModel):
        reasons |= _knees(base, known, values, seen, weighting)
    return reasons


def _knees(
    model: DigressiveBilinearModel,
    known: Information,
    values: Mapping[str, float],
    measurements: Sequence[Measurement],
    weighting: Weighting,
) -> dict[str, Remark]:
    """Reasons where one straight line on a side of v = 0 fits as well: which of the two slopes it is, is unknown."""
    scale = motion_scale(measurements)
    form = model.separation(scale)
    shape = form.shape_of(values)
    projected = Projection(form, measurements, weighting, without=frozenset(model.names) - frozenset(known.names))
    left = projected.objective(shape)
    reasons: dict[str, Remark] = {}
    for place, (knee, slopes) in enumerate(model.knees.items()):
        straight = shape.copy()
        straight[place] = BEYOND * scale.top_speed_m_s
        if projected.objective(straight) <= left * (1.0 + DISTINGUISHABLE / max(1, projected.samples)):
            reasons |= {name: say("no-knee", name=name, knee=knee) for name in (knee, *slopes)}
    return reasons


def _behind_law(
    model: DamperModel, values: Mapping[str, float], measurements: Sequence[Measurement]
) -> tuple[DamperModel, Sequence[Measurement]]:
    """The model without its current law, and the tests with what its fluid feels."""
    if isinstance(model, CurrentLawModel):
        return model.base, felt(model, values, measurements)
    return model, measurements


def _tanh(
    model: TanhModel,
    known: Information,
    values: Mapping[str, float],
    measurements: Sequence[Measurement],
    weighting: Weighting,
) -> dict[str, Remark]:
    """Reasons where the tanh is as good as something simpler: sgn(u), a sign function, or a straight line."""
    share, largest = _yield_use(model, values, measurements)
    yielding, offset = (*model.shape_names, *model.yield_names), model.shape_names[1]
    if abs(share) < DEGENERATE:
        return {name: say("degenerate-yield", name=name, offset=offset) for name in yielding}
    with_viscous = (*yielding, *model.of_term("viscous"))
    if largest < STRAIGHT:
        return {name: say("straight-tanh", name=name, largest=largest) for name in with_viscous}
    steep, bent = alternative_shapes(model, known, values, measurements, weighting)
    if not steep:
        return {}
    if bent:
        return {name: say("bent-or-steep", name=name) for name in with_viscous}
    return {name: say("saturated-tanh", name=name) for name in model.shape_names}


def degenerate(model: DamperModel, values: Mapping[str, float], measurements: Sequence[Measurement]) -> list[Remark]:
    """A warning where the tanh follows sgn(u), as with the printed lambda of 1.41 m/s: a yield force without loss."""
    model, measurements = _behind_law(model, values, measurements)
    if not isinstance(model, TanhModel):
        return []
    if abs(_yield_use(model, values, measurements)[0]) >= DEGENERATE:
        return []
    offset = model.shape_names[1]
    return [say("degenerate-hysteresis", offset=offset, value=values[offset])]


def _yield_use(
    model: TanhModel, values: Mapping[str, float], measurements: Sequence[Measurement]
) -> tuple[float, float]:
    """Energy that the yield force takes out as a share of what it would with the speed's sign; its greatest shape."""
    taken = most = largest = 0.0
    for test in measurements:
        for _, piece in pieces_of(model, test):
            yielding = model.yield_shape(values, piece.u_m, piece.v_m_s)
            power = yielding * piece.v_m_s
            taken += float(np.sum(power))
            most += float(np.sum(np.abs(power)))
            largest = max(largest, float(np.max(np.abs(yielding))))
    return (taken / most if most > 0.0 else 1.0), largest
