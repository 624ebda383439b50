"""Optional parts of the installation: the extras of pyproject.toml that a user's command may need."""

from __future__ import annotations


def how_to_install(extra: str) -> str:
    """The shell command that adds an extra, for the end of a message.

    Args:
        extra: name in `[project.optional-dependencies]` of pyproject.toml.
    """
    return f"pip install 'mr-damper-rig[{extra}]'"
