"""The numbers of commands, beside those of another master that may use the same ones."""

from __future__ import annotations

from drivers.roles import Command

MODULUS = 1 << 16
CLEAR_OF_OTHERS = MODULUS // 2
"""How far from another master's numbers ours go on; it counts up, too."""


class CommandNumbers:
    """Counts 1..65535, on from the last number that the device has seen."""

    def __init__(self) -> None:
        self._sequence: int | None = None
        self._command = Command.NONE
        self._seen = (0, 0)

    def used(self, sequence: int, command: Command) -> None:
        """A command is written with this number."""
        self._sequence, self._command = sequence, command

    def seen(self, sequence: int, command: int) -> None:
        """The device shows the number and the command that it has seen last."""
        self._seen = (sequence, command)

    @property
    def swallowed(self) -> bool:
        """The device has seen our last number with another command: it ignored, or will ignore, ours."""
        return self._seen[0] == self._sequence and self._seen[1] != self._command

    def following(self) -> int:
        """The number after our last one; far from it where another master uses the same ones."""
        if self._sequence is None:
            return _following(self._seen[0])
        following = _following(self._sequence)
        if self.swallowed or self._seen[0] == following:
            return _following(self._sequence + CLEAR_OF_OTHERS)
        return following


def _following(sequence: int) -> int:
    return sequence % (MODULUS - 1) + 1
