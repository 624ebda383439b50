"""Interlocks on samples: pure judges that see every sample once and answer with findings; no clock, no I/O.

A judge is fed the batches a reader thread got from its driver (ring-record tuples) and keeps only what it needs of the
past. The common case (nothing unusual) costs a minimum and a maximum over the batch.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from itertools import islice, pairwise
from operator import eq

from protocols.quality import DOUBTFUL, NO_VALUE, Quality

Record = tuple[int, int, float, int, int, int]
"""host_ns, device_us (-1 none), value (SI), sequence, channel, flags: the ring's record."""

CONSECUTIVE = 3
SPEED_WINDOW_S = 0.010
STILL_TOLERANCE_M = 0.0003
REPEATED_SHARE = 0.3
"""Where so many neighbours are equal, the resolution is coarser than the noise."""
FEWEST_PAIRS = 50
MOST_OF_A_RUN = 20
"""A run of equal values counts as no more than this many: one is no proof of a coarse resolution, many are."""


@dataclass(frozen=True)
class Finding:
    """Something a detector saw.

    `slug` names the row of `fault_table`, `t_ns` is the host arrival of what showed it; `warns` marks what is worth a
    warning only, whatever the row's stop.
    """

    slug: str
    detail: str
    t_ns: int
    value: float = math.nan
    limit: float = math.nan
    warns: bool = False


class ChannelJudge:
    """Judges one sensor channel: limits, saturation, spikes, sensor faults, gaps.

    A value beyond a limit trips at once, unless it is a jump that physics cannot make: then it is flagged as a spike
    and trips when `CONSECUTIVE` samples stay there.
    """

    def __init__(
        self,
        name: str,
        slug: str,
        *,
        low: float,
        high: float,
        span: float,
        spike_jump: float = math.inf,
        unit: str = "",
    ) -> None:
        self.name = name
        self.slug = slug
        self.low = low
        self.high = high
        self.span = span
        self.spike_jump = spike_jump
        self.unit = unit
        self.last_value = math.nan
        self.repeats = 0
        self.step = math.inf
        self._pairs = self._equal = 0
        self._lowest = math.inf
        self._highest = -math.inf
        self._jumps = 0
        self._saturated = 0
        self._faulty = 0

    def judge(self, records: list[Record]) -> tuple[list[Record], list[Finding]]:
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
        if lowest < self.low or highest > self.high or max(highest, -lowest) >= self.span:
            return False
        if math.isnan(self.last_value):
            return highest - lowest <= self.spike_jump
        return max(highest, self.last_value) - min(lowest, self.last_value) <= self.spike_jump

    def _one(self, record: Record, findings: list[Finding]) -> Record:
        host_ns, device_us, value, sequence, channel, flags = record
        if flags & Quality.GAP_BEFORE:
            findings.append(Finding("sample-gap", f"{self.name}: samples lost before sequence {sequence}", host_ns))
        self._follow_flags(record, findings)
        if flags & Quality.NOT_A_NUMBER or math.isnan(value):
            findings.append(Finding("sensor-nan", f"{self.name}: sample {sequence} is not a number", host_ns))
            return record
        # Over lost samples the value may have gone anywhere; its limits are judged all the same.
        if not flags & Quality.GAP_BEFORE and abs(value - self.last_value) > self.spike_jump:
            self._jumps += 1
            if self._jumps < CONSECUTIVE:
                detail = f"{self.name}: sample {sequence} jumps from {self.last_value:g} to {value:g} {self.unit}"
                findings.append(Finding("sensor-spike", detail, host_ns, value, self.spike_jump, warns=True))
                return (host_ns, device_us, value, sequence, channel, flags | int(Quality.SPIKE))
            detail = f"{self.name}: jumped from {self.last_value:g} to {value:g} {self.unit} and stayed"
            findings.append(Finding("sensor-spike", detail, host_ns, value, self.spike_jump))
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
        if flags & Quality.OVERLOAD or abs(value) >= self.span:
            self._saturated += 1
        elif not math.isnan(value):
            self._saturated = 0
        if self._saturated >= CONSECUTIVE:
            findings.append(Finding("sensor-saturated", f"{self.name}: at its end", host_ns, value, self.span))

    def _check_limits(self, host_ns: int, value: float, findings: list[Finding]) -> None:
        if self.low <= value <= self.high:
            return
        limit = self.low if value < self.low else self.high
        detail = f"{self.name} {value:.6g} {self.unit}, allowed {self.low:.6g} to {self.high:.6g} {self.unit}"
        findings.append(Finding(self.slug, detail, host_ns, value, limit))


