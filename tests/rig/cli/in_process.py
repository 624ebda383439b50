"""A command as `python -m rig.cli.main` runs it, mostly without a process of its own and the second its start takes."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
from pathlib import Path
from subprocess import CompletedProcess
from unittest.mock import patch

from rig.cli.main import main


def rig_process(*arguments: str | Path, cwd: Path | None = None) -> CompletedProcess[str]:
    """A command in a process of its own: one that starts others, or takes another program's place."""
    command = [sys.executable, "-m", "rig.cli.main", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=120, check=False)


def rig(*arguments: str | Path, cwd: Path | None = None) -> CompletedProcess[str]:
    """What the command printed and its exit code; it sees no terminal."""
    words = [str(argument) for argument in arguments]
    with (
        io.TextIOWrapper(io.BytesIO(), "utf-8") as output, io.TextIOWrapper(io.BytesIO(), "utf-8") as errors,
        contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors), contextlib.chdir(cwd or Path.cwd()),
        patch.object(sys, "stdin", io.StringIO()),
    ):  # fmt: skip
        code = main(words)
        for stream in (output, errors):
            stream.flush()
            stream.seek(0)
        return CompletedProcess(words, code, output.read(), errors.read())
