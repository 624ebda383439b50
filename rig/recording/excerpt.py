"""The end of a recorded point as plain arrays, for processes without HDF5: `python -m rig.recording.excerpt FILE`.

Writes an `.npz` archive to standard output: the last `SHOWN_CYCLES` cycles at full amplitude, of a motion without
cycles the last `SHOWN_S` (`loop_time` s, `loop_displacement` m, `loop_velocity` m/s, `loop_force` N), and of the last
`SHOWN_S` what each channel measured (`time_NAME` s, `NAME` SI): (n,) float64, without missing values.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import EXIT_DONE, EXIT_USAGE, FileProblem
from rig.recording.recorded_point import RecordedPoint

SHOWN_CYCLES, SHOWN_S = 5.0, 20.0
MOST_SHOWN = 4000
FULL = 0.95
"""Of the largest amplitude: counts as full."""
NICENESS = 10
"""A file may be read while a campaign runs on the same computer: below its converter."""
CHANNELS = ("force", "displacement", "current", "coil_temperature", "commanded_current")


def excerpt(path: Path) -> dict[str, NDArray[np.float64]]:
    """The arrays of one point's file.

    Raises:
        FileProblem: it cannot be read.
    """
    point = RecordedPoint.open(path)
    time_s = point.time_s
    period_s, end_s = SHOWN_S / SHOWN_CYCLES, float(time_s[-1])
    if point.frequency_Hz > 0.0 and point.has_frequency:
        period_s, end_s = 1.0 / point.frequency_Hz, _last_peak_s(time_s, point.displacement_m)
    shown_s = min(SHOWN_CYCLES, max(1.0, point.cycles - 1.0) if point.cycles else SHOWN_CYCLES) * period_s
    chosen = np.flatnonzero((time_s <= end_s) & (time_s >= end_s - shown_s))
    chosen = chosen[:: max(1, -(-len(chosen) // MOST_SHOWN))]
    speed_m_s = point.velocity_m_s
    if not np.isfinite(speed_m_s).any():  # older files, imported tests
        speed_m_s = np.gradient(point.displacement_m, time_s)
    loop = np.array([time_s, point.displacement_m, speed_m_s, point.force_N])[:, chosen]
    loop = loop[:, np.isfinite(loop).all(axis=0)]
    names = ("loop_time", "loop_displacement", "loop_velocity", "loop_force")
    arrays: dict[str, NDArray[np.float64]] = dict(zip(names, loop, strict=True))
    for name in CHANNELS:
        values = point.channel(name)
        known = np.isfinite(values) & (time_s >= time_s[-1] - SHOWN_S)
        arrays[f"time_{name}"], arrays[name] = time_s[known], values[known]
    return arrays


def _last_peak_s(time_s: NDArray[np.float64], displacement_m: NDArray[np.float64]) -> float:
    """When the motion was last at its full amplitude: before the ramp out, and what follows it."""
    low_m, high_m = np.nanmin(displacement_m), np.nanmax(displacement_m)
    away_m = np.abs(displacement_m - (low_m + high_m) / 2.0)
    return float(time_s[np.flatnonzero(away_m >= FULL * (high_m - low_m) / 2.0)[-1]])


def main(arguments: list[str]) -> int:
    """Write the arrays of the one file named; returns the exit code."""
    os.nice(NICENESS)
    try:
        arrays = excerpt(Path(arguments[0]))
    except (FileProblem, OSError, IndexError, ValueError) as error:
        sys.stderr.write(f"{error}\n")
        return EXIT_USAGE
    np.savez(sys.stdout.buffer, **arrays)  # type: ignore[arg-type] # numpy's stubs take the names for its options
    return EXIT_DONE


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
