"""The points of a run as JSON, for processes without HDF5: `python -m rig.recording.listing RUN`.

Writes a list of objects with the keys of `points` in `rig run --json`, as far as the files of the points state them. An
imported run has no journal, in which a campaign keeps them.
"""

from __future__ import annotations

import json
import math
import os
import sys
from pathlib import Path
from typing import Any

from rig.errors import EXIT_DONE, EXIT_USAGE, FileProblem
from rig.recording.excerpt import NICENESS
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run


def listed(run: Path) -> list[dict[str, Any]]:
    """The points of a run, in the run's order; numbers that are not known are null.

    Raises:
        FileProblem: the run, or one of its points, cannot be read.
    """
    return [_point(point) for point in Run.open(run).points]


def _point(point: RecordedPoint) -> dict[str, Any]:
    quality, peak = point.quality, point.peak_force_N
    return {
        "id": point.id, "file": None if point.path is None else point.path.name, "verdict": point.verdict,
        "reasons": list(point.reasons), "waveform": point.waveform, "amplitude_m": _known(point.amplitude_m),
        "frequency_Hz": _known(point.frequency_Hz), "current_A": _known(point.current_A), "described": point.described,
        "repeats": point.has_frequency,
        "peak_force_rebound_N": _known(peak.rebound_N), "peak_force_compression_N": _known(peak.compression_N),
        "quality": {
            "coil_temperature_low_degC": quality.coil_low_degC, "coil_temperature_high_degC": quality.coil_high_degC,
        },
    }  # fmt: skip


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def main(arguments: list[str]) -> int:
    """Write the points of the one run named; returns the exit code."""
    os.nice(NICENESS)
    try:
        points = listed(Path(arguments[0]))
    except (FileProblem, OSError, IndexError, ValueError) as error:
        sys.stderr.write(f"{error}\n")
        return EXIT_USAGE
    json.dump(points, sys.stdout)
    return EXIT_DONE


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
