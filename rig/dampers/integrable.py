"""What integration and search need of a damper model: parameters, states and the compiled equation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol

from rig.dampers.arrays import FloatArray
from rig.dampers.parameter import Hysteresis, Parameter


class Integrable(Protocol):
    """A damper model as integration and search see it; hashable, one compiled loop each."""

    name: ClassVar[str]
    states: ClassVar[int]
    positions: ClassVar[int]
    memories: ClassVar[int]

    @property
    def first_memory(self) -> int:
        """Place of the first of the memories among the states."""

    @property
    def hysteresis(self) -> Hysteresis:
        """Argument of the tanh models' hysteresis."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters in the kernel's order."""

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""

    def parameter(self, name: str) -> Parameter:
        """The parameter called `name`."""

    def vector(self, parameters: Mapping[str, float], /) -> FloatArray:
        """Values in the kernel's order, SI."""

    def initial_state(self, u_m: float = 0.0, /) -> FloatArray:
        """Internal states at rest at that displacement (m)."""

    def __hash__(self) -> int:
        """Models with the same equation are equal."""

    def slopes_along(self) -> Any:  # noqa: ANN401 - a function compiled by numba
        """The force's slopes over all parameters, compiled; None where they are found by differences."""

    def kernel(self) -> Any:  # noqa: ANN401 - functions compiled by numba
        """The equation, compiled (`rig.dampers.kernel.Kernel`)."""
