"""The actuator's thread, the only one that talks to the controller: polls, refreshes its watchdog, executes commands.

A stop is executed before anything else and wakes the thread. Commands of requests run as jobs between two polls, so
that no request delays the interlocks by more than one exchange.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

from drivers.capabilities import Capabilities, WatchdogKind
from drivers.clock import back_whenever, back_within
from drivers.connection import LinkKind
from drivers.errors import DriverError, LinkLost, NoAnswer, RequestRefused
from drivers.origins import Origins, origins_of
from drivers.ring import Record
from drivers.roles import Actuator, ActuatorIdentity, ActuatorStatus, Command, state_name
from rig.bench.settings import ActuatorConfig
from rig.clock import monotonic_ns, result_of, wait_for
from rig.station.interfaces import Travel
from rig.station.interlocks.actuator_interlock import ActuatorInterlock
from rig.station.interlocks.finding import CONSECUTIVE, Finding
from rig.station.interlocks.line_interlock import ClockWatch
from rig.station.interlocks.link_faults import EchoWatch, LinkFaults, SentStop, link_slug
from rig.station.interlocks.motion_interlock import Reference
from rig.station.log import say_error
from rig.station.safe_stop import STILL_S, StopAction
from rig.station.supervisor import Supervisor
from rig.station.threads.device_thread import DeviceThread
from rig.station.threads.setpoint_stream import SetpointStream
from rig.station.threads.status_records import StatusRecords

T = TypeVar("T")
SILENT = "modbus-halfopen"
"""What silence is called while nothing else was said since the last good status."""
COUNTER_MODULUS = 1 << 16
OPEN_PATIENCE_S = 2.0
FEED_AGAIN_NS = 100_000_000
IDENTITY_EVERY = 50
"""Polls between two looks at boot count and configuration."""
REOPEN_PAUSE_S = 0.01
COMMANDS = {
    StopAction.HYDRAULICS_LOW: Command.HYDRAULICS_LOW,
    StopAction.FADE: Command.FADE_STOP,
    StopAction.HALT: Command.HALT,
    StopAction.HYDRAULICS_OFF: Command.HYDRAULICS_OFF,
}
"""Stop commands, the weakest first: one that was sent makes those before it needless."""
CLOCK_STATUSES = 20
"""Statuses by whose least delayed one the controller's clock is read."""
PRESSURE_ACTIONS = frozenset({StopAction.HYDRAULICS_LOW, StopAction.HYDRAULICS_OFF})


