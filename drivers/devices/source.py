"""A current source as data: a DBC file with its signals, and a table that states what they mean.

A name is a preset described here (`demo_ecu.dbc`, `demo_ecu.toml`); a user's DBC comes as its text, with the table of
its roles.
"""

from __future__ import annotations

import functools
import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from drivers.devices.dbc_file import DBC_ENCODING, DbcMessage, DbcText, parse_dbc
from drivers.devices.ecu_description import EcuDescription
from drivers.devices.ecu_roles import describe
from drivers.devices.role_reading import RoleProblem, RoleProblems
from protocols.errors import LocalProtocolError

FOLDER = Path(__file__).parent

Given = str | DbcText
"""The name of a preset, or a user's DBC."""


def current_source(given: Given, roles: Mapping[str, Any] | None = None) -> EcuDescription:
    """The description of a preset, or of a user's DBC and roles.

    Args:
        given: the name of a preset, or a user's DBC.
        roles: of a user's DBC: plain values by the keys of a roles file (`rig.files.ecu_roles`), each of its type.

    Raises:
        RoleProblems: roles and DBC cannot be used together.
        LocalProtocolError: there is no such preset, or it is not a DBC.
    """
    if isinstance(given, str):
        return _preset(given)
    if roles is None:
        raise LocalProtocolError(f"{given.name}: no roles are specified; roles define the meaning of the signals")
    return _described(given, json.dumps(roles, default=str))


def source_problems(given: DbcText, roles: Mapping[str, Any]) -> Sequence[RoleProblem]:
    """Everything that a user's DBC and valid roles contradict in each other.

    Raises:
        LocalProtocolError: it is not a DBC.
    """
    try:
        current_source(given, roles)
    except RoleProblems as wrong:
        return wrong.problems
    return ()


def current_source_names() -> tuple[str, ...]:
    """Names of the current sources described here."""
    return tuple(sorted(path.stem.removesuffix("_ecu") for path in FOLDER.glob("*_ecu.toml")))


@functools.lru_cache(8)
def read_dbc(given: DbcText) -> dict[str, DbcMessage]:
    """The messages of a DBC, by name.

    Raises:
        LocalProtocolError: it is not a DBC.
    """
    try:
        return parse_dbc(given.text, given.format)
    except LocalProtocolError as error:
        raise LocalProtocolError(f"{given.name}: {error}") from error


@functools.lru_cache(8)
def _described(given: DbcText, roles: str) -> EcuDescription:
    """The description of these contents: a bench file asks for it at several places."""
    return describe(given.stem, read_dbc(given), json.loads(roles))


@functools.cache
def preset(name: str) -> tuple[DbcText, Mapping[str, Any]]:
    """DBC and roles of a preset.

    Raises:
        LocalProtocolError: there is none of that name.
    """
    if name not in current_source_names():
        raise LocalProtocolError(f"unknown current source {name!r}; known: {', '.join(current_source_names())}")
    dbc, roles = FOLDER / f"{name}_ecu.dbc", FOLDER / f"{name}_ecu.toml"
    return DbcText(dbc.name, dbc.read_text(DBC_ENCODING)), tomllib.loads(roles.read_text(encoding="utf-8"))


@functools.cache
def _preset(name: str) -> EcuDescription:
    dbc, roles = preset(name)
    return describe(name, read_dbc(dbc), roles)
