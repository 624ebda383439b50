"""What a damper model is: named parameters, an equation, a force, a kernel, and what a fit needs to know of it.

One object owns all of it: its parameters (name, unit, limits, role), its equation, its compiled kernel, the columns and
slopes that a fit uses, where its force jumps, and which parameters which tests cannot tell. So a new model is one file,
and one line in `catalogue`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from rig.dampers.arrays import FloatArray
from rig.dampers.parameter import Hysteresis, Parameter, Term

if TYPE_CHECKING:  # it loads numba
    from rig.dampers.kernel import Compiled, Kernel
    from rig.dampers.separation import MotionScale, Search, Separation

Jump = Literal["mid-stroke", "reversal", ""]


class DamperModel(ABC):
    """A damper force model; motion about mid-stroke in, force (N) out.

    Attributes:
        name: key in `rig.dampers.MODELS`.
        parameters: in the order of the kernel's vector.
        states: number of internal states; 0 for algebraic models.
        positions: how many of them, from the first, are positions, which move with the rod.
        memories: how many of them, from the last, are low-passes of the speed (m/s).
        equation: the force as text, with its source.
        energy: what it dissipates, and where it gives energy back.
        forms: forms of the hysteresis argument that it has.
        hysteresis: the form of this one.
        jumps_at: where the force jumps, so that noise of motion or clocks puts samples on the wrong side.
        redundant: parameters that only scale others, and those; the others are known for one choice of it only.
        apart_at_one_current: parameters of power 1 that one current tells from their value at 0 A.
        speeds_tell_yield: whether a single speed tells yield force from viscous force.
        non_negative: linear parameters that no damper has below 0; a fit that finds one there holds it at 0.
        demonstration: plausible values of a damper for the simulated rig, complete; these are not a published fit.
    """

    name: ClassVar[str]
    states: ClassVar[int]
    positions: ClassVar[int] = 0
    memories: ClassVar[int] = 0
    equation: ClassVar[str]
    energy: ClassVar[str] = ""
    forms: ClassVar[tuple[Hysteresis, ...]] = ("kwok",)
    jumps_at: ClassVar[Jump] = ""
    redundant: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    apart_at_one_current: ClassVar[tuple[str, ...]] = ()
    speeds_tell_yield: ClassVar[bool] = False
    non_negative: ClassVar[tuple[str, ...]] = ()
    demonstration: ClassVar[Mapping[str, float]]
    hysteresis: Hysteresis = "kwok"
    parameters: tuple[Parameter, ...]

    @property
    def first_memory(self) -> int:
        """Place of the first of the `memories` among the states."""
        return self.states - self.memories

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Parameter names in the kernel's order."""
        return tuple(parameter.name for parameter in self.parameters)

    def parameter(self, name: str) -> Parameter:
        """The parameter called `name`.

        Raises:
            KeyError: the model has no such parameter; the message lists those it has.
        """
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise KeyError(f"{self.name}: got parameter {name!r}, expected one of {', '.join(self.names)}")

    def of_term(self, term: Term) -> tuple[str, ...]:
        """Names of the parameters of one part of the force."""
        return tuple(parameter.name for parameter in self.parameters if parameter.term == term)

    def vector(self, values: Mapping[str, float]) -> FloatArray:
        """Values in the kernel's order, shape (len(parameters),), SI.

        Raises:
            KeyError: a name is missing or unknown.
        """
        names = self.names
        if values.keys() != set(names):
            missing = [name for name in names if name not in values]
            unknown = [name for name in values if name not in names]
            raise KeyError(f"{self.name}: missing {missing}, unknown {unknown}; expected {', '.join(names)}")
        return np.array([float(values[name]) for name in names])

    def values(self, vector: Sequence[float] | FloatArray) -> dict[str, float]:
        """The inverse of `vector`: names to values (SI).

        Raises:
            ValueError: the vector's length is not the number of parameters.
        """
        return {name: float(value) for name, value in zip(self.names, vector, strict=True)}

    def initial_state(self, u_m: float = 0.0) -> FloatArray:
        """Internal state at rest at extension `u_m` (m), springs free; shape (max(states, 1),)."""
        state = np.zeros(max(self.states, 1))
        state[: self.positions] = u_m
        return state

    @abstractmethod
    def kernel(self) -> Kernel:
        """The equation compiled: force, and rates of the internal states, of one instant."""

    def slopes_along(self) -> Compiled | None:
        """Force and its slopes over all parameters along a sampled motion, compiled; None: found by differences.

        Called as `rig.dampers.kernel.series_of` is; gives the force (N), (n,), and the slopes, (n, parameters).
        """
        return None

    @abstractmethod
    def separation(self, scale: MotionScale) -> Separation | None:
        """How the model splits into a few shape parameters and a linear rest, and starts for the shape.

        None for a model that is searched for with all parameters at once, by `search`.

        Args:
            scale: what the tests' motion is like.
        """

    def search(self) -> Search:
        """How all parameters of a model that does not split are searched for at once.

        Raises:
            NotImplementedError: the model splits.
        """
        raise NotImplementedError(f"{self.name} is separable: see `separation`")

    @abstractmethod
    def force(
        self,
        parameters: Mapping[str, float],
        u: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        current: ArrayLike,
        dt_s: float,
    ) -> FloatArray:
        """Force (N) along a uniformly sampled motion.

        Args:
            parameters: parameter name to SI value; complete.
            u: extension about mid-stroke (m), shape (n,).
            v: velocity (m/s), shape (n,).
            a: acceleration (m/s^2), shape (n,).
            current: coil current after its lag (A), shape (n,) or a scalar.
            dt_s: sampling interval (s); algebraic models do not use it.

        Returns:
            Force, shape (n,); positive resists extension.

        Raises:
            KeyError: a parameter is missing or unknown.
        """

    def force_at(self, parameters: Mapping[str, float], v: ArrayLike, current: ArrayLike) -> FloatArray:
        """Force (N) on the sliding branch, passing mid-stroke at constant velocity.

        `v` (m/s) and `current` (A) are broadcast. The value of the tanh models is the mean of both sides of u = 0.

        Raises:
            KeyError: a parameter is missing or unknown.
        """
        v_grid, current_grid = np.broadcast_arrays(np.asarray(v, dtype=float), np.asarray(current, dtype=float))
        flat = [
            self._sliding_force(parameters, float(speed), float(amps))
            for speed, amps in zip(v_grid.ravel(), current_grid.ravel(), strict=True)
        ]
        return np.array(flat).reshape(v_grid.shape)

    def _sliding_force(self, parameters: Mapping[str, float], v_m_s: float, current_A: float) -> float:
        """Force (N) after 20 mm of travel at constant velocity, at mid-stroke."""
        if v_m_s == 0.0:
            return float(self.force(parameters, np.zeros(1), np.zeros(1), np.zeros(1), current_A, 1e-3)[0])
        steps = 400
        travel_m = 0.02
        dt_s = travel_m / abs(v_m_s) / steps
        u = np.sign(v_m_s) * np.linspace(-travel_m, 0.0, steps + 1)
        v = np.full(steps + 1, v_m_s)
        return float(self.force(parameters, u, v, np.zeros(steps + 1), current_A, dt_s)[-1])


