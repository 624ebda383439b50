"""Load cell, LVDT and auxiliaries over real ptys and sockets."""

import os
import pty
import socket
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import closing

import pytest

from drivers.errors import LinkLost, PortClosed
from drivers.ring import Channel, Record
from drivers.sample_stream import SampleScale
from drivers.serial_port import SerialPort
from drivers.serial_sensor import SerialSensor
from protocols.errors import LocalProtocolError
from protocols.exchange import Exchange
from protocols.frame_format import encode
from protocols.line_format import LineFormat

Wire = tuple[str, Callable[[bytes], object], Callable[[], object], Callable[[int], bytes]]


def load_cell(url: str, **given: object) -> SerialSensor:
    return SerialSensor(url, name="load_cell", channel=Channel.FORCE, **given)  # type: ignore[arg-type]  # by name


def lvdt_sensor(url: str, **given: object) -> SerialSensor:
    return SerialSensor(url, name="lvdt", channel=Channel.DISPLACEMENT, scale=SampleScale(1e-3), **given)  # type: ignore[arg-type]  # by name


@pytest.fixture(params=["pty", "socket"])
def wire(request: pytest.FixtureRequest) -> Iterator[Wire]:
    """URL of a port; write to it from the device's side; pull the cable; read on the device's side."""
    if request.param == "pty":
        master, slave = pty.openpty()
        tty.setraw(slave)
        open_ends = {master}

        def pull() -> None:
            os.close(master)
            open_ends.clear()

        yield os.ttyname(slave), lambda data: os.write(master, data), pull, lambda count: os.read(master, count)
        os.close(slave)
        for end in open_ends:
            os.close(end)
        return
    with socket.create_server(("127.0.0.1", 0)) as server:
        connections: list[socket.socket] = []

        def connection() -> socket.socket:
            if not connections:
                connections.append(server.accept()[0])
            return connections[0]

        yield (
            f"socket://127.0.0.1:{server.getsockname()[1]}",
            lambda data: connection().sendall(data),
            lambda: connection().close(),
            lambda count: connection().recv(count),
        )
        for end in connections:
            end.close()


def collect(sensor: SerialSensor, count: int, timeout_s: float = 5.0) -> list[Record]:
    """Records of a sensor until there are `count`."""
    records: list[Record] = []
    deadline = time.monotonic() + timeout_s
    while len(records) < count and time.monotonic() < deadline:
        records += sensor.read_batch(0.05).records
    return records


def test_a_load_cell_gives_newtons_with_arrival_time_and_age(wire: Wire) -> None:
    url, send, _, _ = wire
    with closing(load_cell(url, scale=SampleScale(2.0, 1.0, 250.0))) as cell:
        cell.open()
        before = time.monotonic_ns()
        send(encode(10.5, 7, 1000) + encode(11.5, 8, 5000))
        records = collect(cell, 2)
        after = time.monotonic_ns()
        assert [r[1:] for r in records] == [(1000, 20.0, 7, Channel.FORCE, 0), (5000, 22.0, 8, Channel.FORCE, 0)]
        assert before <= records[0][0] <= after
        assert (cell.counters.samples, cell.bad_frames, cell.skipped_bytes) == (2, 0, 0)


def test_an_lvdt_gives_metres(wire: Wire) -> None:
    url, send, _, _ = wire
    with closing(lvdt_sensor(url)) as lvdt:
        lvdt.open()
        send(encode(-12.5, 0, 0))
        assert [r[2:5] for r in collect(lvdt, 1)] == [(-0.0125, 0, Channel.DISPLACEMENT)]


def test_ascii_lines_of_an_lvdt_carry_millimetres(wire: Wire) -> None:
    url, send, _, _ = wire
    with closing(lvdt_sensor(url, line_format="signed-decimal")) as lvdt:
        lvdt.open()
        send(b"345 mm\r\n+00012.345 mm\r\n+00012.345 N\r\n")
        assert [r[2] for r in collect(lvdt, 1)] == [pytest.approx(0.012345)]
        assert lvdt.bad_frames == 1


def test_an_auxiliary_has_its_own_name_and_channel(wire: Wire) -> None:
    url, send, pull, _ = wire
    with closing(SerialSensor(url, name="accelerometer", channel=Channel.AUXILIARY_1)) as sensor:
        sensor.open()
        send(encode(1.0, 0, 0))
        assert collect(sensor, 1)[0][4] == Channel.AUXILIARY_1
        pull()
        with pytest.raises(PortClosed, match=f"accelerometer at {url}"):
            collect(sensor, 1)


