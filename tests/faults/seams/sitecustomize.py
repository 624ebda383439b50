"""Faults that live around a process: loaded by every Python process of a campaign under test, switched on by a file.

`RIG_TEST_SEAM` names a folder. A file in it with the fault's name switches the fault on; its content is the amount:
`clock-step` seconds by which the wall clock is off, `host-suspend` seconds the machine has slept, `fsync-error` every
flush of a file fails, `task-dies` the station's sensor threads fail with an error nobody expects.
"""

from __future__ import annotations

import errno
import os
import sys
from datetime import timedelta
from pathlib import Path

SEAM = Path(os.environ.get("RIG_TEST_SEAM", ""))


def amount(fault: str) -> float:
    """How much of a fault is switched on; 0 while it is off."""
    try:
        return float((SEAM / fault).read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return 0.0


def install() -> None:
    """Put the seams in."""
    import rig.clock

    utc_now, suspended_ns, fdatasync = rig.clock.utc_now, rig.clock.suspended_ns, os.fdatasync

    def refused_flush(handle: int) -> None:
        if amount("fsync-error"):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        fdatasync(handle)

    rig.clock.utc_now = lambda: utc_now() + timedelta(seconds=amount("clock-step"))
    rig.clock.suspended_ns = lambda: suspended_ns() + int(1e9 * amount("host-suspend"))
    os.fdatasync = refused_flush
    if "rig.station" in sys.orig_argv:
        install_dying_tasks()


def install_dying_tasks() -> None:
    """Sensor threads of the station that end by an error nobody expects."""
    from drivers.serial_sensor import SerialSensor

    read_batch = SerialSensor.read_batch

    def failing(self: SerialSensor, timeout_s: float) -> object:
        if amount("task-dies"):
            raise RuntimeError("a defect in a thread")
        return read_batch(self, timeout_s)

    SerialSensor.read_batch = failing  # type: ignore[method-assign,assignment]  # this is what a seam does


if "RIG_TEST_SEAM" in os.environ:
    install()
