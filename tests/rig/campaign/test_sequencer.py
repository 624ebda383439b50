"""The sequencer explored exhaustively: every reachable state with every event, and what must hold in each."""

from __future__ import annotations

import gc
import sys
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import pytest

from rig.campaign.execution.runner import after_station
from rig.campaign.results import RigState
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer.action import Action, Request
from rig.campaign.sequencer.event import MeasuredMotion
from rig.campaign.sequencer.state import (
    NO_CONDITIONS,
    Ceiling,
    Conditions,
    Latch,
    ManualState,
    Phase,
    State,
    start_state,
)
from rig.campaign.sequencer.step import step
from rig.campaign.sequencer.stopping import COOLING_PAUSE_S
from rig.campaign.stop_cause import StopCause
from rig.faults.row import StopKind
from rig.matrix.order_by_heat import HeatModel, Load, Thermal
from rig.signals.drive_iteration import IterationSettings, SignalDrive
from rig.signals.record import SweepMotion, sweep_record
from rig.test_point import TestPoint

POINTS = (
    TestPoint("p001", "sine", 0.02, 2.0, 0.5, cycles=3, rest_s=1.0),
    TestPoint("p002", "triangle", 0.01, 1.0, 0.0, cycles=3, centre_m=0.005),
)
# Amplitude compensation, and apart from it a temperature window, demagnetising and a current step: together their
# histories multiply.
COMPENSATED = (
    (replace(POINTS[0], rest_s=0.0),),
    Conditions(tolerance=0.01, ceilings={"p001": Ceiling(0.03, "speed")}),
)
STEP = TestPoint("step1", "hold", 0.0, 2.0, 1.0, 2, 0.0, 0.0, kind="current_step", steps_A=(0.2, 1.0))
TEMPERED = (
    (replace(POINTS[0], rest_s=0.0), STEP),
    Conditions(
        thermal=Thermal(HeatModel(), 25.0, 45.0, 23.0, 400.0),
        loads=(("p001", Load(2.5, 100.0)), ("step1", Load(1.0, 1.0))),
        warm_up=TestPoint("warm-up", "sine", 0.02, 2.0, 0.5),
        longest_s=20.0,
        demagnetise=True,
    ),
)
SWEEP = sweep_record(SweepMotion(5.0, 1.0, 2.0, 0.01, 0.01), 1.0)
SIGNAL = TestPoint("p001", "sweep", 0.01, 1.5, 0.5, 1, 0.0, 0.0, kind="signal", record=SWEEP)
IDENTIFYING = SignalDrive(SWEEP.mark, SWEEP.amplitude_m, 0.5, 0.8, noise=replace(SWEEP, name="noise"))
CORRECTED = replace(IDENTIFYING, noise=None, command=SWEEP)
ITERATED: tuple[ev.Event, ...] = (
    ev.Iterated("p001", IDENTIFYING), ev.Iterated("p001", CORRECTED),
    ev.Iterated("p001", replace(CORRECTED, outcome="converged")),
    ev.Iterated("p001", replace(CORRECTED, outcome="limit", cannot="valve")),
    ev.Iterated("p001", None, StopCause("iteration", "no rod")), ev.Iterated("p009", CORRECTED),
)
RESTARTABLE = StopCause("ecu-silent", "no status")
STILL_HOT = StopCause("coil-not-ready", "ECU in state FAULT")
HOT = StopCause("ecu-overtemp", "over-temperature bit")
FINAL = StopCause("estop", "chain open")

EVENTS: tuple[ev.Event, ...] = (
    ev.Begin(),
    *(ev.Done(request) for request in Request),
    *(ev.Declined(request, StopCause("modbus-reject", "refused")) for request in Request),
    ev.ZerosJudged(None),
    ev.ProofLegDone(),
    ev.ProofJudged(None),
    ev.ProofJudged(StopCause("sensors-swapped", "the LVDT shows -4 mm")),
    ev.ZerosJudged(StopCause("not-tared", "900 N at rest")),
    ev.Centred(),
    ev.CurrentSettled(),
    ev.ProgramEnded(at_centre=True),
    ev.ProgramEnded(at_centre=False),
    ev.ProgramEnded(at_centre=True, cut_short="the controller was FADING"),
    ev.ZerosReturned(),
    ev.RestOver(),
    ev.Standstill(),
    *(ev.Judged(point.id, valid) for point in POINTS for valid in (True, False)),
    *(ev.TimedOut(phase) for phase in Phase),
    ev.Spoiled(StopCause("sample-gap", "12 lost")),
    ev.Fault(StopKind.FADE_OUT, StopCause("disk-full", "journal")),
    ev.Tripped(StopKind.FADE_OUT, RESTARTABLE),
    ev.Tripped(StopKind.PRESSURE_OFF, FINAL),
    ev.Safe(),
    ev.Safe(StopKind.PRESSURE_OFF),
    ev.Unknown("links lost"),
    ev.StationGone("exit code -9"),
    ev.Abort(StopKind.FADE_OUT, StopCause("sigint")),
    ev.Abort(StopKind.PRESSURE_OFF, StopCause("sigterm")),
    ev.PauseAsked(),
    ev.ResumeAsked(),
)


class Edge(NamedTuple):
    before: State
    event: ev.Event
    after: State
    actions: tuple[Action, ...]


