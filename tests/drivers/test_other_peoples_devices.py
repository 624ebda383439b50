"""Devices of other people behind pymodbus's own server: state, pressure, fault and watchdog are told apart.

A drive with a CiA 402 status word, a stepper in the manner of Oriental Motor's AZ, a PLC in the manner of TwinCAT with
floats and a handshake. Their logic is written here from such documents, and shares nothing with the maps' reader.
"""

from __future__ import annotations

import asyncio
import struct
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from drivers.connection import ActuatorConnection
from drivers.errors import Busy
from drivers.modbus_actuator import ModbusActuator
from drivers.register_maps.map_file import controller
from drivers.roles import ActuatorStatus, Command, Pressure, State
from drivers.setpoint_generator import Setpoint

CIA402 = """
[modbus]
first_address = 0
[quantities]
status_word = {address = 0x41, access = "r"}
position = {address = 0x64, type = "i32", unit = "um", access = "r"}
error_code = {address = 0x3F, access = "r"}
control_word = {address = 0x40}
target = {address = 0x7A, type = "i32", unit = "um"}
heartbeat_in = {address = 0x200}
[state]
tripped = {quantity = "status_word", bit = 3}
hold = [{quantity = "status_word", bit = 2}, {quantity = "status_word", bit = 1}, {quantity = "status_word", bit = 0}]
off = true
[pressure]
off = {quantity = "status_word", bit = 4, equals = 0}
on = {quantity = "status_word", bit = 4}
[faults]
watchdog = {quantity = "error_code", equals = 0x8130}
following-error = {quantity = "error_code", equals = 0x8611}
[commands]
hydraulics-on = [
    {write = {control_word = 6}}, {write = {control_word = 7}}, {write = {control_word = 15}},
    {wait = {quantity = "status_word", bit = 2}, within = "1 s"},
]
hydraulics-off = {write = {control_word = 0}}
reset = [{write = {control_word = 0x80}}, {write = {control_word = 0}}]
[setpoint]
write = {target = "$position"}
[watchdog]
kind = "counter"
write = {heartbeat_in = "$counter"}
time = "500 ms"
"""
STEPPER = """
[quantities]
position = {address = 0xCC, type = "i32", scale = 0.01, unit = "mm", access = "r"}
driver_output = {address = 0x7F, access = "r"}
alarm = {address = 0x80, type = "u32", access = "r"}
driver_input = {address = 0x7D}
target = {address = 0x58, type = "i32", scale = 0.01, unit = "mm"}
[state]
tripped = {quantity = "driver_output", bit = 7}
off = {quantity = "driver_output", bit = 1, equals = 0}
moving = {quantity = "driver_output", bit = 13}
hold = {quantity = "driver_output", bit = 5}
[faults]
following-error = {quantity = "alarm", equals = 0x10}
internal = {quantity = "alarm", equals = 0x28}
[commands]
hydraulics-on = [{write = {driver_input = 1}}, {wait = {quantity = "driver_output", bit = 1}, within = "1 s"}]
hydraulics-off = {write = {driver_input = 0}}
halt = {write = {driver_input = 33}}
reset = [{write = {driver_input = 128}}, {write = {driver_input = 0}}]
[setpoint]
write = {target = "$position"}
"""
PLC = """
[modbus]
word_order = "little"
first_address = 0x3000
[quantities]
state = {address = 0x3000, access = "r"}
enabled = {address = 0x3001, access = "r"}
position = {address = 0x3004, type = "f32", unit = "mm", access = "r"}
watchdog_bit = {address = 0x3002, access = "r"}
order = {address = 0x3080}
setpoint_position = {address = 0x3084, type = "f32", unit = "mm"}
life = {address = 0x3090}
[state]
off = 0
hold = 10
tripped = 99
[inputs]
hydraulics-on = {quantity = "enabled"}
[faults]
watchdog = {quantity = "watchdog_bit"}
[commands]
hydraulics-on = [{write = {order = 1}}, {wait = {quantity = "state", equals = 10}, within = "1 s"}]
hydraulics-off = {write = {order = 2}}
reset = {write = {order = 3}}
acquire = {write = {order = 7}}
release = {write = {order = 8}}
[setpoint]
write = {setpoint_position = "$position"}
[watchdog]
kind = "counter"
write = {life = "$counter"}
time = "500 ms"
"""


