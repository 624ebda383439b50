"""The ECU driver over slcan bytes and over python-can's virtual bus."""

import math
import struct
import time
from collections.abc import Callable, Iterator

import demo_ecu as wire
import pytest
from demo_ecu import CoilStatus, CoilTemperature, EcuIdentity
from slcan_device import SlcanDevice

from drivers.can_current_source import CanCurrentSource
from drivers.can_library import import_can
from drivers.can_port import CanPort
from drivers.connection import CanAddress
from drivers.current_source import SourceBatch, SourceCounters, SourceIdentity
from drivers.devices.dbc_file import parse_dbc
from drivers.devices.ecu_roles import describe
from drivers.devices.source import current_source
from drivers.errors import LinkLost, PortClosed
from drivers.frame_checks import FrameChecks
from drivers.ring import Channel
from protocols.errors import LocalProtocolError
from protocols.quality import Quality
from rig.station.interlocks.current_interlock import BusInterlock

DEMO = current_source("demo")


def source(interface: str, channel: str, bitrate: int = 500_000) -> CanCurrentSource:
    return CanCurrentSource(CanPort(CanAddress(interface, channel, bitrate)), DEMO)


@pytest.fixture
def device() -> Iterator[SlcanDevice]:
    with SlcanDevice() as made:
        yield made


@pytest.fixture
def ecu(device: SlcanDevice) -> Iterator[CanCurrentSource]:
    made = source("slcan", device.channel)
    made.open()
    yield made
    made.close()


def status(counter: int, current_A: float = 0.5, ticks: int = 0, faults: int = 0) -> bytes:
    return wire.encode(CoilStatus(counter % 15, 2, current_A, faults, 10.0, ticks % 65536))


def collect(ecu: CanCurrentSource, done: Callable[[SourceBatch], bool], timeout_s: float = 5.0) -> SourceBatch:
    """Batches of the ECU joined until `done`."""
    total = SourceBatch([], [], [], 0, 0, 0)
    deadline = time.monotonic() + timeout_s
    while not done(total) and time.monotonic() < deadline:
        batch = ecu.read_batch(0.05)
        total.records.extend(batch.records)
        total.statuses.extend(batch.statuses)
        total.temperatures.extend(batch.temperatures)
        total = total._replace(
            lost=total.lost + batch.lost, bad=total.bad + batch.bad, arrival_ns=batch.arrival_ns
        )
    return total


def of(batch: SourceBatch, channel: Channel) -> list[tuple[int, float, int, int]]:
    """(device_us, value, sequence, flags) of a channel's records."""
    return [(r[1], r[2], r[3], r[5]) for r in batch.records if r[4] == channel]


def commands(device: SlcanDevice) -> list[wire.CoilCommand]:
    sent = [bytes.fromhex(line[5:].decode()) for line in device.lines if line.startswith(b"t1208")]
    return [wire.decode(wire.CoilCommand, data) for data in sent]


def test_the_adapter_is_set_up_before_anything_else(device: SlcanDevice, ecu: CanCurrentSource) -> None:
    del ecu
    assert device.wait_for(lambda lines: b"O" in lines)
    assert device.lines[:2] == [b"C", b"S6"]
    assert set(device.lines[2:]) <= {b"O", b""}


def test_status_frames_become_records(device: SlcanDevice, ecu: CanCurrentSource) -> None:
    for n in range(3):
        device.frame(0x121, status(n, current_A=0.5 + n / 10, ticks=65500 + 100 * n))
    batch = collect(ecu, lambda b: len(b.statuses) == 3)
    # 0.1 ms a tick; the clock wraps at 65536.
    assert of(batch, Channel.COIL_CURRENT) == [
        (6_550_000, 0.5, 1, 0), (6_560_000, 0.6, 2, 0), (6_570_000, pytest.approx(0.7), 3, 0),
    ]
    assert of(batch, Channel.ECU_STATE) == [(6_550_000, 2.0, 1, 0)]
    assert of(batch, Channel.ECU_FAULTS) == [(6_550_000, 0.0, 1, 0)]
    assert ecu.status is not None
    assert ecu.status.current_A == pytest.approx(0.7)


