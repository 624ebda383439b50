"""Units as other programs write them, and the factors and sensitivities that a user gives for a column."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from protocols import wire_units
from rig.units import ALIASES, NUMBER, UNITS, WORDS, Unit, units_of

DIMENSION = {"time": "time", "displacement": "length", "force": "force", "current": "current",
             "commanded_current": "current", "voltage": "voltage", "temperature": "temperature"}  # fmt: skip
"""Quantity of a damper test -> what it measures."""
DAY = Unit("time", 86400.0)
"""In which spreadsheets count, where a cell with a time has no format of a time."""
MASS_FOR_FORCE = {"kg": "kgf", "g": "gf", "t": "tf", "oz": "ozf"}
"""Units of mass that displays show for a force; they are taken as one only where the user writes the unit of force."""
TEMPERATURES = {"F": "degF", "C": "degC"}
"""Letters that are units only of a column of temperatures: elsewhere, they may be symbols of quantities."""
COUNTS = frozenset(("count", "counts", "digit", "digits", "lsb", "bit", "bits", "inc", "increment", "increments", "1"))
_SENSITIVITY = re.compile(rf"({NUMBER})\s*([^\s/\d][^\s/]*)\s*(?:/|per)\s*([^\s/]+)")


def units_for(dimension: str) -> dict[str, Unit]:
    """Units of a dimension that a column of a file may have, SI first."""
    own = {name: unit for name, unit in UNITS.items() if unit.dimension == dimension}
    others = {name: unit for name, unit in wire_units.UNITS.items() if unit.dimension == dimension}
    return {**own, **others, **({"d": DAY} if dimension == "time" else {})}


def named_unit(text: str, dimension: str) -> tuple[str, Unit] | None:
    """A unit as a file or a user writes it: its name in our table and the unit; None where it is not one of these."""
    bare = text.strip().strip("[]()").strip()
    known = units_for(dimension)
    folded: dict[str, list[str]] = {}
    for name in known:
        folded.setdefault(name.casefold(), []).append(name)
    candidates = folded.get(bare.casefold(), [])
    unpointed = bare.replace(".", "")  # "lbf.", "in./sec."
    for name in (bare, ALIASES.get(bare, ""), wire_units.ALIASES.get(bare, ""), WORDS.get(bare.casefold(), ""),
                 TEMPERATURES.get(bare, "") if dimension == "temperature" else "",
                 candidates[0] if len(candidates) == 1 else ""):  # fmt: skip
        if name in known:
            return name, known[name]
    return named_unit(unpointed, dimension) if unpointed != bare else None


def known_unit(text: str) -> str:
    """The name in our tables of a unit of any dimension as a file writes it; empty where it is not known."""
    bare = text.strip().strip("[]()").strip()
    name = ALIASES.get(bare, bare)
    if name in UNITS:
        return name
    if bare in TEMPERATURES:
        return ""
    return next((unit[0] for dimension in dict.fromkeys(DIMENSION.values())
                 if (unit := named_unit(bare, dimension)) is not None), "")  # fmt: skip


@dataclass(frozen=True)
class Scaling:
    """What a user says of the numbers of a column: a factor, or the sensitivity of a sensor.

    Attributes:
        text: as the user wrote it.
        factor: by which the file's numbers are multiplied; of a sensitivity: SI units of the quantity for one SI unit
            (or count) of the file's numbers.
        per: dimension of the file's numbers; empty: counts; None: a plain factor, in the column's own unit.
        per_unit: unit of the file's numbers where the file does not state it.
    """

    text: str
    factor: float
    per: str | None = None
    per_unit: str = ""


def scaling_of(quantity: str, given: str | float) -> Scaling:
    """A user's factor (`-1`), sensitivity (`500 N/V`, `0.25 N/count`) or its inverse as on data sheets (`2 mV/N`).

    Raises:
        ValueError: none of these, or not of the quantity's dimension.
    """
    text = str(given).strip()
    fit = "expected a factor such as -1, or a sensitivity such as '500 N/V', '0.25 N/count' or '2 mV/N'"
    try:
        factor = float(text)
    except ValueError:
        match = _SENSITIVITY.fullmatch(text) if len(text) <= 60 else None
        if match is None:
            raise ValueError(f"got {text[:60]!r}, {fit}") from None
        return _sensitivity(quantity, text, float(match[1]), match[2], match[3])
    if not math.isfinite(factor) or factor == 0.0:
        raise ValueError(f"got {text[:60]!r}, expected a finite factor other than 0")
    return Scaling(text, factor)


def _sensitivity(quantity: str, text: str, number: float, above: str, below: str) -> Scaling:
    dimension = DIMENSION[quantity]
    if number == 0.0 or not math.isfinite(number):
        raise ValueError(f"got {text!r}, expected a finite sensitivity other than 0")
    if below.casefold() in COUNTS and (unit := named_unit(above, dimension)):
        return Scaling(text, number * unit[1].scale, "")
    for electrical in ("voltage", "current"):
        of, per = named_unit(above, dimension), named_unit(below, electrical)
        if of and per and electrical != dimension:
            return Scaling(text, number * of[1].scale / per[1].scale, electrical, per[0])
        of, per = named_unit(below, dimension), named_unit(above, electrical)
        if of and per and electrical != dimension:
            return Scaling(text, of[1].scale / (number * per[1].scale), electrical, per[0])
    units = ", ".join(units_of(dimension)[:4])
    raise ValueError(f"got {text!r}, expected a unit of {dimension} ({units}, ...) per V, mV, mA or count")
