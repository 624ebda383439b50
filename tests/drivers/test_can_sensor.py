"""Sensors on CAN against nodes of python-can whose frames cantools packs."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import Any

import can
import cantools
import pytest

from drivers.can_bus import CanBus
from drivers.can_current_source import CanCurrentSource
from drivers.catalogue import SensorConnection, make_sensor
from drivers.connection import CanAddress
from drivers.devices.can_sensor import can_format
from drivers.devices.dbc_file import DbcText
from drivers.devices.source import current_source
from drivers.errors import PortClosed
from drivers.ring import Channel
from drivers.sample_stream import SampleScale
from drivers.serial_sensor import SerialSensor
from protocols.descriptions import DescriptionProblems

DBC = '''VERSION ""
BU_: Cell Travel Host
BO_ 385 LoadCell: 8 Cell
 SG_ Force : 0|24@1- (0.5,0) [-100000|100000] "N" Host
 SG_ State : 24|8@1+ (1,0) [0|255] "" Host
 SG_ Cnt : 52|4@1+ (1,0) [0|15] "" Host
BO_ 386 TravelSensor: 4 Travel
 SG_ Travel : 7|24@0- (0.001,0) [-200|200] "mm" Host
BO_ 2566848278 Pressure: 8 Cell
 SG_ Oil : 7|16@0+ (0.1,-100) [-100|6453.5] "bar" Host
VAL_ 385 State 0 "ok" 1 "overload" 2 "broken" ;
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 2566848278 3;
'''
NETWORK = {"name": "sensors.dbc", "text": DBC}
FORCE = {
    "dbc": NETWORK, "signal": "LoadCell.Force", "status": {"signal": "State", "fault_values": ("broken",)},
    "protection": {"profile": "counter", "counter": "Cnt"},
}
TRAVEL = {"dbc": NETWORK, "signal": "TravelSensor.Travel", "request": "remote"}
PRESSURE = {"dbc": NETWORK, "signal": "Pressure.Oil"}


@pytest.fixture
def node() -> Iterator[can.BusABC]:
    with can.Bus(interface="virtual", channel="sensors") as bus:
        yield bus


def bus_of(name: str = "sensors") -> CanBus:
    return CanBus(CanAddress("virtual", name))


def sensor(bus: CanBus, name: str, table: Mapping[str, object], rate_Hz: float = 100.0) -> SerialSensor:
    connection = SensorConnection(
        "virtual:sensors", 0, name, Channel.FORCE, table, SampleScale(rate_Hz=rate_Hz), bus=bus
    )
    made = make_sensor(connection)
    assert isinstance(made, SerialSensor)
    return made


def send(node: can.BusABC, name: str, identifier: int | None = None, **signals: float) -> None:
    network: Any = cantools.database.load_string(DBC, "dbc")
    message = network.get_message_by_name(name)
    number = message.frame_id if identifier is None else identifier
    data = message.encode(signals, strict=False)
    node.send(can.Message(arbitration_id=number, is_extended_id=message.is_extended_frame, data=data))


def values(driver: SerialSensor, count: int) -> list[float]:
    found: list[float] = []
    end = time.monotonic() + 2.0
    while len(found) < count and time.monotonic() < end:
        found += [record[2] for record in driver.read_batch(0.02).records]
    return found


def test_a_signal_of_a_dbc_is_read_with_its_counter_and_its_state(node: can.BusABC) -> None:
    bus = bus_of()
    force = sensor(bus, "load_cell", FORCE)
    force.open()
    for count, newton in enumerate((12.5, -4000.0, 0.5)):
        send(node, "LoadCell", Force=newton, State=0, Cnt=count)
    assert values(force, 3) == [12.5, -4000.0, 0.5]
    send(node, "LoadCell", Force=1.0, State=0, Cnt=6)
    assert values(force, 1) == [1.0]
    assert force.counters.lost == 3
    send(node, "LoadCell", Force=1.0, State=2, Cnt=7)
    assert values(force, 1)[0] != 1.0
    assert force.counters.sensor_faults == 1
    node.send(can.Message(arbitration_id=385, is_extended_id=False, data=bytes(5)))
    assert force.read_batch(0.05).records == []
    assert force.bad_frames == 1
    force.close()


def test_a_polled_sensor_is_asked_by_remote_frames(node: can.BusABC) -> None:
    travel = sensor(bus_of(), "lvdt", TRAVEL)
    travel.open()
    assert travel.read_batch(0.01).records == []
    request = node.recv(1.0)
    assert request is not None
    assert (request.arbitration_id, request.is_remote_frame, request.dlc) == (386, True, 4)
    send(node, "TravelSensor", Travel=-12.345)
    assert values(travel, 1) == [pytest.approx(-12.345)]
    travel.close()


def test_a_message_without_a_dbc_is_described_by_its_bytes(node: can.BusABC) -> None:
    table = {"id": 0x182, "length": 4, "order": "big", "fields": {"value": {"at": 0, "type": "i24", "scale": 0.001}}}
    travel = sensor(bus_of(), "lvdt", table)
    travel.open()
    send(node, "TravelSensor", Travel=-0.5)
    assert values(travel, 1) == [pytest.approx(-0.5)]
    travel.close()


def test_a_bus_is_opened_for_can_fd_if_one_of_its_devices_uses_it(node: can.BusABC) -> None:
    bus = bus_of()
    force = sensor(bus, "load_cell", FORCE)
    assert not bus.port.fd
    table = {"id": 0x182, "length": 12, "fields": {"value": {"at": 8, "type": "i32", "scale": 0.001}}}
    travel = sensor(bus, "lvdt", table)
    assert bus.port.fd
    travel.open()
    data = bytes(8) + (-2500).to_bytes(4, "little", signed=True)
    node.send(can.Message(arbitration_id=0x182, is_extended_id=False, is_fd=True, data=data))
    assert values(travel, 1) == [pytest.approx(-2.5)]
    assert not force.is_open
    travel.close()


def test_the_ecu_and_sensors_share_a_bus_and_each_has_its_own_frames(node: can.BusABC) -> None:
    bus = bus_of()
    force, description = sensor(bus, "load_cell", FORCE), current_source("demo")
    ecu = CanCurrentSource(bus.join("ecu", description.hears, rest=True), description)
    force.open()
    ecu.open()
    send(node, "LoadCell", Force=7.0, State=0, Cnt=1)
    node.send(can.Message(arbitration_id=0x555, is_extended_id=False, data=b"\1"))
    assert values(force, 1) == [7.0]
    ecu.read_batch(0.05)
    assert ecu.counters.other_frames == 1
    ecu.close()
    send(node, "LoadCell", Force=8.0, State=0, Cnt=2)
    assert values(force, 1) == [8.0]
    force.close()
    with pytest.raises(PortClosed, match="not open"):
        force.read_batch(0.0)


@pytest.mark.parametrize(("more", "slug"), [({}, "no-answer"), ({"source_address": 0x21}, "")])
def test_a_parameter_group_from_another_address_is_named_with_what_to_write(
    node: can.BusABC, more: dict[str, object], slug: str
) -> None:
    pressure = sensor(bus_of(), "oil_pressure", {**PRESSURE, **more})
    pressure.open()
    own = 2566848278 & 0x1FFF_FFFF
    send(node, "Pressure", own & ~0xFF | 0x21, Oil=150.0)
    if slug:
        assert pressure.read_batch(0.05).records == []
    else:
        assert values(pressure, 1) == [pytest.approx(150.0)]
    assert pressure.refusal[0] == slug
    assert ("source_address = 0x21" in pressure.refusal[1]) is bool(slug)
    pressure.close()


def test_the_ecu_s_parameter_group_from_another_address_is_named_too() -> None:
    dbc = DBC.replace("Pressure", "Drive").replace('SG_ Oil : 7|16@0+ (0.1,-100) [-100|6453.5] "bar"',
                                                   'SG_ Current : 0|16@1+ (0.001,0) [0|60] "A"')
    dbc = dbc.replace("BO_ 386", 'BO_ 387 Order: 2 Host\n SG_ Wanted : 0|16@1+ (0.001,0) [0|60] "A" Cell\nBO_ 386')
    described = current_source(
        DbcText("ecu.dbc", dbc), {"command": "Order.Wanted", "measured_current": "Drive.Current"}
    )
    with can.Bus(interface="virtual", channel="ecu") as node:
        bus = bus_of("ecu")
        ecu = CanCurrentSource(bus.join("ecu", described.hears, rest=True), described)
        ecu.open()
        number = 2566848278 & 0x1FFF_FF00 | 0x21
        node.send(can.Message(arbitration_id=number, is_extended_id=True, data=bytes(8)))
        ecu.read_batch(0.05)
        assert ecu.refusal[0] == "no-answer"
        assert "source_address = 0x21" in ecu.refusal[1]
        ecu.close()


def test_the_ecu_s_messages_are_requested_at_their_periods_and_another_host_s_requests_are_no_faults() -> None:
    dbc = DBC.replace("BO_ 386", 'BO_ 387 Order: 2 Host\n SG_ Wanted : 0|16@1+ (0.001,0) [0|60] "A" Cell\n'
                      'BO_ 388 Drive: 2 Cell\n SG_ Current : 0|16@1+ (0.001,0) [0|60] "A" Host\n'
                      'BO_ 389 Heat: 1 Cell\n SG_ Coil : 0|8@1+ (1,0) [0|200] "degC" Host\nBO_ 386')
    described = current_source(DbcText("ecu.dbc", dbc), {
        "command": "Order.Wanted", "measured_current": "Drive.Current", "coil_temperature": "Heat.Coil",
        "requests": {"Drive": "remote", "Heat": {"id": 0x85, "data": (1, 2)}}, "periods": {"Drive": "20 ms"},
    })  # fmt: skip
    assert described.timing == (0.02, 0.1, 0.0)
    assert "periods" not in dict(described.lacking)
    with can.Bus(interface="virtual", channel="polled-ecu") as node:
        bus = bus_of("polled-ecu")
        ecu = CanCurrentSource(bus.join("ecu", described.hears, rest=True), described)
        ecu.open()
        statuses = []
        requests: list[tuple[int, bool, int, bytes]] = []
        end = time.monotonic() + 0.19
        while time.monotonic() < end:
            statuses += ecu.read_batch(0.005).statuses
            while (frame := node.recv(0.0)) is not None:
                requests.append((frame.arbitration_id, frame.is_remote_frame, frame.dlc, bytes(frame.data)))
                if frame.arbitration_id == 388:
                    node.send(can.Message(arbitration_id=388, is_extended_id=False, data=b"\xe8\x03"))
        assert set(requests) == {(388, True, 2, b""), (0x85, False, 2, b"\1\2")}
        assert 4 <= requests.count((388, True, 2, b"")) <= 10, "one in every 20 ms"
        assert 1 <= requests.count((0x85, False, 2, b"\1\2")) <= 2, "one in every 100 ms"
        assert len(statuses) >= 3
        assert statuses[-1].current_A == 1.0
        node.send(can.Message(arbitration_id=388, is_extended_id=False, is_remote_frame=True, dlc=2))
        ecu.read_batch(0.005)
        assert (ecu.counters.malformed, ecu.counters.other_frames) == (0, 1)
        ecu.close()


def refused(table: dict[str, object]) -> list[str]:
    with pytest.raises(DescriptionProblems) as error:
        can_format(table)
    return [f"{place}: {text}" for place, text in error.value.problems]


CASES: list[tuple[dict[str, object], str]] = [
    ({"dbc": NETWORK, "signal": "LoadCell.Fource"}, "nearest: Force"),
    ({"dbc": NETWORK, "signal": "LoadCell.Force", "id": 5}, "the DBC file defines this"),
    ({"id": 0x900, "extended": False, "length": 8, "fields": {}}, "exceeds the 11 bits"),
    ({"id": 0x100, "length": 9, "fields": {}}, "must be the length"),
    ({"id": 0x100, "length": 2, "fields": {"value": {"at": 1, "type": "i16"}}}, "extends beyond"),
    ({"id": 0x100, "length": 2, "fields": {"value": {"at": 0, "type": "i16"}}, "source_address": 3}, "29-bit"),
    ({"id": 0x100, "length": 2, "fields": {"value": {"at": 0, "type": "i16"}}, "request": {"id": 0x100}},
     "('request', 'id'): 0x100 is the identifier of the requested message"),
]


@pytest.mark.parametrize(("table", "text"), CASES)
def test_contradictions_are_named(table: dict[str, object], text: str) -> None:
    assert any(text in problem for problem in refused(table))