def test_temperatures_come_with_the_standing_state(device: SlcanDevice, ecu: CanCurrentSource) -> None:
    device.frame(0x122, wire.encode(CoilTemperature(85.3, 41.0, 24.07, 3)))
    device.frame(0x121, status(1, faults=4))
    device.frame(0x122, wire.encode(CoilTemperature(85.4, 41.0, 24.07, 3)))
    batch = collect(ecu, lambda b: len(b.temperatures) == 2)
    assert [value for _, value, _, _ in of(batch, Channel.COIL_TEMPERATURE)] == pytest.approx([85.3, 85.4])
    assert [value for _, value, _, _ in of(batch, Channel.ECU_SUPPLY)] == pytest.approx([24.07, 24.07])
    assert [value for _, value, _, _ in of(batch, Channel.ECU_TEMPERATURE)] == pytest.approx([41.0, 41.0])
    assert [value for _, value, _, _ in of(batch, Channel.ECU_FAULTS)] == [4.0, 4.0]


def test_missing_and_repeated_status_frames_are_counted(device: SlcanDevice, ecu: CanCurrentSource) -> None:
    for counter in (13, 14, 14, 2):
        device.frame(0x121, status(counter))
    batch = collect(ecu, lambda b: len(b.statuses) == 3)
    assert [(sequence, flags) for _, _, sequence, flags in of(batch, Channel.COIL_CURRENT)] == [
        (1, 0), (2, 0), (5, Quality.GAP_BEFORE),
    ]
    assert (batch.lost, ecu.counters.duplicates) == (2, 1)


def test_a_frame_with_a_wrong_crc_is_dropped_and_counted_in_a_row(device: SlcanDevice, ecu: CanCurrentSource) -> None:
    broken = bytearray(status(1))
    broken[0] ^= 1
    device.frame(0x121, bytes(broken))
    device.frame(0x121, bytes(broken))
    device.frame(0x121, status(2)[:7])
    assert collect(ecu, lambda b: b.bad == 3).statuses == []
    assert (ecu.counters.bad_checks, ecu.counters.bad_in_a_row, ecu.malformed) == (2, 3, 1)
    device.frame(0x121, status(3))
    collect(ecu, lambda b: bool(b.statuses))
    assert ecu.counters.bad_in_a_row == 0


@pytest.mark.parametrize(
    "line", [b"r1218\r", b"T00000121" + b"8" + b"00" * 8 + b"\r", b"t1217" + b"00" * 7 + b"\r", b"t1218zz\r"]
)
def test_remote_extended_short_and_garbled_frames_are_malformed(
    device: SlcanDevice, ecu: CanCurrentSource, line: bytes
) -> None:
    device.send(line)
    device.frame(0x121, status(1))
    collect(ecu, lambda b: bool(b.statuses))
    assert ecu.malformed == 1
    assert ecu.counters.statuses == 1


def test_a_other_sender_of_our_command_is_seen(device: SlcanDevice, ecu: CanCurrentSource) -> None:
    device.frame(0x120, bytes(8))
    device.frame(0x7FF, b"\x01")
    device.send(b"\a")
    device.frame(0x121, status(1))
    collect(ecu, lambda b: bool(b.statuses))
    assert (ecu.counters.foreign_commands, ecu.counters.other_frames, ecu.bus_errors) == (1, 1, 1)


