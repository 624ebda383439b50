"""The campaign's journal on a full disk: the last words still come, no later line is glued to a torn one."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from rig.recording.journal.campaign_log import RESERVE_BYTES, CampaignLog, read_lines, read_log


class FullDisk:
    """A disk that takes so many bytes more, and what `journal.reserve` occupied once that is gone."""

    def __init__(self, folder: Path, room: int) -> None:
        self.room = room
        self.reserve = folder / "journal.reserve"
        self.really = os.write

    def write(self, handle: int, data: bytes) -> int:
        if self.room == 0 and not self.reserve.exists():
            self.room, self.reserve = RESERVE_BYTES, self.reserve.parent
        if self.room == 0:
            raise OSError(errno.ENOSPC, "no space left on device")
        taken = self.really(handle, data[: self.room])
        self.room -= taken
        return taken


def test_on_a_full_disk_the_last_words_are_written_into_the_room_kept_for_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = CampaignLog(tmp_path)
    assert (tmp_path / "journal.reserve").stat().st_size == RESERVE_BYTES
    monkeypatch.setattr(os, "write", FullDisk(tmp_path, 150).write)
    for number in range(20):
        log.write("station", what="trip", number=number)
    log.close()
    assert [line["number"] for line in read_log(tmp_path)] == list(range(20))
    assert not (tmp_path / "journal.reserve").exists()


def test_after_a_line_that_was_cut_off_the_next_one_stands_by_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = CampaignLog(tmp_path)
    (tmp_path / "journal.reserve").unlink()
    disk = FullDisk(tmp_path, 30)
    disk.reserve = tmp_path
    with monkeypatch.context() as patched:
        patched.setattr(os, "write", disk.write)
        with pytest.raises(OSError, match="no space"):
            log.write("first")
    log.write("second")
    log.close()
    assert [line["event"] for line in read_lines(tmp_path)] == ["second"]


def test_a_session_that_a_full_disk_refused_leaves_the_journal_as_it_found_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = CampaignLog(tmp_path)
    first.write("begun")
    first.close()
    kept = first.path.read_bytes()
    log = CampaignLog(tmp_path)
    (tmp_path / "journal.reserve").unlink()
    disk = FullDisk(tmp_path, 30)
    disk.reserve = tmp_path
    with monkeypatch.context() as patched:
        patched.setattr(os, "write", disk.write)
        with pytest.raises(OSError, match="no space"):
            log.write("resumed")
    log.close()
    assert first.path.read_bytes() == kept


def test_a_journal_that_ends_well_leaves_nothing_behind(tmp_path: Path) -> None:
    log = CampaignLog(tmp_path)
    log.write("begun")
    log.close()
    assert [path.name for path in tmp_path.iterdir()] == ["journal.jsonl"]


def test_half_a_line_that_could_not_be_taken_back_stays_apart_from_the_next_though_one_more_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unable(_handle: int, _length: int) -> None:
        raise OSError(errno.EIO, "input/output error")

    log = CampaignLog(tmp_path)
    (tmp_path / "journal.reserve").unlink()
    disk = FullDisk(tmp_path, 30)
    disk.reserve = tmp_path
    with monkeypatch.context() as patched:
        patched.setattr(os, "write", disk.write)
        patched.setattr(os, "ftruncate", unable)
        with pytest.raises(OSError, match="no space"):
            log.write("first")
    disk.room = 10
    with monkeypatch.context() as patched:
        patched.setattr(os, "write", disk.write)
        with pytest.raises(OSError, match="no space"):
            log.write("second")
    log.write("third")
    log.close()
    assert [line["event"] for line in read_log(tmp_path)] == ["third"]
