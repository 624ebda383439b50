"""Units of third-party devices and files, with their factor to SI: the one table of conversion factors.

`rig.units` (bench and matrix files) takes its factors from here, and so do register maps and imported files.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

INCH_M = 0.0254
FOOT_M = 12.0 * INCH_M
POUND_KG = 0.45359237
POUND_FORCE_N = 4.4482216152605
STANDARD_GRAVITY_M_S2 = 9.80665

class Unit(NamedTuple):
    """What a unit measures, and SI for a number in it: number * scale + offset (a temperature in degC)."""

    dimension: str
    scale: float
    offset: float = 0.0


UNITS: Mapping[str, Unit] = {
    "m": Unit("length", 1.0), "mm": Unit("length", 1e-3), "cm": Unit("length", 1e-2), "um": Unit("length", 1e-6),
    "in": Unit("length", INCH_M), "mil": Unit("length", 1e-3 * INCH_M), "ft": Unit("length", FOOT_M),
    "m/s": Unit("speed", 1.0), "mm/s": Unit("speed", 1e-3), "cm/s": Unit("speed", 1e-2), "um/s": Unit("speed", 1e-6),
    "mm/min": Unit("speed", 1e-3 / 60.0), "m/min": Unit("speed", 1.0 / 60.0), "in/s": Unit("speed", INCH_M),
    "in/min": Unit("speed", INCH_M / 60.0), "ft/s": Unit("speed", FOOT_M), "ft/min": Unit("speed", FOOT_M / 60.0),
    "km/h": Unit("speed", 1.0 / 3.6), "mph": Unit("speed", 5280.0 * FOOT_M / 3600.0),
    "m/s^2": Unit("acceleration", 1.0), "mm/s^2": Unit("acceleration", 1e-3), "in/s^2": Unit("acceleration", INCH_M),
    "ft/s^2": Unit("acceleration", FOOT_M),
    "g": Unit("acceleration", STANDARD_GRAVITY_M_S2),
    "N": Unit("force", 1.0), "kN": Unit("force", 1e3), "mN": Unit("force", 1e-3), "daN": Unit("force", 10.0),
    "MN": Unit("force", 1e6),
    "lbf": Unit("force", POUND_FORCE_N), "kip": Unit("force", 1e3 * POUND_FORCE_N),
    "ozf": Unit("force", POUND_FORCE_N / 16.0),
    "gf": Unit("force", 1e-3 * STANDARD_GRAVITY_M_S2), "kgf": Unit("force", STANDARD_GRAVITY_M_S2),
    "tf": Unit("force", 1e3 * STANDARD_GRAVITY_M_S2),
    "Pa": Unit("pressure", 1.0), "kPa": Unit("pressure", 1e3), "MPa": Unit("pressure", 1e6),
    "bar": Unit("pressure", 1e5),
    "mbar": Unit("pressure", 100.0), "psi": Unit("pressure", POUND_FORCE_N / INCH_M**2),
    "Hz": Unit("frequency", 1.0), "kHz": Unit("frequency", 1e3), "mHz": Unit("frequency", 1e-3),
    "rpm": Unit("frequency", 1.0 / 60.0),
    "s": Unit("time", 1.0), "ms": Unit("time", 1e-3), "us": Unit("time", 1e-6), "ns": Unit("time", 1e-9),
    "min": Unit("time", 60.0),
    "h": Unit("time", 3600.0),
    "A": Unit("current", 1.0), "mA": Unit("current", 1e-3), "uA": Unit("current", 1e-6), "kA": Unit("current", 1e3),
    "V": Unit("voltage", 1.0), "mV": Unit("voltage", 1e-3), "uV": Unit("voltage", 1e-6), "kV": Unit("voltage", 1e3),
    "degC": Unit("temperature", 1.0), "K": Unit("temperature", 1.0, -273.15),
    "degF": Unit("temperature", 5.0 / 9.0, -160.0 / 9.0),
    "1": Unit("number", 1.0), "%": Unit("number", 1e-2), "cycles": Unit("number", 1.0), "": Unit("", 1.0),
}  # fmt: skip
"""Every unit by name."""

ALIASES: Mapping[str, str] = {
    "µm": "um", "μm": "um", "µs": "us", "μs": "us", "m/s2": "m/s^2", "m/s²": "m/s^2", "mm/s2": "mm/s^2",
    "mm/s²": "mm/s^2", "in/s2": "in/s^2", "in/s²": "in/s^2", "ft/s2": "ft/s^2", "ft/s²": "ft/s^2",
    "inch": "in", "ips": "in/s", "lb": "lbf", "kp": "kgf", "-": "1",
}  # fmt: skip


_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*?)\s*", re.ASCII)


def quantity(text: str) -> tuple[float, str]:
    """SI value and dimension of a number with its unit, such as "500 ms".

    Raises:
        ValueError: it is not a number with a known unit.
    """
    match = _QUANTITY.fullmatch(text)
    unit = None if match is None else unit_of(match[2])
    if match is None or unit is None:
        raise ValueError(f"{text!r} is not a number with a known unit, such as \"500 ms\"")
    return float(match[1]) * unit.scale + unit.offset, unit.dimension


def seconds(text: str) -> float:
    """A time with its unit, such as "500 ms", in s.

    Raises:
        ValueError: it is not a time.
    """
    value, dimension = quantity(text)
    if dimension != "time":
        raise ValueError(f"{text!r} is not a time, such as \"500 ms\"")
    return value


def unit_of(name: str) -> Unit | None:
    """A unit by its name or another spelling; None for one that is not known."""
    return UNITS.get(ALIASES.get(name, name))
