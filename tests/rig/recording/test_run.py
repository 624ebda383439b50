from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rig.errors import FileProblem
from rig.recording import memory
from rig.recording.file_formats.table_file import read_bytes
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

FIRST_VERSION = Path(__file__).with_name("first_version.h5")


def write_point(folder: Path, name: str, waveform: str, current_A: float, verdict: str = "valid") -> None:
    time_s = np.arange(100) / 250.0
    write_file(folder / "points" / f"{name}.h5", PointFile(
        time_s, 250.0, [AlignedChannel("force", time_s, "N", "Force")], quality={"verdict": verdict},
        test={"id": name, "waveform": waveform, "amplitude_m": 0.05, "frequency_Hz": 1.5, "current_A": current_A},
    ))


@pytest.fixture
def run(campaign: Path) -> Run:
    write_point(campaign, "p001", "sine", 0.0)
    write_point(campaign, "p002", "sine", 1.0, "invalid")
    write_point(campaign, "p003", "triangle", 1.0)
    return Run.open(campaign)


def ids(points: tuple[RecordedPoint, ...]) -> list[str]:
    return [point.id for point in points]


def test_points_come_in_the_order_of_their_names_and_invalid_ones_are_distinguished(run: Run) -> None:
    assert ids(run.points) == ["p001", "p002", "p003"]
    assert ids(run.valid) == ["p001", "p003"]


@pytest.mark.parametrize(("text", "expected"), [
    ("waveform=triangle", ["p003"]),
    ("current_A=1", ["p002", "p003"]),
    ("current_A=1,waveform=sine", ["p002"]),
    ("id=p001|p003", ["p001", "p003"]),
    ("frequency_Hz=1.5, verdict=valid", ["p001", "p003"]),
    ("current_A=0.5", []),
])
def test_a_filter_selects_the_points_that_meet_every_condition(run: Run, text: str, expected: list[str]) -> None:
    assert ids(run.select(text)) == expected


@pytest.mark.parametrize(("text", "message"), [
    ("wavform=sine", "did you mean waveform"),
    ("waveform", "is not a condition"),
    ("current_A=high", "current_A = 'high': expected a number"),
    ("", "is not a condition"),
])
def test_a_wrong_filter_says_what_would_fit(run: Run, text: str, message: str) -> None:
    with pytest.raises(FileProblem, match=message):
        run.select(text)


def test_a_single_file_is_a_run_of_one(run: Run) -> None:
    assert ids(Run.open(run.path / "points" / "p003.h5").points) == ["p003"]


def test_a_point_opens_by_a_path_in_words_too(run: Run) -> None:
    path = run.path / "points" / "p003.h5"
    assert RecordedPoint.open(str(path)).id == RecordedPoint.open(path).id == "p003"


def test_paths_that_are_no_run_are_distinguished(run: Run, tmp_path: Path) -> None:
    with pytest.raises(FileProblem, match="'nowhere' is neither a path nor part of a run's name"):
        Run.open(tmp_path / "nowhere")
    assert Run.open(run.path.parent).path == run.path
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileProblem, match="not a run"):
        Run.open(tmp_path / "empty")
    (tmp_path / "empty" / "campaign.json").write_text("{}", encoding="utf-8")
    with pytest.raises(FileProblem, match="no points were recorded"):
        Run.open(tmp_path / "empty")
    points = tmp_path / "broken" / "points"
    points.mkdir(parents=True)
    (points / "p001.journal").touch()
    with pytest.raises(FileProblem, match="rig recover"):
        Run.open(tmp_path / "broken")


def test_a_run_becomes_a_table_of_points(run: Run) -> None:
    table = run.to_pandas()
    assert list(table["id"]) == ["p001", "p002", "p003"]
    assert list(table["verdict"]) == ["valid", "invalid", "valid"]


def test_channels_a_file_does_not_have_are_nan_not_zero(run: Run) -> None:
    assert np.all(np.isnan(run.points[0].current_measured_A))


def test_a_point_made_in_memory_has_the_requested_current_and_central_differences() -> None:
    time_s = np.arange(1000) / 1000.0
    point = RecordedPoint.from_arrays(
        time_s=time_s, displacement_m=0.01 * np.sin(2 * np.pi * time_s), force_N=np.zeros(1000), id="x",
        waveform="sine", amplitude_m=0.01, frequency_Hz=1.0, current_A=0.7,
    )
    assert np.all(point.current_measured_A == 0.7)
    assert np.max(point.velocity_m_s) == pytest.approx(0.02 * np.pi, rel=1e-3)
    assert np.array_equal(point.force_samples.time_s, time_s)


