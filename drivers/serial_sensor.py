"""A sensor on a serial line or socket (load cell, LVDT, auxiliary channels) that sends by itself or is asked."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import cast

from drivers import clock
from drivers.can_bus import CanSensorPort
from drivers.connection import LineSettings
from drivers.errors import DriverError
from drivers.ring import Channel
from drivers.sample_stream import Batch, Decoder, SampleCounters, SampleScale, SampleStream
from drivers.sensor_formats import FRAME16, described_format
from drivers.serial_port import SerialPort
from protocols.binary_decoder import BinaryDecoder
from protocols.binary_format import BinaryFormat
from protocols.exchange import Exchange
from protocols.frame_format import DEVICE_US_MODULUS, SEQUENCE_MODULUS, FrameDecoder, Reading
from protocols.line_format import LineDecoder, LineFormat

BINARY = (FRAME16,)
"""Formats that have a decoder of their own."""
CLOCKED = (FRAME16,)
"""Those that carry the sensor's clock and latched edges too; all others are counted against their rate."""
DEFAULT_FORMAT = FRAME16
UNSCALED = SampleScale()
NO_EXCHANGE = Exchange()
REQUEST_RATE_Hz = 100.0
"""How often a sensor is asked where neither bench nor format say it."""
AHEAD_BYTES = 2048
AHEAD_S = 0.25
"""Requests under way to a sensor whose clock is not the host's: at most so many bytes, or for so much wall time."""
AHEAD_TIMEOUT_S = 1.0
"""Such a sensor's clock may stand still for a while."""


USUAL = LineSettings()


class SerialSensor:
    """Owns the port of one sensor and converts its data to ring records in SI units.

    A polled sensor (its format has a request) is polled at the scale's rate in `read_batch`, with one request at a
    time. The time of the request is the device time of the reading; a missing answer counts as a lost sample. If the
    device has its own clock (a simulated device that runs faster), requests are sent in advance and readings are
    counted.

    Args:
        url: port, anything `SerialPort` takes.
        line: settings of the serial line, or its baud rate alone.
        name: device name for messages, as in the bench file.
        channel: ring channel 1..9.
        line_format: name of a format, path of a format's file, or a format.
        scale: conversion from wire units to SI, and the sensor's rate (default: the rate of the format).
        port: source of the bytes instead of a port at `url`, such as a CAN bus.

    Raises:
        LocalProtocolError: the format is unknown or cannot be used.
    """

    def __init__(
        self,
        url: str,
        line: LineSettings | int = USUAL,
        *,
        name: str,
        channel: Channel,
        line_format: str | LineFormat | BinaryFormat = DEFAULT_FORMAT,
        scale: SampleScale = UNSCALED,
        port: SerialPort | CanSensorPort | None = None,
    ) -> None:
        self.name = name
        self.channel = channel
        line = LineSettings(line) if isinstance(line, int) else line
        self._port = port or SerialPort(
            url, line.baudrate, device=name, bytesize=line.data_bits, parity=line.parity, stopbits=line.stop_bits
        )
        self._exchange, self._poll = NO_EXCHANGE, cast("Poll | None", None)
        self._decoder: Decoder = FrameDecoder()
        has_sequence = True
        if line_format != FRAME16:
            described = described_format(line_format, channel) if isinstance(line_format, str) else line_format
            if scale.rate_Hz is None:
                scale = replace(scale, rate_Hz=described.nominal_rate_Hz)
            self._exchange = described.exchange
            self._decoder = _decoder(described)
            has_sequence = described.has_sequence
            if self._exchange.request:
                self._decoder = self._poll = Poll(self._decoder, self._exchange, scale)
                has_sequence = True
        self._stream = SampleStream(self._decoder, channel, scale, has_sequence=has_sequence)

    @property
    def url(self) -> str:
        """URL of the port."""
        return self._port.url

    @property
    def moved(self) -> bool:
        """The port's name leads to another port than the one that was opened."""
        return self._port.moved

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return self._port.is_open

    @property
    def refusal(self) -> tuple[str, str]:
        """Code and reason why the received data cannot come from this sensor; two empty strings if it may."""
        return self._port.refusal if isinstance(self._port, CanSensorPort) else ("", "")

    @property
    def lost_slug(self) -> str:
        """Fault code of a lost port if it is not the sensor's own port; otherwise empty."""
        return "can-busoff" if isinstance(self._port, CanSensorPort) else ""

    @property
    def counters(self) -> SampleCounters:
        """Totals of samples, losses and faults since construction."""
        return self._stream.counters

    @property
    def bad_frames(self) -> int:
        """Frames or lines that came damaged."""
        return self._decoder.bad_frames

    @property
    def skipped_bytes(self) -> int:
        """Bytes that belonged to no reading."""
        return self._decoder.skipped_bytes

    def open(self) -> None:
        """Open the port, throw away what waited in it, start the device's sending if its format needs that.

        Raises:
            PortClosed: the port cannot be opened.
            LinkLost: the start command could not be sent.
        """
        self._port.open()
        self._decoder.clear()
        if self._exchange.start_command:
            self._port.write(self._exchange.start_command)

    def close(self) -> None:
        """Stop the device's sending if its format needs that, and close the port; closing twice is harmless."""
        if self._port.is_open and self._exchange.stop_command:
            try:
                self._port.write(self._exchange.stop_command)
            except DriverError:
                # The port may be what failed; a device that goes on sending harms nothing.
                self._decoder.clear()
        self._port.close()

    def discard_input(self) -> None:
        """Throw away what has arrived; reading begins with what comes now.

        Raises:
            PortClosed: the port is not open, or the cable was pulled.
        """
        self._port.discard_input()
        self._decoder.clear()

    def read_batch(self, timeout_s: float) -> Batch:
        """Whatever samples have arrived, waiting for the first bytes.

        Args:
            timeout_s: longest wait, s.

        Returns:
            The batch; without records after a time-out or when no reading was complete.

        Raises:
            PortClosed: the port is not open, or the cable was pulled.
        """
        if self._poll is not None:
            return self._ask(self._poll, timeout_s)
        chunk, arrival_ns = self._port.read_available(timeout_s)
        return self._stream.take(chunk, arrival_ns)

    def _ask(self, poll: Poll, timeout_s: float) -> Batch:
        """Ask when it is time, and take what comes, until a sample or the time-out.

        Raises:
            PortClosed: the port is not open, or the cable was pulled.
            LinkLost: a request could not be sent.
        """
        lost_before = self._stream.counters.lost
        end_ns = clock.monotonic_ns() + int(timeout_s * 1e9)
        while True:
            now_ns = clock.monotonic_ns()
            if poll.given_up(now_ns):
                self._port.discard_input()
            if request := poll.due(now_ns):
                self._port.write(request)
            wait_ns = max(0, min(end_ns, poll.next_ns()) - now_ns)
            chunk, arrival_ns = self._port.read_available(wait_ns * 1e-9)
            batch = self._stream.take(chunk, arrival_ns)
            if batch.records or arrival_ns >= end_ns:
                return batch._replace(lost=self._stream.counters.lost - lost_before)


