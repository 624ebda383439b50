"""The coil's current by an analogue output: a module on Modbus whose value commands a current amplifier.

A thread of the driver asks and writes, one request at a time. A set-point goes out before anything else, as soon as the
answer under way has come: the thread that requests it wakes that thread. It goes on as long as the driver is open: a
module that comes back receives 0 A, even if the driver was abandoned meanwhile.
"""

from __future__ import annotations

import contextlib
import math
import threading
from collections import deque

from drivers import clock
from drivers.current_source import SourceBatch, SourceFault, SourceIdentity, SourceStatus, SourceTraits
from drivers.devices.output import CURRENT, ENABLE, IDENTITY, MEASURED, AnalogueOutput
from drivers.devices.supply import SupplyConnection
from drivers.errors import Busy, DriverError, LinkLost, NoAnswer, RequestRefused, WrongAnswer
from drivers.modbus_line import ModbusLine, SharedWire
from drivers.modbus_link import ModbusLink
from drivers.origins import ChannelOrigin, Origins
from drivers.polled_source import DEVICE, PolledSource
from drivers.register_access import RegisterAccess
from drivers.register_maps.condition import Values
from drivers.register_maps.quantity import Value, same
from drivers.register_maps.recipe import Recipe, Write

IN_A_ROW = 3
OPEN_SHARE = 0.1
"""Less of the wanted current than this is none: the circuit is open, or the amplifier is off."""
COUNTERS = 1 << 16
AGAIN_S = 0.1
"""A module that cannot be reached is tried again so often."""
_HEARD_KEPT = 4096
_CLOSING_S = 0.5


