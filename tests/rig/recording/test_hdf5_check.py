from __future__ import annotations

import random
import tracemalloc
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.errors import DataWarning, FileProblem
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

TEST = {"id": "p001", "waveform": "sine", "amplitude_m": 0.05, "frequency_Hz": 1.0, "current_A": 0.5}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "p001.h5"
    time_s = np.arange(500) / 250.0
    write_file(path, PointFile(time_s, 250.0, [AlignedChannel("force", np.sin(time_s), "N", "Force")], test=TEST))
    return path


def refused(file: Path) -> str:
    with pytest.raises(FileProblem) as caught:
        RecordedPoint.open(file)
    return str(caught.value)


def test_an_external_link_is_refused_without_opening_its_target(file: Path, tmp_path: Path) -> None:
    with h5py.File(file, "a") as opened:
        opened["entry/data/velocity"] = h5py.ExternalLink(str(tmp_path / "secret.h5"), "/x")
    assert "/entry/data/velocity: links of type ExternalLink" in refused(file)


def test_a_soft_link_is_refused(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        opened["entry/data/velocity"] = h5py.SoftLink("/entry/data/force")
    assert "velocity: links of type SoftLink" in refused(file)


def test_where_only_the_description_is_read_its_groups_must_be_the_files_own(file: Path, tmp_path: Path) -> None:
    assert RecordedPoint.open(file, whole=False).id == "p001"
    with h5py.File(file, "a") as opened:
        del opened["entry/quality"]
        opened["entry/quality"] = h5py.ExternalLink(str(tmp_path / "secret.h5"), "/x")
    with pytest.raises(FileProblem, match="/entry/quality: missing, or not a group within the file"):
        RecordedPoint.open(file, whole=False)


def test_external_storage_is_refused(file: Path, tmp_path: Path) -> None:
    (tmp_path / "passwords").write_bytes(bytes(4000))
    with h5py.File(file, "a") as opened:
        opened["entry/data"].create_dataset(
            "velocity", (500,), "f8", external=[(str(tmp_path / "passwords"), 0, 4000)])
    assert "external storage refused" in refused(file)


def test_a_virtual_dataset_is_refused(file: Path) -> None:
    layout = h5py.VirtualLayout((500,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "x", (500,))
    with h5py.File(file, "a") as opened:
        opened["entry/data"].create_virtual_dataset("velocity", layout)
    assert "virtual dataset refused" in refused(file)


def test_a_filter_we_do_not_use_is_refused(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        opened["entry/data"].create_dataset("velocity", data=np.zeros(500), compression="lzf")
    assert "filter 32000" in refused(file)


def test_a_decompression_bomb_is_refused(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        opened["entry/data"].create_dataset("velocity", (90_000_000,), "f8", chunks=(1_000_000,), compression="gzip")
    assert "decompression bomb" in refused(file)


def test_more_samples_than_any_point_has_are_refused(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        opened["entry/data"].create_dataset("velocity", (10**12,), "f8", chunks=(1000,))
    assert "declares 1000000000000 values" in refused(file)


def test_a_small_file_with_a_chunk_of_gigabytes_is_refused_before_anything_is_inflated(tmp_path: Path) -> None:
    path = tmp_path / "p001.h5"
    samples = 80_000_000
    write_file(path, PointFile(np.arange(500) / 250.0, 250.0, [], test=TEST))
    with h5py.File(path, "a") as opened:
        data = opened["entry/data"]
        data.create_dataset("velocity", (samples,), "f8", chunks=(samples,), compression="gzip", shuffle=True)
        deflated = zlib.compressobj(9)
        zeros = bytes(1 << 20)
        chunk = b"".join(deflated.compress(zeros) for _ in range(8 * samples >> 20)) + deflated.flush()
        data["velocity"].id.write_direct_chunk((0,), chunk)
    tracemalloc.start()
    message = refused(path)
    assert tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()
    assert f"/entry/data/velocity: chunks of {8 * samples} bytes; allowed: at most 8388608" in message


def test_many_small_bombs_are_refused_together(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        for number in range(900):
            opened["entry/raw"].create_dataset(f"c{number}", (130_000,), "f8", chunks=(130_000,), compression="gzip")
    assert "rejected as a decompression bomb" in refused(file)


def test_a_filter_applied_twice_is_refused(file: Path) -> None:
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_chunk((500,))
    properties.set_deflate(9)
    properties.set_deflate(9)
    with h5py.File(file, "a") as opened:
        space, kind = h5py.h5s.create_simple((500,)), h5py.h5t.py_create(np.dtype("f8"))
        h5py.h5d.create(opened["entry/data"].id, b"velocity", kind, space, dcpl=properties)
    assert "duplicate filter refused: [1, 1]" in refused(file)


def test_elements_larger_than_any_text_or_number_are_refused(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        opened["entry/data"].create_dataset("velocity", (3,), "S1000000")
        opened["entry/data"].create_dataset("other", (3,), np.longdouble)
    message = refused(file)
    assert "elements of 1000000 bytes; allowed: at most 65536" in message
    assert "elements of 16 bytes; allowed: at most 8" in message


def test_attributes_are_looked_at_before_they_are_read(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        test = opened["entry/test"].attrs
        test["big"] = np.zeros(1_000_000)
        test["square"] = np.zeros((3, 3))
        test["reference"] = opened["entry"].ref
        test["many"] = np.array(["a", "b"], h5py.string_dtype())
        test["text"] = "as h5py writes it"
        opened["entry/data/force"].attrs["region"] = opened["entry/data/force"].regionref[:2]
    message = refused(file)
    assert "/entry/test: attribute big: 8000000 bytes; at most 4194304" in message
    assert "/entry/test: attribute square: 2 dimensions" in message
    assert "/entry/test: attribute reference: type object is not allowed" in message
    assert "/entry/test: attribute many: type object is not allowed" in message
    assert "/entry/data/force: attribute region: type object is not allowed" in message
    assert "attribute text" not in message
    with pytest.raises(FileProblem, match="attribute big"):
        RecordedPoint.open(file, whole=False)


def test_more_attributes_and_links_than_the_layout_has_are_counted_and_not_read(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        for number in range(2_100):
            opened["entry/quality"].attrs[f"a{number}"] = number
            opened[f"entry/raw/link{number}"] = opened["entry/data"]
    message = refused(file)
    assert "/entry/quality: 2" in message
    assert "attributes; at most 2000" in message
    assert "/entry/raw: more than 2000 objects" in message


def test_a_group_that_holds_itself_ends_the_walk(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        opened["entry/raw/again"] = opened["entry"]
    assert "nested deeper than 6 groups" in refused(file)


def test_contiguous_data_larger_than_the_file_are_refused(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        opened["entry/data"].create_dataset("velocity", (1_000_000,), "f8")
    assert "declares 8000000 bytes in a file of" in refused(file)


def test_a_name_that_would_drive_a_terminal_is_shown_as_text(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        opened["entry/data/\x1b[2Jgone"] = h5py.SoftLink("/x")
    assert "\x1b" not in refused(file)


def test_references_and_nested_arrays_are_refused(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        opened["entry/data"].create_dataset("velocity", data=np.zeros((500, 2)))
        opened["entry/data"].create_dataset("other", (3,), h5py.ref_dtype)
    message = refused(file)
    assert "2 dimensions" in message
    assert "type object is not allowed" in message


def test_a_newer_format_is_refused(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        opened.attrs["format_version"] = 99
    assert "format_version: 99; this software reads versions up to 1" in refused(file)


def test_wrong_attributes_are_named_all_at_once(file: Path) -> None:
    with h5py.File(file, "a") as opened:
        test = opened["entry/test"]
        del test.attrs["waveform"]
        test.attrs["amplitude_m"] = np.nan
        opened["entry/quality"].attrs["verdict"] = "splendid"
    message = refused(file)
    assert "waveform is missing" in message
    assert "amplitude_m = nan; expected a finite number" in message
    assert "verdict = 'splendid'; expected one of valid, suspect, invalid" in message


@pytest.mark.parametrize("content", [b"", b"hello", b"\x89HDF\r\n\x1a\n" + bytes(600)])
def test_what_is_no_hdf5_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "p.h5").write_bytes(content)
    assert "cannot be read as HDF5" in refused(tmp_path / "p.h5")


def test_damaged_files_are_refused_or_read_as_they_were_but_never_crash(file: Path, tmp_path: Path) -> None:
    data, source = file.read_bytes(), random.Random(4)
    true = RecordedPoint.open(file)
    expected = true.force_N
    caught = 0
    for number in range(150):
        damaged = bytearray(data)
        for _ in range(source.randint(1, 4)):
            damaged[source.randrange(len(data))] ^= 1 << source.randrange(8)
        if number % 5 == 0:
            del damaged[source.randrange(len(data)):]
        path = tmp_path / f"damaged{number}.h5"
        path.write_bytes(damaged)
        try:
            point = RecordedPoint.open(path)
            force = point.force_N
        except FileProblem:
            caught += 1
            continue
        assert len(force) == len(expected)
        assert np.all(np.isnan(force)) or np.array_equal(force, expected)
    assert caught > 25


def test_a_run_with_a_damaged_file_names_it(file: Path, tmp_path: Path) -> None:
    points = tmp_path / "run" / "points"
    points.mkdir(parents=True)
    (points / "p001.h5").write_bytes(file.read_bytes())
    (points / "p002.h5").write_bytes(file.read_bytes()[:1000])
    with pytest.warns(DataWarning, match=r"points/p002\.h5: cannot be read as HDF5"):
        assert len(Run.open(tmp_path / "run").points) == 1
    (points / "p001.h5").write_bytes(file.read_bytes()[:1000])
    with pytest.raises(FileProblem, match=r"points/p001\.h5: cannot be read as HDF5"):
        Run.open(tmp_path / "run")
