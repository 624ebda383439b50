"""Files that a bench file names: descriptions of devices, by their path from the bench file's folder.

An entry with the ending of such a file is a file name; any other text is the name of an included description.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path, PurePath
from typing import Any

from rig.errors import FileProblem
from rig.files.names import NETWORK_ENDINGS, is_dbc
from rig.files.network_text import NETWORK, with_network_path
from rig.files.toml_source import read_toml
from rig.text_file import read_bytes

LARGEST_BYTES = 4 << 20
FORMAT = "format"
"""Key of a sensor's format."""
ENTRIES: Mapping[tuple[str, str], str | tuple[str, ...]] = {
    ("actuator", "register_map"): ".toml", ("ecu", "dbc"): NETWORK_ENDINGS, ("ecu", "roles"): ".toml",
    ("ecu", "supply"): ".toml",
    ("load_cell", "format"): ".toml", ("lvdt", "format"): ".toml", ("auxiliary", "format"): ".toml",
}  # fmt: skip
"""Table and key of each entry that may name a file, and how such a name ends; a table may be a list of them."""


def is_file(entry: tuple[str, str], value: object) -> bool:
    """Whether the value of an entry is a file's name."""
    return isinstance(value, str) and value.casefold().endswith(ENTRIES[entry])


def with_paths(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The data of a bench file with every file's name as a whole path.

    Args:
        data: as read.
        folder: the bench file's.
    """
    return _with_values(data, lambda entry, value: _with_path(entry, value, folder))


def _with_values(data: Mapping[str, Any], value_of: Callable[[tuple[str, str], Any], Any]) -> dict[str, Any]:
    """The data of a bench file with another value of each entry that may name a file."""
    result = dict(data)
    for entry in ENTRIES:
        table, key = entry
        tables = [{**one, key: value_of(entry, one[key])} if key in one else one for one in _tables(result, table)]
        if tables:
            result[table] = tables[0] if isinstance(data[table], Mapping) else type(data[table])(tables)
    return result


def _with_path(entry: tuple[str, str], value: Any, folder: Path) -> Any:  # noqa: ANN401 - whatever the file has
    if is_file(entry, value):
        return str(folder / value)
    return with_network_path(value, folder) if entry[1] == FORMAT and isinstance(value, Mapping) else value


def named(data: Mapping[str, Any], folder: Path = Path()) -> Iterator[str]:
    """Each file's name as written; also files named in the format of a sensor.

    Args:
        data: content of a bench file.
        folder: that relative names start from.
    """
    for entry, written in _written(data):
        yield written
        if entry[1] == FORMAT and (inner := _inner(written, folder)):
            yield str(PurePath(written).parent / inner)


def _network(given: Mapping[str, Any]) -> str:
    """Network description named in a sensor's format that is a table; empty if there is none."""
    return str(given[NETWORK]) if is_dbc(given.get(NETWORK)) else ""


def _tables(data: Mapping[str, Any], name: str) -> list[Mapping[str, Any]]:
    """The table of that name, or every one of a list of them; none where there is something else."""
    given = data.get(name)
    listed = [given] if isinstance(given, Mapping) else list(given) if isinstance(given, (list, tuple)) else []
    return listed if all(isinstance(one, Mapping) for one in listed) else []


def with_contents(dumped: str, data: Mapping[str, Any]) -> str:
    """A bench as JSON text with the contents of its files in place of their paths: what is hashed.

    Args:
        dumped: the text.
        data: the bench's tables, with whole paths.

    Raises:
        FileProblem: a file cannot be read any more.
    """
    for path in named(data):
        digest = hashlib.sha256(read_bytes(Path(path), LARGEST_BYTES)).hexdigest()
        forms = [form for form in (json.dumps(path), json.dumps(path, ensure_ascii=False)) if form in dumped]
        if forms:
            dumped = dumped.replace(forms[0], json.dumps(digest))
        else:
            dumped += digest  # a file that another file names
    return dumped


@dataclass(frozen=True)
class Kept:
    """How the files that a bench file names are kept beside a copy of it.

    Attributes:
        names: for each file's name in the bench file the name in the copy.
        files: for each file's name from the copy's folder the name from the bench file's folder.
    """

    names: dict[str, str]
    files: dict[str, str]


def kept(data: Mapping[str, Any], folder: Path, reserved: Container[str] = ()) -> Kept:
    """Where the files that a bench file names lie beside a copy of it.

    The same path where that leads downwards and no other file has it. A format's network description keeps its place
    relative to the format's file, which names it and whose content is hashed.

    Args:
        data: the bench file's.
        folder: from which the names in it lead.
        reserved: names in the copy's folder that are no file's of the bench.
    """
    names: dict[str, str] = {}
    files: dict[str, str] = {}
    for entry, written in _written(data):
        inner = _inner(written, folder) if entry[1] == FORMAT else ""
        for number in count():
            place = _place(written, inner, number)
            whole = {place: written}
            if inner:
                own = PurePath(inner).name if PurePath(inner).is_absolute() else _path(PurePath(place).parent, inner)
                whole[own] = str(PurePath(written).parent / inner)
            if all(
                PurePath(own).parts[0] not in reserved and _same(files.get(own, source), source, folder)
                for own, source in whole.items()
            ):
                break
        names[written] = place
        files |= whole
    return Kept(names, files)


def renamed(data: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """The data of a bench file with other names of the files that it names."""
    return _with_values(data, lambda entry, value: _renamed(entry, value, names))


def _renamed(entry: tuple[str, str], value: Any, names: Mapping[str, str]) -> Any:  # noqa: ANN401 - whatever the file has
    if isinstance(value, str):
        return names.get(value, value) if is_file(entry, value) else value
    if entry[1] == FORMAT and isinstance(value, Mapping) and _network(value):
        return {**value, NETWORK: names.get(value[NETWORK], value[NETWORK])}
    return value


def _written(data: Mapping[str, Any]) -> Iterator[tuple[tuple[str, str], str]]:
    """Each entry that names a file, and the name; of a format's table that of its network description."""
    for entry in ENTRIES:
        table, key = entry
        for one in _tables(data, table):
            value = one.get(key)
            if isinstance(value, str) and is_file(entry, value):
                yield entry, value
            elif key == FORMAT and isinstance(value, Mapping) and (network := _network(value)):
                yield (table, NETWORK), network


def _inner(written: str, folder: Path) -> str:
    """The network description that a format's file names, as it is written there; empty for none."""
    try:
        inner = read_toml(folder / written).data.get(NETWORK)
    except FileProblem:
        return ""  # reported where the format is read
    return str(inner) if is_dbc(inner) else ""


def _place(written: str, inner: str, number: int) -> str:
    """Where a file is kept: not above the copy's folder, nor the network description that it names."""
    path = PurePath(written)
    path = PurePath(path.name) if path.is_absolute() or ".." in path.parts else path
    if number:
        path = PurePath(f"files-{number}") / path
    relative = inner and not PurePath(inner).is_absolute()
    above = PurePath(_path(path.parent, inner)).parts.count("..") if relative else 0
    return (path.parent.joinpath(*["format"] * above) / path.name).as_posix()


def _path(folder: PurePath, name: str) -> str:
    return PurePath(os.path.normpath(folder / name)).as_posix()


def _same(one: str, other: str, folder: Path) -> bool:
    return os.path.normpath(folder / one) == os.path.normpath(folder / other)