class ModbusOutput(PolledSource):
    """Drives one analogue output; a `drivers.current_source.CurrentSource`.

    Only one thread may call `read_batch`; any thread may call `command` and `send_now`. Nothing is written before
    `start`.

    Args:
        connection: address and settings of the device.
        output: registers of the output.
        line: the connection if it is shared with sensors; None: a separate connection.
    """

    def __init__(
        self, connection: SupplyConnection, output: AnalogueOutput, line: ModbusLine | None = None
    ) -> None:
        super().__init__(connection, "output")
        described = connection.description
        self.malformed = 0
        self._output = output
        self._link = ModbusLink(
            connection.url, connection.device_id, connection.timeout_s, device=DEVICE,
            baudrate=connection.baudrate or described.link.baudrate, parity=described.link.parity,
            wire=None if line is None else SharedWire(line, connection.device_id, DEVICE),
        )
        self._access = RegisterAccess(self._link, output.rules, together=False)
        self._held_A: float | None = None
        """What the module has taken (A); None before the first write."""
        self._woken, self._leaving = threading.Event(), threading.Event()
        self._progress = threading.Condition()
        self._worker: threading.Thread | None = None
        self._lost: DriverError | None = None
        self._heard: deque[SourceStatus] = deque(maxlen=_HEARD_KEPT)
        self._prepared = self._refused = False
        self._bad_reported = self._odd = self._fed = 0
        self._who = self._problem = ""

    @property
    def traits(self) -> SourceTraits:
        """What else the rig has to know of it."""
        watchdog = self._output.watchdog
        return SourceTraits(
            own_timeout_s=None if watchdog is None else watchdog.time_s, measures=self._output.measures,
            settling_s=self._described.settling_s, lowest_A=min(0.0, self._described.current_A[0]),
        )

    @property
    def origins(self) -> Origins:
        """The registers that each channel is made of; without an input that measures, the set-point stands for it."""
        quantities = self._output.quantities
        written = f"value = {self._output.current.on_wire}"
        if MEASURED in quantities:
            current = ChannelOrigin(
                "output", f"value = {quantities[MEASURED].on_wire}", "Coil current measured by the analogue output"
            )
        else:
            current = ChannelOrigin(
                "set-point", "the set-point accepted by the output; not measured",
                "Coil current commanded to an analogue output; not measured",
            )
        return self._origins("output", current, written)

    @property
    def identity_problem(self) -> str:
        """Why the module is not the one expected; empty while it is, or has not been asked."""
        return self._problem

    def open(self) -> None:
        """Open the connection and begin to ask.

        Raises:
            PortClosed: it cannot be opened.
        """
        if self._worker is None:
            self._link.open()
            self._due_ns, self._who, self._problem = 0, "", ""
            self._prepared, self._lost = False, None
            self._leaving.clear()
            self._worker = threading.Thread(target=self._work, name="ecu-output", daemon=True)
            self._worker.start()

    def close(self) -> None:
        """0 A, output off and its time-out ended if anything was ever set, connection closed; twice is harmless."""
        if self._worker is None:
            return
        self.command(0.0, enable=False)
        self._leaving.set()
        self._woken.set()
        self._worker.join(_CLOSING_S + 2.0 * self._connection.timeout_s)
        self._worker, self._started = None, False
        self._link.close()

    def start(self, period_s: float) -> None:
        """Set it up and 0 A, output off, its time-out on; polls go on as before."""
        del period_s
        self._started, self._prepared = True, False
        self.send_now()

    def command(self, current_A: float, *, enable: bool = True, clear_faults: bool = False) -> None:
        """Set what is asked for next; `clear_faults` forgets what was found, too.

        Raises:
            LocalProtocolError: the set-point is beyond what the output gives; the old one stays.
        """
        if self._want(current_A, enable=enable):
            self._woken.set()
            with self._progress:
                self._heard.clear()
        if clear_faults:
            self._faults = self._open = self._odd = 0

    def send_now(self) -> None:
        """Have the set-point written before anything else."""
        self.counters.sent += 1
        with self._progress:
            self._records.append(self._command_record(clock.monotonic_ns()))
        self._woken.set()

    def read_batch(self, timeout_s: float) -> SourceBatch:
        """What was told since the last call, waiting up to `timeout_s` for the first status.

        Raises:
            PortClosed: the connection is gone, and there is none to be had.
            RequestRefused: the module has no such registers.
        """
        batch = SourceBatch([], [], [], 0, self.counters.bad_checks - self._bad_reported, 0)
        self._bad_reported += batch.bad
        clock.back_within(timeout_s)
        with self._progress:
            self._progress.wait_for(lambda: self._heard or self._lost is not None, timeout_s)
            while self._heard:
                batch.statuses.append(self._heard.popleft())
            if self._lost is not None and not batch.statuses:
                raise self._lost
            self._hand_over(batch)
        return batch._replace(arrival_ns=clock.monotonic_ns())

    # The thread that asks and writes

    def _work(self) -> None:
        """Write what is wanted and ask what is due, until the end; a lost connection is looked for again and again."""
        while not self._leaving.is_set():
            try:
                self._turn()
            except LinkLost:
                self._link.close()
            except DriverError as error:
                self._link.close()
                with self._progress:
                    self._lost = error
                    self._progress.notify_all()
                self._leaving.wait(AGAIN_S)
        clock.back_whenever()
        # A link that is gone takes no farewell.
        with contextlib.suppress(DriverError):
            self._farewell()

    def _turn(self) -> None:
        if not self._link.is_open:
            # What was to be set is not known to have arrived.
            self._link.open(self._connection.timeout_s)
            self._woken.set()
        if self._woken.is_set():
            self._woken.clear()
            if self._started:
                self._set()
                self._due_ns = 0
        now_ns = clock.monotonic_ns()
        if now_ns >= self._due_ns:
            self._poll(now_ns)
        left_s = max(0.0, (self._due_ns - clock.monotonic_ns()) * 1e-9)
        clock.back_within(left_s)
        self._woken.wait(left_s)

    def _farewell(self) -> None:
        deadline_ns = clock.monotonic_ns() + int(_CLOSING_S * 1e9)
        while self._started and self._link.is_open and clock.monotonic_ns() < deadline_ns:
            self._woken.clear()
            self._set()
            if not self._woken.is_set():
                if self._output.watchdog is not None:
                    self._write(self._output.watchdog.stop)
                return

    # Writing

    def _set(self) -> None:
        """Write the set-point as it stands; what did not arrive is written again at once."""
        watchdog, self._refused = self._output.watchdog, False
        if not self._prepared:
            self._prepared = self._write((*self._output.prepare, *(() if watchdog is None else watchdog.start)))
        target_A = self.commanded_A
        current, enable = self._output.current, self._output.quantities.get(ENABLE)
        zero = target_A == 0.0 and not self._described.drives_zero
        done = zero or self._write((Write({current: target_A}),))
        if enable is not None:
            # Tried whatever became of the set-point: either takes the current away.
            done &= self._write((Write({enable: int(target_A != 0.0)}),))
        if done and self._refused:
            return  # It still holds what it took before; the refusal is a fault, asking again would change nothing.
        if done:
            self._held_A = None if zero else float(current.decode(current.encode(target_A)))
        else:
            self._woken.set()

    def _write(self, recipe: Recipe, given: Values | None = None) -> bool:
        """The requests of a recipe; whether all were answered. One that is refused is a fault of its own.

        Raises:
            DriverError: the connection broke.
        """
        done = True
        for step in recipe:
            requests = step.requests(given or {}) if isinstance(step, Write) else ()
            for request in requests:
                try:
                    self._access.write(request)
                except (NoAnswer, Busy, WrongAnswer) as error:
                    done = False
                    self._bad(error)
                except RequestRefused:
                    self._faults |= SourceFault.COMMAND_CHECK
                    self._refused = True
        return done

    # Asking

    def _poll(self, now_ns: int) -> None:
        """Feed its watchdog, ask for what it shows; before that once who it is."""
        self._plan_next_poll(now_ns)
        self._polls += 1
        watchdog = self._output.watchdog
        if self._started and watchdog is not None:
            self._fed = (self._fed + 1) % COUNTERS
            self._write(watchdog.feed, {"counter": self._fed, "toggle": self._fed & 1})
        try:
            if not self._who:
                self._know(self._access.read(self._output.known, "identity"))
            values = self._access.read(self._output.status, "status")
        except (NoAnswer, Busy, WrongAnswer) as error:
            self._bad(error)
            return
        self._take(values)

    def _bad(self, error: DriverError) -> None:
        """What came and cannot be an answer counts; silence is noticed by what stays away."""
        if isinstance(error, WrongAnswer):
            self.counters.bad_checks += 1
            self.counters.bad_in_a_row += 1

    def _know(self, values: Values) -> None:
        """It has said who it is."""
        shown = {name: str(values.get(name, "")) for name in IDENTITY}
        shown_text = ", ".join(text for text in shown.values() if text)
        self._who = shown_text or self._described.name
        quantities, text = self._output.quantities, self._connection.identity
        wrong = [
            f"{name} is {values[name]!r:.60}, expected {value!r:.60}"
            for name, value in self._output.expected.items()
            if not same(values[name], value, quantities[name].step)
        ]
        if text not in shown_text:
            wrong.append(f"identification: got {shown_text!r:.100}, expected text that contains {text!r}")
        self._problem = "; ".join(wrong)
        self.identity = SourceIdentity(shown["serial_number"], shown["firmware"], 0)

    def _take(self, values: dict[str, Value]) -> None:
        """What it shows, judged: what it holds, what flows."""
        arrival_ns, counters = clock.monotonic_ns(), self.counters
        if not all(math.isfinite(float(values[name])) for name in (CURRENT, MEASURED) if name in values):
            counters.bad_checks += 1
            counters.bad_in_a_row += 1
            counters.unmeasured_in_a_row += 1
            return
        counters.bad_in_a_row = counters.unmeasured_in_a_row = 0
        counters.statuses += 1
        shown_A = float(values[CURRENT]) if CURRENT in values else self._held_A or 0.0
        current_A = float(values[MEASURED]) if MEASURED in values else shown_A
        if ENABLE in values and MEASURED not in values and not values[ENABLE]:
            current_A = 0.0
        self._faults |= self._output.faults.meaning(values) & sum(SourceFault)
        self._check_held(shown_A, values)
        self._check_open(current_A, arrival_ns)
        status, records = self._report(current_A, arrival_ns)
        with self._progress:
            self._records.extend(records)
            # What was shown before a set-point that waits to be written proves nothing of it.
            if not self._woken.is_set():
                self._heard.append(status)
                self._progress.notify_all()

    def _check_held(self, shown_A: float, values: Values) -> None:
        """A module that does not hold what it took: it restarted, its time-out expired, or another master writes."""
        if self._held_A is None or self._woken.is_set():
            return
        off = ENABLE in values and bool(values[ENABLE]) is not (self.commanded_A != 0.0)
        odd = off or not same(shown_A, self._held_A, self._output.current.step)
        self._odd = self._odd + 1 if odd else 0
        if self._odd >= IN_A_ROW:
            self._faults |= SourceFault.RESTARTED

    def _check_open(self, current_A: float, now_ns: int) -> None:
        target_A = abs(self.commanded_A)
        none = self._output.measures and self._settled(now_ns) and abs(current_A) < OPEN_SHARE * target_A
        self._open = self._open + 1 if none else 0
        if self._open >= IN_A_ROW:
            self._faults |= SourceFault.OPEN
