"""Processes of this computer: the project's own programs as commands, and what the system shows of a process."""

from __future__ import annotations

import sys
from pathlib import Path

PREPARED = "drivers.prepared"
"""Module of a process that has loaded its program in advance; its command line names that program: FD TITLE MODULE."""


def own_program(module: str, *arguments: str) -> list[str]:
    """The command of one of the project's own programs.

    `-P`: the working folder holds files of users. A `click.py` or `tomllib.py` among them must not be imported.

    Args:
        module: its module, as for `python -m`.
        arguments: of the program.
    """
    return [sys.executable, "-P", "-m", module, *arguments]


def stat_fields(process: int) -> list[bytes] | None:
    """The fields of /proc/PID/stat from the third on, the state (proc(5)); None where the system shows none."""
    try:
        # The second field, the name in parentheses, may contain spaces and parentheses.
        return Path(f"/proc/{process}/stat").read_bytes().rpartition(b")")[2].split() or None
    except OSError:
        return None
