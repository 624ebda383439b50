"""The actuator driver against Modbus TCP bytes, right and wrong."""

import struct
import time
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from modbus_device import ModbusDevice, demo_actuator, framed

from drivers.errors import (
    Busy,
    DriverError,
    LinkLost,
    NoAnswer,
    PortClosed,
    RequestRefused,
    WrongAnswer,
    WrongIdentity,
)
from drivers.modbus_actuator import ModbusActuator
from drivers.roles import ActuatorLimits, Command, Program, Waveform
from protocols.errors import LocalProtocolError

TIMEOUT_S = 0.1
LIMITS = ActuatorLimits(-0.085, 0.085, 0.75, 60.0, 5000.0, 1.5, 20.0, 500)


@pytest.fixture
def device() -> Iterator[ModbusDevice]:
    made = ModbusDevice()
    yield made
    made.close()
    assert made.faults == [], "scripted answers that nobody asked for"


@pytest.fixture
def actuator(device: ModbusDevice) -> Iterator[ModbusActuator]:
    made = demo_actuator(device.url, timeout_s=TIMEOUT_S, owner_id=77)
    made.open()
    yield made
    made.close()


def silence(frame: bytes, right: bytes) -> list[bytes]:
    """The request is carried out, the answer is lost."""
    del frame, right
    return []


def never_arrived(frame: bytes, right: bytes) -> list[bytes]:
    """The request itself is lost."""
    del frame, right
    return []


never_arrived.unheard = True  # type: ignore[attr-defined]  # read by the device before it executes


def exception(code: int):  # noqa: ANN201 - a closure for the device's list of faults
    def answer(frame: bytes, right: bytes) -> list[bytes]:
        del right
        return [framed(frame, bytes([frame[7] | 0x80, code]))]

    answer.unheard = True  # type: ignore[attr-defined]  # an exception means that nothing was done
    return answer


def test_identity_is_read_and_its_signature_proved(actuator: ModbusActuator) -> None:
    assert actuator.read_identity().serial_number == "T-1"


@pytest.mark.parametrize(
    ("address", "words", "message"),
    [
        (0, [0x0304, 0x0102], r"signature_u32 .*0x03040102\), expected .*0x01020304"),
        (2, [0x5000, 0x449A], "signature_f32 .*expected 1234.5"),
        (4, [9], "layout_version 9, expected 1"),
        (26, [0xFFFF], "identity: .*not ASCII"),
    ],
)
def test_another_device_or_word_order_is_refused(
    device: ModbusDevice, actuator: ModbusActuator, address: int, words: list[int], message: str
) -> None:
    device.put(address, words)
    with pytest.raises(WrongIdentity, match=message):
        actuator.read_identity()


def test_exchange_feeds_and_polls_in_one_trip(device: ModbusDevice, actuator: ModbusActuator) -> None:
    before = time.monotonic_ns()
    status = actuator.exchange(65536 + 5)
    assert device.requests == [(23, 350, [5])]
    assert status.watchdog_echo == 5
    assert before <= status.received_ns <= time.monotonic_ns()


def test_reading_the_status_does_not_feed(device: ModbusDevice, actuator: ModbusActuator) -> None:
    actuator.read_status()
    assert device.requests == [(3, 100, [])]


def test_limits_are_written_and_read_back(device: ModbusDevice, actuator: ModbusActuator) -> None:
    actuator.write_limits(LIMITS)
    assert [request[:2] for request in device.requests] == [(16, 200), (3, 200)]
    assert actuator.read_limits().force_max_N == 5000.0


def test_limits_the_controller_does_not_hold_are_seen(device: ModbusDevice, actuator: ModbusActuator) -> None:
    device.ignore_writes = True
    with pytest.raises(WrongAnswer, match=r"position_min_m: wrote -0\.085, read back 0"):
        actuator.write_limits(LIMITS)


def test_limits_are_written_again_when_the_answer_was_lost(device: ModbusDevice, actuator: ModbusActuator) -> None:
    device.faults = [silence]
    actuator.write_limits(LIMITS)
    assert [request[0] for request in device.requests] == [16, 16, 3]


def test_a_command_is_one_write_with_a_new_sequence(device: ModbusDevice, actuator: ModbusActuator) -> None:
    device.put(118, [65535, 1, 0])
    sequence = actuator.send(Command.START, Program(Waveform.TRIANGLE, 0.05, 2.0, cycles=10.0))
    assert sequence == 1
    function, address, words = device.requests[-1]
    assert (function, address, words[:4]) == (16, 300, [7, 1, 77, 1])
    # 0.05 = 0x3D4CCCCD, 2.0 = 0x40000000, 10.0 = 0x41200000
    assert words[8:12] == [0x3D4C, 0xCCCD, 0x4000, 0]
    assert words[14:16] == [0x4120, 0]
    assert actuator.read_status().acknowledges(Command.START, 1)
    assert actuator.send(Command.FADE_STOP) == 2


