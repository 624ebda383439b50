"""A console that shows control characters of texts as escapes, so that no name in a file controls the terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Console

from rig.errors import clean_text


class SafeConsole(Console):
    """A console of rich whose texts pass `rig.errors.clean_text`."""

    def print(self, *objects: Any, **settings: Any) -> None:  # noqa: ANN401 - as of rich
        """Print objects as rich does, texts without control characters."""
        super().print(*(clean_text(one) if isinstance(one, str) else one for one in objects), **settings)
