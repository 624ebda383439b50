"""What a device shows of its state in an emulated map: codes, bits, conditions made true, as the map has them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from drivers.register_maps.condition import Condition, Test
from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.meanings import Bits
from drivers.register_maps.quantity import Quantity
from drivers.roles import Pressure, State
from simulators.emulated_codec import raw_of, value_of

Registers = dict[tuple[str, int], int]
"""Raw numbers by space and first address: a quantity and its bits share one."""

STATES_SHOWN_AS: Mapping[State, tuple[State, ...]] = {
    State.LOW: (State.OFF, State.HOLD), State.OFF: (State.LOW, State.HOLD), State.HOLD: (),
    State.MOVING: (State.RUNNING, State.HOLD), State.RUNNING: (State.MOVING, State.HOLD),
    State.FADING: (State.RUNNING, State.MOVING, State.HOLD), State.HALTING: (State.MOVING, State.RUNNING, State.HOLD),
    State.TRIPPED: (),
}  # fmt: skip
"""States that a device shows in place of one it has no word for."""


class EmulatedStatus:
    """Makes a map's conditions true.

    Args:
        emulated: the map.
    """

    def __init__(self, emulated: ControllerMap) -> None:
        self._map = emulated
        words = emulated.words
        every = words.states.quantities | words.faults.quantities | words.inputs.quantities | words.pressure.quantities
        self.quantities = every | {emulated.quantities[name] for name in ("state",) if name in emulated.quantities}

    def show(
        self, registers: Registers, state: State, motion: State, fault_bits: int, inputs: int, pressure: Pressure
    ) -> None:
        """Lay state, faults, inputs and pressure down.

        Args:
            registers: what is shown so far of `quantities`; changed in place.
            state: the device's.
            motion: what its rod does, also while it is tripped.
            fault_bits: the rig's.
            inputs: the rig's.
            pressure: the rig's.
        """
        if pressure is Pressure.LOW and pressure not in self._map.words.pressure.rules:
            pressure = Pressure.ON  # low pressure is not the absence of it
        for bits, shown in ((self._map.words.faults, fault_bits), (self._map.words.inputs, inputs)):
            self._show_bits(registers, bits, shown)
        self._show_state(registers, state if state in self._known else motion, pressure)
        for shown_pressure, rule in self._map.words.pressure.rules.items():
            if rule.condition is not None:
                make(registers, rule.condition, holds=shown_pressure is pressure)

    @property
    def _known(self) -> frozenset[int]:
        return self._map.words.states.known

    def _show_state(self, registers: Registers, state: State, pressure: Pressure) -> None:
        shown = next((one for one in (state, *STATES_SHOWN_AS[state]) if one in self._known), State.HOLD)
        for rule in self._map.words.states.rules:
            if rule.state != shown:
                if rule.condition is not None and rule.condition.tests:
                    make(registers, rule.condition, holds=False)
                continue
            if rule.condition is not None:
                make(registers, rule.condition, holds=True)
            else:
                state_register = self._map.quantities["state"]
                put(registers, state_register, None, self._code(rule.codes, pressure))
            break
        if shown is State.TRIPPED:
            self._show_off_behind_a_trip(registers, pressure)

    def _code(self, codes: tuple[int, ...], pressure: Pressure) -> int:
        """Of a state's codes the one that shows the pressure, too."""
        rules = self._map.words.pressure.rules
        own = set(rules[pressure].codes) if pressure in rules else set()
        others = {code for rule in rules.values() for code in rule.codes} - own
        return min(codes, key=lambda code: (code not in own, code in others))

    def _show_off_behind_a_trip(self, registers: Registers, pressure: Pressure) -> None:
        """A condition of `off` of its own shows the pressure of a tripped device, too."""
        before = dict(registers)
        for rule in self._map.words.states.rules:
            if rule.state == State.OFF and rule.condition is not None and rule.condition.tests:
                make(registers, rule.condition, holds=pressure is Pressure.OFF)
        trips = [rule for rule in self._map.words.states.rules if rule.state == State.TRIPPED]
        if any(rule.condition is not None and not shows(registers, rule.condition) for rule in trips):
            registers.clear()
            registers.update(before)

    def _show_bits(self, registers: Registers, bits: Bits, shown: int) -> None:
        if bits.quantity is not None:
            for place, member in bits.places.items():
                put(registers, bits.quantity, place, int(bool(shown & member)))
        for member, condition in bits.conditions:
            make(registers, condition, holds=bool(shown & member))


def make(registers: Registers, condition: Condition, *, holds: bool) -> None:
    """Make a condition true, or untrue by the first of its tests that can be."""
    if holds:
        for test in condition.tests:
            _make_test(registers, test, holds=True)
    elif condition.tests and shows(registers, condition):
        _make_test(registers, condition.tests[0], holds=False)


def shows(registers: Registers, condition: Condition) -> bool:
    """Whether a condition holds for what is shown."""
    return all(_is(registers, test) for test in condition.tests)


def _is(registers: Registers, test: Test) -> bool:
    """Whether a test holds for what is shown."""
    raw = taken(registers, test.quantity, None)
    shown = value_of(test.quantity, raw)
    return test.holds({test.quantity.name: int(shown) if test.quantity.whole else shown}, _Zeros())


class _Zeros(dict[str, int]):
    def __missing__(self, key: str) -> int:
        return 0


def _make_test(registers: Registers, test: Test, *, holds: bool) -> None:
    if _is(registers, test) is holds:
        return
    for value in _candidates(test):
        before = dict(registers)
        if test.bit is not None:
            put(registers, test.quantity, test.bit, int(value) & 1)
        else:
            put(registers, test.quantity, None, raw_of(test.quantity, value))
        if _is(registers, test) is holds:
            return
        registers.clear()
        registers.update(before)


def _candidates(test: Test) -> Iterator[float]:
    """Values with which a test may hold, or not."""
    step = test.quantity.step or 1.0
    for value in test.expected:
        number = 0.0 if isinstance(value, str) else float(value)
        yield from (number, number + step, number - step)
    yield from (0.0, 1.0)


def put(registers: Registers, quantity: Quantity, bit: int | None, raw: int) -> None:
    """Set a quantity, or one of its bits."""
    place = quantity.bit if bit is None else bit
    key = (quantity.space, quantity.address)
    before = registers.get(key, 0)
    registers[key] = raw if place is None else before & ~(1 << place) | (raw & 1) << place


def taken(registers: Registers, quantity: Quantity, bit: int | None) -> int:
    """What a quantity, or one of its bits, shows."""
    place = quantity.bit if bit is None else bit
    shown = registers.get((quantity.space, quantity.address), 0)
    return shown if place is None else shown >> place & 1


