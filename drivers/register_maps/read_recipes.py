"""The tables [commands], [recipes], [setpoint], [watchdog] and [table] of a register map."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from drivers.capabilities import WatchdogKind
from drivers.register_maps.entries import Table, listed
from drivers.register_maps.meanings import word
from drivers.register_maps.quantity import HOLDING, Quantity, Value
from drivers.register_maps.read_meanings import number_of, read_condition
from drivers.register_maps.recipe import (
    MOVE,
    PROGRAM,
    SETPOINT,
    TABLE,
    WATCHDOG,
    Pause,
    Recipe,
    Step,
    Wait,
    Write,
    names_for,
)
from drivers.roles import Command
from protocols.near_miss import meant

Quantities = Mapping[str, Quantity]

STEPS = ("write", "wait", "pause", "recipe")
COMMANDS = {word(command): command for command in Command if command is not Command.NONE}
LONGEST_SPAN = 123
MOST_CALLS = 500
"""Recipes run by recipes, in one file: a few lines can ask for more than there will ever be time for."""
MEASURES = {
    "target": "length", "position": "length", "amplitude": "length", "peak_to_peak": "length", "centre": "length",
    "low": "length", "high": "length", "speed": "speed", "peak_speed": "speed", "mean_speed": "speed",
    "velocity": "speed",
    "frequency": "frequency", "period": "time", "duration": "time", "table_interval": "time", "values": "length",
}  # fmt: skip
"""What a recipe's names measure, where the quantity's unit must measure the same."""
COUNTS = {"counter": (0, 0xFFFF), "sequence": (0, 0xFFFF), "owner": (1, 0xFFFF), "toggle": (0, 1)}
"""Lowest and highest number of a recipe's names that count: the quantity must show each of them."""
KINDS = ("counter", "keep-alive", "setpoints", "none")
LONGEST_SETPOINT_S = 0.1
"""Longest total wait in the steps of a set-point (s), because a stop may have to wait for the poll."""


class Recipes:
    """Reads recipes; a recipe that runs others by name is made of their steps."""

    def __init__(self, named: Table, quantities: Quantities) -> None:
        self._named = named
        self._quantities = quantities
        self._used: set[str] = set()
        self._calls = 0

    def read(self, table: Table, key: str, names: Collection[str], under: tuple[str, ...] = ()) -> Recipe:
        """The steps of an entry.

        Args:
            table: holds it.
            key: its name there.
            names: what it may ask for, without the "$".
            under: the named recipes that led here.
        """
        given = table.get(key)
        result: list[Step] = []
        for place, step in enumerate(listed(given)):
            where = (*table.place, key) if isinstance(given, Mapping) else (*table.place, key, place)
            result += self._step(Table(table.source, where, step), names, under)
        return tuple(result)

    def _step(self, step: Table, names: Collection[str], under: tuple[str, ...]) -> Recipe:
        if "pause" in step:
            return (Pause(step.time_s("pause")),)
        if "wait" in step:
            return (Wait(read_condition(step, "wait", self._quantities, names), step.time_s("within")),)
        if "recipe" in step:
            return self._call(step, names, under)
        return (Write(read_values(step, "write", self._quantities, names), self._span(step)),)

    def _call(self, step: Table, names: Collection[str], under: tuple[str, ...]) -> Recipe:
        name = step.get("recipe")
        if name not in self._named:
            step.add(None, f"recipe {name!r} is not in [recipes]; {meant(name, self._named)}")
            return ()
        if name in under:
            step.add(None, f"the recipe calls itself ({' -> '.join((*under, name))}) and would never end")
            return ()
        self._used.add(name)
        self._calls += 1
        if self._calls == MOST_CALLS:
            step.add(None, f"the recipes in this file call other recipes more than {MOST_CALLS} times. Fix: write out "
                "the steps")
        if self._calls >= MOST_CALLS:
            return ()
        return self.read(self._named, name, names, (*under, name))

    def check_unused(self) -> None:
        """Judge the named recipes that no command uses, too."""
        for name in self._named:
            if name not in self._used:
                self.read(self._named, name, (*MOVE, *PROGRAM, *names_for(Command.HALT)), (name,))

    def _span(self, step: Table) -> tuple[int, int] | None:
        if "span" not in step:
            return None
        given = step.get("span")
        inside = [self._quantities[name] for name in step.table("write") if name in self._quantities]
        if not all(name in self._quantities for name in given):
            step.add("span", "must be two quantities, [first, last]; all registers from the first to the last are "
                "written")
            return None
        first, last = (self._quantities[name] for name in given)
        span = (first.address, last.end - 1)
        fits = all(span[0] <= one.address and one.end - 1 <= span[1] for one in inside)
        holding = all(one.space == HOLDING and one.write_function == 16 for one in (first, last, *inside))
        bits = any(one.bit is not None for one in inside)
        if bits:
            step.add("span", "writes whole registers, but this step writes single bits. Fix: write the bits in a "
                "separate step")
            return None
        if not (holding and fits and 0 < span[1] - span[0] + 1 <= LONGEST_SPAN):
            step.add(
                "span", f"must cover at most {LONGEST_SPAN} holding registers, written by function 16, and include "
                    "everything that this step writes"
            )
            return None
        return span


