"""A current source as data: a DBC file with its signals, a TOML file that says what they mean.

A name is a preset described here (`demo_ecu.dbc`, `demo_ecu.toml`); what ends in .dbc is a user's file, and comes with
the path or the contents of a roles file.
"""

from __future__ import annotations

import functools
import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drivers.devices.dbc_file import DBC_ENCODING, DbcMessage, parse_dbc
from drivers.devices.description_file import read_description, read_text
from drivers.devices.ecu_description import EcuDescription
from drivers.devices.ecu_roles import describe
from drivers.devices.role_reading import RoleProblem, RoleProblems
from protocols.errors import LocalProtocolError
from protocols.toml_lines import scan_lines

FOLDER = Path(__file__).parent
DBC_END = ".dbc"


def is_dbc(name: str) -> bool:
    """Whether the name is that of a user's file."""
    return name.lower().endswith(DBC_END)


def current_source(name: str, roles: str | Mapping[str, Any] | None = None) -> EcuDescription:
    """The description of a preset, or of a user's DBC and roles.

    Args:
        name: of a preset, or the path of a DBC file.
        roles: of a user's DBC: path of the roles file, or its contents.

    Raises:
        RoleProblems: roles and DBC cannot be used together.
        LocalProtocolError: there is no such preset, or a file cannot be read.
    """
    if is_dbc(name):
        if roles is None:
            raise LocalProtocolError(f"{name}: no roles are given that say what its signals mean")
        given = read_description(Path(roles)) if isinstance(roles, str) else roles
        return _described(Path(name).stem, read_text(Path(name), DBC_ENCODING), json.dumps(given, default=str), name)
    return _preset(name)


def current_source_problems(name: str, roles: str | Mapping[str, Any] | None) -> list[tuple[tuple[str, ...], str]]:
    """Everything that is wrong with a user's DBC and roles; nothing where all is well.

    Returns:
        Where in the bench file's table [ecu], and what: with file, line and entry where they are files of their own.
    """
    try:
        current_source(name, roles)
    except RoleProblems as wrong:
        if isinstance(roles, str):
            told = _Told(Path(roles))
            return [(("roles",), told.line(problem, Path(name).name)) for problem in wrong.problems]
        dbc = Path(name).name
        return [
            (("roles", *problem.place), problem.text) if problem.place else (("dbc",), _of_dbc(problem, dbc))
            for problem in wrong.problems
        ]
    except LocalProtocolError as wrong:
        return [(("roles" if isinstance(roles, str) and roles in str(wrong) else "dbc",), str(wrong))]
    return []


class _Told:
    """Problems of a roles file with its lines."""

    def __init__(self, path: Path) -> None:
        self._name = path.name
        text = read_text(path)
        self._lines, self._data = scan_lines(text), tomllib.loads(text)

    def line(self, problem: RoleProblem, dbc: str) -> str:
        """One problem: file, line, entry, and what is wrong."""
        if not problem.place:
            return _of_dbc(problem, dbc)
        line = next(
            (self._lines[problem.place[:end]] for end in range(len(problem.place), 0, -1)
             if problem.place[:end] in self._lines), None,
        )  # fmt: skip
        value: Any = self._data
        for key in problem.place:
            value = value.get(key) if isinstance(value, Mapping) else None
        entry = ".".join(problem.place)
        shown = "" if value is None or isinstance(value, Mapping) else f" = {json.dumps(value, default=str)[:60]}"
        return f"{self._name}: {f'line {line}: ' if line else ''}{entry}{shown}: {problem.text}"


def _of_dbc(problem: RoleProblem, dbc: str) -> str:
    return f"{dbc}: {f'line {problem.line}: ' if problem.line else ''}{problem.text}"


def current_source_files(name: str) -> tuple[Path, Path]:
    """DBC and roles file of a preset.

    Raises:
        LocalProtocolError: there is none of that name.
    """
    if name not in current_source_names():
        raise LocalProtocolError(f"no current source {name!r}; known: {', '.join(current_source_names())}")
    return FOLDER / f"{name}_ecu.dbc", FOLDER / f"{name}_ecu.toml"


def current_source_names() -> tuple[str, ...]:
    """Names of the current sources described here."""
    return tuple(sorted(path.stem.removesuffix("_ecu") for path in FOLDER.glob("*_ecu.toml")))


def read_dbc(path: Path) -> dict[str, DbcMessage]:
    """The messages of a DBC file, by name.

    Raises:
        LocalProtocolError: it cannot be read, or is no DBC.
    """
    return _parsed(read_text(path, DBC_ENCODING), str(path))


@functools.lru_cache(8)
def _parsed(content: str, path: str) -> dict[str, DbcMessage]:
    try:
        return parse_dbc(content)
    except LocalProtocolError as error:
        raise LocalProtocolError(f"{path}: {error}") from error


@functools.lru_cache(8)
def _described(name: str, dbc: str, roles: str, path: str) -> EcuDescription:
    """The description of these contents: a bench file asks for it at several places."""
    return describe(name, _parsed(dbc, path), json.loads(roles))


@functools.cache
def _preset(name: str) -> EcuDescription:
    dbc, roles = current_source_files(name)
    messages = read_dbc(dbc)
    data = read_description(roles)
    try:
        return describe(name, messages, data)
    except LocalProtocolError as error:
        raise LocalProtocolError(f"{roles}: {error}") from error
