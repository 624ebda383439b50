"""The controller's registers and coils, as a register map lays them out: the demo's, or a user's. No sockets."""

from __future__ import annotations

import math
import zlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from drivers.capabilities import PRESSURE_LEVELS, WatchdogKind
from drivers.register_maps.access_plan import reads
from drivers.register_maps.condition import Condition, Test
from drivers.register_maps.controller_map import LIMIT_FIELDS, ControllerMap
from drivers.register_maps.meanings import Codes
from drivers.register_maps.quantity import BITS, HOLDING, LAST_ADDRESS, SPACES, Quantity
from drivers.register_maps.read_quantities import IDENTITY, LIMITS, ROLES
from drivers.register_maps.recipe import Recipe, Write
from drivers.roles import Command, Pressure, Result, State, WatchdogAction
from protocols.errors import LocalProtocolError
from simulators.actuator import Actuator
from simulators.controller_readings import ControllerReadings
from simulators.emulated_bench import emulated_map
from simulators.emulated_codec import DECIMAL, bits_of, digits_of, lay_down, raw_of, text_words, value_of, words_of
from simulators.emulated_commands import Scripts, Seen, preconditions, scripts_of
from simulators.emulated_orders import order_of, whole
from simulators.emulated_status import EmulatedStatus, Registers, make
from simulators.options import RigOptions, ServoOptions
from simulators.plant.records import FOLLOW_S

WATCHDOG_MS = 500
"""Of a device whose map does not say after how long it trips."""
SHOWN_S = 0.15
"""So long (simulated s) an answer to a command stays before the device looks as if nothing was requested."""
INTERMEDIATE_S = 1.0
"""Time (simulated s) for which the device shows intermediate states that a host waits for."""
SHORTEST_S = 1e-3
"""Two set-points that come closer together are taken as if they did not."""
USUAL_SHARE = 0.1
"""Of each time between two set-points, in the usual one: a late one and the next, which comes early, make no jump."""
NO_LEASE = 1
"""Owner of a device without leases."""
PRESSURES = (Pressure.OFF, Pressure.LOW, Pressure.ON)
FOLLOWING = frozenset({State.HOLD, State.MOVING, State.RUNNING, State.FADING, State.HALTING})
"""States in which the machine accepts set-points."""
CLOCKS = frozenset({"clock", "pulse_clock"})
MODULAR = frozenset({"heartbeat", "pulse_count", "watchdog_echo", "program_id"})
BY_MEANING = frozenset({"state", "fault_bits", "inputs"})
"""Quantities of the status that codes, bits and conditions make up."""

MOST_SHOWN = 1024
"""Number of cached register contents, which are not encoded again."""

Cell = tuple[str, int]
"""Space and address of a register or coil."""
Cells = dict[Cell, int]


