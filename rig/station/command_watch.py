"""Is anybody else at the controller? Whatever it did must have been asked for here. Pure, no clock, no I/O.

Another client's command shows by its number and kind. The controller's own panel, or a client that the status does not
name, shows by what the controller does: it fades out, halts or drops the pressure with no fault of its own, or ends a
program before its cycles are done.
"""

from __future__ import annotations

from collections.abc import Sequence

from protocols.actuator import ActuatorStatus, Command, Input, Result, State
from rig.station.interlocks import Finding

SLUG = "second-master"
UNASKED = 2
"""Statuses in a row: a controller may show what it does one status before it says why."""
MOTIONS = frozenset({Command.START, Command.MOVE_TO})
STOPS = frozenset({Command.FADE_STOP, Command.HALT, Command.HYDRAULICS_OFF})
PRESSURES = frozenset({Command.HYDRAULICS_LOW, Command.HYDRAULICS_ON, Command.HYDRAULICS_OFF})
STOPPING_STATES = frozenset({State.FADING, State.HALTING})
PRESSURELESS_STATES = frozenset({State.OFF, State.LOW})
CYCLE_SLACK = 1e-6

Sent = Sequence[tuple[int, int]]
"""(sequence, command) of what was written to the controller, oldest first."""


class CommandWatch:
    """Follows the controller's status while the lease is ours."""

    def __init__(self) -> None:
        self._cycles = 0.0
        self._running = 0
        self._pressurised = False
        self._unasked = 0
        self._knocked = (0, 0)

    def expect_program(self, cycles: float) -> None:
        """The program that is about to start has so many cycles, ramps included."""
        self._cycles = cycles

    def restart(self) -> None:
        """Forget the past: after a reconnection nothing is compared with what was seen before."""
        self._running = 0
        self._pressurised = False
        self._unasked = 0

    def judge(self, status: ActuatorStatus, sent: Sent) -> list[Finding]:
        """Take one status that shows our lease."""
        findings = self._command(status, sent)
        if findings or status.fault_bits or status.state == State.TRIPPED:
            self._running, self._unasked = 0, 0
            return findings
        if not status.inputs & Input.E_STOP_CLOSED:
            return []
        return [*self._program(status, sent), *self._doing(status, sent)]

    def _command(self, status: ActuatorStatus, sent: Sent) -> list[Finding]:
        acknowledged = (status.acked_sequence, status.acked_command)
        if acknowledged in sent:
            return []
        detail = f"the controller's last command is {_name(acknowledged[1])} as {acknowledged[0]}: not from this host"
        if status.acked_command == Command.ACQUIRE and status.result == Result.REFUSED_OWNER:
            # Another host asks whether the rig is free, and has been told that it is not: said once.
            if acknowledged == self._knocked:
                return []
            self._knocked = acknowledged
            return [Finding(SLUG, f"{detail}; it was refused", status.received_ns, warns=True)]
        return [Finding(SLUG, detail, status.received_ns, status.acked_sequence)]

    def _program(self, status: ActuatorStatus, sent: Sent) -> list[Finding]:
        """The program that runs is ours, and it ends with the cycles that were ordered."""
        before, self._running = self._running, status.program_id if status.state == State.RUNNING else 0
        started = _last(sent, {Command.START})
        if self._running and (self._running, int(Command.START)) != started:
            detail = f"the controller runs program {status.program_id}, which was not started here"
            return [Finding(SLUG, detail, status.received_ns, status.program_id)]
        ended = before and before == status.program_id and status.state == State.HOLD
        whole = int(self._cycles + CYCLE_SLACK)
        if ended and not _stopped(sent) and status.cycles_done < whole:
            detail = f"the program ended after {status.cycles_done} of {whole} cycles, and nobody here stopped it"
            return [Finding(SLUG, detail, status.received_ns, status.cycles_done, whole)]
        return []

    def _doing(self, status: ActuatorStatus, sent: Sent) -> list[Finding]:
        """A motion that is being stopped, or a pressure that goes, was ordered here or follows a fault."""
        asked_on = (_last(sent, PRESSURES) or (0, 0))[1] == Command.HYDRAULICS_ON
        pressureless = status.state in PRESSURELESS_STATES
        self._pressurised = asked_on and (self._pressurised or not pressureless)
        stopping = status.state in STOPPING_STATES and not _stopped(sent)
        moving = status.state == State.MOVING and (_last(sent, MOTIONS) or (0, 0))[1] != Command.MOVE_TO
        self._unasked = self._unasked + 1 if stopping or moving or (pressureless and self._pressurised) else 0
        if self._unasked < UNASKED:
            return []
        detail = f"the controller is {State(status.state).name}, without a fault, and nobody here asked for it"
        return [Finding(SLUG, detail, status.received_ns, status.state)]


def _last(sent: Sent, commands: frozenset[Command] | set[Command]) -> tuple[int, int] | None:
    """The newest of these commands that was sent; None when none of them was."""
    return next((each for each in reversed(sent) if each[1] in commands), None)


def _stopped(sent: Sent) -> bool:
    """A stop was sent since the last motion was asked for, or no motion was."""
    newest = _last(sent, MOTIONS | STOPS)
    return newest is None or newest[1] in STOPS


def _name(command: int) -> str:
    return Command(command).name if command in set(Command) else str(command)
