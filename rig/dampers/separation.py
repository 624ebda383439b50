"""What a fit needs to know of a model: how it splits into shape and linear rest, or how all of it is searched for."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Protocol

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.dampers.integrable import Integrable

FASTEST = 5.0  # rate of a state, times the sampling interval, beyond which it is rigid and cannot be followed
SCANNED_DECADES = (0.1, 1.0, 10.0)  # of a shape parameter's start, where a model says nothing better


@dataclass(frozen=True)
class MotionScale:
    """What the motion of some tests is like.

    Attributes:
        smallest_amplitude_m: of the test that moves least (m).
        top_speed_m_s: greatest speed of all (m/s).
        mean_current_A: mean over the tests (A).
        low_current_A: least current (A).
        high_current_A: greatest current (A).
        interval_s: shortest sampling interval (s).
    """

    smallest_amplitude_m: float
    top_speed_m_s: float
    mean_current_A: float
    low_current_A: float
    high_current_A: float
    interval_s: float

    @property
    def fastest_1_s(self) -> float:
        """The fastest rate (1/s) of an internal state that these tests can follow."""
        return FASTEST / self.interval_s


class Motion(Protocol):
    """A sampled test: motion about mid-stroke and current, (n,) each, interval, samples of its first whole cycle."""

    @property
    def u_m(self) -> FloatArray: ...  # noqa: D102 - described above
    @property
    def v_m_s(self) -> FloatArray: ...  # noqa: D102 - described above
    @property
    def a_m_s2(self) -> FloatArray: ...  # noqa: D102 - described above
    @property
    def current_A(self) -> FloatArray: ...  # noqa: D102 - described above
    @property
    def dt_s(self) -> float: ...  # noqa: D102 - described above
    @property
    def samples_per_cycle(self) -> int: ...  # noqa: D102 - described above


@dataclass(frozen=True)
class JoinedMotions:
    """Motions of several tests, one after the other in each array (n,); what has a memory starts again at each of them.

    Attributes:
        u_m: extension about mid-stroke (m).
        v_m_s: velocity (m/s).
        a_m_s2: acceleration (m/s^2).
        current_A: coil current (A).
        stretches: first sample, sampling interval (s) and samples of the first whole cycle (0: no whole cycle) of each
            test; the last row is the end. Shape (tests + 1, 3).
    """

    u_m: FloatArray
    v_m_s: FloatArray
    a_m_s2: FloatArray
    current_A: FloatArray
    stretches: FloatArray

    @classmethod
    def of(cls, motions: Sequence[Motion]) -> JoinedMotions:
        """Several motions, one after the other."""
        ends = np.cumsum([0, *(one.u_m.size for one in motions)])
        cycles = [one.samples_per_cycle if one.samples_per_cycle > 1 else 0 for one in motions]
        return cls(
            np.concatenate([one.u_m for one in motions]),
            np.concatenate([one.v_m_s for one in motions]),
            np.concatenate([one.a_m_s2 for one in motions]),
            np.concatenate([one.current_A for one in motions]),
            np.column_stack((ends, [*(one.dt_s for one in motions), 0.0], [*cycles, 0])).astype(float),
        )


class Separation(Protocol):
    """A model split for projection: what is linear without the shape, and the yield shapes times powers of the current.

    Attributes:
        fixed_names: linear parameters whose regressors need no shape parameter.
        yield_names: linear parameters of the yield shapes, of each by rising powers of the current.
        powers: how many of `yield_names` belong to each yield shape.
        shape_names: the nonlinear parameters.
        bends: for each of them, which yield shapes it bends, next to each other and rising.
        logarithmic: for each of them, whether it is positive and searched by its logarithm.
        limits: lowest and highest value of each shape parameter, shape (s, 2).
        pointwise: whether a sample's regressors need no other sample, so that samples may be left out.
        starts: shapes from which the best is refined, each (s,).
    """

    @property
    def fixed_names(self) -> tuple[str, ...]: ...  # noqa: D102 - described above
    @property
    def yield_names(self) -> tuple[str, ...]: ...  # noqa: D102 - described above
    @property
    def powers(self) -> tuple[int, ...]: ...  # noqa: D102 - described above
    @property
    def bends(self) -> tuple[tuple[int, ...], ...]: ...  # noqa: D102 - described above
    @property
    def shape_names(self) -> tuple[str, ...]: ...  # noqa: D102 - described above
    @property
    def logarithmic(self) -> tuple[bool, ...]: ...  # noqa: D102 - described above
    @property
    def limits(self) -> FloatArray: ...  # noqa: D102 - described above
    @property
    def pointwise(self) -> bool: ...  # noqa: D102 - described above
    @property
    def starts(self) -> Sequence[FloatArray]: ...  # noqa: D102 - described above

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """Regressors of `fixed_names`, shape (n, k), from extension (m), velocity, acceleration and current (A)."""

    def yielding(self, source: Motion, rows: slice, shape: FloatArray, *, slope: bool) -> list[FloatArray]:
        """The yield shapes of some rows, each (n,); with `slope`, then the derivatives, by `bends`."""

    def held_here(self, held: frozenset[str]) -> frozenset[str]:
        """The names here of the model's parameters that are held at zero."""

    def values(self, linear: FloatArray, shape: FloatArray) -> dict[str, float]:
        """The model's own parameters (SI) from the linear ones (fixed, then yield) and the shape."""

    def shape_of(self, values: Mapping[str, float]) -> FloatArray:
        """The shape (s,) for the model's own values (SI), inside the limits."""

    def at_limit(self, met: Mapping[str, float]) -> dict[str, float]:
        """Shape parameters that lie at a limit, by the model's own names, with the limit in their unit."""


