from __future__ import annotations

import resource
from pathlib import Path

import numpy as np
import pytest

from rig.recording.journal.journal_file import JournalProblem, JournalWriter, parse_journal, read_journal
from rig.recording.ring_records import RECORD_DTYPE

HEADER_BYTES = 16


def some_records(count: int, start: int = 0) -> np.ndarray:
    records = np.zeros(count, RECORD_DTYPE)
    records["host_ns"] = np.arange(start, start + count) * 4_000_000
    records["value"] = np.arange(start, start + count) + 0.25
    records["sequence"] = np.arange(start, start + count)
    records["channel"] = 1
    return records


def written(path: Path, blocks: int = 5, *, reserve_bytes: int = 0) -> bytes:
    journal = JournalWriter(path, '{"a": 1}', reserve_bytes=reserve_bytes)
    for block in range(blocks):
        journal.append(some_records(3, 3 * block))
    journal.event(77, "note", "a note")
    journal.close(stopped_by=None, lost_records=0)
    return path.read_bytes()


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    written(tmp_path / "p.journal")
    content = read_journal(tmp_path / "p.journal")
    assert np.array_equal(content.records, some_records(15))
    assert [(event.time_ns, event.code, event.text) for event in content.events] == [(77, "note", "a note")]
    assert content.end == {"stopped_by": None, "lost_records": 0}
    assert (content.missing_blocks, content.damaged_bytes, content.context_json) == (0, 0, '{"a": 1}')


def test_a_journal_cut_at_any_byte_never_gives_a_false_sample(tmp_path: Path) -> None:
    data = written(tmp_path / "p.journal")
    true = some_records(15)
    for length in range(len(data)):
        try:
            content = parse_journal(data[:length])
        except JournalProblem:
            assert length < HEADER_BYTES + len('{"a": 1}')
            continue
        assert np.array_equal(content.records, true[: len(content.records)])
        assert content.end is None


def test_a_flipped_bit_anywhere_costs_samples_but_never_makes_one(tmp_path: Path) -> None:
    data = written(tmp_path / "p.journal")
    true = {record.tobytes() for record in some_records(15)}
    refused = 0
    for position in range(len(data)):
        for bit in (0, 3, 7):
            damaged = bytearray(data)
            damaged[position] ^= 1 << bit
            try:
                content = parse_journal(bytes(damaged))
            except JournalProblem:
                refused += 1
                continue
            assert {record.tobytes() for record in content.records} <= true
            complete = len(content.records) == 15 and content.end is not None and len(content.events) == 1
            assert not complete
            assert content.missing_blocks > 0 or content.damaged_bytes > 0 or content.end is None
    assert refused == 3 * (HEADER_BYTES + len('{"a": 1}'))


def test_blocks_after_a_damaged_one_are_still_read_and_the_hole_is_counted(tmp_path: Path) -> None:
    data = bytearray(written(tmp_path / "p.journal"))
    second = data.find(b"MRBK", data.find(b"MRBK") + 1)
    data[second + 40] ^= 0xFF
    content = parse_journal(bytes(data))
    assert content.records["sequence"].tolist() == [0, 1, 2, *range(6, 15)]
    assert content.missing_blocks == 1


def test_reserved_room_is_given_back_and_is_no_damage_when_it_was_not(tmp_path: Path) -> None:
    path = tmp_path / "p.journal"
    assert len(written(path, reserve_bytes=1 << 16)) < 2000
    journal = JournalWriter(tmp_path / "cut.journal", "{}", reserve_bytes=1 << 16)
    journal.append(some_records(4))
    cut = (tmp_path / "cut.journal").read_bytes()
    journal.close(stopped_by=None, lost_records=0)
    assert len(cut) == 1 << 16
    content = parse_journal(cut)
    assert len(content.records) == 4
    assert content.damaged_bytes == 0


def test_an_existing_journal_is_never_written_over(tmp_path: Path) -> None:
    data = written(tmp_path / "p.journal")
    with pytest.raises(FileExistsError):
        JournalWriter(tmp_path / "p.journal", "{}")
    assert (tmp_path / "p.journal").read_bytes() == data


def test_a_full_disk_is_an_error_at_once_and_keeps_what_was_written(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    journal = JournalWriter(tmp_path / "p.journal", "{}")
    journal.append(some_records(100))
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, hard))
    try:
        with pytest.raises(OSError, match="File too large"):
            journal.append(some_records(1000))
        with pytest.raises(OSError, match="File too large"):
            JournalWriter(tmp_path / "q.journal", "{}", reserve_bytes=1 << 20)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not (tmp_path / "q.journal").exists()
    assert np.array_equal(read_journal(tmp_path / "p.journal").records, some_records(100))
    journal.close(stopped_by="disk-full", lost_records=0)


@pytest.mark.parametrize("data", [b"", b"MRJOURN1", b"\x89HDF\r\n\x1a\n" + bytes(40)])
def test_what_is_no_journal_is_refused(data: bytes) -> None:
    with pytest.raises(JournalProblem):
        parse_journal(data)