class RegisterBank:
    """Registers of the simulated controller.

    Args:
        actuator: the machine's logic.
        servo: what its inputs show.
        random: of their noise.
        emulated: the map.

    Attributes:
        readings: what is shown of the machine.
        word_order_swapped: a fault: numbers of several registers come with their words in the wrong order.
        writes_lost: a fault: writes are acknowledged and forgotten.
        polled_s: served time (s) at which the status was last read; NaN before.
    """

    def __init__(
        self, actuator: Actuator, servo: ServoOptions, random: np.random.Generator, emulated: ControllerMap
    ) -> None:
        self.actuator = actuator
        self.readings = ControllerReadings(actuator, servo, random)
        self.word_order_swapped = False
        self.writes_lost = False
        self.polled_s = math.nan
        self._map = emulated
        self._cells: Cells = {}
        self._status = EmulatedStatus(emulated)
        self._shown_before: dict[tuple[int, ...], Registers] = {}
        setpoint = {Command.NONE: emulated.recipes.setpoint}
        self._scripts = self._recognised(emulated.recipes.commands)
        self._handshakes = self._recognised(setpoint if emulated.setpoint_waits else {})
        self._before = preconditions({**emulated.recipes.commands, **setpoint})
        self._restore_s = 0.0
        self._led: tuple[Condition, ...] = ()
        self._led_s = 0.0
        self._count = 0
        self._fed = 0
        self._followed_s = 0.0
        self._usual_s = math.nan
        self._feeds = self._named(emulated.recipes.feed)
        self._setpoints = self._named(emulated.recipes.setpoint)
        named = emulated.quantities
        self._measured = [named[name] for name in ROLES if name in named and name not in BY_MEANING]
        self._identity = [
            named[name] for name in dict.fromkeys((*IDENTITY, *emulated.expected))
            if name in named and name not in ROLES and named[name] not in self._status.quantities
        ]
        self._limits = sorted((named[name] for name in LIMITS if name in named), key=lambda one: one.address)
        self._meanings = [self._whole(one) for one in self._status.quantities]
        self._shown_bits = _shown_bits(emulated)
        self._status_cells = _cells([*self._measured, *self._status.quantities])
        self._identity_cells = _cells(self._identity)
        self._limit_cells = _cells(self._limits)
        self._allowed = _allowed(emulated)
        written = [one for one in named.values() if one.written]
        self._ends: dict[Cell, list[Quantity]] = {}
        for one in written:
            self._ends.setdefault((one.space, one.cells[-1]), []).append(one)
        self._writable = _cells(written) | self._spans() | self._pointers()
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
        """Initial values: without leases the device has no owner, and its watchdog has a time."""
        actuator = self.actuator
        if not self._map.capabilities.lease and actuator.owner == 0:
            actuator.owner = NO_LEASE
        actuator.watchdog_pressure = PRESSURE_LEVELS.index(self._map.recipes.watchdog_tested)
        watched = self._map.capabilities.watchdog is not WatchdogKind.NONE
        if watched and actuator.limits.watchdog_ms == 0 and "watchdog_time" not in self._map.quantities:
            time_ms = round(1e3 * self._map.recipes.watchdog_s) or WATCHDOG_MS
            action = int(WatchdogAction.FADE_AND_HOLD)
            actuator.configure(replace(actuator.limits, watchdog_ms=time_ms, watchdog_action=action))
        if self._restore_s and actuator.plant.time_s > self._restore_s:
            self._restore_s = 0.0
            self._satisfy(self._before, {})

    def bits(self, space: str) -> dict[int, int]:
        """All coils or discrete inputs by address."""
        self.tick()
        there = [cell for cell in self._allowed if cell[0] == space]
        return {cell[1]: bit for cell, bit in zip(there, self._shown(there), strict=True)}

    def read(self, address: int, count: int, space: str = HOLDING) -> list[int] | None:
        """Words, or coils, from `address`; None when one of them is not there."""
        cells = [(space, at) for at in range(address, address + count)]
        if not self._allowed.issuperset(cells):
            return None
        self.tick()
        return self._shown([self._pointed(cell) for cell in cells] if self._map.indirect is not None else cells)

    def write(self, address: int, words: Sequence[int], space: str = HOLDING) -> bool | None:
        """Take a write; False when its values are refused, None when something of it cannot be written there."""
        cells = {(space, address + place): int(word) for place, word in enumerate(words)}
        if not self._writable.issuperset(cells):
            return None
        if self.writes_lost:
            return True
        before = dict(self._cells)
        self._cells |= cells
        touched = self._touched(cells, before)
        if not self._take_limits({one.name for one in touched}):
            self._cells = before
            return False
        self._take_counters(touched)
        self._accept_handshakes(touched)
        return self._take_table(touched) and self._take_commands(touched)

    # What a write means

    def _touched(self, cells: Cells, before: Cells) -> list[Quantity]:
        """Quantities that a write completes; for bits of a register, those that it changes (if any)."""
        touched = [one for cell in cells for one in self._ends.get(cell, ())]
        bits = [one for one in touched if one.bit is not None]
        same = {one.name for one in bits if self._raw(one) == self._raw(one, before)}
        return touched if len(same) == len(bits) else [one for one in touched if one.name not in same]

    def _take_limits(self, names: set[str]) -> bool:
        changed: dict[str, float] = {}
        for name in names & LIMITS.keys():
            quantity = self._map.quantities[name]
            value = value_of(quantity, self._raw(quantity))
            if not math.isfinite(value):
                return False
            if name == "watchdog_action":
                value = self._map.words.watchdog_actions.meaning(int(value))
            changed[LIMIT_FIELDS[name]] = round(1e3 * value) if name == "watchdog_time" else value
        if not changed:
            return True
        return self.actuator.configure(replace(self.actuator.limits, **changed))  # type: ignore[arg-type]  # by field

    def _take_counters(self, touched: Iterable[Quantity]) -> None:
        """Food for the watchdog, and set-points."""
        for quantity in touched:
            setpoint = self._setpoints.get(quantity.name)
            if quantity.name in self._feeds or setpoint == "$counter":
                self._feed(self._raw(quantity), constant=not isinstance(self._feeds.get(quantity.name, "$"), str))
            if setpoint == "$position" and not self._map.setpoint_waits:
                self._follow_setpoint(quantity)

    def _accept_handshakes(self, touched: Iterable[Quantity]) -> None:
        """Accept a set-point with a handshake at its trigger step; acknowledge it if the machine follows."""
        for seen in self._handshakes.take({one.name: self._raw(one) for one in touched}):
            if self.actuator.state not in FOLLOWING:
                continue
            if seen.decides:
                position = self._written_with("$position")
                if position is not None:
                    self._follow_setpoint(position)
            self._satisfy(seen.waits, {})

    def _feed(self, counter: int, *, constant: bool) -> None:
        self._fed = (self._fed + 1) & 0xFFFF if constant else counter
        self.actuator.feed(self._fed)

    def _follow_setpoint(self, position: Quantity) -> None:
        """Follow a set-point that was written; it also feeds a watchdog without a separate feed.

        Where the map has no speed for it, it is reached after the usual time between two.
        """
        if not self._feeds and self._map.capabilities.watchdog is WatchdogKind.TIMEOUT:
            self._feed(0, constant=True)
        position_m, velocity = value_of(position, self._raw(position)), self._written_with("$velocity")
        if velocity is not None:
            self.actuator.follow(position_m, value_of(velocity, self._raw(velocity)))
        else:
            self.actuator.follow(position_m, None, self._within_s())

    def _written_with(self, value: str) -> Quantity | None:
        """The quantity that holds this value of a set-point; None if the map has none."""
        name = next((name for name, held in self._setpoints.items() if held == value), None)
        return None if name is None else self._map.quantities[name]

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
        elements, count = by_name["$values"].elements, self._raw(by_name["$count"])
        if count > len(elements):
            return False
        return self.actuator.write_table(
            self._raw(by_name["$index"]), [value_of(one, self._raw(one)) for one in elements[:count]]
        )

    def _take_commands(self, touched: Iterable[Quantity]) -> bool:
        written = {one.name: self._raw(one) for one in touched if one.values == 1}
        seen = self._scripts.take(written)
        if not seen and (number := self._scripts.number) in written:
            code = self._scripts.code
            unknown = 0 if code is None else self._map.words.commands.meaning(self._raw(code))
            self.actuator.refuse(written[number], unknown)
        given: dict[str, float] = {}
        if seen:
            # When powered up, a drive passes through states that the machine does not have.
            self._led = next((one.waits for one in seen if one.leads), ())
            self._led_s = self.actuator.plant.time_s + INTERMEDIATE_S
        for one in seen:
            if one.decides:
                given = self._execute(one)
                self._led = ()
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
        sequence = whole(given.get("sequence", self._count))
        owner = whole(given.get("owner", NO_LEASE)) if self._map.capabilities.lease else NO_LEASE
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
                if not self._shows(test) and test.quantity.name not in ROLES
            ]
            registers: Registers = {
                (test.quantity.space, test.quantity.address): self._raw(self._whole(test.quantity)) for test in tests
            }
            make(registers, Condition(tuple(tests)), holds=True)
            for test in tests:
                whole = self._whole(test.quantity)
                lay_down(self._cells, whole, registers[whole.space, whole.address])

    def _shows(self, test: Test) -> bool:
        """Whether the machine's state determines what a test reads; for a word, the bit of the test."""
        bit = test.quantity.bit if test.bit is None else test.bit
        cell = test.quantity.space, test.quantity.address
        return test.quantity in self._status.quantities and (bit is None or not {None, bit}.isdisjoint(
            self._shown_bits.get(cell, ())
        ))

    # What is shown

    def _shown(self, cells: Collection[Cell]) -> list[int]:
        """What these cells show now."""
        live: Cells = {}
        if not self._status_cells.isdisjoint(cells):
            self.polled_s = self.actuator.served_s
            self._show_status(live)
        if not self._identity_cells.isdisjoint(cells):
            self._show_identity(live)
        if not self._limit_cells.isdisjoint(cells):
            self._show_limits(live)
        held = self._cells
        return [live[cell] if cell in live else held.get(cell, 0) for cell in cells]

    def _show_status(self, live: Cells) -> None:
        shown = self.readings.status()
        words = self._map.words
        shown |= {
            "phase": _code(words.phases, int(shown["phase"])), "result": _code(words.results, int(shown["result"])),
            "acked_command": _code(words.commands, int(shown["acked_command"])),
        }
        for quantity in self._measured:
            lay_down(live, quantity, _measured(quantity, shown), swapped=self.word_order_swapped)
        registers: Registers = {}
        for quantity in self._meanings:
            # A condition may look at what the machine measures: that is shown, and changed only where it must hold.
            registers[quantity.space, quantity.address] = self._raw(quantity, live)
        actuator = self.actuator
        pressure = PRESSURES[int(actuator.plant.command["pressure"][0])]
        meant = actuator.state, actuator.motion_state, int(shown["fault_bits"]), int(shown["inputs"]), pressure
        before = (*registers.values(), *meant)
        if before in self._shown_before:
            registers = self._shown_before[before]
        else:
            self._status.show(registers, *meant)
            if len(self._shown_before) == MOST_SHOWN:
                self._shown_before.clear()
            self._shown_before[before] = registers
        if self._led and actuator.plant.time_s < self._led_s and not actuator.tripped:
            registers = dict(registers)
            for condition in self._led:
                make(registers, condition, holds=True)
        for quantity in self._meanings:
            lay_down(live, quantity, registers[quantity.space, quantity.address], swapped=self.word_order_swapped)

    def _show_identity(self, live: Cells) -> None:
        shown = self.readings.identity() | {"config_hash": self._config_hash()} | dict(self._map.expected)
        for quantity in self._identity:
            value = shown[quantity.name]
            if quantity.type == "string":
                for place, word in enumerate(text_words(quantity, str(value))):
                    live[quantity.space, quantity.address + place] = word
            else:
                digits = "".join(letter for letter in str(value) if letter.isdigit())
                raw = raw_of(quantity, float(digits or 0) if isinstance(value, str) else value)
                if quantity.bit is not None:
                    # Other bits of its register may be identity, too.
                    before = live.get((quantity.space, quantity.address), 0)
                    raw = before & ~(1 << quantity.bit) | (raw & 1) << quantity.bit
                lay_down(live, self._whole(quantity), raw, swapped=self.word_order_swapped)

    def _show_limits(self, live: Cells) -> None:
        for quantity in self._limits:
            lay_down(live, quantity, self._limit(quantity), swapped=False)  # as the host has written it

    def _limit(self, quantity: Quantity) -> int:
        """The bits that show a limit."""
        held = float(getattr(self.actuator.limits, LIMIT_FIELDS[quantity.name]))
        if quantity.name == "watchdog_time":
            held *= 1e-3
        elif quantity.name == "watchdog_action":
            held = _code(self._map.words.watchdog_actions, int(held))
        return raw_of(quantity, held)

    def _config_hash(self) -> int:
        """CRC-32 of the words of the limits, in the order of their addresses, as big-endian bytes."""
        words = (word for one in self._limits for word in words_of(one, self._limit(one)))
        return zlib.crc32(b"".join(word.to_bytes(2, "big") for word in words))

    # Cells

    def _raw(self, quantity: Quantity, live: Cells | None = None) -> int:
        """The bits that a host has written, or the device laid down, for a quantity; first of all what is `live`."""
        held, live, space = self._cells, live or {}, quantity.space
        words = []
        for at in quantity.cells[: quantity.length]:
            cell = (space, at)
            words.append(live[cell] if cell in live else held.get(cell, 0))
        if space in BITS:
            return words[0]
        raw = bits_of(quantity, words)
        return raw if quantity.bit is None else raw >> quantity.bit & 1

    @staticmethod
    def _whole(quantity: Quantity) -> Quantity:
        """The register of which a quantity is one bit; any other as it is."""
        return quantity if quantity.bit is None else replace(quantity, bit=None)

    def _pointed(self, cell: Cell) -> Cell:
        """Where what is shown at an address of the indirect data comes from."""
        indirect = self._map.indirect
        if indirect is None or cell[0] != indirect.space or not 0 <= cell[1] - indirect.data < len(indirect.sources):
            return cell
        entry_of, further = indirect.entry_of(cell[1] - indirect.data)
        at = indirect.pointers + entry_of * indirect.pointer_registers
        words = [self._cells.get((HOLDING, at + place), 0) for place in range(indirect.pointer_registers)]
        entry = sum(word << 16 * place for place, word in enumerate(reversed(words))) - indirect.pointer_offset
        entry += further
        spaces = [one.space for one in indirect.quantities if entry in one.cells]
        return (spaces[0], entry) if spaces else (HOLDING, entry)

    def _pointers(self) -> set[Cell]:
        indirect = self._map.indirect
        if indirect is None:
            return set()
        count = len(indirect.addresses) * indirect.pointer_registers
        return {(HOLDING, indirect.pointers + place) for place in range(count)}

    def _spans(self) -> set[Cell]:
        recipes = self._map.recipes
        every = (*recipes.commands.values(), recipes.setpoint, recipes.feed, recipes.table)
        spans = [step.span for recipe in every for step in recipe if isinstance(step, Write) and step.span]
        return {(HOLDING, address) for low, high in spans for address in range(low, high + 1)}

    def _recognised(self, recipes: Mapping[Command, Recipe]) -> Scripts:
        """What recognises these recipes by what a host writes."""
        return Scripts(scripts_of(recipes), lambda one, value: raw_of(one, float(value)), self._raw)

    @staticmethod
    def _named(recipe: Iterable[object]) -> dict[str, object]:
        """Quantity -> what is written to it, of all steps."""
        steps = [step for step in recipe if isinstance(step, Write)]
        return {quantity.name: value for step in steps for quantity, value in step.values.items()}


