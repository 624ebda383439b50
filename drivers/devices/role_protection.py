"""The table [protection.MESSAGE] of a roles file: counter, checksum, AUTOSAR E2E profile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from drivers.devices.dbc_file import DbcMessage
from drivers.devices.role_reading import Place, Reading
from protocols.can_signals import Signal
from protocols.e2e import Covered, Crc, Protection, checked, counted, profile_1, profile_2, profile_5, profile_11

PROFILES = ("none", "counter", "counter+crc", "e2e-1", "e2e-2", "e2e-5", "e2e-11")
MODES = ("both", "alt", "low", "nibble")
KEYS: Mapping[str, tuple[str, ...]] = {
    "none": ("profile",),
    "counter": ("profile", "counter", "counter_max"),
    "counter+crc": (
        "profile", "counter", "counter_max", "crc", "polynomial", "initial", "final_xor", "reflected", "data_id",
        "data_id_bytes", "data_id_first", "first_byte", "last_byte",
    ),
    "e2e-1": ("profile", "data_id", "data_id_mode", "counter", "crc", "nibble", "offset"),
    "e2e-2": ("profile", "data_ids", "counter", "crc"),
    "e2e-5": ("profile", "data_id", "counter", "crc", "offset"),
    "e2e-11": ("profile", "data_id", "data_id_mode", "counter", "crc", "nibble", "offset"),
}
_LONGEST_CRC = 32


def read_protection(reading: Reading, message: DbcMessage, given: Mapping[str, Any]) -> Protection:
    """The protection of one message; none and a problem where it cannot be used."""
    place: Place = ("protection", message.name)
    profile = given["profile"]
    before = len(reading.problems)
    if profile == "none":
        return Protection()
    made = _own(reading, message, given, profile) if profile.startswith("counter") else _e2e(
        reading, message, given, profile
    )
    if made is None or len(reading.problems) > before:
        return Protection()
    _overlap(reading, message, made, place)
    return made


def _own(reading: Reading, message: DbcMessage, given: Mapping[str, Any], profile: str) -> Protection | None:
    """A counter, or a counter and a checksum of the maker's own."""
    place: Place = ("protection", message.name)
    counter = _named(reading, message, given, "counter")
    if counter is None:
        return None
    highest = int(counter.high)
    top = reading.whole(given.get("counter_max", highest), 1, highest, (*place, "counter_max"))
    if top is None:
        return None
    if profile == "counter":
        return counted(counter, top + 1)
    checksum = _named(reading, message, given, "crc")
    if checksum is None:
        return None
    bytes_of = _whole_bytes(checksum, message.size)
    if bytes_of is None or checksum.length > _LONGEST_CRC:
        reading.wrong((*place, "crc"), f"{checksum.name} must occupy one to four whole bytes (8, 16, 24 or 32 bits)")
        return None
    crc, covered = _crc(reading, given, checksum.length, place), _covered(reading, given, message.size, place)
    if crc is None or covered is None:
        return None
    return checked(counter, top + 1, checksum, crc, covered.of(message.size, bytes_of), covered.data_id)


def _crc(reading: Reading, given: Mapping[str, Any], width: int, place: Place) -> Crc | None:
    highest = (1 << width) - 1
    numbers = [
        reading.whole(given.get(key, 0), least, highest, (*place, key))
        for key, least in (("polynomial", 1), ("initial", 0), ("final_xor", 0))
    ]
    polynomial, initial, final = numbers
    if polynomial is None or initial is None or final is None:
        return None
    return Crc(width, polynomial, initial, final, given.get("reflected", False))


def _covered(reading: Reading, given: Mapping[str, Any], size: int, place: Place) -> Covered | None:
    length = reading.whole(given.get("data_id_bytes", 2), 1, 4, (*place, "data_id_bytes"))
    first = reading.whole(given.get("first_byte", 0), 0, size - 1, (*place, "first_byte"))
    last = reading.whole(given.get("last_byte", size - 1), 0, size - 1, (*place, "last_byte"))
    in_front = given.get("data_id_first", True)
    if length is None or first is None or last is None:
        return None
    data_id: int | None = -1
    if "data_id" in given:
        data_id = reading.whole(given["data_id"], 0, (1 << 8 * length) - 1, (*place, "data_id"))
    return None if data_id is None else Covered(data_id, length, in_front, first, last)


