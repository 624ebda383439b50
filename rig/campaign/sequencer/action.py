"""Actions of the sequencer: frozen values, executed by the runner in the given order."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from rig.campaign.results import Wait
from rig.campaign.stop_cause import StopCause
from rig.faults.row import StopKind
from rig.signals.drive_iteration import SignalDrive, SignalDrives
from rig.test_point import TestPoint


class Request(StrEnum):
    """What the station can be asked for."""

    CONNECT = "connect"
    ARM = "arm"
    STARVE_WATCHDOG = "starve_watchdog"
    HYDRAULICS_OFF = "hydraulics_off"
    HYDRAULICS_LOW = "hydraulics_low"
    HYDRAULICS_ON = "hydraulics_on"
    MOVE = "move"
    SET_CURRENT = "set_current"
    START = "start"
    STOP = "stop"
    RESET = "reset"
    DISARM = "disarm"


PROOF_WALL_S: dict[Request, float] = {
    Request.CONNECT: 20.0,
    Request.ARM: 10.0,
    Request.STARVE_WATCHDOG: 30.0,
    Request.HYDRAULICS_OFF: 30.0,
    Request.HYDRAULICS_LOW: 30.0,
    Request.HYDRAULICS_ON: 30.0,
    Request.MOVE: 5.0,
    Request.SET_CURRENT: 5.0,
    Request.START: 5.0,
    Request.STOP: 60.0,
    Request.RESET: 10.0,
    Request.DISARM: 25.0,
}
"""How long the station may take to prove a request (wall s)."""
MIN_WALL_S = 2.0
"""A deadline on the rig's clock also leaves this much wall time: requests take wall time at any speed."""
PATIENCE = 10.0
"""A rig's clock that runs this much slower than expected, or stands still, does not hold a deadline up any longer."""


@dataclass(frozen=True)
class Ask:
    """Ask the station for something that takes no values."""

    request: Request


@dataclass(frozen=True)
class Move:
    """Move slowly to `target_m` (m, LVDT coordinate) and report `Centred` when the actuator holds there."""

    target_m: float


@dataclass(frozen=True)
class SetCurrent:
    """Command `current_A` (A) and report `CurrentSettled` when the measured current is there."""

    current_A: float


@dataclass(frozen=True)
class AskOperator:
    """Ask the operator to set `current_A` (A) on the supply, and report `OperatorAnswered` when that was confirmed."""

    current_A: float


@dataclass(frozen=True)
class Start:
    """Start the point's motion program and report `ProgramEnded` when it has ended."""

    point: TestPoint


@dataclass(frozen=True)
class Iterate:
    """Calculate the next command of a signal and report `Iterated`.

    Attributes:
        point: the signal.
        drive: what was run; None: nothing yet, the first command or noise is requested.
        run: the program that was run; None: nothing yet.
        known: drives of other signals and currents, from which the first command may start.
    """

    point: TestPoint
    drive: SignalDrive | None = None
    run: TestPoint | None = None
    known: SignalDrives = ()


@dataclass(frozen=True)
class Stop:
    """Stop the rig now; goes before every other request."""

    stop: StopKind
    cause: StopCause


@dataclass(frozen=True)
class WatchZeros:
    """Watch the resting rig for a moment and report `ZerosJudged`; `again`: at the end, `ZerosReturned` instead."""

    again: bool = False


@dataclass(frozen=True)
class ReadTemperature:
    """Report `TemperatureRead` with the coil's present temperature."""


@dataclass(frozen=True)
class AwaitTemperature:
    """Report `CooledDown` when the coil's temperature is `highest_degC` (degC) or less."""

    highest_degC: float


@dataclass(frozen=True)
class ProveSensors:
    """Move 2 mm, slowly: `leg` 0 one way, 1 the other; report `ProofLegDone`, then `ProofJudged`."""

    leg: int


@dataclass(frozen=True)
class Rest:
    """Report `RestOver` after `rest_s` seconds of the rig's clock."""

    rest_s: float


@dataclass(frozen=True)
class AwaitStandstill:
    """Report `Standstill` when the actuator has stood still for a moment."""


@dataclass(frozen=True)
class BeginRecording:
    """Open the point's journal; every sample from now on belongs to it. `attempt` counts from 1.

    `commanded` is the program that makes the point's motion; `drive` how an iterated signal came to it.
    """

    point: TestPoint
    attempt: int
    commanded: TestPoint
    drive: SignalDrive | None = None


@dataclass(frozen=True)
class EndRecording:
    """Close the point's journal and have its file written; a `fault` makes the point invalid."""

    point: TestPoint
    attempt: int
    fault: StopCause | None


@dataclass(frozen=True)
class DropRecording:
    """Close the point's journal and keep it apart: the motion was not the wanted one, and the point is run again.

    `reason` is what it reached and what follows, in words.
    """

    point: TestPoint
    reason: str = ""


@dataclass(frozen=True)
class Remark:
    """Put a finding into the running point's recording; `code` decides what it means for the verdict."""

    code: str
    text: str


@dataclass(frozen=True)
class GiveUpPoint:
    """The point could not be begun: it is invalid and has no file."""

    point: TestPoint
    cause: StopCause


@dataclass(frozen=True)
class Withdraw:
    """These points (ids) are not run: a stop rule ended their endurance test (its id)."""

    test: str
    points: tuple[str, ...]


@dataclass(frozen=True)
class Deadline:
    """Report `TimedOut(phase)` when the phase lasts too long.

    Attributes:
        phase: which one.
        device_s: how long it may last (s, rig's clock).
        wall_s: wall time that it is left at any speed (s).
        patience: beyond `wall_s`, how many times the wall time of `device_s` a slow rig's clock may take.
    """

    phase: str
    device_s: float
    wall_s: float = MIN_WALL_S
    patience: float = PATIENCE


@dataclass(frozen=True)
class Note:
    """A line for the campaign's journal and the operator; `level` is `info`, `warning` or `error`.

    `wait` is the line's statement on the damper temperature, for the result of the campaign. `code` is its topic for
    readers of the journal (`temperature` or `amplitude`). `stop` is the code of the stop that it announces.
    """

    level: str
    text: str
    wait: Wait | None = None
    code: str = ""
    stop: str = ""


@dataclass(frozen=True)
class LeaveToStation:
    """Close the station's link: it stops the rig, takes the pressure away and ends.

    Should it not, the devices' own watchdogs stop the rig.
    """


@dataclass(frozen=True)
class Finish:
    """The campaign has ended; nothing follows."""


Action = (
    Ask
    | Move
    | SetCurrent
    | AskOperator
    | Start
    | Iterate
    | Stop
    | WatchZeros
    | ProveSensors
    | ReadTemperature
    | AwaitTemperature
    | Rest
    | AwaitStandstill
    | BeginRecording
    | EndRecording
    | DropRecording
    | Remark
    | GiveUpPoint
    | Withdraw
    | Deadline
    | Note
    | LeaveToStation
    | Finish
)

MOTION_ACTIONS = (ProveSensors, Move, Start)


def energises(action: Action) -> bool:
    """Whether an action moves the rod, raises the pressure or lets current flow: never after something has failed."""
    if isinstance(action, SetCurrent):
        return action.current_A != 0.0
    pressure = {Ask(Request.HYDRAULICS_LOW), Ask(Request.HYDRAULICS_ON)}
    return isinstance(action, MOTION_ACTIONS) or action in pressure

