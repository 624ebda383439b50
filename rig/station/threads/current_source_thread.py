"""The ECU's thread: reads its frames, checks them, writes them into the ring; the driver itself repeats the command.

0 A is sent immediately by the thread that trips (`zero_now`); the driver's cycle then repeats it. After that no other
current is accepted until `begin` prepares the coil again.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

from drivers.current_source import UNKNOWN_STATE, CurrentSource, SourceBatch, SourceFault, SourceIdentity, SourceState
from drivers.errors import DriverError
from drivers.origins import Origins, origins_of
from drivers.ring import Channel, Record
from protocols.quality import Quality
from rig.bench.settings import EcuConfig
from rig.clock import monotonic_ns, wait_for
from rig.station.errors import StationRefused
from rig.station.interlocks.current_interlock import BusInterlock, CurrentInterlock, EcuInterlock, thrown_away
from rig.station.interlocks.finding import Finding
from rig.station.interlocks.law_interlock import LawInterlock
from rig.station.log import say
from rig.station.safe_stop import CURRENT_LIMIT_S, ZERO_CURRENT_A
from rig.station.supervisor import Supervisor
from rig.station.threads.device_thread import ReadingThread
from rig.station.watchdogs import Listener

STALE_FOR_SURE_S = 0.0002
SLOW_STATUS_S = 0.050
"""A source that tells its current less often is a slow one."""
PROVING_COMMANDS = 6
"""So many commands tell whether the source takes them; it may forgive a few that are damaged."""


class CurrentSourceThread(ReadingThread):
    """Owns the reading side of the ECU's driver; commands may come from any thread."""

    def __init__(
        self,
        config: EcuConfig,
        driver: CurrentSource,
        interlock: EcuInterlock,
        supervisor: Supervisor,
        append: Callable[[list[Record]], None],
    ) -> None:
        super().__init__("ecu", "ecu-silent", config.silent_after_s)
        self.config = config
        self.interlock = interlock
        self._driver = driver
        self._supervisor = supervisor
        self._append = append
        self._timeout_s = min(0.05, config.silent_after_s)
        self._listener = Listener(supervisor.host, self._last_ns)
        self._late_after_ns = int(1e9 * supervisor.config.late_after_s)
        self._zero_error: DriverError | None = None
        self._bus_interlock = BusInterlock(config.bitrate)
        self._settle_s = driver.traits.settling_s / min(1.0, supervisor.config.device_rate)
        self._current_interlock = CurrentInterlock(self._stale_ns, driver.timing, driver.traits.settling_s)
        self._law_interlock = LawInterlock(driver.timing, driver.traits.settling_s)
        self._set_points = 0
        self._bus_errors = 0
        self._errors_before = 0
        self._stamps_reported = False
        self._not_numbers_reported: set[Channel] = set()
        self._zeroed = True
        self._zeroed_ns = self._before_ns = 0
        self._program: object | None = None
        self._command_lock = threading.Lock()
        self._progress = threading.Condition()

    def open(self) -> None:
        """Join the bus; before the thread starts.

        Raises:
            DriverError: the interface cannot be opened.
        """
        self._driver.open()

    def close(self) -> None:
        """End the command frames and leave the bus; after the thread has ended."""
        self._driver.close()

    def revive(self) -> None:
        """Open a lost bus again; only at standstill, as part of a reset.

        Raises:
            DriverError: the interface cannot be opened.
        """
        if self.port_lost is not None or self._driver.send_error is not None:
            self._driver.close()
            self._driver.send_error = None
            self._zero_error = None
            self._driver.open()
            self._reopened()

    # Commands, from any thread

    def begin(self) -> None:
        """Send 0 A, disabled, with the ECU's faults cleared, from now on.

        Raises:
            DriverError: the bus does not take the frame.
        """
        with self._command_lock:
            self._bus_interlock.forget_others(self._driver.counters)
            self._command(0.0, enable=False, clear_faults=True)
            self._driver.start(self.config.command_period_s)
            self._zeroed = False

    def wait_clear(self, timeout_s: float) -> bool:
        """Wait until the ECU reports no fault, then stop asking it to clear them; False after `timeout_s`.

        A slow source is given its own time on top, and that in which its current falls.
        """
        timeout_s += self._stale_ns * 1e-9 + self._settle_s
        begun_ns = monotonic_ns()
        with self._progress:
            clear = wait_for(self._progress, lambda: self._last_ns > begun_ns and self._is_clear(), timeout_s)
            if clear:
                wait_for(self._progress, self._is_zero, self._settle_s)
        with self._command_lock:
            self._command(0.0, enable=False)
        return clear

    def wait_taken(self, timeout_s: float) -> bool:
        """Whether it reports no fault once it has had several commands; False too when it says nothing more."""
        enough_ns = monotonic_ns() + int(1e9 * PROVING_COMMANDS * self.config.command_period_s)
        with self._progress:
            return wait_for(self._progress, lambda: self._last_ns > enough_ns, timeout_s) and self._is_clear()

    def try_current(self, current_A: float) -> float:
        """Ask for a small current (A) and take it away again, before motion; how much was measured (A).

        It is waited for until half of it is there, at most as long as the source may take.

        Raises:
            StationRefused: 0 A is latched by a trip.
            DriverError: the bus does not take the frame.
        """
        allowed_s = self._settle_s + 2.0 * self._stale_ns * 1e-9
        self.set_current(current_A)
        try:
            with self._progress:
                wait_for(self._progress, lambda: self._measured_A() > 0.5 * current_A, allowed_s)
            return self._measured_A()
        finally:
            with self._command_lock:
                self._command(0.0, enable=False)
                self._driver.send_now()
            with self._progress:
                wait_for(self._progress, self._is_zero, self._settle_s + allowed_s)

    def _measured_A(self) -> float:
        status = self._driver.status
        return 0.0 if status is None else status.current_A

    @property
    def tells_bad_commands(self) -> bool:
        """It reports commands that it throws away."""
        return self._driver.traits.tells_bad_commands

    @property
    def faults(self) -> int:
        """Its faults as it last told them."""
        status = self._driver.status
        return 0 if status is None else status.faults

    def set_current(self, current_A: float) -> None:
        """Ask for a current (A), at once and from now on; of one set by hand: say what flows, 0 A after a stop too.

        Raises:
            StationRefused: 0 A is latched by a trip.
            DriverError: the bus does not take the frame.
        """
        with self._command_lock:
            if self._zeroed and current_A != 0.0:
                raise StationRefused("tripped", "set_current: 0 A is latched")
            self._command(current_A, enable=not self._zeroed or self.by_hand)
            self._driver.send_now()

    def follow_law(self, *, law: bool) -> None:
        """From now on a control law commands the current, or none does; no program is followed."""
        with self._command_lock:
            self._program = None
            self._law_interlock.follow(law=law)

    def follow_program(self, program: object, *, steps: bool) -> None:
        """From now on this program may step the current, until anything else commands one.

        Args:
            program: its identity counts.
            steps: whether it changes the current at all.
        """
        patience_s = 1e-9 * self._stale_ns * self._supervisor.config.device_rate
        with self._command_lock:
            if not self._zeroed:
                self._program = program
                self._law_interlock.follow(law=steps, patience_s=patience_s)

    def leave_program(self, program: object) -> None:
        """This program commands no more steps."""
        with self._command_lock:
            if self._program is program:
                self._end_program()

    def follows_program(self, program: object) -> bool:
        """Nothing else has commanded a current since this program began."""
        return self._program is program

    def step_current(self, program: object, current_A: float) -> bool:
        """Command a step (A) of a current program; False, and nothing is sent, if the program no longer applies.

        Raises:
            DriverError: the bus does not take the frame.
        """
        with self._command_lock:
            if self._program is not program:
                return False
            self._command(current_A, enable=True, program=program)
            self._driver.send_now()
            return True

    def rest(self) -> None:
        """Command 0 A with the output stage off, at once and from now on; the coil may be used again.

        Raises:
            DriverError: the bus does not take the frame.
        """
        with self._command_lock:
            self._command(0.0, enable=False)
            self._driver.send_now()

    def zero_now(self) -> None:
        """Command 0 A, output stage off, and put the frame on the wire at once; never raises."""
        with self._command_lock:
            self._zeroed = True
            self._zeroed_ns = monotonic_ns()
            self._command(0.0, enable=False)
            try:
                self._driver.send_now()
            except DriverError as error:
                # The ECU goes to 0 A by its own time-out, if the repeated command frames do not reach it before.
                self._zero_error = error
                say(f"0 A could not be sent: {error}")

    def _end_program(self) -> None:
        """The current is no longer that of a program, if it was; both change together, under the lock of commands."""
        if self._program is not None:
            self._program = None
            self._law_interlock.follow(law=False)

    def _command(
        self, current_A: float, *, enable: bool, clear_faults: bool = False, program: object | None = None
    ) -> None:
        """Change what is sent; a set-point that lasts for less than a status period is counted all the same.

        Any command except a step of the `program` ends the program that is followed.
        """
        if self._program is not program:
            self._end_program()
        before_A = self._driver.commanded_A
        self._driver.command(current_A, enable=enable, clear_faults=clear_faults)
        if self._driver.commanded_A != before_A:
            self._set_points += 1

    # State, for any thread

    @property
    def begun(self) -> bool:
        """Its silence counts; not while its current is heard at connect and its slower state is still to come."""
        return self._supervisor.armed or not getattr(self._driver, "waits_for_state", False)

    @property
    def fresh_current_A(self) -> float | None:
        """Measured current (A), None when its status is stale, or may be older than the 0 A that a trip commanded.

        The first one that comes after that may have been measured before it, or asked for.
        Of one set by hand what was said; None if a stop requests its removal and that is not confirmed.
        """
        status = self._driver.status
        if self._zeroed and self.by_hand and not self._is_zero():
            return None
        if self._zeroed and self._before_ns <= self._zeroed_ns:
            return None
        allowed_ns = self._stale_ns + int(self._timeout_s * 1e9)
        if status is None or self.port_lost is not None or monotonic_ns() - self._last_ns > allowed_ns:
            return None
        return status.current_A

    @property
    def commanded_A(self) -> float:
        """Set-point of the commands (A); 0 while the output stage is to be off."""
        return self._driver.commanded_A

    @property
    def coil_degC(self) -> float:
        """Last coil temperature (degC); NaN where it is not measured."""
        temperature = self._driver.temperature
        return math.nan if temperature is None else temperature.coil_degC

    @property
    def identity_problem(self) -> str:
        """Why the ECU is not the described device; empty while it is."""
        return self._driver.identity_problem

    def wait_identity(self, timeout_s: float) -> SourceIdentity | None:
        """The ECU's identity once all that it tells has come; None after `timeout_s` (wall s), or if it has none."""
        with self._progress:
            wait_for(self._progress, lambda: not self.missing, timeout_s)
        return None if self.missing else self._driver.identity

    @property
    def missing(self) -> list[str]:
        """Kinds of frames that the ECU should have sent and has not yet."""
        driver, timing = self._driver, self._driver.timing
        heard = {
            "identity": driver.identity is not None or not timing.identity_s,
            "status": driver.status is not None,
            "temperature": driver.temperature is not None or not timing.temperature_s,
        }
        return [name for name, came in heard.items() if not came]

    @property
    def zero_within_s(self) -> float:
        """After so long a commanded 0 A must be measured (wall s)."""
        slow = self._driver.timing.status_s > SLOW_STATUS_S
        return max(CURRENT_LIMIT_S, self._settle_s + 2e-9 * self._stale_ns if slow else 0.0)

    @property
    def lowest_A(self) -> float | None:
        """The most negative current it drives (A); None: as negative as positive."""
        return self._driver.traits.lowest_A

    @property
    def own_timeout_s(self) -> float | None:
        """Time-out of its own commands that its description declares (wall s); None: none, or set manually."""
        return self._driver.traits.own_timeout_s

    @property
    def falls_within_s(self) -> float | None:
        """After so long without commands it is at 0 A (wall s), or a person is asked; None: it keeps its current."""
        own_s = 0.0 if self.by_hand else self.own_timeout_s
        return None if own_s is None else max(own_s, 1e-9 * self._stale_ns) + self._settle_s

    @property
    def by_hand(self) -> bool:
        """A person sets it; no stop takes it away."""
        return self._driver.traits.by_hand

    @property
    def longest_period_s(self) -> float:
        """Of what it tells (s of its clock)."""
        return max(self._driver.timing)

    @property
    def origins(self) -> Origins:
        """Where the values of its channels come from, as its driver states."""
        return origins_of(self._driver)

    @property
    def refusal(self) -> tuple[str, str]:
        """Slug and words of why its frames cannot be believed; two empty texts while nothing speaks against them."""
        return self._driver.refusal

    @property
    def lacking(self) -> tuple[tuple[str, str], ...]:
        """What it cannot do or does not tell: a name, and what is left without it."""
        return self._driver.lacking

    @property
    def thrown_away(self) -> str:
        """Slug for status frames that come but fail their checks; empty where none do."""
        return thrown_away(self._driver.counters)

    def describe(self) -> str:
        """State and faults in words."""
        status = self._driver.status
        if status is None:
            return "does not send a status"
        if status.state == UNKNOWN_STATE:
            return f"is in an unknown state with faults {SourceFault(status.faults)!r}"
        state = SourceState(status.state).name if status.state in set(SourceState) else str(status.state)
        return f"is in state {state} with faults {SourceFault(status.faults)!r}"

    def counters(self, now_ns: int) -> dict[str, object]:
        """Age of the last status and what was counted."""
        counted = self._driver.counters
        return {
            "age_s": (now_ns - self._last_ns) / 1e9,
            "statuses": counted.statuses,
            "lost": counted.lost,
            "bad": counted.bad_checks + self._driver.malformed,
            "foreign": counted.foreign_commands,
            "sent": counted.sent,
            "late_sends": counted.late_sends,
            "port_lost": self.port_lost,
        }

    # On the thread

    def _read(self) -> None:
        self._listener.restart(monotonic_ns())
        while not self._ending.is_set():
            request_s = self._patience_s()
            try:
                batch = self._driver.read_batch(request_s)
            except DriverError as error:
                self.port_lost = str(error)
                self._supervisor.report([Finding("can-lost", self.port_lost, monotonic_ns())])
                return
            blind_ns = self._listener.returned(request_s, batch.arrival_ns, heard=bool(batch.statuses))
            late = blind_ns > self._late_after_ns
            findings = self._check_batch(batch, late=late)
            if findings:
                self._supervisor.report(findings)
            if batch.records:
                self._append(_stale(batch.records) if late else batch.records)
            if batch.statuses:
                with self._progress:
                    self._progress.notify_all()

    def _patience_s(self) -> float:
        """How long to wait for a frame: no longer than until the last status is stale."""
        left_s = (self._last_ns + self._stale_ns - monotonic_ns()) * 1e-9 + STALE_FOR_SURE_S
        return min(left_s, self._timeout_s) if left_s > 0.0 else self._timeout_s

    def _check_batch(self, batch: SourceBatch, *, late: bool = False) -> list[Finding]:
        """Judge what one read gave; `late`: it may have waited while the station did not run."""
        now_ns = batch.arrival_ns
        findings: list[Finding] = []
        commanded_A = self._driver.commanded_A
        if batch.statuses:
            self._before_ns, self._last_ns = self._last_ns, now_ns
        for status in batch.statuses:
            findings += self.interlock.check_status(status, now_ns)
            if not late and self._driver.traits.measures:
                # What waited may be from before the set-point.
                findings += self._current_interlock.check(status, commanded_A, now_ns, self._set_points)
                findings += self._law_interlock.check(status, commanded_A, now_ns)
        self._report_stamps()
        self._report_not_numbers()
        if batch.statuses:
            # Errors that came with the last status frame may be the beginning of what silences the bus.
            self._bus_errors, self._errors_before = self._errors_before, self._driver.bus_errors
        for temperature in batch.temperatures:
            findings += self.interlock.check_temperature(temperature, now_ns)
        findings += self.interlock.check_temperature_age(now_ns)
        findings += self._bus_interlock.check(self._driver.counters, now_ns)
        if self._driver.send_error is not None:
            findings.append(Finding("can-lost", f"command frames stopped: {self._driver.send_error}", now_ns))
        elif self._zero_error is not None:
            findings.append(Finding("can-lost", f"0 A could not be sent immediately: {self._zero_error}", now_ns))
        if not self.begun:
            return findings
        silence = self._supervisor.host.missed(self.name, self._silence(), self._last_ns, self._stale_ns, now_ns)
        return findings if silence is None else [*findings, silence]

    def _report_stamps(self) -> None:
        """Say once that frames are timed by the interface, and how well."""
        uncertainty_ns = self._driver.counters.stamps_ns
        if uncertainty_ns and not self._stamps_reported:
            self._stamps_reported = True
            self._supervisor.warn(
                "ecu-time-stamps",
                "the CAN interface time-stamps the frames; the time stamps are converted to this host's clock to "
                f"within {uncertainty_ns / 1e3:.0f} us plus the shortest read time",
            )

    def _report_not_numbers(self) -> None:
        """Report once for each channel that its value is no number; the rest of its frames is used."""
        for channel in self._driver.counters.not_numbers.keys() - self._not_numbers_reported:
            self._not_numbers_reported.add(channel)
            self._supervisor.warn(
                "ecu-value-missing",
                f"the {channel.name.lower().replace('_', ' ')} in some frames is not a finite number: this value is "
                "discarded, and the rest of the frame is used",
            )

    def _silence(self) -> str:
        """Why no fresh status comes: the bus has errors, the ECU sends bad or old ones, or it says nothing."""
        if self._driver.bus_errors > self._bus_errors:
            return "can-busoff"
        late = self._driver.counters.lateness > 0
        return thrown_away(self._driver.counters) or ("ecu-late" if late else "ecu-silent")

    def _is_zero(self) -> bool:
        status = self._driver.status
        return status is not None and abs(status.current_A) < ZERO_CURRENT_A

    def _is_clear(self) -> bool:
        status = self._driver.status
        return status is not None and status.faults == 0


def _stale(records: list[Record]) -> list[Record]:
    """The records, flagged: they waited while the station did not run."""
    stale = int(Quality.STALE)
    return [(*record[:5], record[5] | stale) for record in records]
