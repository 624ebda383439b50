"""Check before reading that recordings fit into the memory of this computer."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from drivers.posix import resource
from rig.errors import FileProblem

MEMORY_INFO, OWN_SIZE = Path("/proc/meminfo"), Path("/proc/self/statm")
LIMIT, USED = Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.stat")
"""Files with the limits of a container (cgroup v2)."""


def check_memory(file: Path, needed_bytes: int, fix: str) -> None:
    """Check that the available memory is sufficient.

    Args:
        file: file to be read.
        needed_bytes: required memory.
        fix: recommended action, for the message.

    Raises:
        FileProblem: more memory is needed than is available.
    """
    available_bytes = min(_available(), default=needed_bytes)
    if needed_bytes > available_bytes:
        raise FileProblem(str(file), [
            f"reading this file requires about {needed_bytes / 1e9:.3g} GB of memory, but only "
            f"{max(0, available_bytes) / 1e9:.3g} GB are available. Fix: {fix}, close other programs, or use a "
            "computer with more memory"
        ])  # fmt: skip


def _available() -> Iterator[int]:
    """Memory still available to this process (bytes), for each limit of this computer."""
    with contextlib.suppress(OSError, ValueError, KeyError):
        lines = MEMORY_INFO.read_text(encoding="ascii").splitlines()
        entries = {name: int(rest.split()[0]) * 1024 for name, _, rest in (line.partition(":") for line in lines)}
        yield entries["MemAvailable"] + entries["SwapFree"]
    with contextlib.suppress(OSError, ValueError):
        limit = int(LIMIT.read_text(encoding="ascii"))  # "max" if there is no limit
        stated = dict(line.split() for line in USED.read_text(encoding="ascii").splitlines())
        yield limit - int(stated.get("anon", 0)) - int(stated.get("unevictable", 0))
    with contextlib.suppress(OSError, ValueError, AttributeError):
        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            yield limit - int(OWN_SIZE.read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