class OwnNames:
    """What a `Separation` says of names and limits where its parameters are the model's own, by their own names."""

    fixed_names: tuple[str, ...]
    yield_names: tuple[str, ...]
    shape_names: tuple[str, ...]
    limits: FloatArray

    def held_here(self, held: frozenset[str]) -> frozenset[str]:
        """See `Separation.held_here`."""
        return held

    def values(self, linear: FloatArray, shape: FloatArray) -> dict[str, float]:
        """See `Separation.values`."""
        names = (*self.fixed_names, *self.yield_names, *self.shape_names)
        return {name: float(value) for name, value in zip(names, (*linear, *shape), strict=True)}

    def shape_of(self, values: Mapping[str, float]) -> FloatArray:
        """See `Separation.shape_of`."""
        shape = np.array([values[name] for name in self.shape_names])
        return np.asarray(np.clip(shape, self.limits[:, 0], self.limits[:, 1]))

    def at_limit(self, met: Mapping[str, float]) -> dict[str, float]:
        """See `Separation.at_limit`."""
        return dict(met)


class Joinable:
    """Base of a `Separation` whose `yielding` also accepts `JoinedMotions`: one call for many short tests."""


@dataclass(frozen=True)
class Unknowns:
    """How a vector of unknowns becomes the parameters of a model that does not split.

    Attributes:
        names: what is searched.
        logarithmic: which of them are searched by their logarithm.
        scales: sizes at which the others move.
        model: the model.
        held: parameters of the model left at zero.
        translated: the model's own values from the named unknowns and its starts, where their names differ.
    """

    names: tuple[str, ...]
    logarithmic: BoolArray
    scales: FloatArray
    model: Integrable
    held: frozenset[str]
    translated: Callable[[dict[str, float], dict[str, float]], dict[str, float]]

    def vector(self, theta: FloatArray) -> FloatArray:
        """The model's own vector."""
        natural = np.where(self.logarithmic, np.exp(np.where(self.logarithmic, theta, 0.0)), theta * self.scales)
        named = dict(zip(self.names, natural.tolist(), strict=True))
        starts = {parameter.name: parameter.start for parameter in self.model.parameters}
        values = self.translated(starts, named)
        return self.model.vector({name: 0.0 if name in self.held else values[name] for name in self.model.names})

    def values(self, theta: FloatArray) -> dict[str, float]:
        """The model's own values by name."""
        return dict(zip(self.model.names, self.vector(theta).tolist(), strict=True))

    def theta(self, values: Mapping[str, float]) -> FloatArray:
        """The unknowns of named values."""
        natural = np.array([values[name] for name in self.names])
        return np.where(self.logarithmic, np.log(np.where(self.logarithmic, natural, 1.0)), natural / self.scales)


