"""Events of the sequencer: frozen values made by the runner from answers, ring records, signals and verdicts."""

from __future__ import annotations

from dataclasses import dataclass

from rig.campaign.sequencer.action import Action, Request
from rig.campaign.stop_cause import StopCause
from rig.faults.row import StopKind
from rig.signals.drive_iteration import SignalDrive


@dataclass(frozen=True)
class MeasuredMotion:
    """What the sensors saw of a program that has ended.

    Attributes:
        amplitude_m: mean over the full cycles of half of peak to valley, m.
        mean_m: mean position, m.
        valve_saturated: the controller reported full flow.
        following_error_m: largest reported difference of set-point and position, m.
        disturbed: what kept this computer from streaming the motion; empty: nothing.
    """

    amplitude_m: float
    mean_m: float
    valve_saturated: bool = False
    following_error_m: float = 0.0
    disturbed: str = ""


@dataclass(frozen=True)
class Begin:
    """The operator started the campaign; the plan is accepted."""


@dataclass(frozen=True)
class Done:
    """The station proved that a request was carried out."""

    request: Request


@dataclass(frozen=True)
class Declined:
    """The station refused a request, or could not prove that it was carried out."""

    request: Request
    cause: StopCause


@dataclass(frozen=True)
class ZerosJudged:
    """The rest window is over; `cause` is None when the sensors show a rig at rest."""

    cause: StopCause | None


@dataclass(frozen=True)
class ZerosReturned:
    """The rest window at the end is over, and what it showed is kept."""


@dataclass(frozen=True)
class ActionFailed:
    """An action raised; the others of its step were carried out, except those that energise the rig.

    Attributes:
        action: which one.
        phase: the phase that its step led to.
        cause: what happened.
    """

    action: Action
    phase: str
    cause: StopCause


@dataclass(frozen=True)
class ProofLegDone:
    """The first way of the proof move has ended."""


@dataclass(frozen=True)
class ProofJudged:
    """The proof move is over; `cause` is None when LVDT and load cell followed the actuator."""

    cause: StopCause | None


@dataclass(frozen=True)
class Centred:
    """The actuator holds at the commanded target."""


@dataclass(frozen=True)
class CurrentSettled:
    """The measured current is at the commanded one."""


@dataclass(frozen=True)
class OperatorAnswered:
    """The operator confirmed the requested current."""


@dataclass(frozen=True)
class ProgramEnded:
    """The motion program has ended and the actuator holds.

    Attributes:
        at_centre: the measured position is the program's centre.
        motion: what the displacement sensor saw, None where it saw no full cycle.
        cut_short: how the controller shows that another client stopped it; empty where it ran all its cycles.
    """

    at_centre: bool
    motion: MeasuredMotion | None = None
    cut_short: str = ""


@dataclass(frozen=True)
class Iterated:
    """The next command of a signal was calculated.

    Attributes:
        point_id: of the signal.
        drive: with that command; None: there is none.
        cause: why there is none.
    """

    point_id: str
    drive: SignalDrive | None
    cause: StopCause | None = None


@dataclass(frozen=True)
class TemperatureRead:
    """The coil's temperature as the ECU just reported it (degC)."""

    temperature_degC: float


@dataclass(frozen=True)
class CooledDown:
    """The coil's temperature has fallen to the one awaited."""


@dataclass(frozen=True)
class RestOver:
    """The rest after a point has passed on the rig's clock."""


@dataclass(frozen=True)
class Standstill:
    """The actuator stands still by the controller's own position."""


@dataclass(frozen=True)
class BlockCounted:
    """What is known of an endurance test after the file of one of its blocks.

    Attributes:
        cycles_left: of the block.
        cycles_run: of the whole test.
        ended_by: name of the stop rule that was reached; empty: none.
    """

    cycles_left: int
    cycles_run: int
    ended_by: str = ""


@dataclass(frozen=True)
class Judged:
    """A point's file was written and judged; `block`: only of a block of an endurance test."""

    point_id: str
    valid: bool
    block: BlockCounted | None = None


@dataclass(frozen=True)
class TimedOut:
    """The deadline set on entering `phase` has passed."""

    phase: str


@dataclass(frozen=True)
class Spoiled:
    """Something that invalidates the running point without stopping it (reaction P)."""

    cause: StopCause


@dataclass(frozen=True)
class Fault:
    """The application found a fault that must stop the rig; the station does not know of it yet."""

    stop: StopKind
    cause: StopCause


@dataclass(frozen=True)
class Tripped:
    """The station's interlocks tripped, or found more during a stop; the stop is already under way.

    Attributes:
        stop: how it stops the rig.
        cause: what was found.
        first: the station had no trip latched before this one.
    """

    stop: StopKind
    cause: StopCause
    first: bool = True


@dataclass(frozen=True)
class Safe:
    """The station proved standstill and 0 A after a stop, after one of kind S1 also that the pressure is off."""

    stop: StopKind = StopKind.FADE_OUT


@dataclass(frozen=True)
class Unknown:
    """The station cannot prove standstill or 0 A."""

    detail: str


@dataclass(frozen=True)
class StationGone:
    """The station process is gone or does not answer."""

    detail: str


@dataclass(frozen=True)
class Abort:
    """The operator wants it stopped now."""

    stop: StopKind
    cause: StopCause


@dataclass(frozen=True)
class PauseAsked:
    """The operator wants a pause at the next point boundary."""


@dataclass(frozen=True)
class ResumeAsked:
    """The operator ends the pause, or takes back the wish for one."""


Event = (
    Begin
    | Done
    | Declined
    | ZerosJudged
    | ZerosReturned
    | ActionFailed
    | ProofLegDone
    | ProofJudged
    | Centred
    | CurrentSettled
    | OperatorAnswered
    | ProgramEnded
    | Iterated
    | TemperatureRead
    | CooledDown
    | RestOver
    | Standstill
    | Judged
    | TimedOut
    | Spoiled
    | Fault
    | Tripped
    | Safe
    | Unknown
    | StationGone
    | Abort
    | PauseAsked
    | ResumeAsked
)
