"""Where the station's ring lies: in memory where there is such a place; its pages must never wait for a disk."""

from __future__ import annotations

import contextlib
import os
import struct
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers.ring import OFFSET_PID

SHARED_MEMORY = Path("/dev/shm")
PREFIX = "mr-damper-rig-"


@contextmanager
def ring_path_for(campaign: str, place: Path | None = None) -> Iterator[Path]:
    """A path for the ring of the campaign of that name; the file is removed when the block ends.

    Rings of stations that were killed are removed first.

    Args:
        campaign: the campaign's id.
        place: the folder to use; by default shared memory, else the folder for temporary files.
    """
    folder = place or (SHARED_MEMORY if SHARED_MEMORY.is_dir() else Path(tempfile.gettempdir()))
    for left in folder.glob(f"{PREFIX}*.ring"):
        # Another campaign may end at the same moment and remove its own.
        with contextlib.suppress(FileNotFoundError):
            if left.stat().st_uid == os.getuid() and not _written(left):
                left.unlink()
    path = folder / f"{PREFIX}{campaign}.ring"
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


def _written(ring: Path) -> bool:
    """Whether the station that made the ring still lives; True as well while that cannot be told."""
    with ring.open("rb") as file:
        head = file.read(OFFSET_PID + 4)
    if len(head) < OFFSET_PID + 4:
        return True
    (pid,) = struct.unpack_from("<I", head, OFFSET_PID)
    if pid == 0:
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
