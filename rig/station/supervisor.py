"""The supervisor: latches the first cause, stops the rig, proves that it stopped.

Reader threads call `report` with what their judges found; the call that latches a trip also sends 0 A and wakes the
actuator's thread, so a stop never waits for a polling period. A thread of its own ticks the slow checks: ages, the
application's beat, the stop machine, its own lateness.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from drivers.ring import NO_DEVICE_TIME, Channel, Record
from rig.clock import monotonic_ns
from rig.station import safe_stop
from rig.station.config import StationConfig
from rig.station.events import trip_event, unknown_reason
from rig.station.fault_table import TABLE, FaultRow, Stop
from rig.station.interlocks import Finding
from rig.station.roles import Coil, Motion, Travel, Watched
from rig.station.safe_stop import Action, SafeStop, Step, View
from rig.station.vigil import Vigil

TICK_S = 0.005
WARNING_EVERY_NS = 1_000_000_000
STALLED_NS = 500_000_000
UNTAKEN_NS = 200_000_000
"""So long a stop command may go unacknowledged before the controller's watchdog is starved."""
EXPECTED_IN_PROOF = frozenset({"host-silent", "controller-trip"})

NO_TROUBLE = Finding("", "", 0)

Emit = Callable[[dict[str, object]], None]


@dataclass(frozen=True)
class Trip:
    """The latched first cause."""

    slug: str
    stop: Stop
    detail: str
    t_ns: int
    value: float
    limit: float


@dataclass(frozen=True)
class Movement:
    """What a stop has to expect of the motion that was last commanded (device seconds)."""

    fade_s: float = 0.0
    period_s: float = 0.0


@dataclass
class Late:
    """How late the interlock loop has been."""

    count: int = 0
    worst_s: float = 0.0


