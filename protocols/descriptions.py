"""Contradictions in a description: location in its table, and the correction."""

from __future__ import annotations

from collections.abc import Sequence

from protocols.errors import LocalProtocolError

Place = tuple[str | int, ...]
"""Keys, and numbers of entries of lists from 0, from the whole table to an entry."""
Problem = tuple[Place, str]
"""Where, and what is wrong there with what would be right."""


class DescriptionProblems(LocalProtocolError):
    """A description whose valid entries contradict each other: `problems` has every reason with its place."""

    def __init__(self, name: str, problems: Sequence[Problem]) -> None:
        self.problems = list(problems)
        reasons = "; ".join(f"{dotted(place)}: {text}" if place else text for place, text in problems)
        super().__init__(f"{name}: {reasons}")


def dotted(place: Place) -> str:
    """A place as it is written: `range.current_A[2]` (lists count from 1)."""
    text = ""
    for part in place:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else part
    return text
