"""One named parameter of a damper model, and a named, sourced set of values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


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
    """

    name: str
    symbol: str
    unit: str
    start: float
    low: float
    high: float
    linear: bool
    meaning: str


@dataclass(frozen=True)
class ParameterSet:
    """Named values of one model.

    Attributes:
        name: how users ask for it.
        model: name of the model in `rig.dampers.MODELS`.
        values: parameter name to SI value; complete.
        source: publication, table and how the values were read.
        hysteresis: form of the hysteresis argument ("kwok" or "printed"); only the tanh models have two.
    """

    name: str
    model: str
    values: Mapping[str, float]
    source: str
    hysteresis: str = "kwok"
