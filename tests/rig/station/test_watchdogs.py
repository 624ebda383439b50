"""What nobody reports by itself: silent devices, dead threads, a lagging application, recorder or machine."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from rig import clock
from rig.clock import monotonic_ns
from rig.station.watchdogs import HostWatch, Watchdogs

MS = 1_000_000
TIMEOUT_S = 0.5


@dataclass
class Source:
    """A thread that reads a device."""

    age_ms: int
    alive: bool = True
    slug: str = "lvdt-pulled"
    name: str = "lvdt"

    def silent_ns(self, now_ns: int) -> tuple[int, int]:
        del now_ns
        return self.age_ms * MS, 20 * MS


@pytest.mark.parametrize(
    ("source", "found"),
    [(Source(20), []), (Source(21), ["lvdt-pulled"]), (Source(0, alive=False), ["task-dies"])],
    ids=["fresh", "silent", "dead"],
)
def test_a_device_is_silent_after_its_own_time_and_a_thread_that_ended_is_named(
    source: Source, found: list[str]
) -> None:
    watchdogs = Watchdogs(TIMEOUT_S, HostWatch(0.05, 0.5, 0.02, monotonic_ns()), lambda: 0.0)
    watchdogs.watched = (Source(1), source)
    assert [finding.slug for finding in watchdogs.devices(monotonic_ns())] == found


def test_an_application_that_does_not_beat_is_stalled_and_one_that_is_unwell_says_so() -> None:
    watchdogs = Watchdogs(TIMEOUT_S, HostWatch(0.05, 0.5, 0.02, monotonic_ns()), lambda: 0.0)
    watchdogs.beat(healthy=True)
    now_ns = monotonic_ns()
    assert not list(watchdogs.application(now_ns + 400 * MS))
    assert [finding.slug for finding in watchdogs.application(now_ns + 501 * MS)] == ["host-stalled"]
    watchdogs.beat(healthy=False)
    assert [finding.slug for finding in watchdogs.application(monotonic_ns())] == ["recorder-unwell"]


def test_a_recorder_that_leaves_half_of_the_ring_unread_is_slow() -> None:
    unread = [0.5]
    watchdogs = Watchdogs(TIMEOUT_S, HostWatch(0.05, 0.5, 0.02, monotonic_ns()), lambda: unread[0])
    assert not list(watchdogs.consumer(0))
    unread[0] = 0.51
    (finding,) = watchdogs.consumer(7)
    assert (finding.slug, finding.t_ns, finding.value) == ("slow-consumer", 7, 0.51)


def test_a_machine_that_slept_is_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    slept = {"ns": 0}
    monkeypatch.setattr(clock, "suspended_ns", lambda: slept["ns"])
    watchdogs = Watchdogs(TIMEOUT_S, HostWatch(0.05, 0.5, 0.02, monotonic_ns()), lambda: 0.0)
    slept["ns"] = 2_000 * MS
    assert [finding.slug for finding in watchdogs.machine(0)] == ["host-suspend"]
    assert not list(watchdogs.machine(0))