def test_commands_go_out_cyclically_with_counter_and_crc(device: SlcanDevice, ecu: CanCurrentSource) -> None:
    ecu.command(1.25)
    ecu.start(0.002)
    ecu.start(0.002)
    assert device.wait_for(lambda lines: len(commands(device)) >= 20)
    sent = commands(device)[:20]
    assert [command.counter for command in sent] == [n % 15 for n in range(20)]
    assert {(c.setpoint_A, c.enable, c.clear_faults) for c in sent} == {(1.25, True, False)}
    batch = ecu.read_batch(0.0)
    assert {value for _, value, _, _ in of(batch, Channel.COMMANDED_CURRENT)} == {1.25}


def test_before_any_command_the_frames_ask_for_zero_and_off(device: SlcanDevice, ecu: CanCurrentSource) -> None:
    ecu.start()
    assert device.wait_for(lambda lines: len(commands(device)) >= 1)
    assert commands(device)[0] == wire.CoilCommand(0, enable=False, clear_faults=False, setpoint_A=0.0)


def test_a_stop_goes_out_at_once_beside_the_cycle(device: SlcanDevice, ecu: CanCurrentSource) -> None:
    ecu.command(2.0)
    ecu.start(60.0)
    ecu.command(0.0, enable=False, clear_faults=True)
    ecu.send_now()
    assert device.wait_for(lambda lines: len(commands(device)) >= 2)
    assert [(c.counter, c.setpoint_A, c.enable, c.clear_faults) for c in commands(device)] == [
        (0, 2.0, True, False), (1, 0.0, False, True),
    ]


def test_a_setpoint_the_frame_cannot_carry_leaves_the_old_one(device: SlcanDevice, ecu: CanCurrentSource) -> None:
    ecu.command(1.0)
    with pytest.raises(LocalProtocolError, match="CurrentSetpoint"):
        ecu.command(40.0)
    ecu.send_now()
    assert device.wait_for(lambda lines: len(commands(device)) >= 1)
    assert commands(device)[0].setpoint_A == 1.0


def test_after_closing_no_command_goes_out(device: SlcanDevice, ecu: CanCurrentSource) -> None:
    ecu.start(0.001)
    ecu.close()
    ecu.close()
    assert device.wait_for(lambda lines: len(lines) > 3 and lines[-1] == b"C")
    with pytest.raises(PortClosed):
        ecu.send_now()


def test_a_pulled_adapter_is_reported_and_ends_the_command_thread(device: SlcanDevice, ecu: CanCurrentSource) -> None:
    ecu.start(0.001)
    device.pull()
    with pytest.raises(PortClosed, match="ecu at socket://"):
        collect(ecu, lambda _: False)
    deadline = time.monotonic() + 5
    while ecu.send_error is None and time.monotonic() < deadline:
        time.sleep(0.001)
    assert isinstance(ecu.send_error, (PortClosed, LinkLost))


@pytest.mark.parametrize(("layout", "problem"), [(1, ""), (2, "frame layout 2, expected 1")])
def test_an_identity_of_another_layout_is_reported(
    device: SlcanDevice, ecu: CanCurrentSource, layout: int, problem: str
) -> None:
    assert (ecu.identity, ecu.identity_problem) == (None, "")
    device.frame(0x123, wire.encode(EcuIdentity(1001, 0x0102, layout)))
    collect(ecu, lambda _: ecu.identity is not None)
    assert ecu.identity == SourceIdentity(1001, 0x0102, layout)
    assert ecu.identity_problem == problem


def test_an_unknown_bit_rate_is_refused_before_anything_is_opened() -> None:
    with pytest.raises(PortClosed, match="unsupported bit rate 499999"):
        source("slcan", "/nowhere", 499_999).open()


