"""The units and signs that people read: `[display]` of a bench or matrix file as a value.

Every number inside the program, in recordings and in JSON is SI, with extension positive. What a person reads
(terminal, page, report) is converted at the edge with a `Display`, and in no other way:

    shown = run.display                     # of a recorded run; of a bench: `rig.files.display_table.display_of`
    shown.force.text(1234.5)                # "277.5 lbf": a magnitude, such as a limit or an amplitude
    shown.force.signed_text(loop.jounce_N)  # a force with its sign, which `positive = "compression"` reverses
    Axis(shown.force.title("Force"), shown.force.unit)
    shown.force.signed(force_N)             # an array for that axis

Without `[display]`, everything is shown as N, mm, m/s, degC and J with rebound (extension) positive.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args

from rig.units import UNITS, symbol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Positive = Literal["rebound", "compression"]
Paper = Literal["A4", "letter"]
Number = TypeVar("Number", float, "NDArray[np.float64]")


def _units(dimension: str) -> tuple[str, ...]:
    return tuple(name for name, unit in UNITS.items() if unit.dimension == dimension)


FORCE_UNITS, LENGTH_UNITS, SPEED_UNITS, TEMPERATURE_UNITS, ENERGY_UNITS = map(
    _units, ("force", "length", "speed", "temperature", "energy")
)
CHOICES: Mapping[str, tuple[str, ...]] = {
    "force": FORCE_UNITS, "displacement": LENGTH_UNITS, "speed": SPEED_UNITS, "temperature": TEMPERATURE_UNITS,
    "energy": ENERGY_UNITS,
    "positive": get_args(Positive), "paper": get_args(Paper),
}
"""Entry of `[display]` -> the values that it may have."""


def spelt(value: object) -> Any:  # noqa: ANN401 - what a file has, a text in most entries
    """An entry of `[display]` in the spelling of `CHOICES`: "lbs" is lbf, "Letter" is letter; others as they are."""
    if not isinstance(value, str):
        return value
    sizes = {size.casefold(): size for size in get_args(Paper)}
    return sizes.get(value.strip().casefold()) or symbol(value.strip())


_SPEED = re.compile(r" ([0-9.e+-]+) m/s ")
"""A speed in a description of a point."""


@dataclass(frozen=True)
class Shown:
    """One quantity as it is shown.

    Attributes:
        unit: name of the unit.
        scale, offset: SI value of a number in it: number * scale + offset.
        positive: the direction that is positive; of no meaning for a quantity without a direction.
    """

    unit: str
    scale: float
    offset: float = 0.0
    positive: Positive = "rebound"

    def value(self, si: Number) -> Number:
        """A magnitude (number or array (n,)) from SI: a limit, an amplitude, a standard deviation, a temperature."""
        return (si - self.offset) / self.scale

    def signed(self, si: Number) -> Number:
        """A value (number or array (n,)) from SI that is positive in rebound, with the sign of the display."""
        return -self.value(si) if self.positive == "compression" else self.value(si)

    def text(self, si: float, digits: int = 4) -> str:
        """A magnitude with its unit: "30 mm"."""
        return f"{self.value(si):.{digits}g} {self.unit}"

    def at_least(self, si: float, digits: int = 4) -> str:
        """The least magnitude with its unit that is not below this one (SI, positive): it is entered as a setting."""
        value = self.value(si)
        step = 10.0 ** (math.floor(math.log10(value)) + 1 - digits)
        return f"{math.ceil(value / step - 1e-6) * step:.{digits}g} {self.unit}"

    def signed_text(self, si: float, digits: int = 4) -> str:
        """A value that is positive in rebound, with the sign of the display and the unit: "-1234 N"."""
        return f"{self.signed(si) + 0.0:.{digits}g} {self.unit}"

    def span(self, low: float, high: float, word: str = "to") -> str:
        """Two positions, from SI, with the sign of the display, the lower one first: "-50 mm to 50 mm"."""
        ends = (low, high) if self.positive == "rebound" else (high, low)
        return f" {word} ".join(self.signed_text(end) for end in ends)

    def fixed(self, si: float, resolution: float) -> str:
        """A signed value with as many decimals as this resolution (SI) needs, without the unit: "12.3", "0.484"."""
        decimals = max(0, math.ceil(-math.log10(resolution / self.scale) - 1e-9))
        return f"{self.signed(si) + 0.0:.{decimals}f}"

    def title(self, quantity: str) -> str:
        """Name of a signed quantity for an axis or a column, with the sign convention where that is not the usual one.

        "Force"; with compression positive "Force, compression positive".
        """
        return f"{quantity}, compression positive" if self.positive == "compression" else quantity


@dataclass(frozen=True)
class Display:
    """`[display]`: units by name, the direction in which force, displacement and speed are positive, and the paper."""

    force_unit: str = "N"
    displacement_unit: str = "mm"
    speed_unit: str = "m/s"
    temperature_unit: str = "degC"
    positive: Positive = "rebound"
    paper: Paper = "A4"
    energy_unit: str = "J"

    @classmethod
    def of(cls, *tables: Mapping[str, Any]) -> Display:
        """The display of `[display]` tables as they are in the files; an entry of a later table counts more.

        Args:
            tables: of the bench file, then of the matrix file.

        Raises:
            ValueError: an entry is unknown or has no such value; the message says what is allowed.
        """
        entries = {name: spelt(value) for table in tables for name, value in table.items() if value is not None}
        for name, value in entries.items():
            if name not in CHOICES:
                raise ValueError(f"[display] {name}: unknown key; allowed here: {', '.join(CHOICES)}")
            if value not in CHOICES[name]:
                raise ValueError(f"[display] {name} = {value!r:.40}: allowed: {', '.join(CHOICES[name])}")
        without_unit = {"positive", "paper"}
        return cls(**{name if name in without_unit else f"{name}_unit": value for name, value in entries.items()})

    @property
    def force(self) -> Shown:
        """Forces; signed ones are positive in rebound (SI)."""
        return self._shown(self.force_unit)

    @property
    def displacement(self) -> Shown:
        """Displacements, amplitudes, strokes; signed ones are positive in extension (SI)."""
        return self._shown(self.displacement_unit)

    @property
    def speed(self) -> Shown:
        """Speeds; signed ones are positive in rebound (SI)."""
        return self._shown(self.speed_unit)

    @property
    def temperature(self) -> Shown:
        """Temperatures; they have no direction."""
        unit = UNITS[self.temperature_unit]
        return Shown(self.temperature_unit, unit.scale, unit.offset)

    @property
    def energy(self) -> Shown:
        """Energies, such as that of a cycle; they have no direction."""
        return Shown(self.energy_unit, UNITS[self.energy_unit].scale)

    @property
    def damping(self) -> Shown:
        """Force over speed, in the display's own units: "N s/m", "lbf s/in"; no direction."""
        force, speed = self.force, self.speed
        length, slash, time = speed.unit.partition("/")
        unit = f"{force.unit} {time}/{length}" if slash else f"{force.unit}/({speed.unit})"
        return Shown(unit, force.scale / speed.scale)

    @property
    def acceleration(self) -> Shown:
        """Accelerations, in the unit of speeds per second if that is a length per second, else in m/s^2."""
        length, _, time = self.speed_unit.partition("/")
        return Shown(f"{length}/s^2", UNITS[self.speed_unit].scale) if time == "s" else Shown("m/s^2", 1.0)

    def described(self, text: str, amplitude_m: float) -> str:
        """A point's `described`, which is in SI units, with its amplitude (m) and speed in the units of this display.

        For readers of results, which have no test point: a test point has its own phrase.
        """
        for digits in (4, 3):
            size = f" {SI.displacement.text(amplitude_m, digits)} "
            if size in text:
                text = text.replace(size, f" {self.displacement.text(amplitude_m, digits)} ", 1)
                break
        return _SPEED.sub(lambda speed: f" {self.speed.text(float(speed[1]))} ", text, count=1)

    @property
    def usual(self) -> bool:
        """Whether `[display]` changes no number."""
        return replace(self, paper=SI.paper) == SI

    def to_json(self) -> dict[str, str]:
        """Its entries as they are written in a file, every one of them."""
        return {item.name.removesuffix("_unit"): getattr(self, item.name) for item in fields(self)}

    def _shown(self, unit: str) -> Shown:
        return Shown(unit, UNITS[unit].scale, UNITS[unit].offset, self.positive)


SI = Display()
"""As without `[display]`."""
