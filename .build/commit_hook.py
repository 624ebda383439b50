"""Build hook: puts the commit that a wheel or an sdist is built from into `rig/commit.txt`."""

import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CommitHook(BuildHookInterface):
    """Includes `rig/commit.txt`; one that an sdist brought is kept."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Ask git for the commit; without a repository there is nothing to add."""
        root = Path(self.root)
        if version == "editable" or (root / "rig/commit.txt").exists() or not (root / ".git").exists():
            return
        command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=10", "--exclude=*"]
        own = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
        try:
            commit = subprocess.run(command, capture_output=True, text=True, check=True, env=own).stdout.strip()
        except (OSError, subprocess.CalledProcessError):
            return
        with tempfile.NamedTemporaryFile("w", suffix=".txt", delete=False) as file:
            file.write(commit + "\n")
        self.written = Path(file.name)
        build_data["force_include"][file.name] = "rig/commit.txt"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary file."""
        del version, build_data, artifact_path
        if (written := getattr(self, "written", None)) is not None:
            written.unlink(missing_ok=True)
