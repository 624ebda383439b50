"""A study small enough for a test: few samples, few evaluations; and a recorded run of the demo damper."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile

SMALL = """
format = 1
name = "small"
seed = 3
[data]
simulate = "table1"
noise = "5 N"
keep_every = 40
[comparison]
methods = ["de", "pso", "c_foa"]
populations = [8, 12]
budgets = [60, 120]
repeats = 2
[symmetry]
population = 8
budget = 120
[sensitivity]
populations = [8, 12]
generations = [4, 6]
resolutions = [100, 10]
[per_current]
model = "bouc_wen"
methods = ["ga_novel", "zhu_three_step"]
current = ["0 A", "0.5 A", "1 A"]
population = 6
budget = 24
repeats = 1
[per_current.data]
simulate = "bouc_wen"
noise = "1 N"
"""


@pytest.fixture
def small_study(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    return path


def record(
    run: Path, name: str, frequency_Hz: float, current_A: float, verdict: str = "valid", kind: str = "loop"
) -> None:
    """A recorded point of the demo damper: sine of 20 mm, 250 Hz, 5 N of noise."""
    time_s = np.arange(0.0, 5.0 / frequency_Hz, 0.004)
    omega = 2.0 * np.pi * frequency_Hz
    u, v = 0.02 * np.sin(omega * time_s), 0.02 * omega * np.cos(omega * time_s)
    current = np.full(len(u), current_A)
    force = model("asymmetric").force(parameter_set("demo").values, u, v, -(omega**2) * u, current, 0.004)
    channels = [
        AlignedChannel("displacement", u, "m", "Damper extension"),
        AlignedChannel("force", force + np.random.default_rng(1).normal(0.0, 5.0, len(u)), "N", "Force"),
        AlignedChannel("current", current, "A", "Current"),
    ]
    test = {"id": name, "waveform": "sine", "amplitude_m": 0.02, "frequency_Hz": frequency_Hz, "current_A": current_A}
    test["kind"] = kind
    quality = {"verdict": verdict, "reasons": () if verdict == "valid" else ("estop: held",)}
    point = PointFile(time_s, 250.0, channels, test={**test, "mid_stroke_m": 0.0}, quality=quality, provenance={})
    write_file(run / "points" / f"{name}.h5", point)


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    """Four valid points, two currents at two frequencies, and an invalid one at a third current."""
    run = tmp_path / "run"
    (run / "points").mkdir(parents=True)
    points = [(1.0, 0.0), (2.0, 0.0), (1.0, 1.0), (2.0, 1.0)]
    for number, (frequency_Hz, current_A) in enumerate(points, start=1):
        record(run, f"p{number:03}", frequency_Hz, current_A)
    record(run, "p005", 1.0, 2.0, verdict="invalid")
    (run / "campaign.json").write_text(json.dumps({"specimen": "MR-001"}))
    return run


@pytest.fixture
def friction_point() -> Callable[[Path, str], None]:
    """Adds a friction test, a valid point that is no loop, to a run."""

    def add(run: Path, name: str) -> None:
        record(run, name, 0.5, 0.0, kind="friction")

    return add
