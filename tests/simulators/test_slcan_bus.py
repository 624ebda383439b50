from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from simulators.slcan_bus import SlcanBus, frame_line, well_formed

Heard = list[tuple[int, bytes]]


def on_a_bus(story: Callable[[SlcanBus, Heard], Awaitable[None]]) -> None:
    async def run() -> None:
        heard: Heard = []
        bus = SlcanBus(lambda identifier, data: heard.append((identifier, data)))
        await bus.open()
        try:
            await asyncio.wait_for(story(bus, heard), 5.0)
        finally:
            bus.close()

    asyncio.run(run())


async def client(bus: SlcanBus, *setup: bytes) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    reader, writer = await asyncio.open_connection("127.0.0.1", bus.port)
    for line in setup:
        writer.write(line + b"\r")
        assert await reader.readuntil(b"\r") == b"\r"
    return reader, writer


def test_every_client_sees_the_ecus_and_each_others_frames_but_not_its_own() -> None:
    async def story(bus: SlcanBus, heard: Heard) -> None:
        one, write_one = await client(bus, b"S6", b"O")
        two, write_two = await client(bus, b"S6", b"L")
        bus.send([(0x121, bytes.fromhex("0102030405060708"))])
        for reader in (one, two):
            assert await reader.readuntil(b"\r") == b"t12180102030405060708\r"
        write_one.write(b"t120211FF\r")
        assert await one.readuntil(b"\r") == b"z\r"
        assert await two.readuntil(b"\r") == b"t120211FF\r"
        assert heard == [(0x120, b"\x11\xff")]
        write_one.close()
        write_two.close()

    on_a_bus(story)


def test_a_closed_channel_hears_nothing_and_a_listener_may_not_send() -> None:
    async def story(bus: SlcanBus, heard: Heard) -> None:
        reader, writer = await client(bus, b"L")
        writer.write(b"t1200\r")
        assert await reader.readexactly(1) == b"\a"
        writer.write(b"C\r")
        assert await reader.readuntil(b"\r") == b"\r"
        bus.send([(0x121, b"")])
        writer.write(b"V\r")
        assert await reader.readuntil(b"\r") == b"V1013\r"
        assert heard == []
        writer.close()

    on_a_bus(story)


def test_a_line_may_arrive_in_any_pieces() -> None:
    async def story(bus: SlcanBus, heard: Heard) -> None:
        reader, writer = await client(bus, b"O")
        for byte in b"t1203AABBCC\r":
            writer.write(bytes([byte]))
            await writer.drain()
        assert await reader.readuntil(b"\r") == b"z\r"
        assert heard == [(0x120, b"\xaa\xbb\xcc")]
        writer.close()

    on_a_bus(story)


def test_a_silent_bus_passes_nothing_while_sending_seems_to_succeed() -> None:
    async def story(bus: SlcanBus, heard: Heard) -> None:
        reader, writer = await client(bus, b"O")
        bus.silent = True
        bus.send([(0x121, bytes(8))])
        writer.write(b"t1200\r")
        assert await reader.readuntil(b"\r") == b"z\r"
        assert heard == []
        writer.close()

    on_a_bus(story)


def test_a_client_that_does_not_read_loses_frames_and_does_not_block() -> None:
    async def story(bus: SlcanBus, heard: Heard) -> None:
        _, deaf = await client(bus, b"O")
        deaf.transport.pause_reading()  # type: ignore[attr-defined]  # a stream's transport is a read transport
        frames = [(0x121, bytes(8))] * 2000
        while bus.dropped_frames == 0:
            bus.send(frames)
            await asyncio.sleep(0)
        (listener,) = bus.clients
        assert listener.unread() > 64 * 1024
        assert heard == []
        deaf.transport.abort()

    on_a_bus(story)


@pytest.mark.parametrize(
    ("line", "fits"),
    [
        (b"t1202AABB", True), (b"t1202AA", False), (b"t1209" + b"00" * 9, False), (b"tXYZ0", False), (b"t120", False),
        (b"t8000", False), (b"T1FFFFFFF0", True), (b"T200000000", False), (b"r1204", True), (b"r1204AABBCCDD", False),
        (b"t1202A B", False), (b"", False),
    ],
)
def test_malformed_lines_are_distinguished_from_frames(line: bytes, fits: bool) -> None:
    assert well_formed(line) is fits


def test_a_frame_line_by_hand() -> None:
    assert frame_line(0x121, b"\x0a\xff") == b"t12120AFF\r"
