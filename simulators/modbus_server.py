"""The controller's registers on Modbus TCP or RTU (pymodbus server), with the wire faults of that link."""

from __future__ import annotations

import asyncio
import logging
import os
import tty
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from pymodbus import FramerType
from pymodbus.constants import ExcCodes
from pymodbus.framer import FramerRTU
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

SPACES = ("coil", "discrete", "holding", "input")
"""In the order that pymodbus has them."""
BITS = frozenset(SPACES[:2])
BITS_A_REGISTER = 16
FUNCTIONS = {1: "coil", 2: "discrete", 4: "input", 5: "coil", 15: "coil"}
"""Whose functions they are; all others are for holding registers."""
_RTU_FUNCTION, _TCP_FUNCTION = 1, 7
"""Where in an answer its function stands."""
_READ_SIZE = 4096
SLOW_S = 0.025
"""Less than a host waits for an answer, more than two of its polls."""
STALE_EVERY = 20
"""While the fault `late_answers` is on, its first answer and then one in so many comes late."""


class Bank(Protocol):
    """Registers and coils of one device, as Modbus reads and writes them."""

    def blocks(self) -> dict[str, list[tuple[int, int]]]:
        """First address and count of what is there, by space."""

    def bits(self, space: str) -> dict[int, int]:
        """All coils or discrete inputs by address."""

    def read(self, address: int, count: int, space: str = "holding") -> list[int] | None:
        """Words from `address`; None when one of them is not there."""

    def write(self, address: int, words: Sequence[int], space: str = "holding") -> bool | None:
        """Take a write; False when its values are refused, None when it cannot be written there."""


@dataclass
class LinkFaults:
    """What is broken on the Modbus link."""

    busy: bool = False
    reject_writes: bool = False
    reset: bool = False
    wrong_transaction: bool = False
    """Until the host connects again."""
    wrong_function: bool = False
    late_answers: bool = False
    silent_next: bool = False
    silent: bool = False
    """No request is answered."""
    slow: bool = False
    """Every answer comes `SLOW_S` late."""
    damaged: bool = False
    """Answers with a wrong checksum, cut short, or with bytes behind them, in turn."""


