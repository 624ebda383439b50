from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from drivers.ring import RingWriter
from rig.recording.journal.ring_reader import RecordBlock, RingProblem, RingReader
from rig.recording.ring_records import RECORD_DTYPE


def record(number: int) -> tuple[int, int, float, int, int, int]:
    return (number * 1000, number, number + 0.5, number, 1, 0)


def test_the_reader_gets_every_record_once_across_the_wrap(tmp_path: Path) -> None:
    with RingWriter(tmp_path / "ring", 16) as writer, RingReader(tmp_path / "ring") as reader:
        seen = []
        for start in range(0, 100, 7):
            writer.append([record(n) for n in range(start, start + 7)])
            seen += reader.read().tolist()
        assert seen == [record(n) for n in range(105)]
        assert reader.lost == 0


def test_a_lapped_reader_counts_what_it_lost_and_goes_on(tmp_path: Path) -> None:
    with RingWriter(tmp_path / "ring", 16) as writer, RingReader(tmp_path / "ring") as reader:
        for start in range(0, 40, 10):
            writer.append([record(n) for n in range(start, start + 10)])
        records = reader.read()
        assert reader.lost + len(records) == 40
        assert records["sequence"].tolist() == list(range(40 - len(records), 40))
        assert reader.lost >= 24


def test_a_reader_of_earlier_records_gets_the_newest_half_of_a_full_ring_and_loses_none(tmp_path: Path) -> None:
    with RingWriter(tmp_path / "ring", 16) as writer:
        writer.append([record(n) for n in range(5)])
        with RingReader(tmp_path / "ring", earlier=True) as reader:
            assert reader.read().tolist() == [record(n) for n in range(5)]
        for start in range(5, 45, 10):
            writer.append([record(n) for n in range(start, start + 10)])
        with RingReader(tmp_path / "ring", earlier=True) as reader:
            writer.append([record(n) for n in range(45, 50)])
            assert reader.read().tolist() == [record(n) for n in range(37, 50)]
            assert reader.lost == 0


def test_only_the_recorder_moves_the_cursor_the_station_watches(tmp_path: Path) -> None:
    with (
        RingWriter(tmp_path / "ring", 16) as writer,
        RingReader(tmp_path / "ring") as viewer,
        RingReader(tmp_path / "ring", recorder=True) as recorder,
    ):
        writer.append([record(n) for n in range(5)])
        assert len(viewer.read()) == 5
        assert writer.recorder_cursor == 0
        assert len(recorder.read(3)) == 3
        assert writer.recorder_cursor == 3
        assert recorder.unread == 2
        assert recorder.writer_pid == os.getpid()


def test_a_file_that_is_no_ring_is_refused(tmp_path: Path) -> None:
    (tmp_path / "short").write_bytes(b"MRRING01")
    (tmp_path / "other").write_bytes(bytes(8192))
    (tmp_path / "empty").write_bytes(b"")
    for name in ("short", "other", "empty", "missing"):
        with pytest.raises(RingProblem, match=name):
            RingReader(tmp_path / name)


def test_a_ring_cut_short_is_refused(tmp_path: Path) -> None:
    RingWriter(tmp_path / "ring", 1024).close()
    data = (tmp_path / "ring").read_bytes()
    (tmp_path / "ring").write_bytes(data[:5000])
    with pytest.raises(RingProblem, match="5000 bytes"):
        RingReader(tmp_path / "ring")


@pytest.mark.parametrize("count", [0, 1, 2, 500])
def test_a_block_divides_records_by_channel_and_keeps_their_order(count: int) -> None:
    random = np.random.default_rng(count)
    records = np.zeros(count, RECORD_DTYPE)
    records["channel"], records["sequence"] = random.integers(0, 50, count), np.arange(count)
    block = RecordBlock(records)
    assert len(block) == count
    for channel in range(50):
        chosen = records[records["channel"] == channel]
        assert np.array_equal(block.of(channel), chosen)
        assert (channel in block) == (len(chosen) > 0)
        assert np.array_equal(block.newest[block.newest["channel"] == channel], chosen[-1:])
    assert np.all(np.diff(block.newest["channel"].astype(int)) > 0)
