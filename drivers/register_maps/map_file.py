"""A register map from its table, or by the name of one that comes with the program; checked as a whole."""

from __future__ import annotations

import functools
import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers.capabilities import PRESSURE_LEVELS, WatchdogKind
from drivers.register_maps import needs
from drivers.register_maps.controller_map import ControllerMap, Recipes, Words
from drivers.register_maps.entries import Kept, Table
from drivers.register_maps.indirect import read_indirect
from drivers.register_maps.quantity import Quantity, Value
from drivers.register_maps.read_meanings import number_of, read_bits, read_codes, read_pressure, read_states
from drivers.register_maps.read_quantities import IDENTITY, LIMITS, ROLES, read_modbus, read_quantities
from drivers.register_maps.read_recipes import Recipes as Reader
from drivers.register_maps.read_recipes import read_commands, read_setpoint, read_table, read_watchdog
from drivers.roles import Command, FaultBit, Input, ProgramPhase, Result, WatchdogAction, Waveform
from protocols.descriptions import DescriptionProblems, Problem
from protocols.errors import LocalProtocolError
from protocols.near_miss import meant, near_names

FOLDER = Path(__file__).parents[1] / "devices"
_END = "_controller.toml"
TABLES = (
    "modbus", "quantities", "identity", "state", "pressure", "faults", "inputs", "phase", "results", "command_codes",
    "waveforms", "watchdog_actions", "commands", "recipes", "setpoint", "watchdog", "table", "indirect",
)  # fmt: skip
NEARLY = 0.85
"""Share of letters from which an unused quantity is taken for a misspelt one that means something."""

Described = str | Mapping[str, Any]
"""The name of a map that comes with the program, or the table of a user's."""


def map_problems(table: Mapping[str, Any]) -> Sequence[Problem]:
    """What valid entries of a register map contradict, or what a rig needs of it and is missing."""
    return read_map(table)[1]


def read_map(given: Mapping[str, Any]) -> tuple[ControllerMap | None, list[Problem]]:
    """The map of a table, or None and what is wrong with it.

    Args:
        given: plain values by the keys of a map's file (`rig.files.register_map`), each of its type and range.
    """
    kept = Kept()
    given = _over_base(kept, given)
    if kept.problems:
        return None, kept.problems
    top = Table(kept, (), given)
    if not given.keys() & set(TABLES):
        return None, [((), "this is not a register map: a register map contains [quantities], [state] and "
            "[commands]; see rig schema register-map")]
    for table, why in (("quantities", "this table states which "
        "registers contain the device's values"), ("state", "this table states how the device shows its states")):
        if table not in top:
            top.add(None, f"[{table}] is missing; {why}")
    modbus = read_modbus(top.table("modbus"))
    quantities = read_quantities(top.table("quantities"), modbus)
    words = _words(top, quantities)
    recipes, watchdog = _recipes(top, quantities)
    expected = _identity(top.table("identity"), quantities)
    indirect = read_indirect(top.table("indirect"), quantities, modbus.first_address)
    _misspelt(kept, given, quantities)
    needs.check(kept, quantities, words, recipes, watchdog)
    needs.check_identity(kept, expected, quantities)
    if kept.problems:
        return None, kept.problems
    tried = not top.get("unverified", False)
    return ControllerMap(
        top.get("name", "register map"), quantities,
        replace(needs.capabilities(quantities, words, recipes, watchdog), tried=tried), words, recipes, modbus.rules,
        expected, indirect, modbus.read_while_writing,
    ), []  # fmt: skip


def _over_base(kept: Kept, given: Mapping[str, Any]) -> Mapping[str, Any]:
    """The entries over those of the map that is named as their `base`, less those that they are `without`."""
    name, leaves = given.get("base"), given.get("without", ())
    if name is None:
        if leaves:
            kept.add(("without",), "requires `base`, the map from which entries are removed")
        return given
    if name not in controller_names():
        kept.add(("base",), f"unknown map {name!r:.40}; {meant(name, controller_names())}")
        return given
    merged = {key: dict(value) if isinstance(value, Mapping) else value for key, value in _shipped(name).items()}
    for entry in leaves:
        table, _, key = entry.partition(".")
        held = merged if not key else merged.get(table, {})
        if not isinstance(held, dict) or (key or table) not in held:
            kept.add(("without",), f"{entry!r:.60} is not an entry in {name}")
            continue
        del held[key or table]
    for table, entries in given.items():
        both = isinstance(entries, Mapping) and isinstance(merged.get(table), Mapping)
        merged[table] = {**merged[table], **entries} if both else entries
    return merged


