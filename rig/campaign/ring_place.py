"""Where the station's ring lies: in memory where there is such a place; its pages must never wait for a disk."""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers.ring import MAGIC

SHARED_MEMORY = Path("/dev/shm")
PREFIX = "mr-damper-rig-"


@contextmanager
def ring_path_for(campaign: str, place: Path | None = None) -> Iterator[Path]:
    """A path for the ring of the campaign of that name; the file is removed when the block ends.

    The station removes it too at its own end, in case the application was killed. Rings of stations that were killed
    themselves are removed here.

    Args:
        campaign: the campaign's id.
        place: the folder to use; by default shared memory, else the folder for temporary files.
    """
    folder = place or (SHARED_MEMORY if SHARED_MEMORY.is_dir() else Path(tempfile.gettempdir()))
    for left in [*folder.glob(f"{PREFIX}*.ring"), *folder.glob(f"{PREFIX}*.ring.new")]:
        # Another campaign may end at the same moment and remove its own.
        with contextlib.suppress(FileNotFoundError):
            if left.lstat().st_uid == os.getuid() and not _written(left):
                left.unlink()
    path = folder / f"{PREFIX}{campaign}.ring"
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


def _written(ring: Path) -> bool:
    """Whether the station that made the ring still lives: it holds the file's lock. True where that cannot be told.

    Raises:
        FileNotFoundError: the ring is gone.
    """
    try:
        handle = os.open(ring, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK)
    except FileNotFoundError:
        raise
    except OSError:
        return True
    try:
        if os.pread(handle, len(MAGIC), 0) != MAGIC:
            return True  # begun at this moment, or not a ring
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(handle)
    return False
