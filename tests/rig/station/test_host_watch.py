"""The station's own lateness, on a clock of the test's: it is never a device's, it is counted, and it has limits."""

from __future__ import annotations

import random
from collections.abc import Iterator

import pytest

from rig.station.interlocks.finding import Finding
from rig.station.watchdogs import STOPPED, TOO_BUSY, HostWatch, Listener, quiet_s

MS = 1_000_000
STALE_MS = 20
LIMIT_MS = 50
PERIOD_MS = 4


def host(watchdog_ms: float = 500.0) -> HostWatch:
    made = HostWatch(1e-3 * LIMIT_MS, 1e-3 * watchdog_ms, quiet_s([1e-3 * PERIOD_MS, 0.01]), 0)
    made.watch(0)
    made.listen(0, listening=True)
    return made


def busy(made: HostWatch, begin_ms: int, end_ms: int) -> None:
    """The station ticks and hears its devices."""
    for ms in range(begin_ms, end_ms + 1, PERIOD_MS):
        made.heard(ms * MS)


def slug_of(made: HostWatch, last_ms: float, now_ms: float, slug: str = "lvdt-pulled") -> str | None:
    finding = made.missed("lvdt", slug, round(last_ms * MS), STALE_MS * MS, round(now_ms * MS))
    return None if finding is None else finding.slug


def findings(made: HostWatch) -> Iterator[Finding | None]:
    while (blind := made.take()) is not None:
        yield made.finding(blind)


def test_a_device_is_silent_while_others_are_heard() -> None:
    made = host()
    busy(made, 0, 120)
    assert slug_of(made, 100.0, 120.0) is None
    assert slug_of(made, 99.9, 120.0) == "lvdt-pulled"
    assert not list(findings(made))


@pytest.mark.parametrize("held_ms", [11, 25, 49])
def test_a_station_that_was_held_up_blames_no_device_and_looks_again(held_ms: int) -> None:
    made = host()
    busy(made, 0, 100)
    woken_ms = 100 + held_ms
    made.awake(woken_ms * MS)
    assert slug_of(made, 96.0, woken_ms) is None
    assert (made.count, made.worst_ns) == (1, held_ms * MS)
    assert list(findings(made)) == [None], "short enough to go on"


def test_a_cable_that_went_while_the_station_was_held_up_is_named_a_stale_after_later() -> None:
    made = host()
    busy(made, 0, 100)
    busy(made, 140, 160)
    assert slug_of(made, 96.0, 160.0) is None
    busy(made, 161, 161)
    assert slug_of(made, 96.0, 160.1) == "lvdt-pulled"


@pytest.mark.parametrize(
    ("held_ms", "slug"), [(51, "host-late"), (60, "host-late"), (200, "host-late"), (520, "host-silent")]
)
def test_beyond_its_limit_the_station_names_itself(held_ms: int, slug: str) -> None:
    made = host()
    busy(made, 0, 100)
    made.awake((100 + held_ms) * MS)
    (finding,) = findings(made)
    assert finding is not None
    assert finding.slug == slug
    assert (finding.value, finding.limit) == (pytest.approx(1e-3 * held_ms), 1e-3 * LIMIT_MS)
    assert (STOPPED in finding.detail, TOO_BUSY in finding.detail) == ((slug == "host-silent"), (slug == "host-late"))


def test_a_limit_beyond_the_controllers_watchdog_means_nothing() -> None:
    made = HostWatch(0.5, 0.1, 0.02, 0)
    made.watch(0)
    made.awake(101 * MS)
    assert [finding is not None for finding in findings(made)] == [True]


def test_short_times_that_come_again_and_again_are_too_long_together() -> None:
    made, now_ms = host(), 0
    slugs = []
    for _ in range(30):
        busy(made, now_ms, now_ms + 10)
        now_ms += 8 + 30
        made.heard(now_ms * MS)
        slugs += [finding.slug for finding in findings(made) if finding is not None]
        assert slugs or now_ms < 1000
    assert slugs
    assert set(slugs) == {"host-late"}


def test_when_no_device_at_all_is_heard_it_is_not_one_of_them_that_went() -> None:
    made = host()
    busy(made, 0, 100)
    for ms in range(100, 171, 5):
        made.awake(ms * MS)
        assert slug_of(made, 100.0, ms) is None
    made.awake(175 * MS)
    assert slug_of(made, 100.0, 175.0) == "host-late"


def test_devices_that_are_heard_again_after_a_common_silence_are_well() -> None:
    made = host()
    busy(made, 0, 100)
    for ms in range(105, 138, 5):
        made.awake(ms * MS)
    busy(made, 138, 158)
    assert slug_of(made, 96.0, 158.0) is None
    assert slug_of(made, 96.0, 158.1) == "lvdt-pulled", "this one did not come back"
    assert made.total_ns == 38 * MS


def test_before_the_station_ticks_nothing_is_late() -> None:
    made = HostWatch(0.05, 0.5, 0.02, 0)
    made.heard(10_000 * MS)
    assert made.count == 0


def test_one_time_seen_by_many_threads_is_counted_once() -> None:
    made = host()
    busy(made, 0, 100)
    threads = [Listener(made, 100 * MS) for _ in range(5)]
    seen_ms = [thread.returned(0.02, 140 * MS + number, heard=True) / MS for number, thread in enumerate(threads)]
    assert seen_ms == pytest.approx([40.0] * 5)
    assert (made.count, made.total_ns) == (1, 40 * MS)


def test_a_thread_that_alone_was_kept_waiting_says_so() -> None:
    made = host()
    busy(made, 0, 100)
    reader = Listener(made, 100 * MS)
    busy(made, 104, 148)
    assert reader.returned(0.02, 150 * MS, heard=False) == 30 * MS
    assert slug_of(made, 100.0, 150.0) is None


@pytest.mark.parametrize("seed", range(20))
def test_of_random_hold_ups_no_healthy_device_is_blamed_and_a_pulled_one_always_is(seed: int) -> None:
    """A sensor every 4 ms beside another one; its thread wakes late at random; from 3 s on its cable is out."""
    chance, made, now_ms, last_ms, pulled_ms = random.Random(seed), host(), 0.0, 0.0, 3000.0
    reader, blamed_ms = Listener(made, 0), None
    while blamed_ms is None and now_ms < 3300.0:
        held_ms = chance.choice([0.0] * 12 + [chance.uniform(5.0, 45.0)])
        request_ms = max(0.2, last_ms + STALE_MS + 0.2 - now_ms)
        comes_ms = PERIOD_MS * (now_ms // PERIOD_MS + 1)
        sends = comes_ms < pulled_ms
        waited_ms = min(comes_ms - now_ms if sends else PERIOD_MS, request_ms)
        now_ms += waited_ms + held_ms
        seen = sends and now_ms >= comes_ms
        # While it waits the others are read, unless the whole process is held up.
        made.heard(round((now_ms - held_ms) * MS))
        reader.returned(1e-3 * waited_ms, round(now_ms * MS), heard=seen)
        last_ms = now_ms if seen else last_ms
        if not seen and slug_of(made, last_ms, now_ms) is not None:
            blamed_ms = now_ms
    assert blamed_ms is not None
    assert pulled_ms < blamed_ms
    assert blamed_ms - pulled_ms <= 2 * STALE_MS + LIMIT_MS + 45 + PERIOD_MS
