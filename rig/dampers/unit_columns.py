"""Any model that is linear in some of its parameters split for projection by running it: no formula is written twice.

Given the shape parameters, the force is a sum of columns, and the column of a linear parameter is the force of the
model with that parameter at 1 and all other linear ones at 0. So a model needs to say only which parameters are its
yield terms, where its shape may lie, and where to start; slopes come from differences.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.integrable import Integrable
from rig.dampers.parameter import LAG, ModelProblem, Parameter
from rig.dampers.separation import Motion, OwnNames

DIFFERENCE = 1e-4  # share of a shape parameter by which it is moved for its slope
WITHOUT_SHAPE = ("kx", "kv", "kv_b", "kva", "kva_b", "f0")  # u, v, v I, |v|, |v| I, 1


class UnitSeparation(OwnNames):
    """A model split for projection (see `Separation`).

    Linear parameters that are neither named `WITHOUT_SHAPE` nor in `yields` are further terms, found by the kernel.

    Args:
        model: the model; linear parameters named as in `WITHOUT_SHAPE` are coefficients of the columns listed there.
        yields: names of the yield terms at zero current; their terms per ampere follow by `at_zero`.
        shapes: for each shape parameter its lowest and highest value and its starts; every combination is tried.

    Raises:
        ModelProblem: a name is not such a parameter of the model, a shape parameter is missing, or powers of the
            current of a term are not 0, 1, 2 in the order of the parameters.
    """

    pointwise = False

    def __init__(
        self, model: Integrable, yields: Sequence[str], shapes: Mapping[str, tuple[float, float, Sequence[float]]]
    ) -> None:
        self.model = model
        terms = [[name, *self._per_ampere(name)] for name in yields]
        chosen = {name for group in terms for name in group}
        self.fixed_names: tuple[str, ...] = tuple(
            name for name in WITHOUT_SHAPE if name in model.names and name not in chosen
        )
        chosen |= set(self.fixed_names)
        for parameter in model.parameters:
            if parameter.linear and parameter.name not in chosen:
                own = [name for name in self._per_ampere(parameter.name) if name not in chosen]
                terms.append([parameter.name, *own])
                chosen |= set(terms[-1])
        _check(model, terms, tuple(shapes))
        self._bases = tuple(group[0] for group in terms)
        self.yield_names: tuple[str, ...] = tuple(name for group in terms for name in group)
        self.powers: tuple[int, ...] = tuple(len(group) for group in terms)
        self.shape_names: tuple[str, ...] = tuple(shapes)
        self.bends: tuple[tuple[int, ...], ...] = (tuple(range(len(terms))),) * len(shapes)
        self.limits = np.array([(low, high) for low, high, _ in shapes.values()]).reshape(-1, 2)
        self.logarithmic: tuple[bool, ...] = tuple(low > 0.0 for low, _, _ in shapes.values())
        self.starts: Sequence[FloatArray] = [
            np.array(start, dtype=np.float64) for start in product(*(starts for _, _, starts in shapes.values()))
        ]

    def _per_ampere(self, name: str) -> list[str]:
        return [one.name for one in self.model.parameters if one.linear and one.at_zero == name]

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `Separation.fixed_columns`."""
        del a
        if not self.fixed_names:
            return np.empty((u.size, 0))
        speed = np.abs(v)
        known = (u, v, v * current, speed, speed * current, np.ones_like(u))
        columns = dict(zip(WITHOUT_SHAPE, known, strict=True))
        return np.column_stack([columns[name] for name in self.fixed_names])

    def yielding(self, source: Motion, rows: slice, shape: FloatArray, *, slope: bool) -> list[FloatArray]:
        """See `Separation.yielding`."""
        here = [column[rows] for column in self.columns(source, shape)]
        if not slope:
            return here
        slopes = []
        for k, value in enumerate(shape):
            moved = shape.copy()
            moved[k] = value + DIFFERENCE * (abs(value) + 1e-3)
            step = moved[k] - value
            there = self.columns(source, moved)
            slopes += [(column[rows] - at) / step for column, at in zip(there, here, strict=True)]
        return [*here, *slopes]

    def columns(self, source: Motion, shape: FloatArray) -> list[FloatArray]:
        """The columns of all yield terms at zero current, each (n,)."""
        return [self.column(source, name, shape) for name in self._bases]

    def column(self, source: Motion, name: str, shape: FloatArray) -> FloatArray:
        """The force (N per unit of the parameter) with one linear parameter at 1 and the others at 0, shape (n,)."""
        from rig.dampers.kernel import force_series  # loads numba

        values = dict.fromkeys(self.model.names, 0.0) | dict(zip(self.shape_names, shape.tolist(), strict=True))
        motion = (source.u_m, source.v_m_s, source.a_m_s2, source.current_A)
        state, vector = self.model.initial_state(float(source.u_m[0])), self.model.vector(values | {name: 1.0})
        return force_series(self.model, vector, state, *motion, source.dt_s, source.samples_per_cycle)

    def held_here(self, held: frozenset[str]) -> frozenset[str]:
        """See `Separation.held_here`; a shape parameter that is held stays at zero, its only value from here on."""
        for k, name in enumerate(self.shape_names):
            if name in held:
                self.limits[k] = 0.0
                for start in self.starts:
                    start[k] = 0.0
        return held