class Supervisor:
    """One per station; every method may be called from any thread."""

    def __init__(
        self, config: StationConfig, emit: Emit, append: Callable[[list[Record]], None], beat: Callable[[int], None]
    ) -> None:
        self.config = config
        self.late = Late()
        self.tick_ns = monotonic_ns()
        self.movement = Movement()
        self.trip: Trip | None = None
        self.stop: SafeStop | None = None
        self.later: dict[str, str] = {}
        self.trouble = NO_TROUBLE
        self.changed = threading.Condition()
        self.vigil = Vigil(config.heartbeat_timeout_s)
        self._emit = emit
        self._append = append
        self._ring_beat = beat
        self._coil: Coil | None = None
        self._motion: Motion | None = None
        self._travel: Travel | None = None
        self._armed = False
        self._starving = False
        self._proving = False
        self._was_late = False
        self._application_gone = False
        self._warned: dict[str, tuple[int, int]] = {}
        self._lock = threading.RLock()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="supervisor", daemon=True)

    def attach(self, coil: Coil, motion: Motion, travel: Travel, watched: Iterable[Watched]) -> None:
        """Give the supervisor its devices; before that nothing can be armed."""
        self._coil, self._motion, self._travel = coil, motion, travel
        self.vigil.watched = tuple(watched)

    def start(self) -> None:
        """Start the ticking thread; readers of the ring see the writer's beat from now on."""
        self._ring_beat(monotonic_ns())
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
        return self.stop is not None and self.stop.finished and self.stop.kind is Stop.S1

    @property
    def thread_alive(self) -> bool:
        """The ticking thread runs."""
        return self._thread.is_alive()

    def arm(self) -> None:
        """Let the interlocks act; the application's beat counts from now."""
        self.vigil.restart_beat()
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
        return self.stop is not None and self.stop.step is Step.SAFE

    def evidence(self) -> dict[str, object]:
        """Current, position and controller state as they are now; None where stale."""
        now_ns = monotonic_ns()
        return {
            "current_A": None if self._coil is None else self._coil.fresh_current_A,
            "position_m": None if self._travel is None else self._travel.position_m(now_ns),
            "state": None if self._motion is None else self._motion.state_name,
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
            if stop is not None and stop.step is Step.STOPPING and not taken:
                return now_ns - stop.step_ns < UNTAKEN_NS
            return stop is None or stop.step is not Step.UNKNOWN
        return self.vigil.beat_age_s(now_ns) < 2.0 * self.config.heartbeat_timeout_s

    def beat(self, healthy: bool) -> None:
        """The application lives; `healthy` carries its recorder's state."""
        self.vigil.beat(healthy)

    def application_gone(self) -> None:
        """The application's link has ended: stop, and after standstill hydraulics off."""
        self._application_gone = True
        self.report([Finding("sigkill", "the application's link has ended", monotonic_ns())])

    def report(self, findings: Iterable[Finding]) -> None:
        """Act on what a detector found: trip, or warn where the row or the state says so."""
        for finding in findings:
            row = TABLE[finding.slug]
            if finding.slug in self.config.disabled_detectors:
                continue
            if self._proving and finding.slug in EXPECTED_IN_PROOF:
                continue
            if finding.warns or row.stop is Stop.W or not self._armed:
                self._warn(finding)
            else:
                self.trouble = finding
                self._trip(finding, row, row.stop)

    def ask_stop(self, kind: Stop, slug: str, detail: str) -> None:
        """Stop because the application asks for it, whatever is armed."""
        now_ns = monotonic_ns()
        self._trip(Finding(slug, detail, now_ns), TABLE.get(slug, TABLE["operator"]), kind, asked=True)

    def note_sent(self, action: Action) -> None:
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

    def _trip(self, finding: Finding, row: FaultRow, kind: Stop, *, asked: bool = False) -> None:
        now_ns = monotonic_ns()
        # A stop asked for is never a halt: only a detector's row knows of a hard limit.
        halt = row.halt and not asked
        with self._lock:
            first = self.trip is None
            known = finding.slug in self.later or (self.trip is not None and self.trip.slug == finding.slug)
            if self.stop is None:
                if first:
                    self.trip = Trip(finding.slug, kind, finding.detail, finding.t_ns, finding.value, finding.limit)
                if self._travel is not None:
                    self._travel.restart_still()
                self.stop, actions = safe_stop.begin(
                    kind, now_ns, halt=halt, fade_s=self.movement.fade_s, device_rate=self.config.device_rate,
                    watchdog_s=self.config.actuator.watchdog_s,
                )
            else:
                self.stop, actions = safe_stop.escalate(self.stop, kind, now_ns, halt=halt)
            if not first and not known:
                self.later[finding.slug] = finding.detail
        self._perform(actions)
        if first or not known:
            self._append([(now_ns, NO_DEVICE_TIME, float(row.code), 0, Channel.TRIP, 0)])
            self._emit(trip_event(finding, kind, first, now_ns))
        with self.changed:
            self.changed.notify_all()

    def _perform(self, actions: Iterable[Action]) -> None:
        for action in actions:
            if action is Action.ZERO_CURRENT:
                if self._coil is not None:
                    self._coil.zero_now()
            elif action is Action.STOP_IGNORED:
                self._internal("stop-ignored", "no standstill within the stop's deadline: hydraulics off")
            elif action is Action.CURRENT_STUCK:
                self._internal("current-stuck", "coil current persists after 0 A was commanded")
            elif self._motion is not None:
                self._motion.act(action)

    def _internal(self, slug: str, detail: str) -> None:
        row = TABLE[slug]
        self._trip(Finding(slug, detail, monotonic_ns()), row, row.stop)

    def _run(self) -> None:
        before_ns = monotonic_ns()
        while not self._ending.wait(TICK_S):
            now_ns = monotonic_ns()
            late_s = (now_ns - before_ns) / 1e9 - TICK_S
            before_ns = now_ns
            self.tick(now_ns, late_s)

    def tick(self, now_ns: int, late_s: float = 0.0) -> None:
        """One round of the slow checks."""
        self.tick_ns = now_ns
        self._ring_beat(now_ns)
        self.report(self.vigil.machine(now_ns))
        late = late_s > self.config.late_after_s
        if late:
            self._note_late(now_ns, late_s)
        # Having stood still, the station first reads what waits before it calls anybody silent: once, not for ever.
        if not late or self._was_late:
            self.report(self.vigil.devices(now_ns))
            if self._guards:
                self.report(self.vigil.application(now_ns))
        if self._guards:
            self.report(self.vigil.consumer(now_ns))
        self._was_late = late
        self._advance_stop(now_ns)

    @property
    def _guards(self) -> bool:
        return self._armed and self.trip is None

    def _note_late(self, now_ns: int, late_s: float) -> None:
        self.late.count += 1
        self.late.worst_s = max(self.late.worst_s, late_s)
        self._append([(now_ns, NO_DEVICE_TIME, late_s, self.late.count, Channel.LOOP_LATE, 0)])
        self._emit({"event": "late", "late_s": late_s, "count": self.late.count, "t_ns": now_ns})
        if late_s * 1e9 > STALLED_NS:
            self.report([Finding("host-silent", f"interlock loop stood still for {late_s:.3f} s", now_ns, late_s)])

    def _advance_stop(self, now_ns: int) -> None:
        with self._lock:
            if self.stop is None:
                return
            before = self.stop
            view = self._view(now_ns)
            if not before.finished:
                self.stop, actions = safe_stop.advance(before, view)
            elif self._application_gone and before.kind is not Stop.S1:
                self.stop, actions = safe_stop.escalate(before, Stop.S1, now_ns)
            elif safe_stop.broken(before, view):
                self._internal("stop-ignored", "the rod moves although its standstill was proved: hydraulics off")
                return
            else:
                return
            after = self.stop
        self._perform(actions)
        if after.step is not before.step:
            self._tell_step(after, view)

    def _view(self, now_ns: int) -> View:
        moving = clock_s = low = off = None
        if self._motion is not None:
            moving, clock_s, low, off = self._motion.fill_view(now_ns)
        still_s = None if self._travel is None else self._travel.still_s(now_ns)
        current_A = None if self._coil is None else self._coil.fresh_current_A
        taken = self._motion is None or self._motion.stop_taken
        return View(now_ns, still_s, moving, clock_s, low, off, current_A, self.movement.period_s, taken)

    def _tell_step(self, stop: SafeStop, view: View) -> None:
        if stop.step is Step.SAFE:
            event: dict[str, object] = {
                "event": "safe",
                "stop": str(stop.kind),
                "standstill": stop.standstill,
                "current_zero": stop.current_zero,
                **self.evidence(),
                "stopped_s": (view.now_ns - stop.started_ns) / 1e9,
            }
        elif stop.step is Step.UNKNOWN:
            event = {"event": "unknown", "reason": unknown_reason(stop, view), **self.evidence()}
        else:
            event = {"event": "stop", "step": stop.step.name.lower()}
        self._emit({**event, "t_ns": view.now_ns})
        with self.changed:
            self.changed.notify_all()
