"""Entries that name files."""

from __future__ import annotations

ENDING, DBC_ENDING = ".toml", ".dbc"


def is_file(given: object) -> bool:
    """Whether an entry names a file, in place of a description that comes with the program, or a table."""
    return isinstance(given, str) and given.casefold().endswith(ENDING)


def is_dbc(given: object) -> bool:
    """Whether an entry names a DBC file."""
    return isinstance(given, str) and given.casefold().endswith(DBC_ENDING)
