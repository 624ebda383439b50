"""Parameters of damper models: name, unit, role and limits; sets of their values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from rig.errors import RigError

Hysteresis = Literal["kwok", "printed"]
Term = Literal["inertia", "stiffness", "viscous", "yield", "shape", ""]


class ModelProblem(RigError):
    """The definition of a damper model is incomplete or inconsistent; the message is for its author."""


@dataclass(frozen=True)
class Parameter:
    """A model parameter as data.

    Attributes:
        name: key in mappings, files and JSON.
        symbol: as written in the cited equation.
        unit: SI unit, "1" when it has none.
        start: sensible first guess, in `unit`.
        low: lowest admissible value, in `unit`.
        high: highest admissible value, in `unit`.
        linear: whether the force is linear in it once the other nonlinear ones are given.
        meaning: one phrase for tables and messages.
        term: which part of the force it belongs to, where tests may fail to tell that part from another.
        at_zero: the parameter whose value at zero current this one adds to, times a power of the current.
        power: that power; 0 for a parameter that does not depend on the current.
        softens: whether warm oil weakens it.
    """

    name: str
    symbol: str
    unit: str
    start: float
    low: float
    high: float
    linear: bool
    meaning: str
    term: Term = ""
    at_zero: str = ""
    power: int = 0
    softens: bool = False


@dataclass(frozen=True)
class ParameterSet:
    """Named values of one model.

    Attributes:
        name: how users ask for it.
        model: name of the model in `rig.dampers.MODELS`.
        values: parameter name to SI value; complete.
        source: publication, table and how the values were read.
        hysteresis: form of the hysteresis argument; only the tanh models have two.
    """

    name: str
    model: str
    values: Mapping[str, float]
    source: str
    hysteresis: Hysteresis = "kwok"


#: The coil current's first-order lag (equation 9), which belongs to the coil and not to the force.
LAG = Parameter("eta", "eta", "1/s", 25.0, 0.1, 1e4, False, "rate of the first-order lag of the coil current")


def linear_parameter(
    name: str,
    unit: str,
    start: float,
    meaning: str,
    *,
    symbol: str = "",
    limit: float = 1e6,
    term: Term = "",
    at_zero: str = "",
    power: int = 0,
    softens: bool = False,
) -> Parameter:
    """A linear parameter, of either sign up to `limit`; one that is `at_zero` of another has power 1 unless told."""
    power = power or (1 if at_zero else 0)
    return Parameter(name, symbol or name, unit, start, -limit, limit, True, meaning, term, at_zero, power, softens)


def shape_parameter(
    name: str,
    unit: str,
    start: float,
    low: float,
    high: float,
    meaning: str,
    *,
    term: Term = "",
    at_zero: str = "",
    softens: bool = False,
) -> Parameter:
    """A nonlinear parameter between `low` and `high`."""
    power = 1 if at_zero else 0
    return Parameter(name, name, unit, start, low, high, False, meaning, term, at_zero, power, softens)