def registers_of(actuator: Actuator, options: RigOptions, random: np.random.Generator) -> RegisterBank:
    """The registers of a controller, as its map says.

    Raises:
        FileProblem: the map cannot be used: everything that is wrong.
    """
    return RegisterBank(actuator, options.servo, random, emulated_map(options.controller))


def _resolved(test: Test, given: dict[str, float]) -> Test:
    """A test with a recipe's values put in."""
    expected = tuple(given.get(one[1:], 0) if isinstance(one, str) else one for one in test.expected)
    return replace(test, expected=expected)


def _measured(quantity: Quantity, shown: Mapping[str, float]) -> int:
    """The bits of a quantity of the status; counters and clocks start again at the end of their register."""
    name = quantity.name
    if name in CLOCKS:
        clock_us = shown[f"{name}_us"]
        if not quantity.step:
            return raw_of(quantity, 1e-6 * clock_us)
        number = math.floor(clock_us / (1e6 * quantity.scale * quantity.factor))
    elif name in MODULAR and quantity.step:
        number = int(shown[name] / (quantity.scale * quantity.factor) + 1e-6)
    else:
        return raw_of(quantity, float(shown[name]))
    if quantity.type in DECIMAL:
        return digits_of(number % quantity.numbers, quantity)
    return number & (1 << 16 * quantity.length) - 1