def test_a_command_whose_answer_was_lost_is_not_executed_twice(device: ModbusDevice, actuator: ModbusActuator) -> None:
    actuator.send(Command.ACQUIRE)
    device.faults = [silence]
    sequence = actuator.send(Command.START)
    assert device.executed == [Command.ACQUIRE, Command.START]
    assert [request[0] for request in device.requests[-2:]] == [16, 3]
    assert actuator.read_status().acknowledges(Command.START, sequence)


def test_a_command_that_did_not_arrive_is_sent_again(device: ModbusDevice, actuator: ModbusActuator) -> None:
    actuator.send(Command.ACQUIRE)
    device.faults = [never_arrived]
    actuator.send(Command.HALT)
    assert device.executed == [Command.ACQUIRE, Command.HALT]


def test_a_command_survives_a_reset_connection(device: ModbusDevice, actuator: ModbusActuator) -> None:
    actuator.send(Command.ACQUIRE)
    device.hang_up()
    actuator.send(Command.FADE_STOP)
    assert device.executed == [Command.ACQUIRE, Command.FADE_STOP]


def test_a_command_that_never_gets_through_is_reported_and_its_number_is_not_used_again(
    device: ModbusDevice, actuator: ModbusActuator
) -> None:
    first = actuator.send(Command.ACQUIRE)
    device.faults = [never_arrived] * 20
    with pytest.raises((NoAnswer, LinkLost)):
        actuator.send(Command.START)
    device.faults = []
    assert actuator.send(Command.HALT) == first + 2
    assert device.executed == [Command.ACQUIRE, Command.HALT]


def test_a_controller_that_went_away_is_a_lost_link(device: ModbusDevice, actuator: ModbusActuator) -> None:
    actuator.send(Command.ACQUIRE)
    device.close()
    with pytest.raises(LinkLost, match="command 2: outcome unknown"):
        actuator.send(Command.FADE_STOP)
    assert not actuator.is_open


def test_a_value_the_register_cannot_hold_is_never_sent(device: ModbusDevice, actuator: ModbusActuator) -> None:
    actuator.send(Command.ACQUIRE)
    sent = len(device.requests)
    with pytest.raises(LocalProtocolError, match="'amplitude'"):
        actuator.send(Command.START, Program(Waveform.SINE, float("nan"), 1.0))
    assert len(device.requests) == sent


def test_a_late_answer_is_never_taken_for_the_next_one(device: ModbusDevice, actuator: ModbusActuator) -> None:
    late: list[bytes] = []

    def keep(frame: bytes, right: bytes) -> list[bytes]:
        late.append(framed(frame, right))
        return []

    def behind_the_late_one(frame: bytes, right: bytes) -> list[bytes]:
        return [late[0], framed(frame, right)]

    device.put(101, [1])
    device.faults = [keep, behind_the_late_one]
    device.registers[101] = 2
    assert actuator.read_status().state == 2
    device.registers[101] = 3
    assert actuator.read_status().state == 3


def test_a_silent_controller_is_reported_in_time_and_closed_at_the_second_time_out(
    device: ModbusDevice, actuator: ModbusActuator
) -> None:
    device.faults = [silence, silence]
    with pytest.raises(NoAnswer, match="no answer within 100 ms"):
        actuator.read_status()
    assert not actuator.is_open
    with pytest.raises(LinkLost, match="not connected"):
        actuator.read_status()
    actuator.open()
    assert actuator.read_status().state == 0


def test_one_lost_answer_is_read_again(device: ModbusDevice, actuator: ModbusActuator) -> None:
    device.faults = [silence]
    actuator.exchange(1)
    assert [request[0] for request in device.requests] == [23, 23]
    assert actuator.is_open


def test_a_busy_controller_is_queried_again_and_then_given_up(device: ModbusDevice, actuator: ModbusActuator) -> None:
    device.faults = [exception(6), exception(6)]
    assert actuator.read_status().state == 0
    device.faults = [exception(6)] * 10
    with pytest.raises(Busy, match=r"exception 6 \(busy\)"):
        actuator.read_status()
    device.faults = [exception(6)]
    actuator.send(Command.HALT)
    assert device.executed == [Command.HALT]


@pytest.mark.parametrize(
    ("code", "name"), [(2, "illegal address"), (3, "illegal value"), (4, "device failure"), (99, "unknown")]
)
def test_an_exception_is_a_refusal_with_its_name(
    device: ModbusDevice, actuator: ModbusActuator, code: int, name: str
) -> None:
    device.faults = [exception(code)]
    with pytest.raises(RequestRefused, match=rf"exception {code} \({name}\)"):
        actuator.read_status()


