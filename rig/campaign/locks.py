"""Who may use a rig and a campaign's directory: locks that end with the process that holds them, however it ends."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rig.bench.model import Bench
from rig.clock import monotonic_ns
from rig.errors import Refused

STATION_STOPS_S = 90.0
"""How long the station of a killed campaign may need to bring its rig to rest and give the devices back."""
LOOK_AGAIN_S = 0.1


@contextmanager
def locked(bench: Bench) -> Iterator[tuple[int, ...]]:
    """Hold the rig's devices for this process while the block runs: one lock a device address.

    The station inherits the descriptors (`pass_fds`), so the locks last until it is gone too: after a killed
    application it still stops the rig. Such a station is waited for; a campaign that lives is not.

    Raises:
        Refused: another campaign on this machine holds one of them (slug `two-instances`).
    """
    addresses = (bench.actuator.url, bench.ecu.channel, bench.load_cell.url, bench.lvdt.url)
    with contextlib.ExitStack() as held:
        descriptors = []
        for address in addresses:
            descriptors.append(_lock(address))
            held.callback(os.close, descriptors[-1])
        yield tuple(descriptors)


def _lock(address: str) -> int:
    name = hashlib.sha256(address.encode()).hexdigest()[:16]
    path = Path(tempfile.gettempdir()) / f"mr-damper-rig-{os.getuid()}-{name}.lock"
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    deadline_ns = monotonic_ns() + int(STATION_STOPS_S * 1e9)
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            break
        except OSError as error:
            if _lives(_owner(descriptor)) or monotonic_ns() > deadline_ns:
                os.close(descriptor)
                raise Refused(
                    "two-instances", f"{address} is in use by another campaign on this machine ({path})"
                ) from error
        # A lock cannot be waited for with a time limit.
        time.sleep(LOOK_AGAIN_S)
    os.ftruncate(descriptor, 0)
    os.pwrite(descriptor, b"%d\n" % os.getpid(), 0)
    return descriptor


def _owner(descriptor: int) -> int:
    """Process id of the campaign that took the lock; 0 when it is not written yet."""
    text = os.pread(descriptor, 32, 0).strip()
    return int(text) if text.isdigit() else 0


def _lives(process: int) -> bool:
    """Whether a process runs; one that is not known (0) counts as running."""
    if process == 0:
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
