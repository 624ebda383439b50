"""What a device's codes and bits mean in the rig's words, and back."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from functools import cached_property

from drivers.register_maps.condition import Condition, Values
from drivers.register_maps.quantity import Quantity
from drivers.roles import UNNAMED, Pressure, State
from protocols.errors import LocalProtocolError

UNNAMED_BITS = 32
"""So far up a bit is moved that has no name and whose number has another meaning here."""


def word(member: IntEnum | IntFlag) -> str:
    """A member as files write it: `fade-stop`."""
    return str(member.name).lower().replace("_", "-")


class Codes:
    """What a register's codes mean, there and back; a meaning may have several codes, the first is written.

    Args:
        meaning: the rig's words.
        codes: of the file.
    """

    def __init__(self, meaning: type[IntEnum], codes: Mapping[IntEnum, tuple[int, ...]]) -> None:
        self.codes = {int(member): given for member, given in codes.items()}
        self._meaning = {code: int(member) for member, given in codes.items() for code in given}
        self._members = tuple(meaning)
        self._taken = {int(member) for member in meaning}

    def meaning(self, code: int) -> int:
        """The rig's number of a device's code; one without a name is shown as it is, or moved out of the way."""
        named = self._meaning.get(code)
        if named is not None:
            return named
        return code + UNNAMED if code in self._taken else code

    def code(self, number: int) -> int:
        """The device's code of one of the rig's numbers; what `meaning` made of an unnamed code becomes that again.

        Raises:
            LocalProtocolError: the device has none.
        """
        known = self.codes.get(number)
        if known is not None:
            return known[0]
        if number in self._taken:
            name = next(word(member) for member in self._members if member == number)
            raise LocalProtocolError(f"{name} is not supported by this controller")
        return number - UNNAMED if number - UNNAMED in self._taken else number


@dataclass(frozen=True)
class Bits:
    """What a register's bits mean, and what else means one of the rig's bits.

    Attributes:
        quantity: the register, None where all are conditions.
        places: bit of the register -> the rig's bit.
        conditions: the rig's bit, and what makes it.
        taken: all bits that mean something to the rig.
    """

    quantity: Quantity | None
    places: Mapping[int, int]
    conditions: tuple[tuple[int, Condition], ...]
    taken: int

    def meaning(self, values: Values) -> int:
        """The rig's bits for what the device shows; bits without a name are moved out of the way of named ones."""
        result = 0
        if self.quantity is not None:
            shown = int(values[self.quantity.name])
            for place, member in self.places.items() if shown else ():
                result |= member if shown >> place & 1 else 0
            rest = shown & ~self._named
            if self.quantity.name in {"fault_bits", "inputs"}:
                result |= rest & ~self.taken | (rest & self.taken) << UNNAMED_BITS
        for member, condition in self.conditions:
            result |= member if condition.holds(values) else 0
        return result

    @cached_property
    def _named(self) -> int:
        """The register's bits that have a name."""
        return sum(1 << place for place in self.places)

    @cached_property
    def members(self) -> int:
        """All of the rig's bits that this device can show."""
        result = 0
        for member in (*self.places.values(), *(member for member, _ in self.conditions)):
            result |= member
        return result

    @property
    def quantities(self) -> frozenset[Quantity]:
        """What must be read."""
        own: Iterable[Quantity] = () if self.quantity is None else (self.quantity,)
        return frozenset(own).union(*(condition.quantities for _, condition in self.conditions))


@dataclass(frozen=True)
class StateRule:
    """A state, and what makes it: codes of the quantity `state`, or a condition."""

    state: int
    codes: tuple[int, ...] = ()
    condition: Condition | None = None

    def holds(self, values: Values) -> bool:
        """Whether the device is in this state, unless an earlier rule says otherwise."""
        if self.condition is not None:
            return self.condition.holds(values)
        return int(values["state"]) in self.codes


@dataclass(frozen=True)
class States:
    """The rules in the file's order; the first that holds decides."""

    rules: tuple[StateRule, ...]
    codes: Codes

    def meaning(self, values: Values) -> int:
        """The rig's state; what no rule names is shown as the device's code, moved out of the way of named ones."""
        for rule in self.rules:
            if rule.holds(values):
                return rule.state
        return self.codes.meaning(int(values["state"])) if "state" in values else UNNAMED

    def pressure(self, values: Values) -> Pressure:
        """The pressure by the rules, a latched trip apart: what the rules say of the rest of the state.

        Behind a trip only codes or a condition prove that there is none; an `off = true` is what is left over.
        """
        tripped = False
        for rule in self.rules:
            if not rule.holds(values):
                continue
            if rule.state == State.TRIPPED:
                tripped = True
                continue
            stated = bool(rule.codes or (rule.condition is not None and rule.condition.tests))
            if tripped and not stated:
                break
            return {State.OFF: Pressure.OFF, State.LOW: Pressure.LOW}.get(State(rule.state), Pressure.ON)
        return Pressure.UNKNOWN

    @cached_property
    def known(self) -> frozenset[int]:
        """States that this device shows."""
        return frozenset(rule.state for rule in self.rules)

    @property
    def quantities(self) -> frozenset[Quantity]:
        """What conditions look at, beside the quantity `state`."""
        return frozenset[Quantity]().union(*(rule.condition.quantities for rule in self.rules if rule.condition))


@dataclass(frozen=True)
class PressureRules:
    """What shows the pressure, separately from the state; empty where the map has no [pressure].

    Attributes:
        rules: the pressure, and what makes it. The highest that holds counts.
    """

    rules: Mapping[Pressure, StateRule]

    def meaning(self, values: Values) -> Pressure:
        """The pressure; unknown where no rule holds."""
        shown = [pressure for pressure, rule in self.rules.items() if rule.holds(values)]
        return max(shown, default=Pressure.UNKNOWN)

    @property
    def quantities(self) -> frozenset[Quantity]:
        """What must be read, beside the quantity `state`."""
        return frozenset[Quantity]().union(*(
            rule.condition.quantities for rule in self.rules.values() if rule.condition
        ))
