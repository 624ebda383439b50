from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile

Make = Callable[..., Path]
CYCLES, RATE_HZ = 6, 250.0


class Recorder:
    """Writes runs of a damper F = c v + F0 with dry friction, whose characteristics are known on paper."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def run(self, name: str, damping_N_s_m: float = 1000.0, percent: float | None = None) -> Path:
        """A run of one sine of 20 mm and 1 Hz at 0.5 A."""
        folder = self.folder / name
        (folder / "points").mkdir(parents=True, exist_ok=True)
        (folder / "campaign.json").write_text(json.dumps({"specimen": f"S-{name}"}))
        self.point(folder, "p001", damping_N_s_m, percent=percent)
        return folder

    def point(
        self, folder: Path, name: str, damping_N_s_m: float, *, current_A: float = 0.5, frequency_Hz: float = 1.0,
        verdict: str = "valid", percent: float | None = None, kind: str = "loop", amplitude_m: float = 0.02,
        offset_N: float = -50.0, imported: bool = False,
    ) -> Path:
        duration_s = CYCLES / frequency_Hz
        time_s = np.arange(round((duration_s + 0.4) * RATE_HZ)) / RATE_HZ
        phase = 2 * np.pi * frequency_Hz * np.clip(time_s - 0.2, 0.0, duration_s)
        moving = (phase > 0) & (phase < 2 * np.pi * CYCLES)
        u_m = amplitude_m * np.sin(phase)
        force_N = damping_N_s_m * amplitude_m * 2 * np.pi * frequency_Hz * np.cos(phase) * moving + offset_N
        stated = {} if percent is None else {f"{of}_uncertainty_percent": percent for of in ("force", "displacement")}
        path = folder / "points" / f"{name}.h5"
        write_file(path, PointFile(
            time_s, RATE_HZ,
            [AlignedChannel("displacement", u_m, "m", "Damper extension"),
             AlignedChannel("force", force_N, "N", "Force"),
             AlignedChannel("current", np.full(len(u_m), current_A), "A", "Current")],
            test={"id": name, "waveform": "sine", "amplitude_m": amplitude_m, "frequency_Hz": frequency_Hz,
                  "current_A": current_A, "mid_stroke_m": 0.0, "kind": kind, "imported": imported, **stated},
            quality={"verdict": verdict, "reasons": ("estop: stopped",) if verdict == "invalid" else ()},
            provenance={"bench": "a bench", "specimen": "S"},
        ))  # fmt: skip
        return path

    def fit(self, folder: Path, **changes: object) -> Path:
        entry: dict[str, object] = {
            "value": 500.0, "unit": "N", "standard_error": 5.0, "low": 490.0, "high": 510.0, "identifiable": True,
        }  # fmt: skip
        entry |= {key: changes.pop(key) for key in list(changes) if key in entry}
        path = folder / "fit.json"
        path.write_text(json.dumps({"model": "bingham", "adequate": True, "parameters": {"Fy": entry}, **changes}))
        return path


@pytest.fixture
def recorder(tmp_path: Path) -> Recorder:
    return Recorder(tmp_path)


@pytest.fixture
def made_run(recorder: Recorder) -> Make:
    return recorder.run


@pytest.fixture
def made_point(recorder: Recorder) -> Make:
    return recorder.point


@pytest.fixture
def made_fit(recorder: Recorder) -> Make:
    return recorder.fit


@pytest.fixture
def bands(tmp_path: Path) -> Make:
    """Writes a bands file of some tables and returns its path."""

    def write(text: str, decision: str = "simple") -> Path:
        path = tmp_path / "bands.toml"
        path.write_text(f'format = 1\nname = "drawing 4711"\ndecision = "{decision}"\n{text}', encoding="utf-8")
        return path

    return write
