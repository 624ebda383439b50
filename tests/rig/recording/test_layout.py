from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

from rig.recording.layout import RECORD_DTYPE, AlignedChannel, Event, PointFile, RawChannel, write_file
from rig.recording.run import RecordedPoint


def a_point(samples: int = 1000) -> PointFile:
    time_s = np.arange(samples) / 250.0
    force = 100.0 * np.cos(time_s)
    force[3] = np.nan
    records = np.zeros(samples, RECORD_DTYPE)
    records["value"], records["sequence"] = force, np.arange(samples)
    return PointFile(
        time_s, 250.0,
        [AlignedChannel("displacement", 0.05 * np.sin(time_s), "m", "Damper extension", "lvdt"),
         AlignedChannel("force", force, "N", "Force at the load cell", "load_cell", {"serial_number": "LC-1"})],
        raw=[RawChannel("force", records, "N", "Force", time_s + 0.001), RawChannel("pulse", records[:0], "1", "None")],
        events=[Event(5_000_000, "note", "über alles"), Event(6_000_000, "stop", "")],
        test={"id": "p001", "waveform": "sine", "amplitude_m": 0.05, "frequency_Hz": 1.0, "current_A": 0.5,
              "mid_stroke_m": None},
        quality={"verdict": "suspect", "reasons": ("one: first", "two: second"), "lost_samples": 2},
        provenance={"bench": "here", "software": "x"},
    )


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "p001.h5"
    write_file(path, a_point())
    return path


def test_a_point_is_read_back_as_it_was_written(file: Path) -> None:
    point, wanted = RecordedPoint.open(file), a_point()
    assert np.array_equal(point.time_s, wanted.time_s)
    assert np.array_equal(point.force_N, wanted.channels[1].values.astype(np.float32), equal_nan=True)
    assert (point.verdict, point.reasons, point.lost_samples) == ("suspect", ("one: first", "two: second"), 2)
    assert (point.amplitude_m, point.frequency_Hz, point.current_A, point.mid_stroke_m) == (0.05, 1.0, 0.5, None)
    assert point.force_samples.time_s[0] == 0.001


def test_events_keep_time_slug_and_text(file: Path) -> None:
    from rig.recording.reading import read_events

    assert read_events(file) == [(5_000_000, "note", "über alles"), (6_000_000, "stop", "")]


def test_every_dataset_states_its_units_and_time_is_a_dimension_scale(file: Path) -> None:
    with h5py.File(file) as opened:
        data = opened["entry/data"]
        assert data["time"].is_scale
        for name in ("displacement", "force", "flags"):
            assert data[name].dims[0][0] == data["time"]
            assert data[name].attrs["units"]
        assert data["time"].attrs["units"] == b"s"
        assert all("units" in column.attrs for column in opened["entry/raw/force"].values())
        assert data["force"].dtype == np.float32
        assert data["force"].compression == "gzip"
        assert data["force"].fletcher32


def test_nothing_in_the_file_needs_compound_boolean_or_variable_length_types(file: Path) -> None:
    kinds = set()

    def look(_: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            kinds.add(item.dtype.kind)

    with h5py.File(file) as opened:
        opened.visititems(look)
    assert kinds <= set("iufS")


def test_xarray_opens_it_with_coordinates_and_units(file: Path) -> None:
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    pytest.importorskip("h5netcdf", reason="h5netcdf is not installed")
    with xarray.open_dataset(file, group="entry/data", engine="h5netcdf", decode_times=False) as dataset:
        assert dataset["force"].dims == ("time",)
        assert dataset["force"].attrs["units"] in {"N", b"N"}
        assert float(dataset["displacement"].sel(time=1.0)) == pytest.approx(0.05 * np.sin(1.0), rel=1e-6)


def test_pandas_gets_a_table_over_time(file: Path) -> None:
    table = RecordedPoint.open(file).to_pandas()
    assert isinstance(table, pd.DataFrame)
    assert table.index.name == "time_s"
    assert {"displacement", "force"} <= set(table.columns)


@pytest.mark.skipif(shutil.which("h5dump") is None, reason="h5dump is not installed")
def test_h5dump_reads_every_value(file: Path) -> None:
    shown = subprocess.run(["h5dump", str(file)], capture_output=True, text=True, check=True)
    assert shown.stderr == ""
    assert '"N"' in shown.stdout
    force = subprocess.run(["h5dump", "-d", "/entry/data/force", "-s", "0", "-c", "3", str(file)], capture_output=True,
                           text=True, check=True)
    assert "(0): 100" in force.stdout


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="Octave is not installed")
def test_octave_loads_it(file: Path) -> None:
    command = f"x = load('{file}'); printf('%g', numel(x.entry.data.force));"
    assert subprocess.run(["octave-cli", "--eval", command], capture_output=True, text=True).stdout == "1000"


def test_channels_of_another_length_than_the_time_are_refused_and_nothing_is_left(tmp_path: Path) -> None:
    point = a_point()
    wrong = PointFile(point.time_s[:-1], 250.0, point.channels)
    with pytest.raises(ValueError, match="time has 999 samples, but channel displacement has 1000"):
        write_file(tmp_path / "p.h5", wrong)
    assert list(tmp_path.iterdir()) == []


def test_a_point_of_four_samples_can_be_written_and_read(tmp_path: Path) -> None:
    write_file(tmp_path / "p.h5", a_point(4))
    assert RecordedPoint.open(tmp_path / "p.h5").samples == 4


def test_the_names_of_the_channels_are_those_of_the_ring() -> None:
    from drivers.ring import Channel
    from rig.recording.channel import NUMBER

    named = {channel.name.lower(): int(channel) for channel in Channel}
    assert named == NUMBER
