"""What the sources of the coil's current have in common that are not on CAN: supplies, analogue outputs, a person."""

from __future__ import annotations

from collections import deque

from drivers import clock
from drivers.current_source import (
    SourceBatch,
    SourceCounters,
    SourceIdentity,
    SourceState,
    SourceStatus,
    SourceTemperature,
    SourceTiming,
)
from drivers.devices.supply import SupplyConnection, supply_missing
from drivers.errors import DriverError
from drivers.origins import ChannelOrigin, Origins
from drivers.ring import NO_DEVICE_TIME, Channel, Record
from protocols.errors import LocalProtocolError
from protocols.quality import Quality

DEVICE = "ecu"
REPORT_EVERY = 10
"""Polls between two records of a state that does not change."""
_RECORDS_KEPT = 4096


class UnmeasuredSource:
    """What is wanted of a source, what it was found to do, and the records of both; the wire is its heirs' own."""

    report_every = REPORT_EVERY

    def __init__(self) -> None:
        self.counters = SourceCounters()
        self.status: SourceStatus | None = None
        self.temperature: SourceTemperature | None = None
        self.identity: SourceIdentity | None = None
        self.send_error: DriverError | None = None
        self.bus_errors = 0
        self._requested = (0.0, False)
        self._polls = self._faults = 0
        self._reported: tuple[int, int] | None = None
        self._records: deque[Record] = deque(maxlen=_RECORDS_KEPT)

    def _origins(self, source: str, current: ChannelOrigin, commanded: str) -> Origins:
        """Origins of a source whose state and faults are what its driver found.

        Args:
            source: what it is.
            current: of the current that flows.
            commanded: how the set-point was written.
        """
        derived = ChannelOrigin(source, "value = derived by the driver from the set-point, the answers and the faults")
        return {
            Channel.COIL_CURRENT: current, Channel.COMMANDED_CURRENT: ChannelOrigin(source, commanded),
            Channel.ECU_STATE: derived, Channel.ECU_FAULTS: derived,
        }

    @property
    def refusal(self) -> tuple[str, str]:
        """Nothing speaks against what is heard."""
        return "", ""

    @property
    def commanded_A(self) -> float:
        """Set-point, A; 0 while the output is to be off."""
        current_A, enable = self._requested
        return current_A if enable else 0.0

    def _report(self, current_A: float, arrival_ns: int) -> tuple[SourceStatus, list[Record]]:
        """What is known now that so much flows: the status, and what of it is recorded."""
        state = SourceState.OFF if self.commanded_A == 0.0 else SourceState.ENABLED
        status = SourceStatus(SourceState.FAULT if self._faults else state, current_A, self._faults)
        self.status = status
        records = [self._record(arrival_ns, Channel.COIL_CURRENT, current_A), self._command_record(arrival_ns)]
        if self._reported != (status.state, status.faults) or self._polls % self.report_every == 1:
            self._reported = (status.state, status.faults)
            records.append(self._record(arrival_ns, Channel.ECU_STATE, status.state))
            records.append(self._record(arrival_ns, Channel.ECU_FAULTS, status.faults))
        return status, records

    def _hand_over(self, batch: SourceBatch) -> None:
        """Put what was recorded meanwhile into a batch, everything in its order of time."""
        while self._records:
            batch.records.append(self._records.popleft())
        batch.records.sort(key=lambda record: record[0])

    def _record(self, arrival_ns: int, channel: Channel, value: float) -> Record:
        number = self.counters.statuses & 0xFFFFFFFF
        return arrival_ns, NO_DEVICE_TIME, float(value), number, int(channel), int(Quality.GOOD)

    def _command_record(self, now_ns: int) -> Record:
        return now_ns, NO_DEVICE_TIME, self.commanded_A, self.counters.sent, int(Channel.COMMANDED_CURRENT), 0


class PolledSource(UnmeasuredSource):
    """A source with a description that is asked for what flows.

    Args:
        connection: how to reach it.
        called: what it is, in messages.
    """

    def __init__(self, connection: SupplyConnection, called: str) -> None:
        super().__init__()
        self._connection = connection
        self._described = connection.description
        self._called = called
        self._changed_ns = self._due_ns = self._open = 0
        self._started = False

    @property
    def timing(self) -> SourceTiming:
        """The current at every poll, its identity once, temperatures never."""
        return SourceTiming(self._connection.poll_s, 0.0, self._connection.poll_s)

    @property
    def lacking(self) -> tuple[tuple[str, str], ...]:
        """What it cannot do, and what is left without it."""
        return supply_missing(self._described)

    def _want(self, current_A: float, *, enable: bool) -> bool:
        """Take a set-point; whether it is another one.

        Raises:
            LocalProtocolError: it is beyond what the source gives; the old one stays.
        """
        low_A, high_A = self._described.current_A
        if current_A != 0.0 and not low_A <= current_A <= high_A:
            raise LocalProtocolError(
                f"{current_A:g} A is outside the {self._called}'s range of {low_A:g} to {high_A:g} A"
            )
        changed = self._requested != (current_A, enable)
        self._requested = (current_A, enable)
        if changed:
            self._changed_ns = clock.monotonic_ns()
        return changed

    def _plan_next_poll(self, now_ns: int) -> None:
        """A poll that comes late is not made up for by a burst."""
        period_ns = int(self._connection.poll_s * 1e9)
        self._due_ns = self._due_ns + period_ns if self._due_ns + period_ns > now_ns else now_ns + period_ns

    def _settled(self, now_ns: int) -> bool:
        """Whether the current has had its time since the set-point changed."""
        return now_ns - self._changed_ns > int(self._described.settling_s * 1e9)
