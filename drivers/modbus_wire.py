"""How Modbus requests travel: TCP with transaction numbers, or a serial line where only silence separates frames.

    modbus-tcp://host:port                        Modbus TCP
    modbus-rtu:/dev/ttyUSB0                       Modbus RTU on a serial port
    modbus-rtu:socket://host:port                 Modbus RTU through a serial device server

Both ask once and answer once; who may ask again is decided in `modbus_link`.
"""

from __future__ import annotations

import contextlib
import select
import socket
from typing import Protocol

from drivers import clock
from drivers.connection import ActuatorAddress
from drivers.errors import DamagedAnswer, LinkLost, LocalEcho, NoAnswer, OtherAnswer, PortClosed
from drivers.serial_port import SerialPort
from protocols import modbus
from protocols.errors import RemoteProtocolError

READ_SIZE = 4096
TRANSACTIONS = 1 << 16
EARLIER = 4
"""So many requests back an answer may belong to one that was given up."""
ECHO = "local echo: the adapter receives its own requests"
ECHO_FIX = "switch off the echo at the RS-485 adapter (2-wire mode, receiver disabled during transmission)"
QUIET_S = 0.005
"""Silence that ends whatever a serial line was sending: more than 3.5 characters at any baud rate in use."""


class Wire(Protocol):
    """One way to a device; used by one thread.

    Attributes:
        stale: answers to earlier or unknown requests, recognised and discarded.
    """

    stale: int

    @property
    def is_open(self) -> bool:
        """Whether the connection stands, as far as is known."""

    def open(self, timeout_s: float) -> None:
        """Connect; `timeout_s` is the longest wait."""

    def close(self) -> None:
        """Disconnect; closing twice is harmless."""

    def ask(self, pdu: bytes, timeout_s: float) -> bytes:
        """Send one request and return the PDU of its answer."""

    def drain(self) -> int:
        """Discard answers that are no longer awaited; number of bytes."""


class TcpWire:
    """Modbus TCP: an answer carries the number of its request; any other is thrown away and counted."""

    def __init__(self, address: ActuatorAddress, unit: int, device: str) -> None:
        self.url = address.text
        self._address = address
        self.device = device
        self.stale = 0
        self._unit = unit
        self._transaction = 0
        self._socket: socket.socket | None = None
        self._frames = modbus.TcpFrames()

    @property
    def is_open(self) -> bool:
        """Whether the connection stands, as far as is known."""
        return self._socket is not None

    def open(self, timeout_s: float) -> None:
        """Connect.

        Raises:
            PortClosed: not such a URL, or no answer.
        """
        host, port = self._address.host, self._address.port
        if host is None or port is None:
            raise PortClosed(self.device, self.url, "expected modbus-tcp://host:port")
        try:
            connection = socket.create_connection((host, port), timeout=timeout_s)
        except OSError as error:
            message = f"no connection within {timeout_s:g} s" if isinstance(error, TimeoutError) else (
                f"no connection: {error.strerror or error}"
            )
            raise PortClosed(self.device, self.url, message) from error
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = connection
        self._frames = modbus.TcpFrames()

    def close(self) -> None:
        """Disconnect."""
        connection, self._socket = self._socket, None
        if connection is not None:
            with contextlib.suppress(OSError):
                connection.close()

    def ask(self, pdu: bytes, timeout_s: float) -> bytes:
        """Send one request, wait for its answer.

        Raises:
            NoAnswer: none with this request's number came in time, or one with a number that was never asked for: the
                connection answers one request at a time, so it was meant to be this one's.
            LinkLost: the connection broke or is not open.
            OtherAnswer: what came is not Modbus, or is from another unit.
        """
        connection = self._socket
        if connection is None:
            raise LinkLost(self.device, self.url, "not connected")
        self._transaction = (self._transaction + 1) % TRANSACTIONS
        deadline, silence = clock.monotonic() + timeout_s, f"no answer within {timeout_s * 1e3:g} ms"
        try:
            connection.settimeout(timeout_s)
            connection.sendall(modbus.encode_tcp(self._transaction, self._unit, pdu))
            # A host that did not run must not call its device silent: what waits at the deadline is still looked at.
            in_time = True
            while (answer := self._next_answer()) is None and in_time:
                in_time = clock.monotonic() < deadline
                self._read_until(connection, deadline)
        except TimeoutError as error:
            raise NoAnswer(self.device, self.url, silence) from error
        except OSError as error:
            self.close()
            raise LinkLost(self.device, self.url, f"connection lost: {error}") from error
        except RemoteProtocolError as error:
            # Where the next frame begins is not known any more.
            self.close()
            raise OtherAnswer(self.device, self.url, str(error)) from error
        if answer is None:
            raise NoAnswer(self.device, self.url, silence)
        return answer

    def drain(self) -> int:
        """Throw away what has arrived."""
        thrown = 0
        while self._socket is not None and select.select([self._socket], [], [], 0.0)[0]:
            try:
                data = self._socket.recv(READ_SIZE)
            except OSError:
                break
            thrown += len(data)
            if not data:
                break
        self._frames = modbus.TcpFrames()
        return thrown

    def _next_answer(self) -> bytes | None:
        """The PDU of this request's answer, None while it has not come; others are counted.

        Raises:
            RemoteProtocolError: not Modbus.
            NoAnswer: a number that was not asked for lately.
            OtherAnswer: another unit's.
        """
        while (frame := self._frames.next()) is not None:
            transaction, unit, pdu = frame
            if transaction != self._transaction:
                self.stale += 1
                if (self._transaction - transaction) % TRANSACTIONS > EARLIER:
                    text = f"answer {transaction} to request {self._transaction}"
                    raise NoAnswer(self.device, self.url, text)
                continue
            if unit != self._unit:
                raise OtherAnswer(self.device, self.url, f"the request was sent to unit {self._unit}, but unit "
                    f"{unit} answered")
            return pdu
        return None

    def _read_until(self, connection: socket.socket, deadline: float) -> None:
        """Take what comes next.

        Raises:
            TimeoutError: nothing until the deadline.
            OSError: the other end is gone.
        """
        left_s = deadline - clock.monotonic()
        if not select.select([connection], [], [], max(0.0, left_s))[0]:
            if clock.monotonic() < deadline:
                return  # a simulated rig's clock waited meanwhile
            raise TimeoutError
        data = connection.recv(READ_SIZE)
        if not data:
            raise OSError("the device closed the connection")
        self._frames.feed(data)


