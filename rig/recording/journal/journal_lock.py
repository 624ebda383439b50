"""Locks: one on a campaign's directory, one on each journal; both end with their process.

The application locks its campaign's directory, the recorder the journal it writes, and a converter the journal it
reads. So no process recovers a point that is still being recorded, and two that finish one journal take turns.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers.posix import O_CLOEXEC, fcntl
from rig.errors import FileProblem, Refused


@contextmanager
def campaign_held(folder: Path) -> Iterator[None]:
    """Hold a campaign's directory while the block runs.

    Raises:
        FileProblem: there is no such directory, or its file system knows no locks.
        Refused: another process holds it (slug `two-instances`): the campaign still runs or is being recovered.
    """
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | O_CLOEXEC)
    except OSError as error:
        raise FileProblem(str(folder), [f"this is not a campaign folder: {error.strerror}"]) from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise Refused("two-instances", f"{folder}: the campaign is still running, or another process is "
            "recovering it") from error
    except OSError as error:
        os.close(handle)
        raise FileProblem(str(folder), [f"cannot be locked: {error.strerror}. Fix: use a file system that "
            "supports locks"]) from error
    try:
        yield
    finally:
        os.close(handle)


@contextmanager
def folder_claimed(folder: Path) -> Iterator[None]:
    """Hold a folder while the block runs; waits until no other process holds it.

    Raises:
        OSError: it cannot be opened, or its file system knows no locks.
    """
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | O_CLOEXEC)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


@contextmanager
def journal_claimed(journal: Path) -> Iterator[int | None]:
    """Hold a journal that no other process writes or finishes; gives a descriptor to read it by.

    None when it was gone once it was free: another process has finished it meanwhile.

    Raises:
        OSError: it cannot be opened.
    """
    try:
        handle = os.open(journal, os.O_RDONLY | O_CLOEXEC)
    except FileNotFoundError:
        yield None
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        there = False
        with contextlib.suppress(FileNotFoundError):
            there = os.stat(journal).st_ino == os.fstat(handle).st_ino
        yield handle if there else None
    finally:
        os.close(handle)
