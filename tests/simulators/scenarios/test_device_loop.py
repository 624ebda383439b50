"""The devices' event loop: asyncio in virtual time, connections with the world's processes."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from simulators.scenarios.device_loop import CAPACITY, ScenarioLoop, WirePort
from simulators.scenarios.machine import Machine

Make = Callable[[int], tuple[Machine, Path]]
SEEDS = range(8)


class Device(asyncio.Protocol):
    """Sends back what comes, and keeps what happened."""

    def __init__(self) -> None:
        self.log: list[object] = []
        self.transport: Any = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep it."""
        self.transport = transport
        self.log.append("made")

    def data_received(self, data: bytes) -> None:
        """Send it back."""
        self.transport.write(data)

    def connection_lost(self, exc: Exception | None) -> None:
        """Note it."""
        del exc
        self.log.append("lost")


def course(
    machine: Machine, host: Callable[[int], object], device: Device, do: Callable[[], object] | None = None
) -> object:
    """What a host's program gives that talks to a device at a port."""
    ports: list[int] = []
    results: list[object] = []

    def devices() -> None:
        loop = ScenarioLoop(machine.kernel, machine.network)

        async def serve() -> None:
            server = await loop.create_server(lambda: device)
            ports.append(server.sockets[0].getsockname()[1])
            await asyncio.sleep(1.0)
            if do is not None:
                do()
            await asyncio.sleep(10_000.0)

        loop.run_until_complete(serve())

    machine.start("devices", devices)
    machine.kernel.run(lambda: bool(ports))
    process = machine.start("host", lambda: results.append(host(ports[0])))
    machine.kernel.run(lambda: not process.alive)
    assert process.errors == []
    return results[0]


def connected(machine: Machine, port: int) -> Any:  # noqa: ANN401
    """A host's socket."""
    return machine.connect(("127.0.0.1", port), 5.0)


def read_all(connection: Any, size: int) -> bytes:  # noqa: ANN401
    """So many bytes, or up to the end."""
    got = b""
    while len(got) < size and (data := connection.recv(1 << 16)):
        got += data
    return got


def test_what_is_sent_comes_back_whole(make: Make) -> None:
    data = bytes(range(256)) * 40

    def host(machine: Machine, port: int) -> bytes:
        connection = connected(machine, port)
        connection.sendall(data)
        return read_all(connection, len(data))

    for seed in SEEDS:
        machine, _ = make(seed)
        assert course(machine, lambda port, machine=machine: host(machine, port), Device()) == data  # type: ignore[misc]


def test_a_host_that_reads_late_gets_everything(make: Make) -> None:
    machine, _ = make(1)
    device, size = Device(), 1_000_000

    def host(port: int) -> int:
        connection = connected(machine, port)
        machine.kernel.sleep_ns(3 * 10**9)
        assert device.transport.get_write_buffer_size() > 0
        return len(read_all(connection, size))

    assert course(machine, host, device, lambda: device.transport.write(bytes(size))) == size
    assert device.transport.get_write_buffer_size() == 0


def test_a_closed_connection_brings_what_was_written_before(make: Make) -> None:
    machine, _ = make(1)
    device, size = Device(), 1_000_000

    def close() -> None:
        device.transport.write(bytes(size))
        device.transport.close()
        device.transport.write(b"never sent")

    def host(port: int) -> int:
        connection = connected(machine, port)
        machine.kernel.sleep_ns(3 * 10**9)
        return len(read_all(connection, 2 * size))

    assert course(machine, host, device, close) == size
    assert device.log == ["made", "lost"]


def test_an_aborted_connection_fails(make: Make) -> None:
    machine, _ = make(1)
    device = Device()

    def host(port: int) -> object:
        connection = connected(machine, port)
        with pytest.raises(ConnectionResetError):
            connection.recv(10)
        return connection.recv(10)

    assert course(machine, host, device, lambda: device.transport.abort()) == b""
    machine.kernel.run(lambda: len(device.log) == 2)
    assert device.log == ["made", "lost"]


def test_a_device_hears_that_the_host_hung_up(make: Make) -> None:
    machine, _ = make(1)
    device = Device()

    def host(port: int) -> None:
        connection = connected(machine, port)
        machine.kernel.sleep_ns(10**8)
        connection.close()

    course(machine, host, device)
    machine.kernel.run(lambda: len(device.log) == 2)
    assert device.log == ["made", "lost"]


def test_timers_of_a_loop_are_virtual_and_in_order(make: Make) -> None:
    machine, _ = make(1)
    log: list[tuple[int, float]] = []

    def devices() -> None:
        loop = ScenarioLoop(machine.kernel, machine.network)

        async def wait(number: int) -> None:
            await asyncio.sleep(number * 100.0)
            log.append((number, machine.kernel.time_s))

        async def serve() -> None:
            await asyncio.gather(*(wait(number) for number in (3, 1, 2)))

        loop.run_until_complete(serve())

    process = machine.start("devices", devices)
    machine.kernel.run(lambda: not process.alive)
    assert [(number, round(at_s, 1)) for number, at_s in log] == [(1, 100.0), (2, 200.0), (3, 300.0)]


def test_a_loop_that_waits_leaves_the_thread_s_own_asyncio_alone(make: Make) -> None:
    machine, _ = make(1)
    hooks = sys.get_asyncgen_hooks()
    course(machine, lambda port: port, Device())
    assert sys.get_asyncgen_hooks() == hooks

    async def other() -> int:
        await asyncio.sleep(0)
        return 7

    assert asyncio.run(other()) == 7


def test_a_sensor_s_line_drops_and_counts_whole_frames_nobody_reads(make: Make) -> None:
    machine, _ = make(1)
    port = WirePort(machine.kernel, machine.network)
    frame = bytes(10)
    port.write(frame, 10)
    assert (port.unheard_frames, port.dropped_frames) == (1, 0)

    def host() -> int:
        connection = connected(machine, port._number)
        for _ in range(1000):
            port.write(frame, 10)
        assert port.unread() == CAPACITY // 10 * 10
        got = len(read_all(connection, CAPACITY // 10 * 10))
        port.close()
        with pytest.raises(ConnectionResetError):
            read_all(connection, 1)
        return got

    results: list[int] = []
    process = machine.start("host", lambda: results.append(host()))
    machine.kernel.run(lambda: not process.alive)
    assert process.errors == []
    assert results == [CAPACITY // 10 * 10]
    assert port.dropped_frames == 1000 - CAPACITY // 10