class Device:
    """Registers behind pymodbus's server; `written` is the device's logic."""

    def __init__(self) -> None:
        self.words: dict[int, int] = {}
        self.powered = False
        self.fault = 0
        self.orders: list[int] = []
        self.stays_on = False

    def off(self) -> None:
        """Ordered off."""
        self.powered = self.powered and self.stays_on

    def shown(self) -> dict[int, int]:
        raise NotImplementedError

    def written(self, address: int) -> None:
        raise NotImplementedError

    async def access(
        self, function: int, start: int, address: int, count: int, registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> None:
        del function
        if values is None:
            shown = self.words | self.shown()
            registers[address - start : address - start + count] = [shown.get(address + i, 0) for i in range(count)]
            return
        for place, value in enumerate(values):
            self.words[address + place] = int(value)
        self.written(address)


class Cia402(Device):
    """Voltage enabled is bit 4, fault bit 3; a fault may or may not switch the voltage off."""

    def shown(self) -> dict[int, int]:
        enabled = 0b0111 if self.powered and not self.fault else 0
        return {0x41: enabled | (1 << 3) * bool(self.fault) | (1 << 4) * self.powered, 0x3F: self.fault}

    def written(self, address: int) -> None:
        if address == 0x40:
            word = self.words[0x40]
            self.orders.append(word)
            if word == 0x80:
                self.fault = 0
            elif word == 15:
                self.powered = True
            elif word == 0:
                self.off()


class Stepper(Device):
    """SYS-RDY bit 1 shows excitation, READY bit 5, ALM-A bit 7."""

    def shown(self) -> dict[int, int]:
        ready = self.powered and not self.fault
        output = (1 << 1) * self.powered | (1 << 5) * ready | (1 << 7) * bool(self.fault)
        return {0x7F: output, 0x80: 0, 0x81: self.fault}

    def written(self, address: int) -> None:
        if address == 0x7D:
            word = self.words[0x7D]
            self.orders.append(word)
            if word == 128:
                self.fault = 0
            elif word == 1:
                self.powered = True
            elif word == 0:
                self.off()


class Plc(Device):
    """A state of its own beside its enable; the watchdog is a bit."""

    def shown(self) -> dict[int, int]:
        low, high = struct.unpack("<HH", struct.pack("<f", 12.5))
        return {
            0: 99 if self.fault else 10 if self.powered else 0, 1: int(self.powered), 2: int(self.fault == 1),
            4: low, 5: high,
        }

    def written(self, address: int) -> None:
        if address == 0x80:
            order = self.words[0x80]
            self.orders.append(order)
            if order == 1:
                self.powered = True
            elif order == 2:
                self.off()
            elif order == 3:
                self.fault = 0


async def ended(server: Any) -> None:  # noqa: ANN401 - its shutdown is not annotated
    await server.shutdown()


@pytest.fixture
def driven() -> Iterator[Callable[[str, Device], ModbusActuator]]:
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    made: list[ModbusActuator] = []
    servers: list[ModbusTcpServer] = []

    async def serve(device: Device) -> int:
        bits, words = [SimData(0, values=[False] * 16, datatype=DataType.BITS)], [
            SimData(0, values=[0] * 0x400, datatype=DataType.REGISTERS)
        ]
        described = SimDevice(1, (bits, bits, words, words), action=device.access)
        server = ModbusTcpServer(described, address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        servers.append(server)
        listener: Any = server.transport  # an asyncio.Server, which pymodbus declares as a transport
        return int(listener.sockets[0].getsockname()[1])

    def make(text: str, device: Device) -> ModbusActuator:
        port = asyncio.run_coroutine_threadsafe(serve(device), loop).result(5.0)
        described = controller(tomllib.loads(text))
        made.append(ModbusActuator(ActuatorConnection(f"modbus-tcp://127.0.0.1:{port}", 1, 0.5), described))
        made[-1].open()
        made[-1].read_identity()
        return made[-1]

    yield make
    for one in made:
        one.close()
    for server in servers:
        asyncio.run_coroutine_threadsafe(ended(server), loop).result(5.0)
    loop.call_soon_threadsafe(loop.stop)
    thread.join(5.0)
    loop.close()


def settled(actuator: ModbusActuator, state: int) -> ActuatorStatus:
    """Polls until it shows a state."""
    deadline = time.monotonic() + 30.0
    while (status := actuator.read_status()).state != state:
        assert time.monotonic() < deadline, (status.state, state)
    return status


@pytest.mark.parametrize(("text", "made", "fault"), [(CIA402, Cia402, 0x8611), (STEPPER, Stepper, 0x28), (PLC, Plc, 2)])
def test_a_trip_hides_no_pressure(
    text: str, made: type[Device], fault: int, driven: Callable[[str, Device], ModbusActuator]
) -> None:
    device = made()
    actuator = driven(text, device)
    assert actuator.read_status().hydraulics_off
    actuator.send(Command.HYDRAULICS_ON)
    assert settled(actuator, State.HOLD).pressure is Pressure.ON
    actuator.follow(Setpoint(0.001, 0.0), 1 if actuator.capabilities.watchdog != "none" else None)
    device.fault = fault
    tripped = settled(actuator, State.TRIPPED)
    assert not tripped.hydraulics_off, "tripped, and still powered"
    assert (tripped.tripped, tripped.watchdog_tripped) == (True, False)
    device.stays_on = True
    actuator.send(Command.HYDRAULICS_OFF)
    assert not actuator.read_status().hydraulics_off, "it took the order and stays on"
    device.stays_on = False
    actuator.send(Command.HYDRAULICS_OFF)
    gone = actuator.read_status()
    assert (gone.state, gone.hydraulics_off) == (State.TRIPPED, True)
    actuator.send(Command.RESET)
    assert settled(actuator, State.OFF).hydraulics_off


@pytest.mark.parametrize(("text", "made", "fault"), [(CIA402, Cia402, 0x8130), (PLC, Plc, 1)])
def test_the_watchdogs_trip_is_a_fact_of_its_own(
    text: str, made: type[Device], fault: int, driven: Callable[[str, Device], ModbusActuator]
) -> None:
    device = made()
    actuator = driven(text, device)
    device.fault = fault
    status = settled(actuator, State.TRIPPED)
    assert (status.watchdog_tripped, status.hydraulics_off) == (True, True)


def test_control_is_taken_and_given_back_without_an_owner(driven: Callable[[str, Device], ModbusActuator]) -> None:
    device = Plc()
    actuator = driven(PLC, device)
    able = actuator.capabilities
    assert (able.lease, able.acquires, able.releases) == (False, True, True)
    actuator.send(Command.ACQUIRE)
    actuator.send(Command.RELEASE)
    assert device.orders == [7, 8]


SINGLE_BITS = CIA402.replace(
    'target = {address = 0x7A, type = "i32", unit = "um"}',
    """target = {address = 0x7A, type = "i32", unit = "um"}
new_setpoint = {address = 0x40, bit = 4, access = "rw", write_function = FUNCTION}
at_once = {address = 0x40, bit = 5, access = "rw", write_function = FUNCTION}""",
).replace(
    'write = {target = "$position"}',
    """steps = [
    {write = {target = "$position"}},
    {write = {new_setpoint = 1, at_once = 1}},
    {wait = {quantity = "status_word", bit = 12}, within = "40 ms"},
    {write = {new_setpoint = 0}},
    {wait = {quantity = "status_word", bit = 12, equals = 0}, within = "40 ms"},
]""",
)


class Handshake(Cia402):
    """Takes a target with an edge of bit 4 and acknowledges it in bit 12."""

    def __init__(self) -> None:
        super().__init__()
        self.taken: list[int] = []
        self.acknowledges = True

    def shown(self) -> dict[int, int]:
        shown = super().shown()
        acknowledged = self.acknowledges and self.words.get(0x40, 0) & 0x10
        return shown | {0x41: shown[0x41] | 0x1000 * bool(acknowledged)}

    def written(self, address: int) -> None:
        before = self.orders[-1] if self.orders else 0
        super().written(address)
        if address == 0x40 and self.powered and self.words[0x40] & 0x10 and not before & 0x10:
            self.taken.append(self.words[0x7A] << 16 | self.words[0x7B])


@pytest.mark.parametrize("function", [6, 16, 22])
def test_single_bits_hand_a_set_point_over_and_leave_the_others(
    function: int, driven: Callable[[str, Device], ModbusActuator]
) -> None:
    device = Handshake()
    actuator = driven(SINGLE_BITS.replace("FUNCTION", str(function)), device)
    actuator.send(Command.HYDRAULICS_ON)
    settled(actuator, State.HOLD)
    device.words[0x40] |= 0x40
    for target_m in (0.001, 0.002, 0.002):
        actuator.follow(Setpoint(target_m, 0.0), 1)
    assert device.taken == [1000, 2000, 2000], "one edge each"
    assert device.words[0x40] == 0x6F, "bits 0 to 3 as before, bit 5 set, bit 4 taken back, bit 6 as the test left it"
    device.words[0x40] &= ~0x40
    actuator.follow(Setpoint(0.003, 0.0), 2)
    assert not device.words[0x40] & 0x40, "a bit that the device has taken back is not set again"


def test_a_set_point_that_is_not_acknowledged_is_taken_back_and_told(
    driven: Callable[[str, Device], ModbusActuator]
) -> None:
    device = Handshake()
    actuator = driven(SINGLE_BITS.replace("FUNCTION", "22"), device)
    actuator.send(Command.HYDRAULICS_ON)
    settled(actuator, State.HOLD)
    device.acknowledges = False
    with pytest.raises(Busy, match="within 40 ms"):
        actuator.follow(Setpoint(0.001, 0.0), 1)
    assert device.words[0x40] & 0x10 == 0, "the next set-point has an edge again"
    device.acknowledges = True
    actuator.follow(Setpoint(0.002, 0.0), 2)
    assert device.taken == [1000, 2000]
