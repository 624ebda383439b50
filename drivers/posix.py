"""What Windows lacks, where only the analysis of recorded tests runs (docs/how-to/windows.md): `fcntl` and file flags.

The rig itself, real or simulated, needs Linux. Files of the analysis are locked against a running campaign only, and
none runs on Windows: there a lock is always free.
"""

from __future__ import annotations

import os

try:
    import fcntl
except ModuleNotFoundError:

    class fcntl:  # type: ignore[no-redef]  # noqa: N801 - the module's name
        """Locks that are always free."""

        LOCK_SH = LOCK_EX = LOCK_NB = LOCK_UN = 0

        @staticmethod
        def flock(handle: int, operation: int) -> None:
            """Do nothing."""
            del handle, operation


try:
    import resource
except ModuleNotFoundError:
    resource = None  # type: ignore[assignment]

try:
    import termios
except ModuleNotFoundError:
    termios = None  # type: ignore[assignment]

O_CLOEXEC = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
"""Of every file: it is not inherited, and on Windows line ends in it are left alone."""
O_NOFOLLOW = getattr(os, "O_NOFOLLOW", 0)
HAS_POSITIONED_ACCESS = hasattr(os, "pread")

__all__ = ["HAS_POSITIONED_ACCESS", "O_CLOEXEC", "O_NOFOLLOW", "fcntl", "resource", "termios"]
