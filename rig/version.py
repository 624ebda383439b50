"""Which version this is, and which commit it was made from."""

from __future__ import annotations

import subprocess
from pathlib import Path

from rig import __version__

PACKAGE = Path(__file__).resolve().parent


def commit() -> str | None:
    """The commit of this checkout (with `-dirty` where files were changed) or of the build; None if unknown."""
    if (PACKAGE.parent / ".git").exists():
        command = ["git", "-C", str(PACKAGE.parent), "describe", "--always", "--dirty", "--abbrev=10", "--exclude=*"]
        try:
            return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() or None
        except (OSError, subprocess.CalledProcessError):
            return None
    built = PACKAGE / "commit.txt"
    return built.read_text(encoding="utf-8").strip() if built.is_file() else None


def described() -> str:
    """Version and commit, as `rig --version` prints them."""
    made_from = commit()
    return __version__ if made_from is None else f"{__version__} (commit {made_from})"