@pytest.mark.parametrize(("change", "says"), [
    ({"force_N": np.zeros(7)}, r"force_N has shape \(7,\), expected \(n,\) as for time_s: \(8,\)"),
    ({"displacement_m": np.zeros((8, 1))}, r"displacement_m has shape \(8, 1\)"),
    ({"velocity_m_s": np.zeros(9)}, "velocity_m_s has shape"),
    ({"time_s": np.repeat(np.arange(4.0), 2)}, "time_s must have"),
    ({"time_s": np.arange(8.0)[::-1]}, "time_s must have"),
    ({"time_s": np.zeros(0), "displacement_m": np.zeros(0), "force_N": np.zeros(0)}, "two or more samples"),
])
def test_arrays_that_are_no_samples_of_one_time_base_are_refused(change: dict[str, np.ndarray], says: str) -> None:
    arrays = {"time_s": np.arange(8.0), "displacement_m": np.zeros(8), "force_N": np.zeros(8), **change}
    with pytest.raises(FileProblem, match=says):
        RecordedPoint.from_arrays(
            **arrays, id="p", waveform="sine", amplitude_m=0.01, frequency_Hz=1.0, current_A=0.0,
        )


def test_a_table_with_two_columns_of_one_name_is_refused() -> None:
    time_s = np.arange(100) / 50.0
    table = pd.DataFrame({"displacement": np.sin(9.0 * time_s), "force": time_s}, index=pd.Index(time_s, name="time_s"))
    with pytest.raises(FileProblem, match="several columns named 'force'"):
        RecordedPoint.from_pandas(pd.concat([table, table[["force"]]], axis=1), id="p", current_A=0.0)


def test_a_table_goes_in_and_comes_out_unchanged() -> None:
    time_s = np.arange(0.0, 6.0, 0.004)
    motion_m = 0.02 * np.sin(2 * np.pi * 1.5 * np.clip(time_s - 0.5, 0.0, 5.0))
    table = pd.DataFrame({"displacement": motion_m, "force": 900.0 * motion_m}, index=pd.Index(time_s, name="time_s"))
    point = RecordedPoint.from_pandas(table, id="mine", current_A=0.5, units={"displacement": "m", "force": "N"})
    assert point.amplitude_m == pytest.approx(0.02, rel=1e-3)
    assert point.frequency_Hz == pytest.approx(1.5, rel=1e-3)
    assert np.all(point.current_measured_A == 0.5)
    pd.testing.assert_frame_equal(point.to_pandas()[["displacement", "force"]], table)
    again = RecordedPoint.from_pandas(point.to_pandas(), id="mine", current_A=0.5)
    pd.testing.assert_frame_equal(again.to_pandas(), point.to_pandas())


def test_a_table_that_is_no_test_says_why() -> None:
    time_s = np.arange(0.0, 1.0, 0.004)
    table = pd.DataFrame({"displacement": 0.0 * time_s, "F": 99.0 * time_s}, index=pd.Index(time_s, name="time_s"))
    table.attrs["units"] = {"displacement": "m", "force": "N"}
    with pytest.raises(FileProblem, match="no column 'force'; its columns: \\['displacement', 'F'\\]"):
        RecordedPoint.from_pandas(table, id="mine", current_A=0.5)
    with pytest.raises(FileProblem, match="must increase from row to row"):
        RecordedPoint.from_pandas(table.rename(columns={"F": "force"})[::-1], id="mine", current_A=0.5)


def test_a_record_that_does_not_fit_into_memory_is_refused_before_it_is_read(
    campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "meminfo"
    info.write_text("MemTotal: 9 kB\nMemAvailable: 1 kB\nSwapFree: 0 kB\n")
    point = RecordedPoint.open(shutil.copy(FIRST_VERSION, campaign / "points" / "p001.h5"))
    monkeypatch.setattr(memory, "MEMORY_INFO", info)
    with pytest.raises(FileProblem, match=r"requires about \S+ GB of memory, but only \S+ GB are available. Fix: "):
        _ = point.time_s
    table = tmp_path / "test.csv"
    table.write_text("time,x,F\n" + "0.1,2.5,3.5\n" * 100)
    with pytest.raises(FileProblem, match="Fix: split the file into shorter tests, close other programs"):
        read_bytes(table)
