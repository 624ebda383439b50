"""Addresses of devices in a bench file: serial ports, CAN interfaces, Modbus addresses; nothing is opened."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any
from urllib.parse import urlsplit

from drivers.can_library import missing_for
from drivers.catalogue import (
    DbcText,
    actuator_names,
    check_actuator,
    check_current_source,
    known_current_source_names,
    own_names,
    supply_names,
)
from drivers.connection import ActuatorAddress, LinkKind
from drivers.plugins import CURRENT_SOURCES, BrokenPlugIn
from protocols.descriptions import Problem
from protocols.errors import ProtocolError
from protocols.near_miss import near_names
from rig.files.names import is_dbc

SCHEMES = ("socket", "rfc2217", "loop", "spy", "alt", "hwgrep", "cp2110")
"""What pyserial's `serial_for_url` takes before "://"; a test compares this list with it."""
_WITH_HOST = frozenset({"socket", "rfc2217"})

INTERFACES = (
    "socketcan", "slcan", "pcan", "kvaser", "vector", "ixxat", "canalystii", "cantact", "etas", "gs_usb", "iscan",
    "neousys", "neovi", "nican", "nixnet", "robotell", "seeedstudio", "serial", "socketcand", "systec", "udp_multicast",
    "usb2can", "virtual",
)  # fmt: skip
"""python-can's own interfaces; a test compares this list with it, because importing python-can takes long."""

LAST_SERIAL_ID = 247
"""Of the unit addresses of Modbus RTU, which begin at 1; 0 is a broadcast."""

_PLUGINS = "can.interface"
_MAKERS = {"peak": "pcan", "pcan_usb": "pcan", "can0": "socketcan", "vcan": "socketcan", "candle": "gs_usb"}
"""What people call an interface, and its name in python-can."""


def serial_url(text: str) -> str:
    """Check a serial port's name or URL.

    Raises:
        ValueError: an unknown scheme, or no host and port where the scheme needs them.
    """
    scheme, separator, _ = text.partition("://")
    if scheme == LinkKind.MODBUS_TCP:
        _host_and_port(text, "modbus-tcp://192.168.0.40:502")
        return text
    if not separator:
        name, colon, rest = text.partition(":")
        if colon and (name in SCHEMES or (rest.isdigit() and "/" not in name)):
            raise ValueError(f'not a serial port; for a serial device server, write "socket://{_address(text)}"')
        return text
    if scheme not in SCHEMES:
        hint = _close(scheme, SCHEMES)
        known = f'did you mean "{hint}://"?' if hint else f"known: {', '.join(f'{name}://' for name in SCHEMES)}"
        raise ValueError(f"unknown kind of port {scheme}:// ({known}); a local port has a name such as /dev/ttyUSB0")
    if scheme in _WITH_HOST:
        _host_and_port(text, f"{scheme}://192.168.0.7:4001")
    return text


def supply_url(text: str) -> str:
    """Check a supply's address: a serial port as `serial_url` takes it, `tcp://host:port`, or one of Modbus.

    Raises:
        ValueError: it is neither.
    """
    if text.startswith("tcp://"):
        _host_and_port(text, "tcp://192.168.0.20:5025")
        return text
    return modbus_url(text) if is_modbus(text) else serial_url(text)


def is_modbus(text: str) -> bool:
    """Whether an address is one of Modbus."""
    return ActuatorAddress.parse(text).kind in {LinkKind.MODBUS_TCP, LinkKind.MODBUS_RTU}


def modbus_url(text: str) -> str:
    """Check the controller's address.

    Raises:
        ValueError: none of `modbus-tcp://host:port`, `tcp://host:port`, `modbus-rtu:` and a serial port.
    """
    given = ActuatorAddress.parse(text)
    if given.kind in {LinkKind.MODBUS_TCP, LinkKind.TCP}:
        _host_and_port(text, f"{given.kind}://192.168.0.10:502")
    elif given.kind is LinkKind.MODBUS_RTU and given.line:
        serial_url(given.line)
    else:
        raise ValueError('must have a form such as "modbus-tcp://192.168.0.10:502" or "modbus-rtu:/dev/ttyUSB0"')
    return text


