"""What follows when a phase lasts longer than it may: no phase is without a deadline and an answer here."""

from __future__ import annotations

from rig.campaign import conditioning, stopping
from rig.campaign import event as ev
from rig.campaign.cause import Cause
from rig.campaign.state import Phase, State
from rig.campaign.stopping import Handler, Step
from rig.faults.row import StopKind

CURRENT_LIMIT_S = 5.0
PAUSE_LIMIT_S = 7200.0
"""Wall time: nobody leaves a rig under pressure for longer."""

_program_overdue: Handler = lambda state, _: stopping.fault(  # noqa: E731 - one entry of a table, four times
    state, ev.Fault(StopKind.FADE_OUT, Cause("modbus-write-lost", "the motion program did not run to its end in time"))
)


def _current_never_settled(state: State, event: ev.TimedOut) -> Step:
    wanted_A = conditioning.program(state).first_current_A
    cause = Cause("current-tracking", f"measured current did not reach {wanted_A:g} A in {CURRENT_LIMIT_S:g} s")
    return conditioning.give_up(state, cause)


def _unanswered(state: State, event: ev.TimedOut) -> Step:
    """A station that proves nothing is asked for a stop; before arming there is nothing to stop."""
    cause = Cause("task-dies", f"{state.phase}: the station proved nothing in time")
    if not state.armed:
        return stopping.leave_to_station(state, cause)
    return stopping.fault(state, ev.Fault(StopKind.PRESSURE_OFF, cause))


OVERDUE: dict[Phase, Handler] = {
    Phase.CONNECTING: _unanswered,
    Phase.ARMING: _unanswered,
    Phase.PROVING_WATCHDOG: _unanswered,
    Phase.PRESSURE_LOW: _unanswered,
    Phase.PRESSURE_ON: _unanswered,
    Phase.RESETTING: stopping.overdue,
    Phase.FINISHING: stopping.overdue,
    Phase.CHECKING_RETURN: lambda state, _: stopping.disarm(state),
    Phase.RESTING: lambda state, _: stopping.fault(
        state, ev.Fault(StopKind.FADE_OUT, Cause("data-stale", "the controller's clock stands still"))
    ),
    Phase.PAUSED: lambda state, _: stopping.fault(
        state, ev.Fault(
            StopKind.PRESSURE_OFF, Cause("pause-ended", f"paused for {PAUSE_LIMIT_S / 3600.0:g} h: pressure off")
        )
    ),
    Phase.GATING: lambda state, _: stopping.fault(
        state, ev.Fault(StopKind.FADE_OUT, Cause("temperature-window", "the ECU reports no temperature"))
    ),
    Phase.COOLING: conditioning.cooling_overdue,
    Phase.DEMAGNETISING: conditioning.demagnetising_overdue,
    Phase.WARMING: _program_overdue,
    Phase.ADAPTING: _program_overdue,
    Phase.STEPPING: _program_overdue,
    Phase.CHECKING_ZEROS: lambda state, _: stopping.refuse(
        state, Cause("not-tared", "too few samples from the resting rig")
    ),
    Phase.PROVING_SENSORS: lambda state, _: stopping.fault(
        state, ev.Fault(StopKind.FADE_OUT, Cause("modbus-write-lost", "the actuator did not carry out the proof move"))
    ),
    Phase.CENTRING: lambda state, _: stopping.fault(
        state, ev.Fault(StopKind.FADE_OUT, Cause("modbus-write-lost", "the actuator did not reach the centre"))
    ),
    Phase.SETTLING: _current_never_settled,
    Phase.RUNNING: _program_overdue,
    Phase.CLEARING: lambda state, _: stopping.fault(
        state, ev.Fault(StopKind.PRESSURE_OFF, Cause("current-stuck", "the measured current did not return to 0 A"))
    ),
    Phase.JUDGING: lambda state, _: stopping.finish(state),
    Phase.STANDING: lambda state, _: stopping.fault(
        state, ev.Fault(StopKind.PRESSURE_OFF, Cause("stop-ignored", "the actuator did not come to rest"))
    ),
    Phase.STOPPING: stopping.overdue,
    Phase.COOLING_DOWN: lambda state, _: stopping.finish(state),
}