# With retries the histories multiply; the events left out there are explored without retries.
MEASURED_MOTIONS: tuple[ev.Event, ...] = (
    ev.ProgramEnded(at_centre=True, motion=MeasuredMotion(0.018, 0.0)),
    ev.ProgramEnded(at_centre=True, motion=MeasuredMotion(0.02, 0.0)),
)
TEMPERATURES: tuple[ev.Event, ...] = (
    *(ev.TemperatureRead(temperature_degC) for temperature_degC in (24.0, 30.0, 45.5, 60.0)),
    ev.CooledDown(),
)
PAUSES_AND_TWINS = (ev.PauseAsked, ev.ResumeAsked, ev.Abort, ev.StationGone)


@dataclass(frozen=True)
class Case:
    points: tuple[TestPoint, ...] = POINTS
    conditions: Conditions = NO_CONDITIONS
    retries: int = 0
    events: tuple[ev.Event, ...] = EVENTS
    phases: frozenset[Phase] = frozenset()


WITHOUT_PAUSES = tuple(event for event in EVENTS if not isinstance(event, PAUSES_AND_TWINS))
HEALTHY = (ev.Begin, ev.Done, ev.ZerosJudged, ev.ProofLegDone, ev.ProofJudged, ev.Centred, ev.CurrentSettled)
STOPPED = (ev.Tripped, ev.Fault, ev.Safe, ev.Unknown, ev.RestOver, ev.TimedOut, ev.Abort, ev.Judged)
STOPPED_OR_HEALTHY: tuple[ev.Event, ...] = (
    *(event for event in EVENTS if isinstance(event, HEALTHY + STOPPED)),
    ev.ProgramEnded(at_centre=True),
    ev.Standstill(),
)
HOT_EVENTS: tuple[ev.Event, ...] = (
    *STOPPED_OR_HEALTHY,
    ev.Tripped(StopKind.FADE_OUT, HOT),
    ev.Declined(Request.RESET, STILL_HOT),
    ev.Declined(Request.RESET, FINAL),
)
CASES = {
    "no-retries": Case(phases=frozenset({Phase.PAUSED})),
    "hot-ecu": Case(
        (replace(POINTS[0], rest_s=0.0),),
        Conditions(longest_s=2 * COOLING_PAUSE_S),
        retries=1,
        events=HOT_EVENTS,
        phases=frozenset({Phase.COOLING_DOWN, Phase.EVALUATING, Phase.RESETTING}),
    ),
    "one-retry": Case(retries=1, events=WITHOUT_PAUSES, phases=frozenset({Phase.EVALUATING, Phase.RESETTING})),
    "compensated": Case(*COMPENSATED, events=WITHOUT_PAUSES + MEASURED_MOTIONS, phases=frozenset({Phase.ADAPTING})),
    "iterated": Case(
        (SIGNAL,), Conditions(iteration=IterationSettings()), events=STOPPED_OR_HEALTHY + ITERATED,
        phases=frozenset({Phase.ITERATING, Phase.CORRECTING}),
    ),
    "tempered": Case(
        *TEMPERED,
        events=WITHOUT_PAUSES + TEMPERATURES,
        phases=frozenset({Phase.GATING, Phase.COOLING, Phase.WARMING, Phase.DEMAGNETISING, Phase.STEPPING}),
    ),
    "by-hand": Case(
        conditions=Conditions(hand=ManualState("off", 600.0)),
        events=(*WITHOUT_PAUSES, ev.Abort(StopKind.FADE_OUT, StopCause("sigint")), ev.OperatorAnswered()),
        phases=frozenset({Phase.YIELDING, Phase.ASKING, Phase.CURRENT_SET, Phase.TAKING_AWAY, Phase.TAKEN_AWAY}),
    ),
}


FULL = StopCause("disk-full", "no space left")


MUST_BE_ANSWERED = ev.Fault | ev.Abort | ev.Tripped | ev.ActionFailed


class Explored(NamedTuple):
    """What was explored.

    Attributes:
        states: every reachable state, as one object each.
        edges: the transitions that change the state or want something done, and every one of what must be answered.
            Of what is left out, news in a phase that does not wait for it, nothing but the number is kept: the state
            is the same object, and there are no actions.
        transitions: how many there are in all.
    """

    states: list[State]
    edges: list[Edge]
    transitions: int


@cache
def explore(name: str) -> Explored:
    """Every reachable state with every event of the case, and with the failure of every action that led to it."""
    case = CASES[name]
    first = start_state(case.points, case.retries, case.conditions)
    failures: defaultdict[int, set[ev.Event]] = defaultdict(set)
    waiting: deque[tuple[State, Iterable[ev.Event]]] = deque([(first, case.events)])
    seen, edges, transitions = {first: first}, [], 0
    gc.disable()  # there is nothing to collect among so many edges
    while waiting:
        state, events = waiting.popleft()
        for event in events:
            after, actions = step(state, event)
            transitions += 1
            if after is not state:
                same = seen.setdefault(after, after)
                if same is after:
                    waiting.append((after, case.events))
                after = same
            if after is not state or actions or isinstance(event, MUST_BE_ANSWERED):
                edges.append(Edge(state, event, after, actions))
            if actions:
                known = failures[id(after)]  # `seen` keeps it
                fresh = {ev.ActionFailed(action, after.phase, FULL) for action in actions} - known
                known |= fresh
                waiting.append((after, tuple(fresh)))
    gc.enable()
    gc.freeze()
    return Explored(list(seen), edges, transitions)


@pytest.fixture(params=CASES)
def explored(request: pytest.FixtureRequest) -> Explored:
    return explore(request.param)