def known_actuator(name: str) -> str:
    """Check the name of a kind of actuator, in place of the file of a register map.

    Raises:
        ValueError: unknown; the known ones are named. Or its driver cannot be used.
    """
    return _described(
        _known(name, actuator_names(), '; specify your own register map by its file name, such as "my-map.toml"'),
        check_actuator,
    )


def known_supply(name: str) -> str:
    """Check the name of a preset of a supply, in place of a file or a table.

    Raises:
        ValueError: unknown; the known ones are named.
    """
    return _known(name, supply_names(), ", or a file NAME.toml")


def known_current_source(name: str | DbcText) -> str | DbcText:
    """Check the name of a kind of current source against those there is a description of, and that description.

    A DBC file is checked together with its roles (`ecu_problems`); the station has its text.

    Raises:
        ValueError: unknown; the known ones are named. Or its driver cannot be used.
    """
    if not isinstance(name, str) or is_dbc(name):
        return name
    return _described(_known(name, known_current_source_names()), check_current_source)


def ecu_problems(dbc: str | DbcText, roles: str | Mapping[str, Any] | None) -> Iterator[Problem]:
    """What a current source's DBC and roles state wrong, each separately and together; of the station's nothing."""
    if isinstance(dbc, DbcText):
        return
    if not is_dbc(dbc):
        if roles is not None and (dbc in own_names(CURRENT_SOURCES) or not isinstance(roles, Mapping)):
            yield ("roles",), (
                f'applies only to a DBC file; "{dbc}" already defines the meaning of its signals. Fix: remove this '
                "entry"
            )
    elif roles is None:
        yield ("dbc",), (
            'a DBC file requires roles, which define the meaning of its signals. Fix: write roles = "ecu-roles.toml" '
            "or a table [ecu.roles]; see docs/how-to/connect-an-ecu-by-dbc.md"
        )  # fmt: skip
    else:
        from rig.files.ecu_files import ecu_problems as problems  # loads the validator, which has called this

        yield from problems(dbc, roles)


def _known(name: str, known: tuple[str, ...], way: str = "") -> str:
    if name not in known:
        raise ValueError(f"unknown {name!r}; known: {', '.join(known)}{way}")
    return name


def _described(name: str, check: Callable[[str], None]) -> str:
    try:
        check(name)
    except ProtocolError as error:
        raise ValueError(f"the description of {name} cannot be used: {error}") from error
    except BrokenPlugIn as error:
        raise ValueError(str(error)) from error
    return name


def can_interface(text: str) -> str:
    """Check the name of a CAN interface against what python-can and its plugins provide.

    Raises:
        ValueError: unknown; the nearest name is suggested. Or its package is not installed.
    """
    if text in INTERFACES:
        missing = missing_for(text)
        if missing:
            raise ValueError(f"a package that python-can requires for this interface is not installed: {missing}")
        return text
    from importlib.metadata import entry_points

    known = (*INTERFACES, *(entry.name for entry in entry_points(group=_PLUGINS)))
    if text in known:
        return text
    folded = text.casefold()
    hint = folded if folded in known else _MAKERS.get(folded) or _close(folded, known)
    hint_text = f'did you mean "{hint}"? ' if hint else ""
    raise ValueError(f"unknown python-can interface; {hint_text}known: {', '.join(known)}")


def _host_and_port(text: str, example: str) -> None:
    try:
        parts = urlsplit(text)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise ValueError(f'{str(error)[:1].lower()}{str(error)[1:]}; expected a form such as "{example}"') from error
    if not host or not port:
        raise ValueError(f'requires a host and a port from 1 to 65535, for example "{example}"')


def _address(text: str) -> str:
    """What follows a scheme written without its slashes."""
    name, _, rest = text.partition(":")
    return rest.lstrip("/") if name in SCHEMES else text


def _close(name: str, known: tuple[str, ...]) -> str | None:
    return next(iter(near_names(name, known)), None)
