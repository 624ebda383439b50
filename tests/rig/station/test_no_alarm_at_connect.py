"""While devices are connected, proved and refused, nothing is called a fault that is the connecting itself."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

from station_bench import config_for
from test_capabilities import Rig

from drivers.can_current_source import CanCurrentSource
from drivers.can_port import CanPort
from drivers.capabilities import Capabilities, WatchdogKind
from drivers.connection import CanAddress
from drivers.current_source import SourceBatch
from drivers.devices.source import current_source
from rig.clock import monotonic_ns
from rig.station.interlocks.current_interlock import EcuInterlock
from rig.station.supervisor import Supervisor
from rig.station.threads.current_source_thread import CurrentSourceThread
from rig.station.threads.devices import Devices


class Ended:
    """A device whose thread has ended."""

    name, slug, alive = "load_cell", "loadcell-pulled", False

    def silent_ns(self, now_ns: int) -> tuple[int, int]:
        return now_ns, 1

    def end(self) -> None: ...

    def close(self) -> None: ...


class Closing:
    """What `Devices.close` needs of its devices."""

    def __init__(self, supervisor: Supervisor) -> None:
        self._supervisor = supervisor

    def __iter__(self) -> Iterator[Ended]:
        return iter((Ended(),))


def test_a_thread_that_is_ended_since_another_device_is_refused_has_not_died() -> None:
    journal: list[dict[str, object]] = []
    supervisor = Supervisor(config_for(), journal.append, lambda _: None, lambda _: None, lambda: 0.0)
    supervisor.watchdogs.watched = (Ended(),)
    supervisor.tick(monotonic_ns())
    assert [one["slug"] for one in journal] == ["task-dies"], "one that ends by itself is named"
    journal.clear()
    supervisor._warned.clear()
    Devices.close(Closing(supervisor))  # type: ignore[arg-type]  # only its devices are asked for
    supervisor.tick(monotonic_ns())
    assert journal == []


def test_a_request_that_keeps_the_polls_waiting_is_no_silence_while_nothing_may_move() -> None:
    here = Rig(Capabilities(WatchdogKind.NONE, hydraulics=True))
    release = threading.Event()
    asking = threading.Thread(target=lambda: here.thread.call(lambda _: release.wait(2.0), 5.0))
    try:
        here.supervisor.disarm()
        asking.start()
        time.sleep(0.05)
        later_ns = monotonic_ns() + 10**9
        assert here.thread.silent_ns(later_ns)[0] == 0
        here.supervisor.arm()
        age_ns, stale_ns = here.thread.silent_ns(later_ns)
        assert age_ns > stale_ns, "armed, its silence counts whatever it is asked"
    finally:
        release.set()
        asking.join()
        here.thread.end()


def test_an_ecu_whose_state_comes_later_than_its_current_is_not_silent_at_connect() -> None:
    config = config_for()
    supervisor = Supervisor(config, lambda _: None, lambda _: None, lambda _: None, lambda: 0.0)
    source = CanCurrentSource(CanPort(CanAddress("slcan", "socket://127.0.0.1:1")), current_source("demo"))
    coil = CurrentSourceThread(
        config.ecu, source, EcuInterlock(3.0, 120.0, lambda: 0), supervisor, lambda _: None
    )
    later_ns = monotonic_ns() + int(2e9 * config.ecu.stale_after_s)
    nothing = SourceBatch([], [], [], 0, 0, later_ns)
    assert [one.slug for one in coil._check_batch(nothing)] == ["ecu-silent"], "nothing is heard at all"
    source._current_heard = True
    assert source.waits_for_state
    assert coil._check_batch(nothing) == []
    assert coil.silent_ns(later_ns)[0] == 0
    supervisor.arm()
    assert [one.slug for one in coil._check_batch(nothing)] == ["ecu-silent"]
