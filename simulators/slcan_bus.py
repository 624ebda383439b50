"""A CAN bus on a TCP socket in the slcan format: every client and the ECU see every frame, but their own.

Lines end in CR. `t` iii l dd..: standard frame, `T` iiiiiiii l dd..: extended, `r`/`R`: remote. `S` `s` `O` `L` `C` `Z`
set the adapter up and are answered with CR, `V` and `N` with version and serial number, anything else with BEL. A
client hears frames between its `O` (or `L`, listen only) and its `C`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable

from protocols.can_frame import EXTENDED
from simulators.peer_queue import PeerQueue

OK = b"\r"
ERROR = b"\a"
ADAPTER_ANSWERS = {b"S": OK, b"s": OK, b"Z": OK, b"Y": OK, b"V": b"V1013\r", b"N": b"NSIM1\r", b"F": b"F00\r"}
HIGHEST_BACKLOG = 64 * 1024
LONGEST_LINE = 160
MAXIMUM_DATA = 8
FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Bytes of a CAN FD frame by its length code."""
STANDARD, FRAMES = b"trdb", b"trdbTRDB"


class SlcanBus:
    """The bus.

    Attributes:
        port: TCP port on 127.0.0.1 after `open`.
        dropped_frames: frames not delivered because a client's socket was full.
        silent: a fault: nothing passes in either direction.
        queue: asks what clients have not read.
        listeners: called with number, data and whether it is a remote frame for each frame of a client.
        encode: turns a frame of the ECU into its line; a fault may put another one here.

    A frame's number has `EXTENDED` set where its identifier is an extended one.
    """

    def __init__(self, on_frame: Callable[[int, bytes], None]) -> None:
        self.port = 0
        self.dropped_frames = 0
        self.silent = False
        self.encode: Callable[[int, bytes], bytes] = frame_line
        self.listeners: list[Callable[[int, bytes, bool], None]] = []
        self._on_frame = on_frame
        self._clients: list[SlcanClient] = []
        self._server: asyncio.Server | None = None
        self.queue = PeerQueue()

    async def open(self) -> None:
        """Listen on a free port of the loopback interface."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: SlcanClient(self), "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]

    def close(self) -> None:
        """Stop listening and hang up on every client."""
        if self._server is not None:
            self._server.close()
        for client in list(self._clients):
            client.hang_up()
        self.queue.close()

    @property
    def clients(self) -> tuple[SlcanClient, ...]:
        """The connected client."""
        return tuple(self._clients)

    def send(self, frames: Iterable[tuple[int, bytes]]) -> None:
        """Frames from the ECU to every listening client."""
        lines = [self.encode(identifier, data) for identifier, data in frames]
        if lines:
            self.send_lines(lines)

    def send_lines(self, lines: list[bytes], sender: SlcanClient | None = None) -> None:
        """Ready-made lines to every listening client but the sender."""
        if self.silent:
            return
        for client in self._clients:
            if client is not sender and client.listening:
                client.deliver(lines)

    def received(self, line: bytes, sender: SlcanClient) -> None:
        """A client's frame: to the other clients, and to the ECU when it is a data frame."""
        if self.silent:
            return
        self.send_lines([line + OK], sender)
        kind, digits = line[:1], 3 if line[:1] in STANDARD else 8
        number = int(line[1 : 1 + digits], 16) | (0 if digits == 3 else EXTENDED)
        data, remote = bytes.fromhex(line[2 + digits :].decode("ascii")), kind in b"rR"
        if not remote:
            self._on_frame(number, data)
        for listener in self.listeners:
            listener(number, data, remote)

    def joined(self, client: SlcanClient) -> None:
        """A client connected."""
        self._clients.append(client)

    def left(self, client: SlcanClient) -> None:
        """A client hung up."""
        if client in self._clients:
            self._clients.remove(client)


def frame_line(identifier: int, data: bytes, *, remote: bool = False) -> bytes:
    """The slcan line of a frame, its CR included; a remote request has no data, more than 8 bytes are CAN FD."""
    kind = b"r" if remote else b"t" if len(data) <= MAXIMUM_DATA else b"d"
    kind = kind.upper() if identifier & EXTENDED else kind
    number = b"%08X" % (identifier ^ EXTENDED) if identifier & EXTENDED else b"%03X" % identifier
    carried = b"" if remote else data.hex().upper().encode("ascii")
    return b"%s%s%X%s\r" % (kind, number, FD_LENGTHS.index(len(data)), carried)


class SlcanClient(asyncio.Protocol):
    """One connection: splits lines, answers the adapter's commands, hands frames to the bus."""

    def __init__(self, bus: SlcanBus) -> None:
        self.listening = False
        self._transmits = False
        self._bus = bus
        self._rest = b""
        self._transport: asyncio.Transport | None = None

    @property
    def backlog(self) -> int:
        """Bytes that wait for the client's socket."""
        return self._transport.get_write_buffer_size() if self._transport is not None else 0

    @property
    def read_once(self) -> bool:
        """Whether the client hears the bus."""
        return self.listening

    def unread(self) -> int:
        """Bytes sent to the client that it has not read."""
        connection = None if self._transport is None else self._transport.get_extra_info("socket")
        return self.backlog + (0 if connection is None else self._bus.queue.unread(connection))

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Join the bus, not yet listening.

        Raises:
            TypeError: the transport is no stream.
        """
        if not isinstance(transport, asyncio.Transport):
            raise TypeError(f"slcan requires a stream transport, got {type(transport).__name__}")
        self._transport = transport
        self._bus.joined(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Leave the bus."""
        del exc
        self._bus.left(self)

    def data_received(self, data: bytes) -> None:
        """Split into lines; a chunk may begin and end anywhere."""
        *lines, rest = (self._rest + data).split(b"\r")
        self._rest = rest if len(rest) <= LONGEST_LINE else b""
        answers = [self._answer(line) for line in lines if line]
        if self._transport is not None and answers:
            self._transport.write(b"".join(answers))

    def deliver(self, lines: list[bytes]) -> None:
        """Send lines; when the client does not read, drop and count them."""
        if self._transport is None or self._transport.is_closing():
            return
        if self.backlog > HIGHEST_BACKLOG:
            self._bus.dropped_frames += len(lines)
            return
        self._transport.write(b"".join(lines))

    def hang_up(self) -> None:
        """Close the connection at once."""
        if self._transport is not None:
            self._transport.abort()

    def _answer(self, line: bytes) -> bytes:
        kind = line[:1]
        if kind in FRAMES:
            if not (self._transmits and well_formed(line)):
                return ERROR
            self._bus.received(line, self)
            return (b"z" if kind in STANDARD else b"Z") + OK
        if kind in b"OL":
            self.listening, self._transmits = True, kind == b"O"
            return OK
        if kind == b"C":
            self.listening = self._transmits = False
            return OK
        return ADAPTER_ANSWERS.get(kind, ERROR)


def well_formed(line: bytes) -> bool:
    """Whether a frame line has a readable identifier, a length that it can have and as many data bytes as it says."""
    digits = 3 if line[:1] in STANDARD else 8
    head, body = line[1 : 1 + digits], line[2 + digits :]
    try:
        identifier, length = int(head, 16), int(line[1 + digits : 2 + digits], 16)
        data = bytes.fromhex(body.decode("ascii"))
    except ValueError:
        return False
    expected = 0 if line[:1] in b"rR" else FD_LENGTHS[length]
    highest = 0x7FF if digits == 3 else 0x1FFFFFFF
    fits = length <= MAXIMUM_DATA or line[:1] in b"dDbB"
    return len(head) == digits and identifier <= highest and fits and len(data) == expected