def test_any_other_interface_goes_through_python_can() -> None:
    can = import_can()
    ecu = source("virtual", "damper-rig-test")
    ecu.open()
    with can.Bus(interface="virtual", channel="damper-rig-test") as peer:
        ecu.command(0.75)
        ecu.send_now()
        message = peer.recv(1.0)
        assert message is not None
        assert wire.decode(wire.CoilCommand, bytes(message.data)).setpoint_A == 0.75
        peer.send(can.Message(arbitration_id=0x121, data=status(5), is_extended_id=False))
        peer.send(can.Message(arbitration_id=0x121, data=status(6), is_extended_id=True))
        peer.send(can.Message(arbitration_id=0x121, is_error_frame=True))
        peer.send(can.Message(arbitration_id=0x121, data=status(6), is_extended_id=False))
        batch = collect(ecu, lambda b: len(b.statuses) == 2)
    assert [record[3] for record in batch.records if record[4] == Channel.COIL_CURRENT] == [1, 2]
    assert (ecu.malformed, ecu.bus_errors) == (1, 1)
    assert ecu.read_batch(0.0).statuses == []
    ecu.close()
    ecu.close()


def test_an_interface_that_cannot_be_opened_is_named() -> None:
    with pytest.raises(PortClosed, match="ecu at nosuch:x: cannot be opened"):
        source("nosuch", "x").open()
    port = CanPort(CanAddress("virtual", "y"))
    with pytest.raises(PortClosed, match="not open"):
        port.send(0x120, bytes(8))
    with pytest.raises(PortClosed, match="not open"):
        port.receive(0.0)


def test_an_ecu_that_was_commanded_is_left_at_no_current_and_disabled(device: SlcanDevice) -> None:
    ecu = source("slcan", device.channel)
    ecu.open()
    ecu.command(1.0)
    ecu.start(0.01)
    assert device.wait_for(lambda lines: len(commands(device)) >= 2)
    ecu.close()
    assert device.wait_for(lambda lines: b"C" in lines[3:])
    last = commands(device)[-3:]
    assert [(one.setpoint_A, one.enable) for one in last] == [(0.0, False)] * 3
    assert [one.counter for one in last] == [(last[0].counter + place) % 15 for place in range(3)]


def test_an_ecu_that_was_only_listened_to_is_sent_nothing_at_the_end(device: SlcanDevice) -> None:
    ecu = source("slcan", device.channel)
    ecu.open()
    ecu.close()
    assert device.wait_for(lambda lines: b"C" in lines[1:])
    assert commands(device) == []


def test_a_current_that_is_no_number_is_no_status_and_is_named() -> None:
    counters = SourceCounters()
    checks, bus = FrameChecks(DEMO, counters), BusInterlock(500_000)
    assert checks.measured(0.5)
    found = []
    for place in range(3):
        assert not checks.measured(float("nan"))
        found += bus.check(counters, place)
    assert [(one.slug, one.warns) for one in found] == [
        ("current-unmeasured", True), ("current-unmeasured", True), ("current-unmeasured", False)
    ]
    assert checks.measured(0.5)
    assert counters.unmeasured_in_a_row == 0


FLOATS = """VERSION ""
BU_: A
BO_ 16 Order: 4 A
 SG_ Amps : 0|16@1- (0.01,0) [0|0] "A" A
BO_ 17 Status: 12 A
 SG_ Amps : 0|32@1- (1,0) [0|0] "A" A
 SG_ Coil : 32|32@1- (1,0) [0|0] "degC" A
 SG_ Supply : 64|32@1- (1,0) [0|0] "V" A
SIG_VALTYPE_ 17 Amps : 1;
SIG_VALTYPE_ 17 Coil : 1;
SIG_VALTYPE_ 17 Supply : 1;
"""


