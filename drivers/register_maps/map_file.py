"""A register map's file, by its path or as the name of one that comes with the program; judged as a whole."""

from __future__ import annotations

import difflib
import functools
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers.capabilities import WatchdogKind
from drivers.register_maps import needs
from drivers.register_maps.controller_map import ControllerMap, Recipes, Words
from drivers.register_maps.entries import Source, Table, nearest
from drivers.register_maps.indirect import read_indirect
from drivers.register_maps.quantity import Quantity, Value
from drivers.register_maps.read_meanings import number_of, read_bits, read_codes, read_pressure, read_states
from drivers.register_maps.read_quantities import IDENTITY, LIMITS, ROLES, read_modbus, read_quantities
from drivers.register_maps.read_recipes import Recipes as Reader
from drivers.register_maps.read_recipes import read_commands, read_setpoint, read_table, read_watchdog
from drivers.roles import Command, FaultBit, Input, ProgramPhase, Result, WatchdogAction, Waveform
from protocols.errors import LocalProtocolError

FOLDER = Path(__file__).parents[1] / "devices"
SUFFIX = ".toml"
_END = "_controller"
FORMAT = 1
TABLES = (
    "modbus", "quantities", "identity", "state", "pressure", "faults", "inputs", "phase", "results", "command_codes",
    "waveforms", "watchdog_actions", "commands", "recipes", "setpoint", "watchdog", "table", "indirect",
)  # fmt: skip
KEYS = ("format", "name", "description", "unverified", "base", "without", *TABLES)
SOURCES = ("commands", "setpoint", "watchdog", "table", "recipes")


@functools.lru_cache(maxsize=32)
def _load(path: Path, stamp: tuple[int, int]) -> ControllerMap:
    del stamp
    return read_map(Source.read(path))


def load_map(path: Path) -> ControllerMap:
    """Read a register map.

    Raises:
        LocalProtocolError: it cannot be read, or is no register map: everything that is wrong, with its line.
    """
    try:
        about = path.stat()
        stamp = (about.st_mtime_ns, about.st_size)
    except OSError:
        stamp = (0, 0)
    return _load(path, stamp)


def read_map(source: Source) -> ControllerMap:
    """The map of a file's values.

    Raises:
        MapProblem: everything that is wrong.
    """
    top = Table(source, (), source.data)
    top.only(KEYS)
    _take_over(source, top)
    top = Table(source, (), source.data)
    if not set(TABLES) & source.data.keys():
        source.add((), "no register map: one has [quantities], [state] and [commands]; see rig schema register-map")
        source.finish()
    top.whole("format", FORMAT, FORMAT, FORMAT)
    top.text("description")
    modbus = read_modbus(top.table("modbus"))
    quantities = read_quantities(top.table("quantities", needed="where are the device's values?"), modbus)
    words = _words(top, quantities)
    recipes, watchdog = _recipes(top, quantities)
    expected = _identity(top.table("identity"), quantities)
    indirect = read_indirect(top.table("indirect"), quantities, modbus.first_address)
    _misspelt(source, quantities)
    needs.check(source, quantities, words, recipes, watchdog)
    needs.check_identity(source, expected, quantities)
    tried = not top.truth("unverified", default=False)
    source.finish()
    return ControllerMap(
        top.text("name") or source.path.stem, quantities,
        replace(needs.capabilities(quantities, words, recipes, watchdog), tried=tried), words, recipes, modbus.rules,
        expected, indirect, modbus.read_while_writing,
    )  # fmt: skip


def _take_over(source: Source, top: Table) -> None:
    """Put the file's entries over those of the map that it names as its `base`, less those that it is `without`."""
    name, leaves = top.text("base"), top.given.get("without", [])
    if not isinstance(leaves, list) or not all(isinstance(entry, str) for entry in leaves) or (leaves and not name):
        top.add("without", 'must be a list of entries of the base, such as ["commands.start", "table"]')
        return
    if not name:
        return
    if name not in controller_names():
        top.add("base", f"{name!r:.40} is not known; {nearest(name, controller_names())}")
        source.finish()
    merged: dict[str, Any] = {
        table: dict(entries) if isinstance(entries, Mapping) else entries
        for table, entries in Source.read(FOLDER / f"{name}{_END}{SUFFIX}").data.items()
    }
    for entry in leaves:
        table, _, key = entry.partition(".")
        held = merged if not key else merged.get(table, {})
        if not isinstance(held, dict) or (key or table) not in held:
            top.add("without", f"{entry!r:.60} is nothing that {name} has")
            continue
        del held[key or table]
    for table, entries in source.data.items():
        both = isinstance(entries, Mapping) and isinstance(merged.get(table), Mapping)
        merged[table] = {**merged[table], **entries} if both else entries
    source.data = merged


def _words(top: Table, quantities: Mapping[str, Quantity]) -> Words:
    faults, inputs = quantities.get("fault_bits"), quantities.get("inputs")
    return Words(
        states=read_states(top.table("state", needed="what do the device's states mean?"), quantities),
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
    watchdog, feed, time_s = read_watchdog(top.table("watchdog"), reader, bool(setpoint))
    table, values = read_table(top.table("table"), reader)
    reader.check_unused()
    return Recipes(commands, setpoint, feed, table, values, time_s), watchdog


def _identity(table: Table, quantities: Mapping[str, Quantity]) -> dict[str, Value]:
    """What must be shown: quantity -> value (SI, or a text)."""
    table.only(list(quantities))
    result: dict[str, Value] = {}
    for name in table:
        given, quantity = table.given[name], quantities.get(name)
        if quantity is not None:
            result[name] = given if isinstance(given, str) else number_of(table, name, given, quantity, ())
    return result


def _misspelt(source: Source, quantities: Mapping[str, Quantity]) -> None:
    """A quantity that nothing uses and whose name is nearly one that means something."""
    known = (*ROLES, *LIMITS, *IDENTITY)
    used = _names({table: source.data.get(table) for table in TABLES if table != "quantities"})
    for name in quantities.keys() - used - set(known):
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.85)
        if near and near[0] not in quantities:
            source.add(("quantities", name), f"nothing uses it, and its name is nearly {near[0]}; did you mean that?")


def _names(value: object) -> set[str]:
    """Every key and every text in a value."""
    if isinstance(value, Mapping):
        return set(value).union(*(_names(inner) for inner in value.values()))
    if isinstance(value, list):
        return set[str]().union(*(_names(inner) for inner in value))
    return {value} if isinstance(value, str) else set()


def is_map_file(name: str) -> bool:
    """Whether a name is the path of a user's own map."""
    return name.casefold().endswith(SUFFIX)


def controller(name: str) -> ControllerMap:
    """The register map of a name, or of a path that ends in .toml.

    Raises:
        LocalProtocolError: there is none, or it cannot be used.
    """
    if is_map_file(name):
        return load_map(Path(name))
    if name not in controller_names():
        raise LocalProtocolError(f"no controller {name!r}; known: {', '.join(controller_names())}")
    return load_map(FOLDER / f"{name}{_END}{SUFFIX}")


def controller_names() -> tuple[str, ...]:
    """Names of the maps that come with the program."""
    return tuple(sorted(path.stem.removesuffix(_END) for path in FOLDER.glob(f"*{_END}{SUFFIX}")))
