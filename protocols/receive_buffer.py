"""Bytes that have arrived and are not decoded yet."""

from __future__ import annotations


class ReceiveBuffer:
    """Collects chunks and gives back whole lines; a chunk may end anywhere.

    The place up to which a terminator was looked for is remembered, so a line that arrives byte by byte is searched
    once, not once a byte.
    """

    def __init__(self) -> None:
        self._data = bytearray()
        self._searched = 0

    def __len__(self) -> int:
        return len(self._data)

    def append(self, chunk: bytes) -> None:
        """Add bytes as they arrived."""
        self._data += chunk

    def take_line(self, terminator: bytes) -> bytes | None:
        """The next line without its terminator, or None when no terminator is there yet."""
        end = self._data.find(terminator, max(0, self._searched - len(terminator) + 1))
        if end < 0:
            self._searched = len(self._data)
            return None
        line = bytes(self._data[:end])
        del self._data[: end + len(terminator)]
        self._searched = 0
        return line

    def tail(self, count: int) -> bytes:
        """The last `count` bytes (fewer if fewer are there), left in place."""
        return bytes(self._data[max(0, len(self._data) - count) :])

    def clear(self) -> None:
        """Forget everything."""
        self._data.clear()
        self._searched = 0
