"""The coil's current set by a person: nothing is on a wire, what flows is what that person said last.

A command that enables the output passes on what the person confirmed; one that switches it off is a stop, which
this program cannot carry out: the confirmed current counts until the operator confirms its removal.
"""

from __future__ import annotations

import threading

from drivers import clock
from drivers.current_source import CurrentSource, SourceBatch, SourceTiming, SourceTraits
from drivers.origins import ChannelOrigin, Origins
from drivers.polled_source import UnmeasuredSource
from drivers.ring import Channel

PERIOD_S = 0.010
_MISSING = (
    ("measurement", "the coil current is not measured: the recorded current is the value that the operator "
        "confirmed; a different current (due to a setting error, heating or a broken coil) is not detected, and "
        "overcurrent, current-tracking and current-stuck cannot stop the rig"),
    ("switch", "a stop cannot switch the current off: the motion stops, the pressure is switched off, and the "
        "operator is asked to set 0 A; force, stroke, speed and position are monitored as usual"),
    ("coil-temperature", "the coil's temperature is not measured: its limit is not monitored, and temperature "
        "windows are rejected"),
)  # fmt: skip


class ManualCurrentSource(UnmeasuredSource):
    """What a person says of the coil's current; a `drivers.current_source.CurrentSource`.

    Args:
        rehearsed: on a simulated rig, the supply whose knob is turned in the person's place; it tells nothing.
    """

    report_every = 100

    def __init__(self, rehearsed: CurrentSource | None = None) -> None:
        super().__init__()
        self._rehearsed = rehearsed
        self._woken = threading.Event()

    @property
    def timing(self) -> SourceTiming:
        """What was said is repeated as if it came by CAN; nothing else is told."""
        return SourceTiming(PERIOD_S, 0.0, 0.0)

    @property
    def traits(self) -> SourceTraits:
        """Nothing is measured, one sign, and no stop reaches it."""
        return SourceTraits(own_timeout_s=None, measures=False, settling_s=PERIOD_S, lowest_A=0.0, by_hand=True)

    @property
    def origins(self) -> Origins:
        """Nothing is measured: what the operator confirmed."""
        stated = ChannelOrigin(
            "operator", "value confirmed by the operator; not measured",
            "Coil current set manually and confirmed by the operator; not measured",
        )
        derived = ChannelOrigin("station", "value = derived from the operator's confirmation; not reported by any "
            "device")
        own = self._origins("operator", stated, stated.from_wire)
        return {**own, Channel.ECU_STATE: derived, Channel.ECU_FAULTS: derived}

    @property
    def lacking(self) -> tuple[tuple[str, str], ...]:
        """What is not there where a person sets the current, and what is left without it."""
        return _MISSING

    @property
    def identity_problem(self) -> str:
        """The supply cannot be identified."""
        return ""

    @property
    def malformed(self) -> int:
        """Nothing comes in."""
        return 0

    def open(self) -> None:
        """Open the rehearsed supply, if there is one.

        Raises:
            PortClosed: it cannot be opened.
        """
        if self._rehearsed is not None:
            self._rehearsed.open()

    def close(self) -> None:
        """Leave the rehearsed supply, if there is one, at 0 A."""
        if self._rehearsed is not None:
            self._rehearsed.close()

    def start(self, period_s: float) -> None:
        """Make the rehearsed supply ready, if there is one."""
        if self._rehearsed is not None:
            self._rehearsed.start(period_s)

    def command(self, current_A: float, *, enable: bool = True, clear_faults: bool = False) -> None:
        """Take the confirmed current (A); a stop (`enable` False) changes nothing: the knob has not been turned."""
        if not enable:
            return
        self._requested = current_A, True
        if self._rehearsed is not None:
            self._rehearsed.command(current_A, enable=current_A != 0.0, clear_faults=clear_faults)

    def send_now(self) -> None:
        """Tell it at once."""
        self.counters.sent += 1
        self._records.append(self._command_record(clock.monotonic_ns()))
        if self._rehearsed is not None:
            self._rehearsed.send_now()
        self._woken.set()

    def read_batch(self, timeout_s: float) -> SourceBatch:
        """What was said, once more, after a period at most.

        Raises:
            PortClosed: the rehearsed supply's port is gone.
            LinkLost: it does not take a question.
        """
        wait_s = min(timeout_s, PERIOD_S)
        if self._rehearsed is None:
            clock.back_within(wait_s)
            self._woken.wait(wait_s)
            self._woken.clear()
        else:
            self._rehearsed.read_batch(wait_s)
        now_ns = clock.monotonic_ns()
        self._polls += 1
        self.counters.statuses += 1
        status, records = self._report(self.commanded_A, now_ns)
        batch = SourceBatch(records, [status], [], 0, 0, now_ns)
        self._hand_over(batch)
        return batch
