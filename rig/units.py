"""Physical quantities as a user writes them: "50 mm" -> 0.05. Factors to SI are those of `protocols.wire_units`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from protocols import wire_units
from protocols.wire_units import Unit as Unit  # of this module, too

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_QUANTITY = re.compile(rf"({NUMBER})\s*(\S.*)?", re.ASCII)
LONGEST_TEXT = 60
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+")


class UnitProblem(ValueError):
    """A text is not the quantity that is wanted; the message says what would fit."""


@dataclass(frozen=True)
class Dimension:
    """What a quantity is, its SI unit and an example to show."""

    name: str
    article: str
    si: str
    example: str


DIMENSIONS = {
    d.name: d
    for d in (
        Dimension("length", "a", "m", "50 mm"),
        Dimension("speed", "a", "m/s", "0.8 m/s"),
        Dimension("acceleration", "an", "m/s^2", "60 m/s^2"),
        Dimension("force", "a", "N", "5 kN"),
        Dimension("frequency", "a", "Hz", "1.5 Hz"),
        Dimension("time", "a", "s", "10 ms"),
        Dimension("pressure", "a", "Pa", "210 bar"),
        Dimension("temperature", "a", "degC", "120 degC"),
        Dimension("current", "a", "A", "0.5 A"),
        Dimension("voltage", "a", "V", "13.5 V"),
        Dimension("resistance", "a", "ohm", "1.5 ohm"),
        Dimension("inductance", "an", "H", "50 mH"),
        Dimension("current rate", "a", "A/s", "100 A/s"),
        Dimension("mass", "a", "kg", "2 kg"),
        Dimension("energy", "an", "J", "150 J"),
        Dimension("heat capacity", "a", "J/K", "1.5 kJ/K"),
        Dimension("heat loss", "a", "W/K", "5 W/K"),
        Dimension("ratio", "a", "1", "1 %"),
        Dimension("stiffness", "a", "N/m", "20 kN/mm"),
        Dimension("force rate", "a", "N/s", "2 N/s"),
        Dimension("force per current", "a", "N/A", "30 N/A"),
        Dimension("damping", "a", "N s/m", "100 N s/m"),
        Dimension("moment of inertia", "a", "kg m^2", "2700 kg m^2"),
    )
}

def _shared(*names: str) -> dict[str, Unit]:
    """Units that third-party devices use too."""
    return {name: wire_units.UNITS[name] for name in names}


LBF_PER_INCH = wire_units.POUND_FORCE_N / wire_units.INCH_M

UNITS = {
    **_shared("m", "mm", "cm", "um", "in", "mil", "ft"),
    **_shared("m/s", "mm/s", "cm/s", "um/s", "mm/min", "m/min", "in/s", "in/min", "ft/s", "ft/min", "km/h", "mph"),
    **_shared("m/s^2", "mm/s^2", "in/s^2", "ft/s^2"),
    **_shared("N", "kN", "mN", "daN", "MN", "lbf", "kip", "ozf", "gf", "kgf", "tf"),
    **_shared("Hz", "kHz", "mHz", "rpm", "s", "ms", "us", "min", "h"),
    **_shared("Pa", "kPa", "MPa", "bar", "mbar", "psi"),
    **_shared("degC", "K", "degF", "A", "mA", "V", "mV"),
    "ohm": Unit("resistance", 1.0), "mohm": Unit("resistance", 1e-3), "kohm": Unit("resistance", 1e3),
    "H": Unit("inductance", 1.0), "mH": Unit("inductance", 1e-3), "uH": Unit("inductance", 1e-6),
    "A/s": Unit("current rate", 1.0), "A/ms": Unit("current rate", 1e3), "mA/ms": Unit("current rate", 1.0),
    "kg": Unit("mass", 1.0), "g": Unit("mass", 1e-3), "lbm": Unit("mass", wire_units.POUND_KG),
    "J": Unit("energy", 1.0), "mJ": Unit("energy", 1e-3), "kJ": Unit("energy", 1e3), "MJ": Unit("energy", 1e6),
    "ft lbf": Unit("energy", wire_units.FOOT_M * wire_units.POUND_FORCE_N),
    "in lbf": Unit("energy", wire_units.INCH_M * wire_units.POUND_FORCE_N),
    "J/K": Unit("heat capacity", 1.0), "kJ/K": Unit("heat capacity", 1e3), "W/K": Unit("heat loss", 1.0),
    "%": Unit("ratio", 1e-2),
    "N/m": Unit("stiffness", 1.0), "N/mm": Unit("stiffness", 1e3), "kN/mm": Unit("stiffness", 1e6),
    "kN/m": Unit("stiffness", 1e3), "N/um": Unit("stiffness", 1e6), "lbf/in": Unit("stiffness", LBF_PER_INCH),
    "N/s": Unit("force rate", 1.0), "N/A": Unit("force per current", 1.0),
    "N s/m": Unit("damping", 1.0), "kN s/m": Unit("damping", 1e3), "N s/mm": Unit("damping", 1e3),
    "lbf s/in": Unit("damping", LBF_PER_INCH), "kg m^2": Unit("moment of inertia", 1.0),
}  # fmt: skip

# Other spellings of the same units.
ALIASES = {
    **{name: unit for name, unit in wire_units.ALIASES.items() if unit in UNITS},
    **{spelt: f"{length} lbf" for length in ("ft", "in") for spelt in (
        f"{length}-lbf", f"{length}*lbf", f"{length}.lbf", f"{length}·lbf", f"lbf {length}", f"lbf-{length}",
        f"{length} lb", f"{length}-lb", f"{length} lbs",
    )},
    "N m": "J", "Nm": "J", "N*m": "J",
    "°C": "degC", "°F": "degF", "Ω": "ohm", "mΩ": "mohm", "kΩ": "kohm",
}  # fmt: skip

WORDS = {
    "sec": "s", "sec.": "s", "secs": "s", "second": "s", "seconds": "s", "sek": "s", "msec": "ms", "millisecond": "ms",
    "milliseconds": "ms", "usec": "us", "microseconds": "us", "minutes": "min", "hours": "h", "day": "d", "days": "d",
    "metre": "m", "meter": "m", "metres": "m", "meters": "m", "millimetre": "mm", "millimeter": "mm",
    "millimetres": "mm", "millimeters": "mm", "centimeters": "cm", "centimetres": "cm", "micron": "um", "microns": "um",
    "micrometer": "um", "micrometre": "um", "micrometers": "um", "micrometres": "um",
    "inch": "in", "inches": "in", '"': "in", "mils": "mil", "thou": "mil",
    "newton": "N", "newtons": "N", "kilonewton": "kN", "kilonewtons": "kN", "decanewton": "daN", "decanewtons": "daN",
    "kips": "kip", "lb": "lbf", "lbs": "lbf", "lbsf": "lbf", "lb-f": "lbf", "lb_f": "lbf", "pound": "lbf",
    "pounds": "lbf", "pound-force": "lbf", "pounds-force": "lbf", "kp": "kgf", "kg-f": "kgf", "kg_f": "kgf",
    "kilogram-force": "kgf", "gram-force": "gf", "g-f": "gf", "ounce-force": "ozf", "ounces-force": "ozf",
    "oz-f": "ozf", "tonne-force": "tf", "ton-force": "tf",
    "amp": "A", "amps": "A", "ampere": "A", "amperes": "A", "milliamp": "mA", "milliamps": "mA", "milliampere": "mA",
    "milliamperes": "mA", "volt": "V", "volts": "V", "millivolt": "mV", "millivolts": "mV",
    "celsius": "degC", "deg c": "degC", "deg. c": "degC", "°c": "degC", "kelvin": "K", "fahrenheit": "degF",
    "deg f": "degF", "°f": "degF",
}  # fmt: skip
"""Units as people and programs write them out, in small letters; parts of a speed or a stiffness, too (inch/sec)."""


def unit_named(text: str) -> Unit | None:
    """A unit by its name or another spelling; None for one that is not known.

    The parts of a quotient may be written out: "inch/sec".
    """
    return UNITS.get(symbol(text))


def symbol(text: str) -> str:
    """The symbol in `UNITS` of a unit in another spelling ("lbs": "lbf"); a text that is not known as it is."""
    name = ALIASES.get(text, text)
    if name in UNITS:
        return name
    name = "/".join(WORDS.get(part.casefold(), part) for part in text.split("/"))
    return name if name in UNITS else text


def parse(text: object, dimension: str) -> float:
    """Turn a quantity with its unit into SI.

    Args:
        text: for example "50 mm"; anything but a text is refused.
        dimension: a key of `DIMENSIONS`.

    Returns:
        The value in the dimension's SI unit (temperature: degC).

    Raises:
        UnitProblem: no unit, an unknown unit, a unit of another dimension, or not a finite number.
    """
    expected = DIMENSIONS[dimension]
    fit = f'{expected.article} {expected.name} is written as, for example, "{expected.example}"'
    if isinstance(text, bool) or not isinstance(text, (str, int, float)):
        raise UnitProblem(f"{fit}, not {_kind(text)}")
    if not isinstance(text, str):
        if isinstance(text, float) and not math.isfinite(text):
            raise UnitProblem(f"not a finite number; {fit}")
        bare = f"{text:.10g} " if isinstance(text, float) or abs(text) < 1 << 64 else ""
        raise UnitProblem(f"the number {bare}has no unit; {fit}")
    if len(text) > LONGEST_TEXT:
        raise UnitProblem(f"not a number with a unit; {fit}")
    text = text.strip()
    if _DECIMAL_COMMA.match(text):
        raise UnitProblem(f"the decimal separator must be a point; {fit}")
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise UnitProblem(f"not a number with a unit; {fit}")
    number, name = float(match[1]), match[2]
    if name is None:
        raise UnitProblem(f"{text} has no unit; {fit}")
    unit = unit_named(name)
    if unit is None:
        raise UnitProblem(_unknown_unit(name, dimension, fit))
    if unit.dimension != dimension:
        other = DIMENSIONS[unit.dimension]
        raise UnitProblem(f"{text} is {other.article} {other.name}; {fit}")
    value = number * unit.scale + unit.offset
    if not math.isfinite(value):
        raise UnitProblem(f"the number is too large; {fit}")
    return value


def split(text: str) -> tuple[float, str]:
    """Split a quantity of any dimension into its SI value and the name of its dimension.

    Raises:
        UnitProblem: no unit or an unknown one.
    """
    match = _QUANTITY.fullmatch(text.strip()) if len(text) <= LONGEST_TEXT else None
    unit = unit_named(match[2] or "") if match else None
    if unit is None:
        raise UnitProblem(f'"{text}" is not a number with a known unit')
    return parse(text, unit.dimension), unit.dimension


def units_of(dimension: str) -> tuple[str, ...]:
    """Names of the units of one dimension, SI first, other spellings last."""
    own = tuple(name for name, unit in UNITS.items() if unit.dimension == dimension)
    return own + tuple(alias for alias, name in ALIASES.items() if name in own)


def key_suffixes(dimension: str) -> dict[str, str]:
    """Endings a key may carry instead of a unit in its value: {"m_s": "m/s", ...} as in `speed_m_s = 0.8`."""
    own = (name for name, unit in UNITS.items() if unit.dimension == dimension)
    short = str.maketrans({"/": "_", " ": "_", "^": "", "%": "percent"})
    return {name.translate(short): name for name in own}


def si_suffix(dimension: str) -> str:
    """Ending of a key that holds a value of this dimension in SI, such as "N" or "m_s"."""
    return next((end for end, unit in key_suffixes(dimension).items() if unit == DIMENSIONS[dimension].si), "1")


def pattern(dimension: str) -> str:
    """Regular expression (JSON schema dialect) that a quantity of this dimension matches."""
    names = "|".join(map(_spellings, units_of(dimension)))
    return rf"^\s*{NUMBER}\s*({names})\s*$"


def show(value: float, unit: str, digits: int = 4) -> str:
    """Write an SI value in a unit: `show(0.05, "mm")` is "50 mm"."""
    known = UNITS[unit]
    return f"{(value - known.offset) / known.scale:.{digits}g} {unit}"


def _spellings(name: str) -> str:
    """Regular expression of a unit whose parts may be written out."""
    parts = ([part, *(word for word, unit in WORDS.items() if unit == part)] for part in name.split("/"))
    either = ("|".join(re.escape(one).replace(r"\-", "-") for one in part) for part in parts)
    return "/".join(f"({one})" if "|" in one else one for one in either)


def _unknown_unit(name: str, dimension: str, fit: str) -> str:
    folded = {unit.casefold(): unit for unit in units_of(dimension)}
    likely = folded.get("".join(name.split()).casefold())
    hint = f'did you mean "{likely}"?' if likely else f"known units: {', '.join(units_of(dimension))}"
    return f'unknown unit "{name}" ({hint}); {fit}'


def _kind(value: object) -> str:
    names = {bool: "true or false", list: "a list", tuple: "a list", dict: "a table", type(None): "nothing"}
    return names.get(type(value), f"a {type(value).__name__}")
