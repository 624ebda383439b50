"""A file that a full disk delays: nothing is lost, nothing torn."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from simulators.truth import Spool, when_there_is_room


class FullDisk:
    """A disk that takes so many bytes more."""

    def __init__(self, room: int) -> None:
        self.room = room
        self.really = os.write

    def write(self, handle: int, data: bytes) -> int:
        if self.room == 0:
            raise OSError(errno.ENOSPC, "no space left on device")
        taken = self.really(handle, bytes(data[: self.room]))
        self.room -= taken
        return taken


def test_what_a_full_disk_refuses_is_written_when_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = FullDisk(25)
    monkeypatch.setattr(os, "write", disk.write)
    spool = Spool(tmp_path / "rows")
    rows = [bytes([number]) * 10 for number in range(6)]
    for row in rows:
        spool.write(row)
    assert (tmp_path / "rows").read_bytes() == b"".join(rows)[:25]
    assert not spool.push()
    disk.room = 1000
    assert spool.push()
    spool.close()
    assert (tmp_path / "rows").read_bytes() == b"".join(rows)


def test_another_refusal_of_the_disk_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spool = Spool(tmp_path / "rows")

    def broken(handle: int, data: bytes) -> int:
        raise OSError(errno.EIO, "input/output error")

    monkeypatch.setattr(os, "write", broken)
    with pytest.raises(OSError, match="input/output"):
        spool.write(b"row")


def test_room_is_waited_for_and_not_for_ever(tmp_path: Path) -> None:
    tries = []

    def do() -> bool:
        tries.append(1)
        if len(tries) == 1:
            raise OSError(errno.ENOSPC, "no space left on device")
        return len(tries) == 3

    when_there_is_room(tmp_path, lambda: 0, do, longest_s=30.0)
    assert len(tries) == 3
    with pytest.raises(OSError, match="disk") as caught:
        when_there_is_room(tmp_path, lambda: 1 << 60, do, longest_s=0.0)
    assert caught.value.errno == errno.ENOSPC