def _words(top: Table, quantities: Mapping[str, Quantity]) -> Words:
    faults, inputs = quantities.get("fault_bits"), quantities.get("inputs")
    return Words(
        states=read_states(top.table("state"), quantities),
        faults=read_bits(top.table("faults"), FaultBit, faults, "fault_bits", quantities),
        inputs=read_bits(top.table("inputs"), Input, inputs, "inputs", quantities),
        commands=read_codes(top.table("command_codes"), Command),
        results=read_codes(top.table("results"), Result),
        waveforms=read_codes(top.table("waveforms"), Waveform),
        phases=read_codes(top.table("phase"), ProgramPhase),
        watchdog_actions=read_codes(top.table("watchdog_actions"), WatchdogAction),
        pressure=read_pressure(top.table("pressure"), quantities),
    )


def _recipes(top: Table, quantities: Mapping[str, Quantity]) -> tuple[Recipes, WatchdogKind]:
    reader = Reader(top.table("recipes"), quantities)
    commands = read_commands(top.table("commands"), reader)
    setpoint = read_setpoint(top.table("setpoint"), reader)
    while_off = top.table("setpoint").get("while_off", True)
    watchdog, feed, time_s = read_watchdog(top.table("watchdog"), reader, bool(setpoint))
    table, values = read_table(top.table("table"), reader)
    reader.check_unused()
    tested = top.table("watchdog").get("tested", PRESSURE_LEVELS[0])
    return Recipes(commands, setpoint, feed, table, values, time_s, tested, while_off), watchdog


def _identity(table: Table, quantities: Mapping[str, Quantity]) -> dict[str, Value]:
    """What must be shown: quantity -> value (SI, or a text)."""
    table.named(quantities, "quantities")
    return {
        name: given if isinstance(given, str) else number_of(table, name, given, quantities[name], ())
        for name, given in table.given.items() if name in quantities
    }


def _misspelt(kept: Kept, given: Mapping[str, Any], quantities: Mapping[str, Quantity]) -> None:
    """Note a quantity that nothing uses and whose name is nearly one that means something."""
    known = (*ROLES, *LIMITS, *IDENTITY)
    used = _names({table: given.get(table) for table in TABLES if table != "quantities"})
    for name in quantities.keys() - used - set(known):
        near = near_names(name, known, cutoff=NEARLY)
        if near and near[0] not in quantities:
            kept.add(("quantities", name), f"not used; did you mean {near[0]}?")


def _names(value: object) -> set[str]:
    """Every key and every text in a value."""
    if isinstance(value, Mapping):
        return set(value).union(*(_names(inner) for inner in value.values()))
    if isinstance(value, (list, tuple)):
        return set[str]().union(*(_names(inner) for inner in value))
    return {value} if isinstance(value, str) else set()


def controller(given: Described) -> ControllerMap:
    """The register map of a name, or of a table.

    Raises:
        LocalProtocolError: there is none of that name.
        DescriptionProblems: the table contradicts itself.
    """
    if isinstance(given, str) and given not in controller_names():
        raise LocalProtocolError(f"unknown controller {given!r}; known: {', '.join(controller_names())}")
    return _controller(json.dumps(_shipped(given) if isinstance(given, str) else given, default=str))


@functools.lru_cache(maxsize=32)
def _controller(table: str) -> ControllerMap:
    """The map of these contents: a bench asks for it at several places.

    Raises:
        DescriptionProblems: the table contradicts itself.
    """
    given = json.loads(table)
    made, problems = read_map(given)
    if made is None:
        raise DescriptionProblems(str(given.get("name", "register map")), problems)
    return made


@functools.cache
def _shipped(name: str) -> Mapping[str, Any]:
    """The table of a map that comes with the program."""
    return tomllib.loads((FOLDER / f"{name}{_END}").read_text(encoding="utf-8"))


@functools.cache
def controller_names() -> tuple[str, ...]:
    """Names of the maps that come with the program."""
    return tuple(sorted(path.name.removesuffix(_END) for path in FOLDER.glob(f"*{_END}")))
