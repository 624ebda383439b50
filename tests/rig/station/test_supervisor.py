"""What the supervisor makes of findings: each is told once, however often it is found."""

from __future__ import annotations

import pytest
from station_bench import Told, config_for

from drivers.ring import Channel, Record
from rig.station.fault_table import TABLE
from rig.station.interlocks import Finding
from rig.station.supervisor import Supervisor


@pytest.fixture
def told() -> Told:
    return Told()


@pytest.fixture
def ring() -> list[Record]:
    return []


@pytest.fixture
def supervisor(told: Told, ring: list[Record]) -> Supervisor:
    return Supervisor(config_for(), told.append, ring.extend, lambda now_ns: None)


def test_what_is_found_again_and_again_is_told_once_a_second_before_arming_and_once_as_a_trip(
    supervisor: Supervisor, told: Told, ring: list[Record]
) -> None:
    repeated = [Finding("sensor-fault", "load_cell: the sensor reports a fault", 0)] * 1000
    supervisor.report(repeated)
    assert [event["event"] for event in told] == ["warning"]
    supervisor.arm()
    supervisor.report(repeated)
    supervisor.report([Finding("sensor-saturated", "load_cell: at its end", 0)] * 1000)
    assert [event["event"] for event in told] == ["warning", "trip", "also"]
    trips = [record for record in ring if record[4] == Channel.TRIP]
    assert [record[2] for record in trips] == [TABLE["sensor-fault"].code, TABLE["sensor-saturated"].code]


def test_what_is_still_there_after_a_reset_trips_again(supervisor: Supervisor, told: Told) -> None:
    supervisor.arm()
    finding = Finding("position-disagreement", "controller at 0.1 m, LVDT at 0 m", 0)
    supervisor.report([finding])
    assert supervisor.reset(supervisor.stop)
    supervisor.report([finding])
    assert told.slugs("trip") == ["position-disagreement"] * 2
