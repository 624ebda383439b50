"""Entries that name a device's description: which of them are files, and what drivers take in their place."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

from drivers.devices.dbc_file import DBC_ENCODING, DbcText
from rig.errors import FileProblem
from rig.text_file import read_bytes

ENDING, DBC_ENDING = ".toml", ".dbc"
LARGEST_DBC_BYTES = 262_144


def is_file(given: object) -> bool:
    """Whether an entry names a file, in place of a description that comes with the program, or a table."""
    return isinstance(given, str) and given.casefold().endswith(ENDING)


def is_dbc(given: object) -> bool:
    """Whether an entry names a DBC file."""
    return isinstance(given, str) and given.casefold().endswith(DBC_ENDING)


def described(kind: str, given: Any) -> Any:  # noqa: ANN401 - a name, a file's name or a table
    """A description as drivers take it: the name of one that comes with the program, or a table; of a file its own.

    Raises:
        FileProblem: a file cannot be used.
    """
    if not is_file(given):
        return given
    from rig.files.descriptions import table_of  # loads the validator; the station has tables and comes not here

    return table_of(kind, given)


def dbc_text(path: str | Path) -> DbcText:
    """A DBC file's text: UTF-8, or else as most tools write it.

    Raises:
        FileProblem: it cannot be read, is too large, or is in neither encoding.
    """
    path = Path(path)
    data = read_bytes(path, LARGEST_DBC_BYTES)
    for encoding in ("utf-8-sig", DBC_ENCODING):
        with contextlib.suppress(UnicodeDecodeError):
            return DbcText(path.name, data.decode(encoding))
    raise FileProblem(str(path), ["not a text in UTF-8 or Windows-1252"])
