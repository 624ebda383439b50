"""What can go wrong between a driver and its device.

    DriverError
     +-- PortClosed        no such port, refused, unplugged
     +-- NoAnswer          nothing within the time-out
     +-- LinkLost          broken in the middle of a request
     +-- WrongIdentity     another device
     |    +-- WrongLayout  the device, its registers laid out otherwise
     +-- RequestRefused    it said no
     |    +-- Busy         it said "later", again and again
     +-- WrongAnswer       what its protocol forbids
     |    +-- OtherAnswer  intact, but the answer to something else
     |    +-- DamagedAnswer  cut short, too long, with a wrong checksum
     |    +-- LocalEcho    the host's own request
     +-- UnknownDevice     unknown device

Each is one condition; what to do about it is decided by class or `code`, never by the message.
"""

from __future__ import annotations

from typing import ClassVar


class DriverError(Exception):
    """Base of every driver error; the message names device, port, what was expected and what came.

    Attributes:
        device: name of the device as in the bench file, e.g. "load_cell".
        port: URL or channel of its port.
        message: what was expected and what came, without device and port.
        fix: what would fix it, where that is known; else empty.
        code: the condition as a slug; decide by it or by the class, never by the message.
    """

    code: ClassVar[str] = "driver"

    def __init__(self, device: str, port: str, message: str, fix: str = "") -> None:
        super().__init__(f"{device} at {port}: {message}")
        self.fix = fix
        self.device = device
        self.port = port
        self.message = message


class PortClosed(DriverError):
    """The port cannot be opened, or went away: no such device, connection refused, end of file, input/output error."""

    code = "port-closed"


class NoAnswer(DriverError):
    """The device did not answer within its time-out; whether it acted is unknown."""

    code = "no-answer"


class LinkLost(DriverError):
    """The connection broke in the middle of a request; whether the device acted is unknown."""

    code = "link-lost"


class WrongIdentity(DriverError):
    """The device is not the one expected: signature registers, serial number or layout differ."""

    code = "wrong-identity"


class WrongLayout(WrongIdentity):
    """The device's registers are not laid out as expected: signature, word order, scale or layout version differ."""

    code = "wrong-layout"


class RequestRefused(DriverError):
    """The device answered and said no: Modbus exception, or a command result other than done."""

    code = "refused"


class WrongAnswer(DriverError):
    """The device answered something its protocol forbids: wrong length, wrong unit, an echo that differs."""

    code = "wrong-answer"


class OtherAnswer(WrongAnswer):
    """An intact answer to something else: another unit, function, address, count or value."""

    code = "other-answer"


class DamagedAnswer(WrongAnswer):
    """A frame that is cut short, too long, or has a wrong checksum."""

    code = "damaged-answer"


class LocalEcho(WrongAnswer):
    """The line returns what the host sends: an RS-485 adapter hears itself."""

    code = "local-echo"


class Busy(RequestRefused):
    """The device answered that it is busy, again and again; it has not acted."""

    code = "busy"


class UnknownDevice(DriverError):
    """The bench file names a kind of device that there is no description and no driver of."""

    code = "unknown-device"
