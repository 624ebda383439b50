"""What the supervisor makes of findings: each is told once, however often it is found."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator

import pytest
from station_bench import Journal, config_for

from drivers.can_current_source import CanCurrentSource
from drivers.can_port import CanPort
from drivers.connection import CanAddress
from drivers.current_source import SourceBatch, SourceCounters, SourceState, SourceStatus
from drivers.devices.source import current_source
from drivers.ring import Channel, Record
from rig.clock import monotonic_ns
from rig.faults.matrix import REACTIONS
from rig.station.interlocks.current_interlock import EcuInterlock
from rig.station.interlocks.finding import Finding
from rig.station.safe_stop import StopAction
from rig.station.supervisor import Supervisor
from rig.station.threads.current_source_thread import CurrentSourceThread

FAULT = Finding("sensor-fault", "load_cell: the sensor reports a fault", 0)
LATER = Finding("force-limit", "load cell 6000 N, allowed -5000 to 5000 N", 0)


@pytest.fixture
def journal() -> Journal:
    return Journal()


@pytest.fixture
def ring() -> list[Record]:
    return []


@pytest.fixture
def supervisor(journal: Journal, ring: list[Record]) -> Supervisor:
    return Supervisor(config_for(), journal.append, ring.extend, lambda now_ns: None, lambda: 0.0)


def test_what_is_found_again_and_again_is_reported_once_a_second_before_arming_and_once_as_a_trip(
    supervisor: Supervisor, journal: Journal, ring: list[Record]
) -> None:
    repeated = [Finding("sensor-fault", "load_cell: the sensor reports a fault", 0)] * 1000
    supervisor.report(repeated)
    assert [event["event"] for event in journal] == ["warning"]
    supervisor.arm()
    supervisor.report(repeated)
    supervisor.report([Finding("sensor-saturated", "load_cell: the value is at the limit of the range", 0)] * 1000)
    assert [event["event"] for event in journal] == ["warning", "trip", "also"]
    trips = [record for record in ring if record[4] == Channel.TRIP]
    assert [record[2] for record in trips] == [REACTIONS["sensor-fault"].code, REACTIONS["sensor-saturated"].code]


def test_what_is_still_there_after_a_reset_trips_again(supervisor: Supervisor, journal: Journal) -> None:
    supervisor.arm()
    finding = Finding("position-disagreement", "controller at 0.1 m, LVDT at 0 m", 0)
    supervisor.report([finding])
    assert supervisor.reset(supervisor.stop)
    supervisor.report([finding])
    assert journal.slugs("trip") == ["position-disagreement"] * 2


class Coil:
    """A coil whose 0 A does what a test wants."""

    fresh_current_A = None
    zero_within_s = 0.25
    falls_within_s = 0.25
    own_timeout_s = 0.1

    def __init__(self, zero: Callable[[], None]) -> None:
        self.zero_now = zero


class Rod:
    """Actuator and LVDT in one: keeps the stop actions it was given."""

    stop_taken = True
    state_name = pressure_name = None
    changed = False

    def __init__(self) -> None:
        self.actions: list[StopAction] = []
        self.restarts = 0

    def act(self, action: StopAction) -> None:
        self.actions.append(action)

    def stop_inputs(self, now_ns: int) -> tuple[None, None, None, None]:
        del now_ns
        return None, None, None, None

    def still_s(self, now_ns: int) -> None:
        del now_ns

    def restart_still(self) -> None:
        self.restarts += 1

    def hold_place(self) -> None:
        """Nothing is proved."""

    def left_place(self, now_ns: int) -> bool:
        del now_ns
        return False

    def position_m(self, now_ns: int) -> None:
        del now_ns


def broken(*_: object) -> None:
    raise OSError(28, "No space left on device")


@pytest.fixture
def full_standard_error() -> Iterator[None]:
    """Standard error on a full disk; pytest's own comes back."""
    kept, full = os.dup(2), os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, 2)
    yield
    os.dup2(kept, 2)
    os.close(kept)
    os.close(full)


