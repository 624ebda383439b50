"""The driver by a user's register map, against a device of registers and coils written here by hand."""

from __future__ import annotations

import socket
import struct
import threading
import time
import tomllib
from collections.abc import Callable, Iterator

import pytest

from drivers.connection import ActuatorConnection, MotionTerms
from drivers.errors import WrongLayout
from drivers.modbus_actuator import ModbusActuator
from drivers.register_maps.map_file import controller
from drivers.register_maps.quantity import Quantity
from drivers.roles import Command, Move, Program, Result, State, Waveform
from drivers.streamed_actuator import as_actuator
from protocols.errors import LocalProtocolError

HANDSHAKE = """
[quantities]
signature = {address = 900, type = "u32", word_order = "little"}
state = {address = 0, function = "input"}
position = {address = 1, function = "input", type = "i16", scale = 0.01, unit = "mm"}
ready = {address = 0, function = "discrete"}
accepted = {address = 1, function = "discrete"}
pump = {address = 10, function = "coil", write_function = 15}
request = {address = 11, function = "coil"}
code = {address = 100, write_function = 6}
target = {address = 101, type = "i16", scale = 0.01, unit = "mm"}
amplitude = {address = 103, scale = 0.01, unit = "mm"}
frequency = {address = 104, scale = 0.01, unit = "Hz"}
cycles = {address = 105}
[identity]
signature = 0x01020304
[state]
off = {quantity = "ready", equals = 0}
hold = 1
moving = 2
[commands]
hydraulics-on = [{write = {pump = true}}, {wait = {quantity = "ready"}, within = "2 s"}]
hydraulics-off = {write = {pump = false}}
move-to = [{write = {target = "$target"}}, {recipe = "go-1"}]
start = [{write = {amplitude = "$amplitude", frequency = "$frequency", cycles = "$all_cycles"}}, {recipe = "go-2"}]
halt = {write = {code = 9, request = 1}}
[recipes]
go-1 = [{write = {code = 1, request = 1}}, {recipe = "answer"}]
go-2 = [{write = {code = 2, request = 1}}, {recipe = "answer"}]
answer = [
    {wait = {quantity = "accepted"}, within = "100 ms"},
    {write = {request = 0}},
    {wait = {quantity = "accepted", equals = 0}, within = "100 ms"},
]
"""
STREAMED = """
[quantities]
position = {address = 0, type = "f32", unit = "mm"}
clock = {address = 2, unit = "ms"}
setpoint_position = {address = 20, type = "f32", unit = "mm"}
enable = {address = 30}
[state]
off = {quantity = "enable", equals = 0}
hold = true
[commands]
hydraulics-on = {write = {enable = 1}}
hydraulics-off = {write = {enable = 0}}
[setpoint]
write = {setpoint_position = "$position"}
"""


