"""Units of third-party devices and files, with their factor to SI: the one table of conversion factors.

`rig.units` (bench and matrix files) takes its factors from here, and so do register maps and imported files.
"""

from __future__ import annotations

from collections.abc import Mapping

INCH_M = 0.0254
POUND_FORCE_N = 4.4482216152605
STANDARD_GRAVITY_M_S2 = 9.80665

UNITS: Mapping[str, tuple[str, float]] = {
    "m": ("length", 1.0), "mm": ("length", 1e-3), "cm": ("length", 1e-2), "um": ("length", 1e-6),
    "in": ("length", INCH_M), "mil": ("length", 1e-3 * INCH_M),
    "m/s": ("speed", 1.0), "mm/s": ("speed", 1e-3), "cm/s": ("speed", 1e-2), "um/s": ("speed", 1e-6),
    "mm/min": ("speed", 1e-3 / 60.0), "m/min": ("speed", 1.0 / 60.0), "in/s": ("speed", INCH_M),
    "in/min": ("speed", INCH_M / 60.0),
    "m/s^2": ("acceleration", 1.0), "mm/s^2": ("acceleration", 1e-3), "in/s^2": ("acceleration", INCH_M),
    "g": ("acceleration", STANDARD_GRAVITY_M_S2),
    "N": ("force", 1.0), "kN": ("force", 1e3), "mN": ("force", 1e-3), "daN": ("force", 10.0), "MN": ("force", 1e6),
    "lbf": ("force", POUND_FORCE_N), "kip": ("force", 1e3 * POUND_FORCE_N), "ozf": ("force", POUND_FORCE_N / 16.0),
    "gf": ("force", 1e-3 * STANDARD_GRAVITY_M_S2), "kgf": ("force", STANDARD_GRAVITY_M_S2),
    "tf": ("force", 1e3 * STANDARD_GRAVITY_M_S2),
    "Pa": ("pressure", 1.0), "kPa": ("pressure", 1e3), "MPa": ("pressure", 1e6), "bar": ("pressure", 1e5),
    "mbar": ("pressure", 100.0), "psi": ("pressure", POUND_FORCE_N / INCH_M**2),
    "Hz": ("frequency", 1.0), "kHz": ("frequency", 1e3), "mHz": ("frequency", 1e-3), "rpm": ("frequency", 1.0 / 60.0),
    "s": ("time", 1.0), "ms": ("time", 1e-3), "us": ("time", 1e-6), "ns": ("time", 1e-9), "min": ("time", 60.0),
    "h": ("time", 3600.0),
    "A": ("current", 1.0), "mA": ("current", 1e-3), "uA": ("current", 1e-6), "kA": ("current", 1e3),
    "V": ("voltage", 1.0), "mV": ("voltage", 1e-3), "uV": ("voltage", 1e-6), "kV": ("voltage", 1e3),
    "1": ("number", 1.0), "%": ("number", 1e-2), "cycles": ("number", 1.0), "": ("", 1.0),
}  # fmt: skip
"""Unit -> what it measures, and SI for one of it."""

ALIASES: Mapping[str, str] = {
    "µm": "um", "μm": "um", "µs": "us", "μs": "us", "m/s2": "m/s^2", "m/s²": "m/s^2", "mm/s2": "mm/s^2",
    "mm/s²": "mm/s^2", "inch": "in", "ips": "in/s", "lb": "lbf", "kp": "kgf", "-": "1",
}  # fmt: skip


def seconds(text: str) -> float:
    """A time with its unit, such as "500 ms", in s.

    Raises:
        ValueError: it is not a time.
    """
    number = text.strip().rstrip("abcdefghijklmnopqrstuvwxyzµμ ")
    unit = unit_of(text.strip()[len(number) :].strip())
    if unit is None or unit[0] != "time":
        raise ValueError(f"{text!r} is not a time such as \"500 ms\"")
    return float(number) * unit[1]


def unit_of(name: str) -> tuple[str, float] | None:
    """What a unit measures and its factor to SI; None for one that is not known."""
    return UNITS.get(ALIASES.get(name, name))
