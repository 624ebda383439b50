"""Make runs of simulated dampers without a rig, and evaluate them by `rig quality`: production, golden damper, gauge.

    python examples/many_specimens.py FOLDER

FOLDER/production  50 specimens, one run each; 3 of them have another force (SP-023, SP-037, SP-044)
FOLDER/golden      30 days of the golden damper GOLD-1; from day 26, the load cell reads 2 % high
FOLDER/gauge       10 specimens, 3 operators, 3 runs each; one run is missing

The pages are FOLDER/production.html, golden.html and gauge.html.
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile

RATE_HZ, CYCLES, AMPLITUDE_M, FREQUENCY_HZ = 250.0, 5, 0.03, 1.0
CURRENTS_A = (0.0, 1.0)
CHANGED = {23: 1.06, 37: 0.94, 44: 1.08}
"""Number of a specimen -> its force, relative."""
STUDIES = {
    "production": ["--quantity", "rebound_force", "--current", "1 A", "--low", "450", "--high", "540"],
    "golden": ["golden"],
    "gauge": ["gauge", "--quantity", "rebound_force", "--low", "350", "--high", "650"],
}
"""Folder -> arguments of `rig quality`."""


def write_run(
    folder: Path, started: datetime, specimen: str, random: np.random.Generator, *, operator: str = "A. Miller",
    force: float = 1.0, load_cell: float = 1.0, warmer_K: float = 0.0,
) -> None:
    """Write a run with one sine at each current.

    Args:
        folder: folder of runs.
        started: start of the run.
        specimen: serial number.
        random: source of noise.
        operator: person who performed the test.
        force: force of the damper, relative to the usual one.
        load_cell: reading of the load cell, relative to the force.
        warmer_K: temperature of the oil above the usual one.
    """
    name = f"{started:%Y%m%dT%H%M%SZ}-{specimen}"
    run = folder / name
    (run / "points").mkdir(parents=True)
    names = [f"p{number:03d}" for number in range(1, len(CURRENTS_A) + 1)]
    (run / "campaign.json").write_text(json.dumps({
        "id": name, "specimen": specimen, "started_utc": started.isoformat(), "bench": "simulated bench",
        "matrix_file": "production.toml", "operator": operator, "points": names, "simulated": {"seed": 0},
        "software": "examples/many_specimens.py",
    }), encoding="utf-8")  # fmt: skip
    time_s = np.arange(round((CYCLES / FREQUENCY_HZ + 0.4) * RATE_HZ)) / RATE_HZ
    phase = 2.0 * np.pi * FREQUENCY_HZ * np.clip(time_s - 0.2, 0.0, CYCLES / FREQUENCY_HZ)
    speed = 2.0 * np.pi * FREQUENCY_HZ * AMPLITUDE_M * np.cos(phase) * ((phase > 0.0) & (phase < phase[-1]))
    for point, current_A in zip(names, CURRENTS_A, strict=True):
        size = force * load_cell * (1.0 - 0.005 * warmer_K)
        force_N = size * (900.0 * speed + (60.0 + 320.0 * current_A) * np.tanh(speed / 0.02)) - 50.0 * load_cell
        channels = [
            AlignedChannel("displacement", AMPLITUDE_M * np.sin(phase), "m", "Damper extension"),
            AlignedChannel("force", force_N + 3.0 * random.standard_normal(len(time_s)), "N", "Force", "load_cell"),
            AlignedChannel("current", np.full(len(time_s), current_A), "A", "Coil current"),
        ]
        degC = 25.0 + warmer_K
        write_file(run / "points" / f"{point}.h5", PointFile(
            time_s, RATE_HZ, channels,
            test={"id": point, "waveform": "sine", "amplitude_m": AMPLITUDE_M, "frequency_Hz": FREQUENCY_HZ,
                  "current_A": current_A, "mid_stroke_m": 0.0, "kind": "loop", "simulated": True},
            quality={"verdict": "valid", "coil_temperature_low_degC": degC, "coil_temperature_high_degC": degC,
                     "measured_amplitude_m": AMPLITUDE_M * (1.0 + 1e-4 * random.standard_normal())},
            provenance={"specimen": specimen, "bench": "simulated bench", "campaign": name},
        ))  # fmt: skip


def make(folder: Path, seed: int = 0) -> None:
    """Write all three sets of runs."""
    random = np.random.default_rng(seed)
    begin = datetime(2026, 3, 2, 7, 0, tzinfo=UTC)
    for number in range(1, 51):
        force = CHANGED.get(number, 1.0 + 0.01 * random.standard_normal())
        started = begin + timedelta(minutes=20 * number)
        write_run(folder / "production", started, f"SP-{number:03d}", random, force=force,
                  warmer_K=random.normal(0.0, 0.5))  # fmt: skip
    for day in range(1, 31):
        write_run(folder / "golden", begin + timedelta(days=day), "GOLD-1", random, warmer_K=random.normal(0.0, 1.0),
                  force=1.0 + 0.002 * random.standard_normal(), load_cell=1.02 if day > 25 else 1.0)  # fmt: skip
    parts = 1.0 + 0.05 * random.standard_normal(10)
    minutes = 0
    for trial in range(3):
        for operator, bias in (("A. Miller", 0.0), ("B. Young", 0.004), ("C. Khan", -0.003)):
            for number, force in enumerate(parts, 1):
                minutes += 10
                if (trial, operator, number) == (2, "C. Khan", 10):
                    continue  # one mounting failed: the numbers of trials differ
                mounted = force * (1.0 + bias + 0.004 * random.standard_normal())
                write_run(folder / "gauge", begin + timedelta(minutes=minutes), f"PART-{number:02d}", random,
                          operator=operator, force=mounted)  # fmt: skip


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    make(Path(sys.argv[1]))
    for name, arguments in STUDIES.items():
        runs, page = Path(sys.argv[1]) / name, Path(sys.argv[1]) / f"{name}.html"
        words = ["quality", *arguments, "--in", str(runs), "--out", str(page)]
        sys.stdout.write(f"\n> rig {shlex.join(words)}\n")
        sys.stdout.flush()
        subprocess.run([sys.executable, "-m", "rig.cli.main", *words], check=False)  # 8: the study has a signal
