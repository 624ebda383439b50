"""A driver of an actuator that can do little: it follows set-points and has a pressure valve; no more.

No lease, acknowledgement, echo, watchdog, phase, cycle pulse or function generator. Text over TCP, one line each way:

    S position_m velocity_m_s       follow this set-point
    P 0|1|2                         pressure off, low, on
    ?                               nothing
    -> clock_us position_m velocity_m_s force_N pressure
"""

from __future__ import annotations

import contextlib
import math
import socket
import time
from collections import deque

from drivers.capabilities import Capabilities, WatchdogKind
from drivers.connection import ActuatorAddress, ActuatorConnection, LinkKind
from drivers.errors import LinkLost, NoAnswer, PortClosed
from drivers.roles import ActuatorIdentity, ActuatorLimits, ActuatorStatus, Command, Input, Move, Program, State
from drivers.setpoint_generator import Setpoint

PRESSURES = {Command.HYDRAULICS_OFF: 0, Command.HYDRAULICS_LOW: 1, Command.HYDRAULICS_ON: 2}
INPUTS = (Input(0), Input.HYDRAULICS_LOW, Input.HYDRAULICS_ON)


class PlainActuator:
    """The driver."""

    capabilities = Capabilities(
        watchdog=WatchdogKind.NONE, hydraulics=True, streamed_setpoints=True, force_input=True
    )
    link_kind = LinkKind.TCP
    stale = 0
    busy = 0

    def __init__(self, connection: ActuatorConnection) -> None:
        self._address = ActuatorAddress.parse(connection.url)
        self._timeout_s = connection.timeout_s
        self._socket: socket.socket | None = None
        self._rest = b""
        self._sequence = 0
        self.sent: deque[tuple[int, int]] = deque(maxlen=64)

    @property
    def is_open(self) -> bool:
        return self._socket is not None

    def open(self) -> None:
        if self._socket is None:
            try:
                self._socket = socket.create_connection((self._address.host, self._address.port), timeout=1.0)
            except OSError as error:
                raise PortClosed("actuator", self._address.text, str(error)) from error
            self._rest = b""

    def close(self) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.close()
            self._socket = None

    def read_identity(self) -> ActuatorIdentity:
        return ActuatorIdentity(vendor="Plain", serial_number="PLAIN-1")

    def read_status(self) -> ActuatorStatus:
        return self._status("?")

    def follow(self, setpoint: Setpoint, watchdog_counter: int | None) -> ActuatorStatus:
        return self._status(f"S {setpoint.position_m:.9f} {setpoint.velocity_m_s:.9f}")

    def knows(self, command: Command) -> bool:
        return command in PRESSURES

    def _status(self, line: str) -> ActuatorStatus:
        clock_us, position_m, velocity_m_s, force_N, pressure = self._ask(line)
        state = (State.OFF, State.LOW, State.HOLD)[int(pressure)]
        return ActuatorStatus(
            time.monotonic_ns(), int(clock_us // 10_000) & 0xFFFF, int(state), 0, int(clock_us) & 0xFFFFFFFF,
            position_m, velocity_m_s, math.nan, 0, 0, 0, 0, 0, 0, 0, 0, 0,
            int(Input.E_STOP_CLOSED | INPUTS[int(pressure)]), math.nan, math.nan, 0, math.nan, force_N,
        )

    def exchange(self, watchdog_counter: int) -> ActuatorStatus:
        raise AssertionError("nobody feeds a watchdog that is not there")

    def write_limits(self, limits: ActuatorLimits) -> None:
        raise AssertionError("it holds no limits")

    def read_limits(self) -> ActuatorLimits:
        raise AssertionError("it holds no limits")

    def write_table(self, values_m: list[float]) -> None:
        raise AssertionError("it plays no table")

    def send(self, command: Command, order: Move | Program | None = None) -> int:
        if command not in PRESSURES:
            raise AssertionError(f"{command.name} is none of its commands")
        self._ask(f"P {PRESSURES[command]}")
        self._sequence += 1
        self.sent.append((self._sequence, int(command)))
        return self._sequence

    def _ask(self, line: str) -> list[float]:
        if self._socket is None:
            raise LinkLost("actuator", self._address.text, "not connected")
        try:
            self._socket.settimeout(max(self._timeout_s, 0.2))
            self._socket.sendall(line.encode() + b"\n")
            while b"\n" not in self._rest:
                chunk = self._socket.recv(4096)
                if not chunk:
                    raise OSError("it hung up")
                self._rest += chunk
        except TimeoutError as error:
            raise NoAnswer("actuator", self._address.text, "no answer") from error
        except OSError as error:
            self.close()
            raise LinkLost("actuator", self._address.text, str(error)) from error
        answer, _, self._rest = self._rest.partition(b"\n")
        return [float(word) for word in answer.split()]
