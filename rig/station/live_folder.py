"""The live folder of a running campaign: the interface for processes that watch it or request a stop.

It is in shared memory, belongs to one user (mode 0700) and is removed with the campaign:

    live.lock          held (`flock`) while the application runs
    operator.lock      held by the process that serves the operator: one at a time
    devices.json       devices of the rig, and the folder in which the campaign is recorded
    plan.json          the plan, written once; results.json, state.json: always replaced as a whole
    station.sock       datagrams to the station: a stop, nothing else
    application.sock   datagrams to the application: stop, pause, start, notes

Datagrams have no connection: a sender cannot block or disturb the receiver. The station takes commands of its
application on the pipes only; here it accepts a stop only.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from drivers.posix import fcntl
from rig import text_file
from rig.errors import FileProblem

PREFIX = "mr-damper-rig-"
SUFFIX = ".live"
SHARED_MEMORY = Path("/dev/shm")

LOCK = "live.lock"
OPERATOR_LOCK = "operator.lock"
PLAN, RESULTS, STATE = "plan.json", "results.json", "state.json"
DEVICES = "devices.json"
STATION_SOCKET, APPLICATION_SOCKET = "station.sock", "application.sock"
LONGEST_DATAGRAM = 32768
LONGEST_ADDRESS = 103
"""Bytes that every kernel takes as the address of a socket (Linux 107, macOS 103)."""


def make_live_folder(place: Path | None = None) -> tuple[Path, int]:
    """A new folder, and the descriptor that holds its lock; those that killed applications left are removed.

    Args:
        place: where to make it; by default shared memory, else the folder for temporary files.

    Raises:
        OSError: it cannot be made.
    """
    parent = place or _usual_place()
    for left in parent.glob(f"{PREFIX}*{SUFFIX}"):
        if _left_over(left):
            shutil.rmtree(left, ignore_errors=True)
    folder = Path(tempfile.mkdtemp(SUFFIX, PREFIX, parent))
    lock = hold(folder / LOCK)
    if lock is None:
        raise OSError(f"{folder}: the folder's lock is held by another process")
    return folder, lock


def _usual_place() -> Path:
    return SHARED_MEMORY if SHARED_MEMORY.is_dir() else Path(tempfile.gettempdir())


def running_folders(place: Path | None = None) -> list[Path]:
    """Live folders of this user's campaigns that run now, the newest last."""
    folders = []
    for folder in (place or _usual_place()).glob(f"{PREFIX}*{SUFFIX}"):
        with contextlib.suppress(OSError):
            if _ours(folder) and held(folder / LOCK):
                folders.append((folder.lstat().st_ctime_ns, folder))
    return [folder for _, folder in sorted(folders)]


def _ours(folder: Path) -> bool:
    """A real folder of this user.

    Raises:
        OSError: it is gone.
    """
    state = folder.lstat()
    return stat.S_ISDIR(state.st_mode) and state.st_uid == os.getuid()


def _left_over(folder: Path) -> bool:
    """Ours, begun, and its application gone."""
    try:
        if not _ours(folder) or not (folder / LOCK).exists():
            return False
    except OSError:
        return False
    return not held(folder / LOCK)


def hold(path: Path) -> int | None:
    """Take a lock file; the descriptor holds it until it is closed or its process ends. None: another process has it.

    Raises:
        OSError: the file cannot be made.
    """
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle


def held(path: Path) -> bool:
    """Whether a process holds this lock file; False where there is none."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except (OSError, ValueError):  # a file may state a folder with a null byte in its name
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(handle)
    return False


@contextlib.contextmanager
def address(path: Path) -> Iterator[str]:
    """What to bind or send to for the socket at `path`: where that is too long for the kernel, by its open folder.

    Raises:
        OSError: its folder cannot be opened.
    """
    if len(os.fsencode(path)) <= LONGEST_ADDRESS:
        yield str(path)
        return
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)


def bound(path: Path) -> socket.socket:
    """A datagram socket that never blocks, bound at `path`, for this user alone.

    Raises:
        OSError: it cannot be bound.
    """
    inbox = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    try:
        with address(path) as short:
            inbox.bind(short)
        path.chmod(0o600)
    except OSError:
        inbox.close()
        raise
    return inbox


def received(inbox: socket.socket) -> dict[str, Any] | None:
    """The next message; an empty one for what is not a JSON object, None when there is none.

    Raises:
        OSError: the socket is broken.
    """
    try:
        data = inbox.recv(LONGEST_DATAGRAM)
    except BlockingIOError:
        return None
    try:
        message = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return message if isinstance(message, dict) else {}


def send_message(path: str | Path, message: dict[str, Any]) -> bool:
    """Send a message; never blocks. False: no receiver, or it does not read."""
    with contextlib.suppress(OSError, ValueError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as outbox:
        outbox.setblocking(False)
        with address(Path(path)) as short:
            outbox.sendto(json.dumps(message).encode(), short)
        return True
    return False


def replace_json(path: Path, value: object) -> None:
    """Write a file that readers see as a whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    fresh = path.with_suffix(".new")
    fresh.write_text(json.dumps(value), encoding="utf-8")
    fresh.replace(path)


def read_json(path: Path) -> dict[str, Any]:
    """What stands in one of the files; empty where there is none or it cannot be read."""
    try:
        return text_file.read_json(path)
    except FileProblem:
        return {}
