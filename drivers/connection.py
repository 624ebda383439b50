"""How to reach a device: addresses of actuators and CAN buses, parsed once, and settings of lines."""

from __future__ import annotations

import math
import os
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any
from urllib.parse import urlsplit


class LinkKind(StrEnum):
    """What the connection to an actuator is made of; the values are the address's prefixes."""

    MODBUS_TCP = "modbus-tcp"
    MODBUS_RTU = "modbus-rtu"
    TCP = "tcp"
    """A plain TCP connection, for a protocol of the device's own."""
    UNKNOWN = ""


@dataclass(frozen=True, slots=True)
class ActuatorAddress:
    """Where an actuator is.

    Attributes:
        text: as written in the bench file.
        kind: what the link is made of.
        host, port: of a network address; None where they are not stated.
        line: serial port of a serial line, anything `serial_for_url` takes; empty otherwise.
    """

    text: str
    kind: LinkKind
    host: str | None = None
    port: int | None = None
    line: str = ""

    @classmethod
    def parse(cls, text: str) -> ActuatorAddress:
        """Read an address: `modbus-tcp://host:port`, `modbus-rtu:PORT` or `tcp://host:port`; never raises."""
        prefix, _, rest = text.partition(":")
        kind = LinkKind(prefix) if prefix in set(LinkKind) else LinkKind.UNKNOWN
        if kind is LinkKind.MODBUS_RTU:
            return cls(text, kind, line=rest)
        try:
            parts = urlsplit(text)
            return cls(text, kind, parts.hostname, parts.port)
        except ValueError:
            return cls(text, kind)


@dataclass(frozen=True, slots=True)
class MotionTerms:
    """What an actuator must know whose motion is made by its driver.

    Attributes:
        fade_out_cycles: cycles over which a program fades out, >= 1.
        halt_deceleration_m_s2: of a halt.
        device_rate: seconds of the device's time in one of the host's; 1 but on a simulated rig faster than life.
        position_min_m, position_max_m: travel that set-points may use (m).
        speed_m_s, acceleration_m_s2: largest of the rod.
        period_s: of the set-points (wall s); 0: not known, gaps are not looked for.
        longest_gap_s: a motion is not continued after a longer time without a set-point that was taken (wall s).
    """

    fade_out_cycles: float = 1.0
    halt_deceleration_m_s2: float = 20.0
    device_rate: float = 1.0
    position_min_m: float = -math.inf
    position_max_m: float = math.inf
    speed_m_s: float = math.inf
    acceleration_m_s2: float = math.inf
    period_s: float = 0.0
    longest_gap_s: float = math.inf


@dataclass(frozen=True, slots=True)
class ActuatorConnection:
    """How to reach an actuator.

    Attributes:
        url: its address, as in the bench file.
        device_id: Modbus unit number.
        timeout_s: longest wait for one answer (s).
        owner_id: identifies this host in the actuator's lease, 1..65535.
        baudrate: Bd of a serial line.
        parity: "N", "E" or "O", of a serial line.
        motion: used where the driver makes the motion, not the device.
    """

    url: str
    device_id: int = 1
    timeout_s: float = 0.04
    owner_id: int = 0
    baudrate: int = 115_200
    parity: str = "N"
    motion: MotionTerms = MotionTerms()


@dataclass(frozen=True, slots=True)
class LineSettings:
    """Of a serial line; sockets have none.

    Attributes:
        baudrate: Bd.
        data_bits: 7 or 8.
        parity: "N", "E" or "O".
        stop_bits: 1 or 2.
    """

    baudrate: int = 115200
    data_bits: int = 8
    parity: str = "N"
    stop_bits: int = 1


@dataclass(frozen=True, slots=True)
class CanAddress:
    """Where a CAN bus is.

    Attributes:
        interface: name as python-can has it.
        channel: what that interface calls the bus; a serial URL for slcan.
        bitrate: bit/s.
        options: further arguments of the interface, by python-can's names.
    """

    interface: str
    channel: str
    bitrate: int = 500_000
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """Name of the bus: the port of a serial CAN adapter, otherwise interface and channel."""
        return self.channel if self.interface == "slcan" else f"{self.interface}:{self.channel}"


def modbus_line(url: str) -> str:
    """Common part of the addresses of devices on one Modbus connection: host and port, or serial port.

    The addresses `/dev/ttyUSB0` of a sensor and `modbus-rtu:/dev/ttyUSB0` of an output are the same line, and so is a
    name under `/dev/serial/by-id` that currently leads to this port.
    """
    for prefix in (f"{LinkKind.MODBUS_RTU}:", f"{LinkKind.MODBUS_TCP}://", "socket://"):
        url = url.removeprefix(prefix)
    return url.casefold() if not url.startswith("/") else os.path.realpath(url)


def draw_owner_id() -> int:
    """A number 1..65535 at random, to tell this host from others: containers repeat process ids."""
    return secrets.randbelow(0xFFFF) + 1
