"""A supply from its table, or by the name of one that comes with the program."""

from __future__ import annotations

import functools
import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from drivers.current_source import SourceFault
from drivers.devices.output_file import is_output, read_output
from drivers.devices.supply import (
    Commands,
    SupplyCommands,
    SupplyDescription,
    SupplyLink,
    SupplyWatchdog,
    current_range,
)
from drivers.register_maps.entries import listed
from protocols.descriptions import DescriptionProblems, Place, Problem
from protocols.errors import LocalProtocolError
from protocols.patterns import Pattern
from protocols.scpi import Command

FOLDER = Path(__file__).parent
ENDING = "_supply.toml"
COMMANDS = tuple(item.name for item in fields(SupplyCommands))
FAULTS = {"over-temperature": SourceFault.OVER_TEMPERATURE, "undervoltage": SourceFault.UNDERVOLTAGE,
           "open": SourceFault.OPEN, "short": SourceFault.SHORT}
_CARRIES = {"set_current": "current", "set_voltage_limit": "voltage"}
_QUERIES = ("identify", "measure_current", "measure_voltage", "read_output", "error_queue", "read_faults")

Described = str | Mapping[str, Any]
"""The name of a preset, or the table of a user's supply."""


def read_supply(given: Mapping[str, Any]) -> tuple[SupplyDescription | None, list[Problem]]:
    """A supply's description, or None and what its entries contradict.

    Args:
        given: plain values by the keys of a supply's file (`rig.files.supply`), each of its type and range.
    """
    name = given.get("name", "supply")
    if is_output(given):
        return read_output(given, name)
    problems: list[Problem] = []
    commands = _commands(given["commands"], problems)
    ranges, sent = given["range"], given.get("watchdog")
    current_A = current_range(ranges["current_A"])
    voltage_V = current_range(ranges["voltage_V"]) if "voltage_V" in ranges else None
    watchdog = None if sent is None else _watchdog(sent, problems)
    bits = given.get("faults", {})
    if bits and not commands.read_faults:
        problems.append((("faults",), "defines the bits of an answer, but its query is missing. Fix: write the "
            "query as read_faults under [commands]"))
    if commands.read_faults and not bits:
        problems.append((("commands", "read_faults"), "the answer contains bits whose meaning is not defined. Fix: "
            "define the bits under [faults]"))
    problems += _missing(commands, current_A, voltage_V)
    if problems:
        return None, problems
    return SupplyDescription(
        name, _link(given.get("link", {})), commands, current_A, voltage_V, watchdog, given.get("maker", ""),
        given.get("model", ""), given.get("tried", ""), 1e-3 * given.get("settling_ms", 300),
        **_answers(given.get("answers", {})),
        faults=tuple((1 << bit, int(FAULTS[fault])) for fault, bit in bits.items()),
    ), []  # fmt: skip


def supply_description_problems(table: Mapping[str, Any]) -> list[Problem]:
    """What valid entries of a supply's table contradict."""
    return read_supply(table)[1]


def _link(given: Mapping[str, Any]) -> SupplyLink:
    own = {key: value for key, value in given.items() if key not in {"gap_ms", "acknowledge"}}
    acknowledge = given.get("acknowledge", "")
    return SupplyLink(
        **own, gap_s=1e-3 * given.get("gap_ms", 0.0), acknowledge=Pattern(acknowledge) if acknowledge else None
    )


def _some(given: Any, place: Place, problems: list[Problem]) -> Commands:  # noqa: ANN401 - one text or several
    """A command, or a list of them."""
    commands = []
    for text in listed(given):
        try:
            commands.append(Command.of(text))
        except LocalProtocolError as error:
            problems.append((place, str(error)))
    return tuple(commands)


def _commands(given: Mapping[str, Any], problems: list[Problem]) -> SupplyCommands:
    commands = {name: _some(sent, ("commands", name), problems) for name, sent in given.items()}
    for name, sent in commands.items():
        problems += (((("commands", name)), text) for text in _unfit(name, sent))
    return SupplyCommands(**commands)


def _unfit(name: str, sent: Commands) -> Iterator[str]:
    """Whether commands carry the number they are for, and no other, and answer where they must."""
    allowed = _CARRIES.get(name)
    carried = frozenset[str]().union(*(command.quantities for command in sent))
    if allowed and sent and allowed not in carried:
        unit = "current_A" if allowed == "current" else "voltage_V"
        yield f'does not contain the {allowed}; write, for example, "... {{{unit}:.3f}}"'
    if extra := carried - {allowed}:
        yield f"contains {' and '.join(sorted(extra))}, which is not allowed here"
    if name in _QUERIES and len(sent) != 1:
        yield "must be a single command, because its answer is read"
    if name not in _QUERIES and any(command.is_query for command in sent):
        yield "is a query (?), but this command sets a value"


def _watchdog(given: Mapping[str, Any], problems: list[Problem]) -> SupplyWatchdog:
    sent = {
        name: _some(given[name], ("watchdog", name), problems) for name in ("start", "stop", "feed") if name in given
    }
    for name, commands in sent.items():
        if any(command.quantities - {"time"} for command in commands):
            problems.append((("watchdog", name), "may contain only {time_s} or {time_ms}"))
    return SupplyWatchdog(float(given["time_s"]), **sent)


def _answers(given: Mapping[str, Any]) -> dict[str, Any]:
    patterns = ("identity", "no_error", "current", "voltage")
    read: dict[str, Any] = {name: Pattern(given[name]) for name in patterns if given.get(name)}
    return read | ({"on": tuple(listed(given["on"]))} if "on" in given else {})


def supply_names() -> tuple[str, ...]:
    """Every preset."""
    return tuple(sorted(path.name.removesuffix(ENDING) for path in FOLDER.glob(f"*{ENDING}")))


def supply(given: Described) -> SupplyDescription:
    """The description of a preset, or of a table.

    Raises:
        LocalProtocolError: no such preset.
        DescriptionProblems: the table contradicts itself.
    """
    if isinstance(given, str):
        return _preset(given)
    description, problems = read_supply(given)
    if description is None:
        raise DescriptionProblems(str(given.get("name", "supply")), problems)
    return description


@functools.cache
def _preset(name: str) -> SupplyDescription:
    """The preset of that name.

    Raises:
        LocalProtocolError: there is none, or it cannot be used.
    """
    if name not in supply_names():
        known = ", ".join(supply_names())
        raise LocalProtocolError(f"unknown supply {name!r}; known: {known}, or your own file (NAME.toml)")
    return supply({"name": name, **tomllib.loads((FOLDER / f"{name}{ENDING}").read_text(encoding="utf-8"))})


def _missing(
    commands: SupplyCommands, current_A: tuple[float, float], voltage_V: tuple[float, float] | None
) -> Iterator[Problem]:
    """What nothing can be run without."""
    if bool(commands.output_on) != bool(commands.output_off):
        absent = "output_off" if commands.output_on else "output_on"
        yield ("commands", absent), "is missing; specify both output_on and output_off, or neither"
    if not (current_A[0] <= 0.0 <= current_A[1] or commands.output_off):
        yield ("range", "current_A"), (
            "does not include 0 A, and there is no output_off, so the coil could not be switched off"
        )
    if math.isclose(max(map(abs, current_A)), 0.0):
        yield ("range", "current_A"), "does not allow any current"
    if voltage_V is not None and not commands.set_voltage_limit:
        yield ("range", "voltage_V"), "is given, but [commands] has no set_voltage_limit"
