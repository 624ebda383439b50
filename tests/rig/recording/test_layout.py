from __future__ import annotations

import dataclasses
import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from synthetic_rig import SyntheticRig

from rig.recording.conversion.conversion import build
from rig.recording.hdf5 import hdf5_image
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.journal.journal_file import JournalContent
from rig.recording.layout import AlignedChannel, Event, PointFile, RawChannel
from rig.recording.recorded_point import RecordedPoint
from rig.recording.ring_records import RECORD_DTYPE
from rig.signals.derivatives import METHOD


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
    point, expected = RecordedPoint.open(file), a_point()
    assert np.array_equal(point.time_s, expected.time_s)
    assert np.array_equal(point.force_N, expected.channels[1].values.astype(np.float32), equal_nan=True)
    assert (point.verdict, point.reasons, point.lost_samples) == ("suspect", ("one: first", "two: second"), 2)
    assert (point.amplitude_m, point.frequency_Hz, point.current_A, point.mid_stroke_m) == (0.05, 1.0, 0.5, None)
    assert point.force_samples.time_s[0] == 0.001


def test_events_keep_time_slug_and_text(file: Path) -> None:
    from rig.recording.hdf5.reading import read_events

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


def everything(file: h5py.File) -> dict[str, h5py.Group | h5py.Dataset]:
    found: dict[str, h5py.Group | h5py.Dataset] = {"/": file["/"]}
    file.visititems(lambda name, item: found.update({name: item}))
    return found


def test_every_group_says_which_nexus_class_it_is(file: Path) -> None:
    with h5py.File(file) as opened:
        groups = {name: item for name, item in everything(opened).items() if isinstance(item, h5py.Group)}
        assert {item.attrs.get("NX_class", b"").decode() for item in groups.values()} == {
            "NXroot", "NXentry", "NXdata", "NXcollection",
        }
        assert opened.attrs["default"] == b"entry"
        assert opened["entry"].attrs["default"] == b"data"
        data = opened["entry/data"]
        assert data.attrs["signal"].decode() in data
        assert data.attrs["axes"].decode() in data
        assert data.attrs["time_indices"] == 0


def nexus_errors(path: Path, home: Path) -> list[str]:
    """What the NeXus validator punx calls an error: the place, and what is wrong with it."""
    tool = Path(sys.executable).with_name("punx")
    if not tool.exists():
        pytest.skip("the NeXus validator punx is not installed")
    environment = {**os.environ, "HOME": str(home), "XDG_CONFIG_HOME": str(home), "QT_QPA_PLATFORM": "offscreen"}
    ran = subprocess.run([tool, "validate", path], env=environment, capture_output=True, text=True, timeout=300)
    assert "NeXus definitions version" in ran.stdout, ran.stderr
    return [" ".join(line.split()) for line in ran.stdout.split("\n") if " ERROR " in line and line.startswith("/")]


def test_a_nexus_validator_finds_no_error(file: Path, tmp_path: Path) -> None:
    assert nexus_errors(file, tmp_path) == []
    with h5py.File(file, "r+") as opened:
        opened["entry/data"].attrs["signal"] = b"absent"
    assert any("not found: /entry/data/absent" in line for line in nexus_errors(file, tmp_path))


def overhead_bytes(path: Path) -> int:
    """A file's size without the values it holds and without what its attributes say."""
    with h5py.File(path) as opened:
        unique = {h5py.h5o.get_info(item.id).addr: item for item in everything(opened).values()}.values()
        stored = sum(item.id.get_storage_size() for item in unique if isinstance(item, h5py.Dataset))
        message = sum(len(name) + h5py.h5a.open(item.id, name.encode()).get_storage_size()
                   for item in unique for name in item.attrs)
    return path.stat().st_size - stored - message


def test_a_short_point_costs_little_beyond_its_values(tmp_path: Path) -> None:
    """Thirty channels as a real point has; twelve of them of one poll, three of one frame."""
    samples, polls = 3000, 1200
    plain = a_point(samples)
    raw = [RawChannel(name, plain.raw[0].records, "N", name, plain.time_s) for name in ("force", "displacement")]
    rng = np.random.default_rng(1)
    for group, channels in enumerate((12, 3, 4, 1, 1, 1)):
        stamps = np.zeros(polls, RECORD_DTYPE)
        stamps["host_ns"] = np.cumsum(rng.integers(9_900_000, 10_100_000, polls))
        stamps["device_us"] = np.arange(polls) * 10_000 + group
        for number in range(channels):
            records = stamps.copy()
            records["value"] = rng.standard_normal(polls).astype(np.float32)
            raw.append(RawChannel(f"c{group}_{number}", records, "1", "status", stamps["device_us"] * 1e-6,
                                  {"clock_method": "controller", "clock_std_s": 1e-5, "lost_samples": 0}))
    quality = {f"some_quantity_of_the_point_{number}": 0.1 * number for number in range(60)}
    path = tmp_path / "p.h5"
    write_file(path, dataclasses.replace(plain, raw=raw, quality=quality))
    assert overhead_bytes(path) <= 50_000
    point = RecordedPoint.open(path)
    for channel in raw:
        kept = point.raw(channel.name)
        assert kept is not None
        assert np.array_equal(kept["value"], channel.records["value"], equal_nan=True)
        assert all(np.array_equal(kept[name], channel.records[name]) for name in ("host_ns", "device_us", "sequence"))


