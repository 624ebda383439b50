"""What a damper's fluid feels of the coil current: a law x(I) that any model takes in place of the current itself.

Yield force, viscosity and stiffness follow the magnetic field, and the field follows the current by one curve: straight
at first, bent where the iron saturates. So one law serves all parameters of a model: its terms per ampere are per
ampere of x. A law that is straight (`affine`) is the model without one.

    saturating    x = (1 - exp(-k_sat |I|)) / k_sat, with the sign of I
    polynomial    x = I + q2 I^2 + q3 I^3
    per-current   x given at each tested current, straight lines between; x = I at the least and the greatest

Each has the slope or the ends of x = I, because a factor and a zero of x are the model's own.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from rig.dampers.arrays import FloatArray
from rig.dampers.parameter import Parameter
from rig.errors import RigError

if TYPE_CHECKING:
    from rig.dampers.kernel import Compiled

AFFINE, SATURATING, POLYNOMIAL, PER_CURRENT = "affine", "saturating", "polynomial", "per-current"
KINDS = (AFFINE, SATURATING, POLYNOMIAL, PER_CURRENT)
AT = "@"
FEWEST_LEVELS = 3
STRAIGHT = 1e-6  # of k_sat |I|, below which the exponential is its series


class UnknownLaw(RigError):
    """No current law has this name; the message says how they are written."""


class CurrentLaw(ABC):
    """A law x(I).

    Attributes:
        text: as it is written behind a model's name, such as `saturating` or `per-current@0,1,2`.
        parameters: its parameters, in the kernel's order.
        formula: x as text.
        demonstration: plausible values for the simulated rig.
    """

    text: str
    parameters: tuple[Parameter, ...]
    formula: str
    demonstration: Mapping[str, float]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    @abstractmethod
    def felt_A(self, values: Mapping[str, float], current_A: ArrayLike) -> FloatArray:
        """What is felt, x (A), at currents (A), of the same shape.

        Raises:
            KeyError: a parameter is missing.
        """

    @abstractmethod
    def compiled(self, first: int) -> Compiled:
        """The same for one current, compiled: (p, current) -> x, its parameters in p from place `first`."""

    def starts(self, most_A: float) -> list[dict[str, float]]:
        """Values from which a search starts, for currents up to `most_A` (A)."""
        del most_A
        return [{parameter.name: parameter.start for parameter in self.parameters}]


class SaturatingLaw(CurrentLaw):
    """x = (1 - exp(-k_sat |I|)) / k_sat: straight for small currents, never beyond 1 / k_sat."""

    text = SATURATING
    formula = "x = sgn(I) (1 - exp(-k_sat |I|)) / k_sat"
    parameters = (
        Parameter("k_sat", "k_sat", "1/A", 0.5, -2.0, 50.0, False, "inverse of the saturation current", power=2),
    )
    demonstration: Mapping[str, float] = {"k_sat": 0.6}

    def felt_A(self, values: Mapping[str, float], current_A: ArrayLike) -> FloatArray:
        """See `CurrentLaw.felt_A`.

        Raises:
            KeyError: a parameter is missing.
        """
        k, current = values["k_sat"], np.asarray(current_A, dtype=float)
        size = np.abs(current)
        if abs(k) * float(np.max(size, initial=0.0)) < STRAIGHT:
            return np.asarray(current * (1.0 - 0.5 * k * size))
        return np.asarray(-np.sign(current) * np.expm1(-k * size) / k)

    def compiled(self, first: int) -> Compiled:
        """See `CurrentLaw.compiled`."""
        from rig.dampers.compiled_cache import njit  # loads numba

        @njit()
        def felt(p: FloatArray, current: float) -> float:
            k, size = p[first], abs(current)
            if abs(k) * size < STRAIGHT:
                return float(current * (1.0 - 0.5 * k * size))
            x = (1.0 - math.exp(-k * size)) / k
            return float(x if current > 0.0 else -x)

        return felt

    def starts(self, most_A: float) -> list[dict[str, float]]:
        """See `CurrentLaw.starts`."""
        return [{"k_sat": bend / max(most_A, 1e-3)} for bend in (0.1, 1.0, 3.0)]


class PolynomialLaw(CurrentLaw):
    """x = I + q2 I^2 + q3 I^3."""

    text = POLYNOMIAL
    formula = "x = I + q2 I^2 + q3 I^3"
    parameters = (
        Parameter("q2", "q2", "1/A", 0.0, -100.0, 100.0, False, "quadratic coefficient of the current law", power=2),
        Parameter("q3", "q3", "1/A^2", 0.0, -100.0, 100.0, False, "cubic coefficient of the current law", power=3),
    )
    demonstration: Mapping[str, float] = {"q2": 0.1, "q3": -0.08}

    def felt_A(self, values: Mapping[str, float], current_A: ArrayLike) -> FloatArray:
        """See `CurrentLaw.felt_A`.

        Raises:
            KeyError: a parameter is missing.
        """
        current = np.asarray(current_A, dtype=float)
        return np.asarray(current * (1.0 + current * (values["q2"] + current * values["q3"])))

    def compiled(self, first: int) -> Compiled:
        """See `CurrentLaw.compiled`."""
        from rig.dampers.compiled_cache import njit  # loads numba

        @njit()
        def felt(p: FloatArray, current: float) -> float:
            return float(current * (1.0 + current * (p[first] + current * p[first + 1])))

        return felt


class TableLaw(CurrentLaw):
    """x given at each of some currents (A), straight lines between, x = I at the first and the last.

    Args:
        levels_A: the currents (A), rising, three or more.

    Raises:
        UnknownLaw: fewer, or they do not rise.
    """

    def __init__(self, levels_A: Sequence[float]) -> None:
        self.levels_A = np.array(levels_A, dtype=float)
        rising = np.all(np.isfinite(self.levels_A)) and np.all(np.diff(self.levels_A) > 0.0)
        if self.levels_A.size < FEWEST_LEVELS or not rising:
            text = ", ".join(f"{level:g}" for level in levels_A) or "none"
            raise UnknownLaw(
                f"{PER_CURRENT}: got currents {text} A, expected at least {FEWEST_LEVELS} in increasing order, such as "
                f"{PER_CURRENT}{AT}0,1,2"
            )
        inner = self.levels_A[1:-1].tolist()
        self.text = f"{PER_CURRENT}{AT}{','.join(f'{level:g}' for level in self.levels_A)}"
        self.formula = f"x interpolated linearly between its values at {', '.join(f'{x:g}' for x in self.levels_A)} A"
        self.parameters = tuple(
            Parameter(f"x at {level:g} A", "x", "A", level, -1e3, 1e3, False, f"effective current at {level:g} A")
            for level in inner
        )
        span, low = self.levels_A[-1] - self.levels_A[0], self.levels_A[0]
        self.demonstration = {
            name: low + (level - low) * (1.0 + 0.4 * (1.0 - (level - low) / span))
            for name, level in zip(self.names, inner, strict=True)
        }

    def felt_A(self, values: Mapping[str, float], current_A: ArrayLike) -> FloatArray:
        """See `CurrentLaw.felt_A`; beyond the ends the outermost lines go on.

        Raises:
            KeyError: a parameter is missing.
        """
        levels, current = self.levels_A, np.asarray(current_A, dtype=float)
        felt = np.array([levels[0], *(values[name] for name in self.names), levels[-1]])
        place = np.clip(np.searchsorted(levels, current, side="left") - 1, 0, levels.size - 2)
        slope = np.diff(felt) / np.diff(levels)
        return np.asarray(felt[place] + slope[place] * (current - levels[place]))

    def compiled(self, first: int) -> Compiled:
        """See `CurrentLaw.compiled`."""
        from rig.dampers.compiled_cache import njit  # loads numba

        levels, last = self.levels_A, self.levels_A.size - 1

        @njit()
        def felt(p: FloatArray, current: float) -> float:
            place = 0
            for k in range(1, last):
                if current > levels[k]:
                    place = k
            low, high = levels[0], levels[last]
            if place > 0:  # not an expression: some languages look at both sides of it
                low = p[first + place - 1]
            if place + 1 < last:
                high = p[first + place]
            share = (current - levels[place]) / (levels[place + 1] - levels[place])
            return float(low + share * (high - low))

        return felt


def current_law(text: str) -> CurrentLaw | None:
    """The law that is written so: `affine` (None), `saturating`, `polynomial`, `per-current@I1,I2,...` (A, rising).

    Raises:
        UnknownLaw: it is none of these.
    """
    if text == AFFINE:
        return None
    if text == SATURATING:
        return SaturatingLaw()
    if text == POLYNOMIAL:
        return PolynomialLaw()
    kind, at, levels = text.partition(AT)
    if kind == PER_CURRENT and at:
        try:
            return TableLaw([float(level) for level in levels.split(",")])
        except ValueError:
            pass
    raise UnknownLaw(
        f"current law: got {text!r}; known: {AFFINE}, {SATURATING}, {POLYNOMIAL}, {PER_CURRENT}{AT}I1,I2,... (three or "
        f"more currents in A in increasing order, such as {PER_CURRENT}{AT}0,1,2)"
    )
