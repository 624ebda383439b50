"""MATLAB files made to hang, crash or fill the memory: refused in words. Their bytes are written by hand."""

from __future__ import annotations

import resource
import struct
import time
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from rig.errors import FileProblem
from rig.recording.external_tests import ImportedTest, ImportSettings, read_tests

HEAD_5 = b"MATLAB 5.0 MAT-file, written by hand".ljust(124) + b"\x00\x01IM"
HEAD_73 = b"MATLAB 7.3 MAT-file, written by hand".ljust(124) + b"\x00\x02IM"
T = np.arange(500) * 0.004
X_M, F_N = 0.02 * np.sin(2.0 * np.pi * T), 800.0 * np.cos(2.0 * np.pi * T)
COLUMNS = {"time": "t_s", "displacement": "x_m", "force": "F_N"}


def read(path: Path) -> ImportedTest:
    (test,) = read_tests([path], ImportSettings(COLUMNS, 0.5))
    return test


def problems(path: Path) -> str:
    started = time.process_time()
    with pytest.raises(FileProblem) as caught:
        read(path)
    assert time.process_time() - started < 5.0
    return "\n".join(caught.value.problems)


def cells_in_cells(depth: int) -> bytes:
    """Arrays of one cell each: tag 14, flags (class 1), dimensions 1 x 1, an empty name; 1.0 in the innermost."""
    number = struct.pack("<IIIIIIIIiiIIIId", 14, 56, 6, 8, 6, 0, 5, 8, 1, 1, 1, 0, 9, 8, 1.0)
    sizes = [48 * k + 40 + len(number) for k in reversed(range(depth))]
    return b"".join(struct.pack("<IIIIIIIIiiII", 14, size, 6, 8, 1, 0, 5, 8, 1, 1, 1, 0) for size in sizes) + number


def version_73(path: Path, name: str) -> Path:
    """The HDF5 file at `path` as MATLAB writes it: 128 bytes of its own in a user block."""
    held = path.with_name(name)
    held.write_bytes(HEAD_73 + path.read_bytes()[128:])
    return held


@pytest.mark.parametrize("compressed", [False, True])
def test_cells_nested_deeper_than_the_readers_stack(tmp_path: Path, compressed: bool) -> None:
    """scipy reads them by recursion without an end: 5000 end the process."""
    nested = cells_in_cells(50_000)
    if compressed:
        packed = zlib.compress(nested)
        nested = struct.pack("<II", 15, len(packed)) + packed
    (tmp_path / "a.mat").write_bytes(HEAD_5 + nested)
    assert "contains more than 1000 cells, structs or objects" in problems(tmp_path / "a.mat")


def test_elements_that_say_they_are_empty_cost_no_time(tmp_path: Path) -> None:
    packed = zlib.compress(b"\0" * (32 << 20))
    (tmp_path / "a.mat").write_bytes(HEAD_5 + (struct.pack("<II", 15, len(packed)) + packed) * 20)
    assert "no array at byte 0" in problems(tmp_path / "a.mat")


def test_a_small_file_that_unpacks_to_gigabytes_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    """Eight variables of 256 MB of zeros each: 2 MB on the disk."""
    packer = zlib.compressobj()
    size = 256 << 20
    tag = struct.pack("<IIIIIIIIiiIIII", 14, 48 + size, 6, 8, 6, 0, 5, 8, 1, size // 8, 0x10001, ord("x"), 9, size)
    packed = packer.compress(tag) + b"".join(packer.compress(bytes(1 << 20)) for _ in range(256)) + packer.flush()
    (tmp_path / "a.mat").write_bytes(HEAD_5 + (struct.pack("<II", 15, len(packed)) + packed) * 8)
    before_kB = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert "unpack" in problems(tmp_path / "a.mat") or "declares" in problems(tmp_path / "a.mat")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kB < 100_000


def test_groups_that_hold_themselves_are_entered_once(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w", userblock_size=512) as file:
        group = file.create_group("s")
        for k in range(40):
            group[f"again{k}"] = group
        for name, values in (("t_s", T), ("x_m", X_M), ("F_N", F_N)):
            file[name] = values.reshape(1, -1)
    test = read(version_73(tmp_path / "a.h5", "a.mat"))
    assert test.force_N == pytest.approx(F_N)


def test_columns_that_lie_in_other_files_are_none(tmp_path: Path) -> None:
    (tmp_path / "other.bin").write_bytes(X_M.tobytes())
    with h5py.File(tmp_path / "a.h5", "w", userblock_size=512) as file:
        file["t_s"], file["F_N"] = T.reshape(1, -1), F_N.reshape(1, -1)
        file.create_dataset("x_m", (1, 500), "f8", external=[(str(tmp_path / "other.bin"), 0, 4000)])
    assert "no column 'x_m'; columns: F_N, t_s" in problems(version_73(tmp_path / "a.h5", "a.mat"))


def test_structs_are_read_and_version_4_is_named_as_what_it_is_not(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"t_s": T, "x_m": X_M, "F_N": F_N, "notes": np.array([["a", 1], ["b", 2]], object)})
    assert read(tmp_path / "a.mat").force_N == pytest.approx(F_N)
    savemat(tmp_path / "b.mat", {"t_s": T, "x_m": X_M, "F_N": F_N}, format="4")
    assert "is not a MATLAB file of version 5 or 7.3. Fix: save the file with -v7" in problems(tmp_path / "b.mat")


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize(("place", "value"), [(176, 158), (176, 14), (145, 0x08), (132, 0x10), (182, 0xFF)])
def test_numbers_of_a_type_that_does_not_exist(tmp_path: Path, compressed: bool, place: int, value: int) -> None:
    """scipy looks the type up beyond its table, or reads the next array as an imaginary part: the process ended."""
    savemat(tmp_path / "a.mat", {"t_s": T, "x_m": X_M, "F_N": F_N})
    data = bytearray((tmp_path / "a.mat").read_bytes())
    data[place] = value
    if compressed:
        packed = zlib.compress(data[128:])
        data[128:] = struct.pack("<II", 15, len(packed)) + packed
    (tmp_path / "a.mat").write_bytes(data)
    assert "cannot be read as MATLAB 5" in problems(tmp_path / "a.mat")
