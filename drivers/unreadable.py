"""Why a block of registers cannot be read although the device answers: its parts are read one by one.

Used before anything moves, and for a block that has never been read: by then a device has shown that it answers, or
nothing of it can be said.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from drivers.errors import DriverError, LinkLost, NoAnswer, PortClosed, RequestRefused, WrongAnswer, WrongLayout
from drivers.modbus_link import ModbusLink
from drivers.register_maps.access_plan import Read, Rules
from drivers.register_maps.quantity import HOLDING, Quantity

READ_FUNCTIONS = {"coil": 1, "discrete": 2, "holding": 3, "input": 4}
MOST_SILENT = 3
"""So many parts may stay without an answer: each costs two time-outs."""
NAMED = 6
"""Quantities that are named in one message."""


def explained(link: ModbusLink, read: Read, rules: Rules, error: DriverError, *, heard: bool) -> DriverError:
    """What is wrong with the map where that is the cause; else the error itself.

    Args:
        link: the connection; asked for the parts, and open again afterwards where it can be.
        read: the block that could not be read.
        rules: of the map.
        error: what reading it raised.
        heard: the device has answered another request.
    """
    try:
        readable, others = _parted(link, [_whole(one) for one in _apart(read.quantities)], read.space)
        holes = [] if others else _parted(link, _gaps(read), read.space)[1]
    except (LinkLost, PortClosed):
        return error
    if not (readable or heard or isinstance(error, RequestRefused)):
        return error  # nothing of it was ever heard: the link, the unit number, the power
    block = f"{_span((read.address, read.count), read.space, rules)}: {error.message}"
    if not readable:
        text, fix = (
            "none of the device's quantities can be read separately"
        ), "check first_address, function and the addresses in the register map"
    elif others:
        missing = [one.name for one in _apart(read.quantities) if _whole(one) in others][:NAMED]
        at = ", ".join(_span(part, read.space, rules) for part in others[:NAMED])
        text = f"{', '.join(missing)} ({at}) cannot be read; the other quantities can be read"
        fix = f"correct the address and function of {' and '.join(missing)} in [quantities], or remove these entries"
    elif holes:
        first = rules.first_of(HOLDING)
        pairs = ", ".join(f"[{at + first}, {at + count - 1 + first}]" for at, count in holes)
        at = ", ".join(_span(part, read.space, rules) for part in holes)
        text = (
            f"each quantity can be read separately, but {at}, the registers between them, cannot be read and are not "
            "in the map"
        )
        fix = f"write [modbus] unreadable = [{pairs}], or largest_gap = 0, in the register map"
    else:
        longest = max(one.end - one.address for one in read.quantities)
        text = f"each quantity can be read separately, but {read.count} registers cannot be read at once"
        fix = f"write [modbus] largest_read = {longest} (or more, if the device allows it) in the register map"
    names = ", ".join(one.name for one in read.quantities[:NAMED])
    more = f" and {len(read.quantities) - NAMED} more" if len(read.quantities) > NAMED else ""
    return WrongLayout(error.device, error.port, f"{block}; it holds {names}{more}; {text}", fix)


def _apart(quantities: Iterable[Quantity]) -> list[Quantity]:
    """One quantity for each place: bits of one register are read together."""
    return list({_whole(one): one for one in quantities}.values())


def _whole(quantity: Quantity) -> tuple[int, int]:
    return quantity.address, quantity.end - quantity.address


def _gaps(read: Read) -> list[tuple[int, int]]:
    """First address and count of the registers that no quantity names."""
    named = {address for one in read.quantities for address in range(one.address, one.end)}
    gaps: list[tuple[int, int]] = []
    for address in range(read.address, read.address + read.count):
        if address in named:
            continue
        if gaps and sum(gaps[-1]) == address:
            gaps[-1] = (gaps[-1][0], gaps[-1][1] + 1)
        else:
            gaps.append((address, 1))
    return gaps


def _parted(
    link: ModbusLink, parts: Sequence[tuple[int, int]], space: str
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Parts that can be read, and parts that cannot; not all of them where the device is silent to many.

    Raises:
        LinkLost: the connection is gone.
        PortClosed: it cannot be made again.
    """
    readable: list[tuple[int, int]] = []
    others: list[tuple[int, int]] = []
    silent = 0
    for address, count in parts:
        link.open()
        try:
            link.read(address, count, READ_FUNCTIONS[space])
        except (RequestRefused, NoAnswer, WrongAnswer) as error:
            others.append((address, count))
            silent += isinstance(error, NoAnswer)
            if silent == MOST_SILENT:
                break
        else:
            readable.append((address, count))
    link.open()
    return readable, others


def _span(part: tuple[int, int], space: str, rules: Rules) -> str:
    """Registers as the map's file numbers them."""
    first, last = part[0] + rules.first_of(space), part[0] + part[1] - 1 + rules.first_of(space)
    kind = {"holding": "holding register", "input": "input register", "discrete": "discrete input"}.get(space, space)
    return f"{kind} {first}" if first == last else f"{kind}s {first} to {last}"
