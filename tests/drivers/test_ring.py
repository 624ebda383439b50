"""The ring: layout, order, wrap-around, lapped readers, threads."""

import struct
import threading
from pathlib import Path

import pytest

from drivers import ring
from drivers.ring import Channel, Record, RingWriter, edge_channel
from rig.recording.journal.ring_reader import RingReader


def record(number: int) -> Record:
    return (1_000_000 + number, 10 * number, number / 4, number, int(Channel.FORCE), 0)


def taken(reader: RingReader) -> list[Record]:
    """What the reader has not read yet, as plain records."""
    return [tuple(row) for row in reader.read().tolist()]


def test_the_file_has_the_documented_layout(tmp_path: Path) -> None:
    path = tmp_path / "ring"
    with RingWriter(path, 8) as writer:
        writer.append([(1, -1, 0.5, (1 << 32) - 1, 2, 4)])
        writer.beat(-7)
        raw = path.read_bytes()
    assert len(raw) == 4096 + 8 * 32
    assert raw[:16] == b"MRRING01" + bytes([32, 0, 0, 0, 8, 0, 0, 0])
    assert struct.unpack_from("<QQqI", raw, 16)[:3] == (1, 0, -7)
    # 0.5 is 0x3FE0000000000000
    record_bytes = "0100000000000000 FFFFFFFFFFFFFFFF 000000000000E03F FFFFFFFF 0200 0400"
    assert raw[4096 : 4096 + 32] == bytes.fromhex(record_bytes)


def test_records_arrive_in_order_across_many_turns(tmp_path: Path) -> None:
    with RingWriter(tmp_path / "ring", 100) as writer, RingReader(tmp_path / "ring") as reader:
        got: list[Record] = []
        for start in range(0, 1000, 37):
            writer.append([record(n) for n in range(start, start + 37)])
            got += taken(reader)
        assert got == [record(n) for n in range(len(got))]
        assert len(got) == writer.write_index == 1036
        assert reader.lost == 0


def test_a_lapped_reader_counts_what_it_lost_and_goes_on_with_the_oldest(tmp_path: Path) -> None:
    with RingWriter(tmp_path / "ring", 10) as writer, RingReader(tmp_path / "ring") as reader:
        writer.append([record(n) for n in range(25)])
        assert taken(reader) == [record(n) for n in range(15, 25)]
        assert reader.lost == 15


def test_records_being_overwritten_are_not_returned(tmp_path: Path) -> None:
    with RingWriter(tmp_path / "ring", 10) as writer, RingReader(tmp_path / "ring") as reader:
        writer.append([record(n) for n in range(10)])
        # A writer that has reserved three more records and is writing them right now.
        with (tmp_path / "ring").open("r+b") as file:
            file.seek(ring.OFFSET_RESERVED_INDEX)
            file.write((13).to_bytes(8, "little"))
        assert taken(reader) == [record(n) for n in range(3, 10)]
        assert reader.lost == 3


def test_a_batch_larger_than_the_ring_keeps_its_last_records(tmp_path: Path) -> None:
    with RingWriter(tmp_path / "ring", 7) as writer, RingReader(tmp_path / "ring") as reader:
        writer.append([record(n) for n in range(300)])
        assert taken(reader) == [record(n) for n in range(293, 300)]
        assert reader.lost == 293


def test_an_empty_batch_changes_nothing(tmp_path: Path) -> None:
    with RingWriter(tmp_path / "ring", 7) as writer:
        writer.append([])
        assert writer.write_index == 0


def test_the_writer_counts_what_the_recorder_has_not_taken(tmp_path: Path) -> None:
    with RingWriter(tmp_path / "ring", 10) as writer, RingReader(tmp_path / "ring", recorder=True) as recorder:
        writer.append([record(n) for n in range(4)])
        recorder.read()
        assert writer.recorder_cursor == 4
        writer.append([record(n) for n in range(10)])
        assert writer.overruns == 0
        writer.append([record(n) for n in range(3)])
        assert writer.overruns == 3


def test_a_record_that_does_not_fit_is_refused_and_the_ring_stays_whole(tmp_path: Path) -> None:
    with RingWriter(tmp_path / "ring", 10) as writer, RingReader(tmp_path / "ring") as reader:
        with pytest.raises(struct.error):
            writer.append([(0, 0, 0.0, -1, 1, 0)])
        writer.append([record(5)])
        assert taken(reader) == [record(5)]


def test_batches_of_many_threads_stay_whole(tmp_path: Path) -> None:
    with RingWriter(tmp_path / "ring", 10_000) as writer, RingReader(tmp_path / "ring") as reader:

        def write(channel: int) -> None:
            for start in range(0, 1000, 5):
                writer.append([(0, 0, 0.0, n, channel, 0) for n in range(start, start + 5)])

        threads = [threading.Thread(target=write, args=(channel,)) for channel in range(1, 5)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        got = taken(reader)
    assert len(got) == 4000
    for channel in range(1, 5):
        assert [r[3] for r in got if r[4] == channel] == list(range(1000))
    assert all(len({r[4] for r in got[at : at + 5]}) == 1 for at in range(0, 4000, 5))


def test_a_new_ring_replaces_an_old_file_and_leaves_its_readers_theirs(tmp_path: Path) -> None:
    path = tmp_path / "ring"
    with RingWriter(path, 10) as old, RingReader(path) as reader:
        old.append([record(1)])
        with RingWriter(path, 20) as new:
            assert (new.write_index, new.capacity) == (0, 20)
            assert taken(reader) == [record(1)]


@pytest.mark.parametrize("capacity", [0, -1, 1 << 32])
def test_an_impossible_capacity_is_refused(tmp_path: Path, capacity: int) -> None:
    with pytest.raises(ValueError, match="capacity"):
        RingWriter(tmp_path / "ring", capacity)


def test_edges_have_channels_of_their_own() -> None:
    assert edge_channel(Channel.FORCE) is Channel.FORCE_EDGE
    assert edge_channel(Channel.DISPLACEMENT) is Channel.DISPLACEMENT_EDGE
    assert edge_channel(Channel.AUXILIARY_7) is Channel.AUXILIARY_7_EDGE
    with pytest.raises(ValueError, match="not a sensor channel"):
        edge_channel(Channel.COIL_CURRENT)
