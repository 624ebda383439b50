"""The controller's registers and coils as a user's register map lays them: the same machine behind another face."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from drivers.capabilities import WatchdogKind
from drivers.register_maps.access_plan import reads
from drivers.register_maps.condition import Condition, Test
from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.meanings import Codes
from drivers.register_maps.quantity import BITS, LAST_ADDRESS, SPACES, Quantity
from drivers.register_maps.read_quantities import IDENTITY, LIMITS, ROLES
from drivers.register_maps.recipe import Write
from drivers.roles import ActuatorLimits, Command, Pressure, WatchdogAction
from drivers.roles import State as RoleState
from protocols.errors import LocalProtocolError
from simulators import controller_firmware as wire
from simulators.actuator import Actuator
from simulators.controller_firmware import Result, State
from simulators.emulated_bench import emulated_map
from simulators.emulated_codec import bits_of, raw_of, text_words, value_of, words_of
from simulators.emulated_commands import Scripts, Seen, preconditions, scripts_of
from simulators.emulated_orders import order_of
from simulators.emulated_status import EmulatedStatus, Registers, make
from simulators.options import RigOptions, ServoOptions
from simulators.plant.records import FOLLOW_S
from simulators.registers import RegisterBank

WATCHDOG_MS = 500
"""Of a device whose map does not say after how long it trips."""
SHOWN_S = 0.15
"""So long (simulated s) an answer to a command stays before the device looks as if nothing was asked."""
SHORTEST_S = 1e-3
USUAL_SHARE = 0.1
"""Of each time between two set-points, in the usual one: a late one and the next, which comes early, make no jump."""
"""Two set-points that come closer together are taken as if they did not."""
NOBODY = 1
"""Owner of a device without leases."""
PRESSURES = (Pressure.OFF, Pressure.LOW, Pressure.ON)
MODULAR = frozenset({"heartbeat", "pulse_count", "clock", "pulse_clock", "watchdog_echo", "program_id"})

Cells = dict[tuple[str, int], int]
"""Words and coils by space and address."""


class EmulatedRegisters(RegisterBank):
    """Registers of the simulated controller as a map says.

    Args:
        actuator: the machine's logic.
        servo: what its inputs show.
        random: of their noise.
        emulated: the map.
    """

    def __init__(
        self, actuator: Actuator, servo: ServoOptions, random: np.random.Generator, emulated: ControllerMap
    ) -> None:
        super().__init__(actuator, servo, random)
        self._map = emulated
        self._cells: Cells = {}
        self._status = EmulatedStatus(emulated)
        self._scripts = Scripts(scripts_of(emulated.recipes.commands), lambda one, value: raw_of(one, float(value)))
        self._before = preconditions(emulated.recipes.commands)
        self._restore_s = 0.0
        self._count = 0
        self._fed = 0
        self._followed_s = 0.0
        self._usual_s = math.nan
        self._feeds = self._named(emulated.recipes.feed)
        self._setpoints = self._named(emulated.recipes.setpoint)
        self._allowed = _allowed(emulated)
        self._writable = {
            (one.space, address) for one in emulated.quantities.values() if one.written
            for address in range(one.address, one.end)
        }
        self._satisfy(self._before, {})
        self.tick()

    def blocks(self) -> dict[str, list[tuple[int, int]]]:
        """First address and count of what is there, by space."""
        runs: dict[str, list[tuple[int, int]]] = {}
        for space in SPACES:
            addresses = [address for held, address in self._allowed if held == space]
            if addresses:
                runs[space] = [(min(addresses), max(addresses) - min(addresses) + 1)]
        return runs

    def tick(self) -> None:
        """What the device does by itself: nobody owns it where there are no leases, and its watchdog has a time."""
        actuator = self.actuator
        if not self._map.capabilities.lease and actuator.owner == 0:
            actuator.owner = NOBODY
        watched = self._map.capabilities.watchdog is not WatchdogKind.NONE
        if watched and actuator.limits.watchdog_ms == 0 and "watchdog_time" not in self._map.quantities:
            time_ms = round(1e3 * self._map.recipes.watchdog_s) or WATCHDOG_MS
            limits = replace(actuator.limits, watchdog_ms=time_ms, watchdog_action=int(WatchdogAction.FADE_AND_HOLD))
            actuator.configure(wire.encode_limits(limits))
        if self._restore_s and actuator.plant.time_s > self._restore_s:
            self._restore_s = 0.0
            self._satisfy(self._before, {})

    def bits(self, space: str) -> dict[int, int]:
        """All coils or discrete inputs by address."""
        self.tick()
        self.polled_s = self.actuator.served_s
        shown = self._cells | self._live()
        return {address: shown.get((space, address), 0) for held, address in self._allowed if held == space}

    def read(self, address: int, count: int, space: str = "holding") -> list[int] | None:
        """Words, or coils, from `address`; None when one of them is not there."""
        asked = [(space, at) for at in range(address, address + count)]
        if not self._allowed.issuperset(asked):
            return None
        self.tick()
        self.polled_s = self.actuator.served_s
        shown = self._cells | self._live()
        return [shown.get(self._pointed(cell), 0) for cell in asked]

    def write(self, address: int, words: Sequence[int], space: str = "holding") -> bool | None:
        """Take a write; False when its values are refused, None when something of it cannot be written there."""
        cells = {(space, address + place): int(word) for place, word in enumerate(words)}
        if not self._writable.union(self._spans(), self._pointers()).issuperset(cells):
            return None
        if self.writes_lost:
            return True
        before = dict(self._cells)
        self._cells |= cells
        touched = [one for one in self._map.quantities.values() if one.written and (one.space, one.end - 1) in cells]
        if not self._take_limits({one.name for one in touched}):
            self._cells = before
            return False
        self._take_counters(touched)
        return self._take_table(touched) and self._take_commands(touched)

    # What a write means

    def _take_limits(self, names: set[str]) -> bool:
        if not names & LIMITS.keys():
            return True
        fields = {"watchdog_time": "watchdog_ms"} | {name: name for name in LIMITS if name != "watchdog_time"}
        changed: dict[str, float] = dict(zip(wire.LIMITS, _numbers(self.actuator.limits), strict=True))
        for name in names & LIMITS.keys():
            quantity = self._map.quantities[name]
            value = value_of(quantity, self._raw(quantity))
            if name == "watchdog_action":
                value = self._map.words.watchdog_actions.meaning(int(value))
            changed[fields[name]] = round(1e3 * value) if name == "watchdog_time" else value
        return self.actuator.configure(wire.CONFIG.encode(changed))

    def _take_counters(self, touched: Iterable[Quantity]) -> None:
        """Food for the watchdog, and set-points."""
        for quantity in touched:
            said = self._setpoints.get(quantity.name)
            if quantity.name in self._feeds or said == "$counter":
                self._feed(self._raw(quantity), constant=not isinstance(self._feeds.get(quantity.name, "$"), str))
            if said == "$position":
                if not self._feeds and self._map.capabilities.watchdog is WatchdogKind.TIMEOUT:
                    self._feed(0, constant=True)
                self._follow_position(value_of(quantity, self._raw(quantity)))

    def _feed(self, counter: int, *, constant: bool) -> None:
        self._fed = (self._fed + 1) & 0xFFFF if constant else counter
        self.actuator.feed(self._fed)

    def _follow_position(self, position_m: float) -> None:
        """A set-point; where the map has no speed for it, it is reached after the usual time between two."""
        velocity = next((name for name, value in self._setpoints.items() if value == "$velocity"), None)
        if velocity is not None:
            quantity = self._map.quantities[velocity]
            self.actuator.follow(position_m, value_of(quantity, self._raw(quantity)))
        else:
            self.actuator.follow(position_m, None, self._within_s())

    def _within_s(self) -> float:
        """The usual time between two set-points; the last one where it was longer, but not a gap (s)."""
        now_s = self.actuator.arrival_s()
        last_s, self._followed_s = now_s - self._followed_s, now_s
        if last_s >= FOLLOW_S:
            return FOLLOW_S if math.isnan(self._usual_s) else self._usual_s
        if math.isnan(self._usual_s):
            self._usual_s = max(last_s, SHORTEST_S)
        self._usual_s += USUAL_SHARE * (max(last_s, SHORTEST_S) - self._usual_s)
        return max(self._usual_s, last_s)

    def _take_table(self, touched: Iterable[Quantity]) -> bool:
        held = self._named(self._map.recipes.table)
        if not held.keys() & {quantity.name for quantity in touched}:
            return True
        by_name = {str(value): self._map.quantities[name] for name, value in held.items()}
        samples = [value_of(one, self._raw(one)) for one in by_name["$values"].elements[: wire.TABLE_VALUES]]
        values: dict[str, float | int | str] = {f"table_value_{place}": one for place, one in enumerate(samples)}
        values["table_index"] = self._raw(by_name["$index"])
        values["table_count"] = self._raw(by_name["$count"])
        return self.actuator.write_table(values)

    def _take_commands(self, touched: Iterable[Quantity]) -> bool:
        seen = self._scripts.take({one.name: self._raw(one) for one in touched if one.values == 1})
        given: dict[str, float] = {}
        for one in seen:
            if one.decides:
                given = self._execute(one)
                break
        for one in seen:
            if not one.decides or self.actuator.result == Result.DONE:
                self._satisfy(one.waits, given)
                self._restore_s = self.actuator.plant.time_s + SHOWN_S
        return True

    def _execute(self, seen: Seen) -> dict[str, float]:
        """Carry a command out; what its recipe said, by the recipe's names (SI)."""
        given: dict[str, float] = {}
        for step in self._map.recipes.commands[seen.command]:
            if isinstance(step, Write):
                for quantity, value in step.values.items():
                    if isinstance(value, str):
                        given[value[1:]] = value_of(quantity, self._raw(quantity))
        self._count = self._count % 0xFFFF + 1
        sequence = int(given.get("sequence", self._count))
        owner = int(given.get("owner", NOBODY)) if self._map.capabilities.lease else NOBODY
        one_pressure = Command.HYDRAULICS_LOW not in self._map.recipes.commands
        if seen.command is Command.HYDRAULICS_ON and one_pressure and self.actuator.motion_state is State.OFF:
            first = {"sequence": sequence % 0xFFFF + 1, "command": int(Command.HYDRAULICS_LOW), "owner_id": owner}
            self.actuator.execute(first)
        order = order_of(seen.command, given, self.actuator, self._map)
        self.actuator.execute({"sequence": sequence, "command": int(seen.command), "owner_id": owner, **order})
        return given

    def _satisfy(self, conditions: Iterable[Condition], given: dict[str, float]) -> None:
        """Show what a host waits for, but what the machine itself shows."""
        for condition in conditions:
            tests = [
                _resolved(test, given) for test in condition.tests
                if test.quantity not in self._status.quantities and test.quantity.name not in ROLES
            ]
            registers: Registers = {
                (test.quantity.space, test.quantity.address): self._raw(self._whole(test.quantity)) for test in tests
            }
            make(registers, Condition(tuple(tests)), holds=True)
            for test in tests:
                whole = self._whole(test.quantity)
                self._put(self._cells, whole, registers[whole.space, whole.address])

    # What is shown

    def _live(self) -> Cells:
        """What the machine shows of itself now."""
        cells: Cells = {}
        shown = self.status()
        self._show_status(cells, {str(name): value for name, value in shown.items()})
        registers: Registers = {}
        for quantity in self._status.quantities:
            # A condition may look at what the machine measures: that is shown, and changed only where it must hold.
            registers[quantity.space, quantity.address] = self._raw(self._whole(quantity), self._cells | cells)
        states = RoleState(self.actuator.state), RoleState(self.actuator.motion_state)
        pressure = PRESSURES[int(self.actuator.plant.command["pressure"][0])]
        self._status.show(registers, *states, int(shown["fault_bits"]), int(shown["inputs"]), pressure)
        for quantity in self._status.quantities:
            self._put(cells, self._whole(quantity), registers[quantity.space, quantity.address])
        self._show_identity(cells)
        self._show_limits(cells)
        return cells

    def _show_status(self, cells: Cells, shown: dict[str, float | int | str]) -> None:
        clock_us = self.actuator.clock.unwrapped_us(self.actuator.plant.time_s)
        words = self._map.words
        shown |= {
            "clock": 1e-6 * clock_us, "pulse_clock": 1e-6 * float(shown["pulse_clock_us"]), "watchdog_echo": self._fed,
            "phase": _code(words.phases, int(shown["phase"])), "result": _code(words.results, int(shown["result"])),
            "acked_command": _code(words.commands, int(shown["acked_command"])),
        }
        for name in ROLES:
            quantity = self._map.quantities.get(name)
            if quantity is None or name in {"state", "fault_bits", "inputs"}:
                continue
            value = float(shown[name])
            if name in MODULAR and quantity.step:
                raw = int(value / (quantity.scale * quantity.factor) + 1e-6) & (1 << 16 * quantity.length) - 1
            else:
                raw = raw_of(quantity, value)
            self._put(cells, quantity, raw)

    def _show_identity(self, cells: Cells) -> None:
        shown = self.identity() | dict(self._map.expected)
        for name in {*IDENTITY, *self._map.expected}:
            quantity = self._map.quantities.get(name)
            if quantity is None or name in ROLES or quantity in self._status.quantities:
                continue
            value = shown[name]
            if quantity.type == "string":
                for place, word in enumerate(text_words(quantity, str(value))):
                    cells[quantity.space, quantity.address + place] = word
            else:
                digits = "".join(letter for letter in str(value) if letter.isdigit())
                raw = raw_of(quantity, float(digits or 0) if isinstance(value, str) else value)
                if quantity.bit is not None:
                    # Other bits of its register may be identity, too.
                    before = cells.get((quantity.space, quantity.address), 0)
                    raw = before & ~(1 << quantity.bit) | (raw & 1) << quantity.bit
                self._put(cells, self._whole(quantity), raw)

    def _show_limits(self, cells: Cells) -> None:
        held = dict(zip(wire.LIMITS, _numbers(self.actuator.limits), strict=True))
        held["watchdog_time"] = 1e-3 * held["watchdog_ms"]
        held["watchdog_action"] = _code(self._map.words.watchdog_actions, int(held["watchdog_action"]))
        for name in LIMITS:
            quantity = self._map.quantities.get(name)
            if quantity is not None:
                self._put(cells, quantity, raw_of(quantity, held[name]))

    # Cells

    def _raw(self, quantity: Quantity, cells: Cells | None = None) -> int:
        """The bits that a host has written, or the device laid down, for a quantity; or what is in `cells`."""
        held = self._cells if cells is None else cells
        if quantity.space in BITS:
            return held.get((quantity.space, quantity.address), 0)
        words = [held.get((quantity.space, quantity.address + place), 0) for place in range(quantity.length)]
        raw = bits_of(quantity, words)
        return raw if quantity.bit is None else raw >> quantity.bit & 1

    def _put(self, cells: Cells, quantity: Quantity, raw: int) -> None:
        if quantity.space in BITS:
            cells[quantity.space, quantity.address] = raw & 1
            return
        for place, word in enumerate(words_of(quantity, raw, swapped=self.word_order_swapped)):
            cells[quantity.space, quantity.address + place] = word

    @staticmethod
    def _whole(quantity: Quantity) -> Quantity:
        """The register of which a quantity is one bit; any other as it is."""
        return quantity if quantity.bit is None else replace(quantity, bit=None)

    def _pointed(self, cell: tuple[str, int]) -> tuple[str, int]:
        """Where what is shown at an address of the indirect data comes from."""
        indirect = self._map.indirect
        if indirect is None or cell[0] != indirect.space or not 0 <= cell[1] - indirect.data < len(indirect.addresses):
            return cell
        at = indirect.pointers + (cell[1] - indirect.data) * indirect.pointer_registers
        words = [self._cells.get(("holding", at + place), 0) for place in range(indirect.pointer_registers)]
        entry = sum(word << 16 * place for place, word in enumerate(reversed(words))) - indirect.pointer_offset
        spaces = [one.space for one in indirect.quantities if one.address <= entry < one.end]
        return (spaces[0], entry) if spaces else ("holding", entry)

    def _pointers(self) -> set[tuple[str, int]]:
        indirect = self._map.indirect
        if indirect is None:
            return set()
        count = len(indirect.addresses) * indirect.pointer_registers
        return {("holding", indirect.pointers + place) for place in range(count)}

    def _spans(self) -> set[tuple[str, int]]:
        recipes = self._map.recipes
        every = (*recipes.commands.values(), recipes.setpoint, recipes.feed, recipes.table)
        spans = [step.span for recipe in every for step in recipe if isinstance(step, Write) and step.span]
        return {("holding", address) for low, high in spans for address in range(low, high + 1)}

    @staticmethod
    def _named(recipe: Iterable[object]) -> dict[str, object]:
        """Quantity -> what is written to it, of all steps."""
        steps = [step for step in recipe if isinstance(step, Write)]
        return {quantity.name: value for step in steps for quantity, value in step.values.items()}


