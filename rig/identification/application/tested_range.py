"""What the tests covered, and how far the model was off there: what makes a prediction one, and not a guess."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.identification.application.law import Law
from rig.identification.application.motion_table import Motion
from rig.identification.models.measurement import Measurement, first_cycle
from rig.identification.models.undetermined import only_at

Ends = tuple[float, float]

BEYOND = 0.02  # share of a range by which its ends may be passed: overshoot and noise
LEAST_CURRENT_A, LEAST_TEMPERATURE_K = 0.02, 2.0  # and at least so much of these
BAND = 0.95  # share of samples within the band
ROOM_A = 0.05  # about a tested current, where it is the only thing known: a set-point and its error
LEVELS = 16  # of the current, over which the band is told apart
LEAST_LEVEL_A = 0.1
FEWEST = 20  # samples of a level
UNKNOWN = "range not known"


@dataclass(frozen=True)
class Band:
    """Within how much of the modelled force 95 % of the measured samples lay.

    Attributes:
        current_A: currents (A), rising.
        half_width_N: half width at each (N).
        source: which tests say so.
    """

    current_A: tuple[float, ...]
    half_width_N: tuple[float, ...]
    source: str

    def at(self, current_A: FloatArray) -> FloatArray:
        """Half width (N) at currents (A), shape (n,); as at the nearest tested current beyond them."""
        return np.asarray(np.interp(current_A, self.current_A, self.half_width_N))


@dataclass(frozen=True)
class TestedRange:
    """Lowest and highest value in the tests that were fitted; None where it was not recorded.

    Attributes:
        displacement_m: extension about mid-stroke (m).
        velocity_m_s: velocity (m/s).
        current_A: coil current (A).
        temperature_degC: coil temperature (degC).
        band: how far measured forces were from modelled ones.
        only_at_A: the tested currents (A), rising, where the force is known at these alone because the model has
            powers of the current that so few do not tell; empty where it is known from the lowest to the highest.
    """

    __test__ = False  # pytest takes classes called Test for its own

    displacement_m: Ends
    velocity_m_s: Ends
    current_A: Ends
    temperature_degC: Ends | None
    band: Band
    only_at_A: tuple[float, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Key `tested` of `rig identify --json`."""
        ends = {name: None if value is None else list(value) for name, value in self._ranges()}
        band = {key: list(value) if isinstance(value, tuple) else value for key, value in vars(self.band).items()}
        return ends | {"only_at_A": list(self.only_at_A), "band": band}

    @classmethod
    def from_json(cls, entry: Mapping[str, Any]) -> TestedRange:
        """The inverse of `to_json`.

        Raises:
            KeyError, TypeError, ValueError: the entry is not what `to_json` gives.
        """
        ends = {name: (float(entry[name][0]), float(entry[name][1])) for name in ("displacement_m", "velocity_m_s",
                "current_A")}  # fmt: skip
        warm = entry["temperature_degC"]
        band = entry["band"]
        widths = tuple(map(float, band["half_width_N"]))
        return cls(
            **ends,
            temperature_degC=None if warm is None else (float(warm[0]), float(warm[1])),
            band=Band(tuple(map(float, band["current_A"])), widths, str(band["source"])),
            only_at_A=tuple(map(float, entry.get("only_at_A", ()))),
        )

    def _ranges(self) -> list[tuple[str, Ends | None]]:
        names = ("displacement_m", "velocity_m_s", "current_A", "temperature_degC")
        return [(name, getattr(self, name)) for name in names]

    def between_currents(self, current_A: FloatArray) -> BoolArray:
        """Which currents (A) are none of `only_at_A`, where there are such, shape (n,)."""
        away_A = np.full(current_A.shape, math.inf if self.only_at_A else 0.0)
        for tested_A in self.only_at_A:
            away_A = np.minimum(away_A, np.abs(current_A - tested_A))
        return np.asarray(away_A > ROOM_A)

    def told(self) -> str:
        """The ranges in words and units."""
        ranges = ", ".join(
            f"{name} {value[0]:.4g} to {value[1]:.4g}" for name, value in self._ranges() if value is not None
        )
        if not self.only_at_A:
            return ranges
        currents = ", ".join(f"{current_A:.2f}" for current_A in self.only_at_A)
        return f"{ranges}, of the currents only {currents} A (too few for the model to know the force between them)"

    def beyond(self, motion: Motion) -> dict[str, BoolArray]:
        """Quantity -> which samples lie beyond what was tested, shape (n,); only those with such samples."""
        given = {
            "displacement_m": motion.u_m, "velocity_m_s": motion.v_m_s, "current_A": motion.current_A,
            "temperature_degC": motion.temperature_degC,
        }  # fmt: skip
        least = {"current_A": LEAST_CURRENT_A, "temperature_degC": LEAST_TEMPERATURE_K}
        outside = {}
        for name, ends in self._ranges():
            values = given[name]
            if values is None:
                continue
            if ends is None:  # a temperature that no test recorded: nobody knows
                outside[name] = np.ones(values.size, dtype=bool)
                continue
            room = max(BEYOND * (ends[1] - ends[0]), least.get(name, 0.0))
            outside[name] = (values < ends[0] - room) | (values > ends[1] + room)
        if self.only_at_A:
            outside["current_A"] |= self.between_currents(motion.current_A)
        return {name: where for name, where in outside.items() if np.any(where)}


def tested_range(
    law: Law,
    fitted: Sequence[Measurement],
    held_out: Sequence[Measurement],
    temperature_degC: Ends | None,
    widened: float,
) -> TestedRange:
    """What tests covered, and the band of the force that their errors give.

    Args:
        law: the fitted model.
        fitted: tests it was fitted to.
        held_out: tests it has not seen; if there are any, they alone give the band.
        temperature_degC: lowest and highest recorded; None where nothing was.
        widened: factor on the band of fitted tests, 1 or more: how much larger the error on left-out tests was.
    """
    seen = held_out or fitted
    factor = 1.0 if held_out else max(1.0, widened)
    source = "held-out tests" if held_out else f"fitted tests x {factor:.3g}" if factor > 1.0 else "fitted tests"
    ends = {name: _ends(getattr(test, name) for test in fitted) for name in ("u_m", "v_m_s", "current_A")}
    band = _band(law, seen, factor, source)
    levels = only_at(law.model, fitted) if law.current is None else ()
    return TestedRange(ends["u_m"], ends["v_m_s"], ends["current_A"], temperature_degC, band, levels)


def _ends(arrays: Iterable[FloatArray]) -> Ends:
    pairs = [(float(np.min(values)), float(np.max(values))) for values in arrays]
    return min(low for low, _ in pairs), max(high for _, high in pairs)


def _band(law: Law, tests: Sequence[Measurement], factor: float, source: str) -> Band:
    errors, currents = [], []
    for test in map(first_cycle, tests):
        off = np.abs(test.force_N - law.force_of(test))
        errors.append(off[test.scored])
        currents.append(test.current_A[test.scored])
    error_N, current_A = np.concatenate(errors), np.concatenate(currents)
    width_A = max(LEAST_LEVEL_A, float(np.ptp(current_A)) / LEVELS)
    level = np.round(current_A / width_A).astype(np.int64)
    known = [one for one in np.unique(level) if np.count_nonzero(level == one) >= FEWEST]
    groups = [level == one for one in known] or [np.ones(level.size, dtype=bool)]
    means = tuple(float(np.mean(current_A[group])) for group in groups)
    widths = tuple(factor * float(np.quantile(error_N[group], BAND)) for group in groups)
    return Band(means, tuple(0.0 if math.isnan(width) else width for width in widths), source)
