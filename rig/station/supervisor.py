"""The supervisor: latches the first cause, stops the rig, confirms that it stopped.

Reader threads call `report` with the findings of their interlocks; the call that latches a trip also sends 0 A and
wakes the actuator's thread, so a stop never waits for a poll. A separate thread runs the slow checks: ages, the
application's heartbeat, the stop machine, its own latency.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterable
from typing import TypeVar

from drivers.clock import back_whenever, back_within
from drivers.ring import NO_DEVICE_TIME, Channel, Record
from rig.bench.settings import StationConfig
from rig.clock import monotonic_ns
from rig.faults.matrix import REACTIONS
from rig.faults.row import FaultRow, StopKind
from rig.station import safe_stop
from rig.station.events import Trip, late_event, step_event, trip_event
from rig.station.interfaces import Coil, Motion, Travel, Watched
from rig.station.interlocks.finding import Finding
from rig.station.log import say_error
from rig.station.safe_stop import Movement, SafeStop, StopAction, StopInputs, StopPhase
from rig.station.watchdogs import HostWatch, Listener, Watchdogs, quiet_s

TICK_S = 0.005
WARNING_EVERY_NS = 1_000_000_000
STALLED_NS = 500_000_000
FORGIVEN_NS = 1_000_000_000
"""So much of the station's own blind time does not count towards the deadlines of one stop."""
UNTAKEN_NS = 200_000_000
"""So long a stop command may go unacknowledged before the controller's watchdog is starved."""
EXPECTED_IN_PROOF = frozenset({"host-silent", "controller-trip"})
NO_TROUBLE = Finding("", "", 0)
_SLOWEST_LAST = (*(action for action in StopAction if action is not StopAction.ZERO_CURRENT), StopAction.ZERO_CURRENT)

Emit = Callable[[dict[str, object]], None]
Append = Callable[[list[Record]], None]
T = TypeVar("T")


