"""The analysis of recorded tests needs nothing that only Linux has: it runs on Windows, too."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np


def test_import_identify_report_export_compare_and_python_need_no_linux(tmp_path: Path) -> None:
    time_s = np.arange(0.0, 4.0, 0.004)
    phase = 2.0 * np.pi * time_s
    speed_m_s = 0.02 * 2.0 * np.pi * np.cos(phase)
    force_N = 300.0 * np.tanh(30.0 * speed_m_s) + 800.0 * speed_m_s
    table = np.column_stack([time_s, 20.0 * np.sin(phase), force_N])
    np.savetxt(tmp_path / "test.csv", table, delimiter=",", header="time [s],displacement [mm],force [N]", comments="")
    command = [sys.executable, str(Path(__file__).with_name("windows.py")), "test.csv"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    points, model, force = done.stdout.split()[-3:]
    assert (points, model) == ("1", "kwok")
    assert abs(float(force) - np.abs(force_N).max()) < 0.05 * np.abs(force_N).max()
    assert {path.suffix for path in (tmp_path / "model").iterdir()} >= {".c", ".h"}
    assert (tmp_path / "tables").is_dir()
