"""One Modbus connection: requests, time-outs, bounded retries, matching of answers.

    modbus-tcp://host:port                       Modbus TCP
    modbus-rtu:PORT                              Modbus RTU on anything `serial_for_url` takes

A time-out leaves the outcome unknown. Reads, and exchanges whose write is harmless to repeat, are tried again within
their bound; anything else is left to the caller. The connection is closed at the second time-out in a row, because a
silent peer keeps a TCP connection "connected" for ever; the owner opens it again. Late answers are recognised and
skipped: by the number of their request on TCP, by listening until the line is silent on a serial line.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TypeVar

from drivers.connection import ActuatorAddress, LinkKind
from drivers.errors import Busy, LinkLost, NoAnswer, OtherAnswer, PortClosed, RequestRefused, WrongAnswer
from drivers.modbus_wire import RtuWire, TcpWire, Wire
from protocols import modbus
from protocols.errors import RemoteProtocolError

T = TypeVar("T")

OPEN_TIMEOUT_S = 2.0
TIMEOUTS_UNTIL_CLOSED = 2
READ_RETRIES = 1
BUSY_RETRIES = 3
BUSY_PAUSE_S = 0.005


class ModbusLink:
    """A connection to one Modbus device, used by one thread.

    Args:
        url: modbus-tcp://host:port, or modbus-rtu: and a serial port.
        device_id: Modbus unit number, 0..255.
        timeout_s: longest wait for one answer, s.
        device: name of the device for messages.
        baudrate: Bd of a serial line.
        parity: "N", "E" or "O", of a serial line.
        wire: the connection if it is shared with other devices; None: a separate connection.

    Attributes:
        timeouts: number of answers that did not arrive in time since construction.
        busy: number of requests repeated after a "busy" answer since construction.
    """

    def __init__(
        self, url: str, device_id: int = 1, timeout_s: float = 0.04, *, device: str = "actuator",
        baudrate: int = 115_200, parity: str = "N", wire: Wire | None = None,
    ) -> None:
        self.url = url
        self.device = device
        self.timeouts = 0
        self.busy = 0
        self._timeout_s = timeout_s
        self._silent = 0
        self._wire = wire
        self.address = ActuatorAddress.parse(url)
        if wire is not None:
            return
        if self.address.kind is LinkKind.MODBUS_RTU:
            self._wire = RtuWire(self.address, device_id, device, baudrate, parity)
        elif self.address.kind is LinkKind.MODBUS_TCP:
            self._wire = TcpWire(self.address, device_id, device)

    @property
    def is_open(self) -> bool:
        """Whether the connection stands, as far as is known."""
        return self._wire is not None and self._wire.is_open

    @property
    def stale(self) -> int:
        """Answers to earlier requests that were recognised and thrown away, since construction."""
        return 0 if self._wire is None else self._wire.stale

    def open(self, timeout_s: float = OPEN_TIMEOUT_S) -> None:
        """Connect; does nothing when connected.

        Args:
            timeout_s: longest wait for the connection, s.

        Raises:
            PortClosed: the URL is no Modbus URL, or does not answer.
        """
        if self._wire is None:
            raise PortClosed(self.device, self.url, "expected modbus-tcp://host:port or modbus-rtu:PORT")
        if not self._wire.is_open:
            self._wire.open(timeout_s)
            self._silent = 0

    def close(self) -> None:
        """Disconnect; closing twice is harmless."""
        if self._wire is not None:
            self._wire.close()

    def read(self, address: int, count: int, function: int = modbus.READ) -> list[int]:
        """Read registers or coils, again after a time-out, a damaged or a busy answer.

        Args:
            address: first register or coil.
            count: 1..125 registers, 1..2000 coils.
            function: 1, 2, 3 or 4.

        Returns:
            `count` words, of coils 0 and 1.

        Raises:
            NoAnswer: no answer, also not to the retry.
            LinkLost: the connection broke or is not open.
            RequestRefused: the device answered with an exception.
            WrongAnswer: the answer is not one to this request, also not to the retry.
        """
        return self._words(modbus.read_request(address, count, function), count)

    def write(self, address: int, words: Sequence[int], function: int = modbus.WRITE) -> None:
        """Write registers or coils, once.

        Args:
            address: first register or coil.
            words: 1..123 values (0 or 1 for coils); for function 22, the mask of the unchanged bits and the other bits.
            function: 5, 6, 15, 16 or 22.

        Raises:
            NoAnswer: no answer; the device may have acted.
            LinkLost: the connection broke or is not open; the device may have acted.
            RequestRefused: the device answered with an exception; it has not acted.
            WrongAnswer: the answer is not one to this request; the device may have acted.
        """
        request = modbus.write_request(address, words, function)
        self._unless_busy(request, lambda answer: modbus.check_written(request, answer))

    def exchange(
        self, read_address: int, read_count: int, write_address: int, words: Sequence[int], *,
        retries: int = READ_RETRIES,
    ) -> list[int]:
        """Write, then read, in one trip (FC23); where it is retried, the write must be harmless to repeat.

        Args:
            read_address: first register to read.
            read_count: 1..125.
            write_address: first register to write.
            words: 1..121 values.
            retries: how often it is tried again; 0 for a write that is out of date by then.

        Returns:
            `read_count` words.

        Raises:
            NoAnswer: no answer, also not to the retry.
            LinkLost: the connection broke or is not open.
            RequestRefused: the device answered with an exception.
            WrongAnswer: the answer is not one to this request, also not to the retry.
        """
        request = modbus.exchange_request(read_address, read_count, write_address, words)
        return self._words(request, read_count, retries)

    def _words(self, request: bytes, count: int, retries: int = READ_RETRIES) -> list[int]:
        """Ask for registers, within the bound again after silence or a damaged answer.

        Raises:
            NoAnswer: the retries are used up, or the connection was given up.
            WrongAnswer: the retries are used up, or the connection was given up.
            LinkLost: the connection broke.
            RequestRefused: an exception.
        """
        decode = modbus.decode_bits if request[0] in modbus.BIT_READS else modbus.decode_words
        while True:
            try:
                return self._unless_busy(request, lambda answer: decode(request, answer, count))
            except (NoAnswer, WrongAnswer):
                if retries == 0 or not self.is_open:
                    raise
                retries -= 1

    def _unless_busy(self, request: bytes, decode: Callable[[bytes], T]) -> T:
        """One request; again, within its bound, while the device is busy, because then nothing was done.

        Raises:
            NoAnswer: time-out.
            LinkLost: not connected, or the connection broke.
            Busy: still busy after the bounded retries.
            RequestRefused: another exception.
            OtherAnswer: not an answer to this request.
        """
        code = 0
        for attempt in range(BUSY_RETRIES + 1):
            answer = self._once(request)
            refusal = modbus.refusal(request, answer)
            if refusal is None:
                try:
                    return decode(answer)
                except RemoteProtocolError as error:
                    # What follows in the stream cannot be trusted either.
                    if self._wire is not None:
                        self._wire.drain()
                    raise OtherAnswer(self.device, self.url, f"function {request[0]}: {error}") from error
            code = refusal
            if code != modbus.BUSY or attempt == BUSY_RETRIES:
                break
            self.busy += 1
            time.sleep(BUSY_PAUSE_S)
        name = modbus.EXCEPTION_NAMES.get(code, "unknown")
        refused = Busy if code == modbus.BUSY else RequestRefused
        raise refused(self.device, self.url, f"function {request[0]}: exception {code} ({name})")

    def _once(self, request: bytes) -> bytes:
        """One request, one answer.

        Raises:
            NoAnswer: time-out, or an answer to no request; the connection is closed at the second in a row.
            LinkLost: not connected, or the connection broke.
            WrongAnswer: not an answer from this device.
        """
        if self._wire is None:
            raise LinkLost(self.device, self.url, "not connected")
        try:
            answer = self._wire.ask(request, self._timeout_s)
        except NoAnswer as error:
            self.timeouts += 1
            self._silent += 1
            if self._silent >= TIMEOUTS_UNTIL_CLOSED:
                self.close()
            raise NoAnswer(self.device, self.url, f"function {request[0]}: {error.message}") from error
        self._silent = 0
        return answer
