"""The frames that are sent in every cycle: set-point, enable and constants packed into their messages, page by page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.devices.dbc_file import DbcMessage, DbcSignal
from drivers.devices.ecu_description import SentFrame
from drivers.devices.role_reading import Found, Place, Reading
from protocols.can_signals import FrameWriter, Placed, Signal
from protocols.e2e import Protection
from protocols.errors import LocalProtocolError

Page = tuple[tuple[str, int], ...]
"""Numbers of multiplexers, by name, that one frame of a message has."""


def sent_frames(
    reading: Reading,
    roles: Mapping[str, Found],
    constants: Mapping[str, Any],
    protections: Mapping[str, Protection],
) -> tuple[SentFrame, ...]:
    """Every frame that is sent, in the order of the roles; one for each page that a role or a constant is on.

    Args:
        reading: takes the problems.
        roles: `command`, `enable`, `clear_faults`, as far as there are any.
        constants: the table of that name.
        protections: by message.
    """
    fixed = _constants(reading, constants)
    frames: list[SentFrame] = []
    messages = {named.message.name: named.message for named in (*roles.values(), *(item for item, _, _ in fixed))}
    for name, message in messages.items():
        own = {role: named for role, named in roles.items() if named.message.name == name}
        given = {item.signal.name: (item, number, place) for item, number, place in fixed if item.message.name == name}
        for role, named in own.items():
            if named.signal.name in given:
                reading.wrong(given[named.signal.name][2], f"has the role {role}, so its value cannot be constant")
        protection = protections.get(name, Protection())
        for page in _pages(message, own, {key: number for key, (_, number, _) in given.items()}):
            frame = _frame(reading, message, page, own, given, protection)
            if frame is not None:
                frames.append(frame)
    return tuple(frames)


def _constants(reading: Reading, given: Mapping[str, Any]) -> list[tuple[Found, int, Place]]:
    """The entries of [constants]: "Message.signal" = value, or a table for each message."""
    entries: list[tuple[str, Any, Place]] = []
    for key, value in given.items():
        if isinstance(value, Mapping):
            entries += [(f"{key}.{name}", inner, ("constants", key, name)) for name, inner in value.items()]
        else:
            entries.append((key, value, ("constants", key)))
    named: list[tuple[Found, int, Place]] = []
    for name, value, place in entries:
        item = reading.find(name, place)
        number = None if item is None else _constant(reading, item, value, place)
        if item is not None and number is not None:
            named.append((item, number, place))
    return named


def _constant(reading: Reading, named: Found, value: Any, place: Place) -> int | None:  # noqa: ANN401 - of a user's file
    """The bits of a constant: a name of the DBC, a whole number as on the wire; of a float the value itself."""
    signal = named.signal
    if signal.is_float:
        if isinstance(value, bool | str):
            reading.wrong(place, f"{signal.name} is a float, so its value must be a number")
            return None
        try:
            return signal.raw(value)
        except LocalProtocolError as error:
            reading.wrong(place, str(error))
            return None
    number = reading.number(value, named, place)
    return None if number is None else number & (1 << signal.length) - 1


def _pages(message: DbcMessage, roles: Mapping[str, Found], constants: Mapping[str, int]) -> list[Page]:
    """The pages on which a role or a constant is; a message without pages has one, the empty one.

    What is on all pages asks for none; a constant multiplexer with nothing below it is a page of its own.
    """
    signals = [message.signals[named.signal.name] for named in roles.values()]
    signals += [message.signals[name] for name in constants]
    pages: list[Page] = []
    for given in signals:
        if given.pages:
            page = [
                (multiplexer.name, stated if (stated := constants.get(multiplexer.name)) in numbers else min(numbers))
                for multiplexer, numbers in given.pages
            ]
            pages.append(tuple(sorted(page)))
    # A page that another one contains is sent with it.
    distinct = list(dict.fromkeys(pages))
    return [page for page in distinct if not any(set(page) < set(other) for other in distinct)] or [()]


def _frame(
    reading: Reading,
    message: DbcMessage,
    page: Page,
    roles: Mapping[str, Found],
    constants: Mapping[str, tuple[Found, int, Place]],
    protection: Protection,
) -> SentFrame | None:
    """One frame; a problem where two of its signals want the same bits."""
    on_page = dict(page)
    changing = {
        role: Placed(named.signal, plain=role != "command")
        for role, named in roles.items() if _is_on(named.given, on_page)
    }  # fmt: skip
    used = {placed.signal.name for placed in changing.values()}
    fixed: list[tuple[Signal, int]] = []
    stated: list[tuple[Signal, Place]] = []
    for name, given in message.signals.items():
        if name in used or not _is_on(given, on_page):
            continue
        if name in constants:
            fixed.append((given.signal, constants[name][1]))
            stated.append((given.signal, constants[name][2]))
        elif name in on_page:
            fixed.append((given.signal, on_page[name]))
        elif not _taken(given.signal, message, protection, changing, constants):
            fixed.append((given.signal, _start(given)))
    _overlaps(reading, message, changing, stated, protection)
    return SentFrame(
        message.name, message.identifier, message.extended, message.fd,
        FrameWriter(message.size, tuple(fixed), changing), protection, message.j1939,
    )


def _is_on(given: DbcSignal, page: Mapping[str, int]) -> bool:
    return all(page.get(multiplexer.name) in numbers for multiplexer, numbers in given.pages)


def _taken(
    signal: Signal,
    message: DbcMessage,
    protection: Protection,
    changing: Mapping[str, Placed],
    constants: Mapping[str, tuple[Found, int, Place]],
) -> bool:
    """Whether the bits of an unnamed signal belong to one that was, or do not fit."""
    bits, size = signal.bits(message.size), message.size
    others = [placed.signal.bits(size) for placed in changing.values()]
    others += [named.signal.bits(size) for named, _, _ in constants.values()]
    others += list(protection.places(size).values())
    return any(bits & other for other in others) or min(bits) < 0 or max(bits) >= 8 * size


def _start(given: DbcSignal) -> int:
    """What an unnamed signal is sent as: its start value, else 0 on the wire."""
    signal = given.signal
    if signal.is_float:
        return Signal(signal.name, signal.start, signal.length, is_float=True).raw(float(given.start_number))
    return int(given.start_number) & (1 << signal.length) - 1


def _overlaps(
    reading: Reading,
    message: DbcMessage,
    changing: Mapping[str, Placed],
    stated: list[tuple[Signal, Place]],
    protection: Protection,
) -> None:
    taken: dict[int, str] = {}
    for what, bits in protection.places(message.size).items():
        taken |= dict.fromkeys(bits, f"{what} of [protection.{message.name}]")
    named = [((role,), placed.signal) for role, placed in changing.items()]
    for place, signal in (*named, *((place, signal) for signal, place in stated)):
        mine = signal.bits(message.size)
        clash = next((taken[bit] for bit in sorted(mine) if bit in taken), "")
        if clash:
            reading.wrong(place, f"{signal.name} and {clash} overlap. Fix: check the entries offset, crc and counter")
        taken |= dict.fromkeys(mine, signal.name)
