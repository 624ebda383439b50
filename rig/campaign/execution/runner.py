"""The application's loop: reports of the rig become events, the sequencer's actions are executed.

One turn every few milliseconds: heartbeat, collect events, step, act. A turn never waits for the rig; requests are
answered on separate threads, samples are recorded on the recorder's thread, files are written by the finaliser's
process. Events of one turn are processed in this order: signals, station, answers, facts, verdicts, faults, deadlines;
so a trip is always known before the answer or the fact that arrived with it. Conclusions of this program itself
(another master's stop, a loose load train, a missing answer) wait until all messages of the station are read: after a
pause of this process, samples and its own clock are processed first.
"""

from __future__ import annotations

import math
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Set
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from drivers.clock import back_whenever, back_within
from drivers.ring import Channel
from rig.campaign.execution.action_executor import ActionExecutor, Outcome
from rig.campaign.execution.campaign_context import CampaignContext
from rig.campaign.execution.drive_calculation import stored_drives
from rig.campaign.execution.loop_watch import LoopWatch, TurnClock
from rig.campaign.execution.observer import LIVE
from rig.campaign.operator_link import Signals
from rig.campaign.preflight.proof_move import Baseline
from rig.campaign.results import RigState
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer import stopping
from rig.campaign.sequencer.action import Request
from rig.campaign.sequencer.state import Latch, Phase, State, campaign_state
from rig.campaign.sequencer.step import step
from rig.campaign.stop_cause import CURRENT_FLOWS, SPOIL, StopCause, because, cause_of, disk_slug
from rig.campaign.words import say
from rig.campaign_folder import CampaignFolder
from rig.clock import WallClockWatch, monotonic_ns
from rig.faults.row import StopKind
from rig.recording.conversion.finaliser import Finaliser
from rig.recording.journal.ring_reader import RecordBlock, RingReader
from rig.signals.iteration_time import trials_s
from rig.station.client import StationLost
from rig.station.safe_stop import ZERO_CURRENT_A
from rig.test_point import SIGNAL

TURN_S = 0.002
BEAT_NS = 40_000_000
PROGRESS_NS = 100_000_000
STALE_HEARTBEATS = 2.0
STATION_ENDS_S = 30.0
MOST_FAILURES = 10
"""So many failed turns of the loop after the first one, and the rig is left to its station."""
WITHOUT_HYDRAULICS = "actuator-without-hydraulics"
"""What the station reports at connect where there is no pressure that it could take away."""
LINK_ENDED = "sigkill"
"""What the station calls the end of its link; to the program that ended it that is no news."""
SETPOINTS_LATE = "setpoints-late"
OF_MOTION = frozenset({"speed-limit", "stroke-limit", "force-limit", "setpoints-lost", "controller-trip"})
"""Stops whose cause may be set-points that were omitted."""
SLOW_MOVES = frozenset({Phase.CENTRING, Phase.PROVING_SENSORS})

Given = TypeVar("Given")