class Search:
    """How all parameters of a model with internal states are searched for at once, where it says nothing better.

    The unknowns are the parameters themselves, positive shapes by their logarithm; starts are every combination of a
    tenth, once and ten times the shapes' starts, with the linear parameters at theirs.

    Attributes:
        model: the model.
        simpler: name of a model that this one contains as a limit and whose fit gives the starts; empty for none.
        simpler_names: for parameters held at zero, their names in the simpler model.
        family: successive starts of which the best is refined.
    """

    simpler: str = ""
    simpler_names: Mapping[str, str] = {}
    family: int = 3

    def __init__(self, model: Integrable) -> None:
        self.model = model

    def starts(self, simple: Mapping[str, float], scale: MotionScale) -> list[dict[str, float]]:
        """Named unknowns to start from, the likeliest families first.

        Args:
            simple: the simpler model's fitted values (SI); empty without one.
            scale: what the tests' motion is like.
        """
        del simple, scale
        own = {parameter.name: parameter.start for parameter in self.model.parameters if parameter.name != "eta"}
        shapes = [
            parameter
            for parameter in self.model.parameters
            if not parameter.linear and parameter.name in own and parameter.start > 0.0
        ]
        choices = [
            [min(max(share * shape.start, shape.low), shape.high) for share in SCANNED_DECADES] for shape in shapes
        ]
        names = [shape.name for shape in shapes]
        return [own | dict(zip(names, chosen, strict=True)) for chosen in product(*choices)]

    def named(self, values: Mapping[str, float]) -> dict[str, float]:
        """The unknowns by name for the model's own values (SI)."""
        return dict(values)

    def unknowns(self, start: Mapping[str, float], held: frozenset[str]) -> Unknowns:
        """The unknowns, scaled by where they start, and what is held at zero."""
        names = tuple(name for name in self.model.names if name not in held and name != "eta")
        parameters = [self.model.parameter(name) for name in names]
        logarithmic = np.array(
            [not parameter.linear and parameter.low >= 0.0 and start[parameter.name] > 0.0 for parameter in parameters]
        )
        sizes = np.array([max(abs(start[parameter.name]), abs(parameter.start), 1e-6) for parameter in parameters])
        return Unknowns(names, logarithmic, sizes, self.model, held, lambda starts, named: starts | named)

    def admissible(self, values: Mapping[str, float], scale: MotionScale) -> bool:
        """Whether the model can be integrated with these values on such tests, and they are physical."""
        del scale
        parameters = (
            parameter for parameter in self.model.parameters if not parameter.linear and parameter.name in values
        )
        return all(
            math.isfinite(values[parameter.name]) and parameter.low <= values[parameter.name] <= parameter.high
            for parameter in parameters
        )

    def at_limit(self, unknowns: Unknowns, theta: FloatArray) -> dict[str, float]:
        """Parameters at which the search ended at a limit, and that limit."""
        values = unknowns.values(theta)
        return {
            parameter.name: end
            for parameter in self.model.parameters
            if not parameter.linear and parameter.name in unknowns.names
            for end in (parameter.low, parameter.high)
            if math.isclose(values[parameter.name], end, rel_tol=1e-3)
        }
