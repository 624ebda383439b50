"""A user's DBC file and the roles of its signals: the errors of each, and their contradictions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drivers.devices.dbc_file import DbcText
from drivers.devices.role_reading import RoleProblem
from drivers.devices.source import source_problems
from protocols.descriptions import Problem
from protocols.errors import LocalProtocolError
from rig.errors import FileProblem
from rig.files.described import described
from rig.files.descriptions import entry_problems
from rig.files.loader import lines_of
from rig.files.names import is_file
from rig.files.network_text import dbc_text
from rig.files.toml_source import read_toml


def ecu_problems(dbc: str, roles: str | Mapping[str, Any]) -> list[Problem]:
    """What is wrong with a user's roles, else with what DBC file and roles say together, by the entries of [ecu].

    Args:
        dbc: path of the DBC file.
        roles: path of the roles file, or its contents.
    """
    if not isinstance(roles, Mapping) and not is_file(roles):
        return [(("roles",), 'must be the name of a .toml file, such as "ecu-roles.toml", or a table')]
    if wrong := entry_problems("ecu-roles", roles):
        return [(("roles", *place), text) for place, text in wrong]
    try:
        given = dbc_text(dbc)
        contradictions = source_problems(given, described("ecu-roles", roles))
    except (LocalProtocolError, FileProblem) as error:
        return [(("dbc",), str(error))]
    of_roles = [(problem.place, problem.text) for problem in contradictions if problem.place]
    of_dbc: list[Problem] = [(("dbc",), _of_dbc(problem, given)) for problem in contradictions if not problem.place]
    if is_file(roles):
        path = Path(str(roles))
        problems = [f"{path.name}: {line}" for line in lines_of(read_toml(path), of_roles)]
        return [*of_dbc, *(((("roles",)), line) for line in problems)]
    return [*of_dbc, *((("roles", *place), text) for place, text in of_roles)]


def _of_dbc(problem: RoleProblem, dbc: DbcText) -> str:
    return f"{dbc.name}: {f'line {problem.line}: ' if problem.line else ''}{problem.text}"
