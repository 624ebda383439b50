"""The matrix files of a folder, as far as a list of them needs: name, serial number, what cannot be used and why.

Nothing here decides anything: the plan reads the files anew, with every check. Names from a browser are looked up in
the list and never made into paths; no link is followed.
"""

from __future__ import annotations

import contextlib
import os
import tomllib
from pathlib import Path
from typing import Any

from rig.errors import FileProblem
from rig.files.toml_lines import structure_problem
from rig.text_file import read_text

LARGEST_BYTES = 262_144
MOST_FILES = 300
LONGEST_NAME = 120
LINK = "is a symbolic link, which may point outside this folder. Fix: copy the matrix file into this folder"
OTHER = "not a matrix file: it has no [specimen] table"
NO_MATRIX = frozenset({"limits", "actuator", "benchmark", "data", "body", "profile"})
"""Tables of the other files of users."""


class Matrices:
    """The matrix files in a folder; a file is read again when it has changed.

    Args:
        folder: where they are.

    Attributes:
        listing: what `look` found last: name, serial number and remark of each; and what is not listed, in words.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.listing: tuple[list[dict[str, Any]], str] = [], ""
        self._known: dict[str, tuple[tuple[int, int, int], dict[str, Any] | None]] = {}

    def look(self) -> None:
        """List the files; large ones take up to 0.1 s each, so this is not called in the loop of a server."""
        self.listing = self._listed()

    def _listed(self) -> tuple[list[dict[str, Any]], str]:
        try:
            with os.scandir(self.folder) as entries:
                names = sorted(entry.name for entry in entries if entry.name.endswith(".toml"))
        except OSError as error:
            return [], f"{self.folder}: cannot be read: {error.strerror}"
        usable = [name for name in names if _usable(name)]
        matrices = [entry for name in usable[:MOST_FILES] if (entry := self._entry(name)) is not None]
        matrices.sort(key=lambda entry: entry["remark"] == OTHER)
        self._known = {name: self._known[name] for name in usable if name in self._known}
        notes = []
        if len(usable) < len(names):
            notes.append(f"{len(names) - len(usable)} files whose names contain unusual characters are not listed")
        if len(usable) > MOST_FILES:
            notes.append(f"only the first {MOST_FILES} files are listed")
        return matrices, "; ".join(notes)

    def path(self, name: object) -> Path | None:
        """The file of a listed name; None for any other, and for a symbolic link."""
        known = isinstance(name, str) and any(entry["name"] == name for entry in self.listing[0])
        path = self.folder / str(name)
        return path if known and path.is_file() and not path.is_symlink() else None

    def _entry(self, name: str) -> dict[str, Any] | None:
        """One file; None where it is another of the user's files or is gone."""
        path = self.folder / name
        try:
            state = path.lstat()
        except OSError:
            return None
        stamp = state.st_mtime_ns, state.st_size, state.st_ino
        known = self._known.get(name)
        if known is None or known[0] != stamp:
            known = self._known[name] = stamp, _described(path)
        return known[1]


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
    if not isinstance(data.get("specimen"), dict):
        return {**entry, "remark": OTHER}
    with contextlib.suppress(KeyError, TypeError):
        entry["serial_number"] = str(data["specimen"]["serial_number"])[:80]
    return entry