@pytest.mark.usefixtures("full_standard_error")
@pytest.mark.parametrize("failing", ["coil", "link", "ring", "all"])
def test_whatever_fails_of_a_stop_its_motion_is_stopped_and_its_current_requested_to_be_zero(failing: str) -> None:
    zeroed: list[None] = []

    def zero() -> None:
        zeroed.append(None)
        if failing in {"coil", "all"}:
            broken()

    rod, journal, ring = Rod(), Journal(), list[Record]()
    made = Supervisor(
        config_for(), broken if failing in {"link", "all"} else journal.append,
        broken if failing in {"ring", "all"} else ring.extend, lambda now_ns: None, lambda: 0.0,
    )  # fmt: skip
    made.attach(Coil(zero), rod, rod, ())
    made.arm()
    made.report([FAULT])
    assert rod.actions == [StopAction.FADE]
    assert zeroed == [None]
    assert made.trip is not None
    assert failing in {"link", "all"} or journal.slugs("trip") == ["sensor-fault"]


@pytest.mark.usefixtures("full_standard_error")
def test_a_bus_that_takes_no_frame_beside_a_full_disk_costs_no_fade_out(
    supervisor: Supervisor, journal: Journal
) -> None:
    rod = Rod()
    nowhere = CanCurrentSource(CanPort(CanAddress("slcan", "socket://127.0.0.1:1")), current_source("demo"))
    coil = CurrentSourceThread(
        supervisor.config.ecu, nowhere, EcuInterlock(3.0, 120.0, lambda: 0), supervisor, lambda records: None
    )
    supervisor.attach(coil, rod, rod, ())
    supervisor.arm()
    supervisor.report([FAULT])
    assert rod.actions == [StopAction.FADE]
    assert journal.slugs("trip") == ["sensor-fault"]


@pytest.mark.parametrize(
    ("counted", "slug"),
    [
        (SourceCounters(), "ecu-silent"),
        (SourceCounters(duplicates=1, lateness=2), "ecu-late"),
        (SourceCounters(bad_checks=2, bad_in_a_row=2), "ecu-crc"),
        (SourceCounters(malformed=2, bad_in_a_row=2, malformed_in_a_row=2), "can-malformed"),
    ],
)
def test_no_good_status_is_named_by_what_comes_in_its_place(
    supervisor: Supervisor, counted: SourceCounters, slug: str
) -> None:
    source = CanCurrentSource(CanPort(CanAddress("slcan", "socket://127.0.0.1:1")), current_source("demo"))
    coil = CurrentSourceThread(
        supervisor.config.ecu, source, EcuInterlock(3.0, 120.0, lambda: 0), supervisor, lambda records: None
    )
    source.counters = counted
    later_ns = monotonic_ns() + int(1.05e9 * supervisor.config.ecu.stale_after_s)
    findings = coil._check_batch(SourceBatch([], [], [], 0, 0, later_ns))
    assert [finding.slug for finding in findings if not finding.warns] == [slug]


def test_a_repeat_that_came_with_the_last_fresh_status_tells_that_the_ecu_is_late(supervisor: Supervisor) -> None:
    source = CanCurrentSource(CanPort(CanAddress("slcan", "socket://127.0.0.1:1")), current_source("demo"))
    coil = CurrentSourceThread(
        supervisor.config.ecu, source, EcuInterlock(3.0, 120.0, lambda: 0), supervisor, lambda records: None
    )
    fresh_ns = monotonic_ns()
    source.counters = SourceCounters(duplicates=4, lateness=2)
    coil._check_batch(SourceBatch([], [SourceStatus(SourceState.ENABLED, 0.0, 0)], [], 0, 0, fresh_ns))
    later_ns = fresh_ns + int(1.05e9 * supervisor.config.ecu.stale_after_s)
    findings = coil._check_batch(SourceBatch([], [], [], 0, 0, later_ns))
    assert [finding.slug for finding in findings if not finding.warns] == ["ecu-late"]


