"""Tables of force over velocity as damper dynamometers print them: rows of velocity, columns by current and direction.

A sine gives a *peak velocity* table (PVP): forces at the peak velocity of each motion. A triangle, whose velocity is
constant between the reversals, gives a *constant velocity* table. One value for terminal, JSON and report.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from rig.characteristics.loop import LoopCharacteristics, over_repeats
from rig.fits.plain import plain
from rig.signals.rounding import MOST_PLACES, places_of
from rig.signals.waveform import TRIANGLE
from rig.test_point import peak_speed_m_s

PEAK_VELOCITY, CONSTANT_VELOCITY = "peak velocity", "constant velocity"
MOST_DIGITS = 4
"""Of the largest force of a table: a load cell is uncertain by about 0.1 %, which variation between cycles hides."""


@dataclass(frozen=True)
class ForceCell:
    """Forces of one motion at one current, N; the mean over its repeats; NaN where a force is unknown.

    Attributes:
        points: ids of the points; `tests` in JSON is their number.
        rebound_N, compression_N: at the velocity of the row; positive and negative.
        rebound_std_N, compression_std_N: standard uncertainty from the scatter of cycles and repeats.
        peak_force_rebound_N, peak_force_compression_N: largest forces of the motion, at whatever velocity.
    """

    points: tuple[str, ...]
    rebound_N: float
    compression_N: float
    rebound_std_N: float
    compression_std_N: float
    peak_force_rebound_N: float
    peak_force_compression_N: float

    @classmethod
    def of(cls, loops: Sequence[LoopCharacteristics]) -> Self:
        """The cell of these loops: one, or the repeats of one point."""
        rebound_N, rebound_std_N = over_repeats(loop.rebound_N for loop in loops)
        compression_N, compression_std_N = over_repeats(loop.jounce_N for loop in loops)
        peaks = [loop.peak_force_N for loop in loops]
        return cls(
            tuple(loop.id for loop in loops), rebound_N, compression_N, rebound_std_N, compression_std_N,
            _mean([peak.rebound_N for peak in peaks]), _mean([peak.compression_N for peak in peaks]),
        )


@dataclass(frozen=True)
class ForceRow:
    """One motion: velocity (m/s, measured), amplitude (m, half of the stroke), frequency (Hz).

    `cells` has an entry for each current of the table; None where the motion was not run at that current.
    """

    speed_m_s: float
    amplitude_m: float
    frequency_Hz: float
    cells: tuple[ForceCell | None, ...]

    def requested_m_s(self, waveform: str) -> float:
        """Peak speed (m/s) of the ideal waveform with this amplitude and frequency."""
        return peak_speed_m_s(waveform, self.amplitude_m, self.frequency_Hz)

    @property
    def tests(self) -> str:
        """Number of tests whose mean a cell is: "mean of 3", "mean of 1 to 3", "1"."""
        counts = [len(cell.points) for cell in self.cells if cell is not None]
        return tests_text(min(counts), max(counts))


def tests_text(fewest: int, most: int) -> str:
    """How many tests a force is the mean of."""
    if most <= 1:
        return str(most)
    return f"mean of {most}" if fewest == most else f"mean of {fewest} to {most}"


@dataclass(frozen=True)
class ForceTable:
    """The motions of one waveform by velocity.

    Attributes:
        kind: `peak velocity` or `constant velocity`.
        waveform: of the motions.
        currents_A: levels of current (n,), rising, A.
        rows: the motions by rising velocity, each with n cells.
    """

    kind: str
    waveform: str
    currents_A: tuple[float, ...]
    rows: tuple[ForceRow, ...]

    @property
    def constant_stroke(self) -> bool:
        """Whether all motions have one amplitude, within 1 %."""
        amplitudes_m = [row.amplitude_m for row in self.rows]
        return max(amplitudes_m) <= 1.01 * min(amplitudes_m)

    @property
    def averaged(self) -> bool:
        """Whether a cell is the mean of several tests."""
        return any(len(cell.points) > 1 for _, _, cell in self.tested)

    def places(self, unit_N: float = 1.0) -> int:
        """Decimal places of all its forces: by the median of their uncertainties, at most `MOST_DIGITS` digits.

        Args:
            unit_N: the unit in which the forces are shown, N.
        """
        known = [cell for _, _, cell in self.tested]
        forces = [abs(force) for one in known for force in (one.rebound_N, one.compression_N) if math.isfinite(force)]
        stds = [std for one in known for std in (one.rebound_std_N, one.compression_std_N) if std > 0.0]
        largest = max(forces, default=0.0) / unit_N
        most = MOST_DIGITS - 1 - math.floor(math.log10(largest)) if largest > 0.0 else MOST_PLACES
        return min(most, places_of(float(np.median(stds)) / unit_N)) if stds else max(0, most)

    @property
    def tested(self) -> Iterator[tuple[float, ForceRow, ForceCell]]:
        """The cells that are not empty: current (A), row and cell."""
        for row in self.rows:
            for current_A, cell in zip(self.currents_A, row.cells, strict=True):
                if cell is not None:
                    yield current_A, row, cell

    def to_json(self) -> dict[str, Any]:
        """Plain types; null for a number that is unknown."""
        entry: dict[str, Any] = plain(self)
        for row in entry["rows"]:
            row["cells"] = [cell and {"tests": len(cell["points"]), **cell} for cell in row["cells"]]
        return entry

    @classmethod
    def from_json(cls, entry: Mapping[str, Any]) -> Self:
        """What `to_json` wrote.

        Raises:
            KeyError, TypeError: it did not write this.
        """
        rows = tuple(
            ForceRow(
                row["speed_m_s"], row["amplitude_m"], row["frequency_Hz"],
                tuple(None if cell is None else ForceCell(**_with_nan(cell)) for cell in row["cells"]),
            )
            for row in entry["rows"]
        )
        return cls(entry["kind"], entry["waveform"], tuple(entry["currents_A"]), rows)


def force_tables(loops: Sequence[LoopCharacteristics]) -> tuple[ForceTable, ...]:
    """A table for each waveform among the loops, those of peak velocity first."""
    waveforms = sorted({loop.waveform for loop in loops}, key=lambda name: (name == TRIANGLE.name, name))
    return tuple(_table(name, [loop for loop in loops if loop.waveform == name]) for name in waveforms)


def _table(waveform: str, loops: Sequence[LoopCharacteristics]) -> ForceTable:
    currents_A = tuple(sorted({loop.level_A for loop in loops}))
    motions: dict[tuple[float, float], list[LoopCharacteristics]] = {}
    for loop in loops:
        motions.setdefault(loop.group, []).append(loop)
    rows = []
    for (amplitude_m, frequency_Hz), members in motions.items():
        at = [[loop for loop in members if loop.level_A == current_A] for current_A in currents_A]
        cells = tuple(ForceCell.of(repeats) if repeats else None for repeats in at)
        rows.append(ForceRow(_mean([loop.peak_speed_m_s for loop in members]), amplitude_m, frequency_Hz, cells))
    kind = CONSTANT_VELOCITY if waveform == TRIANGLE.name else PEAK_VELOCITY
    return ForceTable(kind, waveform, currents_A, tuple(sorted(rows, key=lambda row: row.speed_m_s)))


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return math.fsum(known) / len(known) if known else math.nan


def _with_nan(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: tuple(x) if name == "points" else math.nan if x is None else x for name, x in entry.items()
        if name != "tests"
    }
