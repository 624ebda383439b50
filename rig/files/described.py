"""Entries that name or contain a device's description: their type, and what drivers receive instead."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.devices.dbc_file import DBC_ENCODING, DbcText
from rig.errors import FileProblem
from rig.files.names import is_file
from rig.files.quantity import located
from rig.text_file import read_bytes

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler
    from pydantic_core import CoreSchema

NETWORK = "dbc"
"""Key of a sensor's format that names the network description of its message."""
LARGEST_DBC_BYTES = 262_144
LARGEST_XML_BYTES = 4 << 20
"""Of a KCD, SYM or ARXML file, which needs more text for the same messages."""
LARGEST_NETWORK_BYTES = 32 << 20
"""Of a DBC that describes a car's whole network: for decoding traffic only."""


@dataclass(frozen=True)
class DescribedBy:
    """Annotation of an entry that names a device's description, or holds one: a known name, a file's, or a table.

    Attributes:
        kind: of description, as `rig schema` calls it.
        known: returns a name that is no file's, or raises ValueError.
        tables: a table may be in its place.
    """

    kind: str
    known: Callable[[str], str]
    tables: bool = True

    def check(self, value: Any) -> Any:  # noqa: ANN401 - a name or a table
        """A name or a table that was checked when the file was read, as it is.

        Raises:
            ValueError: a name that is not known any more.
        """
        return self.known(value) if isinstance(value, str) else value

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        from pydantic_core import core_schema

        written: Any = str | dict[str, Any] if self.tables else str
        shape = handler.generate_schema(written)
        return core_schema.no_info_plain_validator_function(self._read, json_schema_input_schema=shape)

    def _read(self, value: Any) -> Any:  # noqa: ANN401 - whatever the file has
        """The name or table, and what it describes checked.

        Raises:
            ValueError: it is neither, or an unknown name.
            error: everything that is wrong with the description.
        """
        from rig.files.descriptions import entry_problems  # loads the validator, which has called this

        table = isinstance(value, Mapping) and self.tables
        if not table and not isinstance(value, str):
            raise ValueError("must be the name of a description or of a file, in quotes" + self.tables * ", or a table")
        if not table and not is_file(value):
            return self.known(value)
        if problems := entry_problems(self.kind, value):
            error: Exception = located(problems)
            raise error
        return value


def described(kind: str, given: Any) -> Any:  # noqa: ANN401 - a name, a file's name or a table
    """A description as drivers take it: the name of one that comes with the program, or a table; of a file its own.

    Raises:
        FileProblem: a file cannot be used.
    """
    if not is_file(given):
        return with_network_text(given) if isinstance(given, Mapping) else given
    from rig.files.descriptions import table_of  # loads the validator; the station has tables and comes not here

    return with_network_text(table_of(kind, given))


def with_network_path(table: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """A description with the network description that it names as a whole path.

    Args:
        table: of any description.
        folder: of the file that holds it.
    """
    given = table.get(NETWORK)
    return {**table, NETWORK: str(folder / given)} if isinstance(given, str) else dict(table)


def with_network_text(table: Mapping[str, Any]) -> dict[str, Any]:
    """A description with the name and text of the network description that it names: drivers read no file.

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
