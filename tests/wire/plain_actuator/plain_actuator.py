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
import sys
import time
from collections import deque

from drivers.capabilities import Capabilities, WatchdogKind
from drivers.connection import ActuatorAddress, ActuatorConnection, LinkKind
from drivers.errors import LinkLost, NoAnswer, PortClosed
from drivers.roles import ActuatorIdentity, ActuatorLimits, ActuatorStatus, Command, Input, Move, Program, State
from drivers.setpoint_generator import SetpointGenerator

LATE_S = 0.03
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
        self._generator = SetpointGenerator(0.0)
        self._pressure = 0
        self._sequence = 0
        self._program_id = 0
        self._last_s = 0.0
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
        now_s = time.monotonic()
        setpoint = self._generator.at(now_s)
        moves = self._pressure == 2
        if self._generator.state is State.RUNNING and now_s - self._last_s > LATE_S:
            sys.stderr.write(f"late set-point: {1e3 * (now_s - self._last_s):.0f} ms after the one before\n")
        self._last_s = now_s
        line = f"S {setpoint.position_m:.9f} {setpoint.velocity_m_s:.9f}" if moves else "?"
        clock_us, position_m, velocity_m_s, force_N, pressure = self._ask(line)
        if not moves:
            self._generator.rest(position_m)
        state = (State.OFF, State.LOW, self._generator.state)[int(pressure)]
        running = state in {State.RUNNING, State.FADING}
        return ActuatorStatus(
            time.monotonic_ns(), int(clock_us // 10_000) & 0xFFFF, int(state), 0, int(clock_us) & 0xFFFFFFFF,
            position_m, velocity_m_s, setpoint.position_m, self._generator.cycles_done, 0,
            int(self._generator.phase), 0, 0, 0, 0, 0, 0, int(Input.E_STOP_CLOSED | INPUTS[int(pressure)]),
            math.nan, math.nan, self._program_id if running else 0, setpoint.position_m - position_m, force_N,
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
        now_s = time.monotonic()
        if command in PRESSURES:
            self._ask(f"P {PRESSURES[command]}")
            self._pressure = PRESSURES[command]
        elif isinstance(order, Move):
            self._generator.move(order, now_s)
        elif isinstance(order, Program):
            self._generator.start(order, now_s)
            self._program_id = self._sequence + 1
        elif command is Command.FADE_STOP:
            self._generator.fade(now_s)
        elif command is Command.HALT:
            self._generator.halt(now_s)
        else:
            raise AssertionError(f"{command.name} is none of its commands")
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