def _e2e(reading: Reading, message: DbcMessage, given: Mapping[str, Any], profile: str) -> Protection | None:
    """An AUTOSAR profile; counter and checksum are where it has them, unless signals are named."""
    place: Place = ("protection", message.name)
    wide = profile == "e2e-5"
    header = 3 if wide else 2
    offset = reading.whole(given.get("offset", 0), 0, max(0, message.size - header), (*place, "offset"))
    if message.size < header:
        reading.wrong(place, f"{profile} needs {header} bytes, {message.name} has {message.size}")
        return None
    if offset is None:
        return None
    at = 8 * offset
    checksum = _named(reading, message, given, "crc", Signal("the checksum", at, 16 if wide else 8))
    usual = Signal("the counter", at + 16, 8) if wide else Signal("the counter", at + 8, 4)
    counter = _named(reading, message, given, "counter", usual)
    if checksum is None or counter is None or not _fits(reading, message, profile, checksum, counter):
        return None
    if profile == "e2e-2":
        return profile_2(list(given["data_ids"]), counter, checksum)
    mode = given.get("data_id_mode", "both")
    data_id = reading.whole(given["data_id"], 0, 0xFFF if mode == "nibble" else 0xFFFF, (*place, "data_id"))
    if data_id is None:
        return None
    if wide:
        return profile_5(data_id, counter, checksum)
    nibble = None
    if mode == "nibble":
        nibble = _named(reading, message, given, "nibble", Signal("the nibble of the data ID", at + 12, 4))
        if nibble is None:
            return None
    return (profile_1 if profile == "e2e-1" else profile_11)(data_id, counter, checksum, mode, nibble)


def _fits(reading: Reading, message: DbcMessage, profile: str, checksum: Signal, counter: Signal) -> bool:
    """Whether counter and checksum have the lengths and places that the profile can have."""
    place: Place = ("protection", message.name)
    wide = profile == "e2e-5"
    bits, count_bits = (16, 8) if wide else (8, 4)
    before = len(reading.problems)
    bytes_of = _whole_bytes(checksum, message.size)
    if checksum.length != bits or bytes_of is None or (wide and checksum.big_endian):
        order = ", low byte first" if wide else ""
        reading.wrong((*place, "crc"), f"{profile} requires a checksum of {bits} bits in whole bytes{order}; "
                      f"{checksum.name} has {checksum.length} bits from bit {checksum.start}")  # fmt: skip
    if counter.length != count_bits:
        text = f"{profile} requires a counter of {count_bits} bits; {counter.name} has {counter.length} bits"
        reading.wrong((*place, "counter"), text)
    if profile == "e2e-2" and bytes_of != range(1):
        reading.wrong((*place, "crc"), "e2e-2 requires the checksum in byte 0")
    return len(reading.problems) == before


def _named(
    reading: Reading, message: DbcMessage, given: Mapping[str, Any], key: str, default: Signal | None = None
) -> Signal | None:
    """The signal that an entry names, as plain bits; where none is named, the place that the profile has for it."""
    place: Place = ("protection", message.name, key)
    if key not in given:
        if default is None:
            reading.wrong(place, f"is missing; write the name of a signal in {message.name}")
        return default
    named = reading.signal(message, given[key].removeprefix(f"{message.name}."), place)
    return None if named is None else replace(named.signal, signed=False, is_float=False, scale=1.0, offset=0.0)


def _whole_bytes(signal: Signal, size: int) -> range | None:
    """The bytes that a signal takes; None where it does not take whole ones in a row."""
    shift = signal.shift(size)
    if shift % 8 or signal.length % 8:
        return None
    places = sorted({bit // 8 for bit in signal.bits(size)})
    return range(places[0], places[-1] + 1)


def _overlap(reading: Reading, message: DbcMessage, made: Protection, place: Place) -> None:
    taken: dict[int, str] = {}
    for what, bits in made.places(message.size).items():
        for bit in sorted(bits):
            if bit in taken:
                reading.wrong(place, f"{what} and {taken[bit]} both use bit {bit % 8} of byte {bit // 8}")
                return
            taken[bit] = what
