"""Optional parts of the installation: the extras of pyproject.toml that a user's command may need."""

from __future__ import annotations

import os
import shlex
import sys
from pathlib import Path


def how_to_install(extra: str) -> str:
    """The shell command that adds an extra to this Python environment, for the end of a message.

    Args:
        extra: name in `[project.optional-dependencies]` of pyproject.toml.
    """
    return f"{pip()} install 'mr-damper-rig[{extra}]'"


def pip() -> str:
    """The command `pip` of this Python environment: with its path if the environment is a venv that is not activated.

    The shell's own `pip` then belongs to another Python. The path is relative if it is in the working directory.
    """
    program = Path(sys.prefix, *(("Scripts", "pip.exe") if os.name == "nt" else ("bin", "pip")))
    activated = os.environ.get("VIRTUAL_ENV", "") == sys.prefix
    if sys.prefix == sys.base_prefix or activated or not program.exists():
        return "pip"
    here = Path.cwd()
    return shlex.quote(str(program.relative_to(here) if program.is_relative_to(here) else program))


EXTRA_OF = {
    "pyarrow": "files", "asammdf": "files", "matio": "files", "nptdms": "files",
    "python_calamine": "files", "reportlab": "pdf", "PIL": "pdf", "distributed": "cluster",
    "psycopg": "results",
}
"""Package as it is imported to the smallest extra that installs it."""


def missing_package(error: ModuleNotFoundError) -> str:
    """The message for a package that is not installed; empty if it is part of the basic installation."""
    package = (error.name or "").partition(".")[0]
    extra = EXTRA_OF.get(package)
    return f"the required package {package} is not installed. Fix: {how_to_install(extra)}" if extra else ""
