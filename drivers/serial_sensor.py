"""A sensor that sends readings by itself over a serial line: load cell, LVDT, auxiliary channels."""

from __future__ import annotations

import time
from dataclasses import replace

from drivers.errors import DriverError
from drivers.ring import Channel
from drivers.sample_stream import Batch, Decoder, SampleCounters, SampleStream
from drivers.serial_port import SerialPort
from protocols.frame_format import FrameDecoder
from protocols.line_format import LineDecoder, LineFormat, preset

FRAME16 = "frame16"
WIRE_UNITS = {Channel.FORCE: "N", Channel.DISPLACEMENT: "mm"}


class SerialSensor:
    """Owns the port of one sensor and turns what it sends into ring records in SI.

    Args:
        url: port, anything `SerialPort` takes.
        baudrate: Bd.
        name: device name for messages, as in the bench file.
        channel: ring channel 1..9.
        line_format: "frame16", the name of a line format preset, or a `LineFormat`.
        wire_unit: unit a line format preset writes behind the number, where it writes one; N for force, mm for
            displacement and the preset's own otherwise, when not given.
        sensitivity: SI unit per unit on the wire.
        offset: SI unit, added after scaling: minus what the sensor shows at zero.
        rate_Hz: nominal samples a second of the device's clock; None when not known.
        device_rate: device seconds a second of the host's clock.

    Raises:
        LocalProtocolError: no format of that name.
    """

    def __init__(
        self,
        url: str,
        baudrate: int = 115200,
        *,
        name: str,
        channel: Channel,
        line_format: str | LineFormat = FRAME16,
        wire_unit: str | None = None,
        sensitivity: float = 1.0,
        offset: float = 0.0,
        rate_Hz: float | None = None,
        device_rate: float = 1.0,
    ) -> None:
        self.name = name
        self.channel = channel
        self._port = SerialPort(url, baudrate, device=name)
        self._format: LineFormat | None = None
        if isinstance(line_format, LineFormat):
            self._format = line_format
        elif line_format != FRAME16:
            shipped = preset(line_format)
            self._format = replace(shipped, unit=wire_unit or WIRE_UNITS.get(channel, shipped.unit))
        self._decoder: Decoder = FrameDecoder() if self._format is None else LineDecoder(self._format)
        if rate_Hz is None and self._format is not None:
            rate_Hz = self._format.nominal_rate_Hz
        self._stream = SampleStream(
            self._decoder, channel, sensitivity=sensitivity, offset=offset, nominal_rate_Hz=rate_Hz,
            device_rate=device_rate, has_sequence=self._format is None,
        )
        self._last_sample_ns: int | None = None

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
        if self._format is not None and self._format.start_command:
            self._port.write(self._format.start_command)

    def close(self) -> None:
        """Stop the device's sending if its format needs that, and close the port; closing twice is harmless."""
        if self._port.is_open and self._format is not None and self._format.stop_command:
            try:
                self._port.write(self._format.stop_command)
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
        chunk, arrival_ns = self._port.read_available(timeout_s)
        batch = self._stream.take(chunk, arrival_ns)
        if batch.records:
            self._last_sample_ns = arrival_ns
        return batch

    def age_ns(self, now_ns: int | None = None) -> int | None:
        """Nanoseconds since the last reading arrived; None before the first.

        Args:
            now_ns: monotonic time; now without it.
        """
        if self._last_sample_ns is None:
            return None
        return (time.monotonic_ns() if now_ns is None else now_ns) - self._last_sample_ns
