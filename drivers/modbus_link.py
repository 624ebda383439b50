"""One Modbus connection: requests, time-outs, bounded retries, matching of answers.

    modbus-tcp://host:port      Modbus TCP

A time-out leaves the outcome unknown. Reads, and exchanges whose write is harmless to repeat, are tried again within
their bound; anything else is left to the caller. The connection is closed at the second time-out in a row, because a
silent peer keeps a TCP connection "connected" for ever; the owner opens it again. Late answers carry the transaction
number of their own request and are skipped.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import struct
import time
from collections.abc import Callable, Sequence
from urllib.parse import urlsplit

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException, ModbusIOException
from pymodbus.pdu import ModbusPDU

from drivers.errors import LinkLost, NoAnswer, PortClosed, RequestRefused, WrongAnswer

OPEN_TIMEOUT_S = 2.0
TIMEOUTS_UNTIL_CLOSED = 2
READ_RETRIES = 1
BUSY_RETRIES = 3
BUSY_PAUSE_S = 0.005

EXCEPTION_NAMES = {
    1: "illegal function", 2: "illegal address", 3: "illegal value", 4: "device failure",
    5: "acknowledge", 6: "busy", 10: "gateway path unavailable", 11: "gateway target silent",
}
_BUSY = 6
_READ, _WRITE, _EXCHANGE = 3, 16, 23

# Every failure leaves here as an exception with its reason; the library's own log lines would say it twice.
logging.getLogger("pymodbus.logging").addHandler(logging.NullHandler())
logging.getLogger("pymodbus.logging").propagate = False


class ModbusLink:
    """A connection to one Modbus device, used by one thread.

    Args:
        url: modbus-tcp://host:port.
        device_id: Modbus unit number, 0..255.
        timeout_s: longest wait for one answer, s.
        device: name of the device for messages.

    Attributes:
        timeouts: answers that did not come in time, since construction.
    """

    def __init__(self, url: str, device_id: int = 1, timeout_s: float = 0.04, *, device: str = "actuator") -> None:
        self.url = url
        self.device = device
        self.timeouts = 0
        self._device_id = device_id
        self._timeout_s = timeout_s
        self._silent = 0
        self._client: ModbusTcpClient | None = None

    @property
    def is_open(self) -> bool:
        """Whether the connection stands, as far as is known."""
        return self._client is not None

    def open(self, timeout_s: float = OPEN_TIMEOUT_S) -> None:
        """Connect; does nothing when connected.

        Args:
            timeout_s: longest wait for the connection, s.

        Raises:
            PortClosed: the URL is no Modbus URL, or nobody answers there.
        """
        if self._client is not None:
            return
        host, port = self._address()
        client = ModbusTcpClient(host, port=port, timeout=timeout_s, retries=0)
        if not client.connect() or client.socket is None:  # type: ignore[no-untyped-call]  # not annotated there
            raise PortClosed(self.device, self.url, f"refused, or cannot connect within {timeout_s:g} s")
        client.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.comm_params.timeout_connect = self._timeout_s
        self._client = client
        self._silent = 0

    def close(self) -> None:
        """Disconnect; closing twice is harmless."""
        client, self._client = self._client, None
        if client is not None:
            with contextlib.suppress(OSError):
                client.close()  # type: ignore[no-untyped-call]  # not annotated there

    def drain(self) -> int:
        """Throw away answers that nobody waits for any more; number of bytes."""
        client, thrown = self._client, 0
        if client is None or client.socket is None:
            return 0
        client.socket.setblocking(False)
        with contextlib.suppress(OSError):
            while data := client.socket.recv(4096):
                thrown += len(data)
        return thrown

    def read(self, address: int, count: int) -> list[int]:
        """Read holding registers (FC3), again after a time-out or a busy answer.

        Args:
            address: first register.
            count: 1..125.

        Returns:
            `count` words.

        Raises:
            NoAnswer: no answer, also not to the retry.
            LinkLost: the connection broke or is not open.
            RequestRefused: the device answered with an exception.
            WrongAnswer: the answer is not one to this request.
        """
        answer = self._repeat(
            _READ, lambda c: c.read_holding_registers(address, count=count, device_id=self._device_id), READ_RETRIES
        )
        return self._registers(answer, count)

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write holding registers (FC16), once.

        Args:
            address: first register.
            words: 1..123 values.

        Raises:
            NoAnswer: no answer; the device may have acted.
            LinkLost: the connection broke or is not open; the device may have acted.
            RequestRefused: the device answered with an exception; it has not acted.
            WrongAnswer: the answer is not one to this request; the device may have acted.
        """
        answer = self._repeat(
            _WRITE, lambda c: c.write_registers(address, list(words), device_id=self._device_id), retries=0
        )
        echoed = (getattr(answer, "address", None), getattr(answer, "count", None))
        if echoed != (address, len(words)):
            raise self._wrong(f"wrote {len(words)} registers at {address}, the answer names {echoed[1]} at {echoed[0]}")

    def exchange(self, read_address: int, read_count: int, write_address: int, words: Sequence[int]) -> list[int]:
        """Write, then read, in one trip (FC23); the write must be harmless to repeat.

        Args:
            read_address: first register to read.
            read_count: 1..125.
            write_address: first register to write.
            words: 1..121 values.

        Returns:
            `read_count` words.

        Raises:
            NoAnswer: no answer, also not to the retry.
            LinkLost: the connection broke or is not open.
            RequestRefused: the device answered with an exception.
            WrongAnswer: the answer is not one to this request.
        """
        answer = self._repeat(
            _EXCHANGE,
            lambda c: c.readwrite_registers(
                read_address=read_address, read_count=read_count, write_address=write_address,
                values=list(words), device_id=self._device_id,
            ),
            READ_RETRIES,
        )
        return self._registers(answer, read_count)

    def _address(self) -> tuple[str, int]:
        """Host and port of the URL.

        Raises:
            PortClosed: not a URL of this link.
        """
        try:
            parts = urlsplit(self.url)
            host, port = parts.hostname, parts.port
        except ValueError:
            host = port = None
        if host is None or port is None or parts.scheme != "modbus-tcp":
            raise PortClosed(self.device, self.url, "expected modbus-tcp://host:port")
        return host, port

    def _repeat(self, function: int, request: Callable[[ModbusTcpClient], ModbusPDU], retries: int) -> ModbusPDU:
        """The one place for retries: after time-outs where allowed, after "busy" always (nothing was done).

        Raises:
            NoAnswer: the retries are used up.
            RequestRefused: still busy, or another exception.
        """
        busy = 0
        while True:
            try:
                answer = self._once(function, request)
            except NoAnswer:
                if retries == 0 or self._client is None:
                    raise
                retries -= 1
                continue
            code = getattr(answer, "exception_code", 0)
            if not answer.isError():
                return answer
            if code != _BUSY or busy == BUSY_RETRIES:
                name = EXCEPTION_NAMES.get(code, "unknown")
                raise RequestRefused(self.device, self.url, f"function {function}: exception {code} ({name})")
            busy += 1
            time.sleep(BUSY_PAUSE_S)

    def _once(self, function: int, request: Callable[[ModbusTcpClient], ModbusPDU]) -> ModbusPDU:
        """One request, one answer.

        Raises:
            NoAnswer: time-out.
            LinkLost: not connected, or the connection broke.
            WrongAnswer: not an answer to this function.
        """
        client = self._client
        if client is None or not client.connected:
            self.close()
            raise LinkLost(self.device, self.url, "not connected")
        try:
            answer = request(client)
        except ConnectionException as error:
            self.close()
            raise LinkLost(self.device, self.url, f"connection broke: {error}") from error
        except ModbusIOException as error:
            raise self._no_answer(function) from error
        except OSError as error:
            self.close()
            raise LinkLost(self.device, self.url, f"connection broke: {error}") from error
        except (ModbusException, struct.error, IndexError, KeyError, ValueError) as error:
            raise self._wrong(f"function {function}: the answer cannot be decoded: {error}") from error
        self._silent = 0
        if answer.function_code & 0x7F != function:
            raise self._wrong(f"asked function {function}, the answer is one to function {answer.function_code & 0x7F}")
        return answer

    def _no_answer(self, function: int) -> NoAnswer:
        """Count a time-out; close the connection at the second in a row."""
        self.timeouts += 1
        self._silent += 1
        if self._silent >= TIMEOUTS_UNTIL_CLOSED:
            self.close()
        return NoAnswer(
            self.device, self.url, f"function {function}: no answer within {self._timeout_s * 1e3:g} ms"
        )

    def _registers(self, answer: ModbusPDU, count: int) -> list[int]:
        """Words of a read answer.

        Raises:
            WrongAnswer: another number of words than asked for.
        """
        words = answer.registers
        if len(words) != count:
            raise self._wrong(f"asked for {count} registers, got {len(words)}")
        return list(words)

    def _wrong(self, message: str) -> WrongAnswer:
        """An answer that breaks the protocol: what follows it in the stream cannot be trusted either."""
        self.drain()
        return WrongAnswer(self.device, self.url, message)
