"""Sensors that are asked: which answer belongs to which request, and what follows when none comes."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator

import pytest

from drivers.ring import Channel, Record
from drivers.sample_stream import SampleScale
from drivers.serial_sensor import Poll, SerialSensor
from protocols.exchange import Exchange
from protocols.line_format import LineDecoder, LineFormat
from protocols.quality import Quality

REQUEST = b"?\r"
FORMAT = LineFormat(
    "polled", r"(?P<value>[+-]\d{3})", terminator=b"\r", exchange=Exchange(request=REQUEST, answer_timeout_s=0.05)
)
MS = 1_000_000


def poll(rate_Hz: float = 100.0, device_rate: float = 1.0) -> Poll:
    decoder = LineDecoder(FORMAT, answers=True)
    return Poll(decoder, FORMAT.exchange, SampleScale(rate_Hz=rate_Hz, device_rate=device_rate))


def test_a_request_goes_out_once_a_period_and_its_time_is_the_reading_s() -> None:
    sensor = poll()
    assert sensor.due(1000 * MS) == REQUEST
    assert sensor.due(1005 * MS) == b""
    assert sensor.feed(b"+012\r") == [(1, 1_000_000, 12.0, 0, 0)]
    assert sensor.due(1009 * MS) == b""
    assert sensor.due(1010 * MS) == REQUEST
    assert sensor.feed(b"-003\r")[0][:3] == (2, 1_010_000, -3.0)


def test_periods_in_which_nobody_requested_are_missing_numbers() -> None:
    sensor = poll()
    sensor.due(1000 * MS)
    sensor.feed(b"+001\r")
    assert sensor.due(1035 * MS) == REQUEST
    assert sensor.feed(b"+002\r")[0][0] == 4


def test_an_answer_that_is_late_is_never_taken_for_the_next_one() -> None:
    sensor = poll()
    sensor.due(1000 * MS)
    assert not sensor.given_up(1050 * MS)
    assert sensor.given_up(1051 * MS)
    assert sensor.due(1060 * MS) == b""
    assert sensor.feed(b"+111\r") == []
    assert sensor.bad_frames == 1
    assert sensor.due(1101 * MS) == REQUEST
    number, _, value, _, _ = sensor.feed(b"+222\r")[0]
    assert (number, value) == (2, 222.0)


def test_a_damaged_answer_costs_its_own_request() -> None:
    sensor = poll()
    sensor.due(1000 * MS)
    assert sensor.feed(b"+1x1\r") == []
    assert sensor.due(1010 * MS) == REQUEST
    assert sensor.feed(b"+222\r")[0][0] == 2


def test_a_device_on_another_clock_is_requested_ahead_and_its_readings_counted() -> None:
    sensor = poll(device_rate=20.0)
    waiting = sensor.due(1000 * MS)
    assert waiting == REQUEST * 500
    assert [r[:2] for r in sensor.feed(b"+001\r+002\r")] == [(1, -1), (2, -1)]
    assert sensor.due(1001 * MS) == REQUEST * 2


@pytest.fixture
def device() -> Iterator[tuple[str, list[bytes]]]:
    """A device that answers each request but the third, written apart from the project's own simulators."""
    heard: list[bytes] = []
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        connection, _ = server.accept()
        with connection:
            number = 0
            while data := connection.recv(64):
                heard.append(data)
                for _ in range(data.count(b"\r")):
                    number += 1
                    if number != 3:
                        connection.sendall(f"{number:+04d}\r".encode())

    thread = threading.Thread(target=serve)
    thread.start()
    yield f"socket://127.0.0.1:{server.getsockname()[1]}", heard
    thread.join()
    server.close()


def test_a_polled_sensor_over_a_socket_loses_the_request_that_is_not_answered(device: tuple[str, list[bytes]]) -> None:
    url, heard = device
    sensor = SerialSensor(
        url, name="load_cell", channel=Channel.FORCE, line_format=FORMAT, scale=SampleScale(2.0, 0.0, rate_Hz=100.0)
    )
    sensor.open()
    records: list[Record] = []
    while len(records) < 5:
        records += sensor.read_batch(0.05).records
    sensor.close()
    assert [record[2] for record in records] == [2.0, 4.0, 8.0, 10.0, 12.0]
    assert records[2][5] & Quality.GAP_BEFORE
    assert sensor.counters.lost >= 1
    assert b"".join(heard).replace(REQUEST, b"") == b""
    assert records[-1][1] - records[0][1] >= 3 * 9_000  # µs: a busy host may stamp one late
