"""The controller's registers on Modbus TCP (pymodbus server), with the wire faults of that link."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import dataclass
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from protocols import actuator as wire
from simulators.registers import RegisterBank

_REQUEST_HEADER = 8


@dataclass
class LinkFaults:
    """What is broken on the Modbus link."""

    busy: bool = False
    reject_writes: bool = False
    black_hole: bool = False
    reset: bool = False
    wrong_transaction: bool = False
    wrong_function: bool = False


class ModbusServer:
    """Serves one register bank.

    Attributes:
        faults: switches of the fault injectors.
        port: TCP port on 127.0.0.1 after `open`.
        requests: how many requests have been answered or swallowed.
    """

    def __init__(self, bank: RegisterBank, device_id: int) -> None:
        self.faults = LinkFaults()
        self.port = 0
        self.requests = 0
        self._bank = bank
        self._device_id = device_id
        self._server: ModbusTcpServer | None = None

    async def open(self) -> None:
        """Listen on a free port of the loopback interface."""
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
        data = [
            SimData(block.address, values=[0] * block.count, datatype=DataType.REGISTERS)
            for block in wire.MAP.blocks.values()
        ]
        device = SimDevice(self._device_id, data, action=self._access)
        self._server = ModbusTcpServer(device, address=("127.0.0.1", 0), trace_packet=self._trace)
        await self._server.serve_forever(background=True)
        listener: Any = self._server.transport  # an asyncio.Server, which pymodbus declares as a transport
        self.port = listener.sockets[0].getsockname()[1]

    async def close(self) -> None:
        """Stop listening and hang up on every client."""
        if self._server is not None:
            await self._server.shutdown()  # type: ignore[no-untyped-call]  # pymodbus leaves it unannotated

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
        del function
        if self.faults.busy:
            return ExcCodes.DEVICE_BUSY
        if values is None:
            words = self._bank.read(address, count)
            if words is None:
                return ExcCodes.ILLEGAL_ADDRESS
            registers[address - start : address - start + count] = words
            return None
        if self.faults.reject_writes:
            return ExcCodes.DEVICE_FAILURE
        accepted = self._bank.write(address, [int(value) for value in values])
        if accepted is None:
            return ExcCodes.ILLEGAL_ADDRESS
        return None if accepted else ExcCodes.ILLEGAL_VALUE

    def _trace(self, sending: bool, packet: bytes) -> bytes:
        """Damage an answer on its way out when a fault asks for it."""
        if not sending:
            self.requests += 1
            if self.faults.black_hole:
                return b""
            return packet
        if self.faults.reset:
            self._reset_connections()
            return packet[: len(packet) // 2]
        changed = bytearray(packet)
        if self.faults.wrong_transaction:
            changed[1] ^= 0x55
        if self.faults.wrong_function and len(changed) >= _REQUEST_HEADER:
            changed[7] ^= 0x04
        return bytes(changed)

    def _reset_connections(self) -> None:
        """RST every client in the middle of an answer, once."""
        self.faults.reset = False
        if self._server is not None:
            for connection in list(self._server.active_connections.values()):
                if isinstance(connection.transport, asyncio.Transport):
                    connection.transport.abort()