def test_stamps_that_channels_share_are_stored_once_and_others_are_not(file: Path, tmp_path: Path) -> None:
    records = a_point().raw[0].records
    later = records.copy()
    later["host_ns"][7] += 1
    raw = [RawChannel(name, each, "1", name) for name, each in (("a", records), ("b", records), ("c", later))]
    write_file(tmp_path / "p.h5", dataclasses.replace(a_point(), raw=raw))
    with h5py.File(tmp_path / "p.h5") as opened:
        a, b, c = (opened[f"entry/raw/{name}"] for name in "abc")
        assert a["host_ns"] == b["host_ns"]
        assert a["host_ns"] != c["host_ns"]
        assert c["host_ns"][7] == later["host_ns"][7]
        assert a["value"] != b["value"]


@pytest.mark.parametrize("samples", [1, 31, 33, 16384, 16385, 100_000])
def test_files_of_any_length_are_read_back(tmp_path: Path, samples: int) -> None:
    write_file(tmp_path / "p.h5", a_point(max(samples, 4)))
    point = RecordedPoint.open(tmp_path / "p.h5")
    assert np.array_equal(point.force_N, a_point(max(samples, 4)).channels[1].values.astype(np.float32), equal_nan=True)


def test_the_index_of_a_long_file_grows_without_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hdf5_image, "CHUNK_SAMPLES", 4)
    point = dataclasses.replace(a_point(20_000), raw=())
    write_file(tmp_path / "p.h5", point)
    read = RecordedPoint.open(tmp_path / "p.h5")
    assert np.array_equal(read.force_N, point.channels[1].values.astype(np.float32), equal_nan=True)


def test_attributes_that_hdf5_cannot_hold_are_cut_or_kept_as_text_and_never_cost_the_file(tmp_path: Path) -> None:
    cycles = tuple(f"{number:.6g}" for number in range(10_000))
    provenance = {"operator": "é" * 100_000, "half": "a\ud800b", "zero": "a\0b", "large": 10**30, "cycles": cycles}
    write_file(tmp_path / "p.h5", dataclasses.replace(a_point(), provenance=provenance))
    kept = RecordedPoint.open(tmp_path / "p.h5").provenance
    assert kept["operator"].endswith("[cut: 200000 bytes]")
    assert kept["operator"].startswith("é" * 15_000)
    assert (kept["half"], kept["zero"], kept["large"]) == ("a?b", "a?b", str(10**30))
    assert kept["cycles"] == cycles


def test_a_file_of_the_first_version_still_opens() -> None:
    point = RecordedPoint.open(Path(__file__).with_name("first_version.h5"))
    assert (point.id, point.verdict, point.samples) == ("p001", "valid", 64)
    assert point.force_samples.flags.tolist() == [0] * 64
    assert point.force_N[5] == pytest.approx(100.0 * np.cos(5 / 250.0), rel=1e-6)


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
def test_octave_loads_all_of_it_numbers_and_texts(file: Path) -> None:
    command = f"""x = load('{file}'); e = x.entry;
        printf('%d|%.6f|%d|%s|%s|', numel(e.data.force), e.data.time(1000), e.raw.pulse.host_ns(1),
               strtrim(e.events.code(2,:)), strtrim(e.events.text(1,:)));
        printf('%d', numel(e.raw.force.value));"""
    command = command.replace("e.raw.pulse.host_ns(1)", "numel(e.raw.pulse.host_ns)")
    done = subprocess.run(["octave-cli", "--eval", command], capture_output=True, text=True, check=False)
    assert done.stdout == "1000|3.996000|0|stop|über alles|1000", done.stderr


def test_channels_of_another_length_than_the_time_are_refused_and_nothing_is_left(tmp_path: Path) -> None:
    point = a_point()
    wrong = PointFile(point.time_s[:-1], 250.0, point.channels)
    with pytest.raises(ValueError, match="time has 999 samples, but channel displacement has 1000"):
        write_file(tmp_path / "p.h5", wrong)
    assert list(tmp_path.iterdir()) == []


def test_a_point_of_four_samples_can_be_written_and_read(tmp_path: Path) -> None:
    write_file(tmp_path / "p.h5", a_point(4))
    assert RecordedPoint.open(tmp_path / "p.h5").samples == 4


@pytest.mark.parametrize(
    ("manual", "unmeasured", "states"),
    [(True, False, "constant: set manually"), (False, True, "set-point"), (False, False, "linear interpolation")],
)
def test_the_recording_states_how_its_current_came_about(manual: bool, unmeasured: bool, states: str) -> None:
    rig = SyntheticRig(cycles=3)
    content = JournalContent("", rig.records(), end={"stopped_by": None, "lost_records": 0})
    file, _ = build(content, rig.context(current_by_hand=manual, current_unmeasured=unmeasured))
    methods = {channel.name: str(channel.attributes["method"]) for channel in file.channels}
    assert states in methods["current"]
    assert ("not measured" in methods["current"]) is (manual or unmeasured)
    assert methods["velocity"] == METHOD