class ActuatorThread(DeviceThread):
    """Owns the controller's driver once it is started."""

    def __init__(
        self,
        config: ActuatorConfig,
        driver: Actuator,
        interlock: ActuatorInterlock,
        travel: Travel,
        supervisor: Supervisor,
        append: Callable[[list[Record]], None],
    ) -> None:
        super().__init__("actuator", SILENT)
        self.config = config
        self.interlock = interlock
        self.identity: ActuatorIdentity | None = None
        self.polls = 0
        self.failures = 0
        self.clock = ClockWatch(supervisor.config.device_rate)
        self.status_changed = threading.Condition()
        self._driver = driver
        self._travel = travel
        self._supervisor = supervisor
        self._append = append
        self._wake = threading.Condition()
        self._actions: frozenset[StopAction] = frozenset()
        self._hurry = self._anew = False
        self._jobs: deque[tuple[Callable[[], object], Future[object]]] = deque()
        self._counter = 0
        self._echo = EchoWatch()
        self._stream = SetpointStream(driver, config, supervisor)
        self._stale_ns = int(config.stale_after_s * 1e9)
        self._last_ns = monotonic_ns()
        self._linked = True
        self._troubles = LinkFaults(driver)
        self._feed_ns = 0
        self._busy = False
        self._worked_ns = 0
        self._settings: tuple[int, int] | None = None
        self._sent: SentStop | None = None
        self._records = StatusRecords()
        self._rate = supervisor.config.device_rate
        self._ahead_us: deque[float] = deque(maxlen=CLOCK_STATUSES)

    # For other threads

    def open(self) -> None:
        """Connect and read the identity; before the thread starts.

        Nothing depends on speed yet, so an answer that is late is asked for again until `OPEN_PATIENCE_S`.

        Raises:
            NoAnswer: the port is open, but nothing answers.
            LinkLost: the connection breaks again and again.
            DriverError: no device, or another one.
        """
        deadline_ns = monotonic_ns() + int(OPEN_PATIENCE_S * 1e9)
        while True:
            self._driver.open()
            try:
                self.identity = self._driver.read_identity()
                self._driver.read_status()
                return
            except (NoAnswer, LinkLost):
                if monotonic_ns() > deadline_ns:
                    raise

    @property
    def origins(self) -> Origins:
        """Where the values of its channels come from, as its driver states."""
        return origins_of(self._driver)

    @property
    def capabilities(self) -> Capabilities:
        """What the actuator can do."""
        return self._driver.capabilities

    @property
    def link_kind(self) -> LinkKind:
        """What the connection to it is made of."""
        return self._driver.link_kind

    def close(self) -> None:
        """Disconnect; after the thread has ended."""
        self._driver.close()

    def counters(self, now_ns: int) -> dict[str, object]:
        """Age of the last status and what was counted."""
        return {"age_s": (now_ns - self._last_ns) / 1e9, "polls": self.polls, "failures": self.failures}

    def wait_fed(self, timeout_s: float) -> ActuatorStatus | None:
        """A status after a feed, which echoes it where the controller does; None after `timeout_s` wall seconds."""
        before, echoes = self._counter, self.capabilities.echo
        return self.wait_status(
            lambda status: self._counter != before and not (echoes and status.watchdog_echo == before), timeout_s
        )

    def act(self, action: StopAction) -> None:
        """Carry out a stop action before anything else; returns at once."""
        if action in PRESSURE_ACTIONS and not self.capabilities.hydraulics:
            return
        with self._wake:
            self._actions |= {action}
            self._hurry = True
            self._wake.notify()

    def restart_still(self) -> None:
        """Begin the proof of standstill anew: what counts is read after the stop command was sent."""
        self._anew = True
        self.interlock.place.hold(math.nan)

    def hold_place(self) -> None:
        """Standstill is proved: the rod has to stay where it is."""
        self.interlock.hold_place()

    def left_place(self, now_ns: int) -> bool:
        """A fresh status shows the rod away from where its standstill was proved."""
        return self.interlock.place.left and self.fresh_status(now_ns) is not None

    def call(self, job: Callable[[Actuator], T], timeout_s: float) -> T:
        """Run `job` with the driver on this thread and return its result.

        Raises:
            DriverError: whatever the driver raised.
            TimeoutError: the thread did not come to it in time; a job that had not begun never will.
        """
        future: Future[object] = Future()
        with self._wake:
            self._jobs.append((lambda: job(self._driver), future))
            self._wake.notify()
        try:
            return result_of(future, timeout_s)  # type: ignore[return-value]  # the future holds what the job returned
        except TimeoutError:
            future.cancel()
            raise

    def controller_s(self, host_ns: int) -> float:
        """The controller's clock at a host time (ns), s; the host's clock at the device rate before the first status.

        The least delayed of the last statuses counts, so that a late answer does not set the clock back.
        """
        ahead_us = max(list(self._ahead_us), default=0.0)
        return 1e-6 * (ahead_us + 1e-3 * self._rate * host_ns)

    def expect_settings(self, expected: bool) -> None:
        """Compare boot count and configuration with what they are now (True), or with nothing (False)."""
        self._settings = None
        if expected:
            self._settings = self.call(lambda driver: driver.read_identity(), OPEN_PATIENCE_S).settings

    def wake(self) -> None:
        """Interrupt the wait for the next poll."""
        with self._wake:
            self._wake.notify()

    def wait_status(self, reached: Callable[[ActuatorStatus], bool], timeout_s: float) -> ActuatorStatus | None:
        """The first status from now on that is wanted; None after `timeout_s` wall seconds."""
        interlock = self.interlock
        with self.status_changed:
            came = wait_for(
                self.status_changed, lambda: interlock.status is not None and reached(interlock.status), timeout_s
            )
            return interlock.status if came else None

    def fresh_status(self, now_ns: int) -> ActuatorStatus | None:
        """The last status, None when it is stale: not answered, or answered by a controller whose heartbeat stands."""
        return self.interlock.status if now_ns - self._last_ns <= self._stale_ns and not self.interlock.frozen else None

    def rests(self, now_ns: int) -> bool:
        """A fresh status says that the rod stands; without one this is unknown."""
        return self.stop_inputs(now_ns)[0] is False

    def stop_inputs(self, now_ns: int) -> tuple[bool | None, float | None, bool | None, bool | None]:
        """Moving, clock (s), hydraulics low, hydraulics off; None without a fresh status, moving without a position."""
        if (status := self.fresh_status(now_ns)) is None:
            return None, None, None, None
        moves = self._anew or self.interlock.moving(STILL_S, self._supervisor.movement.period_s)
        moving = moves if math.isfinite(status.position_m) else None
        if not self.capabilities.hydraulics:
            # There is no pressure to take away: standing still is all that can be proved.
            rests = moving is False and not self.left_place(now_ns) and not self._travel.left_place(now_ns)
            return moving, self.interlock.clock_s, rests, rests
        return moving, self.interlock.clock_s, status.hydraulics_low, status.hydraulics_off

    @property
    def stop_taken(self) -> bool:
        """No stop command waits to be sent or to be acknowledged."""
        return not self._actions and self._sent is None

    def force_reference(self) -> Reference:
        """The controller's own force (N), for the load cell that may stand still."""
        return self._reference(lambda status: status.force_N)

    def position_reference(self) -> Reference:
        """The controller's own position (m), for the LVDT that may stand still."""
        return self._reference(lambda status: status.position_m)

    def _reference(self, quantity: Callable[[ActuatorStatus], float]) -> Reference:
        status = self.interlock.status
        return Reference(self.polls, self.interlock.path_m, math.nan if status is None else quantity(status))

    @property
    def state_name(self) -> str | None:
        """The controller's state by name, None without a fresh status."""
        status = self.fresh_status(monotonic_ns())
        return None if status is None else state_name(status.state)

    @property
    def pressure_name(self) -> str | None:
        """The pressure by name, `none` where there is none to take away, None without a fresh status."""
        if not self.capabilities.hydraulics:
            return "none"
        status = self.fresh_status(monotonic_ns())
        return None if status is None else status.pressure.name.lower()

    def start(self) -> None:
        """Start the thread; its silence counts from now."""
        self._last_ns = monotonic_ns()
        super().start()

    def silent_ns(self, now_ns: int) -> tuple[int, int]:
        """Age of the last status, and the age at which it is stale (ns).

        While nothing may move a request may keep the polls waiting: its own errors tell of a controller that is silent.
        """
        if self._supervisor.may_move:
            return now_ns - self._last_ns, self._stale_ns
        return 0 if self._busy else now_ns - max(self._last_ns, self._worked_ns), self._stale_ns

    # On the thread

    def work(self) -> None:
        """Poll until the end."""
        steps = self._stream.steps
        self._last_ns = monotonic_ns()
        steps.begin(self._last_ns)
        while not self._ending.is_set():
            due_ns = steps.next_ns
            self._wait(due_ns)
            try:
                self._serve()
            except DriverError as error:
                self._failed(error)
            except Exception as error:  # noqa: BLE001 - this thread alone can stop the motion: it must not end
                detail = f"actuator: {type(error).__name__}: {error}"
                if detail != self.failure:
                    self.failure = detail
                    say_error()
                self._supervisor.report([Finding("task-dies", detail, monotonic_ns())])
            if steps.next_ns == due_ns:
                steps.take(monotonic_ns())

    def _wait(self, until_ns: int) -> None:
        with self._wake:
            if not (self._hurry or self._jobs):
                left_s = max(0.0, (until_ns - monotonic_ns()) / 1e9)
                back_within(left_s)
                self._wake.wait(left_s)
            self._hurry = False
        back_whenever()  # how long an exchange may take is a matter of its own time-outs

    def _serve(self) -> None:
        if not self._linked:
            self._reopen()
        self._carry_out()
        if self._jobs:
            self._run_job()
        self._poll()
        if self._settings is not None and self.polls % IDENTITY_EVERY == 0:
            self._compare_settings(self._settings)

    def _carry_out(self) -> None:
        """Send the stop commands that wait, the strongest last; one that is refused waits for the next round.

        Raises:
            DriverError: one was not answered; it is sent again, but no stronger one has waited for that.
        """
        waiting, unanswered = self._actions, None
        if self._anew and waiting - PRESSURE_ACTIONS:
            self._anew = False
            self.interlock.restart_still()
        weakest_first = [action for action in COMMANDS if action in waiting]
        for place, action in enumerate(weakest_first):
            try:
                sequence = self._driver.send(COMMANDS[action])
            except RequestRefused as error:
                self._failed(error)
                continue
            except DriverError as error:
                unanswered = error
                continue
            with self._wake:
                self._actions -= {*weakest_first[: place + 1]}
            if self.capabilities.acknowledge:
                self._sent = SentStop(action, sequence)
            self._supervisor.note_sent(action)
        if unanswered is not None:
            raise unanswered

    def _compare_settings(self, expected: tuple[int, int]) -> None:
        """A controller that has booted, or whose limits another client changed, is not the one that was prepared."""
        shown = self._driver.read_identity().settings
        if shown != expected:
            detail = f"the controller's boot count and configuration hash are {shown}, expected {expected}"
            self._supervisor.report([Finding("actuator-reboot", detail, monotonic_ns())])

    def _run_job(self) -> None:
        with self._wake:
            job, future = self._jobs.popleft()
        if not future.set_running_or_notify_cancel():
            return
        self._busy = True
        try:
            future.set_result(job())
        except DriverError as error:
            self.slug = link_slug(error, self._driver.link_kind)
            future.set_exception(error)
        except Exception as error:  # noqa: BLE001 - handed to the thread that asked, which raises it
            future.set_exception(error)
        finally:
            self._worked_ns, self._busy = monotonic_ns(), False

    def _poll(self) -> None:
        now_ns = monotonic_ns()
        self._stream.sending(now_ns)
        fed = self.capabilities.watchdog is not WatchdogKind.NONE and self._stream.may_feed
        if fed and self._supervisor.may_feed(now_ns) and now_ns >= self._feed_ns:
            # A write that is refused is tried again, but not at every poll: the status can still be read.
            self._feed_ns = now_ns + FEED_AGAIN_NS
            self._counter = (self._counter + 1) % COUNTER_MODULUS
            status = self._driver.exchange(self._counter)
            self._feed_ns = 0
            if self.capabilities.echo:
                self._supervisor.report(self._echo.check(self._counter, status))
        else:
            status = self._driver.read_status()
        self.polls += 1
        self._supervisor.host.heard(status.received_ns)
        self._supervisor.report(self._troubles.answered(status.received_ns))
        self._follow_stop(status)
        self._last_ns = status.received_ns
        self.slug = SILENT
        device_us, records = self._records.of(status, self.polls)
        self.clock.take(status.received_ns, device_us)
        self._ahead_us.append(device_us - 1e-3 * self._rate * status.received_ns)
        self._append(records)
        lvdt_m = self._travel.position_m(status.received_ns)
        findings = self.interlock.check(status, lvdt_m, self._travel.speed_m_s, self._driver.sent)
        if findings:
            self._supervisor.report(findings)
        self._stream.answered(status)
        with self.status_changed:
            self.status_changed.notify_all()

    def _follow_stop(self, status: ActuatorStatus) -> None:
        """A stop command that was written must also be acknowledged; else it is sent again.

        Its number with another command is another master's: the controller has ignored ours.
        """
        if (sent := self._sent) is None:
            return
        sent.statuses += 1
        command, swallowed = COMMANDS[sent.action], status.acked_sequence == sent.sequence
        taken = status.acknowledges(command, sent.sequence)
        if not (taken or swallowed) and sent.statuses < CONSECUTIVE:
            return
        self._sent = None
        if taken:
            return
        last = f"{status.acked_command} as {status.acked_sequence}"
        detail = f"{command.name} was written with number {sent.sequence}, but the controller's last command is {last}"
        slug = "second-master" if swallowed else "modbus-write-lost"
        self._supervisor.report([Finding(slug, detail, status.received_ns)])
        if not self._supervisor.settled:
            self.act(sent.action)

    def _failed(self, error: DriverError) -> None:
        self.failures += 1
        now_ns = monotonic_ns()
        self._supervisor.host.awake(now_ns)
        self._linked = self._driver.is_open
        finding = self._troubles.failed(error, now_ns)
        if finding.slug != "modbus-wrong-tid":
            self.slug = finding.slug
        self._supervisor.report([finding])
        self._stream.failed(finding)

    def _reopen(self) -> None:
        """Connect again, so that a stop reaches the controller; a latched trip stays latched.

        Raises:
            DriverError: no answer.
        """
        self._driver.close()
        try:
            self._driver.open()
        except DriverError:
            self._ending.wait(REOPEN_PAUSE_S)
            raise
        self.interlock.restart()
        self._linked = True
