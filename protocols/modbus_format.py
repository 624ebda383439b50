"""A sensor whose readings are Modbus registers: the request for one, and its answer as a binary frame.

The device is the server; each reading is one request (function 3 or 4) and one answer, framed as Modbus TCP or as
Modbus RTU (Modbus Application Protocol V1.1b3, MODBUS Messaging on TCP/IP V1.0b, MODBUS over Serial Line V1.02).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from protocols.binary_format import SIZES, BinaryFormat, Field, Registers
from protocols.checksums import CHECKSUMS
from protocols.descriptions import Place, Problem
from protocols.exchange import Exchange
from protocols.format_checks import field_problems

FRAMINGS = ("tcp", "rtu")
FUNCTIONS: Mapping[str, int] = {"holding": 3, "input": 4}
TYPES = ("u16", "i16", "u32", "i32", "u64", "i64", "f32", "f64")
LAST_ADDRESS = 0xFFFF
MOST_REGISTERS = 125
"""Registers of one request."""
_TRANSACTION = bytes([0, 1, 0, 0])
"""Transaction and protocol identifier: requests go out one at a time, so that all may have the same."""
OTHERS = ("status", "decimals")
"""Tables that describe a separate register, read together with the reading."""
_CRC = "crc16-modbus"


def modbus_format(values: Mapping[str, Any], problems: list[Problem]) -> BinaryFormat | None:
    """The format of one register; None, with its problems added, where entries contradict each other.

    Args:
        values: entries of a table of kind "modbus", each of its type and range.
        problems: what is wrong is added.
    """
    type_, status = values.get("type", "u16"), values.get("status")
    count = SIZES[type_] // 2
    base = values.get("first_address", 0)
    _check_addresses(values, count, problems)
    if problems:
        return None
    first = values["address"] - base
    others = {key: values[key]["address"] - base for key in OTHERS if key in values}
    begin = min([first, *others.values()])
    end = max([first + count, *(place + 1 for place in others.values())])
    if end - begin > MOST_REGISTERS:
        text = f"is too far from the address of the reading; one request reads at most {MOST_REGISTERS} registers"
        problems.append(((max(others, key=lambda key: abs(others[key] - first)), "address"), text))
        return None
    unit, function = values.get("device_id", 1), FUNCTIONS[values.get("function", "holding")]
    asked = bytes([unit, function, *begin.to_bytes(2, "big"), *(end - begin).to_bytes(2, "big")])
    head, data = bytes([unit, function, 2 * (end - begin)]), 2 * (end - begin)
    rtu = values.get("framing", FRAMINGS[0]) == "rtu"
    if rtu:
        asked += CHECKSUMS[_CRC].of(asked).to_bytes(2, "little")
        sync, length = head, len(head) + data + 2
    else:
        asked = _TRANSACTION + len(asked).to_bytes(2, "big") + asked
        sync = _TRANSACTION + (len(head) + data).to_bytes(2, "big") + head
        length = len(sync) + data
    fields = {"value": _value(values, type_, len(sync) + 2 * (first - begin))}
    if status is not None:
        masks = {key: status[key] for key in ("overload_bits", "fault_bits") if key in status}
        at = len(sync) + 2 * (others["status"] - begin)
        fields["status"] = Field(at, "u16", values.get("byte_order", "big"), **masks)
    if "decimals" in others:
        at = len(sync) + 2 * (others["decimals"] - begin)
        fields["decimals"] = Field(at, "u16", values.get("byte_order", "big"))
    made = BinaryFormat(
        name=values.get("name", "custom"), sync=sync, length=length, fields=fields,
        checksum=_CRC if rtu else "none", checksum_at=length - 2, checksum_over=(0, length - 3),
        checksum_order="little", unit=values.get("unit", "N"), nominal_rate_Hz=values.get("nominal_rate_Hz"),
        exchange=Exchange(request=asked, answer_timeout_s=1e-3 * values.get("answer_timeout_ms", 100.0)),
        registers=Registers(
            unit, function, begin, end - begin, rtu, values.get("largest_gap", 0), base, (first, count)
        ),
    )  # fmt: skip
    for name, field in fields.items():
        problems += (((*((name,) * (name in OTHERS)), *place), text)
                     for place, text in field_problems(name, field, made))  # fmt: skip
    return None if problems else made


def _value(values: Mapping[str, Any], type_: str, at: int) -> Field:
    """The field of the value: its registers in their order, the bytes of each in theirs."""
    orders = values.get("word_order", "big"), values.get("byte_order", "big")
    same = ("scale", "offset", "valid", "overload_values", "fault_values")
    return Field(
        at, type_, orders[1], signed=type_.startswith("i"), words_swapped=orders[0] != orders[1],
        **{key: values[key] for key in same if key in values},
    )


def _check_addresses(values: Mapping[str, Any], count: int, problems: list[Problem]) -> None:
    """Registers that are missing, or lie outside the address range."""
    if "address" not in values:
        problems.append(((), "key 'address' is missing; it states the address of the first register of the reading"))
        return
    base = values.get("first_address", 0)
    places: list[tuple[Place, int, int]] = [(("address",), values["address"], count)]
    places += [((key, "address"), values[key]["address"], 1) for key in OTHERS if key in values]
    for place, register, registers in places:
        if not base <= register <= base + LAST_ADDRESS + 1 - registers:
            last = base + LAST_ADDRESS + 1 - registers
            problems.append((place, f"must be from {base} (first_address) to {last}"))
    for place, register, _ in () if problems else places[1:]:
        if places[0][1] <= register < places[0][1] + count:
            problems.append((place, "belongs to the value"))
