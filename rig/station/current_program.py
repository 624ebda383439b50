"""A current program: current steps during a motion, commanded by the station at stated times of the motion.

The steps follow the controller's own clock, so that they keep in step with a motion of any length. The motion starts
some milliseconds before or after the station knows of it: where in the stroke a step fell is read from the recording.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from drivers.clock import back_whenever, back_within, step_due
from drivers.errors import DriverError
from drivers.roles import State
from rig.clock import monotonic_ns
from rig.signals.program_limits import MOST_STEPS, SHORTEST_HOLD_S
from rig.station.errors import StationRefused
from rig.station.interlocks.finding import Finding
from rig.station.log import say_error
from rig.station.motion_start import read_order
from rig.station.supervisor import Supervisor
from rig.station.threads.devices import Devices

SAME_CURRENT_A = 1e-6
LOOK_S = 0.050
"""So often (wall s) a program that waits for its next step checks that its motion is still running."""
AFTER_END_S = 1.0
"""A motion that was never seen to run is over so long after the program's last step (device s)."""


@dataclass(frozen=True)
class CurrentProgram:
    """Currents in turn, each held until the next.

    Attributes:
        time_s: (n,) when each is commanded, s of the controller's clock since the start of the motion; 0 first, rising.
        current_A: (n,) the currents, A.
    """

    time_s: tuple[float, ...]
    current_A: tuple[float, ...]

    @classmethod
    def from_json(cls, given: Mapping[str, Any]) -> CurrentProgram:
        """The program of a start request.

        Raises:
            KeyError: an entry is missing.
            TypeError: an entry is not a list of numbers.
            ValueError: the times do not rise from 0, or their number is not that of the currents.
        """
        time_s, current_A = (tuple(float(value) for value in given[name]) for name in ("time_s", "current_A"))
        if not 1 <= len(time_s) <= MOST_STEPS or len(time_s) != len(current_A):
            raise ValueError(f"{len(time_s)} times and {len(current_A)} currents; allowed: 1 to {MOST_STEPS} of each")
        if not all(map(math.isfinite, (*time_s, *current_A))):
            raise ValueError("the times or currents contain values that are not finite")
        if time_s[0] != 0.0 or any(after - before < SHORTEST_HOLD_S for before, after in pairwise(time_s)):
            raise ValueError(f"the times must start at 0 s and increase by at least {SHORTEST_HOLD_S:g} s per step")
        return cls(time_s, current_A)


def current_program(given: object, devices: Devices) -> CurrentProgram:
    """The current program of a start request, within the limits that apply to a constant current.

    Args:
        given: `time_s` and `current_A`.
        devices: of the rig.

    Raises:
        StationRefused: it is not a program, goes beyond a limit, does not start with the current that is commanded now,
            or the current is set manually.
    """
    program, coil = read_order(given, "a current program", CurrentProgram.from_json), devices.coil
    if coil.by_hand:
        raise StationRefused("by-hand-without-steps", "start: the current is set manually; an operator cannot set "
            "currents at exact times")
    high_A = devices.config.limits.current_A
    low_A = -high_A if coil.lowest_A is None else max(-high_A, coil.lowest_A)
    beyond = [value for value in program.current_A if not low_A <= value <= high_A]
    if beyond:
        raise StationRefused("matrix-infeasible", f"start: the current program contains {beyond[0]:g} A, allowed: "
            f"{low_A:g} A to {high_A:g} A")
    if abs(program.current_A[0] - coil.commanded_A) > SAME_CURRENT_A:
        raise StationRefused("bad-request", f"start: the current program starts at {program.current_A[0]:g} A, but "
            f"{coil.commanded_A:g} A is commanded now")
    return program


class CurrentSteps:
    """Commands the steps of one program on its own thread, until the motion ends or anything else sets the current.

    Args (construction):
        program: the steps.
        begun_ns: when the motion's start was sent (host monotonic).
        devices: of the rig.
        supervisor: receives what goes wrong.
    """

    def __init__(self, program: CurrentProgram, begun_ns: int, devices: Devices, supervisor: Supervisor) -> None:
        self._program = program
        self._coil, self._actuator = devices.coil, devices.actuator
        self._supervisor = supervisor
        self._rate = devices.config.device_rate
        self._begun_s = self._actuator.controller_s(begun_ns)
        self._ran = False
        self._next_look = threading.Event()

    def start(self) -> None:
        """Start commanding; the motion's start was confirmed."""
        self._coil.follow_program(self, steps=len(self._program.time_s) > 1)
        threading.Thread(target=self._run, name="current-program", daemon=True).start()

    def _run(self) -> None:
        times_s, currents_A = self._program.time_s, self._program.current_A
        try:
            for number in range(1, len(times_s)):
                if not self._reached(times_s[number]):
                    return
                overtaken = number + 1 < len(times_s) and self._elapsed_s >= times_s[number + 1]
                if not overtaken and not self._coil.step_current(self, currents_A[number]):
                    return
            self._reached(math.inf)
        except DriverError as error:
            detail = f"a step of the current program could not be sent: {error}"
            self._supervisor.report([Finding("can-lost", detail, monotonic_ns())])
        except Exception as error:  # noqa: BLE001 - a program that ended unseen would leave a current that is not meant
            say_error()
            detail = f"current program: {type(error).__name__}: {error}"
            self._supervisor.report([Finding("task-dies", detail, monotonic_ns())])
        finally:
            self._coil.leave_program(self)
            step_due(None)
            back_whenever()

    @property
    def _elapsed_s(self) -> float:
        """Time since the motion's start (s of the controller's clock)."""
        return self._actuator.controller_s(monotonic_ns()) - self._begun_s

    def _reached(self, at_s: float) -> bool:
        """Wait until so long after the motion's start (device s); False once the motion or the program is over."""
        while not self._over:
            now_ns = monotonic_ns()
            left_s = (at_s - self._elapsed_s) / self._rate
            if left_s <= 0.0:
                return True
            step_due(now_ns + int(1e9 * left_s) if math.isfinite(left_s) else None)
            wait_s = min(left_s, LOOK_S)
            back_within(wait_s)
            self._next_look.wait(wait_s)
        return False

    @property
    def _over(self) -> bool:
        """The motion has ended, a trip is latched, or something else has set the current."""
        status = self._actuator.interlock.status
        running = status is not None and status.state == State.RUNNING
        self._ran = self._ran or running
        late = self._elapsed_s > self._program.time_s[-1] + AFTER_END_S
        ended = not running and (self._ran or late)
        return ended or self._supervisor.trip is not None or not self._coil.follows_program(self)