def _code(codes: Codes, number: int) -> int:
    """The device's code; one that it has no word for is the first code that means nothing: 0 where that is free."""
    try:
        return codes.code(number)
    except LocalProtocolError:
        named = {code for given in codes.codes.values() for code in given}
        return next(code for code in range(len(named) + 1) if code not in named)


def _cells(quantities: Iterable[Quantity]) -> set[Cell]:
    return {(one.space, address) for one in quantities for address in one.cells}


def _shown_bits(emulated: ControllerMap) -> dict[Cell, set[int | None]]:
    """Bits of each register that the machine's state determines; None: all bits."""
    words = emulated.words
    rules = (*words.states.rules, *words.pressure.rules.values())
    conditions = [rule.condition for rule in rules]
    conditions += [condition for bits in (words.faults, words.inputs) for _, condition in bits.conditions]
    shown: dict[Cell, set[int | None]] = {}
    for condition in conditions:
        for test in () if condition is None else condition.tests:
            bit = test.quantity.bit if test.bit is None else test.bit
            shown.setdefault((test.quantity.space, test.quantity.address), set()).add(bit)
    for bits in (words.faults, words.inputs):
        if bits.quantity is not None:
            shown.setdefault((bits.quantity.space, bits.quantity.address), set()).add(None)
    if "state" in emulated.quantities:
        state = emulated.quantities["state"]
        shown.setdefault((state.space, state.address), set()).add(None)
    return shown


def _allowed(emulated: ControllerMap) -> set[Cell]:
    """Every address that is there: what the map names, and the gaps that it allows to be read."""
    held = _cells(emulated.quantities.values())
    # However many registers a request may have: which ones a host reads together is its own choice.
    for read in reads(emulated.quantities.values(), replace(emulated.rules, largest_read=LAST_ADDRESS + 1)):
        held |= {(read.space, read.address + place) for place in range(read.count)}
    if emulated.indirect is not None:
        held |= _cells(emulated.indirect.shown().values())
        count = len(emulated.indirect.addresses) * emulated.indirect.pointer_registers
        held |= {(HOLDING, emulated.indirect.pointers + place) for place in range(count)}
    return held