class Device:
    """Registers and coils on Modbus TCP; keeps every request's bytes."""

    def __init__(self) -> None:
        self.words = {"holding": [0] * 1000, "input": [0] * 1000, "coil": [0] * 100, "discrete": [0] * 100}
        self.requests: list[bytes] = []
        self.acts: Callable[[bytes], None] = lambda pdu: None
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"modbus-tcp://127.0.0.1:{self._server.getsockname()[1]}"
        self.driven: list[ModbusActuator] = []
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def writes(self) -> list[str]:
        return [pdu.hex() for pdu in self.requests if pdu[0] not in {1, 2, 3, 4}]

    def close(self) -> None:
        for actuator in self.driven:
            actuator.close()
        self._thread.join(5)
        self._server.close()

    def _serve(self) -> None:
        connection, _ = self._server.accept()
        data = b""
        with connection:
            while chunk := connection.recv(4096):
                data += chunk
                while len(data) >= 6 and len(data) >= 6 + int.from_bytes(data[4:6], "big"):
                    size = 6 + int.from_bytes(data[4:6], "big")
                    frame, data = data[:size], data[size:]
                    pdu = frame[7:]
                    self.requests.append(pdu)
                    answer = self._answer(pdu)
                    self.acts(pdu)
                    connection.sendall(frame[:4] + struct.pack(">HB", len(answer) + 1, frame[6]) + answer)

    def _answer(self, pdu: bytes) -> bytes:
        function, address, count = struct.unpack(">BHH", pdu[:5])
        if function in {3, 4}:
            words = self.words["holding" if function == 3 else "input"][address : address + count]
            return struct.pack(f">BB{count}H", function, 2 * count, *words)
        if function in {1, 2}:
            bits = self.words["coil" if function == 1 else "discrete"][address : address + count]
            packed = sum(bit << place for place, bit in enumerate(bits)).to_bytes((count + 7) // 8, "little")
            return bytes([function, len(packed)]) + packed
        if function == 16:
            self.words["holding"][address : address + count] = struct.unpack(f">{count}H", pdu[6:])
        elif function == 6:
            self.words["holding"][address] = count
        elif function == 5:
            self.words["coil"][address] = int(count == 0xFF00)
        elif function == 15:
            self.words["coil"][address : address + count] = [pdu[6] >> place & 1 for place in range(count)]
        return pdu[:5]


@pytest.fixture
def device() -> Iterator[Device]:
    made = Device()
    yield made
    made.close()


def driven(device: Device, text: str) -> ModbusActuator:
    actuator = ModbusActuator(ActuatorConnection(device.url, timeout_s=1.0), controller(tomllib.loads(text)))
    device.driven.append(actuator)
    actuator.open()
    return actuator


def test_a_handshake_is_gone_on_with_at_the_polls_and_then_acknowledged(device: Device) -> None:
    device.words["discrete"][0] = 1
    device.words["input"][:2] = [1, 500]
    actuator = driven(device, HANDSHAKE)
    assert actuator.capabilities.acknowledge
    sequence = actuator.send(Command.MOVE_TO, Move(-0.0123, 0.1))
    # -12.3 mm in steps of 0.01 mm = -1230 = 0xFB32; code 1 by function 6, the request's coil by function 5
    assert device.writes() == ["10006500010" + "2fb32", "0600640001", "05000bff00"]
    assert actuator.read_status().result == Result.BUSY
    device.words["discrete"][1] = 1
    assert actuator.read_status().result == Result.BUSY, "the request is still to be taken back"
    assert device.writes()[-1] == "05000b0000"
    device.words["discrete"][1] = 0
    status = actuator.read_status()
    assert (status.acknowledges(Command.MOVE_TO, sequence), status.result) == (True, Result.DONE)
    assert (status.state, status.position_m) == (State.HOLD, pytest.approx(0.005))


def test_a_handshake_that_is_not_answered_in_time_is_a_refusal(device: Device) -> None:
    device.words["discrete"][0] = 1
    actuator = driven(device, HANDSHAKE)
    begin_s = time.monotonic()
    actuator.send(Command.MOVE_TO, Move(0.01, 0.1))
    while (result := actuator.read_status().result) == Result.BUSY:
        assert time.monotonic() - begin_s < 5.0
    assert result == Result.REFUSED_STATE
    assert time.monotonic() - begin_s > 0.09


def test_a_stop_goes_before_a_command_that_still_waits_and_counts_when_it_is_written(device: Device) -> None:
    device.words["discrete"][0] = 1
    actuator = driven(device, HANDSHAKE)
    actuator.send(Command.START, Program(Waveform.SINE, 0.02, 1.5, cycles=10.0))
    sequence = actuator.send(Command.FADE_STOP)
    assert device.writes()[-2:] == ["0600640009", "05000bff00"], "it stops in one way only"
    status = actuator.read_status()
    assert (status.acknowledges(Command.FADE_STOP, sequence), status.result) == (True, Result.DONE)
    before = len(device.writes())
    device.words["discrete"][1] = 1
    actuator.read_status()
    assert len(device.writes()) == before, "the start is not gone on with"


@pytest.mark.parametrize(
    ("type_", "shown", "written"),
    [
        ("u16", -5, "0000"),  # the rod is 0.05 mm beyond the register's end
        ("u16", 123, "007b"),
        ("i16", 32767, "7fff"),  # 327.67 mm, in a register of steps of 1 um
    ],
)
@pytest.mark.parametrize("command", [Command.HALT, Command.FADE_STOP])
def test_a_stop_that_writes_the_position_goes_out_wherever_the_rod_is(
    device: Device, command: Command, type_: str, shown: int, written: str
) -> None:
    scale = 0.001 if type_ == "i16" else 0.01
    text = HANDSHAKE.replace("halt = {write = {code = 9, request = 1}}", 'halt = {write = {hold_at = "$position"}}')
    register = f'hold_at = {{address = 110, type = "{type_}", scale = {scale}, unit = "mm"}}'
    text = text.replace("[identity]", f"{register}\n[identity]")
    device.words["input"][:2] = [2, shown & 0xFFFF]
    actuator = driven(device, text)
    actuator.send(command)
    assert device.writes() == ["1000" + "6e" + "0001" + "02" + written]


@pytest.mark.parametrize(("type_", "length"), [("u16", 1), ("i16", 1), ("u32", 2), ("i32", 2), ("f32", 2), ("f64", 4)])
@pytest.mark.parametrize("value", [-1e300, -0.02, 0.0, 0.0123456, 1e300])
def test_the_nearest_value_is_one_that_the_register_holds(type_: str, length: int, value: float) -> None:
    for scale in (0.01, 1.0, -1.0):
        quantity = Quantity("hold_at", "holding", 0, type_, length, scale=scale, factor=1e-3)
        nearest = quantity.nearest(value)
        assert quantity.holds(nearest)
        assert (nearest == value) is quantity.holds(value)
    assert Quantity("whole", "holding", 0, "u16").nearest(70000.4) == 0xFFFF


def test_what_moves_is_what_was_requested_and_cycles_are_counted_by_time(device: Device) -> None:
    device.words["discrete"][:2] = [1, 1]
    actuator = driven(device, HANDSHAKE)
    actuator.send(Command.START, Program(Waveform.SINE, 0.02, 100.0, cycles=3.0))
    device.words["input"][0] = 2
    assert actuator.read_status().state == State.RUNNING
    device.words["input"][0] = 1
    ended = actuator.read_status()
    assert (ended.state, ended.cycles_done, ended.program_id) == (State.HOLD, 3, 0)
    actuator.send(Command.HALT)
    device.words["input"][0] = 2
    assert actuator.read_status().state == State.HALTING


def test_a_device_with_one_pressure_shows_low_while_it_is_off_and_loses_pressure_when_low_is_requested(
    device: Device,
) -> None:
    device.words["input"][0] = 1
    actuator = driven(device, HANDSHAKE)
    assert actuator.read_status().state == State.OFF
    actuator.send(Command.HYDRAULICS_LOW)
    assert (actuator.read_status().state, device.writes()) == (State.LOW, [])
    actuator.send(Command.HYDRAULICS_ON)
    assert device.writes() == ["0f000a0001" + "0101"]
    device.words["discrete"][0] = 1
    assert actuator.read_status().state == State.HOLD
    actuator.send(Command.HYDRAULICS_LOW)
    assert device.writes()[-1] == "0f000a0001" + "0100"


def test_swapped_words_are_refused_with_the_order_that_would_be_right(device: Device) -> None:
    device.words["holding"][900:902] = [0x0102, 0x0304]
    actuator = driven(device, HANDSHAKE)
    with pytest.raises(WrongLayout, match=r'0x03040102\), expected .*with word_order = "big", the same words'):
        actuator.read_identity()
    device.words["holding"][900:902] = [0x0304, 0x0102]
    actuator.read_identity()


def test_a_controller_with_another_number_of_decimal_places_is_refused(device: Device) -> None:
    text = HANDSHAKE.replace("[identity]", "decimal_places = {address = 920}\n[identity]\ndecimal_places = 2")
    device.words["holding"][900:902] = [0x0304, 0x0102]
    device.words["holding"][920] = 3
    actuator = driven(device, text)
    with pytest.raises(WrongLayout, match="decimal_places 3, expected 2"):
        actuator.read_identity()
    device.words["holding"][920] = 2
    actuator.read_identity()


def test_set_points_are_laid_where_the_rod_is_before_it_can_move_and_then_streamed(device: Device) -> None:
    # 12.5 mm as f32: 0x41480000
    device.words["holding"][0:3] = [0x4148, 0, 65_500]
    device.words["holding"][20:22] = [0x4248, 0]
    driver = driven(device, STREAMED)
    actuator = as_actuator(driver, MotionTerms())
    before = actuator.read_status()
    actuator.send(Command.HYDRAULICS_LOW)
    assert device.writes() == [], "there is no low pressure"
    actuator.send(Command.HYDRAULICS_ON)
    assert device.writes() == ["100014000204" + "41480000", "10001e000102" + "0001"]
    assert actuator.read_status().state == State.HOLD
    actuator.send(Command.MOVE_TO, Move(0.0225, 0.5))
    device.words["holding"][2] = 300
    status = actuator.exchange(1)
    assert status.state == State.MOVING
    assert (status.clock_us - before.clock_us) == 336_000, "a clock of 16 bits went round"
    while actuator.exchange(2).state == State.MOVING:
        pass
    # 22.5 mm: 0x41B40000
    assert device.writes()[-1] == "100014000204" + "41b40000"
    with pytest.raises(LocalProtocolError, match="reset is not supported by this controller"):
        actuator.send(Command.RESET)


def test_a_watchdog_that_set_points_feed_is_fed_wherever_the_rod_is(device: Device) -> None:
    """The rod is 0.05 mm beyond what the set-point's register can hold."""
    text = STREAMED.replace('{address = 20, type = "f32", unit = "mm"}', '{address = 20, scale = 0.01, unit = "mm"}')
    watched = '[watchdog]\nkind = "setpoints"\n[faults]\nwatchdog = {quantity = "enable"}\n[state]'
    text = text.replace("[state]", watched)
    text = text.replace("[setpoint]", "reset = {write = {enable = 0}}\nhalt = {write = {enable = 3}}\n[setpoint]")
    device.words["holding"][:2] = list(struct.unpack(">2H", struct.pack(">f", -0.05)))
    actuator = driven(device, text)
    actuator.read_status()
    actuator.exchange(1)
    assert device.writes() == ["1000140001" + "02" + "0000"]


def test_a_watchdog_that_set_points_feed_is_fed_from_the_first_poll_on_and_starved_by_reading(device: Device) -> None:
    text = STREAMED.replace("[state]", "trip = {address = 31}\n[watchdog]\nkind = \"setpoints\"\n[faults]\n"
                            "watchdog = {quantity = \"trip\"}\n[state]")  # fmt: skip
    text = text.replace("[setpoint]", "reset = {write = {trip = 0}}\nhalt = {write = {enable = 3}}\n[setpoint]")
    # 12.5 mm, 12.75 mm and 13 mm as f32: 0x41480000, 0x414C0000, 0x41500000
    device.words["holding"][0] = 0x4148
    actuator = as_actuator(driven(device, text), MotionTerms())
    actuator.read_status()
    actuator.exchange(1)
    device.words["holding"][0] = 0x414C
    actuator.read_status()
    actuator.exchange(2)
    assert device.writes() == ["100014000204" + "41480000", "100014000204" + "414c0000"], "off: where the rod is"
    actuator.send(Command.HYDRAULICS_ON)
    device.words["holding"][0] = 0x4150
    for counter in (3, 4):
        actuator.exchange(counter)
    assert device.writes()[-2:] == ["100014000204" + "414c0000"] * 2, "under pressure: where it is held"
    actuator.send(Command.HALT)
    before = device.writes()
    actuator.exchange(5)
    assert device.writes() == before, "a set-point could have a halted device go on"


def test_indirect_registers_are_laid_down_at_connect_and_read_in_one_piece(device: Device) -> None:
    text = STREAMED.replace("[setpoint]", "[indirect]\npointers = 700\ndata = 800\nquantities = [\"position\", "
                            "\"clock\", \"enable\"]\n[setpoint]")  # fmt: skip
    device.words["holding"][800:804] = [0x4148, 0, 7, 1]
    actuator = driven(device, text)
    assert device.requests == [bytes.fromhex("1002bc000408" + "0000" + "0001" + "0002" + "001e")]
    status = actuator.read_status()
    assert device.requests[1:] == [bytes.fromhex("0303200004")]
    assert (status.position_m, status.state) == (pytest.approx(0.0125), State.HOLD)


def test_one_pointer_shows_all_registers_of_a_value(device: Device) -> None:
    text = STREAMED.replace("[setpoint]", "[indirect]\npointers = 700\ndata = 800\npointer_for = \"value\"\n"
                            "quantities = [\"position\", \"clock\", \"enable\"]\n[setpoint]")  # fmt: skip
    device.words["holding"][800:804] = [0x4148, 0, 7, 1]
    actuator = driven(device, text)
    assert device.requests == [bytes.fromhex("1002bc000306" + "0000" + "0002" + "001e")]
    status = actuator.read_status()
    assert device.requests[1:] == [bytes.fromhex("0303200004")]
    assert (status.position_m, status.state) == (pytest.approx(0.0125), State.HOLD)


NUMBERED = """
[quantities]
status = {address = 0}
position = {address = 1, type = "i16", scale = 0.01, unit = "mm"}
acked_sequence = {address = 3}
acked_command = {address = 4}
result = {address = 5}
order = {address = 100}
number = {address = 101}
target = {address = 102, type = "i16", scale = 0.01, unit = "mm"}
amplitude = {address = 103}
frequency = {address = 104}
cycles = {address = 105}
[state]
off = {quantity = "status", equals = 0}
running = {quantity = "status", equals = 2}
hold = true
[command_codes]
hydraulics-on = 1
hydraulics-off = 2
move-to = 3
start = 4
halt = 6
[results]
done = 1
[commands]
hydraulics-on = {write = {order = 1, number = "$sequence"}}
hydraulics-off = {write = {order = 2, number = "$sequence"}}
move-to = {write = {order = 3, number = "$sequence", target = "$target"}}
start = [
    {write = {amplitude = "$amplitude", frequency = "$frequency", cycles = "$all_cycles"}},
    {write = {order = 4, number = "$sequence"}},
]
halt = {write = {order = 6, number = "$sequence"}}
"""


def test_a_command_that_another_one_carries_out_is_acknowledged_as_what_was_requested(device: Device) -> None:
    """One pressure and one way to stop: low pressure writes nothing, a fade-out is the halt (code 6)."""
    held = device.words["holding"]
    held[3:6] = [512, 4, 1]  # yesterday's start
    actuator = driven(device, NUMBERED)

    def obeys(pdu: bytes) -> None:
        if pdu[0] == 16:
            held[3:6] = [held[101], held[100], 1]
            held[0] = {1: 1, 2: 0}.get(held[100], held[0])

    device.acts = obeys
    assert actuator.read_status().acked_sequence == 512
    low = actuator.send(Command.HYDRAULICS_LOW)
    status = actuator.read_status()
    assert (status.acknowledges(Command.HYDRAULICS_LOW, low), status.result) == (True, Result.DONE)
    assert (status.state, device.writes()) == (State.LOW, [])
    on = actuator.send(Command.HYDRAULICS_ON)
    assert actuator.read_status().acknowledges(Command.HYDRAULICS_ON, on)
    stop = actuator.send(Command.FADE_STOP)
    status = actuator.read_status()
    assert status.acknowledges(Command.FADE_STOP, stop)
    assert (on, stop, held[100]) == (low + 1, low + 2, 6)
    held[3:5] = [stop, 4]  # somebody else's start with our number
    assert actuator.read_status().acked_command == Command.START
