from __future__ import annotations

import asyncio
import errno
import math
import os
import select
import socket
import termios
import tty
from collections.abc import Iterator

import pytest
import serial

from simulators.pace import Backpressure, Pace
from simulators.serial_port import CAPACITY, PtyPort, SocketPort, open_port

FRAME = 16


def frames(first: int, count: int) -> bytes:
    return b"".join(i.to_bytes(FRAME, "big") for i in range(first, first + count))


def read_all(descriptor: int, count: int) -> bytes:
    data = b""
    while len(data) < count and select.select([descriptor], [], [], 2.0)[0]:
        data += os.read(descriptor, 65536)
    return data


@pytest.fixture
def pty() -> Iterator[PtyPort]:
    port = PtyPort()
    yield port
    port.close()


@pytest.mark.parametrize(("chosen", "right"), [(9600, True), (115200, False), (38400, False)])
def test_a_host_at_another_baud_rate_than_the_device_gets_other_bytes(chosen: int, right: bool) -> None:
    port = PtyPort(9600)
    try:
        with serial.Serial(port.url, 19200, timeout=2.0) as host:
            port.write(b"", FRAME)
            host.baudrate = chosen
            port.write(b"+0012.3\r\n", 9)
            assert (host.read(9) == b"+0012.3\r\n") is right
    finally:
        port.close()


