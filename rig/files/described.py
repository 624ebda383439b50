"""Entries that name a device's description: which of them are files, and what drivers take in their place."""

from __future__ import annotations

from typing import Any

ENDING = ".toml"


def is_file(given: object) -> bool:
    """Whether an entry names a file, in place of a description that comes with the program, or a table."""
    return isinstance(given, str) and given.casefold().endswith(ENDING)


def described(kind: str, given: Any) -> Any:  # noqa: ANN401 - a name, a file's name or a table
    """A description as drivers take it: the name of one that comes with the program, or a table; of a file its own.

    Raises:
        FileProblem: a file cannot be used.
    """
    if not is_file(given):
        return given
    from rig.files.descriptions import table_of  # loads the validator; the station has tables and comes not here

    return table_of(kind, given)