def short(frame: bytes, right: bytes) -> list[bytes]:
    del right
    return [framed(frame, bytes([3, 4, 0, 1, 0, 2]))]


def other_function(frame: bytes, right: bytes) -> list[bytes]:
    del right
    return [framed(frame, struct.pack(">BHH", 16, 100, 34))]


@pytest.mark.parametrize(("fault", "message"), [(short, "requested 34 registers, got 2"), (other_function, "function")])
def test_an_answer_to_another_question_is_not_believed(
    device: ModbusDevice, actuator: ModbusActuator, fault: object, message: str
) -> None:
    device.faults = [fault, fault]  # type: ignore[list-item]  # functions of the right shape
    with pytest.raises((WrongAnswer, NoAnswer), match=message):
        actuator.read_status()


def test_a_write_acknowledged_for_other_registers_is_not_believed(
    device: ModbusDevice, actuator: ModbusActuator
) -> None:
    def elsewhere(frame: bytes, right: bytes) -> list[bytes]:
        del right
        return [framed(frame, struct.pack(">BHH", 16, 500, 24))]

    actuator.send(Command.ACQUIRE)
    device.faults = [elsewhere]
    actuator.send(Command.START)
    assert device.executed == [Command.ACQUIRE, Command.START]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(pdu=st.binary(min_size=1, max_size=80))
def test_any_answer_gives_a_status_or_a_driver_error(
    device: ModbusDevice, actuator: ModbusActuator, pdu: bytes
) -> None:
    # More than enough: a request of the example before may still be on its way to the device.
    device.faults = [lambda frame, right: [framed(frame, pdu)]] * 100
    actuator._link._timeout_s = 0.02
    actuator.close()
    actuator.open()
    try:
        status = actuator.read_status()
    except DriverError:
        return
    finally:
        actuator.close()
        device.faults = []
    assert pdu[:2] == b"\x03\x44"
    assert status.heartbeat == int.from_bytes(pdu[2:4], "big")


def test_a_table_is_written_in_parts(device: ModbusDevice, actuator: ModbusActuator) -> None:
    actuator.write_table([0.001 * n for n in range(70)])
    assert [(request[1], request[2][:2]) for request in device.requests] == [(400, [0, 60]), (400, [60, 10])]
    assert len(device.requests[1][2]) == 122


@pytest.mark.parametrize(
    "url", ["modbus-tcp://127.0.0.1:1", "modbus-tcp://127.0.0.1", "http://x:5", "modbus-tcp://h:99999"]
)
def test_a_controller_that_cannot_be_reached_is_named(url: str) -> None:
    with pytest.raises(PortClosed, match=f"actuator at {url}"):
        demo_actuator(url).open()


def another_number(frame: bytes, right: bytes) -> list[bytes]:
    return [framed(bytes([frame[0], frame[1] ^ 0x55]) + frame[2:], right)]


def another_unit(frame: bytes, right: bytes) -> list[bytes]:
    return [framed(frame[:6] + bytes([frame[6] + 1]), right)]


def not_modbus(frame: bytes, right: bytes) -> list[bytes]:
    return [b"HTTP/1.1 400 Bad Request\r\n"]


def test_an_answer_with_another_number_is_thrown_away_and_counted(
    device: ModbusDevice, actuator: ModbusActuator
) -> None:
    device.faults = [another_number]
    assert actuator.read_status().state == 0
    assert actuator.stale == 1


def test_a_connection_whose_numbers_are_wrong_is_left_without_waiting_for_better_ones(device: ModbusDevice) -> None:
    impatient = demo_actuator(device.url, timeout_s=20.0)
    impatient.open()
    device.faults = [another_number, another_number]
    began_ns = time.monotonic_ns()
    with pytest.raises(NoAnswer):
        impatient.read_status()
    assert not impatient.is_open
    assert time.monotonic_ns() - began_ns < 10e9, "neither time-out was waited for"


def test_an_answer_of_another_unit_is_not_believed(device: ModbusDevice, actuator: ModbusActuator) -> None:
    device.faults = [another_unit, another_unit]
    with pytest.raises(WrongAnswer, match="sent to unit 1, but unit 2 answered"):
        actuator.read_status()


def test_a_peer_that_does_not_speak_modbus_is_left(device: ModbusDevice, actuator: ModbusActuator) -> None:
    device.faults = [not_modbus]
    with pytest.raises(WrongAnswer, match="invalid Modbus header"):
        actuator.read_status()
    assert not actuator.is_open


def test_busy_answers_are_counted(device: ModbusDevice, actuator: ModbusActuator) -> None:
    device.faults = [exception(6), exception(6)]
    actuator.read_status()
    assert actuator.busy == 2
