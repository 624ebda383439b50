"""From a sensor's bytes to ring records: unwrapped counters, counted losses, flags.

Loss is counted from the sequence number where the format has one. A format without one is counted against its nominal
rate (`RateWatch`), which sees a shortfall only beyond its tolerance; what is found missing is skipped in the sequence,
so that a count of samples remains a clock. Where the rig's clock is not the host's (a simulated one at speed) there is
nothing to count against.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from drivers.ring import NO_DEVICE_TIME, Channel, Record, edge_channel
from protocols.frame_format import (
    DEVICE_US_MODULUS,
    EDGE_MODULUS,
    SEQUENCE_MODULUS,
    STATUS_EDGE,
    STATUS_OVERLOAD,
    STATUS_SENSOR_FAULT,
    Reading,
)
from protocols.quality import Quality

_SEQUENCE_MASK = SEQUENCE_MODULUS - 1
_SEQUENCE_HALF = SEQUENCE_MODULUS // 2
_US_MASK = DEVICE_US_MODULUS - 1
_US_HALF = DEVICE_US_MODULUS // 2
_RECORD_MASK = 0xFFFFFFFF
_CLOCK_JUMP_US = 1_000_000
_CLOCK_JUMP_PERIODS = 10


class Decoder(Protocol):
    """Turns chunks of a byte stream into readings; `protocols` has one for each kind of format."""

    bad_frames: int
    skipped_bytes: int

    def feed(self, chunk: bytes) -> list[Reading]:
        """Readings completed by these bytes."""

    def clear(self) -> None:
        """Forget the unfinished tail."""


class Batch(NamedTuple):
    """What one read gave.

    Attributes:
        records: ring records in SI, samples and edges in the order of the wire.
        lost: samples found missing in this batch.
        arrival_ns: monotonic time at which the bytes were there, ns; of a time-out, when it ended.
    """

    records: list[Record]
    lost: int
    arrival_ns: int


@dataclass(slots=True)
class SampleCounters:
    """Totals since the stream began; none of them ever decreases."""

    samples: int = 0
    lost: int = 0
    duplicates: int = 0
    clock_errors: int = 0
    edges: int = 0
    edges_missed: int = 0
    overloads: int = 0
    sensor_faults: int = 0
    not_numbers: int = 0


class RateWatch:
    """Counts missing samples of a stream that carries no sequence number.

    Samples of each second are compared with the nominal rate. Less than the tolerance (1 % and 2 samples, for the
    device's clock and its bursts) passes unseen. A second ends with samples that arrive: what a line holds back until
    then is late, not lost.

    Args:
        rate_Hz: samples a second of the host's clock.
    """

    WINDOW_NS = 1_000_000_000

    def __init__(self, rate_Hz: float) -> None:
        self.rate_Hz = rate_Hz
        self._begin_ns: int | None = None
        self._received = 0

    def missing(self, received: int, now_ns: int) -> int:
        """Samples found missing now.

        Args:
            received: samples (good or unreadable) that arrived since the last call.
            now_ns: monotonic time.
        """
        if self._begin_ns is None:
            if received:
                self._begin_ns = now_ns
            return 0
        self._received += received
        elapsed_ns = now_ns - self._begin_ns
        if not received or elapsed_ns < self.WINDOW_NS:
            return 0
        expected = self.rate_Hz * elapsed_ns / 1e9
        shortfall = int(expected - self._received)
        self._begin_ns, self._received = now_ns, 0
        return shortfall if shortfall > 2 + 0.01 * expected else 0


@dataclass(frozen=True, slots=True)
class SampleScale:
    """What turns numbers on a sensor's wire into SI, and its samples into time.

    Attributes:
        sensitivity: SI unit per unit on the wire.
        offset: what `sensitivity * wire` is at zero, in the SI unit: SI value = `sensitivity * wire - offset`.
        rate_Hz: nominal samples a second of the device's clock; None when it is not known.
        device_rate: device seconds that pass in one second of the host's clock.
    """

    sensitivity: float = 1.0
    offset: float = 0.0
    rate_Hz: float | None = None
    device_rate: float = 1.0


class SampleStream:
    """Convert the bytes of one sensor to records, independent of the port.

    Args:
        decoder: splits the bytes; None if readings arrive decoded (`take_readings`).
        channel: sensor channel 1..9; its edges go to the matching edge channel.
        scale: conversion from wire units to SI, and the sensor's rate.
        has_sequence: whether the format carries a sequence number; without one, losses are counted against the rate
            where `device_rate` is 1.

    Attributes:
        counters: totals.
    """

    def __init__(
        self,
        decoder: Decoder | None,
        channel: Channel,
        scale: SampleScale,
        *,
        has_sequence: bool = True,
    ) -> None:
        self.counters = SampleCounters()
        self._decoder = decoder
        self._channel = int(channel)
        self._edge_channel = int(edge_channel(channel))
        self._sensitivity = scale.sensitivity
        self._offset = scale.offset
        self._rate_Hz = rate_Hz = scale.rate_Hz
        self._watch: RateWatch | None = None
        if rate_Hz is not None and not has_sequence and scale.device_rate == 1.0:
            self._watch = RateWatch(rate_Hz)
        period_us = 1e6 / rate_Hz if rate_Hz is not None else 0.0
        self._longest_step_us = max(_CLOCK_JUMP_US, _CLOCK_JUMP_PERIODS * period_us)
        self._started = False
        self._sequence = 0  # unwrapped
        self._skipped = 0  # samples the decoder, which numbers what it sees, does not know of
        self._device_us = NO_DEVICE_TIME  # unwrapped
        self._edges: int | None = None  # unwrapped
        self._gap = False

    def take(self, chunk: bytes, arrival_ns: int) -> Batch:
        """Decode a chunk that ends anywhere.

        Args:
            chunk: bytes as they arrived, possibly none.
            arrival_ns: monotonic time at which they were there.

        Returns:
            The samples and edges they complete.
        """
        if self._decoder is None:
            return self.take_readings([], arrival_ns)
        lost_before, bad_before = self.counters.lost, self._decoder.bad_frames
        readings = self._decoder.feed(chunk) if chunk else []
        if self._watch is not None:
            arrived = len(readings) + self._decoder.bad_frames - bad_before
            self._skip(self._watch.missing(arrived, arrival_ns))
        records = self._records(readings, arrival_ns)
        return Batch(records, self.counters.lost - lost_before, arrival_ns)

    def take_readings(self, readings: list[Reading], arrival_ns: int) -> Batch:
        """Convert readings that were decoded elsewhere, for example by a shared connection."""
        lost_before = self.counters.lost
        records = self._records(readings, arrival_ns)
        return Batch(records, self.counters.lost - lost_before, arrival_ns)

    def _records(self, readings: list[Reading], arrival_ns: int) -> list[Record]:
        """The loop every sample passes; anything unusual goes to `_unusual`."""
        sensitivity, offset, channel = self._sensitivity, self._offset, self._channel
        sequence, device_us, gap = self._sequence, self._device_us, self._gap
        longest, behind = self._longest_step_us, self._skipped - 1
        records: list[Record] = []
        add = records.append
        good = 0
        for reading in readings:
            number, clock, value, status, _ = reading
            if (
                not status
                and not gap
                and not (number - sequence + behind) & _SEQUENCE_MASK
                and ((clock - device_us) & _US_MASK) < longest
                and value - value == 0.0
                and self._started
            ):
                sequence += 1
                if clock >= 0:
                    device_us += (clock - device_us) & _US_MASK
                good += 1
                add((arrival_ns, device_us, value * sensitivity - offset, sequence & _RECORD_MASK, channel, 0))
                continue
            self._sequence, self._device_us = sequence, device_us
            record = self._unusual(reading, arrival_ns)
            sequence, device_us, gap = self._sequence, self._device_us, self._gap
            if record is not None:
                add(record)
        self._sequence, self._device_us = sequence, device_us
        self.counters.samples += good
        return records

    def _unusual(self, reading: Reading, arrival_ns: int) -> Record | None:
        """First sample, edge, duplicate, gap, clock error, flagged or not-a-number reading; None for a duplicate."""
        number, clock, value, status, edge_count = reading
        if status & STATUS_EDGE:
            return self._edge(clock, edge_count, arrival_ns)
        step = (number + self._skipped - self._sequence) & _SEQUENCE_MASK if self._started else 1
        if step == 0:
            self.counters.duplicates += 1
            return None
        flags = self._value_flags(value, status)
        if not self._started:
            self._sequence, self._device_us = number + self._skipped, clock if clock >= 0 else NO_DEVICE_TIME
            self._started = True
        else:
            flags |= self._advance(step, clock)
        if self._gap:
            flags |= Quality.GAP_BEFORE
            self._gap = False
        self.counters.samples += 1
        scaled = value * self._sensitivity - self._offset
        return arrival_ns, self._device_us, scaled, self._sequence & _RECORD_MASK, self._channel, int(flags)

    def _value_flags(self, value: float, status: int) -> Quality:
        """Flags the reading itself gives rise to."""
        flags = Quality.GOOD
        if status & STATUS_OVERLOAD:
            flags |= Quality.OVERLOAD
            self.counters.overloads += 1
        if status & STATUS_SENSOR_FAULT:
            flags |= Quality.SENSOR_FAULT
            self.counters.sensor_faults += 1
        if value - value != 0.0:
            flags |= Quality.NOT_A_NUMBER
            self.counters.not_numbers += 1
        return flags

    def _advance(self, step: int, clock: int) -> Quality:
        """Move the unwrapped sequence and clock to this sample; flag what does not follow from the one before."""
        forward_us = (clock - self._device_us) & _US_MASK if clock >= 0 else 0
        backwards = forward_us >= _US_HALF
        if backwards:
            forward_us -= DEVICE_US_MODULUS
        flags = Quality.GOOD
        if step >= _SEQUENCE_HALF:
            # Backwards: a restart or a reordering; how many samples are missing cannot be known, at least one is.
            self._sequence += step - SEQUENCE_MODULUS
            self.counters.lost += 1
            flags = Quality.GAP_BEFORE
        else:
            step += self._whole_turns(step, forward_us) if clock >= 0 and not backwards else 0
            self._sequence += step
            if step > 1:
                self.counters.lost += step - 1
                flags = Quality.GAP_BEFORE
        if backwards or (step == 1 and forward_us > self._longest_step_us):
            self.counters.clock_errors += 1
            flags = Quality.GAP_BEFORE
        if clock >= 0:
            self._device_us += forward_us
        return flags

    def _whole_turns(self, step: int, forward_us: int) -> int:
        """Samples of whole turns of the 16-bit sequence that a long gap hides, told by the device's clock."""
        if self._rate_Hz is None or forward_us <= self._longest_step_us or step == 1:
            return 0
        expected = forward_us * self._rate_Hz / 1e6
        return max(0, round((expected - step) / SEQUENCE_MODULUS)) * SEQUENCE_MODULUS

    def _edge(self, clock: int, edge_count: int, arrival_ns: int) -> Record | None:
        """Record of a latched pulse; its clock lies a little before or behind the last sample's."""
        if not self._started:
            return None
        if self._edges is None:
            self._edges, step = edge_count, 1
        else:
            step = (edge_count - self._edges) % EDGE_MODULUS
            self._edges += step
        if step == 0:
            self.counters.duplicates += 1
            return None
        self.counters.edges += 1
        self.counters.edges_missed += step - 1
        offset_us = (clock - self._device_us) & _US_MASK
        latched_us = self._device_us + (offset_us - DEVICE_US_MODULUS if offset_us >= _US_HALF else offset_us)
        flags = Quality.GAP_BEFORE if step > 1 else Quality.GOOD
        return arrival_ns, latched_us, 0.0, self._edges & _RECORD_MASK, self._edge_channel, int(flags)

    def _skip(self, missing: int) -> None:
        """Count samples that the rate says are missing before the next one, and leave their numbers out."""
        if missing:
            self.counters.lost += missing
            self._sequence += missing
            self._skipped += missing
            self._gap = True
