"""The matrix files of a folder, as far as a list of them needs: name, serial number, what cannot be used and why.

Nothing here decides anything: the plan reads the files anew, with every check. Names from a browser are looked up in
the list and never made into paths; no link is followed.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from drivers.processes import own_program
from rig.errors import FileProblem
from rig.files.toml_lines import structure_problem
from rig.text_file import read_text

LARGEST_BYTES = 262_144
MOST_FILES = 300
LONGEST_NAME = 120
LINK = "is a symbolic link, which may point outside this folder. Fix: copy the matrix file into this folder"
OTHER = "not a matrix file: it has no [specimen] table"
READ_HERE_BYTES, READ_S, NICENESS = 100_000, 120.0, 10
"""Bytes read in this process (0.05 s); time limit and priority of the other process."""
NO_MATRIX = frozenset({
    "limits", "actuator", "benchmark", "data", "body", "profile", "rebound_force", "jounce_force", "energy", "damping",
    "dynamic_range", "friction_force", "gas_force", "parameter",
})
"""Tables of the other files of users."""


class Matrices:
    """Matrix files in a folder; each is cached until it changes.

    Args:
        folder: folder of the matrix files.

    Attributes:
        listing: last result of `look`: name, serial number and remark of each file, and a note on files that are not
            listed.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.listing: tuple[list[dict[str, Any]], str] = [], ""
        self._known: dict[str, tuple[tuple[int, int, int], dict[str, Any] | None]] = {}

    def look(self) -> None:
        """List the files; not called in the server's event loop, because a large file takes up to 0.1 s."""
        self.listing = self._listed()

    def _listed(self) -> tuple[list[dict[str, Any]], str]:
        try:
            with os.scandir(self.folder) as entries:
                names = sorted(entry.name for entry in entries if entry.name.endswith(".toml"))
        except OSError as error:
            return [], f"{self.folder}: cannot be read: {error.strerror}"
        usable = [name for name in names if _usable(name)]
        self._read(usable[:MOST_FILES])
        known = [self._known[name][1] for name in usable[:MOST_FILES] if name in self._known]
        matrices = [entry for entry in known if entry is not None]  # not those that are another of the user's files
        matrices.sort(key=lambda entry: entry["remark"] == OTHER)
        notes = []
        if len(usable) < len(names):
            notes.append(f"files with unusual characters in their names, not listed: {len(names) - len(usable)}")
        if len(usable) > MOST_FILES:
            notes.append(f"only the first {MOST_FILES} files are listed")
        return matrices, "; ".join(notes)

    def path(self, name: object) -> Path | None:
        """The file of a listed name; None for any other, and for a symbolic link."""
        known = isinstance(name, str) and any(entry["name"] == name for entry in self.listing[0])
        path = self.folder / str(name)
        return path if known and path.is_file() and not path.is_symlink() else None

    def _read(self, names: list[str]) -> None:
        """Read the files that have changed; if there are many bytes, in a process with low priority."""
        stamps: dict[str, tuple[int, int, int]] = {}
        for name in names:
            with contextlib.suppress(OSError):
                state = (self.folder / name).lstat()
                stamps[name] = state.st_mtime_ns, state.st_size, state.st_ino
        self._known = {name: known for name, known in self._known.items() if name in stamps}
        changed = [name for name, stamp in stamps.items() if name not in self._known or self._known[name][0] != stamp]
        small = sum(stamps[name][1] for name in changed) <= READ_HERE_BYTES
        read = described(self.folder, changed) if small else _described_elsewhere(self.folder, changed)
        self._known |= {name: (stamps[name], entry) for name, entry in read.items()}


def described(folder: Path, names: Iterable[str]) -> dict[str, dict[str, Any] | None]:
    """Descriptions by file name; None for files that are not matrix files."""
    return {name: _described(folder / name) for name in names}


def _described_elsewhere(folder: Path, names: list[str]) -> dict[str, dict[str, Any] | None]:
    """Run `described` in another process; empty if it fails, so the next listing tries again."""
    request, silent = json.dumps([str(folder), names]), subprocess.DEVNULL
    with contextlib.suppress(OSError, ValueError, subprocess.SubprocessError):
        done = subprocess.run(
            own_program("rig.page.matrices"), input=request.encode(), stdout=subprocess.PIPE, stderr=silent,
            timeout=READ_S, check=True, start_new_session=True,
        )
        return dict(json.loads(done.stdout))
    return {}


def main() -> None:
    """Describe the files listed on standard input."""
    os.nice(NICENESS)
    folder, names = json.load(sys.stdin)
    sys.stdout.write(json.dumps(described(Path(folder), names)))


def _usable(name: str) -> bool:
    return name.isprintable() and len(name) <= LONGEST_NAME and not name.startswith(".")


def _described(path: Path) -> dict[str, Any] | None:
    entry = {"name": path.name, "serial_number": "", "remark": ""}
    if path.is_symlink():
        return {**entry, "remark": LINK}
    try:
        text = read_text(path, LARGEST_BYTES)
        problem = structure_problem(text)
        data = {} if problem else tomllib.loads(text)
    except FileProblem as error:
        return {**entry, "remark": error.problems[0]}
    except (ValueError, RecursionError):
        problem = "not valid TOML"
    if problem:
        return {**entry, "remark": problem}
    if "specimen" not in data and NO_MATRIX & data.keys():
        return None
    if isinstance(data.get("specimen"), list):
        return None  # specimens of a simulated rig
    if not isinstance(data.get("specimen"), dict):
        return {**entry, "remark": OTHER}
    with contextlib.suppress(KeyError, TypeError):
        entry["serial_number"] = str(data["specimen"]["serial_number"])[:80]
    return entry


if __name__ == "__main__":
    main()
