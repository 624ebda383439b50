"""The numbers of commands, beside those of another master that may use the same ones."""

from __future__ import annotations

from drivers.roles import ActuatorStatus, Command, Result

MODULUS = 1 << 16
CLEAR_OF_OTHERS = MODULUS // 2
"""How far from another master's numbers ours go on; it counts up, too."""


class CommandNumbers:
    """Counts 1..65535, on from the last number that the device has seen."""

    def __init__(self) -> None:
        self._sequence: int | None = None
        self._command = Command.NONE
        self._seen = (0, 0)
        self._shown: tuple[int, int] | None = None
        self._written = True

    def used(self, sequence: int, command: Command, carrier: Command | None) -> None:
        """A command gets this number.

        Args:
            sequence: its number.
            command: what is asked for.
            carrier: the command that is written for it, whose code the device shows; None: nothing is written.
        """
        self._sequence, self._command, self._written = sequence, command, carrier is not None
        self._shown = self._seen if carrier is None else (sequence, int(carrier))

    def as_requested(self, status: ActuatorStatus) -> ActuatorStatus:
        """The status with the command that was asked for, where the device shows the one that carried it out."""
        seen = status.acked_sequence, status.acked_command
        if self._sequence is None or seen != self._shown:
            self._seen = seen
            return status
        result = status.result if self._written else int(Result.DONE)
        self._seen = (self._sequence, int(self._command)) if self._written else seen
        return status._replace(acked_sequence=self._sequence, acked_command=int(self._command), result=result)

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
