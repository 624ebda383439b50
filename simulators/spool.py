"""An append-only file that a full disk delays and does not lose: what it refuses waits in memory for room."""

from __future__ import annotations

import errno
import fcntl
import os
import time
from collections.abc import Callable
from pathlib import Path

FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
MOST_WAITING_BYTES = 1 << 29
LOOK_AGAIN_S = 0.25


class Spool:
    """A new file, locked while it is open.

    Raises:
        OSError: it cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
        fcntl.flock(self._handle, fcntl.LOCK_EX)
        self._waiting = bytearray()

    def write(self, data: bytes) -> None:
        """Append; on a full disk later.

        Raises:
            OSError: the disk refuses for another reason, or has been full for too long.
        """
        self._waiting += data
        if not self.push() and len(self._waiting) > MOST_WAITING_BYTES:
            raise OSError(errno.ENOSPC, "no room for what waits to be written", str(self.path))

    def push(self) -> bool:
        """Write what waits; True when nothing waits any more.

        Raises:
            OSError: the disk refuses for another reason than being full.
        """
        while self._waiting:
            try:
                del self._waiting[: os.write(self._handle, self._waiting)]
            except OSError as error:
                if error.errno not in FULL:
                    raise
                return False
        return True

    def close(self) -> None:
        """Give the lock back."""
        os.close(self._handle)


def when_there_is_room(folder: Path, needed: Callable[[], int], do: Callable[[], bool], longest_s: float) -> None:
    """Try again and again to write, as long as the disk is full.

    Args:
        folder: on the disk in question.
        needed: bytes that must be free before it is worth a try.
        do: tries; False when the disk was full.
        longest_s: how long to go on (wall s).

    Raises:
        OSError: the disk was full all the time, or refuses for another reason.
    """
    until_s = time.monotonic() + longest_s
    while True:
        try:
            room = os.statvfs(folder)
            if room.f_bavail * room.f_frsize >= needed() and do():
                return
        except OSError as error:
            if error.errno not in FULL:
                raise
        if time.monotonic() > until_s:
            raise OSError(errno.ENOSPC, f"no room on the disk for {longest_s:g} s", str(folder))
        # Room on a disk cannot be waited for otherwise.
        time.sleep(LOOK_AGAIN_S)