def test_a_coil_that_keeps_the_stop_waiting_holds_up_neither_the_motion_nor_the_order_of_what_is_reported(
    supervisor: Supervisor, journal: Journal
) -> None:
    rod, requested, go_on = Rod(), threading.Event(), threading.Event()

    def slow() -> None:
        requested.set()
        assert go_on.wait(10.0)

    supervisor.attach(Coil(slow), rod, rod, ())
    supervisor.arm()
    first = threading.Thread(target=supervisor.report, args=([FAULT],))
    first.start()
    assert requested.wait(10.0)
    assert rod.actions == [StopAction.FADE], "queued before the coil's wire is waited for"
    supervisor.report([LATER])
    go_on.set()
    first.join(10.0)
    assert [(event["event"], event["slug"]) for event in journal] == [("trip", FAULT.slug), ("also", LATER.slug)]
    assert supervisor.trip is not None
    assert supervisor.trip.slug == FAULT.slug
    assert rod.actions == [StopAction.FADE, StopAction.HALT]


def test_a_fade_out_that_comes_to_be_sent_after_a_halt_does_not_take_it_back() -> None:
    rod, journal = Rod(), Journal()

    def emit(event: dict[str, object]) -> None:
        journal.append(event)
        if event["event"] == "trip":
            made.report([LATER])  # another thread's, before this one has sent its fade-out

    made = Supervisor(config_for(), emit, lambda records: None, lambda now_ns: None, lambda: 0.0)
    made.attach(Coil(lambda: None), rod, rod, ())
    made.arm()
    made.report([FAULT])
    assert journal.slugs("trip") == [FAULT.slug]
    assert rod.actions
    assert rod.actions[-1] is StopAction.HALT


def test_each_stop_command_begins_the_proof_of_standstill_anew(supervisor: Supervisor) -> None:
    rod = Rod()
    supervisor.attach(Coil(lambda: None), rod, rod, ())
    supervisor.arm()
    supervisor.report([FAULT])
    assert rod.restarts == 2, "LVDT and controller"
    supervisor.report([Finding("sensor-saturated", "load_cell: the value is at the limit of the range", 0)])
    assert rod.restarts == 2, "nothing new is asked of the controller"
    supervisor.report([LATER])
    assert rod.restarts == 4


def test_a_defect_of_the_interlock_loop_stops_the_rig_and_the_stop_goes_on(journal: Journal) -> None:
    def beat(now_ns: int) -> None:
        if failing.is_set():
            raise RuntimeError("a defect")

    failing, rod = threading.Event(), Rod()
    made = Supervisor(config_for(), journal.append, lambda records: None, beat, lambda: 0.0)
    made.attach(Coil(lambda: None), rod, rod, ())
    made.start()
    made.arm()
    failing.set()
    with made.changed:
        assert made.changed.wait_for(lambda: made.trip is not None, 10.0)
        assert made.changed.wait_for(lambda: made.settled, 30.0), "its steps are still taken"
    made.end()
    assert journal.slugs("trip") == ["task-dies"]
    assert rod.actions[0] is StopAction.FADE


def test_a_station_that_hardly_runs_still_gives_a_stop_up_that_it_cannot_prove(journal: Journal) -> None:
    rod = Rod()
    made = Supervisor(config_for(), journal.append, lambda records: None, lambda now_ns: None, lambda: 0.0)
    made.attach(Coil(lambda: None), rod, rod, ())
    begun_ns = monotonic_ns()
    made.host.watch(begun_ns)
    made.arm()
    made.report([FAULT])
    for step in range(1, 40):
        made.tick(begun_ns + step * 300_000_000)
        if made.settled:
            break
    assert made.settled
    assert step * 0.3 < 6.0, "2.3 s until the controller counts as lost, 1 s forgiven, and a tick or two"
    assert rod.actions[-1] is StopAction.HYDRAULICS_OFF
