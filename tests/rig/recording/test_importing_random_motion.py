"""Tests without cycles, and a driver's voltage in place of a current, come in from a file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rig.errors import FileProblem
from rig.identification import identify_run
from rig.recording.importing import import_tests
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

COLUMNS = {"time": "t:s", "displacement": "D:cm", "force": "F:N", "voltage": "Y:V"}


def random_file(folder: Path, sign: float = 1.0) -> Path:
    """10 s at 500 Hz as loggers write them: quoted names, an empty last column, cm and V; 1 kN s/m beside 300 N/V."""
    time_s = np.arange(5000) / 500.0
    rng = np.random.default_rng(1)
    tones = [(rng.uniform(0.5, 6.0), rng.uniform(0.0, 6.0)) for _ in range(30)]
    u_cm = sum(0.2 * np.sin(2.0 * np.pi * f * time_s + p) for f, p in tones)
    v_m_s = 0.01 * np.gradient(u_cm, time_s)
    volts = np.where(np.sin(2.0 * np.pi * 0.7 * time_s) > 0.0, 2.25, 0.0)
    force_N = sign * (1000.0 * v_m_s + 300.0 * volts * np.tanh(v_m_s / 0.01) + rng.normal(0.0, 3.0, 5000))
    rows = (f"{t:.4f},{x:.6f},{y:.4f},{f:.3f},\n" for t, x, y, f in zip(time_s, u_cm, volts, force_N, strict=True))
    file = folder / "ranran.csv"
    file.write_text('"t","D","Y","F",\n' + "".join(rows))
    return file


def test_random_motion_under_a_voltage_becomes_a_valid_point(tmp_path: Path) -> None:
    file = random_file(tmp_path)
    run = Run.open(import_tests([file], columns=COLUMNS, waveform="random", out=tmp_path, ampere_per_volt=0.5))
    (point,) = run.points
    assert isinstance(point, RecordedPoint)
    assert (point.waveform, point.verdict, point.cycles) == ("random", "valid", 0)
    assert point.channel("commanded_current").max() == pytest.approx(0.5 * 2.25)
    assert np.all(np.isnan(point.current_measured_A))
    rows = [line.split(",") for line in file.read_text().splitlines()[1:]]
    cm = np.array([float(row[1]) for row in rows])
    assert point.displacement_m == pytest.approx(0.01 * cm)
    assert point.amplitude_m == pytest.approx(0.005 * np.ptp(cm), rel=0.05)
    assert "voltage Y" in str(point.provenance["current"])


def test_an_imported_random_test_is_fitted_and_forereported(tmp_path: Path) -> None:
    run = import_tests([random_file(tmp_path)], columns=COLUMNS, waveform="random", out=tmp_path)
    fit = identify_run([run], model="kwok", holdout="last 30 %")
    assert fit.holdout is not None
    assert fit.holdout.r_squared > 0.97
    assert json.loads((run / "fit.json").read_text())["coil_eta_1_s"] == pytest.approx(fit.coil_eta_1_s)


def test_a_random_test_with_a_reversed_sign_is_invalid(tmp_path: Path) -> None:
    run = Run.open(import_tests([random_file(tmp_path, -1.0)], columns=COLUMNS, waveform="random", out=tmp_path))
    assert [reason.slug for reason in run.points[0].quality.verdict.entries] == ["reversed-sign"]


def test_a_voltage_beside_a_commanded_current_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileProblem, match="both specify the coil command"):
        import_tests(
            [random_file(tmp_path)], columns={**COLUMNS, "commanded_current": "Y:A"}, waveform="random", out=tmp_path
        )


def test_a_temperature_in_kelvin_is_recorded_in_degrees(tmp_path: Path) -> None:
    lines = random_file(tmp_path).read_text().splitlines()
    warm = tmp_path / "warm.csv"
    rows = [f"{line}{295.15 + 0.001 * k:.3f}" for k, line in enumerate(lines[1:])]
    warm.write_text('"t","D","Y","F","oil"\n' + "\n".join(rows) + "\n")
    expected = {**COLUMNS, "temperature": "oil:K"}
    (point,) = Run.open(import_tests([warm], columns=expected, waveform="random", out=tmp_path / "runs")).points
    assert point.channel("coil_temperature")[[0, -1]] == pytest.approx([22.0, 26.999], abs=1e-3)
    assert point.quality.coil_low_degC == pytest.approx(22.0, abs=1e-3)
