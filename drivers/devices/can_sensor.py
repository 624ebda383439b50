"""Format of a sensor on CAN: a signal in a DBC file or an explicitly described message, as a `BinaryFormat`.

A DBC signal becomes a field of at most eight bytes at its position in the frame, so the decoder, simulated sensor and
provenance of binary formats apply.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from drivers.devices.can_request import read_request
from drivers.devices.dbc_file import DbcMessage, DbcSignal, DbcText
from drivers.devices.role_protection import read_protection
from drivers.devices.role_reading import Found, Reading
from drivers.devices.source import read_dbc
from protocols.binary_format import SIZES, BinaryFormat, Field
from protocols.can_frame import CanFrame
from protocols.can_signals import Signal
from protocols.checksums import CHECKSUMS
from protocols.descriptions import DescriptionProblems, Place, Problem
from protocols.e2e import Protection
from protocols.errors import LocalProtocolError
from protocols.exchange import Exchange
from protocols.format_checks import field_problems, message_problems
from protocols.j1939 import from_address
from protocols.slcan import CLASSIC_LENGTH, FD_LENGTHS

_BYTE_TYPES = {size: name for name, size in SIZES.items() if name.startswith("u")}
_STANDARD_BITS = 11

Table = Mapping[str, Any]


def can_format(table: Table) -> BinaryFormat:
    """Create the format of a sensor's CAN message.

    Args:
        table: valid entries of a format of kind "can" (`rig.files.sensor_format`); the DBC file as name and text.

    Raises:
        DescriptionProblems: entries contradict each other or the DBC file; lists every problem with its key.
    """
    problems: list[Problem] = []
    made = _of_dbc(table, problems) if "dbc" in table else _by_hand(table, problems)
    if made is None or problems:
        raise DescriptionProblems(f"sensor format {str(table.get('name', 'custom'))!r}", problems)
    return made


def _of_dbc(table: Table, problems: list[Problem]) -> BinaryFormat | None:
    """The format of a signal in a DBC file."""
    for key in ("id", "length", "extended", "order", "fields", "checksum", "checksum_at", "checksum_over", "j1939"):
        if key in table:
            problems.append(((key,), "cannot be combined with dbc, because the DBC file defines this"))
    if "signal" not in table:
        problems.append(((), 'key \'signal\' is missing; write the signal, such as signal = "Message.signal"'))
    if problems:
        return None
    given = table["dbc"]
    try:
        reading = Reading(read_dbc(DbcText(given["name"], given["text"])))
    except LocalProtocolError as error:
        problems.append((("dbc",), str(error)))
        return None
    chosen = reading.find(table["signal"], ("signal",))
    if chosen is None:
        problems += ((item.place, item.text) for item in reading.problems)
        return None
    message = chosen.message
    value = _field(reading, chosen, ("signal",))
    if value is not None:
        value = replace(value, **_meaning(reading, chosen, table, ()))
    fields = {} if value is None else {"value": value}
    if "status" in table:
        fields |= _status(reading, message, table["status"])
    protection = _protection(reading, message, table)
    fields |= _sequence(reading, message, protection)
    frame = _frame(table, message, protection, chosen, problems)
    problems += ((item.place, item.text) for item in reading.problems)
    if problems or value is None:
        return None
    return _format(table, frame, fields, table.get("unit") or chosen.signal.unit or "N", problems)


def _by_hand(table: Table, problems: list[Problem]) -> BinaryFormat | None:
    """The format of a message described by its identifier and the positions of its numbers."""
    for key, what in (
        ("id", "it states the identifier of the message, such as id = 0x181"),
        ("length", "it states the number of data bytes of the message"),
        ("fields", "write a table [fields.value] with the keys `at` and `type`"),
    ):
        if key not in table:
            problems.append(((), f"key '{key}' is missing; {what}"))
    if "signal" in table:
        problems.append((("signal",), "requires dbc, the name of the DBC file"))
    if "status" in table:
        problems.append((("status",), "requires dbc. Fix: write a table [fields.status]"))
    for key in ("valid", "overload_values", "fault_values"):
        if key in table:
            problems.append(((key,), "requires dbc. Fix: write this entry in the table [fields.value]"))
    if problems:
        return None
    extended = table.get("extended", table["id"] >> _STANDARD_BITS != 0)
    if not extended and table["id"] >> _STANDARD_BITS:
        problems.append((("id",), "exceeds the 11 bits of a standard frame (0x7FF). Fix: set extended = true"))
        return None
    size = table["length"]
    if size not in FD_LENGTHS:
        sizes = ", ".join(map(str, FD_LENGTHS))
        problems.append((("length",), f"must be the length of a CAN frame (at most 8) or CAN FD frame: {sizes}"))
        return None
    message = DbcMessage(
        "", table["id"], extended, size > CLASSIC_LENGTH, size, {}, 0.0, 0, j1939=extended and table.get("j1939", False)
    )
    fields: dict[str, Field] = {}
    for name, given in table["fields"].items():
        entries = {"order": table.get("order", "little"), **{key: _plain(one) for key, one in given.items()}}
        entries["signed"] = entries.get("signed", False) or entries.get("type", "").startswith("i")
        fields[name] = Field(**entries)
    reading = Reading({})
    protection = _protection(reading, message, table)
    if "sequence" not in fields:
        fields |= _sequence(reading, message, protection)
    problems += ((item.place, item.text) for item in reading.problems)
    frame = _frame(table, message, protection, None, problems)
    return None if problems else _format(table, frame, fields, table.get("unit", "N"), problems)


def _format(
    table: Table, frame: CanFrame, fields: dict[str, Field], unit: str, problems: list[Problem]
) -> BinaryFormat | None:
    checksum = table.get("checksum", "none")
    size = 0 if checksum == "none" else CHECKSUMS[checksum].size
    at = table.get("checksum_at", frame.size - size)
    request = _request(table, frame, problems)
    made = BinaryFormat(
        name=table.get("name", "custom"), length=frame.size, fields=fields, checksum=checksum, checksum_at=at,
        checksum_over=tuple(table.get("checksum_over", (0, at - 1))),
        checksum_order=table.get("checksum_order", table.get("order", "little")),
        unit=unit, nominal_rate_Hz=table.get("nominal_rate_Hz"), can=frame,
        exchange=Exchange(request=request, answer_timeout_s=1e-3 * table.get("answer_timeout_ms", 100.0)),
    )
    if "answer_timeout_ms" in table and not request:
        problems.append((("answer_timeout_ms",), "requires a request"))
    if "fields" in table:
        given = {name: {"at": item.at} for name, item in fields.items()} | dict(table["fields"])
        problems += message_problems(made, {**table, "fields": given})
    for name, item in fields.items() if "dbc" in table else ():
        shown: Place = () if name == "value" else (name,)
        problems += (((*shown, *place), text) for place, text in field_problems(name, item, made))
    return None if problems else made


def _request(table: Table, frame: CanFrame, problems: list[Problem]) -> bytes:
    """The request for each reading; empty if the sensor sends without requests."""
    given = table.get("request")
    if given is None:
        return b""
    address = frame.source_address
    key = frame.key if address is None else from_address(frame.key, address)
    return read_request(
        given, key, frame.size, ("request",), problems, fd=frame.fd, addressed=not frame.by_group or address is not None
    )


def _frame(
    table: Table, message: DbcMessage, protection: Protection, chosen: Found | None, problems: list[Problem]
) -> CanFrame:
    """The message; J1939 messages are identified in the same way as those of the ECU."""
    address = table.get("source_address")
    by_group = message.any_address or (message.extended and (address is not None or (chosen is None and message.j1939)))
    if address is not None and not message.extended:
        problems.append((("source_address",), "applies only to a J1939 message, which has a 29-bit identifier"))
    if table.get("j1939") and not message.extended:
        problems.append((("j1939",), "requires a 29-bit identifier. Fix: set extended = true"))
    if message.size > (FD_LENGTHS[-1] if message.fd else CLASSIC_LENGTH):
        problems.append((("signal",), f"message {message.name!r} has {message.size} bytes; a sensor's message must fit "
            "into one frame"))
    return CanFrame(
        message.identifier, message.size, message.extended, message.fd, by_group, address, protection,
        chosen.given.pages if chosen is not None else (), message.name,
    )


def _protection(reading: Reading, message: DbcMessage, table: Table) -> Protection:
    given = table.get("protection")
    if given is None:
        return Protection()
    before = len(reading.problems)
    made = read_protection(reading, message, given)
    reading.problems[before:] = [
        item._replace(place=("protection", *item.place[2:])) for item in reading.problems[before:]
    ]
    return made


def _sequence(reading: Reading, message: DbcMessage, protection: Protection) -> dict[str, Field]:
    """The counter of the protection as the sequence number; empty without a counter."""
    if protection.counter is None:
        return {}
    counter = _field(reading, Found(message, DbcSignal(protection.counter)), ("protection", "counter"))
    return {} if counter is None else {"sequence": counter}


def _status(reading: Reading, message: DbcMessage, given: Mapping[str, Any]) -> dict[str, Field]:
    """The signal in the same message that indicates the condition of the sensor."""
    name = given["signal"].removeprefix(f"{message.name}.")
    chosen = reading.signal(message, name, ("status", "signal"))
    field = None if chosen is None else _field(reading, chosen, ("status", "signal"))
    if chosen is None or field is None:
        return {}
    return {"status": replace(field, scale=1.0, offset=0.0, **_meaning(reading, chosen, given, ("status",)))}


def _meaning(reading: Reading, chosen: Found, given: Mapping[str, Any], place: tuple[str, ...]) -> dict[str, Any]:
    """Values that are not readings, as raw numbers or value names in the DBC file."""
    made: dict[str, Any] = {
        key: tuple(sorted(reading.numbers(given[key], chosen, (*place, key))))
        for key in ("overload_values", "fault_values") if key in given
    }
    made |= {key: given[key] for key in ("overload_bits", "fault_bits") if key in given}
    if "valid" in given:
        made["valid"] = tuple(given["valid"])
    return made


def _field(reading: Reading, chosen: Found, place: tuple[str, ...]) -> Field | None:
    """A signal as a field of whole bytes."""
    signal, size = chosen.signal, chosen.message.size
    bits = sorted(bit // 8 for bit in signal.bits(size))
    first, last = bits[0], bits[-1]
    count = last - first + 1
    if count > max(_BYTE_TYPES):
        reading.wrong(place, f"signal {signal.name!r} spans {count} bytes; allowed: at most {max(_BYTE_TYPES)}")
        return None
    order = "big" if signal.big_endian else "little"
    if signal.is_float:
        if signal.length not in {32, 64} or count * 8 != signal.length:
            reading.wrong(place, f"signal {signal.name!r} is a float of {signal.length} bits; allowed: 32 or 64 bits "
                "that start at a byte")
            return None
        return Field(first, f"f{signal.length}", order, scale=signal.scale, offset=signal.offset)
    low = _low_bit(signal, size, first, last)
    return Field(
        first, _BYTE_TYPES[count], order, (low, low + signal.length - 1), signal.signed, signal.scale, signal.offset
    )


def _low_bit(signal: Signal, size: int, first: int, last: int) -> int:
    """Lowest bit of the signal in the number formed by its bytes."""
    return signal.shift(size) - 8 * (size - 1 - last if signal.big_endian else first)


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever the key holds
    return tuple(value) if isinstance(value, list) else value
