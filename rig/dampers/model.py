"""What every damper model is: named parameters, an equation, and a force for a motion and a current."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from rig.dampers.arrays import FloatArray
from rig.dampers.parameter import Parameter


class DamperModel(ABC):
    """A damper force model; motion about mid-stroke in, force (N) out.

    Attributes:
        name: key in `rig.dampers.MODELS`.
        kind: integer that selects the model in `rig.dampers.kernels.advance`.
        parameters: in the order of the kernel's vector.
        states: number of internal states; 0 for algebraic models.
        equation: the force as text, with its source.
    """

    name: ClassVar[str]
    states: ClassVar[int]
    equation: ClassVar[str]
    kind: int
    parameters: tuple[Parameter, ...]

    @property
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
        raise KeyError(f"{self.name} has no parameter {name!r}; it has {', '.join(self.names)}")

    def vector(self, values: Mapping[str, float]) -> FloatArray:
        """Values in the kernel's order, shape (len(parameters),), SI.

        Raises:
            KeyError: a name is missing or unknown.
        """
        missing = [name for name in self.names if name not in values]
        unknown = [name for name in values if name not in self.names]
        if missing or unknown:
            raise KeyError(f"{self.name}: missing {missing}, unknown {unknown}; it takes {', '.join(self.names)}")
        return np.array([float(values[name]) for name in self.names])

    def values(self, vector: Sequence[float] | FloatArray) -> dict[str, float]:
        """The inverse of `vector`: names to values (SI).

        Raises:
            ValueError: the vector's length is not the number of parameters.
        """
        return {name: float(value) for name, value in zip(self.names, vector, strict=True)}

    def initial_state(self, u_m: float = 0.0) -> FloatArray:
        """Internal state at rest at extension `u_m` (m); shape (max(states, 1),)."""
        del u_m
        return np.zeros(max(self.states, 1))

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
