"""Which version this is, and which commit it was made from."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from rig import __version__

PACKAGE = Path(__file__).resolve().parent


def commit() -> str | None:
    """The commit of the build, or of this checkout (with `-dirty` where files were changed); None if unknown."""
    built = PACKAGE / "commit.txt"  # first: the folder of an installed or unpacked copy may be another repository
    if built.is_file():
        return built.read_text(encoding="utf-8").strip() or None
    if not (PACKAGE.parent / ".git").exists():
        return None
    command = ["git", "-C", str(PACKAGE.parent), "describe", "--always", "--dirty", "--abbrev=10", "--exclude=*"]
    # In a hook of another repository GIT_DIR names that one; without locks no other git process has to wait.
    own = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    own["GIT_OPTIONAL_LOCKS"] = "0"
    try:
        shown = subprocess.run(command, capture_output=True, text=True, check=True, env=own)
    except (OSError, subprocess.CalledProcessError):
        return None
    return shown.stdout.strip() or None


def described() -> str:
    """Version and commit, as `rig --version` prints them."""
    made_from = commit()
    return __version__ if made_from is None else f"{__version__} (commit {made_from})"