@pytest.fixture
def edges(explored: Explored) -> list[Edge]:
    return explored.edges


PROOFS = (ev.Safe(), ev.Safe(StopKind.PRESSURE_OFF), ev.Done(Request.STOP))
"""The station's word that the rig stands still at 0 A."""


def moving(edge: Edge) -> bool:
    return any(isinstance(action, act.MOTION_ACTIONS) for action in edge.actions)


TAKEN = {Phase.TAKING_AWAY, Phase.TAKEN_AWAY}
"""After the end of everything else: somebody takes the current away that nobody here can."""
OPTIONAL_PHASES = frozenset().union(*(case.phases for case in CASES.values())) | {Phase.RESTING}


@pytest.mark.few(1)
def test_exploration_reaches_every_phase(
    explored: Explored, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    name = request.node.callspec.params["explored"]
    case, (states, edges, transitions) = CASES[name], explored
    failed = sum(isinstance(edge.event, ev.ActionFailed) for edge in edges)
    events = f"{len(case.events)} events + {failed} failing actions"
    with capsys.disabled():
        sys.stdout.write(f"\nsequencer, {name}: {len(states)} states x {events} = {transitions} transitions\n")
    assert transitions == len(states) * len(case.events) + failed
    rests = {Phase.RESTING} if any(point.rest_s for point in case.points) else set()
    assert {state.phase for state in states} == set(Phase) - OPTIONAL_PHASES | case.phases | rests


def test_nothing_moves_unless_armed_proved_powered_and_unlatched(edges: list[Edge]) -> None:
    motions = [edge for edge in edges if moving(edge)]
    assert motions
    for edge in motions:
        state = edge.after
        assert (state.armed, state.proved, state.powered, state.latch, state.refused) == (True, True, True, None, None)


def test_no_motion_follows_a_latch_until_an_explicit_reset_is_proved(edges: list[Edge]) -> None:
    for edge in edges:
        if edge.before.latch is not None:
            assert not moving(edge)
            reset = edge.event == ev.Done(Request.RESET) and edge.before.phase is Phase.RESETTING
            assert edge.after.latch is not None or reset


def test_the_first_cause_is_never_replaced(edges: list[Edge]) -> None:
    for edge in edges:
        if edge.before.latch is not None and edge.after.latch is not None:
            assert edge.after.latch == edge.before.latch


def test_a_reset_demands_every_proof_again(edges: list[Edge]) -> None:
    cleared = [edge for edge in edges if edge.before.latch is not None and edge.after.latch is None]
    for edge in cleared:
        assert edge.after.phase is Phase.CHECKING_ZEROS
        assert not edge.after.proved
        assert not edge.after.powered
        assert edge.after.held_at_m is None
    assert bool(cleared) == (edges[0].before.retries > 0)


def test_no_restart_follows_an_operators_stop_or_a_fault_that_forbids_it(edges: list[Edge]) -> None:
    stopped: dict[int, State] = {}
    for edge in edges:
        forbids = isinstance(edge.event, ev.Abort | ev.Fault) or edge.event == ev.Tripped(StopKind.PRESSURE_OFF, FINAL)
        if forbids and edge.before.latch is not None:
            stopped[id(edge.after)] = edge.after
    assert stopped
    for state in stopped.values():
        for event in (ev.Safe(), ev.Done(Request.RESET), ev.Declined(Request.RESET, STILL_HOT)):
            after, actions = step(state, event)
            assert act.Ask(Request.RESET) not in actions
            assert after.latch is not None
            ends = {Phase.CHECKING_RETURN, Phase.FINISHING, Phase.ENDED, *TAKEN}
            assert after.phase is state.phase or after.phase in ends


def test_what_the_matrix_allows_never_changes_and_a_withdrawn_restart_stays_withdrawn(edges: list[Edge]) -> None:
    for edge in edges:
        assert edge.after.retries == edge.before.retries
        assert edge.after.restart_withdrawn or not edge.before.restart_withdrawn
        if edge.after.restart_withdrawn:
            assert not moving(edge)
            assert not edge.after.recording or edge.after.latch is not None


def test_every_fault_or_abort_of_an_armed_rig_latches_or_ends(edges: list[Edge]) -> None:
    for edge in edges:
        if isinstance(edge.event, ev.Fault | ev.Abort | ev.Tripped) and edge.before.armed:
            stopping = {Phase.STOPPING, Phase.COOLING_DOWN, Phase.RESETTING, Phase.FINISHING, Phase.ENDED}
            assert edge.after.phase in stopping
            assert edge.after.latch is not None or edge.before.phase is Phase.ENDED


def test_the_station_is_requested_to_stop_at_once_when_the_application_sees_the_fault(edges: list[Edge]) -> None:
    for edge in edges:
        if not isinstance(edge.event, ev.Fault | ev.Abort) or not edge.before.armed or edge.before.latch is not None:
            continue
        if edge.before.phase in {Phase.FINISHING, Phase.ENDED}:
            continue
        orders = [action for action in edge.actions if not isinstance(action, act.Deadline | act.Note)]
        assert orders == [act.Stop(edge.event.stop, edge.event.cause)]


def test_a_valid_recording_never_contains_a_fault(edges: list[Edge]) -> None:
    ended = [(edge, action) for edge in edges for action in edge.actions if isinstance(action, act.EndRecording)]
    assert ended
    for edge, action in ended:
        if action.fault is None:
            assert isinstance(edge.event, ev.ProgramEnded | ev.RestOver)
            assert edge.before.latch is None
            assert edge.before.spoiled is None


def test_recordings_begin_and_end_in_turn(edges: list[Edge]) -> None:
    for edge in edges:
        failed = isinstance(edge.event, ev.ActionFailed) and isinstance(edge.event.action, act.BeginRecording)
        opened = edge.before.recording and not failed
        for action in edge.actions:
            if isinstance(action, act.BeginRecording):
                assert not opened
                opened = True
            elif isinstance(action, act.EndRecording | act.DropRecording):
                assert opened
                opened = False
        assert opened == edge.after.recording
        assert not (edge.after.phase is Phase.ENDED and edge.after.recording)


def test_an_attempt_never_writes_over_another(edges: list[Edge]) -> None:
    for edge in edges:
        for action in edge.actions:
            if isinstance(action, act.BeginRecording):
                assert action.attempt == edge.before.attempts.count(action.point.id) + 1
                assert action.attempt <= edge.before.retries + 1


def test_current_flows_only_where_the_rig_may_move(edges: list[Edge]) -> None:
    for edge in edges:
        for action in edge.actions:
            stated = isinstance(edge.event, ev.OperatorAnswered)  # set by hand already, the pressure off
            if isinstance(action, act.SetCurrent) and action.current_A != 0.0 and not stated:
                assert edge.after.proved
                assert edge.after.powered
                assert edge.after.latch is None


def test_the_end_is_reported_once_and_absorbs_everything(edges: list[Edge]) -> None:
    for edge in edges:
        if edge.before.phase is Phase.ENDED:
            assert (edge.after, edge.actions) == (edge.before, ())
        assert (edge.after.phase is Phase.ENDED and edge.before.phase is not Phase.ENDED) == (
            act.Finish() in edge.actions
        )


def test_at_the_end_the_pressure_is_gone_or_a_stop_was_proved_or_the_rigs_state_is_unknown(edges: list[Edge]) -> None:
    for edge in edges:
        if edge.after.phase is Phase.ENDED and edge.after.pressurised:
            held = edge.after.stopped and edge.after.latch is not None
            left = edge.after.left_to_station
            assert held or left or edge.after.rig_state is RigState.UNKNOWN
            assert (act.LeaveToStation() in edge.actions) == (left and edge.before.phase is not Phase.ENDED)


def test_a_stop_counts_as_proved_only_by_the_stations_word_since_the_latch(edges: list[Edge]) -> None:
    for edge in edges:
        if edge.after.stopped and not edge.before.stopped:
            assert edge.event in PROOFS
            assert edge.before.latch is not None
        assert not edge.after.stopped or edge.after.latch is not None


def test_pressure_is_only_gone_when_a_disarm_or_a_stop_with_hydraulics_off_was_proved(edges: list[Edge]) -> None:
    gone = [edge for edge in edges if edge.before.pressurised and not edge.after.pressurised]
    assert gone
    for edge in gone:
        latch = edge.before.latch
        requested = edge.event == ev.Done(Request.STOP) and latch is not None and latch.stop is StopKind.PRESSURE_OFF
        stopped = requested or edge.event == ev.Safe(StopKind.PRESSURE_OFF)
        yielded = edge.before.phase is Phase.YIELDING and edge.event == ev.Done(Request.HYDRAULICS_OFF)
        assert stopped or yielded or edge.event == ev.Done(Request.DISARM)


def test_a_pressure_that_a_stop_promised_to_take_away_and_that_may_be_on_is_no_safe_end(edges: list[Edge]) -> None:
    """The stop that the station proved may be another (S2) than the one that was latched here (S1)."""
    ends = [edge for edge in edges if edge.after.phase is Phase.ENDED and edge.after.pressurised]
    promised = [
        edge.after for edge in ends if edge.after.latch is not None and edge.after.latch.stop is StopKind.PRESSURE_OFF
    ]
    assert promised
    for state in promised:
        assert state.left_to_station or state.rig_state is RigState.UNKNOWN


MOVED = replace(start_state(POINTS, 1), phase=Phase.ENDED, armed=True, pressurised=True, powered=True, moved=True)
S2, S1 = (replace(MOVED, latch=Latch(stop, FINAL)) for stop in (StopKind.FADE_OUT, StopKind.PRESSURE_OFF))
LEFT = replace(S2, left_to_station=True)
HELD = replace(S2, stopped=True)
NEVER = replace(S2, moved=False, pressurised=False, powered=False, left_to_station=True)


@pytest.mark.parametrize(
    ("state", "ended", "safe", "at_rest", "known"),
    [
        (LEFT, True, True, True, RigState.SAFE),
        (LEFT, True, False, False, RigState.UNKNOWN),  # its exit code is no proof: it may have had nothing armed
        (LEFT, False, True, True, RigState.UNKNOWN),
        (LEFT, False, False, False, RigState.UNKNOWN),  # it stands still: SIGSTOP
        (NEVER, True, False, False, RigState.SAFE),
        (NEVER, False, False, False, RigState.UNKNOWN),
        (HELD, False, True, True, RigState.SAFE),  # proved before, holds under pressure as it promised
        (HELD, False, False, True, RigState.SAFE),  # only the pressure cannot be taken away
        (HELD, False, False, False, RigState.UNKNOWN),  # moved again, or its current came back
        (replace(S1, stopped=True), False, True, True, RigState.UNKNOWN),  # it promised to take the pressure away
        (replace(S1, stopped=True), True, True, True, RigState.SAFE),
        (replace(HELD, rig_state=RigState.UNKNOWN), True, True, True, RigState.SAFE),  # the pressure went late
        (replace(LEFT, rig_state=RigState.UNKNOWN), True, True, True, RigState.UNKNOWN),
    ],
)
def test_a_rig_left_to_its_station_is_safe_by_what_the_station_proved(
    state: State, ended: bool, safe: bool, at_rest: bool, known: RigState
) -> None:
    assert after_station(state, ended=ended, safe=safe, at_rest=at_rest).rig_state is known


def test_every_state_can_still_reach_the_end(explored: Explored) -> None:
    sources: dict[int, set[int]] = {}
    for edge in explored.edges:
        sources.setdefault(id(edge.after), set()).add(id(edge.before))
    reaching = {id(state) for state in explored.states if state.phase is Phase.ENDED}
    waiting = deque(reaching)
    while waiting:
        for state in sources.get(waiting.popleft(), set()) - reaching:
            reaching.add(state)
            waiting.append(state)
    assert reaching == set(map(id, explored.states))


def test_every_phase_begins_with_a_deadline(edges: list[Edge]) -> None:
    entered = [edge for edge in edges if edge.after.phase not in {edge.before.phase, Phase.ENDED}]
    assert entered
    for edge in entered:
        limits = [action for action in edge.actions if isinstance(action, act.Deadline)]
        assert [limit.phase for limit in limits] == [edge.after.phase]
        assert 0.0 < limits[0].device_s + limits[0].wall_s < float("inf")


def test_deadlines_alone_end_every_campaign_at_rest_or_left_to_its_station(explored: Explored) -> None:
    ended: set[State] = set()
    for state in (state for state in explored.states if state.phase is not Phase.NEW):
        passed = [state]
        while passed[-1] not in ended and passed[-1].phase is not Phase.ENDED:
            passed.append(step(passed[-1], ev.TimedOut(passed[-1].phase))[0])
            assert len(passed) < 60, state
        ended.update(passed)
        last = passed[-1]
        if last.phase is Phase.ENDED:
            proved = not last.pressurised or last.stopped
            assert proved or last.left_to_station or last.rig_state is RigState.UNKNOWN, state


def test_the_operator_is_obeyed_in_every_phase(explored: Explored) -> None:
    for state in explored.states:
        after, actions = step(state, ev.Abort(StopKind.PRESSURE_OFF, StopCause("sigterm")))
        ending = {Phase.STOPPING, Phase.RESETTING, Phase.FINISHING, Phase.ENDED, *TAKEN}
        assert after.phase in ending
        assert not any(act.energises(action) for action in actions)


def test_an_action_that_fails_stops_the_rig_and_energises_nothing(edges: list[Edge]) -> None:
    failed = [edge for edge in edges if isinstance(edge.event, ev.ActionFailed)]
    assert {type(edge.event.action) for edge in failed if isinstance(edge.event, ev.ActionFailed)} >= {
        act.Ask, act.Move, act.SetCurrent, act.Start, act.Stop, act.WatchZeros, act.ProveSensors, act.AwaitStandstill,
        act.BeginRecording, act.EndRecording, act.Deadline, act.Note,
    }
    for edge in failed:
        assert not any(act.energises(action) for action in edge.actions)
        if edge.before.phase is not Phase.ENDED:
            ending = {Phase.STOPPING, Phase.RESETTING, Phase.CHECKING_RETURN, Phase.FINISHING, Phase.ENDED, *TAKEN}
            assert edge.after.phase in ending
            assert edge.after.latch is not None or edge.after.refused is not None or edge.before.phase in ending


def test_what_fails_before_its_stop_is_requested_is_left_to_the_station(edges: list[Edge]) -> None:
    essential = act.Stop | act.Deadline
    lost = [
        edge for edge in edges
        if isinstance(edge.event, ev.ActionFailed) and isinstance(edge.event.action, essential)
        and edge.before.armed and edge.before.phase is Phase.STOPPING and edge.event.phase == Phase.STOPPING
    ]
    assert lost
    for edge in lost:
        assert edge.after.left_to_station
        assert edge.actions[0] == act.LeaveToStation()


def test_a_refusal_before_motion_names_its_cause_and_stops_nothing_that_never_moved(edges: list[Edge]) -> None:
    refused = [edge for edge in edges if edge.before.refused is None and edge.after.refused is not None]
    assert refused
    for edge in refused:
        assert not edge.before.moved
        assert edge.after.phase in {Phase.FINISHING, Phase.ENDED, *TAKEN}


def answers(state: State) -> Iterator[ev.Event]:
    """What a healthy rig reports, phase by phase."""
    request = {
        Phase.CONNECTING: Request.CONNECT,
        Phase.ARMING: Request.ARM,
        Phase.PROVING_WATCHDOG: Request.STARVE_WATCHDOG,
        Phase.PRESSURE_LOW: Request.HYDRAULICS_LOW,
        Phase.PRESSURE_ON: Request.HYDRAULICS_ON,
        Phase.RESETTING: Request.RESET,
        Phase.FINISHING: Request.DISARM,
    }
    reports: dict[Phase, ev.Event] = {
        Phase.NEW: ev.Begin(),
        Phase.CHECKING_ZEROS: ev.ZerosJudged(None),
        Phase.PROVING_SENSORS: ev.ProofJudged(None),
        Phase.CENTRING: ev.Centred(),
        Phase.SETTLING: ev.CurrentSettled(),
        Phase.RUNNING: ev.ProgramEnded(at_centre=True),
        Phase.CLEARING: ev.CurrentSettled(),
        Phase.RESTING: ev.RestOver(),
        Phase.COOLING_DOWN: ev.RestOver(),
        Phase.STANDING: ev.Standstill(),
        Phase.CHECKING_RETURN: ev.ZerosReturned(),
        Phase.STOPPING: ev.Safe(),
        Phase.PAUSED: ev.ResumeAsked(),
    }
    if state.phase in request:
        yield ev.Done(request[state.phase])
    elif state.phase is Phase.EVALUATING:
        yield ev.Judged(state.unjudged[0], valid=True)
    else:
        yield reports[state.phase]


def play(state: State, until: Phase = Phase.ENDED) -> tuple[State, list[Action]]:
    done: list[Action] = []
    while state.phase is not until:
        for event in answers(state):
            state, actions = step(state, event)
            done += actions
    return state, done


def test_a_healthy_campaign_runs_every_point_once_and_ends_safe() -> None:
    state, actions = play(start_state(POINTS, 0))
    ended = [action for action in actions if isinstance(action, act.EndRecording)]
    assert [(action.point.id, action.attempt, action.fault) for action in ended] == [
        ("p001", 1, None),
        ("p002", 1, None),
    ]
    assert [action.target_m for action in actions if isinstance(action, act.Move)] == [0.0, 0.005]
    assert [action.current_A for action in actions if isinstance(action, act.SetCurrent)] == [0.5, 0.0, 0.0, 0.0]
    assert [action.rest_s for action in actions if isinstance(action, act.Rest)] == [1.0]
    assert (state.rig_state, state.latch, state.queue) == (RigState.SAFE, None, ())


def test_a_held_centre_is_not_approached_again() -> None:
    points = (POINTS[0], replace(POINTS[1], centre_m=0.0))
    _, actions = play(start_state(points, 0))
    assert len([action for action in actions if isinstance(action, act.Move)]) == 1


def test_a_restartable_trip_repeats_the_point_as_another_attempt_and_keeps_the_broken_one_invalid() -> None:
    state, _ = play(start_state(POINTS, 1), until=Phase.RUNNING)
    state, _ = step(state, ev.Tripped(StopKind.FADE_OUT, RESTARTABLE))
    state, actions = play(state)
    ended = [action for action in actions if isinstance(action, act.EndRecording)]
    assert [(action.point.id, action.attempt, action.fault) for action in ended] == [
        ("p001", 1, RESTARTABLE),
        ("p001", 2, None),
        ("p002", 1, None),
    ]
    assert state.latch is None


def test_a_hot_ecu_is_queried_again_until_it_has_cooled_down_and_then_the_point_is_repeated() -> None:
    state, _ = play(start_state(POINTS, 1, Conditions(longest_s=3 * COOLING_PAUSE_S)), until=Phase.RUNNING)
    state, _ = step(state, ev.Tripped(StopKind.FADE_OUT, HOT))
    state, actions = step(state, ev.Safe())
    for waited in (1, 2):
        assert state.phase is Phase.COOLING_DOWN
        assert act.Rest(COOLING_PAUSE_S) in actions
        assert state.cooled_s == waited * COOLING_PAUSE_S
        state, _ = step(state, ev.RestOver())
        state, actions = step(state, ev.Declined(Request.RESET, STILL_HOT))
    state, actions = play(state)
    assert [action.point.id for action in actions if isinstance(action, act.BeginRecording)] == ["p001", "p002"]


@pytest.mark.parametrize("refusal", [STILL_HOT, StopCause("estop", "chain open")], ids=["still-hot", "something-else"])
def test_an_ecu_that_stays_hot_or_is_not_all_that_is_wrong_ends_the_campaign(refusal: StopCause) -> None:
    state, _ = play(start_state(POINTS, 1, Conditions(longest_s=COOLING_PAUSE_S)), until=Phase.RUNNING)
    state, _ = step(state, ev.Tripped(StopKind.FADE_OUT, HOT))
    state, _ = play(state, until=Phase.RESETTING)
    state, _ = step(state, ev.Declined(Request.RESET, refusal))
    state, actions = play(state)
    assert not any(isinstance(action, act.BeginRecording) for action in actions)
    assert state.latch is not None
    assert state.latch.cause == HOT


def test_a_trip_right_after_the_stations_reset_is_a_stop_of_its_own_although_the_answer_comes_later() -> None:
    state, _ = play(start_state(POINTS, 2), until=Phase.RUNNING)
    state, _ = step(state, ev.Tripped(StopKind.FADE_OUT, RESTARTABLE))
    state, _ = play(state, until=Phase.RESETTING)
    state, _ = step(state, ev.Tripped(StopKind.FADE_OUT, RESTARTABLE))
    state, actions = step(state, ev.Done(Request.RESET))
    assert (state.phase, actions) == (Phase.STOPPING, ()), "the answer belongs to the reset before"
    state, actions = play(state)
    assert actions.count(act.Ask(Request.RESET)) == 1
    assert [action.attempt for action in actions if isinstance(action, act.BeginRecording)] == [3, 1]


def test_a_station_that_stands_safely_already_answers_the_stop_with_its_proof() -> None:
    state, _ = play(start_state(POINTS, 0), until=Phase.RUNNING)
    state, _ = step(state, ev.Fault(StopKind.FADE_OUT, FINAL))
    state, _ = step(state, ev.Done(Request.STOP))
    state, _ = play(state)
    assert (state.rig_state, state.pressurised) == (RigState.SAFE, False)


@pytest.mark.parametrize(
    ("slug", "known"),
    [("hydraulics", RigState.UNKNOWN), ("controller-refused", RigState.UNKNOWN), ("modbus-reject", RigState.SAFE)],
)
def test_a_pressure_that_stays_after_its_order_was_taken_is_no_safe_end(slug: str, known: RigState) -> None:
    state, _ = play(start_state(POINTS, 0), until=Phase.RUNNING)
    state, _ = step(state, ev.Tripped(StopKind.FADE_OUT, FINAL))
    state, _ = play(state, until=Phase.FINISHING)
    state, actions = step(state, ev.Declined(Request.DISARM, StopCause(slug, "level off not reached within 10 s")))
    assert (state.phase, state.rig_state, state.pressurised) == (Phase.ENDED, known, True)
    assert any(isinstance(action, act.Note) and action.level == "error" for action in actions)


@pytest.mark.parametrize(
    ("stop", "cause"), [(StopKind.PRESSURE_OFF, RESTARTABLE), (StopKind.HALT, RESTARTABLE), (StopKind.FADE_OUT, FINAL)]
)
def test_nothing_restarts_by_itself_after_a_harder_stop_or_another_cause(stop: StopKind, cause: StopCause) -> None:
    state, _ = play(start_state(POINTS, 2), until=Phase.RUNNING)
    state, _ = step(state, ev.Tripped(stop, cause))
    state, actions = play(state)
    assert act.Ask(Request.RESET) not in actions
    assert state.latch is not None
    assert state.latch.cause == cause


def test_a_bad_verdict_repeats_the_point_at_the_end_of_the_queue() -> None:
    state, _ = play(start_state(POINTS, 1), until=Phase.RESTING)
    state, _ = step(state, ev.Judged("p001", valid=False))
    _, actions = play(state)
    assert [action.point.id for action in actions if isinstance(action, act.BeginRecording)] == ["p002", "p001"]


def test_a_current_that_never_settles_costs_the_point_and_not_the_campaign() -> None:
    state, _ = play(start_state(POINTS, 0), until=Phase.SETTLING)
    state, actions = step(state, ev.TimedOut(Phase.SETTLING))
    assert [action.cause.slug for action in actions if isinstance(action, act.GiveUpPoint)] == ["current-tracking"]
    state, actions = play(state)
    assert [action.point.id for action in actions if isinstance(action, act.BeginRecording)] == ["p002"]


def test_a_pause_waits_for_the_running_point() -> None:
    state, _ = play(start_state(POINTS, 0), until=Phase.RUNNING)
    state, actions = step(state, ev.PauseAsked())
    assert (state.phase, actions) == (Phase.RUNNING, ())
    state, actions = play(state, until=Phase.PAUSED)
    assert not any(isinstance(action, act.BeginRecording) for action in actions)
    state, actions = play(state)
    assert [action.point.id for action in actions if isinstance(action, act.BeginRecording)] == ["p002"]


@pytest.mark.parametrize(
    ("points", "retries"), [((), 0), ((POINTS[0], POINTS[0]), 0), (POINTS, 3), (POINTS, -1)], ids=str
)
def test_nonsense_is_not_a_campaign(points: tuple[TestPoint, ...], retries: int) -> None:
    with pytest.raises(ValueError, match="expected"):
        start_state(points, retries)


@pytest.mark.parametrize(
    "event",
    [ev.Abort(StopKind.FADE_OUT, StopCause("sigint")), ev.Fault(StopKind.FADE_OUT, StopCause("disk-full"))],
    ids=str,
)
def test_an_operator_or_a_fault_ends_a_restart_under_way(event: ev.Event) -> None:
    state, _ = play(start_state(POINTS, 1), until=Phase.RUNNING)
    state, _ = step(state, ev.Tripped(StopKind.FADE_OUT, RESTARTABLE))
    state, _ = play(state, until=Phase.RESETTING)
    state, _ = step(state, event)
    state, actions = play(state)
    assert not any(isinstance(action, act.BeginRecording) for action in actions)
    assert state.latch is not None


def test_a_journal_that_cannot_be_opened_stops_the_rig_and_the_end_is_reached() -> None:
    state, _ = play(start_state(POINTS, 0), until=Phase.SETTLING)
    state, actions = step(state, ev.CurrentSettled())
    begin = next(action for action in actions if isinstance(action, act.BeginRecording))
    state, actions = step(state, ev.ActionFailed(begin, state.phase, FULL))
    assert act.Stop(StopKind.FADE_OUT, FULL) in actions
    state, actions = play(state)
    assert not any(isinstance(action, act.EndRecording) for action in actions)
    assert act.Ask(Request.DISARM) in actions
    assert (state.rig_state, state.pressurised, state.armed) == (RigState.SAFE, False, False)
    assert state.latch is not None
    assert state.latch.cause == FULL


@pytest.mark.parametrize("phase", [Phase.RUNNING])
def test_a_program_that_somebody_else_ended_stops_the_campaign_as_a_second_master(phase: Phase) -> None:
    state, _ = play(start_state(POINTS, 2), until=phase)
    state, actions = step(state, ev.ProgramEnded(at_centre=True, cut_short="3 of 5 requested cycles completed"))
    assert [action.cause.slug for action in actions if isinstance(action, act.Stop)] == ["second-master"]
    state, actions = play(state)
    assert [action.fault.slug for action in actions if isinstance(action, act.EndRecording)] == ["second-master"]
    assert not any(isinstance(action, act.MOTION_ACTIONS) for action in actions)
    assert state.latch is not None


def test_at_the_end_the_zeros_are_checked_again_before_the_pressure_goes() -> None:
    _, actions = play(start_state(POINTS, 0))
    again, off = actions.index(act.WatchZeros(again=True)), actions.index(act.Ask(Request.DISARM))
    assert again < off


@pytest.mark.parametrize(
    ("stop", "checked"), [(StopKind.FADE_OUT, True), (StopKind.PRESSURE_OFF, False), (StopKind.HALT, False)]
)
def test_after_a_stop_the_zeros_are_only_checked_where_the_rod_is_held(stop: StopKind, checked: bool) -> None:
    state, _ = play(start_state(POINTS, 0), until=Phase.RUNNING)
    state, _ = step(state, ev.Tripped(stop, FINAL))
    _, actions = play(state)
    assert (act.WatchZeros(again=True) in actions) is checked


def test_zeros_that_do_not_come_keep_nobody_from_taking_the_pressure_away() -> None:
    state, _ = play(start_state(POINTS, 0), until=Phase.CHECKING_RETURN)
    for event in (ev.TimedOut(Phase.CHECKING_RETURN), ev.ActionFailed(act.WatchZeros(again=True), state.phase, FULL)):
        after, actions = step(state, event)
        assert after.phase is Phase.FINISHING
        assert act.Ask(Request.DISARM) in actions


# By hand


@pytest.fixture
def by_hand() -> list[Edge]:
    return explore("by-hand").edges


def test_an_operator_who_does_not_answer_stops_or_refuses(by_hand: list[Edge]) -> None:
    asking = [edge for edge in by_hand if edge.before.phase is Phase.ASKING]
    overdue = [edge for edge in asking if edge.event == ev.TimedOut(Phase.ASKING)]
    assert {edge.before.armed for edge in overdue} == {True, False}
    for edge in overdue:
        cause = edge.after.refused or (None if edge.after.latch is None else edge.after.latch.cause)
        assert cause is not None
        assert cause.slug == "by-hand-unanswered"


def test_nothing_has_pressure_or_moves_while_somebody_is_at_the_supply(by_hand: list[Edge]) -> None:
    for edge in by_hand:
        if edge.after.phase is Phase.ASKING:
            assert not edge.after.powered
            assert not edge.after.pressurised
            assert not any(act.energises(action) for action in edge.actions)


def test_points_run_at_what_was_confirmed_only(by_hand: list[Edge]) -> None:
    started = [edge for edge in by_hand if any(isinstance(action, act.Start) for action in edge.actions)]
    assert started
    for edge in started:
        assert edge.after.requested_A is None
        assert edge.after.hand_A == edge.after.point.first_current_A


def test_it_never_ends_as_safe_while_the_current_may_flow(by_hand: list[Edge]) -> None:
    ended = [edge.after for edge in by_hand if edge.after.phase is Phase.ENDED]
    assert ended
    assert any(state.hand_flows for state in ended)
    assert all(state.rig_state is RigState.UNKNOWN for state in ended if state.hand_flows)


def test_the_station_receives_only_what_the_operator_stated(by_hand: list[Edge]) -> None:
    for edge in by_hand:
        for action in edge.actions:
            if isinstance(action, act.SetCurrent):
                stated = edge.before.requested_A if isinstance(edge.event, ev.OperatorAnswered) else edge.after.hand_A
                assert action.current_A == stated


def test_a_signal_is_iterated_and_only_its_final_command_is_recorded() -> None:
    state = start_state((SIGNAL,), 0, Conditions(iteration=IterationSettings()))
    arrived = [ev.Begin(), ev.Done(Request.CONNECT), ev.ZerosJudged(None), ev.Done(Request.ARM),
               ev.Done(Request.STARVE_WATCHDOG), ev.Done(Request.HYDRAULICS_LOW), ev.Done(Request.HYDRAULICS_ON),
               ev.ProofJudged(None)]
    drives = (IDENTIFYING, CORRECTED, replace(CORRECTED, outcome="limit", cannot="valve"))
    started: list[TestPoint] = []
    recorded: list[Action] = []
    run: list[ev.Event] = [ev.Centred(), ev.CurrentSettled(), ev.ProgramEnded(at_centre=True)]
    trials = [event for drive in drives for event in (ev.Iterated("p001", drive), *run)]
    for event in (*arrived, *trials):
        state, actions = step(state, event)
        started += [action.point for action in actions if isinstance(action, act.Start)]
        recorded += [action for action in actions if isinstance(action, act.BeginRecording | act.EndRecording)]
        if isinstance(event, ev.ProgramEnded) and len(started) < 3:
            assert state.phase is Phase.CORRECTING
    assert [point.record_samples and point.record_samples.name for point in started] == ["noise", "sweep", "sweep"]
    assert [point.target for point in started] == [None, SWEEP, SWEEP]
    assert [type(action) for action in recorded] == [act.BeginRecording, act.EndRecording]
    assert actions[0] == act.Remark("iteration", "valve"), "the best command is recorded, and why it is not better"
