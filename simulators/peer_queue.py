"""What the other end of a local TCP connection has received and not yet read, as this machine's kernel counts it.

A sender sees its data acknowledged long before the reader has called `recv`. On Linux the queue of any local socket can
be asked for (`NETLINK_SOCK_DIAG`, one lookup by address, some microseconds); elsewhere it is taken as empty.
"""

from __future__ import annotations

import socket
import struct

_SOCK_DIAG, _BY_FAMILY, _REQUEST = 4, 20, 1
_HEADER = struct.Struct("=IHHII")
_QUERY = struct.Struct("=BBBBI")
_ENDS = struct.Struct("!HH4s12x4s12x")
_ANY_INTERFACE_AND_COOKIE = struct.pack("=III", 0, 0xFFFF_FFFF, 0xFFFF_FFFF)
_RECEIVE_QUEUE_AT = _HEADER.size + 4 + 48 + 4
_QUEUE = struct.Struct("=I")
_ANSWER_SIZE = 4096


class PeerQueue:
    """Asks for receive queues; one is enough for any number of connections."""

    def __init__(self) -> None:
        self._kernel: socket.socket | None = None
        if hasattr(socket, "AF_NETLINK"):
            try:
                self._kernel = socket.socket(socket.AF_NETLINK, socket.SOCK_RAW | socket.SOCK_NONBLOCK, _SOCK_DIAG)
            except OSError:
                self._kernel = None

    def unread(self, connection: socket.socket) -> int:
        """Bytes in the peer's receive queue; 0 where that cannot be known."""
        if self._kernel is None or connection.family != socket.AF_INET:
            return 0
        try:
            (near, near_port), (far, far_port) = connection.getsockname(), connection.getpeername()
            ends = _ENDS.pack(far_port, near_port, socket.inet_aton(far), socket.inet_aton(near))
            body = _QUERY.pack(socket.AF_INET, socket.IPPROTO_TCP, 0, 0, 0xFFFF_FFFF) + ends + _ANY_INTERFACE_AND_COOKIE
            self._kernel.send(_HEADER.pack(_HEADER.size + len(body), _BY_FAMILY, _REQUEST, 1, 0) + body)
            answer = self._kernel.recv(_ANSWER_SIZE)
        except OSError:
            return 0
        kind = _HEADER.unpack_from(answer)[1]
        if kind != _BY_FAMILY or len(answer) < _RECEIVE_QUEUE_AT + _QUEUE.size:
            return 0
        unread: int = _QUEUE.unpack_from(answer, _RECEIVE_QUEUE_AT)[0]
        return unread

    def close(self) -> None:
        """Give the kernel's socket back."""
        if self._kernel is not None:
            self._kernel.close()
            self._kernel = None
