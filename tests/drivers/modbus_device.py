"""A Modbus TCP device for driver tests: registers, a log of requests, and faults on the wire. Bytes by hand."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from collections.abc import Callable

import demo_registers as actuator

from drivers.connection import ActuatorConnection
from drivers.modbus_actuator import ModbusActuator
from drivers.register_maps.map_file import controller

Answer = Callable[[bytes, bytes], list[bytes]]
"""(header and request PDU, right answer PDU) -> frames to send instead; an empty list is silence."""


def demo_actuator(url: str, *, timeout_s: float = 0.04, owner_id: int = 0) -> ModbusActuator:
    """The driver of the demo controller at `url`."""
    return ModbusActuator(ActuatorConnection(url, timeout_s=timeout_s, owner_id=owner_id), controller("demo"))


class ModbusDevice:
    """Serves one connection after the other.

    Attributes:
        registers: the 65536 holding registers.
        requests: (function, address, words written) of every request, in order.
        faults: answers to the next requests; `None` entries are answered as they should be.
        executed: commands executed: a new sequence executes once.
    """

    def __init__(self) -> None:
        self.registers = [0] * 65536
        self.requests: list[tuple[int, int, list[int]]] = []
        self.faults: list[Answer | None] = []
        self.executed: list[int] = []
        self.ignore_writes = False
        self.result = 1
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"modbus-tcp://127.0.0.1:{self._server.getsockname()[1]}"
        self._connection: socket.socket | None = None
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self.put(actuator.IDENTITY.address, actuator.IDENTITY.encode({
            "signature_u32": 0x01020304, "signature_f32": 1234.5, "layout_version": 1, "serial_number": "T-1",
        }))
        self._thread.start()

    def put(self, address: int, words: list[int]) -> None:
        """Set registers."""
        self.registers[address : address + len(words)] = words

    def command(self, command: int, sequence: int) -> None:
        """Execute a command, ours or another master's, unless its number is the one before."""
        if sequence != self.registers[118]:
            self.executed.append(command)
            self.put(118, [sequence, self.result, command])

    def hang_up(self) -> None:
        """Reset the connection."""
        if self._connection is not None:
            self._connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            self._connection.close()

    def close(self) -> None:
        """Stop serving; stopping twice is harmless."""
        if self._server.fileno() < 0:
            return
        self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        if self._connection is not None and self._connection.fileno() >= 0:
            with contextlib.suppress(OSError):
                self._connection.shutdown(socket.SHUT_RDWR)
        self._thread.join(5)

    def _serve(self) -> None:
        while True:
            try:
                self._connection, _ = self._server.accept()
            except OSError:
                return
            with self._connection:
                self._serve_connection(self._connection)

    def _serve_connection(self, connection: socket.socket) -> None:
        data = b""
        while True:
            try:
                chunk = connection.recv(4096)
            except OSError:
                return
            if not chunk:
                return
            data += chunk
            while len(data) >= 6 and len(data) >= 6 + int.from_bytes(data[4:6], "big"):
                size = 6 + int.from_bytes(data[4:6], "big")
                frame, data = data[:size], data[size:]
                fault = self.faults.pop(0) if self.faults else None
                try:
                    for piece in self._answers(frame, fault):
                        connection.sendall(piece)
                except OSError:
                    return

    def _answers(self, frame: bytes, fault: Answer | None) -> list[bytes]:
        right = self._execute(frame[7:]) if fault is None or not getattr(fault, "unheard", False) else b""
        return [framed(frame, right)] if fault is None else fault(frame, right)

    def _execute(self, pdu: bytes) -> bytes:
        function, address, count = struct.unpack_from(">BHH", pdu)
        if function == 3:
            self.requests.append((3, address, []))
            return self._words(3, address, count)
        if function == 16:
            self._write(16, address, pdu[6:])
            return pdu[:5]
        write_address, _ = struct.unpack_from(">HH", pdu, 5)
        self._write(23, write_address, pdu[10:])
        return self._words(23, address, count)

    def _words(self, function: int, address: int, count: int) -> bytes:
        words = self.registers[address : address + count]
        return struct.pack(f">BB{count}H", function, 2 * count, *words)

    def _write(self, function: int, address: int, raw: bytes) -> None:
        words = list(struct.unpack(f">{len(raw) // 2}H", raw))
        self.requests.append((function, address, words))
        if self.ignore_writes:
            return
        self.put(address, words)
        if address == 300:
            self.command(words[0], words[1])
        if address == 350:
            self.put(122, words)


def framed(request: bytes, pdu: bytes) -> bytes:
    """An answer frame with the request's transaction number and unit."""
    return request[:4] + struct.pack(">HB", len(pdu) + 1, request[6]) + pdu
