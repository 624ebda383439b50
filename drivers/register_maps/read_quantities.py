"""The tables [modbus] and [quantities] of a register map: where everything lies, and how it is coded."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from drivers.register_maps.access_plan import Rules
from drivers.register_maps.entries import Table, listed
from drivers.register_maps.quantity import (
    BITS,
    COIL,
    FLOATS,
    HOLDING,
    LAST_ADDRESS,
    MASK_WRITE,
    READ_ONLY,
    SPACES,
    TYPES,
    Quantity,
)
from protocols.wire_units import UNITS, unit_of

ORDERS = ("big", "little")
ACCESS = ("r", "w", "rw")

ROLES: Mapping[str, str] = {
    "state": "", "position": "length", "velocity": "speed", "setpoint": "length", "servo_error": "length",
    "force": "force", "fault_bits": "", "inputs": "", "heartbeat": "", "clock": "time", "cycles_done": "",
    "phase": "", "pulse_count": "", "pulse_clock": "time", "acked_sequence": "", "acked_command": "", "result": "",
    "owner": "", "watchdog_echo": "", "supply_pressure": "pressure", "accumulator_pressure": "pressure",
    "program_id": "",
}  # fmt: skip
"""Quantities of the status that mean something here by their name, and what they measure."""
LIMITS: Mapping[str, str] = {
    "position_min": "length", "position_max": "length", "speed_max": "speed", "acceleration_max": "acceleration",
    "force_max": "force", "fade_out_cycles": "number", "halt_deceleration": "acceleration", "watchdog_time": "time",
    "watchdog_action": "",
}  # fmt: skip
IDENTITY = ("boot_count", "config_hash", "vendor", "model", "serial_number", "firmware")
NUMBERED = frozenset({"boot_count", "config_hash"})
LEAST_STEP = 1e-200
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_WHOLE = frozenset(name for name, measures in ROLES.items() if not measures) | {"watchdog_action"}


@dataclass(frozen=True)
class Modbus:
    """What holds for all quantities that do not say otherwise.

    Attributes:
        first_address: what the file calls the first register or coil of each space.
        read_while_writing: function 23 may be used.
    """

    word_order: str
    byte_order: str
    space: str
    first_address: Mapping[str, int]
    write_function: int
    coil_function: int
    rules: Rules
    read_while_writing: bool


def read_modbus(table: Table) -> Modbus:
    """The table [modbus]."""
    first = table.get("first_address", 0)
    starts = {space: first.get(space, 0) if isinstance(first, Mapping) else first for space in SPACES}
    holding = starts[HOLDING]
    unreadable = tuple((low - holding, high - holding) for low, high in table.get("unreadable", ()))
    return Modbus(
        table.get("word_order", "big"), table.get("byte_order", "big"), table.get("function", HOLDING), starts,
        table.get("write_function", 16), table.get("coil_function", 5),
        Rules(table.get("largest_gap", 8), table.get("largest_read", 125), unreadable, tuple(starts.items())),
        table.get("read_while_writing", False),
    )  # fmt: skip


def read_quantities(table: Table, modbus: Modbus) -> dict[str, Quantity]:
    """The table [quantities]; those that are wrong are left out, and their problems kept."""
    result: dict[str, Quantity] = {}
    for name in table:
        if not _NAME.fullmatch(name):
            table.add(name, "is not a valid name; allowed: letters, digits and _, starting with a letter, such as "
                "servo_error")
        entry = table.table(name)
        quantity = _quantity(name, entry, modbus)
        if quantity is not None:
            _check(quantity, entry)
            _check_split(quantity, entry, modbus)
            result[name] = quantity
    _overlaps(table, result)
    return result


def _quantity(name: str, entry: Table, modbus: Modbus) -> Quantity | None:
    space = entry.get("function", modbus.space)
    bits = space in BITS
    first = modbus.first_address[space]
    cells = [address - first for address in listed(entry.get("address"))]
    address = min(cells)
    bit = entry.get("bit")
    kind = entry.get("type", "bit" if bits else "u16")
    if bits and kind != "bit":
        entry.add("type", f"{kind!r}: a {space} has only one bit. Fix: remove type")
        return None
    if not (address >= 0 and max(cells) <= LAST_ADDRESS):
        given = ", ".join(str(cell + first) for cell in cells)
        entry.add("address", f"{given} must be a whole number from {first} to {first + LAST_ADDRESS}")
        return None
    words = 1 if bits else TYPES[kind][1]
    if len(cells) > 1 and (len(cells) != words or len(set(cells)) < words or "count" in entry):
        entry.add("address", f"a value of type {kind} in separate registers requires {words or 'no list of'} different "
            "addresses, highest word first, and no count")
        return None
    if len(cells) > 1 and "word_order" in entry:
        entry.add("word_order", "contradicts the list of addresses, which starts with the highest word. Fix: remove "
            "word_order")
    if kind == "bit" and not bits:
        if bit is None:
            entry.add("type", "type 'bit' applies only to a coil or a discrete input. Fix: for a bit of a "
                "register, write bit = 0 to 15")
            return None
        kind = "u16"
    access = entry.get("access", "r" if space in READ_ONLY or bit is not None else "rw")
    function = entry.get("write_function", modbus.coil_function if space == COIL else modbus.write_function)
    allowed = (5, 15) if space == COIL else (6, 16) if bit is None else (6, 16, MASK_WRITE)
    if function not in allowed:
        entry.add("write_function", f"{function} is not {', '.join(map(str, allowed[:-1]))} or {allowed[-1]}")
    if kind == "string" and "length" not in entry:
        entry.add(None, "length is missing. Fix: write length, a whole number from 1 to 120")
    elif "length" in entry and kind != "string":
        entry.add("length", "applies only to strings; for a table of values, use count")
    length = entry.get("length", 1) if kind == "string" else max(1, TYPES[kind][1])
    return Quantity(
        name, space, address, kind, length, entry.get("count", 1), _scale(entry), float(entry.get("offset", 0.0)),
        1.0 if (unit := unit_of(entry.get("unit", ""))) is None else unit.scale, measures(entry),
        "big" if len(cells) > 1 else entry.get("word_order", modbus.word_order),
        entry.get("byte_order", modbus.byte_order), bit, "r" in access, "w" in access, function,
        tuple(cell - address for cell in cells) if len(cells) > 1 else (),
    )  # fmt: skip


def _scale(entry: Table) -> float:
    scale = float(entry.get("scale", 1.0))
    if scale == 0.0:
        entry.add("scale", "a scale of 0 would make every value 0. Fix: enter the value of one count, such as 0.001")
        return 1.0
    return scale


def measures(entry: Table) -> str:
    """What an entry's unit measures; empty where it has none."""
    unit = unit_of(entry.get("unit", ""))
    return "" if unit is None else unit.dimension


