"""Frames of the simulated ECU, as its DBC and roles file describe them: the demo's, or a user's.

Which signal has which meaning is read by the driver's reader. Packing and protection share no code with the driver:
cantools packs and unpacks, the checksums come from `simulators.ecu_protection`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

from drivers.devices.dbc_file import DbcText, can_database
from drivers.devices.ecu_description import EcuDescription
from drivers.devices.source import current_source, preset
from protocols.can_frame import EXTENDED, decode_requests
from protocols.can_signals import Signal
from protocols.errors import RemoteProtocolError
from protocols.j1939 import from_address
from rig.files.described import described
from rig.files.network_text import dbc_text
from simulators.ecu_protection import seal_of
from simulators.ecu_wire import Command, Frame, Shown

FIRMWARE = 0x0100
USUAL_US = {"measured_current": 10_000, "serial_number": 1_000_000, "firmware": 1_000_000, "layout": 1_000_000}
OTHER_US = 100_000
SIMULATED_ADDRESS = 0x80
"""J1939 address of an ECU whose files state none."""
TEMPERATURES = frozenset({"coil_temperature", "ecu_temperature", "supply_voltage", "boot_count"})


@dataclass(frozen=True)
class EmulatedEcuFiles:
    """What describes the ECU.

    Attributes:
        dbc: the name of a preset, or the path of a user's DBC.
        roles: path or contents of the roles file that belongs to a user's DBC.
    """

    dbc: str | Path = "demo"
    roles: Path | Mapping[str, Any] | None = None

    def load(self) -> EmulatedEcu:
        """An ECU of that kind, just started.

        Raises:
            LocalProtocolError: they cannot be used.
        """
        if self.roles is None:
            return EmulatedEcu(*preset(str(self.dbc)))
        roles = described("ecu-roles", str(self.roles) if isinstance(self.roles, Path) else self.roles)
        return EmulatedEcu(dbc_text(self.dbc), roles)

    def entries(self, serial_number: int | None) -> list[str]:
        """Entries of [ecu] that name the files, and the serial number where that ECU sends one."""
        files = [f'dbc = "{self.dbc}"']
        if self.roles is not None:
            files = [f'dbc = "{Path(self.dbc).absolute()}"', f'roles = "{self.roles}"']
        if serial_number is None or "serial_number" not in self.load().described.roles:
            return files
        return [*files, f"serial_number = {serial_number}"]


DEMO_ECU = EmulatedEcuFiles()


class EmulatedEcu:
    """Frames of an ECU that a DBC and a roles file describe.

    Args:
        dbc: the DBC.
        roles: contents of the roles file.

    Attributes:
        described: as the driver reads both.
        command_timeout_s: after so long without a command it drives 0 A, as stated (s); infinite for one that does not.
        periods_us: of each message that it sends, in the order in which those of one instant go out.
        temperatures: the messages among them that hold temperatures and nothing that the rig cannot do without.
        counter_modulus: at which the counter of commands starts again.
        requested: the messages that it sends only on request.

    Raises:
        LocalProtocolError: they cannot be used.
    """

    def __init__(self, dbc: DbcText, roles: Mapping[str, Any]) -> None:
        self.described: EcuDescription = current_source(dbc, roles)
        stated_s = self.described.command_timeout_s
        self.command_timeout_s = math.inf if stated_s is None else stated_s
        self._messages = _messages(dbc)
        protection: Mapping[str, Any] = roles.get("protection", {})
        self._seals = {
            name: seal_of(message, protection.get(name, {})) for name, message in self._messages.items()
        }
        heard = self.described.heard.values()
        self.periods_us: Mapping[str, int] = {
            message.name: _period_us(message.period_s, message.roles) for message in heard
        }
        address = self.described.source_address
        own_address = SIMULATED_ADDRESS if address is None else address
        self._identifiers = {
            message.name: from_address(key, own_address) if message.by_group else key
            for key, message in self.described.heard.items()
        }
        self.temperatures = frozenset(message.name for message in heard if message.roles <= TEMPERATURES)
        self._sent = {
            frame.identifier | (EXTENDED if frame.extended else 0): frame.name for frame in self.described.sent
        }
        self.counter_modulus = max((self._seals[name].modulus for name in self._sent.values()), default=0)
        self._requests = {
            request: message.name for message in heard for request in decode_requests(message.request)
        }
        self.requested = frozenset(self._requests.values())
        self._initial = {name: _initial(message) for name, message in self._messages.items()}
        self._signals: dict[str, list[tuple[str, Signal]]] = {name: [] for name in self._messages}
        for role, (owner, signal) in self.described.signals.items():
            self._signals[owner].append((role, signal))
        self._codes = {int(meaning): code for code, meaning in reversed(list(self.described.states.items()))}
        self.reset()

    def reset(self) -> None:
        """Counters start over; no command was heard."""
        self._counters = dict.fromkeys(self.periods_us, 0)
        self._requested: dict[str, float] = {}

    def is_command(self, identifier: int) -> bool:
        """Whether it is one of the messages that the host sends."""
        return identifier in self._sent

    def requested_by(self, identifier: int, data: bytes, *, remote: bool) -> str:
        """Name of the message that a frame requests; empty if it is no request."""
        for (key, content, is_remote), name in self._requests.items():
            if (identifier, remote) == (key, is_remote) and (remote or data == content):
                return name
        return ""

    def command(self, identifier: int, data: bytes) -> Command | None:
        """What the host requests; None for a message without the set-point.

        Raises:
            RemoteProtocolError: wrong length, checksum or counter.
        """
        name = self._sent[identifier]
        message, seal = self._messages[name], self._seals[name]
        if len(data) != message.length:
            raise RemoteProtocolError(f"{name}: expected {message.length} data bytes, got {len(data)}")
        counter = seal.check(data)
        numbers: Any = message.decode(data, decode_choices=False, scaling=False)
        requested = {
            role: float(numbers[signal.name]) for role, signal in self._signals[name] if signal.name in numbers
        }
        self._requested |= requested
        if "command" not in requested:
            return None
        signal = self.described.signals["command"][1]
        setpoint_A = _value(signal, self._requested["command"])
        enable = self._is_on("enable", default=True)
        off = not enable if "enable" in self.described.on_off else setpoint_A == 0.0
        clears = self._is_on("clear_faults", default=off)
        return Command(counter, enable, clears, setpoint_A)

    def _is_on(self, role: str, *, default: bool) -> bool:
        if role not in self.described.on_off:
            return default
        return self._requested.get(role) == self.described.on_off[role][0]

    def commands(self, command: Command) -> list[Frame]:
        """The frames by which a host asks for that."""
        on_off = self.described.on_off
        frames: list[Frame] = []
        for sent in self.described.sent:
            name, identifier = sent.name, sent.identifier | (EXTENDED if sent.extended else 0)
            numbers = self._initial[name] | {
                signal.name: _cut(signal, raw) if not signal.is_float else signal.number(raw)
                for signal, raw in sent.writer.fixed
            }
            for role, signal in self._signals[name]:
                if role in on_off:
                    numbers[signal.name] = on_off[role][0 if getattr(command, role) else 1]
                elif role == "command":
                    numbers[signal.name] = _raw(signal, command.setpoint_A)
            data = bytearray(self._messages[name].encode(numbers, scaling=False, strict=False))
            self._seals[name].put(data, command.counter)
            frames.append((identifier, bytes(data)))
        return frames

    def frame(self, name: str, shown: Shown) -> Frame:
        """The next frame of a message; of a message with pages the page that comes next."""
        message = self._messages[name]
        numbers = self._initial[name] | self._reported(name, shown)
        pages = self.described.pages.get(name)
        count = self._counters[name]
        if pages:
            numbers |= pages[count % len(pages)]
        data = bytearray(message.encode(numbers, scaling=False, strict=False))
        self._seals[name].put(data, count)
        self._counters[name] = count + 1
        return self._identifiers[name], bytes(data)

    def damaged(self, frame: Frame) -> Frame:
        """A frame whose checksum, or counter where it has no checksum, is wrong."""
        identifier, data = frame
        name = next(name for name, sent in self._identifiers.items() if sent == identifier)
        return identifier, self._seals[name].damaged(data)

    def _reported(self, name: str, shown: Shown) -> dict[str, float]:
        """The numbers of the signals of a message that have a role."""
        described = self.described
        word = sum(bit for bit, fault in described.fault_bits.items() if shown.faults & fault)
        ticks = int(shown.device_us / described.tick_us) % described.clock_modulus if described.tick_us else 0
        values: dict[str, float] = {
            "measured_current": shown.current_A, "coil_temperature": shown.coil_degC, "ecu_temperature": shown.ecu_degC,
            "supply_voltage": shown.supply_V,
        }
        numbers: dict[str, int] = {
            "state": self._codes.get(shown.state, 0), "faults": word, "clock": ticks, "boot_count": shown.boot_count,
            "serial_number": shown.serial_number, "firmware": FIRMWARE, "layout": described.layout or 0,
        }
        for fault in reversed(described.fault_signals):
            there = min(fault.numbers, default=1)
            numbers[fault.field] = there if shown.faults & fault.fault else numbers.get(fault.field, 0)
        return {
            signal.name: _raw(signal, values[role]) if role in values else _cut(signal, numbers[role])
            for role, signal in self._signals[name]
        }


def _initial(message: Any) -> dict[str, float]:  # noqa: ANN401 - cantools has no types
    """What the signals of a message are while nothing sets them."""
    return {
        signal.name: signal.raw_initial if isinstance(signal.raw_initial, int | float) else 0
        for signal in message.signals
    }


def _period_us(period_s: float, roles: frozenset[str]) -> int:
    stated = round(1e6 * period_s)
    return stated or min((USUAL_US.get(role, OTHER_US) for role in roles), default=OTHER_US)


@functools.lru_cache(8)
def _messages(dbc: DbcText) -> Mapping[str, Any]:
    """The messages of a DBC by their names, as cantools has them."""
    return {message.name: message for message in can_database(dbc.text, dbc.format).messages}


def _value(signal: Signal, number: float) -> float:
    """The value of a number on the wire, rounded once: 7 steps of 0.001 are 0.007."""
    return float(Decimal(repr(signal.scale)) * Decimal(number) + Decimal(repr(signal.offset)))


def _raw(signal: Signal, value: float) -> float:
    """The number on the wire nearest to a value, at the end of the range where it is beyond."""
    number = (value - signal.offset) / signal.scale
    return number if signal.is_float else min(max(round(number), int(signal.low)), int(signal.high))


def _cut(signal: Signal, number: int) -> int:
    """A whole number as far as its bits go."""
    cut = number % (1 << signal.length)
    return cut - (1 << signal.length) if signal.signed and cut >> signal.length - 1 else cut

