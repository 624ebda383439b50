"""Changed lines of the program: one of its detectors is switched off, a bug is put in on purpose."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


class NoLongerThere(ValueError):
    """A text that is to be replaced does not stand in its file exactly once, or not within a function."""


@dataclass(frozen=True)
class Edit:
    """A changed line: `old` becomes `new` in `file`, relative to the project."""

    file: str
    old: str
    new: str


def edited(file: str, edits: tuple[Edit, ...]) -> tuple[str, str]:
    """A file's text before and after.

    Raises:
        NoLongerThere: an old text is not there exactly once.
    """
    before = after = (ROOT / file).read_text(encoding="utf-8")
    for edit in edits:
        if edit.file == file:
            if after.count(edit.old) != 1:
                raise NoLongerThere(f"{file} has {after.count(edit.old)} times: {edit.old.strip()}")
            after = after.replace(edit.old, edit.new)
    return before, after


def deaf_station(*slugs: str) -> Edit:
    """The station does not hear what its detectors report by these slugs."""
    row = "            row = REACTIONS[finding.slug]\n"
    deaf = f"            if finding.slug in {slugs}:\n                continue\n"
    return Edit("rig/station/supervisor.py", row, deaf + row)
