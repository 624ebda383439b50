"""What the sequencer wants done: frozen values, carried out by the runner in the order given."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from rig.campaign.cause import Cause, StopKind
from rig.campaign.options import Wait
from rig.matrix.point import TestPoint


class Request(StrEnum):
    """What the station can be asked for."""

    CONNECT = "connect"
    ARM = "arm"
    STARVE_WATCHDOG = "starve_watchdog"
    HYDRAULICS_LOW = "hydraulics_low"
    HYDRAULICS_ON = "hydraulics_on"
    MOVE = "move"
    SET_CURRENT = "set_current"
    START = "start"
    STOP = "stop"
    RESET = "reset"
    DISARM = "disarm"


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
class Start:
    """Start the point's motion program and report `ProgramEnded` when it has ended."""

    point: TestPoint


@dataclass(frozen=True)
class Stop:
    """Stop the rig now; goes before every other request."""

    stop: StopKind
    cause: Cause


@dataclass(frozen=True)
class WatchZeros:
    """Watch the resting rig for a moment and report `ZerosJudged`."""


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

    `commanded` is the program that makes the point's motion.
    """

    point: TestPoint
    attempt: int
    commanded: TestPoint


@dataclass(frozen=True)
class EndRecording:
    """Close the point's journal and have its file written; a `fault` makes the point invalid."""

    point: TestPoint
    attempt: int
    fault: Cause | None


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
    cause: Cause


@dataclass(frozen=True)
class Deadline:
    """Report `TimedOut(phase)` when the phase lasts longer than `device_s` seconds of the rig's clock; None: never."""

    phase: str
    device_s: float | None


@dataclass(frozen=True)
class Note:
    """A line for the campaign's journal and the operator; `level` is `info`, `warning` or `error`.

    `wait` is what the line tells of the damper's temperature, for the campaign's result.
    """

    level: str
    text: str
    wait: Wait | None = None


@dataclass(frozen=True)
class Finish:
    """The campaign has ended; nothing follows."""


Action = (
    Ask
    | Move
    | SetCurrent
    | Start
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
    | Deadline
    | Note
    | Finish
)

MOTION_ACTIONS = (ProveSensors, Move, Start)