class Supervisor:
    """One per station; every method may be called from any thread."""

    def __init__(
        self, config: StationConfig, emit: Emit, append: Append, beat: Callable[[int], None],
        unread_share: Callable[[], float],
    ) -> None:
        self.config = config
        self.tick_ns = monotonic_ns()
        quiet = quiet_s(config.periods_s)
        self.host = HostWatch(config.late_limit_s, config.actuator.watchdog_s, quiet, self.tick_ns)
        self.movement = Movement()
        self.trip: Trip | None = None
        self.stop: SafeStop | None = None
        self.later: dict[str, str] = {}
        self.defects = 0
        self.trouble = NO_TROUBLE
        self.changed = threading.Condition()
        self.watchdogs = Watchdogs(config.heartbeat_timeout_s, self.host, unread_share)
        self._emit = emit
        self._append = append
        self._ring_beat = beat
        self._coil: Coil | None = None
        self._motion: Motion | None = None
        self._travel: Travel | None = None
        self._armed = False
        self._starving = False
        self._proving = False
        self._application_gone = False
        self._warned: dict[str, tuple[int, int]] = {}
        self._blind_before_ns = 0
        self._lock = threading.RLock()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="supervisor", daemon=True)

    def attach(self, coil: Coil, motion: Motion, travel: Travel, watched: Iterable[Watched]) -> None:
        """Give the supervisor its devices; before that nothing can be armed."""
        self._coil, self._motion, self._travel = coil, motion, travel
        self.watchdogs.watched = tuple(watched)
        self.host.listen(monotonic_ns(), listening=True)

    def start(self) -> None:
        """Start the ticking thread; readers of the ring see the writer's beat from now on."""
        self._ring_beat(monotonic_ns())
        self.host.watch(monotonic_ns())
        self._thread.start()

    def end(self) -> None:
        """End the ticking thread and wait for it."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join(timeout=1.0)

    @property
    def armed(self) -> bool:
        """Interlocks act on findings."""
        return self._armed

    @property
    def may_move(self) -> bool:
        """Armed, nothing latched, watchdog fed."""
        return self._armed and self.trip is None and not self._starving

    @property
    def settled(self) -> bool:
        """No stop is under way."""
        return self.stop is None or self.stop.finished

    @property
    def ended_for_good(self) -> bool:
        """The stop that follows the end of the application's link has gone all the way (S1), or cannot be proved."""
        return self.stop is not None and self.stop.finished and self.stop.kind is StopKind.PRESSURE_OFF

    def arm(self) -> None:
        """Let the interlocks act; the application's beat counts from now."""
        self.watchdogs.restart_beat()
        self._armed = True

    def disarm(self) -> None:
        """Interlocks only warn from now on."""
        self._armed = False
        self.movement = Movement()

    def starve(self, *, proving: bool, feeding: bool) -> None:
        """Feed the controller's watchdog or not, for the proof that it trips.

        Args:
            proving: the controller's own trip is expected: it is not a finding now.
            feeding: the watchdog is fed as always.
        """
        self._proving = proving
        self._starving = not feeding

    @property
    def proved_safe(self) -> bool:
        """The last stop ended in proved standstill."""
        return self.stop is not None and self.stop.step is StopPhase.SAFE

    @property
    def proved_without_pressure(self) -> bool:
        """The last stop ended in proved standstill with the pressure off, whatever became of the current."""
        stop = self.stop
        at_rest = stop is not None and stop.finished and stop.standstill
        return at_rest and self._motion is not None and self._motion.pressure_name == "off"

    def evidence(self) -> dict[str, object]:
        """Current, position, controller state and pressure as they are now; None where stale; the source's time-out."""
        now_ns = monotonic_ns()
        return {
            "current_A": None if self._coil is None else self._coil.fresh_current_A,
            "current_timeout_s": None if self._coil is None else self._coil.own_timeout_s,
            "position_m": None if self._travel is None else self._travel.position_m(now_ns),
            "state": None if self._motion is None else self._motion.state_name,
            "pressure": None if self._motion is None else self._motion.pressure_name,
        }

    def may_feed(self, now_ns: int) -> bool:
        """The controller's watchdog may be fed.

        Only while armed, the interlock loop ticks and the application is well; during a stop feeding goes on, so that
        the fade-out is not cut short, until the stop has ended without proof. A controller that does not take the stop
        is left to its watchdog.
        """
        if not self._armed or self._starving or now_ns - self.tick_ns > STALLED_NS:
            return False
        if self.trip is not None:
            stop, taken = self.stop, self._motion is None or self._motion.stop_taken
            if stop is not None and stop.step is StopPhase.STOPPING and not taken:
                return self._stop_clock_ns(now_ns) - stop.step_ns < UNTAKEN_NS
            return stop is None or stop.step is not StopPhase.UNKNOWN
        return self.watchdogs.beat_age_s(now_ns) < 2.0 * self.config.heartbeat_timeout_s

    def beat(self, healthy: bool) -> None:
        """The application lives; `healthy` carries its recorder's state."""
        self.watchdogs.beat(healthy)

    def application_gone(self) -> None:
        """The application's link has ended: stop, and after standstill hydraulics off."""
        self._application_gone = True
        self.report([Finding("sigkill", "the link to the application was closed", monotonic_ns())])

    def report(self, findings: Iterable[Finding]) -> None:
        """Act on what a detector found: trip, or warn where the row or the state says so.

        What the station itself slept through comes first: it is the cause of what is found after it.
        """
        if self.host.has_unreported:
            self._own_lateness()
        self._finish(self._act(findings))

    def _own_lateness(self) -> None:
        """Tell of blind times that ended; one that is too long stops the rig."""
        actions: list[StopAction] = []
        with self._lock:
            while (blind := self.host.take()) is not None:
                finding, length_s = self.host.finding(blind), blind.length_ns / 1e9
                if finding is not None or length_s > self.config.late_after_s:
                    record: Record = (blind.end_ns, NO_DEVICE_TIME, length_s, self.host.count, Channel.LOOP_LATE, 0)
                    self._try(self._append, [record])
                    self._try(self._emit, late_event(blind, self.host))
                actions += [] if finding is None else self._act([finding])
        self._finish(actions)

    def _act(self, findings: Iterable[Finding]) -> list[StopAction]:
        """Latch or warn; what a stop has to do is returned."""
        actions: list[StopAction] = []
        for finding in findings:
            row = REACTIONS[finding.slug]
            if finding.slug in self.config.disabled_detectors:
                continue
            if self._proving and finding.slug in EXPECTED_IN_PROOF:
                continue
            if finding.warns or row.stop is None or not self._armed:
                self._warn(finding)
            else:
                self.trouble = finding
                actions += self._latch(finding, row, row.stop)
        return actions

    def ask_stop(self, kind: StopKind, slug: str, detail: str) -> None:
        """Stop because the application asks for it, whatever is armed."""
        row = REACTIONS.get(slug, REACTIONS["operator"])
        self._finish(self._latch(Finding(slug, detail, monotonic_ns()), row, kind, requested=True))

    def warn(self, slug: str, detail: str) -> None:
        """Tell the application something that is no fault but worth knowing; it is journalled and shown."""
        self._emit({"event": "warning", "slug": slug, "detail": detail, "count": 1, "t_ns": monotonic_ns()})

    def pass_on(self, event: dict[str, object]) -> None:
        """Tell the application something else."""
        self._emit(event)

    def note_sent(self, action: StopAction) -> None:
        """A stop action has been taken by the controller's link; tells the application when."""
        self._emit({"event": "sent", "action": action.name.lower(), "t_ns": monotonic_ns()})

    def reset(self, ended: SafeStop | None) -> bool:
        """Forget a trip whose stop has ended; the caller has proved standstill, 0 A and a cleared controller.

        Args:
            ended: the stop that the proofs were made after.

        Returns:
            False, and nothing is forgotten, when the stop has been taken up again since.
        """
        with self._lock:
            if self.stop is not ended:
                return False
            self.trip = None
            self.stop = None
            self.later = {}
            self.movement = Movement()
            self._warned = {}
            self.host.listen(monotonic_ns(), listening=True)
            return True

    def _warn(self, finding: Finding) -> None:
        now_ns = monotonic_ns()
        with self._lock:
            last_ns, count = self._warned.get(finding.slug, (0, 0))
            due = now_ns - last_ns > WARNING_EVERY_NS
            self._warned[finding.slug] = (now_ns if due else last_ns, count + 1)
        if due:
            warning: dict[str, object] = {"event": "warning", "slug": finding.slug, "detail": finding.detail}
            self._emit({**warning, "count": count + 1, "t_ns": now_ns})

    def _latch(
        self, finding: Finding, row: FaultRow, kind: StopKind, *, requested: bool = False
    ) -> tuple[StopAction, ...]:
        """Latch and tell, both under one lock: what the application hears first is what came first.

        Returns:
            What the stop has to do now.
        """
        # A stop asked for is never a halt: only a detector's row knows of a hard limit.
        halt = row.halt and not requested
        with self._lock:
            now_ns = monotonic_ns()
            first = self.trip is None
            known = finding.slug in self.later or (self.trip is not None and self.trip.slug == finding.slug)
            if self.stop is None:
                if first:
                    self.trip = Trip(finding.slug, kind, finding.detail, finding.t_ns, finding.value, finding.limit)
                # From now on devices may be gone; hearing none of them is not the host's any more.
                self.host.listen(now_ns, listening=False)
                self._blind_before_ns = self.host.total_ns
                self.stop, actions = safe_stop.begin(
                    kind, self._stop_clock_ns(now_ns), halt=halt, fade_s=self.movement.fade_s,
                    device_rate=self.config.device_rate, watchdog_s=self.config.actuator.watchdog_s,
                )
                self.stop = safe_stop.of_source(self.stop, self._coil)
            else:
                self.stop, actions = safe_stop.escalate(self.stop, kind, self._stop_clock_ns(now_ns), halt=halt)
            if actions and self._travel is not None and self._motion is not None:
                self._travel.restart_still()
                self._motion.restart_still()
            self.stop = safe_stop.after_fault(self.stop, finding.slug)
            if not first and not known:
                self.later[finding.slug] = finding.detail
            if first or not known:
                self._try(self._emit, trip_event(finding, kind, first, now_ns))
                record: Record = (now_ns, NO_DEVICE_TIME, float(row.code), 0, Channel.TRIP, 0)
                self._try(self._append, [record])
        return actions

    def _finish(self, actions: Collection[StopAction]) -> None:
        """Carry a stop's actions out, each by itself: one that fails, or waits for its wire, holds up no other.

        Motion first: it is only queued, for the actuator's thread; the 0 A frame is sent by this one.
        """
        if not actions:
            return
        if self.stop is not None and self.stop.halt and StopAction.HALT not in actions:  # another thread halts it
            actions = [StopAction.HALT if action is StopAction.FADE else action for action in actions]
        for action in sorted(actions, key=_SLOWEST_LAST.index):
            self._try(self._carry_out, action)
        with self.changed:
            self.changed.notify_all()

    def _carry_out(self, action: StopAction) -> None:
        if action is StopAction.ZERO_CURRENT:
            if self._coil is not None:
                self._coil.zero_now()
        elif action is StopAction.STOP_IGNORED:
            self._internal("stop-ignored", "the rod was not at rest within the stop's deadline: hydraulics switched "
                "off")
        elif action is StopAction.CURRENT_STUCK:
            self._internal("current-stuck", "the coil current persists after 0 A was commanded")
        elif self._motion is not None:
            self._motion.act(action)

    def _try(self, do: Callable[[T], None], with_what: T) -> None:
        """Do one thing of a stop; what goes wrong with it is said, and is no reason to leave out the others."""
        try:
            do(with_what)
        except Exception:  # noqa: BLE001 - whatever it is, the rest of the stop matters more
            self.defects += 1
            say_error()

    def _internal(self, slug: str, detail: str) -> None:
        row = REACTIONS[slug]
        if row.stop is not None:
            self._finish(self._latch(Finding(slug, detail, monotonic_ns()), row, row.stop))

    def _run(self) -> None:
        loop = Listener(self.host, monotonic_ns())
        while not self._waited():
            now_ns = monotonic_ns()
            loop.returned(TICK_S, now_ns, heard=False)
            try:
                self.tick(now_ns)
            except Exception as error:  # noqa: BLE001 - a loop that ended would watch nothing and end no stop
                self.defects += 1
                if self.defects == 1:
                    say_error()
                if self._armed:
                    self._internal("task-dies", f"the interlock loop failed: {type(error).__name__}: {error}")
                self._try(self._advance_stop, now_ns)
        back_whenever()

    def _waited(self) -> bool:
        """Wait for the next tick; True once there is none."""
        back_within(TICK_S)
        return self._ending.wait(TICK_S)

    def tick(self, now_ns: int) -> None:
        """One round of the slow checks."""
        self.tick_ns = now_ns
        self._ring_beat(now_ns)
        self.host.awake(now_ns)
        self.report(self.watchdogs.machine(now_ns))
        self.report(self.watchdogs.devices(now_ns))
        for guard in (self.watchdogs.application, self.watchdogs.consumer):
            if self._guards:
                self.report(guard(now_ns))
        self._advance_stop(now_ns)

    def _stop_clock_ns(self, now_ns: int) -> int:
        """The clock of a stop's deadlines: it stands while the station is blind, for `FORGIVEN_NS` in all at most."""
        return now_ns - min(self.host.total_ns - self._blind_before_ns, FORGIVEN_NS)

    @property
    def _guards(self) -> bool:
        return self._armed and self.trip is None

    def _advance_stop(self, now_ns: int) -> None:
        with self._lock:
            if self.stop is None:
                return
            before = self.stop
            inputs = self._stop_inputs(now_ns)
            if not before.finished:
                self.stop, actions = safe_stop.advance(before, inputs)
            elif self._application_gone and before.kind is not StopKind.PRESSURE_OFF:
                self.stop, actions = safe_stop.escalate(before, StopKind.PRESSURE_OFF, inputs.now_ns)
            elif safe_stop.broken(before, inputs):
                self._internal("stop-ignored", "the rod moved after its standstill had been confirmed: hydraulics "
                    "switched off")
                return
            else:
                return
            after = self.stop
            if after.step is StopPhase.SAFE and before.step is not StopPhase.SAFE:
                self._hold_place(after)
            if after.step is not before.step:
                # Under the lock: what is latched meanwhile is told after it.
                self._try(self._emit, step_event(after, inputs, self.evidence(), now_ns))
        self._finish(actions)
        if after.step is not before.step:
            with self.changed:
                self.changed.notify_all()

    def _hold_place(self, stop: SafeStop) -> None:
        """Watch from now on that the rod stays where its standstill was proved."""
        if self._travel is not None:
            self._travel.hold_place()
        if self._motion is not None and stop.position_trusted:
            self._motion.hold_place()

    def _stop_inputs(self, now_ns: int) -> StopInputs:
        motion = (None,) * 4 if self._motion is None else self._motion.stop_inputs(now_ns)
        taken, travel = self._motion is None or self._motion.stop_taken, self._travel
        current_A = None if self._coil is None else self._coil.fresh_current_A
        still_s, changed = (None, False) if travel is None else (travel.still_s(now_ns), travel.changed)
        left = any(witness.left_place(now_ns) for witness in (travel, self._motion) if witness is not None)
        clock_ns = self._stop_clock_ns(now_ns)
        return StopInputs(clock_ns, still_s, *motion, current_A, self.movement.period_s, taken, changed, left)