class MotionJudge:
    """Speed and standstill from LVDT samples, on the sensor's own clock.

    The speed is the slew over `SPEED_WINDOW_S` of device time (at least 3 samples), which divides the sensor's noise by
    the window; it trips when `CONSECUTIVE` windows in a row exceed the limit, so that one spike (which spoils two
    windows that are not neighbours) does not.
    """

    def __init__(self, speed_limit_m_s: float, rate_Hz: float) -> None:
        self.speed_limit_m_s = speed_limit_m_s
        self._period_s = 1.0 / rate_Hz
        self._span = max(CONSECUTIVE, round(SPEED_WINDOW_S * rate_Hz))
        self._recent: deque[tuple[float, float]] = deque(maxlen=self._span)
        self._over = 0
        self._unusable = 0
        self._anchor_m = math.nan
        self._anchor_s = math.nan
        self._latest_s = math.nan
        self.speed_m_s = math.nan

    @property
    def blind(self) -> bool:
        """The sensor sends, but nothing that says where the rod is: its last samples are no measurements."""
        return self._unusable >= CONSECUTIVE

    @property
    def still_s(self) -> float:
        """For how many seconds of the sensor's clock the rod has stayed within `STILL_TOLERANCE_M` (0: it moves)."""
        elapsed_s = self._latest_s - self._anchor_s
        return 0.0 if math.isnan(elapsed_s) else max(0.0, elapsed_s)

    def restart_still(self) -> None:
        """Begin the proof of standstill anew, from the next sample on."""
        # In this order: a sample judged between the two (the supervisor calls from its own thread) sets neither.
        self._anchor_s = math.nan
        self._anchor_m = math.nan

    def judge(self, records: list[Record]) -> list[Finding]:
        """Follow one batch of LVDT samples (m); findings when the speed limit is exceeded."""
        findings: list[Finding] = []
        for host_ns, device_us, value, sequence, _, flags in records:
            if flags & NO_VALUE:
                self._miss()
            if flags & DOUBTFUL:
                continue
            self._unusable = 0
            t_s = device_us * 1e-6 if device_us >= 0 else sequence * self._period_s
            if self._recent and t_s <= self._recent[-1][0]:
                self._recent.clear()
                self.restart_still()
            if len(self._recent) == self._span:
                before_s, before_m = self._recent[0]
                self.speed_m_s = (value - before_m) / (t_s - before_s)
                self._judge_speed(host_ns, findings)
            self._recent.append((t_s, value))
            self._latest_s = t_s
            if not abs(value - self._anchor_m) <= STILL_TOLERANCE_M:
                self._anchor_m, self._anchor_s = value, t_s
        return findings

    def _miss(self) -> None:
        """A sample that is no measurement; after a few in a row speed and standstill are unknown."""
        self._unusable += 1
        if self.blind:
            self._recent.clear()
            self.speed_m_s = math.nan
            self.restart_still()

    def _judge_speed(self, host_ns: int, findings: list[Finding]) -> None:
        speed_m_s = abs(self.speed_m_s)
        self._over = self._over + 1 if speed_m_s > self.speed_limit_m_s else 0
        if self._over >= CONSECUTIVE:
            detail = f"LVDT speed {speed_m_s:.4g} m/s, allowed {self.speed_limit_m_s:.4g} m/s"
            findings.append(Finding("speed-limit", detail, host_ns, speed_m_s, self.speed_limit_m_s))
