"""Files that a matrix file names (roads, records, a fit, bands): located, hashed by content, copied to the campaign."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem
from rig.matrix.assumed_damper import is_fit_file
from rig.text_file import LARGEST_NAMED_FILE_BYTES, read_bytes
from rig.vehicle.road_file import road_names

MOST_BYTES = 262_144
Place = tuple[str | int, ...]
"""Keys down to an entry; a number in a list of tables."""
ROAD, RECORD, PRIOR = ("matrix", "road", "road"), ("matrix", "file", "file"), ("specimen", "prior")
LOGO, BANDS, SPECIMENS = ("report", "logo"), ("acceptance", "bands"), ("line", "simulated")
PLACES: tuple[Place, ...] = (ROAD, RECORD, PRIOR, LOGO, BANDS, SPECIMENS)
"""Entries that may name files, in addition to `file` of each `[[endurance]]`."""
ENDURANCE = "endurance"
LISTS = frozenset({ROAD, RECORD})
"""Those that name a list of files and not one."""
NESTED = ("profile", "drive")
"""Tables of a road file that name a CSV file beside it."""


def with_paths(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The data of a matrix file with every file's name as a whole path.

    Args:
        data: as read.
        folder: the matrix file's.
    """
    whole = {
        place: {name: str(folder / name) for name in names} for place, names in named(data).items()
    }
    return _renamed(data, whole)


def named(data: Mapping[str, Any]) -> dict[Place, tuple[str, ...]]:
    """Files that the entries of `PLACES` name, by their entry."""
    result = {}
    tests = data.get(ENDURANCE)
    of_tests = [(ENDURANCE, number, "file") for number in range(len(tests) if isinstance(tests, (list, tuple)) else 0)]
    for place in (*PLACES, *of_tests):
        value = _entry(data, place)
        names = value if place in LISTS else (value,)
        if isinstance(names, (list, tuple)) and all(isinstance(name, str) for name in names):
            result[place] = tuple(name for name in names if _is_file(place, name))
    return {place: names for place, names in result.items() if names}


def _is_file(place: Place, name: str) -> bool:
    """Whether an entry's value is a file's name, and not that of something that comes with the program."""
    return is_fit_file(name) if place == PRIOR else place != ROAD or name not in road_names()


def _entry(data: object, place: Place) -> object:
    for key in place:
        if isinstance(data, (list, tuple)) and isinstance(key, int):
            data = data[key]
        else:
            data = data.get(key) if isinstance(data, Mapping) else None
    return data


def _renamed(data: Mapping[str, Any], names: Mapping[Place, Mapping[str, str]]) -> dict[str, Any]:
    """The data of a matrix file with its files renamed, and nothing else changed."""
    result: Any = data
    for place, new in names.items():
        result = _replaced_at(result, place, new)
    return dict(result)


def _replaced_at(data: Any, place: Place, new: Mapping[str, str]) -> Any:  # noqa: ANN401 - as it was read
    """A copy of tables and lists in which the files of one entry are renamed."""
    if not place:
        return new.get(data, data) if isinstance(data, str) else type(data)(new.get(name, name) for name in data)
    key, *rest = place
    inner = _replaced_at(data[key], tuple(rest), new)
    if isinstance(data, Mapping):
        return {**data, key: inner}
    return type(data)(inner if number == key else value for number, value in enumerate(data))


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
    original, renamed = text, dict[Place, dict[str, str]]()
    for place, names in named(tomllib.loads(text)).items():
        for name in names:
            content, beside = read_bytes(folder / name, LARGEST_NAMED_FILE_BYTES), dict[str, bytes]()
            if place == ROAD:
                content, beside = _road(content, (folder / name).parent, files)
            own = _free(PurePath(name).name, files)
            files |= {own: content, **beside}
            text = _replaced(text, name, f"{CampaignFolder.records}/{own}")
            renamed.setdefault(place, {})[name] = f"{CampaignFolder.records}/{own}"
    if tomllib.loads(text) != _renamed(tomllib.loads(original), renamed):
        raise FileProblem(
            CampaignFolder.records,
            ["the file name cannot be replaced in the copy of the matrix file. Fix: write the name in quotes without "
             "escapes, and choose a name that is not also another value in the matrix file"],
        )
    return text, files


def _road(content: bytes, folder: Path, taken: Mapping[str, bytes]) -> tuple[bytes, dict[str, bytes]]:
    """A road file with the CSV file that it names, which stands beside its copy."""
    text = content.decode()
    data = tomllib.loads(text)
    beside = {}
    for table in NESTED:
        if isinstance(data.get(table), Mapping):
            written = str(data[table].get("file"))
            own = _free(PurePath(written).name, taken)
            beside[own] = read_bytes(folder / written, LARGEST_NAMED_FILE_BYTES)
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
