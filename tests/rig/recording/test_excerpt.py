"""What is shown of a recorded point beside its whole file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rig.recording.excerpt import excerpt
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile


def recorded(folder: Path, **test: object) -> Path:
    """30 s at 250 Hz: 20 mm at 1 Hz at first, 5 mm at the end, as a sweep's amplitude may fall."""
    time_s = np.arange(7500) / 250.0
    displacement_m = np.interp(time_s, [0.0, 30.0], [0.020, 0.005]) * np.sin(2.0 * np.pi * time_s)
    described = {"id": "p001", "amplitude_m": 0.02, "frequency_Hz": 1.0, "current_A": 0.5, "mid_stroke_m": 0.0}
    write_file(folder / "p001.h5", PointFile(
        time_s, 250.0,
        [AlignedChannel("displacement", displacement_m, "m", "Damper extension"),
         AlignedChannel("force", 100.0 * np.cos(2.0 * np.pi * time_s), "N", "Force"),
         AlignedChannel("current", np.full(7500, 0.5), "A", "Current")],
        test={**described, **test}, quality={"verdict": "valid", "reasons": ()}, provenance={},
    ))  # fmt: skip
    return folder / "p001.h5"


def test_of_a_motion_without_cycles_the_last_seconds_are_shown_wherever_it_was_largest(tmp_path: Path) -> None:
    shown = excerpt(recorded(tmp_path, waveform="sweep", kind="signal", record="sweep"))
    assert shown["loop_time"][[0, -1]] == pytest.approx([30.0 - 20.0, 30.0], abs=0.02)
    assert np.ptp(shown["loop_displacement"]) == pytest.approx(2 * 0.015, rel=0.05)


def test_of_a_sine_its_last_cycles_at_full_amplitude_are_shown(tmp_path: Path) -> None:
    shown = excerpt(recorded(tmp_path, waveform="sine"))
    assert shown["loop_time"][-1] < 5.0, "it was largest at its beginning"