def _check(quantity: Quantity, entry: Table) -> None:
    """A quantity by itself: it ends within the registers, may be accessed as it says, and measures what its name is."""
    if quantity.end > LAST_ADDRESS + 1:
        entry.add("address", f"the {quantity.end - quantity.address} registers extend beyond the last register, 65535")
    if quantity.written and quantity.space in READ_ONLY:
        entry.add("access", f'{quantity.space} registers cannot be written. Fix: access = "r"')
    if quantity.bit is not None and quantity.written and not quantity.read and quantity.write_function != MASK_WRITE:
        entry.add("access", "to write a bit, the program must first read the other bits of its register. Fix: access = "
            f'"rw", or write_function = {MASK_WRITE} if the device supports mask writes, or describe the whole '
            "register")
    if quantity.bit is not None and not quantity.whole:
        entry.add("bit", "a single bit cannot have a scale, an offset or a unit")
    if quantity.type == "string" and (quantity.scale, quantity.offset, quantity.factor) != (1.0, 0.0, 1.0):
        entry.add("type", "a string cannot have a scale, an offset or a unit")
    _check_type(quantity, entry)
    name = quantity.name
    expected_unit = ROLES.get(name) or LIMITS.get(name) or ""
    given = measures(entry)
    if expected_unit and given and given != expected_unit:
        known = [name for name, unit in UNITS.items() if unit.dimension == expected_unit]
        entry.add("unit", f"{name} is a {expected_unit}; its unit must be one of {', '.join(known)}")
    if name in ROLES and not quantity.read:
        entry.add("access", f"{name} is part of the status and must be readable")
    if name in LIMITS and not (quantity.read and quantity.written):
        entry.add("access", f'{name} is a limit, which is written and read back, so its access must be "rw"')
    if quantity.values > 1 and (name in ROLES or name in LIMITS or name in IDENTITY):
        entry.add("count", f"{name} must be a single value")


def _check_split(quantity: Quantity, entry: Table, modbus: Modbus) -> None:
    """Check that one request reads a split value; otherwise its words could belong to different values."""
    if not quantity.places or not quantity.read:
        return
    rules, first = modbus.rules, modbus.first_address[quantity.space]
    low, high = quantity.address, quantity.end - 1
    hole = next((hole for hole in rules.unreadable if hole[0] <= high and low <= hole[1]), None)
    if high - low + 1 > rules.largest_read:
        why = f"are {high - low + 1} registers apart, but a request reads at most {rules.largest_read}"
    elif hole is not None:
        why = f"enclose the unreadable registers {hole[0] + first} to {hole[1] + first}"
    else:
        return
    entry.add("address", f"the registers {low + first} and {high + first} {why}; words that are read at different "
        "times can belong to different values. Fix: use registers that one request can read, or [indirect]")


def _check_type(quantity: Quantity, entry: Table) -> None:
    """What a quantity is called can be a number of its type."""
    name = quantity.name
    if name in _WHOLE and (quantity.type in FLOATS or quantity.type == "string" or not quantity.whole):
        entry.add("type", f"{name} must be a whole number without scale, offset and unit (code, count or bits)")
    if quantity.type == "string" and (ROLES.get(name) or LIMITS.get(name) or name in NUMBERED):
        entry.add("type", f"{name} must be a number, not a string")
    if name in NUMBERED and quantity.type in FLOATS:
        entry.add("type", f"{name} must be a whole number, not {quantity.type}")
    if quantity.step < LEAST_STEP and quantity.type not in {*FLOATS, "string"}:
        entry.add("scale", f"{quantity.scale:g}: a step below {LEAST_STEP:g} is implausible")


def _overlaps(table: Table, result: Mapping[str, Quantity]) -> None:
    """No register means two things, but for its bits, and one thing read and another written."""
    taken: dict[tuple[str, int], Quantity] = {}
    for quantity in sorted(result.values(), key=lambda one: (one.space, one.address)):
        for address in quantity.cells:
            other = taken.setdefault((quantity.space, address), quantity)
            bits = quantity.bit is not None or other.bit is not None
            both = (quantity.read and other.read) or (quantity.written and other.written)
            if other is not quantity and both and not bits:
                table.add(
                    quantity.name, f"overlaps {other.name!r}: both use {quantity.space} {address} (wire address); "
                    f"{other.name!r} occupies {min(other.cells)} to {max(other.cells)}"
                )
                break