def test_a_pulled_cable_is_reported_at_once_and_not_by_silence(wire: Wire) -> None:
    url, send, pull, _ = wire
    with closing(load_cell(url)) as cell:
        cell.open()
        send(encode(1.0, 0, 0))
        collect(cell, 1)
        pull()
        with pytest.raises(PortClosed, match="the connection to the port was lost"):
            collect(cell, 1)


def test_a_silent_sensor_gives_an_empty_batch(wire: Wire) -> None:
    with closing(load_cell(wire[0])) as cell:
        cell.open()
        batch = cell.read_batch(0.01)
        assert (batch.records, batch.lost) == ([], 0)


def test_what_waited_in_the_port_before_open_is_thrown_away() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    with closing(load_cell(os.ttyname(slave))) as cell:
        os.write(master, encode(99.0, 1, 1)[3:] + encode(99.0, 2, 2))
        cell.open()
        os.write(master, encode(1.0, 3, 3))
        assert [r[2] for r in collect(cell, 1)] == [1.0]
        assert cell.skipped_bytes == 0
    os.close(master)
    os.close(slave)


def test_a_format_that_must_be_started_is_started_and_stopped(wire: Wire) -> None:
    url, send, _, receive = wire
    sensor = load_cell(url, line_format="hbm-aed")
    sensor.open()
    assert receive(7) == b"MSV?0;"
    send(b"\r\n+0000042\r\n")
    assert collect(sensor, 1)[0][2] == 42.0
    sensor.close()
    assert receive(5) == b"STP;"


def test_closing_after_the_cable_was_pulled_is_harmless(wire: Wire) -> None:
    url, _, pull, receive = wire
    sensor = load_cell(url, line_format=LineFormat("mine", r"(?P<value>\d+)", exchange=Exchange(stop_command=b"STOP")))
    sensor.open()
    if url.startswith("socket"):
        assert sensor.read_batch(0.0).records == []
    pull()
    sensor.close()
    sensor.close()
    assert not sensor.is_open
    del receive


def test_an_unknown_format_is_refused_before_anything_is_opened() -> None:
    with pytest.raises(LocalProtocolError, match="unknown line format 'morse'"):
        load_cell("/dev/null", line_format="morse")


@pytest.mark.parametrize("url", ["/dev/no-such-port", "socket://127.0.0.1", "socket://127.0.0.1:1", "nonsense://x"])
def test_a_port_that_cannot_be_opened_is_named(url: str) -> None:
    with pytest.raises(PortClosed, match=f"load_cell at {url}: cannot be opened"):
        load_cell(url).open()


def test_a_tty_is_taken_for_us_alone() -> None:
    master, slave = pty.openpty()
    url = os.ttyname(slave)
    with closing(SerialPort(url, device="first")) as first, closing(SerialPort(url, device="second")) as second:
        first.open()
        first.open()
        with pytest.raises(PortClosed, match="second at"):
            second.open()
    os.close(master)
    os.close(slave)


def test_a_port_without_descriptor_is_read_and_written_in_blocks() -> None:
    with closing(SerialPort("loop://", device="loop")) as port:
        port.open()
        assert port.read_available(0.01)[0] == b""
        port.write(b"hello world")
        assert port.read_available(1.0)[0] == b"hello world"


def test_a_port_that_is_not_open_says_so() -> None:
    port = SerialPort("loop://", device="loop")
    with pytest.raises(PortClosed, match="not open"):
        port.read_available(0.0)
    with pytest.raises(PortClosed, match="not open"):
        port.write(b"x")


def test_a_device_that_takes_nothing_is_a_lost_link() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    with closing(SerialPort(os.ttyname(slave), device="deaf")) as port:
        port.open()
        with pytest.raises(LinkLost, match=r"deaf at .*: sent .* of 1000000 bytes"):
            port.write(bytes(1_000_000), timeout_s=0.05)
    os.close(master)
    os.close(slave)


def test_input_that_never_ends_does_not_hold_up_the_discarding() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = SerialPort(f"socket://127.0.0.1:{server.getsockname()[1]}", device="flood")
        port.open()
        connection, _ = server.accept()
        with connection, closing(port):
            connection.sendall(bytes(200_000))
            thrown = 0
            while thrown < 200_000:
                thrown += port.discard_input()
            assert thrown == 200_000
