"""A point too long to hold is converted part by part, and the file is the one that the short way makes."""

from __future__ import annotations

import shutil
import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest
from synthetic_rig import SyntheticRig

from rig.recording.conversion.conversion import finish_point
from rig.recording.journal import point_journal as channel_split
from rig.recording.journal.journal_file import JournalWriter
from rig.signals import chunked_column
from rig.signals.chunked_column import Column, first_after, mapped, thinned

RIG = SyntheticRig(rate_Hz=1000.0, cycles=10, lost=(3000, 3001, 3002))


def journal(path: Path) -> Path:
    records = RIG.records()
    writer = JournalWriter(path, RIG.context().to_json(), reserve_bytes=100_000)
    for start in range(0, len(records), 777):
        writer.append(records[start : start + 777])
    writer.close(stopped_by=None, lost_records=0)
    return path


def datasets(path: Path) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item[...]}) if isinstance(item, h5py.Dataset) else None)
        found["quality"] = np.array(sorted(f"{k}={v}" for k, v in file["entry/quality"].attrs.items()), str)
    return found


def test_the_file_of_a_long_point_equals_that_of_a_short_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("short", "long"):
        (tmp_path / name).mkdir()
    first = journal(tmp_path / "short" / "p001.journal")
    second = Path(shutil.copy(first, tmp_path / "long" / "p001.journal"))
    short = finish_point(first)
    monkeypatch.setattr(channel_split, "MOST_BYTES_IN_MEMORY", 20_000)
    monkeypatch.setattr(chunked_column, "PART_SAMPLES", 1_500)
    long = finish_point(second)
    assert short.error == long.error == ""
    assert long.verdict == short.verdict
    expected, found = datasets(Path(short.file)), datasets(Path(long.file))
    assert expected.keys() == found.keys()
    for name, values in expected.items():
        if values.dtype.kind == "f":
            assert np.allclose(values, found[name], rtol=1e-6, atol=1e-9, equal_nan=True), name
        else:
            assert np.array_equal(values, found[name]), name
    assert sorted(path.name for path in (tmp_path / "long").iterdir()) == ["p001.h5"]


@pytest.mark.nightly
def test_memory_does_not_grow_with_the_points_length(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(channel_split, "MOST_BYTES_IN_MEMORY", 100_000)
    monkeypatch.setattr(chunked_column, "PART_SAMPLES", 5_000)
    peaks = []
    for cycles in (20, 60):
        rig = SyntheticRig(rate_Hz=2000.0, cycles=cycles)
        path = tmp_path / f"p{cycles}.journal"
        writer = JournalWriter(path, rig.context().to_json())
        records = rig.records()
        for start in range(0, len(records), 1000):
            writer.append(records[start : start + 1000])
        writer.close(stopped_by=None, lost_records=0)
        size = records.nbytes
        del records
        tracemalloc.start()
        assert finish_point(path).error == ""
        peaks.append(tracemalloc.get_traced_memory()[1] / size)
        tracemalloc.stop()
    # Status channels, and an overview of 16 bytes a sample of the two sensors, are all that stays in memory.
    assert peaks[1] < 2.5


def test_a_column_is_read_like_an_array() -> None:
    column = Column(10, np.float64, lambda start, stop: np.arange(start, stop, dtype=float) ** 2)
    assert len(column) == 10
    assert column[3] == 9.0
    assert column[-1] == 81.0
    assert column[2:8:2].tolist() == [4.0, 16.0, 36.0]
    assert np.asarray(column).tolist() == [float(k**2) for k in range(10)]
    assert np.asarray(mapped(column, lambda values: values + 1.0, np.float64))[4] == 17.0
    assert [first_after(column, limit) for limit in (-1.0, 0.0, 10.0, 81.0)] == [0, 1, 4, 10]
    assert thinned(np.arange(100), 10).tolist() == list(range(0, 100, 10))
