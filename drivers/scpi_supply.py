"""The coil's current by a programmable supply: lines of text over a serial line or a network, its commands as data.

One thread reads; it asks for the measured current at every poll, and for one of the other things that the supply can
tell in turn. A set-point goes out at once, whichever thread asks for it: nothing waits for an answer under way.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from drivers import clock
from drivers.current_source import SourceBatch, SourceFault, SourceTraits
from drivers.devices.supply import Commands, SupplyConnection, identity_of
from drivers.errors import DriverError
from drivers.origins import ChannelOrigin, Origins
from drivers.polled_source import DEVICE, PolledSource
from drivers.ring import Channel
from drivers.serial_port import SerialPort
from drivers.supply_dialogue import ExpectedReply, Job, SupplyDialogue
from protocols.errors import RemoteProtocolError
from protocols.patterns import Pattern
from protocols.scpi import Command, number_in

OPEN_IN_A_ROW = 3
COMPLIANCE_SHARE = 0.97
SHORT_OF_SHARE, SHORT_OF_A = 0.05, 0.05
_CLOSING_S = 0.5


class ScpiSupply(PolledSource):
    """Drives one supply; a `drivers.current_source.CurrentSource`.

    `read_batch` belongs to one owner thread; `command` and `send_now` may be called from any thread. Before `start`
    nothing is set: the supply is asked who it is and what flows.

    Args:
        connection: how to reach it.
    """

    def __init__(self, connection: SupplyConnection) -> None:
        super().__init__(connection, "supply")
        described = self._described
        link = described.link
        self._port = SerialPort(
            connection.url.replace("tcp://", "socket://", 1),
            link.baudrate if connection.baudrate is None else connection.baudrate,
            device=DEVICE, bytesize=link.bytesize, parity=link.parity, stopbits=link.stopbits,
        )
        self._dialogue = SupplyDialogue(
            self._port, link, connection.timeout_s, described.commands.identify, self._numbers
        )
        self._output_on = self._again = False
        self._identity = ""
        self._late = 0
        self._volts = 0.0

    @property
    def traits(self) -> SourceTraits:
        """What else the rig has to know of it."""
        described = self._described
        return SourceTraits(
            own_timeout_s=None if described.watchdog is None else described.watchdog.time_s,
            settling_s=described.settling_s, lowest_A=min(0.0, described.current_A[0]),
        )

    @property
    def origins(self) -> Origins:
        """The commands and answers that each channel is made of."""
        described = self._described
        commands = described.commands
        current = ChannelOrigin(
            "supply", f"value = {_answered(commands.measure_current, described.current)}",
            "Coil current measured by the power supply",
        )
        sent = " ".join(command.text for command in commands.set_current)
        factor = "0.001 * " if "{current_mA" in sent else ""
        own = self._origins("supply", current, f"value = {factor}number sent in {sent!r}")
        if not commands.measure_voltage:
            return own
        volts = f"value = {_answered(commands.measure_voltage, described.voltage)}"
        return {**own, Channel.ECU_SUPPLY: ChannelOrigin("supply", volts, "Voltage at the power supply's output")}

    @property
    def identity_problem(self) -> str:
        """Why the supply is not the one expected; empty while it is, or has not said who it is."""
        pattern, text = self._described.identity, self._connection.identity
        if not self._identity:
            return ""
        if pattern is not None and not pattern.search(self._identity):
            return f"identification: got {self._identity!r:.100}, expected a match for {pattern.text!r}"
        return (
            f"identification: got {self._identity!r:.100}, expected text that contains {text!r}"
        ) if text not in self._identity else ""

    @property
    def malformed(self) -> int:
        """Answers that are none."""
        return self.counters.malformed + self._dialogue.malformed

    def open(self) -> None:
        """Open the port; the first questions go out with the first `read_batch`.

        Raises:
            PortClosed: it cannot be opened.
        """
        if not self._port.is_open:
            self._port.open()
            self._dialogue.forget()
            self._identity, self._due_ns = "", 0

    def close(self) -> None:
        """0 A and output off if anything was ever set, local mode, port closed; twice is harmless."""
        if not self._port.is_open:
            return
        # A port that is gone takes no farewell.
        with contextlib.suppress(DriverError):
            if self._started:
                self.command(0.0, enable=False)
                self.send_now()
                self._dialogue.jobs.extend(Job(command) for command in self._watchdog("stop"))
            commands = self._described.commands
            self._dialogue.jobs.extend(Job(command) for command in commands.local)
            self._dialogue.jobs.extend(Job(command, ExpectedReply.IDENTITY) for command in commands.identify)
            self._await_silence()
        self._started = False
        self._port.close()

    def start(self, period_s: float) -> None:
        """Set 0 A, output off, clear its errors, set its voltage limit and time-out; polls go on as before.

        Raises:
            PortClosed: the port is gone.
            LinkLost: it does not take the commands.
        """
        del period_s
        self._started = True
        self.send_now()
        commands = self._described.commands
        limit = commands.set_voltage_limit if self._connection.voltage_limit_V is not None else ()
        self._dialogue.jobs.extend(Job(command) for command in (*commands.clear, *limit, *self._watchdog("start")))

    def command(self, current_A: float, *, enable: bool = True, clear_faults: bool = False) -> None:
        """Set what is asked for next; `clear_faults` forgets what was found, too.

        Raises:
            LocalProtocolError: the set-point is beyond what the supply gives; the old one stays.
        """
        self._want(current_A, enable=enable)
        if clear_faults:
            self._faults = self._open = 0
            self._dialogue.refused = False

    def send_now(self) -> None:
        """Send the set-point at once, beside whatever is under way.

        Raises:
            PortClosed: the port is gone.
            LinkLost: it does not take the commands.
        """
        self._dialogue.send_now(self._set_point)
        self.counters.sent += 1
        # A supply that needs a pause between commands may have lost this; the reading thread repeats it with one.
        self._again = self._described.link.gap_s > 0.0
        self._records.append(self._command_record(clock.monotonic_ns()))

    def read_batch(self, timeout_s: float) -> SourceBatch:
        """Ask what is due and take what has arrived, until the current was told or the time is over.

        Raises:
            PortClosed: the port is not open, or gone.
            LinkLost: it does not take a question.
        """
        bad_before = self.counters.bad_checks
        deadline_ns = clock.monotonic_ns() + int(timeout_s * 1e9)
        batch = SourceBatch([], [], [], 0, 0, 0)
        while True:
            now_ns = clock.monotonic_ns()
            next_ns = self._go_on(now_ns)
            data, arrival_ns = self._port.read_available(max(0.0, (min(deadline_ns, next_ns) - now_ns) * 1e-9))
            for kind, answer in self._dialogue.feed(data):
                self._take(kind, answer, arrival_ns, batch)
            if batch.statuses or arrival_ns >= deadline_ns:
                break
        self._hand_over(batch)
        return batch._replace(bad=self.counters.bad_checks - bad_before, arrival_ns=arrival_ns)

    # Sending

    def _numbers(self) -> tuple[float, float, float]:
        watchdog = self._described.watchdog
        limit_V = self._connection.voltage_limit_V
        return self.commanded_A, 0.0 if limit_V is None else limit_V, 0.0 if watchdog is None else watchdog.time_s

    def _set_point(self) -> list[Command]:
        """The commands of the set-point as it stands; 0 A: the current first, then the output off."""
        commands, described = self._described.commands, self._described
        if self.commanded_A != 0.0:
            switch = () if self._output_on else commands.output_on
            self._output_on = bool(commands.output_on)
            return [*commands.set_current, *switch]
        self._output_on = False
        return [*(commands.set_current if described.drives_zero else ()), *commands.output_off]

    def _watchdog(self, what: str) -> tuple[Command, ...]:
        watchdog = self._described.watchdog
        commands: tuple[Command, ...] = () if watchdog is None else getattr(watchdog, what)
        return commands

    def _go_on(self, now_ns: int) -> int:
        """Send what is due; when to look again (ns)."""
        dialogue = self._dialogue
        if dialogue.late != self._late:
            self._late = dialogue.late
            # What was to be set is not known to have arrived.
            self._again = self._started
        if self._again and self._identity:
            self._again, self._output_on = False, False
            dialogue.jobs.extendleft(reversed([Job(c, None, dialogue.set_point) for c in self._set_point()]))
        if not dialogue.jobs and now_ns >= self._due_ns:
            dialogue.jobs.extend(self._poll(now_ns))
        return dialogue.go_on(now_ns) or self._due_ns

    def _poll(self, now_ns: int) -> Iterator[Job]:
        """What is asked now: who it is, until it has said so; then the current, and one of the other things."""
        self._plan_next_poll(now_ns)
        commands = self._described.commands
        if not self._identity:
            yield from (Job(command) for command in commands.connect)
        if not self._identity and commands.identify:
            yield from (Job(command, ExpectedReply.IDENTITY) for command in commands.identify)
            return
        if not self._identity:
            yield from self._know(self._described.name)
        self._polls += 1
        yield from (Job(command, ExpectedReply.CURRENT) for command in commands.measure_current)
        yield from (Job(command) for command in self._watchdog("feed"))
        others = [
            *(Job(command, ExpectedReply.VOLTAGE) for command in commands.measure_voltage),
            *(Job(command, ExpectedReply.FAULTS) for command in commands.read_faults),
            *(Job(command, ExpectedReply.OUTPUT) for command in commands.read_output),
            *(Job(command, ExpectedReply.ERROR) for command in commands.error_queue if self._started),
        ]
        if others:
            yield others[self._polls % len(others)]

    def _know(self, answer: str) -> Iterator[Job]:
        """It has said who it is; what makes it listen."""
        first, self._identity = not self._identity, answer
        self.identity = identity_of(answer)
        self._dialogue.know(answer)
        commands = self._described.commands
        yield from (Job(command) for command in (*commands.remote, *commands.prepare) if first)

    # What comes back

    def _take(self, kind: ExpectedReply, answer: str, arrival_ns: int, batch: SourceBatch) -> None:
        """One answer of the supply."""
        if kind is ExpectedReply.NOTHING:
            self.counters.other_frames += 1
        elif kind is ExpectedReply.IDENTITY:
            self._dialogue.jobs.extend(self._know(answer))
        elif kind is ExpectedReply.ERROR:
            if not self._described.no_error.search(answer):
                self._faults |= SourceFault.COMMAND_CHECK
        elif kind is ExpectedReply.OUTPUT:
            self._take_output(on=answer in self._described.on)
        else:
            self._take_number(kind, answer, arrival_ns, batch)

    def _take_number(self, kind: ExpectedReply, answer: str, arrival_ns: int, batch: SourceBatch) -> None:
        described = self._described
        try:
            if kind is ExpectedReply.VOLTAGE:
                self._volts = number_in(answer, described.voltage)
                batch.records.append(self._record(arrival_ns, Channel.ECU_SUPPLY, self._volts))
            elif kind is ExpectedReply.EARLIER:
                # It proves nothing of what was sent meanwhile: asked anew at once.
                self._due_ns = 0
                flowed_A = number_in(answer, described.current)
                batch.records.append(self._record(arrival_ns, Channel.COIL_CURRENT, flowed_A))
            elif kind is ExpectedReply.CURRENT:
                self._take_current(number_in(answer, described.current), arrival_ns, batch)
            elif kind is ExpectedReply.FAULTS:
                word = int(number_in(answer))
                self._faults |= sum(meaning for bit, meaning in described.faults if word & bit)
            else:
                raise RemoteProtocolError(f"{answer!r:.60}: expected an echo of the command")
        except RemoteProtocolError:
            self.counters.bad_checks += 1
            self.counters.bad_in_a_row += 1
            self.counters.unmeasured_in_a_row += 1

    def _take_current(self, current_A: float, arrival_ns: int, batch: SourceBatch) -> None:
        self.counters.bad_in_a_row = self.counters.unmeasured_in_a_row = 0
        self.counters.statuses += 1
        self._check_compliance(current_A, arrival_ns)
        if self._dialogue.refused:
            self._faults |= SourceFault.COMMAND_CHECK
        status, records = self._report(current_A, arrival_ns)
        batch.statuses.append(status)
        batch.records.extend(records)

    def _check_compliance(self, current_A: float, now_ns: int) -> None:
        """Too little current at the highest voltage allowed: the coil's circuit is open, or the limit too low."""
        target_A, limit_V = abs(self.commanded_A), self._connection.voltage_limit_V
        short_of = abs(current_A) < target_A * (1.0 - SHORT_OF_SHARE) - SHORT_OF_A
        at_limit = limit_V is not None and abs(self._volts) >= COMPLIANCE_SHARE * limit_V
        self._open = self._open + 1 if short_of and at_limit and self._settled(now_ns) else 0
        if self._open >= OPEN_IN_A_ROW:
            self._faults |= SourceFault.OPEN

    def _take_output(self, *, on: bool) -> None:
        """An output that is off although it was switched on: protection, restart, or a manual switch."""
        if self._output_on and not on and not self._faults and self._settled(clock.monotonic_ns()):
            self._faults |= SourceFault.RESTARTED

    def _await_silence(self) -> None:
        """Go on until everything is sent and answered, so that closing cuts nothing off."""
        deadline_ns = clock.monotonic_ns() + int(_CLOSING_S * 1e9)
        dialogue = self._dialogue
        while (dialogue.jobs or dialogue.waits) and clock.monotonic_ns() < deadline_ns:
            dialogue.go_on(clock.monotonic_ns())
            data, _ = self._port.read_available(0.005 if dialogue.jobs else 0.05)
            for _ in dialogue.feed(data):
                pass


def _answered(question: Commands, pattern: Pattern | None) -> str:
    """Where a number stands in the answer to a question, in words."""
    words = " ".join(command.text for command in question)
    return f"number in the answer to {words!r}" + ("" if pattern is None else f", group value of {pattern.text!r}")
