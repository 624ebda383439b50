"""Suggestion of the known name nearest to an unknown one: one rule for files, commands and names of devices."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

CUTOFF = 0.6
"""Share of letters that two names have in common from which one is taken for a slip of the other."""


def near_names(name: str, known: Iterable[str], most: int = 1, cutoff: float = CUTOFF) -> list[str]:
    """The known names nearest to a name, the nearest first; empty where none is near."""
    return difflib.get_close_matches(name, list(known), n=most, cutoff=cutoff)


def meant(name: str, known: Iterable[str]) -> str:
    """`did you mean NAME?` for an unknown name that is near a known one; else which names are known."""
    names = list(known)
    near = near_names(name, names)
    return f"did you mean {near[0]}?" if near else f"known: {', '.join(names) or 'none'}"
