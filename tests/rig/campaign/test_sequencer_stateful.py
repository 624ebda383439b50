"""The sequencer pushed around by operator, rig and faults in any order, with the invariants of the fault matrix."""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from rig.campaign.results import RigState
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer.action import Action, Request
from rig.campaign.sequencer.state import Phase, start_state
from rig.campaign.sequencer.step import step
from rig.campaign.stop_cause import StopCause
from rig.faults.row import StopKind
from rig.test_point import TestPoint

POINTS = tuple(
    TestPoint(f"p{number:03d}", "sine", 0.02, 2.0, 0.5 * number, cycles=3, rest_s=float(number % 2))
    for number in range(1, 5)
)
CAUSES = st.sampled_from(
    ["ecu-silent", "ecu-crc", "ecu-overtemp", "estop", "coil-open-short", "serial-garbage", "stroke-limit"]
)
KINDS = st.sampled_from([StopKind.FADE_OUT, StopKind.PRESSURE_OFF, StopKind.HALT])
ENDS = {
    Phase.STOPPING, Phase.COOLING_DOWN, Phase.RESETTING, Phase.CHECKING_RETURN, Phase.FINISHING, Phase.ENDED,
}  # fmt: skip


class Rig(RuleBasedStateMachine):
    """What a rig answers, what can go wrong, what the operator does, in any order."""

    @initialize(retries=st.integers(0, 2))
    def begin(self, retries: int) -> None:
        self.state = start_state(POINTS, retries)
        self.open: tuple[str, int] | None = None
        self.last: tuple[Action, ...] = ()
        self.faults_in_open = False
        self.valid: list[str] = []
        self.take(ev.Begin())

    def take(self, event: ev.Event) -> tuple[Action, ...]:
        before = self.state
        self.state, actions = step(before, event)
        for action in actions:
            if isinstance(action, act.MOTION_ACTIONS):
                assert self.state.armed
                assert self.state.powered
                assert self.state.proved
                assert self.state.latch is None
            if isinstance(action, act.BeginRecording):
                assert self.open is None
                self.open, self.faults_in_open = (action.point.id, action.attempt), False
            if isinstance(action, act.EndRecording):
                assert self.open == (action.point.id, action.attempt)
                assert not (action.fault is None and self.faults_in_open), "a valid point never contains a fault"
                if action.fault is None:
                    self.valid.append(action.point.id)
                self.open = None
        self.last = actions or self.last
        return actions

    @precondition(lambda self: bool(self.last))
    @rule(which=st.integers(0, 5))
    def what_was_to_be_done_fails(self, which: int) -> None:
        action = self.last[which % len(self.last)]
        if isinstance(action, act.BeginRecording) and self.state.recording:
            self.open = None
        self.faults_in_open = self.faults_in_open or self.open is not None
        armed, phase = self.state.armed, self.state.phase
        self.last = ()
        self.take(ev.ActionFailed(action, phase, StopCause("disk-full")))
        if armed:
            assert self.state.phase in ENDS

    @rule()
    def the_rig_does_what_was_requested(self) -> None:
        requests = {
            Phase.CONNECTING: Request.CONNECT, Phase.ARMING: Request.ARM, Phase.PRESSURE_LOW: Request.HYDRAULICS_LOW,
            Phase.PROVING_WATCHDOG: Request.STARVE_WATCHDOG, Phase.PRESSURE_ON: Request.HYDRAULICS_ON,
            Phase.RESETTING: Request.RESET, Phase.FINISHING: Request.DISARM,
        }  # fmt: skip
        facts: dict[Phase, ev.Event] = {
            Phase.CHECKING_ZEROS: ev.ZerosJudged(None), Phase.PROVING_SENSORS: ev.ProofJudged(None),
            Phase.CENTRING: ev.Centred(), Phase.SETTLING: ev.CurrentSettled(), Phase.CLEARING: ev.CurrentSettled(),
            Phase.RUNNING: ev.ProgramEnded(at_centre=True), Phase.RESTING: ev.RestOver(),
            Phase.STANDING: ev.Standstill(), Phase.CHECKING_RETURN: ev.ZerosReturned(), Phase.STOPPING: ev.Safe(),
            Phase.PAUSED: ev.ResumeAsked(),
            Phase.COOLING_DOWN: ev.RestOver(),
        }  # fmt: skip
        if self.state.phase in requests:
            self.take(ev.Done(requests[self.state.phase]))
        elif self.state.phase in facts:
            self.take(facts[self.state.phase])
        elif self.state.unjudged:
            self.take(ev.Judged(self.state.unjudged[0], valid=True))

    @rule(kind=KINDS, slug=CAUSES)
    def the_station_trips(self, kind: StopKind, slug: str) -> None:
        armed = self.state.armed
        self.faults_in_open = self.faults_in_open or self.open is not None
        self.take(ev.Tripped(kind, StopCause(slug)))
        if armed:
            assert self.state.phase in ENDS
            assert self.state.latch is not None or self.state.phase is Phase.ENDED

    @rule(slug=CAUSES)
    def a_point_is_spoiled(self, slug: str) -> None:
        self.faults_in_open = self.faults_in_open or self.open is not None
        self.take(ev.Spoiled(StopCause(slug)))

    @rule(kind=st.sampled_from([StopKind.FADE_OUT, StopKind.PRESSURE_OFF]))
    def the_operator_stops(self, kind: StopKind) -> None:
        self.faults_in_open = self.faults_in_open or self.open is not None
        self.take(ev.Abort(kind, StopCause("sigint")))

    @rule(paused=st.booleans())
    def the_operator_pauses_or_goes_on(self, paused: bool) -> None:
        self.take(ev.PauseAsked() if paused else ev.ResumeAsked())

    @rule()
    def time_runs_out(self) -> None:
        self.faults_in_open = self.faults_in_open or self.open is not None
        self.take(ev.TimedOut(self.state.phase))

    @rule(request=st.sampled_from(list(Request)))
    def something_is_refused(self, request: Request) -> None:
        self.faults_in_open = self.faults_in_open or self.open is not None
        self.take(ev.Declined(request, StopCause("modbus-reject")))

    @rule(name=st.sampled_from([point.id for point in POINTS]), valid=st.booleans())
    def a_verdict_comes(self, name: str, valid: bool) -> None:
        self.take(ev.Judged(name, valid))

    @precondition(lambda self: self.state.phase is Phase.STOPPING and self.state.armed)
    @rule()
    def standstill_cannot_be_proved(self) -> None:
        self.take(ev.Unknown("links lost"))
        assert self.state.rig_state is RigState.UNKNOWN

    @invariant()
    def an_open_recording_is_known(self) -> None:
        if hasattr(self, "state"):
            assert self.state.recording is (self.open is not None)

    @invariant()
    def the_end_is_safe_or_stated_to_be_unknown(self) -> None:
        if hasattr(self, "state") and self.state.phase is Phase.ENDED:
            known = self.state.stopped or self.state.left_to_station
            assert not self.state.pressurised or self.state.rig_state is RigState.UNKNOWN or known


Rig.TestCase.settings = settings(max_examples=150, stateful_step_count=60, deadline=None)
TestRig = Rig.TestCase
