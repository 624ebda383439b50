"""Descriptions of devices (sensor formats, supplies, roles of signals, register maps): a file or a table of one.

The entries are checked here, by their models; their combination is checked by the driver or protocol that is made from
the plain table. Neither reads a file: a file that a bench file names is read here, once, and passed on as its table.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.devices.supply_file import supply_description_problems
from drivers.register_maps.map_file import map_problems
from drivers.sensor_formats import format_problems
from protocols.descriptions import Problem
from rig.errors import FileProblem
from rig.files.ecu_roles import RolesFile
from rig.files.loader import lines_of, validated
from rig.files.names import is_file
from rig.files.network_text import NETWORK, with_network_path, with_network_text
from rig.files.register_map import RegisterMapFile
from rig.files.section import Section
from rig.files.sensor_format import model_of as sensor_format_model
from rig.files.supply import model_of as supply_model
from rig.files.toml_source import TomlSource, frozen, read_toml
from rig.text_file import stamp

Plain = Mapping[str, Any]


@dataclass(frozen=True)
class Kind:
    """A kind of description.

    Attributes:
        model: what a table must fit.
        problems: what valid entries contradict in each other.
    """

    model: Callable[[Plain], type[Section]]
    problems: Callable[[Plain], Iterable[Problem]]


KINDS: Mapping[str, Kind] = {
    "sensor-format": Kind(sensor_format_model, format_problems),
    "supply": Kind(supply_model, supply_description_problems),
    "register-map": Kind(lambda _: RegisterMapFile, map_problems),
    "ecu-roles": Kind(lambda _: RolesFile, lambda _: ()),  # what they contradict shows with their DBC: `ecu_problems`
}
"""Kinds by the names of `rig schema`."""


def problems_of(kind: str, table: Plain) -> list[Problem]:
    """What is wrong with a table: with its entries, else with what they say together."""
    description, whole = KINDS[kind], frozen(table)
    _, problems = validated(whole, description.model(whole))
    if problems:
        return problems
    try:
        return list(description.problems(with_network_text(whole)))
    except FileProblem as error:
        return [((NETWORK,), problem) for problem in error.problems]


def table_of(kind: str, path: str | Path) -> dict[str, Any]:
    """The checked table of a file, with the file's name as its `name` where it states none.

    Raises:
        FileProblem: it cannot be read, or with every wrong entry of it.
    """
    path = Path(path)
    return _table_of(kind, path, stamp(path))


@functools.lru_cache(maxsize=64)
def _table_of(kind: str, path: Path, written: tuple[int, int] | None) -> dict[str, Any]:
    """Asked for at several places while a bench is read and planned; read again when the file is another one.

    Raises:
        FileProblem: see `table_of`.
    """
    del written
    return checked(kind, read_toml(path))


def checked(kind: str, source: TomlSource) -> dict[str, Any]:
    """The table of a file's text.

    Raises:
        FileProblem: with every wrong entry of it.
    """
    data = with_network_path(source.data, source.path.parent)
    if problems := problems_of(kind, data):
        raise FileProblem(str(source.path), lines_of(source, problems))
    return {"name": source.path.stem, **data}


def entry_problems(kind: str, given: Any) -> list[Problem]:  # noqa: ANN401 - a file's name or a table
    """What is wrong with a description that a file names or holds; of a file of its own each with that file's line."""
    if not is_file(given):
        return problems_of(kind, given)
    try:
        table_of(kind, given)
    except FileProblem as error:
        return [((), f"{Path(given).name}: {problem}") for problem in error.problems]
    return []
