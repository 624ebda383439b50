"""Errors between a driver and its device.

    DriverError
     +-- PortClosed           the port is missing, refused or unplugged
     |    +-- SharedConnectionClosed   another device that shares it reports the cause
     +-- NoAnswer             no answer within the time-out
     +-- LinkLost             the connection broke during a request
     +-- WrongIdentity        another device answered
     |    +-- WrongLayout     the right device with another register layout
     +-- RequestRefused       the device refused the request
     |    +-- Busy            it answered "busy" to every attempt
     +-- WrongAnswer          the answer violates the protocol
     |    +-- OtherAnswer     an intact answer to another request
     |    +-- DamagedAnswer   truncated, too long, or with a wrong checksum
     |    +-- LocalEcho       the host's own request came back
     +-- UnknownDevice        no description or driver of that name

Each class is one condition. Callers decide by the class or its `code`, never by the message.
"""

from __future__ import annotations

from typing import ClassVar


class DriverError(Exception):
    """Base of every driver error; the message names the device, the port, what was expected and what was received.

    Attributes:
        device: name of the device as in the bench file, e.g. "load_cell".
        port: URL or channel of its port.
        message: what was expected and received, without device and port.
        fix: what the user can do about it; empty if unknown.
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
    """The port cannot be opened, or has gone away.

    Situations: no such device file or host; connection refused; no permission; another program holds the port; the
    adapter was unplugged; end of file or an input/output error while reading.
    """

    code = "port-closed"


class SharedConnectionClosed(PortClosed):
    """The shared connection of a device is closed; another of its users reports the cause.

    Situations: two devices behind one host and port, on one serial line or CAN bus; the first one could not open it.
    """


class NoAnswer(DriverError):
    """The device did not answer within its time-out; whether it acted is unknown.

    Situations: wrong unit number or baud rate; cable or power; a device that is restarting; an answer lost on the line.
    """

    code = "no-answer"


class LinkLost(DriverError):
    """The connection broke during a request; whether the device acted is unknown.

    Situations: the device closes the TCP connection; a reset by the network; an adapter unplugged between request and
    answer.
    """

    code = "link-lost"


class WrongIdentity(DriverError):
    """The device is not the one expected: its signature, serial number or layout differs.

    Situations: another device at the address; a replaced device; a port that was renumbered.
    """

    code = "wrong-identity"


class WrongLayout(WrongIdentity):
    """The device is the right one, but its registers are laid out differently.

    Situations: another firmware version; wrong word order, scale or layout version in the register map.
    """

    code = "wrong-layout"


class RequestRefused(DriverError):
    """The device answered and refused the request: it has not acted.

    Situations: a Modbus exception; a command result other than "done"; a value outside the device's own limits.
    """

    code = "refused"


class WrongAnswer(DriverError):
    """The answer violates the protocol.

    Situations: wrong length; wrong unit; an echoed value that differs from the one written.
    """

    code = "wrong-answer"


class OtherAnswer(WrongAnswer):
    """An intact answer to another request: its unit, function, address, count or value differs.

    Situations: a late answer to a request that was given up; two masters on one line.
    """

    code = "other-answer"


class DamagedAnswer(WrongAnswer):
    """A frame that is truncated, too long, or has a wrong checksum.

    Situations: interference; missing termination; a wrong baud rate or parity; two devices that answer at once.
    """

    code = "damaged-answer"


class LocalEcho(WrongAnswer):
    """The line returns what the host sends.

    Situations: an RS-485 adapter with its receiver enabled while it sends.
    """

    code = "local-echo"


class Busy(RequestRefused):
    """The device answered "busy" to every attempt; it has not acted.

    Situations: a controller that is saving parameters or serving another client.
    """

    code = "busy"


class UnknownDevice(DriverError):
    """The bench file names a device for which there is neither a description nor a driver."""

    code = "unknown-device"
