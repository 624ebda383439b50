"""Campaigns begun by an earlier program (recorded in November 2026 by version 0.1.0): read, reported, resumed."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from simulated_campaign import taken_up

from rig.cli.main import cli
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

CAMPAIGNS = Path(__file__).resolve().parent.parent / "golden" / "earlier_campaigns.tar.xz"


@pytest.fixture
def earlier(tmp_path: Path) -> Path:
    """Two campaigns of four points: `stopped` by Ctrl-C and `killed` with kill -9, each while p002 ran."""
    with tarfile.open(CAMPAIGNS) as archive:
        archive.extractall(tmp_path, filter="data")
    return tmp_path


def test_a_recorded_point_reads_as_it_did(earlier: Path) -> None:
    run = Run.open(earlier / "stopped")
    point = run.points[0]
    assert (point.id, point.waveform, point.verdict) == ("p001", "sine", "valid")
    assert (point.frequency_Hz, point.current_A) == (4.0, 0.5)
    assert point.amplitude_m == pytest.approx(5e-3)
    assert point.lost_samples == 0
    still = point.time_s < point.time_s[0] + 0.05
    assert np.ptp(point.displacement_m) == pytest.approx(10e-3, rel=0.03)
    assert abs(float(np.median(point.displacement_m[still]))) < 1e-4
    inside = np.isfinite(point.velocity_m_s) & np.isfinite(point.force_N)
    assert np.nanmax(point.velocity_m_s) == pytest.approx(5e-3 * 2 * np.pi * 4.0, rel=0.05)
    work_J = float(np.trapezoid((point.force_N * point.velocity_m_s)[inside], point.time_s[inside]))
    assert work_J > 10.0
    assert point.skew_s is not None
    assert abs(point.skew_s) < 1e-3


def test_an_interrupted_point_stays_invalid_for_its_reason(earlier: Path) -> None:
    point = RecordedPoint.open(earlier / "stopped" / "points" / "p002.h5")
    assert point.verdict == "invalid"
    assert [reason.partition(":")[0] for reason in point.reasons] == ["sigint"]


def test_a_report_is_made_of_it(earlier: Path) -> None:
    done = CliRunner().invoke(cli, ["report", str(earlier / "stopped")])
    assert done.exit_code == 0, done.output
    page = (earlier / "stopped" / "report.html").read_text(encoding="utf-8")
    assert "MR-001" in page
    assert "p001" in page


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["stopped", "killed"])
def test_it_is_resumed_to_its_end(earlier: Path, name: str) -> None:
    folder = earlier / name
    kept = (folder / "points" / "p001.h5").read_bytes()
    begun = json.loads((folder / "campaign.json").read_text(encoding="utf-8"))["simulated"]
    with taken_up(earlier, folder, begun["speed"], begun["seed"]) as session:
        ended = session.end()
    assert ended.exit_code == 0, ended.output
    assert [(point["id"], point["verdict"]) for point in ended.answer["points"]] == [
        ("p001", "valid"), ("p002", "valid"), ("p003", "valid"), ("p004", "valid")
    ]  # fmt: skip
    assert (folder / "points" / "p001.h5").read_bytes() == kept