def _decoder(described: LineFormat | BinaryFormat) -> Decoder:
    answers = bool(described.exchange.request)
    if isinstance(described, LineFormat):
        return LineDecoder(described, answers=answers)
    return BinaryDecoder(described, answers=answers)


class Poll:
    """When to ask, and which answer belongs to which request; a `Decoder` around the format's own.

    A request that is not answered in time is given up: for as long again nothing is asked, so that a late answer is
    thrown away and never taken for the next one's.

    Args:
        decoder: of the answers.
        exchange: the request and its time-out.
        scale: how often to ask (device time), and how fast the device's clock runs against the host's.
    """

    def __init__(self, decoder: Decoder, exchange: Exchange, scale: SampleScale) -> None:
        self.bad_frames = self.skipped_bytes = 0
        self._decoder = decoder
        self._exchange = exchange
        rate_Hz = (scale.rate_Hz or REQUEST_RATE_Hz) * scale.device_rate
        self._period_ns = int(1e9 / rate_Hz)
        self._clocked = scale.device_rate == 1.0
        self._timeout_ns = int((exchange.answer_timeout_s if self._clocked else AHEAD_TIMEOUT_S) * 1e9)
        ahead = min(AHEAD_BYTES // len(exchange.request), int(AHEAD_S * rate_Hz))
        self._most = 1 if self._clocked else max(1, ahead)
        self._pending: deque[tuple[int, int]] = deque()
        self._number = 0
        self._due_ns = 0
        self._request_ns = 0

    def given_up(self, now_ns: int) -> bool:
        """Whether an answer is overdue; then all requests are forgotten, and nothing is asked for a while."""
        if not self._pending or now_ns - self._request_ns <= self._timeout_ns:
            return False
        self._pending.clear()
        self._decoder.clear()
        self._due_ns = now_ns + self._timeout_ns
        return True

    def due(self, now_ns: int) -> bytes:
        """Requests to be sent now, with which the waiting begins; b"" for none."""
        count = self._most - len(self._pending)
        if now_ns < self._due_ns or count <= 0:
            return b""
        if self._clocked:
            late = (now_ns - self._due_ns) // self._period_ns if self._due_ns else 0
            self._due_ns = (self._due_ns or now_ns) + (late + 1) * self._period_ns
            self._number += late
        for _ in range(count):
            self._number += 1
            self._pending.append((self._number, now_ns))
        self._request_ns = now_ns
        return self._exchange.request * count

    def next_ns(self) -> int:
        """When to look again at the latest (monotonic)."""
        if self._pending:
            return self._request_ns + self._timeout_ns + 1
        return self._due_ns

    def feed(self, chunk: bytes) -> list[Reading]:
        """Readings that answer requests, numbered by them; unrequested bytes are damaged."""
        bad = self._decoder.bad_frames
        answers = self._decoder.feed(chunk)
        self.bad_frames += self._decoder.bad_frames - bad
        self.skipped_bytes = self._decoder.skipped_bytes
        for _ in range(min(self._decoder.bad_frames - bad, len(self._pending))):
            self._pending.popleft()
        readings: list[Reading] = []
        for _, _, value, status, _ in answers:
            if not self._pending:
                self.bad_frames += 1
                continue
            number, request_ns = self._pending.popleft()
            device_us = request_ns // 1000 % DEVICE_US_MODULUS if self._clocked else -1
            readings.append((number % SEQUENCE_MODULUS, device_us, value, status, 0))
            self._request_ns = max(self._request_ns, request_ns) if self._clocked else clock.monotonic_ns()
        return readings

    def clear(self) -> None:
        """Forget the unfinished answer and the requests under way."""
        self._decoder.clear()
        self._pending.clear()