def read_values(step: Table, key: str, quantities: Quantities, names: Collection[str]) -> dict[Quantity, Value]:
    """What a step writes: quantity -> number (SI) or name with its "$"."""
    written = step.table(key)
    result: dict[Quantity, Value] = {}
    for name in written:
        quantity = quantities.get(name)
        if quantity is None:
            written.add(name, f"is not in [quantities]; {meant(name, quantities)}")
            continue
        if not quantity.written:
            written.add(name, f"cannot be written because its access is \"r\" ({quantity.space})")
        value = number_of(written, name, written.given[name], quantity, names)
        if isinstance(value, str):
            _check_name(written, name, value[1:], quantity)
        elif quantity.values > 1:
            written.add(name, f"has {quantity.values} values; only a [table] can write these values")
        elif quantity.type == "string" or not quantity.holds(value):
            written.add(name, f"{written.given[name]!r} does not fit {quantity.type} with scale {quantity.scale:g}")
        result[quantity] = value
    return result


def _check_name(written: Table, key: str, name: str, quantity: Quantity) -> None:
    unit_due = MEASURES.get(name, "")
    if unit_due and quantity.measures and quantity.measures != unit_due:
        written.add(key, f"${name} is a {unit_due}, but {quantity.name} is a {quantity.measures} according to its unit")
    if name in COUNTS:
        low, high = COUNTS[name]
        if quantity.type == "string" or not all(map(quantity.holds, (low, low + 1, high))) or quantity.step > 1.0:
            fix = ", or \"$toggle\" (0 and 1)" if name == "counter" else ""
            written.add(
                key, f"${name} ranges from {low} to {high}, but {quantity.name} ({quantity.type}) cannot hold all of "
                    f"these numbers. Fix: write ${name} to a u16 without scale{fix}"
            )
    if quantity.values > 1 and name != "values":
        written.add(key, f"{quantity.name} has {quantity.values} values; only a [table] can write these values")


def read_commands(table: Table, recipes: Recipes) -> dict[Command, Recipe]:
    """The table [commands]."""
    result: dict[Command, Recipe] = {
        COMMANDS[key]: recipes.read(table, key, names_for(COMMANDS[key])) for key in table
    }
    for key in table:
        if not any(isinstance(step, Write) for step in result[COMMANDS[key]]):
            table.add(key, "does not write anything, so the device would not receive the command")
    return result


def read_setpoint(table: Table, recipes: Recipes) -> Recipe:
    """The table [setpoint]; empty where there is none."""
    if not table.given:
        return ()
    if ("steps" in table) is ("write" in table):
        table.add(None, "requires either write, or steps for a device with a handshake")
        return ()
    if "steps" in table:
        steps = recipes.read(table, "steps", SETPOINT)
    else:
        steps = recipes.read(Table(table.source, (), {"setpoint": table.given}), "setpoint", SETPOINT)
    written = [step for step in steps if isinstance(step, Write)]
    if not any("$position" in step.values.values() for step in written):
        table.add(None, 'the set-point\'s position is missing: write = {setpoint = "$position"}')
    torn = [one for step in written[-1:] for one, value in step.values.items() if one.places and isinstance(value, str)]
    if torn:
        table.add(None, f"the registers of {torn[0].name} are written one after the other, so the device could follow "
            "a position made of an old and a new word. Fix: write the value in a step before the one that starts the "
            "motion")
    longest_s = sum(step.within_s if isinstance(step, Wait) else step.lasts_s for step in steps
                    if not isinstance(step, Write))  # fmt: skip
    if longest_s > LONGEST_SETPOINT_S:
        table.add(None, f"the waits and pauses of a set-point take up to {1e3 * longest_s:g} ms; allowed: "
            f"{1e3 * LONGEST_SETPOINT_S:g} ms in total, because a stop may have to wait for them")
    return steps


def read_watchdog(table: Table, recipes: Recipes, streams: bool) -> tuple[WatchdogKind, Recipe, float]:
    """The table [watchdog]: its kind, what feeds it, after how long it trips (s; 0: as is told by `watchdog_time`).

    Args:
        table: to read.
        recipes: reads steps.
        streams: set-points are sent one by one.
    """
    kind = table.get("kind", "none")
    time_s = table.time_s("time")
    steps: Recipe = ()
    if "write" in table:
        given = {key: table.given[key] for key in ("write", "span") if key in table}
        steps = recipes.read(Table(table.source, (), {"watchdog": given}), "watchdog", WATCHDOG)
    if kind in {"counter", "keep-alive"} and not steps:
        table.add(None, f'kind = "{kind}" requires write, which refreshes the watchdog, such as write = '
            f'{{alive = "$counter"}}')
    if kind in {"setpoints", "none"} and steps:
        table.add("write", f'kind = "{kind}" does not require a refresh. Fix: remove write')
    if kind == "setpoints" and not streams:
        table.add("kind", "no set-points are sent to this device, because [setpoint] is missing")
    kinds = {"counter": WatchdogKind.COUNTER, "none": WatchdogKind.NONE}
    return kinds.get(kind, WatchdogKind.TIMEOUT), steps, time_s


def read_table(table: Table, recipes: Recipes) -> tuple[Recipe, int]:
    """The table [table]: how a table waveform is loaded, and how many values one write takes; () and 0 without."""
    if not table.given:
        return (), 0
    steps = recipes.read(Table(table.source, (), {"table": table.given}), "table", TABLE)
    held = [
        quantity for step in steps if isinstance(step, Write) for quantity, value in step.values.items()
        if value == "$values"
    ]
    if len(held) != 1:
        table.add(None, 'requires a quantity with several values (count = ...) for "$values"')
        return (), 0
    return steps, held[0].values
