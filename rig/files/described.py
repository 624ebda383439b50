"""Entries that name or contain a device's description: their type, and what drivers receive instead."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rig.files.names import is_file
from rig.files.network_text import with_network_text
from rig.files.quantity import located

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler
    from pydantic_core import CoreSchema


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
