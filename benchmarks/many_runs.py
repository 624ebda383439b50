"""`rig runs` over 10,000 campaigns: its time with the index, and of that the time to prove that nothing has changed.

    python benchmarks/many_runs.py [--runs 10000] [--points 5]

Campaigns are copies of one, and the index is filled without reading them, as `rig runs` does in about 15 ms of CPU each
the first time. The command is a process of its own: best and median of seven.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.results.run_index import RunFilter, listed


def make(folder: Path, runs: int, points: int) -> None:
    time_s = np.arange(500) / 250.0
    channels = [AlignedChannel("force", np.sin(time_s), "N", "Force"),
                AlignedChannel("displacement", np.cos(time_s), "m", "Displacement")]  # fmt: skip
    point = folder / "point.h5"
    write_file(point, PointFile(time_s, 250.0, channels, test={"id": "p001"}, quality={"verdict": "valid"}))
    for k in range(runs):
        place = folder / "runs" / f"20260101T{k:06d}Z"
        (place / "points").mkdir(parents=True)
        entry = {"specimen": f"MR-{k % 50:03d}", "started_utc": f"20{10 + k % 20}-01-01T00:00:00+00:00"}
        (place / "campaign.json").write_text(json.dumps(entry))
        fit = {"model": "bilinear", "parameters": {}, "error": {"nrmse_percent_of_peak": 2.0}}
        (place / "fit.json").write_text(json.dumps(fit))
        for number in range(points):
            os.link(point, place / "points" / f"p{number:03d}.h5")


def summary(place: Path) -> dict[str, object]:
    """What `rig runs` says of such a run."""
    entry = json.loads((place / "campaign.json").read_text())
    return {
        "id": place.name, "path": "", "specimen": entry["specimen"], "started": entry["started_utc"],
        "verdict": "valid",
        "model": "bilinear", "points": 5, "valid": 5, "unfinished": 0, "apart": 0, "nrmse_percent_of_peak": 2.0,
        "remark": "",
    }  # fmt: skip


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=10_000)
    arguments.add_argument("--points", type=int, default=5)
    given = arguments.parse_args()
    place = Path(tempfile.mkdtemp(prefix="many-runs-"))
    try:
        make(place, given.runs, given.points)
        program = str(Path(sys.executable).parent / "rig")
        command = [program, "runs", "--in", str(place / "runs"), "--specimen", "MR-007"]
        time.sleep(2.1)  # until files count as settled
        listed(place / "runs", summary, RunFilter())
        took = []
        for _ in range(7):
            begun, used = time.perf_counter(), os.times()
            out = subprocess.run([*command, "--json"], capture_output=True, check=True).stdout
            after = os.times()
            cpu = after.children_user + after.children_system - used.children_user - used.children_system
            took.append((time.perf_counter() - begun, cpu))
        walls, cpus = zip(*took, strict=True)
        print(f"{len(json.loads(out)['runs'])} of {given.runs} runs: best {min(walls):.2f} s, median "
              f"{statistics.median(walls):.2f} s, CPU {min(cpus):.2f} s")  # fmt: skip
    finally:
        shutil.rmtree(place)


if __name__ == "__main__":
    main()
