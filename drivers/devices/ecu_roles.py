"""A roles file: which signals of a DBC are the set-point, the measured current, the faults; and how it is protected.

`describe` makes of both what the driver needs (`EcuDescription`), or says everything that is wrong with them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from drivers.current_source import SourceFault, SourceState, SourceTiming
from drivers.devices.can_request import read_request, request_key
from drivers.devices.dbc_file import DbcMessage
from drivers.devices.ecu_description import (
    BOOTS,
    CLEAR,
    CLOCK,
    COIL,
    COMMAND,
    CURRENT,
    ECU,
    ENABLE,
    FAULTS,
    FIRMWARE,
    LAYOUT,
    SERIAL,
    STATE,
    SUPPLY,
    EcuDescription,
    FaultSignal,
    HeardMessage,
    SentFrame,
)
from drivers.devices.ecu_missing import missing
from drivers.devices.role_protection import read_protection
from drivers.devices.role_reading import SCALING, Found, Place, Reading, RoleProblems
from drivers.devices.sent_frames import sent_frames
from protocols.can_frame import EXTENDED
from protocols.can_signals import FrameReader, Placed, Signal
from protocols.descriptions import Problem
from protocols.e2e import Protection
from protocols.j1939 import from_address, same_receiver
from protocols.slcan import FD_LENGTHS
from protocols.wire_units import seconds

SENT_ROLES = (COMMAND, ENABLE, CLEAR)
MEASURED = {CURRENT: "current", COIL: "temperature", ECU: "temperature", SUPPLY: "voltage", CLOCK: "time"}
IDENTITY = (SERIAL, FIRMWARE, LAYOUT)
STATES = {str(item.name).lower(): item for item in SourceState}
FAULT_NAMES = {str(item.name).lower().replace("_", "-"): item for item in SourceFault}
ROLE_KEYS: Mapping[str, tuple[str, ...]] = {
    COMMAND: ("signal", "unit", "full_scale", *SCALING), ENABLE: ("signal", "on", "off"),
    CLEAR: ("signal", "on", "off"),
    CURRENT: ("signal", "unit", "full_scale", *SCALING), STATE: ("signal", *STATES), FAULTS: ("signal", *FAULT_NAMES),
    COIL: ("signal", "unit", *SCALING), ECU: ("signal", "unit", *SCALING), SUPPLY: ("signal", "unit", *SCALING),
    CLOCK: ("signal", "unit", "scale"),
    SERIAL: ("signal",), FIRMWARE: ("signal",), LAYOUT: ("signal", "value"), BOOTS: ("signal",),
}
"""Every role, and the keys of its table; a text stands for `signal` alone."""
SENDING = ("cyclic", "on-change")
ZERO_A = 0.02
"""So far from 0 A the nearest step of the set-point may be."""
STATUS_S = 0.010
OTHER_S = 0.100
LONGEST_TICK_US = 1e9


def describe(name: str, messages: Mapping[str, DbcMessage], roles: Mapping[str, Any]) -> EcuDescription:
    """What the driver needs of a DBC and the roles of its signals.

    Args:
        name: of the current source, for messages to people.
        messages: of the DBC, by name.
        roles: contents of the roles file.

    Raises:
        RoleProblems: they cannot be used; every reason.
    """
    return _Roles(Reading(messages), roles).description(name)


class _Roles:
    """One reading of a roles file."""

    def __init__(self, reading: Reading, roles: Mapping[str, Any]) -> None:
        self._reading = reading
        self._roles = roles
        self._tables = {role: self._table(role) for role in ROLE_KEYS if role in roles}
        self._found = {role: named for role in self._tables if (named := self._find(role)) is not None}
        self._fault_signals: list[tuple[str, Found, frozenset[int], SourceFault]] = []

    def description(self, name: str) -> EcuDescription:
        """The description.

        Raises:
            RoleProblems: with everything that is wrong.
        """
        reading, named = self._reading, self._found
        on_off = {role: self._on_off(role) for role in (ENABLE, CLEAR) if role in named}
        states, fault_bits = self._states(), self._faults()
        low_A, high_A = self._range()
        protections, periods = self._protections(), self._periods()
        roles = {role: named[role] for role in SENT_ROLES if role in named}
        sent = sent_frames(reading, roles, self._roles.get("constants", {}), protections)
        if (own := self._address("own_address", [reading.messages[frame.name] for frame in sent])) is not None:
            sent = tuple(replace(frame, identifier=from_address(frame.identifier, own)) for frame in sent)
        heard = self._heard(protections, periods)
        self._check_messages(protections, periods, {frame.name for frame in sent})
        self._check_requests(sent, heard)
        timeout = self._roles.get("command_timeout")
        timeout_s = None if timeout is None else seconds(timeout)
        cyclic = self._roles.get("sending", SENDING[0]) == SENDING[0]
        if not cyclic and timeout_s is not None:
            reading.wrong(("sending",), "not allowed with a command_timeout: the current would go to 0 A between two "
                "changes. Fix: use cyclic transmission")
        layout = self._layout()
        if reading.problems:
            raise RoleProblems(reading.problems)
        clock = named.get(CLOCK)
        made = EcuDescription(
            name, sent, heard, _key(named[CURRENT].message), on_off, self._timing(heard), low_A, high_A,
            states, fault_bits,
            tuple(FaultSignal(field, numbers, fault) for field, _, numbers, fault in self._fault_signals),
            0.0 if clock is None else clock.signal.scale, 0 if clock is None else 1 << clock.signal.length,
            layout, cyclic, timeout_s, signals=self._signals(), pages=self._pages(),
            source_address=self._roles.get("source_address"),
        )
        return replace(made, lacking=missing(made))

    def _table(self, role: str) -> Mapping[str, Any]:
        given = self._roles[role]
        return {"signal": given} if isinstance(given, str) else given

    def _find(self, role: str) -> Found | None:
        table, place = self._tables[role], (role,)
        if "signal" not in table:  # of faults, each with a signal of its own
            return None
        named = self._reading.find(table["signal"], (role, "signal") if "signal" in self._as_table(role) else place)
        if named is None:
            return None
        if role in MEASURED or role == COMMAND:
            named = self._reading.in_unit(named, MEASURED.get(role, "current"), table, place)
        elif named.signal.is_float:
            self._reading.wrong(place, f"{named.signal.name} is a float, but must be an integer on the wire")
            return None
        if named is not None and role == CLOCK and (named.signal.is_float or named.signal.scale < 0.0):
            self._reading.wrong(place, f"{named.signal.name} must be an integer that counts up")
            return None
        if named is not None and role == CLOCK and named.signal.scale > LONGEST_TICK_US:
            self._reading.wrong(place, f"a tick is {named.signal.scale:g} us; allowed: at most {LONGEST_TICK_US:g} us")
            return None
        return named

    def _as_table(self, role: str) -> Mapping[str, Any]:
        given = self._roles[role]
        return given if isinstance(given, Mapping) else {}

    def _on_off(self, role: str) -> tuple[int, int]:
        table, named = self._tables[role], self._found[role]
        numbers = [
            self._reading.number(table.get(key, default), named, (role, key) if key in table else (role,))
            for key, default in (("on", 1), ("off", 0))
        ]
        if numbers[0] is not None and numbers[0] == numbers[1]:
            self._reading.wrong((role,), f"on and off are both {numbers[0]}")
        return numbers[0] or 0, numbers[1] or 0

    def _states(self) -> dict[int, SourceState]:
        """The neutral state of each code that has one; without any entry, those whose names in the DBC say so."""
        named, table = self._found.get(STATE), self._tables.get(STATE, {})
        if named is None:
            return {}
        if not table.keys() & STATES.keys():
            words = {number: name.casefold() for number, name in named.given.names.items()}
            return {number: STATES[word] for number, word in words.items() if word in STATES}
        codes: dict[int, SourceState] = {}
        for word, meaning in STATES.items():
            for number in self._reading.numbers(table[word], named, (STATE, word)) if word in table else ():
                if number in codes:
                    self._reading.wrong((STATE, word), f"{number} is already used for "
                        f"{str(codes[number].name).lower()}")
                codes[number] = meaning
        return codes

    def _faults(self) -> dict[int, SourceFault]:
        """The neutral fault of each bit that has one; those with signals or codes of their own are kept aside."""
        table, word = self._tables.get(FAULTS, {}), self._found.get(FAULTS)
        bits: dict[int, SourceFault] = {}
        for name, meaning in FAULT_NAMES.items():
            if name not in table:
                continue
            place, given = (FAULTS, name), table[name]
            if isinstance(given, int) and not isinstance(given, bool):
                self._fault_bit(given, word, meaning, bits, place)
            elif isinstance(given, str) and "." not in given and word is not None:
                numbers = self._reading.numbers(given, word, place)
                self._fault_signals.append((FAULTS, word, numbers, meaning))
            else:
                self._fault_signal(given, meaning, place)
        return bits

    def _fault_bit(
        self, bit: int, word: Found | None, meaning: SourceFault, bits: dict[int, SourceFault], place: Place
    ) -> None:
        if word is None:
            self._reading.wrong(place, "is a bit number, but no fault word is specified. Fix: write "
                'faults.signal = "Message.signal", or a separate "Message.signal" for this fault')  # fmt: skip
        elif not 0 <= bit < word.signal.length:
            self._reading.wrong(place, f"{word.signal.name} has only bits 0 to {word.signal.length - 1}")
        elif 1 << bit in bits:
            self._reading.wrong(place, f"bit {bit} is already used for "
                f"{str(bits[1 << bit].name).lower().replace('_', '-')}")
        else:
            bits[1 << bit] = meaning

    def _fault_signal(self, given: str | Mapping[str, Any], meaning: SourceFault, place: Place) -> None:
        """A fault with a signal of its own: "Message.signal", or {signal = ..., value = ...}."""
        table = given if isinstance(given, Mapping) else {"signal": given}
        named = self._reading.find(table["signal"], place)
        if named is None:
            return
        if named.signal.is_float:
            self._reading.wrong(place, f"{named.signal.name} is a float, but must be an integer on the wire")
            return
        numbers = self._reading.numbers(table["value"], named, place) if "value" in table else frozenset[int]()
        self._fault_signals.append((f"{FAULTS}.{place[-1]}", named, numbers, meaning))

    def _range(self) -> tuple[float, float]:
        """What the set-point holds (A); a problem where 0 A is not among it."""
        named = self._found.get(COMMAND)
        if named is None:
            return -math.inf, math.inf
        signal, given = named.signal, named.given
        low_A, high_A = sorted(number * signal.scale + signal.offset for number in (signal.low, signal.high))
        if given.minimum is not None and given.maximum is not None and given.minimum < given.maximum:
            low_A, high_A = max(low_A, given.minimum), min(high_A, given.maximum)
        steps = 0.0 if signal.is_float else abs(round(-signal.offset / signal.scale) * signal.scale + signal.offset)
        if not low_A - ZERO_A <= 0.0 <= high_A + ZERO_A or steps > ZERO_A:
            at = f" (line {given.line} of the DBC file)" if given.line else ""
            self._reading.wrong(
                (COMMAND,),
                f"{signal.name}{at} ranges from {low_A:g} A to {high_A:g} A in "
                f"steps of {abs(signal.scale):g} A: it cannot represent 0 A, so the coil could not be switched off. "
                "Fix: specify a set-point that can represent 0 A",
            )
        return low_A, high_A

    def _protections(self) -> dict[str, Protection]:
        given, messages = self._roles.get("protection", {}), self._reading.messages
        self._reading.of_messages(given, ("protection",))
        return {
            name: read_protection(self._reading, messages[name], table)
            for name, table in given.items() if name in messages
        }

    def _address(self, key: str, messages: Sequence[DbcMessage]) -> int | None:
        """A J1939 address; a problem where it applies to a message without one."""
        address: int | None = self._roles.get(key)
        if address is not None:
            for name in [message.name for message in messages if not message.extended]:
                self._reading.wrong((key,), f"message {name!r} has a standard identifier, which contains no address. "
                    "Fix: remove this entry")
        return address

    def _periods(self) -> dict[str, float]:
        given = self._roles.get("periods", {})
        self._reading.of_messages(given, ("periods",))
        return {name: seconds(text) for name, text in given.items() if name in self._reading.messages}

    def _heard(self, protections: Mapping[str, Protection], periods: Mapping[str, float]) -> dict[int, HeardMessage]:
        """The messages that are read, each with what is wanted of it."""
        placed: dict[str, dict[str, Placed]] = {}
        for role, named in self._found.items():
            if role not in SENT_ROLES:
                plain = role not in MEASURED or role == CLOCK
                placed.setdefault(named.message.name, {})[role] = named.placed(plain=plain)
        for field, named, _, _ in self._fault_signals:
            placed.setdefault(named.message.name, {})[field] = named.placed(plain=True)
        heard: dict[int, HeardMessage] = {}
        requests: Mapping[str, Any] = self._roles.get("requests", {})
        self._reading.of_messages(requests, ("requests",))
        address = self._address("source_address", [self._reading.messages[name] for name in placed])
        for name, fields in placed.items():
            message = self._reading.messages[name]
            protection = protections.get(name, Protection())
            self._overlaps(message, fields, protection)
            by_group = message.any_address or (address is not None and message.extended)
            period_s, request = periods.get(name, message.period_s), b""
            if name in requests:
                period_s = period_s or min(_usual_s(role) for role in fields)
                request = self._request(requests[name], message, address, by_group=by_group)
            heard[_key(message)] = HeardMessage(
                name, message.size, FrameReader(message.size, fields), protection, period_s, frozenset(fields),
                _page_count(message), message.fd, by_group, request,
            )
        return heard

    def _request(
        self, given: str | Mapping[str, Any], message: DbcMessage, address: int | None, *, by_group: bool
    ) -> bytes:
        """The request for a received message."""
        problems: list[Problem] = []
        key = _key(message) if address is None or not message.extended else from_address(_key(message), address)
        place = ("requests", message.name)
        request = read_request(
            given, key, message.size, place, problems, fd=message.fd, addressed=not by_group or address is not None
        )
        for where, text in problems:
            self._reading.wrong(tuple(map(str, where)), text)
        return request

    def _overlaps(self, message: DbcMessage, fields: Mapping[str, Placed], protection: Protection) -> None:
        for what, bits in protection.places(message.size).items():
            for field, placed in fields.items():
                if bits & placed.signal.bits(message.size):
                    self._reading.wrong(
                        tuple(field.split(".")),
                        f"{placed.signal.name} and {what} of [protection.{message.name}] overlap. Fix: check the "
                        "entries offset, crc and counter",
                    )

    def _check_messages(
        self, protections: Mapping[str, Protection], periods: Mapping[str, float], sent: set[str]
    ) -> None:
        """Every message is sent or heard, not both; no two have one identifier; nothing is said of others."""
        used = {named.message.name for role, named in self._found.items() if role not in SENT_ROLES}
        used |= {named.message.name for _, named, _, _ in self._fault_signals}
        for name in sorted(used & sent):
            self._reading.wrong((COMMAND,), f"message {name!r} is both sent and received; a message has only one "
                "sender")
        for table, names in (("protection", protections), ("periods", periods)):
            for name in names:
                if name not in used | sent:
                    self._reading.wrong((table, name), f"message {name!r} has no role. Fix: remove this entry")
        owners: dict[int, str] = {}
        for name in sorted(used | sent):
            message = self._reading.messages[name]
            if message.size not in FD_LENGTHS:
                refusal = f"{name} has {message.size} bytes; a CAN FD frame has 0 to 8, 12, 16, 20, 24, 32, 48 or 64"
                self._reading.wrong((), refusal, message.line)
            if (owner := owners.setdefault(_key(message), name)) != name:
                refusal = f"{owner} and {name} have the same identifier, 0x{message.identifier:X}"
                self._reading.wrong((), refusal, message.line)

    def _check_requests(self, sent: Sequence[SentFrame], heard: Mapping[int, HeardMessage]) -> None:
        """Only received messages are requested; no request is a command, or another message of the ECU."""
        owners = {key: message.name for key, message in heard.items()}
        received = set(owners.values())
        owners |= {frame.identifier | (EXTENDED if frame.extended else 0): frame.name for frame in sent}
        groups = {same_receiver(frame.identifier): frame.name for frame in sent if frame.j1939}
        for name, given in self._roles.get("requests", {}).items():
            if name in self._reading.messages and name not in received:
                self._reading.wrong(("requests", name), f"message {name!r} is not received, so it is not requested. "
                    "Fix: remove this entry")
            if isinstance(given, str):
                continue
            key = request_key(given)
            owner = owners.get(key) or (groups.get(same_receiver(key), "") if key & EXTENDED else "")
            if owner not in {"", name}:
                self._reading.wrong(("requests", name, "id"), f"0x{given['id']:X} is the identifier of message "
                    f"{owner!r}. Fix: write the identifier of the request")

    def _timing(self, heard: Mapping[int, HeardMessage]) -> SourceTiming:
        """Periods as stated; the usual one if none is stated."""
        of = {role: message.period_s * message.pages for message in heard.values() for role in message.roles}
        return SourceTiming(
            of[CURRENT] or _usual_s(CURRENT),
            (of[COIL] or _usual_s(COIL)) if COIL in of else 0.0,
            max((of[role] or _usual_s(role) for role in IDENTITY if role in of), default=0.0),
        )

    def _signals(self) -> dict[str, tuple[str, Signal]]:
        signals = {field: named for field, named, _, _ in self._fault_signals}
        return {role: (named.message.name, named.signal) for role, named in (self._found | signals).items()}

    def _pages(self) -> dict[str, list[dict[str, int]]]:
        """The pages of heard messages on which a role is; one that another contains is none of its own."""
        pages: dict[str, list[dict[str, int]]] = {}
        received = [named for role, named in self._found.items() if role not in SENT_ROLES]
        for named in (*received, *(named for _, named, _, _ in self._fault_signals)):
            page = {multiplexer.name: min(numbers) for multiplexer, numbers in named.given.pages}
            if page and page not in pages.setdefault(named.message.name, []):
                pages[named.message.name].append(page)
        return {name: [one for one in all_ if not any(one.items() < other.items() for other in all_)]
                for name, all_ in pages.items()}  # fmt: skip

    def _layout(self) -> int | None:
        table, named = self._tables.get(LAYOUT), self._found.get(LAYOUT)
        if table is None or named is None or "value" not in table:
            return None
        return self._reading.number(table["value"], named, (LAYOUT, "value"))


def _page_count(message: DbcMessage) -> int:
    """How many frames it takes until every page has been shown, if they come in turn."""
    numbers = {(given.pages[0][0].name, min(given.pages[0][1])) for given in message.signals.values() if given.pages}
    return max(1, len(numbers))


def _usual_s(role: str) -> float:
    """Period assumed for a role's message if none is stated, s."""
    return STATUS_S if role == CURRENT else 10 * OTHER_S if role in IDENTITY else OTHER_S


def _key(message: DbcMessage) -> int:
    return message.identifier | (EXTENDED if message.extended else 0)
