"""The trials of an iterated signal as JSON, for processes without HDF5: `python -m rig.recording.drive_excerpt FILE`.

Writes to standard output one object: `point`, `record`, `follows`, `outcome`, `reason`, `start`, `tolerance` (null if
not stated), `errors` and `delays_s` of the trials, `frequency_Hz`, `coherence`, `least_coherence`, and of the
last trial `time_s`, `target` and `measured` (m, or N with a force target) over `SHOWN_S` around its middle, at most
`MOST_SHOWN` values; the remaining delay is removed from `measured`.
"""

from __future__ import annotations

import io
import json
import os
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rig.errors import EXIT_DONE, EXIT_USAGE, FileProblem
from rig.recording.drive_file import LARGEST_BYTES
from rig.recording.excerpt import NICENESS
from rig.signals.arrays import FloatArray
from rig.text_file import read_bytes

SHOWN_S, MOST_SHOWN = 8.0, 800
MOST_FREQUENCIES = 400


def drive_excerpt(path: Path) -> dict[str, Any]:
    """The object of one file.

    Raises:
        FileProblem: it cannot be read.
        KeyError: it is not a drive.
        OSError: it is not an HDF5 file.
    """
    with h5py.File(io.BytesIO(read_bytes(path, LARGEST_BYTES)), "r") as file:
        about = dict(file.attrs)
        errors, delays_s = (np.asarray(file[name], np.float64) for name in ("error", "delay"))
        names = ("target_force", "force") if about["follows"] == "force" else ("target", "measured")
        target = np.asarray(file[names[0]], np.float64)
        measured = np.asarray(file[names[1]][-1], np.float64) if len(file[names[1]]) else np.full(len(target), np.nan)
        response = {name: np.asarray(file["response"][name], np.float64) for name in ("frequency", "coherence")}
    step_s = float(about["step_s"])
    time_s = np.asarray(step_s * np.arange(len(target)), np.float64)
    half, middle = round(0.5 * SHOWN_S / step_s), len(target) // 2
    first, last = max(0, middle - half), min(len(target), middle + half)
    rows = slice(first, last, max(1, -(-(last - first) // MOST_SHOWN)))
    lines = slice(None, None, max(1, -(-len(response["frequency"]) // MOST_FREQUENCIES)))
    tolerance = about.get("tolerance")
    return {
        "point": str(about["point"]), "record": str(about["record"]), "follows": str(about["follows"]),
        "outcome": str(about["outcome"]), "reason": str(about["reason"]), "start": str(about["start"]),
        "tolerance": None if tolerance is None else float(tolerance), "errors": _numbers(errors),
        "delays_s": _numbers(delays_s), "least_coherence": float(about["least_coherence"]),
        "frequency_Hz": _numbers(response["frequency"][lines]), "coherence": _numbers(response["coherence"][lines]),
        "time_s": _numbers(time_s[rows]), "target": _numbers(target[rows]), "measured": _numbers(measured[rows]),
    }


def _numbers(values: FloatArray) -> list[float | None]:
    """Numbers of five digits; null where there is none."""
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in values]


def main(arguments: list[str]) -> int:
    """Write the object of the one file named; returns the exit code."""
    os.nice(NICENESS)
    try:
        sys.stdout.write(json.dumps(drive_excerpt(Path(arguments[0])), allow_nan=False))
    except (FileProblem, OSError, KeyError, IndexError, TypeError, ValueError) as error:
        sys.stderr.write(f"{error}\n")
        return EXIT_USAGE
    return EXIT_DONE


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
