"""CAN frames of the demo current ECU, seen from inside: four messages, two of them protected.

    command      host -> source, cyclic      counter, enable, clear faults, set-point
    status       source -> host, cyclic      counter, state, current, faults, duty cycle, device time
    temperature  source -> host, slower      coil, source, supply, boot count
    identity     source -> host, slower      serial number, firmware, layout

Which identifier a message has and where its signals lie is said by `Message` and `Signal`; what a signal means, by the
field of the message it is given to. Protection is AUTOSAR E2E profile 1, mode BOTH: CRC-8 in byte 0, a counter 0..14 in
the low nibble of byte 1. No code is shared with the host's driver.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from e2e.p01 import e2e_p01_check, e2e_p01_protect

from protocols.errors import LocalProtocolError, RemoteProtocolError

COUNTER_MODULUS = 15
"""The counter runs 0..14; 15 is invalid in profile 1."""


class CoilCommand(NamedTuple):
    """Contents of the command: `setpoint_A` in A, `counter` 0..14."""

    counter: int
    enable: bool
    clear_faults: bool
    setpoint_A: float


class CoilStatus(NamedTuple):
    """Contents of the status: `state` and `faults` by the device's own codes, `device_time_ticks` wraps."""

    counter: int
    state: int
    current_A: float
    faults: int
    duty_percent: float
    device_time_ticks: int


class CoilTemperature(NamedTuple):
    """Contents of the temperature message: temperatures in degC, supply in V."""

    coil_degC: float
    ecu_degC: float
    supply_V: float
    boot_count: int


class EcuIdentity(NamedTuple):
    """Contents of the identity; `firmware` is binary coded decimal (0x0102 is 1.02)."""

    serial_number: int
    firmware: int
    layout: int


@dataclass(frozen=True, slots=True)
class Signal:
    """Where one number lies in its message.

    Attributes:
        name: for messages to people.
        start: bit number of the least significant bit, little-endian (byte n holds bits 8n..8n+7).
        length: bits.
        signed: two's complement.
        scale: physical value = scale x wire value.
        unit: of the physical value.
    """

    name: str
    start: int
    length: int
    signed: bool = False
    scale: float = 1.0
    unit: str = ""

    @property
    def low(self) -> int:
        """Least wire value."""
        return -(1 << self.length - 1) if self.signed else 0

    @property
    def high(self) -> int:
        """Greatest wire value."""
        return (1 << self.length - 1) - 1 if self.signed else (1 << self.length) - 1


@dataclass(frozen=True, slots=True)
class Message:
    """One CAN message: identifier, length in bytes, signals by the field they fill, and its E2E data id.

    Attributes:
        data_id: of AUTOSAR E2E profile 1; None for a message without protection.
    """

    identifier: int
    length: int
    signals: Mapping[str, Signal]
    data_id: int | None = None


class _Codec:
    """Packs and unpacks one message; the signals are in the order of `fields`."""

    def __init__(self, message: Message, fields: tuple[str, ...], whole: frozenset[str]) -> None:
        missing = [field for field in fields if field not in message.signals]
        if missing:
            raise LocalProtocolError(f"frame 0x{message.identifier:03X} has no signal for {missing[0]!r}")
        self.message = message
        self.name = f"frame 0x{message.identifier:03X}"
        self._signals = [(message.signals[field], field in whole) for field in fields]
        self._parts = [
            (signal.start, (1 << signal.length) - 1, signal.high, signal.signed, None if raw else _factor(signal.scale))
            for signal, raw in self._signals
        ]
        self._protected = message.data_id is not None

    def encode(self, values: tuple[float, ...]) -> bytes:
        """Bytes of the message; the first value of a protected one is its counter.

        Raises:
            LocalProtocolError: a value does not fit its signal.
        """
        message = self.message
        if self._protected and not 0 <= values[0] < COUNTER_MODULUS:
            raise LocalProtocolError(f"{self.name}: counter {values[0]} is outside 0..14")
        bits = 0
        for (signal, raw), value in zip(self._signals, values, strict=True):
            steps = _steps(value, 1.0 if raw else signal.scale, signal)
            bits |= (steps & (1 << signal.length) - 1) << signal.start
        data = bytearray(bits.to_bytes(message.length, "little"))
        if message.data_id is not None:
            e2e_p01_protect(data, message.data_id, increment_counter=False)
        return bytes(data)

    def decode(self, data: bytes) -> list[float]:
        """Values of the message's fields.

        Raises:
            RemoteProtocolError: wrong length, counter or CRC.
        """
        message = self.message
        if len(data) != message.length:
            raise RemoteProtocolError(f"{self.name}: expected {message.length} data bytes, got {len(data)}")
        if message.data_id is not None:
            if data[1] & 0x0F >= COUNTER_MODULUS:
                raise RemoteProtocolError(f"{self.name}: counter 15 is not valid")
            if not e2e_p01_check(bytearray(data), message.data_id):
                raise RemoteProtocolError(f"{self.name}: wrong CRC in {data.hex(' ')}")
        bits = int.from_bytes(data, "little")
        values: list[float] = []
        for start, mask, high, signed, factor in self._parts:
            value = bits >> start & mask
            if signed and value > high:
                value -= mask + 1
            if factor is None:
                values.append(value)
            else:
                multiply, divide = factor
                values.append(value * multiply / divide)
        return values


