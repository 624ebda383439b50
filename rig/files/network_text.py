"""CAN network descriptions (DBC, KCD, SYM, ARXML) named in a device description; drivers receive the text."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drivers.devices.dbc_file import DBC_ENCODING, DbcText
from rig.errors import FileProblem
from rig.text_file import read_bytes

NETWORK = "dbc"
"""Key in a sensor format for the network description of its message."""
LARGEST_DBC_BYTES = 262_144
LARGEST_XML_BYTES = 4 << 20
"""Of a KCD, SYM or ARXML file, which needs more text for the same messages."""
LARGEST_NETWORK_BYTES = 32 << 20
"""Of a DBC that describes a car's whole network: for decoding traffic only."""


def with_network_path(table: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Replace the name of a network description by its full path.

    Args:
        table: of any description.
        folder: of the file that holds it.
    """
    given = table.get(NETWORK)
    return {**table, NETWORK: str(folder / given)} if isinstance(given, str) else dict(table)


def with_network_text(table: Mapping[str, Any]) -> dict[str, Any]:
    """Replace the name of a network description by its name and text, because drivers read no files.

    Raises:
        FileProblem: the file cannot be read.
    """
    given = table.get(NETWORK)
    if not isinstance(given, str):
        return dict(table)
    read = dbc_text(given)
    return {**table, NETWORK: {"name": read.name, "text": read.text}}


def dbc_text(path: str | Path, largest_bytes: int | None = None) -> DbcText:
    """The text of a DBC file or another network description: UTF-8, or else as most tools write it.

    Raises:
        FileProblem: it cannot be read, is too large, or is in neither encoding.
    """
    path = Path(path)
    if largest_bytes is None:
        largest_bytes = LARGEST_DBC_BYTES if DbcText(path.name, "").format == "dbc" else LARGEST_XML_BYTES
    data = read_bytes(path, largest_bytes)
    for encoding in ("utf-8-sig", DBC_ENCODING):
        with contextlib.suppress(UnicodeDecodeError):
            return DbcText(path.name, data.decode(encoding))
    raise FileProblem(str(path), ["the text is not encoded in UTF-8 or Windows-1252"])