def registers_of(actuator: Actuator, options: RigOptions, random: np.random.Generator) -> RegisterBank:
    """The registers of a controller: as a user's map says where there is one, else its own.

    Raises:
        FileProblem: the map cannot be used: everything that is wrong.
    """
    emulated = emulated_map(options.controller)
    if emulated is None:
        return RegisterBank(actuator, options.servo, random)
    return EmulatedRegisters(actuator, options.servo, random, emulated)


def _resolved(test: Test, given: dict[str, float]) -> Test:
    """A test with a recipe's values put in."""
    wanted = tuple(given.get(one[1:], 0) if isinstance(one, str) else one for one in test.wanted)
    return replace(test, wanted=wanted)


def _numbers(limits: ActuatorLimits) -> list[float]:
    return [getattr(limits, name) for name in ActuatorLimits.__dataclass_fields__]


def _code(codes: Codes, number: int) -> int:
    """The device's code; one that it has no word for is the first code that means nothing: 0 where that is free."""
    try:
        return codes.code(number)
    except LocalProtocolError:
        named = {code for given in codes.codes.values() for code in given}
        return next(code for code in range(len(named) + 1) if code not in named)


def _allowed(emulated: ControllerMap) -> set[tuple[str, int]]:
    """Every address that is there: what the map names, and the gaps that it allows to be read."""
    held = {
        (one.space, address) for one in emulated.quantities.values() for address in range(one.address, one.end)
    }
    # However many registers a request may have: which ones a host reads together is its own choice.
    for read in reads(emulated.quantities.values(), replace(emulated.rules, largest_read=LAST_ADDRESS + 1)):
        held |= {(read.space, read.address + place) for place in range(read.count)}
    if emulated.indirect is not None:
        for one in emulated.indirect.shown().values():
            held |= {(one.space, address) for address in range(one.address, one.end)}
        count = len(emulated.indirect.addresses) * emulated.indirect.pointer_registers
        held |= {("holding", emulated.indirect.pointers + place) for place in range(count)}
    return held
