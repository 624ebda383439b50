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
from rig.dampers.separation import Motion, OwnNames

DIFFERENCE = 1e-4  # share of a shape parameter by which it is moved for its slope
WITHOUT_SHAPE = ("kx", "kv", "kv_b", "kva", "kva_b", "f0")  # u, v, v I, |v|, |v| I, 1


class UnitSeparation(OwnNames):
    """A model split for projection (see `Separation`).

    Args:
        model: the model; its linear parameters are `WITHOUT_SHAPE`, or of `yields`.
        yields: names of the yield terms at zero current; their terms per ampere follow by `at_zero`.
        shapes: for each shape parameter its lowest and highest value and its starts; every combination is tried.
    """

    pointwise = False

    def __init__(
        self, model: Integrable, yields: Sequence[str], shapes: Mapping[str, tuple[float, float, Sequence[float]]]
    ) -> None:
        self.model = model
        self._bases = tuple(yields)
        self.fixed_names: tuple[str, ...] = tuple(name for name in WITHOUT_SHAPE if name in model.names)
        terms = [[name, *self._per_ampere(name)] for name in yields]
        self.yield_names: tuple[str, ...] = tuple(name for group in terms for name in group)
        self.powers: tuple[int, ...] = tuple(len(group) for group in terms)
        self.shape_names: tuple[str, ...] = tuple(shapes)
        self.bends: tuple[tuple[int, ...], ...] = (tuple(range(len(terms))),) * len(shapes)
        self.limits = np.array([(low, high) for low, high, _ in shapes.values()])
        self.logarithmic: tuple[bool, ...] = tuple(low > 0.0 for low, _, _ in shapes.values())
        self.starts: Sequence[FloatArray] = [
            np.array(chosen) for chosen in product(*(starts for _, _, starts in shapes.values()))
        ]

    def _per_ampere(self, name: str) -> list[str]:
        return [parameter.name for parameter in self.model.parameters if parameter.at_zero == name]

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `Separation.fixed_columns`."""
        del a
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
