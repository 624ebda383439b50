"""A current source as data: a DBC file with its signals, a TOML file that says what they mean.

A name is a preset described here (`demo_ecu.dbc`, `demo_ecu.toml`); what ends in .dbc is a user's file, and comes with
the path or the contents of a roles file.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drivers.devices.dbc_file import DBC_ENCODING, DbcMessage, parse_dbc
from drivers.devices.description_file import read_description, read_text
from drivers.devices.ecu_description import EcuDescription
from drivers.devices.ecu_roles import describe
from protocols.errors import LocalProtocolError

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
        return describe(Path(name).stem, read_dbc(Path(name)), given)
    return _preset(name)


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
    content = read_text(path, DBC_ENCODING)
    try:
        return parse_dbc(content)
    except LocalProtocolError as error:
        raise LocalProtocolError(f"{path}: {error}") from error


@functools.cache
def _preset(name: str) -> EcuDescription:
    dbc, roles = current_source_files(name)
    messages = read_dbc(dbc)
    data = read_description(roles)
    try:
        return describe(name, messages, data)
    except LocalProtocolError as error:
        raise LocalProtocolError(f"{roles}: {error}") from error
