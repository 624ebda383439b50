"""Files that a matrix file names, of roads and records: found beside it, hashed by content, kept with a campaign."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

from rig.errors import FileProblem
from rig.vehicle.road_file import road_names

FOLDER = "records"
"""Of a campaign's directory: where copies lie."""
MOST_BYTES = 262_144
NESTED = ("profile", "drive")
"""Tables of a road file that name a CSV file beside it."""


def with_paths(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The data of a matrix file with every file's name as a whole path.

    Args:
        data: as read.
        folder: the matrix file's.
    """
    result = dict(data)
    for table, names in named(data).items():
        whole = tuple(str(folder / name) if name in names else name for name in data["matrix"][table][table])
        result["matrix"] = {**result["matrix"], table: {**result["matrix"][table], table: whole}}
    return result


def named(data: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """Files named by `[matrix.road]` and `[matrix.file]`, as written, by the table's name."""
    matrix = data.get("matrix")
    result = {}
    for table in ("road", "file"):
        inside = matrix.get(table) if isinstance(matrix, Mapping) else None
        names = inside.get(table) if isinstance(inside, Mapping) else None
        if isinstance(names, (list, tuple)) and all(isinstance(name, str) for name in names):
            shipped = road_names() if table == "road" else ()
            result[table] = tuple(name for name in names if name not in shipped)
    return {table: names for table, names in result.items() if names}


def with_whole_names(text: str, folder: Path) -> str:
    """A matrix file's text that may be used in another folder: the names of its files are whole paths.

    Args:
        text: of the matrix file.
        folder: the matrix file's.
    """
    for names in named(tomllib.loads(text)).values():
        for name in names:
            text = _replaced(text, name, str(folder.absolute() / name))
    return text


def kept(text: str, folder: Path) -> tuple[str, dict[str, bytes]]:
    """A matrix file's text with its files under their kept names, and what each of them holds.

    Args:
        text: of the matrix file.
        folder: the matrix file's.

    Raises:
        FileProblem: one cannot be read, or its name stands in the file in a way that cannot be replaced.
    """
    files: dict[str, bytes] = {}
    original, renamed = text, dict[str, dict[str, str]]()
    for table, names in named(tomllib.loads(text)).items():
        for name in names:
            content, beside = _read(folder / name), dict[str, bytes]()
            if table == "road":
                content, beside = _road(content, (folder / name).parent, files)
            own = _free(PurePath(name).name, files)
            files |= {own: content, **beside}
            text = _replaced(text, name, f"{FOLDER}/{own}")
            renamed.setdefault(table, {})[name] = f"{FOLDER}/{own}"
    if tomllib.loads(text) != _expected(tomllib.loads(original), renamed):
        raise FileProblem(
            FOLDER, ["a file's name cannot be replaced in the copy: write it plainly in quotes, and give the file "
                     "a name that is no other entry of the matrix file"],
        )
    return text, files


def _expected(data: dict[str, Any], renamed: Mapping[str, Mapping[str, str]]) -> dict[str, Any]:
    """The data of a matrix file with its files renamed, and nothing else changed."""
    for table, names in renamed.items():
        inside = data["matrix"][table]
        inside[table] = [names.get(name, name) for name in inside[table]]
    return data


def _road(content: bytes, folder: Path, taken: Mapping[str, bytes]) -> tuple[bytes, dict[str, bytes]]:
    """A road file with the CSV file that it names, which stands beside its copy."""
    text = content.decode()
    data = tomllib.loads(text)
    beside = {}
    for table in NESTED:
        if isinstance(data.get(table), Mapping):
            written = str(data[table].get("file"))
            own = _free(PurePath(written).name, taken)
            beside[own] = _read(folder / written)
            text = _replaced(text, written, own)
    return text.encode(), beside


def _replaced(text: str, written: str, own: str) -> str:
    """The text with one quoted name in another's place."""
    return text.replace(json.dumps(written, ensure_ascii=False), json.dumps(own)).replace(
        f"'{written}'", json.dumps(own)
    )


def _free(name: str, taken: Mapping[str, bytes]) -> str:
    number, free = 2, name
    while free in taken:
        number, free = number + 1, f"{number}-{name}"
    return free


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise FileProblem(str(path), [f"cannot be read: {error.strerror}"]) from error
