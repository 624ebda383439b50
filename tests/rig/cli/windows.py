"""Runs the analysis as on Windows: modules, functions and folders that only Linux has are hidden.

python windows.py TEST.csv: import, identify, report, export, compare and the Python interface, in the working folder.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from types import ModuleType

import can  # noqa: F401 - has files of its own for Windows, as pyserial
import serial  # noqa: F401

MODULES = {"fcntl", "termios", "pty", "tty", "resource", "grp", "pwd", "syslog"}
OF_OS = (
    "getuid", "geteuid", "fchmod", "pread", "pwrite", "posix_fallocate", "O_NOFOLLOW", "O_CLOEXEC", "O_NONBLOCK",
    "O_DIRECTORY", "statvfs", "sched_getaffinity", "mkfifo", "killpg", "setsid", "getgroups",
)
OF_SIGNAL = ("SIGHUP", "SIGKILL", "SIGTSTP", "SIGCONT", "SIGSTOP", "SIGUSR1")


class Hidden(MetaPathFinder):
    """Finds first, and finds nothing."""

    def find_spec(self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> None:
        """As for a module that is not there."""
        del path, target
        if name in MODULES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def refuse_linux_folders(event: str, arguments: tuple[object, ...]) -> None:
    """An audit hook: our own code opens nothing that only Linux has."""
    if event == "open" and str(arguments[0]).startswith(("/dev/shm", "/run/lock")):
        raise FileNotFoundError(str(arguments[0]))


def hide() -> None:
    """Hide everything that Windows lacks."""
    for name in MODULES:
        sys.modules.pop(name, None)
    sys.meta_path.insert(0, Hidden())
    sys.addaudithook(refuse_linux_folders)
    for module, names in ((os, OF_OS), (signal, OF_SIGNAL)):
        for name in names:
            if hasattr(module, name):
                delattr(module, name)


def analyse(file: str) -> None:
    """Every command of the analysis, then the same in Python."""
    from rig.cli.main import main
    from rig.cli.output import say
    from rig.identification import Fit
    from rig.recording.run import Run

    columns = [text for name in ("displacement", "force", "time") for text in ("--column", f"{name}={name}")]
    for command in (
        ["import", file, *columns, "--current", "0.5 A"],
        ["identify", "last", "--model", "kwok"],
        ["report", "last"],
        ["export", "last", "--to", "csv", "--out", "tables"],
        ["export", "last/fit.json", "--to", "c", "--out", "model"],
        ["compare", "last", "last"],
    ):
        if code := main(command):
            sys.exit(f"rig {' '.join(command)}: exit {code}")
    run, fit = Run.open("last"), Fit.load("last")
    force_N = fit.predict(run.points[0].to_pandas())["force_N"].abs().max()
    say(f"{len(run.points)} {fit.model} {force_N:.0f}")


if __name__ == "__main__":
    hide()
    analyse(sys.argv[1])