class KernelModel(DamperModel):
    """A model whose force along a motion is its compiled kernel, sample after sample."""

    def force(
        self,
        parameters: Mapping[str, float],
        u: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        current: ArrayLike,
        dt_s: float,
    ) -> FloatArray:
        """See `DamperModel.force`; the first sample starts from `initial_state`.

        Raises:
            KeyError: a parameter is missing or unknown.
            ValueError: motion or current holds what is no number: every state after it would be none.
        """
        from rig.dampers.kernel import force_series  # loads numba

        motion = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (u, v, a, current)))
        u_m, v_m_s, a_m_s2, current_A = (np.array(x) for x in motion)
        for what, values in zip(("u", "v", "a", "current"), motion, strict=True):
            if not np.all(np.isfinite(values)):
                at = int(np.flatnonzero(~np.isfinite(values))[0])
                raise ValueError(f"{self.name}: {what}[{at}] = {values[at]:g}, expected a number")
        state = self.initial_state(float(u_m[0]))
        data = (u_m, v_m_s, a_m_s2, current_A)
        force: FloatArray = force_series(self, self.vector(parameters), state, *data, dt_s, 0)
        return force

    def separation(self, scale: MotionScale) -> Separation | None:
        """See `DamperModel.separation`: None, unless the model states how it splits."""
        del scale
        return None

    def search(self) -> Search:
        """See `DamperModel.search`: from the parameters' starts, all positive shapes by their logarithm."""
        from rig.dampers.separation import Search  # that module builds on this one

        return Search(self)


class HystereticModel(KernelModel):
    """A model whose force depends on earlier motion, through internal states."""


class AlgebraicModel(KernelModel):
    """A model without internal states: its force follows from the motion and the current of the same instant.

    Its parameters and its kernel are sufficient: a fit splits it by `Parameter.linear`.
    """

    states: ClassVar[int] = 0

    def separation(self, scale: MotionScale) -> Separation | None:
        """See `DamperModel.separation`: all linear parameters, and the others as its shape.

        None where that cannot be done: too many shape parameters for a grid, or linear ones that must not be negative.

        Raises:
            ModelProblem: the parameters are inconsistent.
        """
        del scale
        from rig.dampers.unit_columns import separation_by_kernel  # that module builds on this one

        return separation_by_kernel(self, self.non_negative)

    def _sliding_force(self, parameters: Mapping[str, float], v_m_s: float, current_A: float) -> float:
        sides = np.array([-1e-12, 1e-12])
        return float(np.mean(self.force(parameters, sides, np.full(2, v_m_s), np.zeros(2), current_A, 1e-3)))
