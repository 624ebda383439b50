"""A zero that did not return reaches the session's points, their files and the number of valid ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rig.campaign.point_results import PointResults
from rig.campaign.results import CampaignFinding
from rig.recording.conversion.delay_correction import judge_together
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.recording.quality.cross_checks import doubts
from rig.recording.recorded_point import RecordedPoint
from rig.test_point import TestPoint

POINTS = tuple(TestPoint(f"p{number:03d}", "sine", 0.02, 1.0, 0.0, cycles=4) for number in (1, 2, 3))
FINDING = CampaignFinding(
    "zero-drift", "bench", "load cell and controller's force input drifted apart by +26.7 N between start and end",
    ("load cell", "controller's force input"), {"drift": 26.7},
)


def books(folder: Path) -> PointResults:
    results = PointResults(POINTS)
    time_s = np.arange(1000) / 250.0
    for point in POINTS:
        file = folder / f"{point.id}.h5"
        write_file(file, PointFile(
            time_s, 250.0, [AlignedChannel("displacement", np.sin(time_s), "m", "Extension"),
                            AlignedChannel("force", np.cos(time_s), "N", "Force")],
            test={"id": point.id, "waveform": "sine", "amplitude_m": 0.02, "frequency_Hz": 1.0, "current_A": 0.0},
            quality={"verdict": "valid"}, provenance={"bench_hash": "b"},
        ))
        results.record_verdict(point, file, "valid", (), 0)
    return results


def test_every_point_of_the_session_is_doubted_and_none_of_an_earlier_one(tmp_path: Path) -> None:
    before = books(tmp_path).results
    results, warned = PointResults(POINTS, {"p001": before["p001"]}), list[str]()
    for point in POINTS[1:]:
        results.record_verdict(point, before[point.id].file, "valid", (), 0)
    results.doubted([FINDING], warned.append)
    assert warned == []
    assert results.valid == 1
    assert results.results["p001"].verdict == "valid"
    for name in ("p002", "p003"):
        read = RecordedPoint.open(tmp_path / f"{name}.h5")
        assert (read.verdict, read.reasons) == ("suspect", results.results[name].reasons)
        assert "load cell and controller's force input" in read.reasons[0]
        assert read.quality.verdict.blamed == ("bench",)
        assert len(doubts([read])) == 1


def test_a_later_evaluation_of_all_points_keeps_the_doubt(tmp_path: Path) -> None:
    results = books(tmp_path)
    results.doubted([FINDING], str)
    list(judge_together(tmp_path))
    assert {RecordedPoint.open(file).verdict for file in tmp_path.glob("*.h5")} == {"suspect"}


def test_zeros_that_returned_touch_nothing_and_a_file_that_cannot_be_read_is_reported(tmp_path: Path) -> None:
    results = books(tmp_path)
    before = (tmp_path / "p001.h5").read_bytes()
    results.doubted([], str)
    assert (tmp_path / "p001.h5").read_bytes() == before
    (tmp_path / "p002.h5").write_bytes(b"no HDF5")
    warned: list[str] = []
    results.doubted([FINDING], warned.append)
    assert len(warned) == 1
    assert "p002.h5" in warned[0]
    assert results.results["p003"].verdict == "suspect"