class Runner:
    """Runs one campaign to its end. Made once the station process is up.

    Args:
        campaign: what the campaign works with.
        signals: the operator's signals.
        finaliser: the process that writes the points' files.
        baseline: what the campaign's first session found.
    """

    def __init__(
        self, campaign: CampaignContext, signals: Signals, finaliser: Finaliser, baseline: Baseline
    ) -> None:
        points = tuple(item.point for item in campaign.plan.points)
        remaining = {point.id: point for point in campaign.stock.remaining}
        queue = tuple(remaining[point.id] for point in points if point.id in remaining)
        self.state = campaign_state(queue, campaign.matrix, campaign.bench, stored_drives(campaign))
        self._campaign = campaign
        self._signals = signals
        self._finaliser = finaliser
        self._executor = ActionExecutor(campaign, finaliser, baseline)
        self.zeros = self._executor.zeros
        self._ring: RingReader | None = None
        self._waiting: deque[ev.Event] = deque()
        self._reported: set[str] = set()
        self._failures = 0
        self.current_zero = False
        """The station's last proof of standstill proved 0 A, too."""
        self.standstill = False
        """Standstill was proved at the end of the station's last stop."""
        self.pressure = ""
        """What was seen of the pressure then; empty: nothing."""
        self.current_timeout_s: float | None = None
        """Own time-out of a current source that was silent then, and that has passed; None: measured, or none (s)."""
        self.current_left_A: float | None = None
        """Current that the last measurement shows, too large for 0 A (A); None: 0 A, or not measured."""
        self.safe = False
        """The station's last stop ended in proof: its last word is `safe`, not `trip` or `unknown`."""
        self._at_rest = False
        """Standstill and 0 A of a proved stop were not lost afterwards, whatever became of the pressure."""
        self.without_hydraulics = False
        """The actuator has no pressure (or power) that could be taken away."""
        self.stop_causes: set[str] = set()
        """Slugs of everything that stopped the rig in this session, first causes and later ones."""
        self._disturbed = ""
        """What kept this computer from streaming the motion that runs, or ran last; empty: nothing."""
        self._beat_ns = self._progress_ns = 0
        self._turns = TurnClock(campaign.config.heartbeat_timeout_s)
        self._recorder_well = True
        self._wall_clock = WallClockWatch()
        self._trials_left: tuple[object, object, float] = None, None, 0.0
        """Queue and drives of the last calculation, and its result (s)."""

    @property
    def ended_by(self) -> Set[int]:
        """Controller states in which the last motion was ended: FADING, HALTING; empty where it ended by itself."""
        return self._executor.observer.ended_by

    def run(self) -> State:
        """Run until the sequencer has ended and every recorded point is judged; returns the last state.

        A failure of this loop itself stops the rig like any other fault; when it goes on failing, or stands still, the
        station's link is closed, and the station stops the rig by itself.
        """
        self._waiting.extend(self._signals.beginning())
        watch = LoopWatch(lambda: self._campaign.client.close(0.0))
        try:
            while self.state.phase is not Phase.ENDED:
                self._guarded_turn()
                watch.turned()
            back_whenever()
            watch.end()
            if self.state.armed:
                self._leave_to_the_station()
            measured_A = self._measured_left_A()
            self.current_left_A = self.current_left_A if measured_A is None else measured_A
            abort = self._executor.recording.collect(self._signals)
            if abort is not None:
                self.state = replace(self.state, latch=self.state.latch or Latch(abort.stop, abort.cause))
            self._campaign.display.phase(str(Phase.ENDED))
        finally:
            back_whenever()
            watch.end()
            self._executor.close()
            if self._ring is not None:
                self._ring.close()
        return self.state

    def _leave_to_the_station(self) -> None:
        """A rig that could not be disarmed is shut down by its station now, before any wait for a disk.

        Its last words are heard to the end: what it proved is in its `safe`, not in its exit code, which is 0 also
        where it had nothing to prove. A stop that was proved before, and promised to hold under pressure, stays proved
        although the pressure may still be on; the operator was told.
        """
        code = self._campaign.client.close(STATION_ENDS_S)
        heard = self._campaign.client.heard()
        self._events_of(message for message in heard if message.get("slug") != LINK_ENDED)
        self._campaign.log.note("station", what="ended", exit_code=code)
        self.state = after_station(self.state, ended=code == 0, safe=self.safe, at_rest=self._at_rest)

    def _measured_left_A(self) -> float | None:
        """The current that still flows, by the station's newest samples of it; None: 0 A, or not measured."""
        ecu = self._campaign.bench.ecu
        if self._ring is None or not ecu.measured:
            return None
        observer = self._executor.observer
        observer.observe(RecordBlock(self._ring.read()))
        return observer.current_left_A(self._ring.writer_heartbeat_ns - int(1e9 * ecu.silent_after_s))

    def _guarded_turn(self) -> None:
        try:
            self._turn()
        except Exception as error:  # noqa: BLE001 - the last resort of the loop stops the rig
            self._failures += 1
            self._report_failure("the campaign's loop", error)
            cause = because("task-dies", "said", text=_named(error))
            if self._failures == 1:
                self._waiting.appendleft(ev.Fault(StopKind.FADE_OUT, cause))
            elif self._failures > MOST_FAILURES:
                self.state, actions = stopping.leave_to_station(self.state, cause)
                self._carry_out(actions)

    def _report_failure(self, what: str, error: Exception) -> None:
        self._campaign.log.note("error", text=f"{what} failed: {_named(error)}", trace=traceback.format_exc())

    def _collected(self, what: str, source: Callable[[], Iterable[Given]]) -> list[Given]:
        """What a source of events gives; one that fails stops the rig, and the others still count."""
        try:
            return list(source())
        except Exception as error:  # noqa: BLE001 - one source that fails must not hide the others
            if what not in self._reported:
                self._reported.add(what)
                self._report_failure(what, error)
                cause = because("task-dies", "said", text=f"{what}: {_named(error)}")
                self._waiting.append(ev.Fault(StopKind.FADE_OUT, cause))
            return []

    def _turn(self) -> None:
        self._beat()
        self._gather()
        while self._waiting and self.state.phase is not Phase.ENDED:
            self._take(self._waiting.popleft())
        self._show_progress()
        if self.state.phase is not Phase.ENDED:
            self._waiting.extend(self._station_events(TURN_S))

    def _gather(self) -> None:
        """Collect what happened since the last turn, in the order in which it is to be taken."""
        facts = self._collected("the samples", self._facts)
        outcomes, overdue = self._executor.outcomes()
        if overdue:
            self._hear_the_station()
        self._waiting.extend(self._signals.take())
        self._waiting.extend(self._station_events(0.0))
        self._waiting.extend(self._collected("the station's answers", partial(self._answered, outcomes)))
        self._waiting.extend(self._collected("the next command", self._executor.next_commands))
        self._waiting.extend(self._collected("the terminal", self._executor.operator_answers))
        self._waiting.extend(facts)
        verdicts = partial(self._executor.recording.verdicts, self.state.attempts)
        self._waiting.extend(self._collected("the verdicts", verdicts))
        self._look_for_faults()
        self._waiting.extend(overdue)

    def _facts(self) -> list[ev.Event]:
        fact = None if self._ring is None else self._observe(RecordBlock(self._ring.read()))
        if isinstance(fact, ev.ProgramEnded) and fact.cut_short:
            self._hear_the_station()
        return [] if fact is None else [fact]

    def _hear_the_station(self) -> None:
        """Take all that the station has said until now before what comes next."""
        self._waiting.extend(self._events_of(self._campaign.client.heard()))

    def _take(self, event: ev.Event) -> None:
        before = self.state.phase
        if isinstance(event, ev.PauseAsked | ev.ResumeAsked):
            self._report_pause(event)
        self.state, actions = step(self.state, event)
        if self.state.phase is not before:
            self._campaign.log.note("phase", phase=str(self.state.phase), after=type(event).__name__)
            if self.state.phase is not Phase.ENDED:
                self._campaign.display.phase(str(self.state.phase))
        self._carry_out(actions)

    def _carry_out(self, actions: Iterable[act.Action]) -> None:
        """Do everything a step wants; what raises becomes the next event, and nothing is energised after it."""
        failed: list[ev.Event] = []
        for action in actions:
            if failed and act.energises(action):
                continue
            try:
                self._executor.carry_out(action)
            except Exception as error:  # noqa: BLE001 - whatever an action raises is an event
                self._report_failure(type(action).__name__, error)
                failed.append(ev.ActionFailed(action, self.state.phase, cause_of(error)))
        self._waiting.extendleft(reversed(failed))

    def _report_pause(self, event: ev.PauseAsked | ev.ResumeAsked) -> None:
        pauses = isinstance(event, ev.PauseAsked)
        text = say("pause-asked" if pauses else "pause-over")
        self._campaign.log.note("info", text=text)
        self._campaign.display.message("info", text)

    def _station_events(self, timeout_s: float) -> list[ev.Event]:
        events = self._events_of(self._campaign.client.events(timeout_s=timeout_s))
        if not self._campaign.client.alive and "gone" not in self._reported:
            self._reported.add("gone")
            events.append(
                ev.StationGone("the station process has ended; see station.log in the campaign folder")
            )
        return events

    def _events_of(self, messages: Iterable[dict[str, Any]]) -> list[ev.Event]:
        events: list[ev.Event] = []
        for message in messages:
            self._campaign.log.note("station", **{_KEYS.get(key, key): value for key, value in message.items()})
            events += self._collected(f"the station's {message.get('event')}", partial(self._translated, message))
        return events

    def _translated(self, message: dict[str, Any]) -> list[ev.Event]:
        name, detail = message.get("event"), str(message.get("detail", ""))
        if name in {"warning", "also"}:
            self._campaign.display.message("warning", f"{message.get('slug')}: {detail}")
        if name == "warning" and message.get("slug") == SETPOINTS_LATE and self.state.phase is Phase.RUNNING:
            self._disturbed = detail
        if name in {"trip", "also"} and message.get("slug") in OF_MOTION and self._disturbed:
            detail = f"{detail}; {self._disturbed}"
        if name == "trip":
            self._forget_proof()
        if name in {"trip", "also"}:
            self.stop_causes.add(slug := str(message["slug"]))
            self.current_zero = self.current_zero and slug not in CURRENT_FLOWS
            return [ev.Tripped(StopKind(message["stop"]), because(slug, "said", text=detail), name == "trip")]
        if name in {"safe", "unknown"}:
            return [self._end_of_stop(message)]
        if name == "setpoints":
            self._campaign.results.take_setpoints(message)
        if name == "late":
            late_ms, count = 1e3 * float(message["late_s"]), message.get("count")
            text = say("station-late", late_ms=late_ms, count=count)
            self._executor.carry_out(act.Remark("host-late", text))
        self.without_hydraulics |= message.get("slug") == WITHOUT_HYDRAULICS
        if name == "warning" and message.get("slug") in SPOIL:
            return [ev.Spoiled(because(str(message["slug"]), "said", text=detail))]
        return []

    def _forget_proof(self) -> None:
        """A stop begins, or was reset: what an earlier one proved says nothing of now."""
        self.standstill, self.current_zero, self.pressure = False, False, ""
        self.current_timeout_s = self.current_left_A = None
        self.safe = self._at_rest = False

    def _end_of_stop(self, message: dict[str, Any]) -> ev.Event:
        """What the station proved at the end of its stop, and what not."""
        current_zero = message.get("current_zero") is True
        self.safe = message.get("event") == "safe"
        self.standstill = message.get("standstill") is True
        self._at_rest = self.safe or (self._at_rest and self.standstill and (current_zero or not self.current_zero))
        self.current_zero = current_zero
        self.pressure = str(message.get("pressure") or "")
        self.current_left_A = message.get("current_left_A")
        silent = self.safe and not current_zero and message.get("current_A") is None
        self.current_timeout_s = message.get("current_timeout_s") if silent else None
        return ev.Safe(StopKind(message["stop"])) if self.safe else ev.Unknown(str(message.get("reason", "")))

    def _take_proof(self, outcome: Outcome) -> None:
        """A reset makes an earlier stop's proof void; a rig that was disarmed shows its current once more."""
        if outcome.error is None and outcome.request is Request.RESET:
            self._forget_proof()
        if outcome.error is None and outcome.request is Request.DISARM:
            current_A = outcome.answer.get("current_A")
            self.current_zero = self.current_zero or (current_A is not None and abs(current_A) < ZERO_CURRENT_A)

    def _answered(self, outcomes: Iterable[Outcome]) -> Iterator[ev.Event]:
        for outcome in outcomes:
            self._take_proof(outcome)
            yield self._executor.answered(outcome, moves=self.state.phase in SLOW_MOVES)
            if self._ring is None and self._executor.recording.recorder is not None:
                # What came while the devices were connected shows the rig at rest, too.
                self._ring = RingReader(Path(self._campaign.config.ring_path), earlier=True)

    def _look_for_faults(self) -> None:
        """What the application itself can see: a recorder or disk that refuses, data that stand still."""
        campaign, executor = self._campaign, self._executor
        if executor.recording.recorder is not None and not executor.recording.recorder.healthy:
            failure, text = executor.recording.recorder.failure, executor.recording.recorder.error
            self._fault_once(because("task-dies" if failure is None else disk_slug(failure), "said", text=text))
        if not self._finaliser.alive:
            self._fault_once(because("task-dies", "finaliser-ended"))
        written = (campaign.log.path, campaign.log.trouble), (CampaignFolder.baseline, executor.damper.disk_error)
        for file, error in written:
            if error is not None:
                self._fault_once(because(disk_slug(error), "said", text=f"{file}: {error}"))
        newest_ns = executor.observer.last_host_ns.get(Channel.STATE)
        stale_s = STALE_HEARTBEATS * self._campaign.config.heartbeat_timeout_s
        # By the time before the ring was read: a pause of this process is not the silence of another one.
        if self.state.armed and newest_ns is not None and self._turns.silent_ns(newest_ns) > stale_s * 1e9:
            self._fault_once(self._stale_cause(stale_s))
        if self._ring is not None and self._ring.lost > 0 and "lapped" not in self._reported:
            self._reported.add("lapped")
            cause = because("slow-consumer", "records-lost", count=self._ring.lost)
            self._waiting.append(ev.Spoiled(cause))

    def _stale_cause(self, stale_s: float) -> StopCause:
        """Why no status comes: the station's own beat in the ring tells whether it runs at all."""
        if self._ring is not None and self._turns.now_ns - self._ring.writer_heartbeat_ns > 0.5e9 * stale_s:
            return because("host-silent", "station-silent", silent_s=stale_s / 2.0)
        return because("data-stale", "no-status", silent_s=stale_s)

    def _observe(self, block: RecordBlock) -> ev.Event | None:
        """The awaited fact in new records; a load train that changed is a fault of its own."""
        if self._campaign.results.start_temperature_degC is None:
            temperatures_degC = block.of(Channel.COIL_TEMPERATURE)["value"]
            known_degC = temperatures_degC[np.isfinite(temperatures_degC)]
            self._campaign.results.start_temperature_degC = float(known_degC[0]) if len(known_degC) else None
        if self.state.phase is Phase.RUNNING:
            self.zeros.watch(block)
        observer = self._executor.observer
        fact = observer.observe(block)
        if isinstance(fact, ev.ProgramEnded):
            motion = None if fact.motion is None else replace(fact.motion, disturbed=self._disturbed)
            fact, self._disturbed = replace(fact, motion=motion), ""
        changed = observer.load_train_change
        # A friction test's force lies near the sensor's noise: from cycle to cycle it differs by more than a share.
        if changed is not None and self.state.phase is Phase.RUNNING and self.state.point.adapts:
            self._hear_the_station()
            self._fault_once(because("load-train", "said", text=changed), StopKind.PRESSURE_OFF)
        return fact

    def _watch_wall_clock(self) -> None:
        """Log a step of the wall clock; nothing here depends on it, but the times in names and journals do."""
        stepped_s = self._wall_clock.stepped_s()
        if stepped_s != 0.0:
            text = say("clock-step", stepped_s=stepped_s)
            self._campaign.log.note("warning", slug="clock-step", text=text, stepped_s=stepped_s)
            self._campaign.display.message("warning", f"clock-step: {text}")

    def _fault_once(self, cause: StopCause, stop: StopKind = StopKind.FADE_OUT) -> None:
        if cause.slug not in self._reported:
            self._reported.add(cause.slug)
            self._waiting.append(ev.Fault(stop, cause))

    def _beat(self) -> None:
        now_ns = monotonic_ns()
        self._turns.turn(now_ns)
        back_within(1e-9 * BEAT_NS)
        if now_ns - self._beat_ns < BEAT_NS or "gone" in self._reported:
            return
        self._beat_ns = now_ns
        # The stop by its own name goes first; a beat later the station stops the rig should that have been lost.
        recorder = self._executor.recording.recorder
        well, self._recorder_well = self._recorder_well, recorder is None or recorder.healthy
        try:
            self._campaign.client.beat(well)
        except StationLost as error:
            self._reported.add("gone")
            self._waiting.append(ev.StationGone(str(error)))

    def _show_progress(self) -> None:
        now_ns = monotonic_ns()
        if now_ns - self._progress_ns < PROGRESS_NS:
            return
        self._progress_ns = now_ns
        self._watch_wall_clock()
        state, observer = self.state, self._executor.observer
        running = state.phase is Phase.RUNNING
        cycles = self._cycles_done() if running else 0
        left_s = sum(point.motion_s + point.rest_s for point in state.queue)
        left_s -= cycles / state.point.frequency_Hz if running else 0.0
        left_s += self._cooling_left_s() + self._trials_left_s()
        point_id = state.queue[0].id if state.queue else ""
        left_s /= self._campaign.bench.clock.device_rate
        live = {name: observer.last[channel] for name, channel in LIVE.items() if channel in observer.last}
        self._campaign.display.progress(point_id, cycles, left_s, live)

    def _cycles_done(self) -> int:
        """Whole cycles of the running program: of a record that is repeated, by the time since it began."""
        point, observer = self.state.point, self._executor.observer
        if not point.repeats_record:
            return observer.cycles_done
        return max(0, min(round(point.cycles), int((observer.signal_s - point.first_cycle_s) * point.frequency_Hz)))

    def _cooling_left_s(self) -> float:
        """Forecast time (s, rig's clock) until the damper is cool enough; 0 when it is not cooling down."""
        state, thermal = self.state, self.state.conditions.thermal
        if state.phase is not Phase.COOLING or thermal is None:
            return 0.0
        now_degC = self._executor.observer.last.get(Channel.COIL_TEMPERATURE, math.nan)
        highest_degC = state.conditions.highest_start(state.point)
        return thermal.heat.time_to(highest_degC, now_degC) if now_degC > highest_degC else 0.0

    def _trials_left_s(self) -> float:
        """Longest duration of the trials of iterated signals that are left (s, rig's clock)."""
        state, settings = self.state, self.state.conditions.iteration
        if settings is None:
            return 0.0
        queue, drives, left_s = self._trials_left
        if queue is not state.queue or drives is not state.signal_drives:  # called ten times a second
            signals = [(point.record_samples, point.current_A) for point in state.queue if point.kind == SIGNAL]
            known = ((record, current_A) for record, current_A in signals if record is not None)
            left_s = trials_s(known, settings, state.signal_drives)
            self._trials_left = state.queue, state.signal_drives, left_s
        return left_s


def after_station(state: State, *, ended: bool, safe: bool, at_rest: bool) -> State:
    """What is known of an armed rig once its station has ended, or does not end.

    Args:
        state: of the campaign, which has ended.
        ended: the station has ended with exit code 0: nothing is armed any more.
        safe: the last thing that it told of a stop is that it was proved.
        at_rest: the standstill and 0 A of a stop that was proved before were not lost since.
    """
    untouched = not state.moved and not state.pressurised
    if ended and (safe or untouched):
        # A pressure that stayed too long and is proved to be gone now was all that was unknown of a proved stop.
        late = state.stopped and not state.left_to_station and not state.hand_flows
        known = RigState.SAFE if late else state.rig_state
        return replace(state, armed=False, pressurised=False, powered=False, rig_state=known)
    holds = state.latch is not None and state.latch.stop is not StopKind.PRESSURE_OFF
    return state if state.stopped and holds and at_rest else replace(state, rig_state=RigState.UNKNOWN)


def _named(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


_KEYS = {"event": "what"}
"""The campaign's journal has an `event` of its own; the station's is kept beside it."""