class RtuWire:
    """Modbus RTU: an answer cannot say to which request it belongs.

    So nothing may be under way when a request is sent. After a time-out the line is listened to for as long again and
    until it is silent, and what comes is thrown away and counted as stale; what waits before a request is, too. A frame
    is taken only whole, of the length the request allows, with the right checksum and with nothing behind it.
    """

    def __init__(self, address: ActuatorAddress, unit: int, device: str, baudrate: int, parity: str) -> None:
        self.url = address.text
        self.device = device
        self.stale = 0
        self._unit = unit
        self._port = SerialPort(address.line, baudrate, device=device, parity=parity)

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return self._port.is_open

    def open(self, timeout_s: float) -> None:
        """Open the port; `timeout_s` does not apply to one that is there or not.

        Raises:
            PortClosed: it cannot be opened.
        """
        del timeout_s
        self._port.open()

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def ask(self, pdu: bytes, timeout_s: float) -> bytes:
        """Send one request, wait for its answer.

        Raises:
            NoAnswer: no whole answer in time.
            LinkLost: the port is gone or not open.
            LocalEcho: the line returns what was sent.
            OtherAnswer: from another unit.
            DamagedAnswer: a frame that is damaged, or not an answer to this function.
        """
        if not self._port.is_open:
            raise LinkLost(self.device, self.url, "not connected")
        try:
            self.stale += self._port.discard_input() > 0
            sent = modbus.encode_rtu(self._unit, pdu)
            self._port.write(sent)
            frame = self._frame(pdu, sent, clock.monotonic() + timeout_s)
            if not frame:
                self.stale += self._listen(timeout_s) > 0
                raise NoAnswer(self.device, self.url, f"no answer within {timeout_s * 1e3:g} ms")
            unit, answer = modbus.decode_rtu(frame)
        except PortClosed as error:
            self.close()
            raise LinkLost(self.device, self.url, f"the connection to the port was lost: {error}") from error
        except RemoteProtocolError as error:
            self.drain()
            raise DamagedAnswer(self.device, self.url, str(error)) from error
        if unit != self._unit:
            raise OtherAnswer(self.device, self.url, f"the request was sent to unit {self._unit}, but unit {unit} "
                "answered")
        return answer

    def drain(self) -> int:
        """Throw away what comes until the line is silent."""
        return self._listen(QUIET_S) if self._port.is_open else 0

    def _frame(self, request: bytes, sent: bytes, deadline: float) -> bytes:
        """The bytes of one whole answer; empty when the line stayed silent until the deadline.

        The answer to a write of one register or coil is the request itself: there an echo shows by a second copy.

        Raises:
            LocalEcho: the line returns what was sent.
            RemoteProtocolError: not an answer to this request, cut short, or with bytes behind it.
            PortClosed: the port is gone.
        """
        held, echoes = b"", request[0] in modbus.ECHOING
        while True:
            if held.startswith(sent * 2 if echoes else sent):
                self.drain()
                raise LocalEcho(self.device, self.url, ECHO, ECHO_FIX)
            size = modbus.rtu_answer_size(held, request)
            if size is not None and len(held) >= size and not (len(held) < len(sent) and sent.startswith(held)):
                break
            data, _ = self._port.read_available(max(0.0, deadline - clock.monotonic()))
            held += data
            if not data and clock.monotonic() >= deadline:
                if held:
                    raise RemoteProtocolError(f"answer truncated after {len(held)} bytes")
                return b""
        if len(held) > size:
            raise RemoteProtocolError(f"{len(held) - size} extra bytes after an answer of {size} bytes")
        return held

    def _listen(self, first_s: float) -> int:
        """Throw away what comes within `first_s`, and after it until the line is silent; number of bytes.

        Raises:
            PortClosed: the port is gone.
        """
        thrown, wait_s = 0, first_s
        while True:
            data, _ = self._port.read_available(wait_s)
            if not data:
                return thrown
            thrown += len(data)
            wait_s = QUIET_S