class ModbusServer:
    """Serves one register bank.

    Attributes:
        faults: switches of the fault injectors.
        port: TCP port on 127.0.0.1 after `open`.
        url: what a host's bench file says, after `open`.
        late_s: wall time by which a late answer comes later than it should.

    Args (construction):
        bank: its registers.
        device_id: its unit number.
        rtu: frames of a serial line; `pty`: behind a pseudo terminal.
        before_access: called before registers are read or written.
    """

    def __init__(
        self, bank: Bank, device_id: int, *, rtu: bool = False, pty: bool = False,
        before_access: Callable[[], None] = lambda: None,
    ) -> None:
        self.faults = LinkFaults()
        self.port = 0
        self.url = ""
        self.late_s = 0.1
        self._bank = bank
        self._device_id = device_id
        self._rtu = rtu
        self._pty = pty
        self._before_access = before_access
        self._answers = 0
        self._late = 0
        self._server: ModbusTcpServer | None = None
        self._line: SerialLine | None = None

    async def open(self) -> None:
        """Listen on a free port of the loopback interface, or on a pseudo terminal.

        Raises:
            OSError: neither can be had.
        """
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
        blocks = self._bank.blocks()
        coils, discrete, holding, inputs = (_data(space, blocks.get(space, [(0, 1)])) for space in SPACES)
        device = SimDevice(self._device_id, (coils, discrete, holding, inputs), action=self._access)
        self._server = ModbusTcpServer(
            device, address=("127.0.0.1", 0), framer=FramerType.RTU if self._rtu else FramerType.SOCKET,
            trace_packet=self._trace, trace_connect=self._connected,
        )
        await self._server.serve_forever(background=True)
        listener: Any = self._server.transport  # an asyncio.Server, which pymodbus declares as a transport
        self.port = listener.sockets[0].getsockname()[1]
        self.url = f"modbus-tcp://127.0.0.1:{self.port}"
        if self._rtu:
            self.url = f"modbus-rtu:socket://127.0.0.1:{self.port}"
        if self._rtu and self._pty:
            self._line = SerialLine()
            await self._line.open(self.port)
            self.url = f"modbus-rtu:{self._line.name}"

    async def close(self) -> None:
        """Stop listening and hang up on every client."""
        if self._line is not None:
            self._line.close()
        if self._server is not None:
            await self._server.shutdown()  # type: ignore[no-untyped-call]  # pymodbus leaves it unannotated

    def silence_connections(self) -> None:
        """Answer nothing on the connections there are, else on the next one, and keep them open.

        A host must connect again to be heard.
        """
        transports = self._transports()
        self.faults.silent_next = not transports
        for transport in transports:
            transport.pause_reading()

    async def _access(
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """One access by a client: fill `registers` for a read, execute a write."""
        space = FUNCTIONS.get(function, "holding")
        self._before_access()
        if self.faults.busy:
            return ExcCodes.DEVICE_BUSY
        if values is None:
            if space in BITS:
                return self._fill_bits(space, address, start, registers)
            words = self._bank.read(address, count, space)
            if words is None:
                return ExcCodes.ILLEGAL_ADDRESS
            registers[address - start : address - start + count] = words
            return None
        if self.faults.reject_writes:
            return ExcCodes.DEVICE_FAILURE
        accepted = self._bank.write(address, [int(value) for value in values], space)
        if accepted is None:
            return ExcCodes.ILLEGAL_ADDRESS
        return None if accepted else ExcCodes.ILLEGAL_VALUE

    def _fill_bits(self, space: str, address: int, start: int, registers: list[int]) -> ExcCodes | None:
        """Lay down all bits of a space; the server holds the bits 16 n to 16 n + 15 in register n, from `start` on."""
        shown = self._bank.bits(space)
        if address not in shown:
            return ExcCodes.ILLEGAL_ADDRESS
        for place, value in shown.items():
            cell, bit = place // BITS_A_REGISTER - start, place % BITS_A_REGISTER
            registers[cell] = registers[cell] & ~(1 << bit) | value << bit
        return None

    def _connected(self, connected: bool) -> None:
        if not connected:
            return
        self.faults.wrong_transaction = False
        if self.faults.silent_next:
            asyncio.get_running_loop().call_soon(self.silence_connections)

    def _trace(self, sending: bool, packet: bytes) -> bytes:
        """Damage an answer on its way out when a fault asks for it."""
        if not sending:
            return packet
        faults = self.faults
        self._answers += 1
        if faults.silent:
            return b""
        if faults.reset:
            self._reset_connections()
            return packet[: len(packet) // 2]
        self._late += faults.late_answers
        if faults.late_answers and self._late % STALE_EVERY == 1:
            asyncio.get_running_loop().call_later(self.late_s, self._send_late, packet)
            return b""
        if faults.slow:
            asyncio.get_running_loop().call_later(SLOW_S, self._send_late, packet)
            return b""
        if faults.damaged:
            return _damage(packet, self._answers)
        changed = bytearray(packet)
        if faults.wrong_transaction:
            changed[1] ^= 0x55
        if faults.wrong_function:
            changed[_RTU_FUNCTION if self._rtu else _TCP_FUNCTION] ^= 0x04
            if self._rtu:
                changed[-2:] = FramerRTU.compute_CRC(bytes(changed[:-2])).to_bytes(2, "big")
        return bytes(changed)

    def _send_late(self, packet: bytes) -> None:
        for transport in self._transports():
            transport.write(packet)

    def _reset_connections(self) -> None:
        """RST every client in the middle of an answer, once."""
        self.faults.reset = False
        for transport in self._transports():
            transport.abort()

    def _transports(self) -> list[asyncio.Transport]:
        connections = [] if self._server is None else list(self._server.active_connections.values())
        transports = [connection.transport for connection in connections]
        return [transport for transport in transports if isinstance(transport, asyncio.Transport)]


def _data(space: str, blocks: list[tuple[int, int]]) -> list[SimData]:
    """What of a space is there."""
    if space in BITS:
        first = min(first for first, _ in blocks) // BITS_A_REGISTER
        last = max(first + count - 1 for first, count in blocks) // BITS_A_REGISTER
        values = [False] * (BITS_A_REGISTER * (last - first + 1))
        return [SimData(BITS_A_REGISTER * first, values=values, datatype=DataType.BITS)]
    return [SimData(first, values=[0] * count, datatype=DataType.REGISTERS) for first, count in blocks]


def _damage(packet: bytes, count: int) -> bytes:
    if count % 3 == 0:
        return packet[:-1] + bytes([packet[-1] ^ 0x10])
    return packet[:-3] if count % 3 == 1 else packet + b"\x00\x5a"


class SerialLine:
    """A pseudo terminal in raw mode whose bytes are those of a connection to the server.

    Attributes:
        name: what the host opens.
    """

    def __init__(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.name = os.ttyname(self._slave)
        self._writer: asyncio.StreamWriter | None = None
        self._task: asyncio.Task[None] | None = None

    async def open(self, port: int) -> None:
        """Connect the line to the server on this port of the loopback interface.

        Raises:
            OSError: it does not answer.
        """
        reader, self._writer = await asyncio.open_connection("127.0.0.1", port)
        loop = asyncio.get_running_loop()
        loop.add_reader(self._master, self._to_server)
        self._task = loop.create_task(self._to_host(reader))

    def close(self) -> None:
        """Hang up: the host's next read ends."""
        if self._task is not None:
            self._task.cancel()
        if self._writer is not None:
            asyncio.get_running_loop().remove_reader(self._master)
            self._writer.close()
        os.close(self._master)
        os.close(self._slave)

    def _to_server(self) -> None:
        try:
            data = os.read(self._master, _READ_SIZE)
        except BlockingIOError:
            return
        if self._writer is not None:
            self._writer.write(data)

    async def _to_host(self, reader: asyncio.StreamReader) -> None:
        while data := await reader.read(_READ_SIZE):
            try:
                os.write(self._master, data)
            except BlockingIOError:
                # No reader: what does not fit is lost, as on a line.
                continue
