"""A sensor's thread that is kept from running, on a clock of the test's: what waited is read, judged, flagged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from station_bench import Journal, config_for

from drivers.ring import Channel, Record
from drivers.sample_stream import Batch
from protocols.quality import Quality
from rig.station.interlocks.channel_interlock import ChannelInterlock, ChannelLimits
from rig.station.supervisor import Supervisor
from rig.station.threads import sensor_thread
from rig.station.threads.sensor_thread import SensorRole, SensorThread

MS = 1_000_000
PERIOD_MS = 4
STALE_MS = 20


class Port:
    """A load cell that sends every 4 ms into a port; its thread sleeps in `read_batch` and is woken late on demand.

    Args:
        late: ms by which the read that would end at that instant (ms) comes back late; "empty" ones find nothing yet.
        pulled_ms: when the line falls silent.
        peak: number of the one sample that is beyond the limit.
    """

    bad_frames = skipped_bytes = 0
    moved = False

    def __init__(self, late: dict[int, int], *, empty: bool, pulled_ms: int = 10_000, peak: int = -1) -> None:
        self.now_ms = 0.0
        self.end_ms = 400
        self.ended: Callable[[], None] = lambda: None
        self.ticks: Callable[[int], None] = lambda now_ns: None
        self._late, self._empty, self._pulled_ms, self._peak = dict(late), empty, pulled_ms, peak
        self._read = 0

    def monotonic_ns(self) -> int:
        return round(self.now_ms * MS)

    def open(self) -> None:
        """Open."""

    def close(self) -> None:
        """Closed."""

    def discard_input(self) -> None:
        """Nothing waits."""

    def read_batch(self, timeout_s: float) -> Batch:
        sends = (self._read + 1) * PERIOD_MS < self._pulled_ms
        due_ms = (self._read + 1) * PERIOD_MS if sends else 1e9
        until_ms = max(self.now_ms, min(due_ms, self.now_ms + 1e3 * timeout_s))
        while self.now_ms < until_ms:
            self.now_ms = min(until_ms, self.now_ms + 5.0)
            self.ticks(self.monotonic_ns())
        held = [at_ms for at_ms in self._late if at_ms <= self.now_ms]
        for at_ms in held:
            self.now_ms += self._late.pop(at_ms)
        if self.now_ms > self.end_ms:
            self.ended()
        if held and self._empty:
            return Batch([], 0, self.monotonic_ns())
        newest = int(min(self.now_ms, self._pulled_ms - 1) // PERIOD_MS)
        numbers = range(self._read + 1, newest + 1)
        self._read = numbers[-1] if numbers else self._read
        return Batch([self._sample(number) for number in numbers], 0, self.monotonic_ns())

    def _sample(self, number: int) -> Record:
        value_N = 6000.0 if number == self._peak else 100.0 + number % 7
        return self.monotonic_ns(), 1000 * PERIOD_MS * number, value_N, number, Channel.FORCE, 0


class Outcome:
    """What a thread at such a port did."""

    def __init__(self, port: Port, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(sensor_thread, "monotonic_ns", port.monotonic_ns)
        self.journal, self.ring = Journal(), list[Record]()
        self.supervisor = Supervisor(
            config_for(), self.journal.append, self.ring.extend, lambda now_ns: None, lambda: 0.0
        )
        self.supervisor.host.watch(0)
        given = replace(self.supervisor.config.load_cell, stale_after_s=1e-3 * STALE_MS)
        interlock = ChannelInterlock("load_cell", "force-limit", ChannelLimits(low=-5e3, high=5e3, span=10e3, unit="N"))
        role = SensorRole("loadcell-pulled", Channel.FORCE, interlock, None, None, None)
        self.thread = SensorThread(given, port, role, self.supervisor, self.ring.extend)
        port.ended, port.ticks = self.thread.end, self.supervisor.host.awake
        self.supervisor.arm()
        self.thread.work()
        self.samples = [record for record in self.ring if record[4] == Channel.FORCE]


@pytest.mark.parametrize("empty", [True, False], ids=["nothing there yet", "all there"])
@pytest.mark.parametrize("held_ms", [25, 38, 45])
def test_a_thread_that_is_woken_late_takes_nobodys_cable_for_pulled(
    monkeypatch: pytest.MonkeyPatch, held_ms: int, empty: bool
) -> None:
    outcome = Outcome(Port({100: held_ms, 180: held_ms, 300: held_ms}, empty=empty), monkeypatch)
    assert outcome.supervisor.trip is None
    assert not outcome.journal.slugs("warning")
    assert [record[3] for record in outcome.samples] == list(range(1, len(outcome.samples) + 1)), "none is missing"
    late = [record for record in outcome.samples if record[5] & Quality.STALE]
    assert 3 * (held_ms // PERIOD_MS) <= len(late) <= 3 * (held_ms // PERIOD_MS + 3)
    assert outcome.thread.counters(0)["late"] == len(late)
    assert not any(record[5] for record in outcome.samples if record not in late)


def test_every_sample_that_waited_is_evaluated_by_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = Outcome(Port({100: 40}, empty=True, peak=28), monkeypatch)
    assert outcome.journal.slugs("trip") == ["force-limit"], "a sample of the middle of what waited"


@pytest.mark.parametrize("pulled_ms", [60, 95, 105, 120, 139, 141, 160])
def test_a_cable_pulled_before_within_or_after_a_late_time_is_seen_within_a_bounded_one(
    monkeypatch: pytest.MonkeyPatch, pulled_ms: int
) -> None:
    outcome = Outcome(Port({100: 40}, empty=True, pulled_ms=pulled_ms), monkeypatch)
    trip = outcome.supervisor.trip
    assert trip is not None
    assert trip.slug == "loadcell-pulled"
    seen_ms = trip.t_ns / MS
    assert seen_ms <= max(pulled_ms, 140 if pulled_ms > 80 else 0) + STALE_MS + PERIOD_MS + 0.5
    if pulled_ms > 100:
        assert seen_ms > 140


def test_a_thread_that_was_kept_for_too_long_names_only_the_host(monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = Outcome(Port({100: 60}, empty=True), monkeypatch)
    outcome.supervisor.tick(outcome.thread.silent_ns(0)[1])
    assert outcome.journal.slugs("trip") == ["host-late"]
    assert not outcome.journal.slugs("also")
