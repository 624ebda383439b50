"""Interlocks on samples: pure detectors that check every sample once and return findings; no clock, no I/O.

A detector is fed with the batches that a reader thread got from its driver (tuples of ring records) and stores only
what it needs of the past. The usual case (no finding) costs a minimum and a maximum over the batch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import islice, pairwise
from operator import eq

from drivers.ring import Record
from protocols.quality import Quality
from rig.station.interlocks.finding import CONSECUTIVE, Finding

REPEATED_SHARE = 0.3
"""Where so many neighbours are equal, the resolution is coarser than the noise."""
FEWEST_PAIRS = 50
MOST_OF_A_RUN = 20
"""A run of equal values counts as no more than this many: one is no proof of a coarse resolution, many are."""


@dataclass(frozen=True, slots=True)
class ChannelLimits:
    """What a channel may show, in its SI unit.

    Attributes:
        low: least allowed value.
        high: greatest allowed value.
        span: where the sensor is at its end, either side of 0.
        spike_jump: largest step between two samples that physics can make.
        unit: for messages.
    """

    low: float
    high: float
    span: float
    spike_jump: float = math.inf
    unit: str = ""


class ChannelInterlock:
    """Judges one sensor channel: limits, saturation, spikes, sensor faults, gaps.

    A value beyond a limit trips at once, unless it is a jump that physics cannot make: then it is flagged as a spike
    and trips when `CONSECUTIVE` samples stay there.

    Args:
        name: the sensor's, for messages.
        slug: what a value beyond the limits is called.
        limits: what the channel may show.
    """

    def __init__(self, name: str, slug: str, limits: ChannelLimits) -> None:
        self.name = name
        self.slug = slug
        self.limits = limits
        self.last_value = math.nan
        self.repeats = 0
        self.step = math.inf
        self._pairs = self._equal = 0
        self._lowest = math.inf
        self._highest = -math.inf
        self._jumps = 0
        self._saturated = 0
        self._faulty = 0

    def check(self, records: list[Record]) -> tuple[list[Record], list[Finding]]:
        """Judge one batch of one channel's samples.

        Args:
            records: the new samples, oldest first.

        Returns:
            The records as they go into the ring (spikes flagged), and what was found.
        """
        if not records:
            return records, []
        values = [record[2] for record in records]
        self._count_repeats(values)
        plain = not any(record[5] for record in records)
        lowest, highest = min(values), max(values)
        if plain and self._quiet(lowest, highest):
            self._lowest, self._highest = min(self._lowest, lowest), max(self._highest, highest)
            self.last_value = values[-1]
            return records, []
        findings: list[Finding] = []
        return [self._one(record, findings) for record in records], findings

    @property
    def at_extreme(self) -> bool:
        """The last value is the least or the greatest of all that the channel has shown, and it has shown others."""
        return self._lowest < self._highest and self.last_value in {self._lowest, self._highest}

    @property
    def fine(self) -> bool:
        """The channel's values usually differ from one sample to the next: its noise is finer than its steps."""
        return self._pairs >= FEWEST_PAIRS and self._equal <= REPEATED_SHARE * self._pairs

    def says_nothing(self, samples: float) -> bool:
        """Its last values tell nothing of its quantity.

        Args:
            samples: as many equal ones in a row do not come from a channel whose noise is finer than its steps.

        Returns:
            True at its end, with a fault that it reports, or with one value for too long.
        """
        return max(self._saturated, self._faulty) >= CONSECUTIVE or (self.fine and self.repeats >= samples)

    def _count_repeats(self, values: list[float]) -> None:
        """Follow for how many samples the value has been the same to the last bit, and how usual that is."""
        many = len(values)
        if min(values) == max(values) == self.last_value:
            self.repeats += many
            return
        equal = sum(map(eq, values, islice(values, 1, None))) + (values[0] == self.last_value)
        self._equal += min(self.repeats, MOST_OF_A_RUN) + equal
        self._pairs += min(self.repeats, MOST_OF_A_RUN) + many
        self.repeats = many - 1 if equal == many - 1 and values[0] != self.last_value else 0
        if not self.fine:
            self._follow_step(values)

    def _follow_step(self, values: list[float]) -> None:
        """The smallest difference between two values of a coarse channel."""
        levels = sorted({value for value in (*values, self.last_value) if math.isfinite(value)})
        self.step = min((self.step, *(above - below for below, above in pairwise(levels))))

    def _quiet(self, lowest: float, highest: float) -> bool:
        if self._jumps or self._saturated or self._faulty:
            return False
        limits = self.limits
        if lowest < limits.low or highest > limits.high or max(highest, -lowest) >= limits.span:
            return False
        if math.isnan(self.last_value):
            return highest - lowest <= limits.spike_jump
        return max(highest, self.last_value) - min(lowest, self.last_value) <= limits.spike_jump

    def _one(self, record: Record, findings: list[Finding]) -> Record:
        host_ns, device_us, value, sequence, channel, flags = record
        limits = self.limits
        if flags & Quality.GAP_BEFORE:
            findings.append(Finding("sample-gap", f"{self.name}: samples lost before sample {sequence}", host_ns))
        self._follow_flags(record, findings)
        if flags & Quality.NOT_A_NUMBER or math.isnan(value):
            findings.append(Finding("sensor-nan", f"{self.name}: sample {sequence} is not a number", host_ns))
            return record
        # Over lost samples the value may have gone anywhere; its limits are judged all the same.
        if not flags & Quality.GAP_BEFORE and abs(value - self.last_value) > limits.spike_jump:
            self._jumps += 1
            if self._jumps < CONSECUTIVE:
                detail = f"{self.name}: sample {sequence} jumps from {self.last_value:g} to {value:g} {limits.unit}"
                findings.append(Finding("sensor-spike", detail, host_ns, value, limits.spike_jump, warns=True))
                return (host_ns, device_us, value, sequence, channel, flags | int(Quality.SPIKE))
            detail = f"{self.name}: jumped from {self.last_value:g} to {value:g} {limits.unit} and remained there"
            findings.append(Finding("sensor-spike", detail, host_ns, value, limits.spike_jump))
        self._jumps = 0
        self.last_value = value
        self._check_limits(host_ns, value, findings)
        return record

    def _follow_flags(self, record: Record, findings: list[Finding]) -> None:
        """Count samples in a row with a fault, or at the end; one with neither value nor flag ends neither count."""
        host_ns, _, value, _, _, flags = record
        if flags & Quality.SENSOR_FAULT:
            self._faulty += 1
        elif not math.isnan(value):
            self._faulty = 0
        if self._faulty >= CONSECUTIVE:
            findings.append(Finding("sensor-fault", f"{self.name}: the sensor reports a fault", host_ns, value))
        if flags & Quality.OVERLOAD or abs(value) >= self.limits.span:
            self._saturated += 1
        elif not math.isnan(value):
            self._saturated = 0
        if self._saturated >= CONSECUTIVE:
            findings.append(Finding("sensor-saturated", f"{self.name}: the value is at "
                "the limit of the range", host_ns, value, self.limits.span))

    def _check_limits(self, host_ns: int, value: float, findings: list[Finding]) -> None:
        low, high, unit = self.limits.low, self.limits.high, self.limits.unit
        if low <= value <= high:
            return
        limit = low if value < low else high
        detail = f"{self.name} {value:.6g} {unit}, allowed {low:.6g} to {high:.6g} {unit}"
        findings.append(Finding(self.slug, detail, host_ns, value, limit))