class CurrentFrames:
    """The four messages of one kind of current source.

    Args:
        command: fields as in `CoilCommand`.
        status: fields as in `CoilStatus`.
        temperature: fields as in `CoilTemperature`.
        identity: fields as in `EcuIdentity`.
        tick_us: length of a tick of the status's device time (us).

    Attributes:
        command_id, status_id, temperature_id, identity_id: CAN identifiers.
        device_time_modulus: at which the status's device time wraps, ticks.

    Raises:
        LocalProtocolError: a message lacks a signal.
    """

    def __init__(
        self, command: Message, status: Message, temperature: Message, identity: Message, *, tick_us: int
    ) -> None:
        self._command = _Codec(command, CoilCommand._fields, frozenset({"counter", "enable", "clear_faults"}))
        self._status = _Codec(
            status, CoilStatus._fields, frozenset({"counter", "state", "faults", "device_time_ticks"})
        )
        self._temperature = _Codec(temperature, CoilTemperature._fields, frozenset({"boot_count"}))
        self._identity = _Codec(identity, EcuIdentity._fields, frozenset(EcuIdentity._fields))
        self.command_id, self.status_id = command.identifier, status.identifier
        self.temperature_id, self.identity_id = temperature.identifier, identity.identifier
        self.lengths = {item.identifier: item.length for item in (command, status, temperature, identity)}
        self.tick_us = tick_us
        self.device_time_modulus = status.signals["device_time_ticks"].high + 1

    def encode_command(self, command: CoilCommand) -> bytes:
        """Command frame with its counter and CRC.

        Raises:
            LocalProtocolError: the counter is not 0..14 or the set-point does not fit its signal.
        """
        return self._command.encode(command)

    def encode_status(self, status: CoilStatus) -> bytes:
        """Status frame with its counter and CRC.

        Raises:
            LocalProtocolError: a value does not fit its signal.
        """
        return self._status.encode(status)

    def encode_temperature(self, temperature: CoilTemperature) -> bytes:
        """Temperature frame.

        Raises:
            LocalProtocolError: a value does not fit its signal.
        """
        return self._temperature.encode(temperature)

    def encode_identity(self, identity: EcuIdentity) -> bytes:
        """Identity frame.

        Raises:
            LocalProtocolError: a value does not fit its signal.
        """
        return self._identity.encode(identity)

    def decode_command(self, data: bytes) -> CoilCommand:
        """Contents of a command frame.

        Raises:
            RemoteProtocolError: wrong length, CRC or counter.
        """
        counter, enable, clear_faults, setpoint_A = self._command.decode(data)
        return CoilCommand(int(counter), bool(enable), bool(clear_faults), setpoint_A)

    def decode_status(self, data: bytes) -> CoilStatus:
        """Contents of a status frame.

        Raises:
            RemoteProtocolError: wrong length, CRC or counter.
        """
        return CoilStatus(*self._status.decode(data))  # type: ignore[arg-type]  # fields without a scale are whole

    def decode_temperature(self, data: bytes) -> CoilTemperature:
        """Contents of a temperature frame.

        Raises:
            RemoteProtocolError: wrong length.
        """
        return CoilTemperature(*self._temperature.decode(data))  # type: ignore[arg-type]  # the boot count is whole

    def decode_identity(self, data: bytes) -> EcuIdentity:
        """Contents of an identity frame.

        Raises:
            RemoteProtocolError: wrong length.
        """
        return EcuIdentity(*self._identity.decode(data))  # type: ignore[arg-type]  # all are whole


def counter_delta(previous: int, present: int) -> int:
    """Frames sent since `previous`, modulo 15: 1 is right, 0 a repetition, n > 1 means n - 1 frames are missing."""
    return (present - previous) % COUNTER_MODULUS


def _factor(scale: float) -> tuple[float, float]:
    """Numbers to multiply with and to divide by: a scale of 0.001 is division by 1000, which rounds once."""
    inverse = round(1.0 / scale)
    return (1.0, inverse) if abs(inverse * scale - 1.0) < 1e-9 else (scale, 1.0)


def _steps(value: float, scale: float, signal: Signal) -> int:
    """Value in wire steps, rounded to the nearest.

    Raises:
        LocalProtocolError: not finite, or outside what the signal can hold.
    """
    scaled = value / scale
    low, high = signal.low, signal.high
    if not low - 0.5 <= scaled <= high + 0.5:
        unit = f" {signal.unit}" if signal.unit and scale == signal.scale else ""
        raise LocalProtocolError(f"{signal.name} {value}{unit} is outside {low * scale:g}..{high * scale:g}{unit}")
    return min(max(round(scaled), low), high)
