"""Conditions and the tables of codes and bits of a register map: [state], [faults], [inputs], [phase] ..."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from enum import IntEnum, IntFlag
from typing import Any, TypeVar

from drivers.register_maps.condition import COMPARISONS, Condition, Test
from drivers.register_maps.entries import Table, listed
from drivers.register_maps.meanings import Bits, Codes, PressureRules, StateRule, States, word
from drivers.register_maps.quantity import Quantity, Value
from drivers.roles import Pressure, State
from protocols.near_miss import meant

Quantities = Mapping[str, Quantity]
Meaning = TypeVar("Meaning", bound=IntEnum)

LARGEST_CODE = (1 << 32) - 1


def read_condition(table: Table, key: str, quantities: Quantities, names: Collection[str] = ()) -> Condition:
    """A condition: a table, or a list of tables that hold together.

    Args:
        table: holds it.
        key: its name there.
        quantities: of the file.
        names: what a recipe may ask for, without the "$".
    """
    read = (_test(Table(table.source, (*table.place, key), test), quantities, names) for test in listed(table.get(key)))
    return Condition(tuple(test for test in read if test is not None))


def _test(table: Table, quantities: Quantities, names: Collection[str]) -> Test | None:
    name = table.get("quantity")
    quantity = quantities.get(name)
    if quantity is None:
        table.add(None, f"quantity {name!r} is not in [quantities]; {meant(name, quantities)}")
        return None
    if not quantity.read:
        table.add(None, f"{name!r} cannot be read because its access is \"w\"")
    if quantity.type == "string":
        table.add(None, f"{name!r} is a string; a condition requires a number")
    if quantity.values > 1:
        table.add(None, f"{name!r} has {quantity.values} values; a condition requires a single number")
    bit = table.get("bit")
    if bit is not None and bit >= 16 * quantity.length:
        table.add("bit", f"{name!r} has only bits 0 to {16 * quantity.length - 1}")
    if bit is not None and not quantity.whole:
        table.add("bit", f"{name!r} is not a whole number without scale, so it has no bits")
    given = [comparison for comparison in COMPARISONS if comparison in table]
    if len(given) > 1:
        table.add(None, f"got several comparisons: {', '.join(given)}. Fix: write several conditions as a list")
    if not given:
        return Test(quantity, "not_equals", (0,), bit)
    requested = listed(table.get(given[0]))
    values = [number_of(table, given[0], one, quantity if bit is None else None, names) for one in requested]
    return Test(quantity, given[0], tuple(values), bit)


def number_of(table: Table, key: str, given: Value, quantity: Quantity | None, names: Collection[str]) -> Value:
    """A number in a quantity's unit as SI, true and false as 1 and 0, or "$" and one of `names`."""
    if isinstance(given, str):
        if not given.startswith("$"):
            table.add(key, f'{given!r:.40} must be a number, true, false or a name such as "$target"')
            return 0
        if given[1:] not in names:
            table.add(key, f"{given} is not available here; {meant(given, [f'${name}' for name in names])}")
            return 0
        return given
    if isinstance(given, bool):
        return int(given)
    return given if quantity is None or quantity.factor == 1.0 else given * quantity.factor


def read_codes(table: Table, meaning: type[Meaning]) -> Codes:
    """A table word = code, or word = [codes]."""
    members = {word(member): member for member in meaning}
    owners: dict[int, str] = {}
    return Codes(meaning, {members[name]: _codes(table, name, owners) for name in table})


def _codes(table: Table, name: str, owners: dict[int, str]) -> tuple[int, ...]:
    codes = listed(table.get(name))
    for code in codes:
        if owners.setdefault(code, name) != name:
            table.add(name, f"{owners[code]} and {name} both have code {code}; a code can have only one meaning")
    return tuple(codes)


def read_states(table: Table, quantities: Quantities) -> States:
    """The table [state]: codes of the quantity `state`, or conditions."""
    members = {word(member): member for member in State}
    rules: list[StateRule] = []
    owners: dict[int, str] = {}
    codes: dict[IntEnum, tuple[int, ...]] = {}
    for name in table:
        member, given = members[name], table.get(name)
        if given is True:
            rules.append(StateRule(member, condition=Condition()))
        elif _is_condition(given):
            rules.append(StateRule(member, condition=read_condition(table, name, quantities)))
        else:
            own = _codes(table, name, owners)
            codes[member] = own
            rules.append(StateRule(member, own))
            if "state" not in quantities:
                table.add(name, "refers to a code of the quantity `state`, which is not in [quantities]. Fix: add "
                    "`state`, or write a condition")
    if "hold" not in table:
        table.add(None, "hold is missing: this entry states the code or condition that shows that the device holds its "
            "position")
    return States(tuple(rules), Codes(State, codes))


def read_pressure(table: Table, quantities: Quantities) -> PressureRules:
    """The table [pressure]: codes of the quantity `state`, or conditions; empty where there is none."""
    members = {word(member): member for member in (Pressure.OFF, Pressure.LOW, Pressure.ON)}
    rules: dict[Pressure, StateRule] = {}
    owners: dict[int, str] = {}
    for name in table:
        member, given = members[name], table.get(name)
        if _is_condition(given):
            rules[member] = StateRule(member, condition=read_condition(table, name, quantities))
        else:
            rules[member] = StateRule(member, _codes(table, name, owners))
            if "state" not in quantities:
                table.add(name, "refers to a code of the quantity `state`, which is not in [quantities]. Fix: add "
                    "`state`, or write a condition")
    if rules and Pressure.OFF not in rules:
        table.add(None, "off is missing: this entry states the code or condition that shows that the device has no "
            "pressure (or power)")
    return PressureRules(rules)


def _is_condition(given: Any) -> bool:  # noqa: ANN401 - any TOML value
    return any(isinstance(one, Mapping) for one in listed(given))


def read_bits(table: Table, meaning: type[IntFlag], quantity: Quantity | None, named: str, all_of: Quantities) -> Bits:
    """A table word = bit of one register, word = [bits], or word = condition.

    Args:
        table: to read.
        meaning: the rig's words.
        quantity: the register whose bits are meant; None: the file has none.
        named: that register's name.
        all_of: the file's quantities, for conditions.
    """
    members = {word(member): member for member in meaning}
    places: dict[int, int] = {}
    conditions: list[tuple[int, Condition]] = []
    for name in table:
        given = table.get(name)
        member = int(members[name])
        if _is_condition(given):
            conditions.append((member, read_condition(table, name, all_of)))
            continue
        most = 15 if quantity is None else 16 * quantity.length - 1
        bits = listed(given)
        if max(bits) > most:
            table.add(name, f"{given!r:.40} must be a bit of {named} (a whole number from 0 to {most}) or a condition")
            continue
        if quantity is None:
            table.add(name, f"refers to a bit of the quantity `{named}`, which is not in [quantities]. Fix: add the "
                "quantity, or write a condition")
        for bit in bits:
            if bit in places:
                other = next(other for other, one in members.items() if int(one) == places[bit])
                table.add(name, f"{other} and {name} both use bit {bit}; a bit can have only one meaning")
            places[bit] = member
    taken = sum(int(member) for member in meaning)
    return Bits(quantity if places or quantity is not None else None, places, tuple(conditions), taken)
