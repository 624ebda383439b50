"""Entries that name files."""

from __future__ import annotations

from drivers.devices.dbc_file import ENDINGS

ENDING = ".toml"
NETWORK_ENDINGS = ENDINGS
"""Endings of files that describe a CAN network."""


def is_file(given: object) -> bool:
    """Whether an entry names a file, in place of a description that comes with the program, or a table."""
    return isinstance(given, str) and given.casefold().endswith(ENDING)


def is_dbc(given: object) -> bool:
    """Whether an entry names a DBC file, or another description of a CAN network (KCD, SYM, ARXML)."""
    return isinstance(given, str) and given.casefold().endswith(NETWORK_ENDINGS)