@pytest.mark.parametrize(
    ("values", "current", "temperatures", "recorded"),
    [
        ((0.5, 30.0, 12.0), [0.5], [30.0], {"COIL_CURRENT", "COIL_TEMPERATURE", "ECU_SUPPLY"}),
        ((0.5, math.nan, 12.0), [0.5], [], {"COIL_CURRENT", "ECU_SUPPLY"}),
        ((0.5, 30.0, math.inf), [0.5], [30.0], {"COIL_CURRENT", "COIL_TEMPERATURE"}),
        ((math.nan, 30.0, 12.0), [], [30.0], {"COIL_TEMPERATURE", "ECU_SUPPLY"}),
    ],
)
def test_one_value_that_is_no_number_does_not_take_its_frame_with_it(
    values: tuple[float, ...], current: list[float], temperatures: list[float], recorded: set[str]
) -> None:
    made = describe("floats", parse_dbc(FLOATS), {
        "command": "Order.Amps", "measured_current": "Status.Amps", "coil_temperature": "Status.Coil",
        "supply_voltage": "Status.Supply",
    })  # fmt: skip
    source = CanCurrentSource(CanPort(CanAddress("virtual", "floats", 500_000), fd=True), made)
    batch = SourceBatch([], [], [], 0, 0, 0)
    data = struct.pack("<3f", *values)
    source._take((17, data, False, False, len(data)), batch)
    assert [status.current_A for status in batch.statuses] == current
    assert [one.coil_degC for one in batch.temperatures] == temperatures
    assert {Channel(record[4]).name for record in batch.records} == recorded
    missing = {channel.name for channel in source.counters.not_numbers}
    assert missing == {"COIL_TEMPERATURE", "ECU_SUPPLY"} - recorded


J1939 = """VERSION ""
BS_:
BU_: A B
BO_ 2565865982 Order: 2 B
 SG_ Amps : 0|16@1- (0.001,0) [-3|3] "A" A
BO_ 2566844926 Status: 3 A
 SG_ Amps : 0|16@1- (0.001,0) [-3|3] "A" B
 SG_ Coil : 16|8@1+ (1,-40) [0|0] "degC" B
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "J1939PG";
"""
J1939_ROLES = {"command": "Order.Amps", "measured_current": "Status.Amps", "coil_temperature": "Status.Coil"}


def j1939_currents(identifiers: list[int], **keys: int) -> tuple[CanCurrentSource, list[float]]:
    made = describe("j1939", parse_dbc(J1939), {**J1939_ROLES, **keys})
    source = CanCurrentSource(CanPort(CanAddress("virtual", "j1939", 250_000)), made)
    batch = SourceBatch([], [], [], 0, 0, 0)
    for number, identifier in enumerate(identifiers):
        source._take((identifier, struct.pack("<hB", 100 * number, 60), True, False, 3), batch)
    return source, [status.current_A for status in batch.statuses]


def test_j1939_messages_are_known_by_their_parameter_group_and_one_address() -> None:
    source, currents = j1939_currents([0x18FEF181, 0x0CFEF181, 0x18FEF182, 0x18FEF1FE, 0x18FEF281])
    assert currents == [0.0, 0.1], "any priority, the first address, this group alone"
    slug, words = source.refusal
    assert slug == "can-foreign"
    assert "0x81, 0x82, 0xFE" in words
    source, currents = j1939_currents([0x18FEF181, 0x18FEF182, 0x18F08103, 0x18F001FE, 0x18F00105], source_address=0x82)
    assert (currents, source.refusal) == ([0.1], ("", ""))
    assert source.counters.foreign_commands == 2, "a command to the same destination, from any address"
    (frame,) = describe("j1939", parse_dbc(J1939), {**J1939_ROLES, "own_address": 0x21}).sent
    assert frame.identifier == 0x18F00121


def test_frames_that_an_interface_returns_to_their_sender_are_ignored() -> None:
    can = import_can()
    port = CanPort(CanAddress("udp_multicast", "ff15::1", 500_000))
    arrived = [can.Message(arbitration_id=16, data=data, is_extended_id=False) for data in (b"a", b"a", b"b")]
    port._can, port._bus = can, type("Bus", (), {
        "send": lambda *_, **__: None, "recv": lambda *_: arrived.pop(0) if arrived else None,
    })()  # fmt: skip
    port.send(16, b"a")
    frames, _ = port.receive(0.0)
    assert [frame[1] for frame in frames] == [b"a", b"b"], "another sender's frame with the same data is kept"
