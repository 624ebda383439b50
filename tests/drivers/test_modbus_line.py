"""One connection for Modbus sensors and an analogue output, against a server of pymodbus."""

from __future__ import annotations

import asyncio
import struct
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from drivers.connection import LineSettings
from drivers.devices.supply import SupplyConnection
from drivers.devices.supply_file import supply
from drivers.errors import PortClosed, SharedConnectionClosed
from drivers.modbus_line import ModbusLine, ModbusSensor, SharedWire, blocks_of
from drivers.modbus_output import ModbusOutput
from drivers.ring import Channel
from drivers.sample_stream import SampleScale
from drivers.sensor_formats import described_format
from protocols import modbus
from protocols.binary_format import BinaryFormat

EXAMPLES = Path(__file__).parents[2] / "examples"
AINS = {0: 1.25, 2: -3.5, 4: 0.8}
LABJACK = {"base": "labjack-t"}


class Device:
    """A data-acquisition device: float registers, what was asked of it and by how many connections."""

    def __init__(self) -> None:
        self.volts = {**AINS, 1000: 0.0}
        self.reads: list[tuple[int, int]] = []
        self.connections = 0
        self.missing = False
        self.takes_s = 0.0
        self._loop = asyncio.new_event_loop()
        self._server: Any = None
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        asyncio.run_coroutine_threadsafe(self._open(), self._loop).result(5.0)

    async def _open(self) -> None:
        whole = SimData(0, count=61_700, values=0, datatype=DataType.REGISTERS)
        self._server = ModbusTcpServer(
            SimDevice(1, simdata=[whole], action=self._action), address=("127.0.0.1", 0),
            trace_connect=self._connected,
        )
        await self._server.serve_forever(background=True)
        self.port = self._server.transport.sockets[0].getsockname()[1]

    @property
    def url(self) -> str:
        return f"modbus-tcp://127.0.0.1:{self.port}"

    def close(self) -> None:
        if self._server is not None:
            asyncio.run_coroutine_threadsafe(self._server.shutdown(), self._loop).result(5.0)
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(5.0)
            self._loop.close()
            self._server = None

    def _connected(self, connected: bool) -> None:
        self.connections += connected

    async def _action(
        self, function: int, start: int, address: int, count: int, registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        await asyncio.sleep(self.takes_s)
        if values is not None:
            if address == 1000:
                self.volts[1000] = struct.unpack(">f", struct.pack(">2H", *values))[0]
            return None
        self.reads.append((address, count))
        if self.missing and address < 1000:
            return ExcCodes.ILLEGAL_ADDRESS
        for first, volts in self.volts.items():
            for place, word in enumerate(struct.unpack(">2H", struct.pack(">f", volts))):
                if address <= first + place < address + count:
                    registers[first + place - start] = word
        return None


@pytest.fixture
def device() -> Iterator[Device]:
    made = Device()
    yield made
    made.close()


def sensor(line: ModbusLine, name: str, channel: Channel, rate_Hz: float = 200.0, **more: object) -> ModbusSensor:
    layout = described_format({**LABJACK, **more})
    assert isinstance(layout, BinaryFormat)
    assert layout.registers is not None
    return ModbusSensor(
        line, name=name, channel=channel, layout=layout, registers=layout.registers, scale=SampleScale(rate_Hz=rate_Hz)
    )


def line_at(url: str) -> ModbusLine:
    return ModbusLine(url, LineSettings(), rtu=False)


def output(device: Device, line: ModbusLine) -> ModbusOutput:
    described = supply(tomllib.loads((EXAMPLES / "labjack-output.toml").read_text(encoding="utf-8")))
    assert described.output is not None
    return ModbusOutput(SupplyConnection(device.url, described, poll_s=0.02, timeout_s=0.1), described.output, line)


def until(condition: Callable[[], bool], seconds: float = 3.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.002)


def test_force_travel_and_current_have_one_connection_and_one_request_a_period(device: Device) -> None:
    line = line_at(device.url)
    force, travel = sensor(line, "load_cell", Channel.FORCE), sensor(line, "lvdt", Channel.DISPLACEMENT, address=2)
    source = output(device, line)
    for driver in (force, travel, source):
        driver.open()
    try:
        values: dict[str, list[float]] = {"load_cell": [], "lvdt": []}

        def read() -> bool:
            for one in (force, travel):
                values[one.name] += [record[2] for record in one.read_batch(0.05).records]
            return all(len(found) >= 5 for found in values.values())

        until(read)
        source.start(0.01)
        source.command(1.0)
        source.send_now()
        until(lambda: read() and device.volts[1000] == 2.5)  # 0.4 A/V
        assert set(values["load_cell"]) == {1.25}
        assert set(values["lvdt"]) == {-3.5}
        assert device.connections == 1
        assert {count for address, count in device.reads if address == 0} == {4}
        assert not any(address == 2 for address, _ in device.reads)
    finally:
        for driver in (source, force, travel):
            driver.close()
    assert not line.port.is_open


def test_a_lost_connection_is_lost_for_all_and_names_all_of_them(device: Device) -> None:
    line = line_at(device.url)
    force, travel = sensor(line, "load_cell", Channel.FORCE), sensor(line, "lvdt", Channel.DISPLACEMENT, address=2)
    for driver in (force, travel):
        driver.open()
    until(lambda: bool(force.read_batch(0.05).records))
    device.close()
    for driver in (force, travel):
        with pytest.raises(PortClosed, match="shared by load_cell and lvdt"):
            until(lambda one=driver: one.read_batch(0.05) is None)  # type: ignore[misc]  # never None: it raises
    with pytest.raises(PortClosed, match=r"shared by load_cell and lvdt.*refused"):
        force.open()
    with pytest.raises(PortClosed, match="shared by load_cell and lvdt"):
        travel.read_batch(0.0)  # the attempt to open it again does not hide the cause
    with pytest.raises(SharedConnectionClosed, match="uses the same connection as load_cell"):
        travel.open()


def test_an_exception_is_named_with_code_register_and_way_out(device: Device) -> None:
    device.missing = True
    line = line_at(device.url)
    force = sensor(line, "load_cell", Channel.FORCE, address=40_003, first_address=40_001)
    force.open()
    until(lambda: not force.read_batch(0.02).records and force.refusal[0] == "modbus-reject")
    words = force.refusal[1]
    assert "holding registers 40003 to 40004" in words
    assert "exception 2 (illegal address)" in words
    assert "Fix:" in words
    assert "one request with" not in words
    device.missing = False
    until(lambda: bool(force.read_batch(0.05).records))
    assert force.refusal == ("", "")
    force.close()


def test_an_output_that_asks_without_a_pause_leaves_room_for_the_sensors(device: Device) -> None:
    device.takes_s = 0.004
    line = line_at(device.url)
    force = sensor(line, "load_cell", Channel.FORCE, rate_Hz=100.0)
    wires = [SharedWire(line, 1, f"output{number}") for number in range(3)]
    ended = threading.Event()

    def ask(wire: SharedWire) -> None:
        while not ended.is_set():
            wire.ask(modbus.read_request(2000, 1), 0.5)

    force.open()
    for wire in wires:
        wire.open(0.1)
    askers = [threading.Thread(target=ask, args=(wire,), daemon=True) for wire in wires]
    for asker in askers:
        asker.start()
    found = 0

    def read() -> bool:
        nonlocal found
        found += len(force.read_batch(0.05).records)
        return found >= 20

    try:
        until(read)
    finally:
        ended.set()
        for asker in askers:
            asker.join(2.0)
        for one in (force, *wires):
            one.close()
    reads = [address for address, _ in device.reads]
    assert reads.count(0) > 0.2 * len(reads)  # one read in 10 ms, the others fill the rest


def test_a_sensor_that_waits_for_the_output_s_answer_says_so(device: Device) -> None:
    line = line_at(device.url)
    force, wire = sensor(line, "load_cell", Channel.FORCE), SharedWire(line, 1, "ecu")
    force.open()
    wire.open(0.1)
    until(lambda: bool(force.read_batch(0.05).records))
    device.takes_s = 0.5
    asker = threading.Thread(target=lambda: wire.ask(modbus.read_request(2000, 1), 1.0), daemon=True)
    asker.start()
    until(lambda: "the request of ecu" in force.refusal[1])
    assert not force.refusal[0]
    asker.join(3.0)
    device.takes_s = 0.0
    until(lambda: bool(force.read_batch(0.05).records) and force.refusal == ("", ""))
    for one in (force, wire):
        one.close()


def test_an_exception_to_a_request_for_two_sensors_names_both(device: Device) -> None:
    device.missing = True
    line = line_at(device.url)
    force, travel = sensor(line, "load_cell", Channel.FORCE), sensor(line, "lvdt", Channel.DISPLACEMENT, address=2)
    for one in (force, travel):
        one.open()
    until(lambda: not force.read_batch(0.02).records and force.refusal[0] == "modbus-reject")
    assert "one request with lvdt" in force.refusal[1]
    assert "one request with load_cell" in travel.refusal[1]
    for one in (force, travel):
        one.close()


def test_registers_that_do_not_lie_together_are_separate_requests() -> None:
    line = line_at("modbus-tcp://127.0.0.1:1")
    near = [sensor(line, f"a{at}", Channel.AUXILIARY_1, address=at) for at in (0, 2, 16)]
    far = sensor(line, "far", Channel.AUXILIARY_1, address=40)
    slow = sensor(line, "slow", Channel.AUXILIARY_1, rate_Hz=10.0, address=4)
    strict = sensor(line, "strict", Channel.AUXILIARY_1, address=20, largest_gap=0)
    spans = {(block.address, block.count): {one.name for one in block.sensors} for block in
             blocks_of([*near, far, slow, strict])}
    assert spans == {(0, 18): {"a0", "a2", "a16"}, (40, 2): {"far"}, (4, 2): {"slow"}, (20, 2): {"strict"}}