def test_a_pty_holds_4_KiB_then_drops_whole_frames_and_counts_them(pty: PtyPort) -> None:
    for first in range(0, 1000, 10):
        pty.write(frames(first, 10), FRAME)
        # The line discipline takes bytes over on its own thread; its count is what bounds the port.
        while pty.unread() < min(pty.sent_bytes, 4095 // FRAME * FRAME):
            os.sched_yield()
    assert pty.sent_bytes == 4095 // FRAME * FRAME
    assert (pty.dropped_frames, pty.unheard_frames) == (0, 1000 - pty.sent_bytes // FRAME)
    host = os.open(pty.url, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    data = read_all(host, pty.sent_bytes)
    assert data == frames(0, len(data) // FRAME)
    pty.write(frames(5000, 1), FRAME)
    assert read_all(host, FRAME) == frames(5000, 1)
    while not pty.read_once:
        pty.unread()
    for first in range(0, 1000, 10):
        pty.write(frames(first, 10), FRAME)
        while pty.unread() < min((first + 10) * FRAME, 4095 // FRAME * FRAME):
            os.sched_yield()
    assert pty.dropped_frames == 1000 - 4095 // FRAME
    os.close(host)


def test_the_host_may_come_and_go_on_a_pty(pty: PtyPort) -> None:
    for number in range(3):
        host = os.open(pty.url, os.O_RDWR | os.O_NOCTTY)
        pty.write(frames(number, 1), FRAME)
        assert read_all(host, FRAME) == frames(number, 1)
        os.close(host)
    assert pty.dropped_frames == 0


def test_bytes_from_the_host_are_swallowed_without_an_echo(pty: PtyPort) -> None:
    host = os.open(pty.url, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(host, termios.TCSANOW)
    os.write(host, b"\x03\x04tare\r\n")
    pty.write(frames(1, 1), FRAME)
    assert read_all(host, FRAME) == frames(1, 1)
    os.close(host)


def test_a_pulled_cable_ends_the_hosts_read(pty: PtyPort) -> None:
    host = os.open(pty.url, os.O_RDONLY | os.O_NOCTTY)
    pty.close()
    pty.write(frames(0, 1), FRAME)
    try:
        rest = os.read(host, 16)
    except OSError as error:
        rest = errno.errorcode[error.errno].encode()
    assert rest in {b"", b"EIO"}
    os.close(host)


def test_a_socket_port_is_bounded_too_and_never_blocks() -> None:
    async def story() -> None:
        port = SocketPort()
        host = socket.create_connection(("127.0.0.1", int(port.url.rsplit(":", 1)[1])))
        async with asyncio.timeout(2.0):
            while not port.read_once:  # noqa: ASYNC110 (the port has no event; it is polled as the rig does)
                await asyncio.sleep(0.001)
        port.write(frames(0, 2), FRAME)
        host.settimeout(2.0)
        assert host.recv(64) == frames(0, 2)
        total = 0
        while port.dropped_frames == 0:
            port.write(frames(0, 64), FRAME)
            total += 64
        assert port.unread() == port.sent_bytes - 2 * FRAME
        assert total < 2_000_000 / FRAME
        host.close()
        port.close()

    asyncio.run(story())


def test_a_socket_port_drops_while_nobody_is_connected() -> None:
    async def story() -> None:
        port = open_port("socket")
        port.write(frames(0, 300), FRAME)
        assert port.sent_bytes == CAPACITY
        assert (port.dropped_frames, port.unheard_frames) == (0, 300 - CAPACITY // FRAME)
        port.close()

    asyncio.run(story())


def test_simulated_time_never_outruns_its_speed() -> None:
    pace = Pace(10.0, 1e-4, 0.002, 8192)
    assert pace.due(0, 0) == 0
    step = 0
    for now_ns in range(1_000_000, 200_000_000, 1_000_000):
        step += pace.due(now_ns, step)
        assert step <= now_ns * 1e-9 * 10.0 / 1e-4 + 1e-6
    assert step == pytest.approx(0.199 * 10 / 1e-4, rel=0.01)


def test_a_short_stall_is_caught_up_at_speed_1_and_a_long_one_is_not() -> None:
    for stall_s, kept in ((0.1, True), (3.0, False)):
        pace = Pace(1.0, 1e-4, 0.002, 8192)
        step = pace.due(0, 0)
        now_ns = int(stall_s * 1e9)
        for _ in range(3000):
            now_ns += 2_000_000
            step += pace.due(now_ns, step)
        behind_s = now_ns * 1e-9 - step * 1e-4
        assert (behind_s < 0.01) is kept


def test_one_slice_is_bounded() -> None:
    pace = Pace(50.0, 1 / 8000, 0.002, 8192)
    pace.due(0, 0)
    assert pace.due(10_000_000_000, 0) <= 4 * 50 * 0.002 * 8000


def test_a_port_that_is_waited_for_keeps_everything_in_order(pty: PtyPort) -> None:
    pty.waits = True
    for first in range(0, 1000, 10):
        pty.write(frames(first, 10), FRAME)
    assert (pty.dropped_frames, pty.sent_bytes) == (0, 1000 * FRAME)
    host = os.open(pty.url, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    data = b""
    while len(data) < 1000 * FRAME:
        pty.unread()
        data += read_all(host, 1)
    assert data == frames(0, 1000)
    os.close(host)


def test_a_port_given_up_keeps_whole_frames_and_drops_from_then_on(pty: PtyPort) -> None:
    pty.waits = True
    pty.write(frames(0, 400), FRAME)
    pty.waits = False
    while pty.unread() < 4095:
        # The line discipline takes bytes over on its own thread.
        os.sched_yield()
    pty.write(frames(400, 10), FRAME)
    assert pty.dropped_frames + pty.unheard_frames == 10
    host = os.open(pty.url, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    data = b""
    while len(data) < 400 * FRAME:
        pty.unread()
        data += read_all(host, 1)
    assert data == frames(0, 400)
    os.close(host)


def test_what_lies_in_the_hosts_own_socket_is_seen() -> None:
    async def story() -> None:
        port = SocketPort()
        host = socket.create_connection(("127.0.0.1", int(port.url.rsplit(":", 1)[1])))
        async with asyncio.timeout(2.0):
            while not port.read_once:  # noqa: ASYNC110 (the port has no event; it is polled as the rig does)
                await asyncio.sleep(0.001)
        port.waits = True
        port.write(frames(0, 2000), FRAME)
        assert port.unread() == 2000 * FRAME
        left = 2000 * FRAME
        while left:
            left -= len(host.recv(min(left, 5000)))
            assert port.unread() == left
        assert port.dropped_frames == 0
        host.close()
        port.close()

    asyncio.run(story())


class SlowReader:
    """A reader that is behind, as far as back-pressure can see."""

    def __init__(self, left: int, read_once: bool = True) -> None:
        self.left, self.read_once = left, read_once

    def unread(self) -> int:
        return self.left


def test_the_clock_waits_for_a_reader_for_a_while_then_not_until_it_has_caught_up() -> None:
    reader, pressure = SlowReader(3000), Backpressure()
    assert pressure.waits_for(reader, 1000, 0.0)
    reader.left = 2000
    assert pressure.waits_for(reader, 1000, 0.5)
    assert not pressure.given_up(reader)
    assert not pressure.waits_for(reader, 1000, 0.53)
    assert pressure.given_up(reader)
    assert not pressure.waits_for(reader, 1000, 5.0)
    reader.left = 1000
    assert not pressure.waits_for(reader, 1000, 6.0)
    assert not pressure.given_up(reader)
    reader.left = 1001
    assert pressure.waits_for(reader, 1000, 7.0)


def test_a_port_nobody_reads_holds_nothing_up() -> None:
    assert not Backpressure().waits_for(SlowReader(4000, read_once=False), 0, 0.0)


def test_a_host_that_stops_polling_is_waited_for_as_long() -> None:
    pressure = Backpressure()
    assert not pressure.waits_for_poll(math.nan, 0.010, 0.0)
    assert pressure.waits_for_poll(0.011, 0.010, 1.0)
    assert pressure.waits_for_poll(0.5, 0.010, 1.5)
    assert not pressure.waits_for_poll(0.6, 0.010, 1.6)
    assert not pressure.waits_for_poll(0.001, 0.010, 1.7)
    assert pressure.waits_for_poll(0.011, 0.010, 1.8)
