"""Commands to the controller that count only when its status acknowledges them."""

from __future__ import annotations

from collections.abc import Callable

from drivers.roles import Actuator, ActuatorStatus, Command, Move, Program, Result
from drivers.setpoint_generator import ComputedMotion
from drivers.streamed_actuator import StreamedActuator
from rig.clock import monotonic_ns
from rig.station.errors import StationRefused
from rig.station.supervisor import Supervisor
from rig.station.threads.actuator_thread import ActuatorThread

ACK_TIMEOUT_S = 1.0
MOTION_COMMANDS = frozenset({Command.HYDRAULICS_LOW, Command.HYDRAULICS_ON, Command.MOVE_TO, Command.START})


class CommandChannel:
    """Sends commands through the actuator's thread and waits for their acknowledgement.

    Attributes:
        sent_ns: when the last command had been sent (host monotonic).
    """

    def __init__(self, actuator: ActuatorThread, supervisor: Supervisor) -> None:
        self._actuator = actuator
        self._supervisor = supervisor
        self.sent_ns = 0

    def fresh(self) -> ActuatorStatus:
        """The controller's last status; a stale one is waited for, since nothing moves before it.

        Raises:
            StationRefused: none came.
        """
        actuator = self._actuator
        status = actuator.wait_status(lambda _: actuator.fresh_status(monotonic_ns()) is not None, ACK_TIMEOUT_S)
        if status is None:
            raise StationRefused("modbus-halfopen", f"no fresh status from the controller within {ACK_TIMEOUT_S:g} s")
        return status

    def command(self, command: Command, order: Move | Program | None = None) -> ActuatorStatus:
        """Send a command and wait until the controller's status acknowledges it.

        Args:
            command: what to do.
            order: where to, or what to run.

        Returns:
            The status that shows the command done; of an actuator that acknowledges nothing, the next status.

        Raises:
            StationRefused: the controller refused it, or did not acknowledge it in time.
            DriverError: it could not be sent.
        """
        return self._carried(command, lambda driver: driver.send(command, order))

    def compute(self, motion: ComputedMotion) -> ActuatorStatus:
        """Begin a motion that is computed as it goes, and wait as `command` does.

        Raises:
            StationRefused: as `command`; or the actuator does not follow set-points.
            DriverError: it could not be sent.
        """

        def begin(driver: Actuator) -> int:
            if not isinstance(driver, StreamedActuator):
                raise StationRefused("matrix-infeasible", "start: this actuator does not support streamed set-points")
            return driver.compute(motion)

        return self._carried(Command.START, begin)

    def _carried(self, command: Command, begin: Callable[[Actuator], int]) -> ActuatorStatus:
        def send(driver: Actuator) -> int:
            # Judged on the thread that also carries out stops: no motion command can follow a stop.
            if command in MOTION_COMMANDS and not self._supervisor.may_move:
                trip = self._supervisor.trip
                raise StationRefused("tripped", f"{command.name}: {'not armed' if trip is None else trip.slug}")
            sequence = begin(driver)
            self.sent_ns = monotonic_ns()  # not by the thread that waits for it: it may have its turn much later
            return sequence

        sequence = self._actuator.call(send, ACK_TIMEOUT_S)
        if not self._actuator.capabilities.acknowledge:
            sent_ns = self.sent_ns
            return self.await_status(
                lambda answer: answer.received_ns > sent_ns, "modbus-halfopen", f"no status after {command.name}"
            )
        status = self.await_status(
            lambda answer: answer.acknowledges(command, sequence) and answer.result not in {Result.IDLE, Result.BUSY},
            "modbus-write-lost",
            f"{command.name} was not acknowledged",
        )
        if status.result != Result.DONE:
            name = Result(status.result).name if status.result in set(Result) else str(status.result)
            slug = "second-master" if status.result == Result.REFUSED_OWNER else "controller-refused"
            raise StationRefused(slug, f"the controller rejected {command.name} in state {status.state}: {name}")
        return status

    def await_status(
        self,
        reached: Callable[[ActuatorStatus], bool],
        slug: str,
        message: str,
        timeout_s: float = ACK_TIMEOUT_S,
        *,
        until_trip: bool = False,
    ) -> ActuatorStatus:
        """Wait for a status.

        Args:
            reached: what it must show.
            slug: the refusal's slug when it does not come.
            message: what is then missing.
            timeout_s: wall seconds to wait.
            until_trip: a trip ends the wait.

        Raises:
            StationRefused: it did not come, or a trip came first.
        """
        supervisor = self._supervisor
        status = self._actuator.wait_status(
            lambda answer: reached(answer) or (until_trip and supervisor.trip is not None), timeout_s
        )
        if until_trip and supervisor.trip is not None:
            raise StationRefused("tripped", f"{message}: {supervisor.trip.slug} tripped")
        if status is None:
            raise StationRefused(slug, f"{message} within {timeout_s:g} s")
        return status