def _check(model: Integrable, terms: Sequence[Sequence[str]], shapes: Sequence[str]) -> None:
    """Refuse terms and shape parameters that are not the model's.

    Raises:
        ModelProblem: one of these.
    """
    linear = {one.name: one for one in model.parameters if one.linear}
    if wrong := [name for group in terms for name in group if name not in linear]:
        raise ModelProblem(
            f"{model.name}: got linear terms {', '.join(wrong)}, expected names from {', '.join(linear)}"
        )
    bent = {one.name for one in _bending(model)}
    if bent != set(shapes):
        raise ModelProblem(
            f"{model.name}: got shape parameters {', '.join(shapes) or 'none'}, expected "
            f"{', '.join(sorted(bent)) or 'none'} (every parameter that is not linear, except eta). Fix: correct the "
            "model's separation, or omit it"
        )
    for group in terms:
        powers = [linear[name].power for name in group]
        if powers != list(range(len(group))):
            raise ModelProblem(
                f"{model.name}: terms {', '.join(group)} have the powers {powers} of the current, expected "
                f"{list(range(len(group)))}. Fix: set at_zero and power of these parameters, or mark them as not linear"
            )


def _bending(model: Integrable) -> list[Parameter]:
    """The shape parameters: all that are not linear, except the coil's lag."""
    return [one for one in model.parameters if not one.linear and one.name != LAG.name]


STARTS = {0: 1, 1: 9, 2: 9, 3: 5, 4: 3, 5: 3}  # of each shape parameter, by how many there are: at most 243 in all
DECADES = 2.0  # around the start of a positive shape parameter


def separation_by_kernel(model: Integrable, non_negative: Sequence[str] = ()) -> UnitSeparation | None:
    """Any algebraic model split by the roles of its parameters; see `AlgebraicModel.separation`.

    Args:
        model: the model.
        non_negative: linear parameters that must not be negative.

    Raises:
        ModelProblem: as `UnitSeparation`.
    """
    bending = _bending(model)
    terms = [one.name for one in model.parameters if one.linear and not one.at_zero]
    if not terms or non_negative or len(bending) not in STARTS:
        return None
    shapes = {one.name: (one.low, one.high, _starts(one, STARTS[len(bending)])) for one in bending}
    return UnitSeparation(model, terms, shapes)


def _starts(parameter: Parameter, count: int) -> list[float]:
    """Values of a shape parameter to start from: over decades around its start, or both signs of it."""
    low, high, start = parameter.low, parameter.high, parameter.start
    if low > 0.0:
        factor = 10.0**DECADES
        return [float(at) for at in np.geomspace(max(low, start / factor), min(high, start * factor), count)]
    both = {float(np.clip(share * start, low, high)) for share in (-1.0, 0.0, 1.0)}
    return sorted(both) if start else [float(at) for at in np.linspace(low, high, count + 2)[1:-1]]
