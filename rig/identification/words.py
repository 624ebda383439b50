"""Words: every sentence that identification says to people, and the numbers in it; nothing decides by them."""

from __future__ import annotations

from collections.abc import Sequence


def some(texts: Sequence[str], separator: str = ", ") -> str:
    """The first three of a list, and how many more there are."""
    return separator.join(texts[:3]) + (f" and {len(texts) - 3} more" if len(texts) > 3 else "")
