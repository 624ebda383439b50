"""A sensor that sends readings by itself over a serial line: load cell, LVDT, auxiliary channels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from drivers.errors import DriverError
from drivers.ring import Channel
from drivers.sample_stream import Batch, Decoder, SampleCounters, SampleScale, SampleStream
from drivers.serial_port import SerialPort
from protocols.frame_format import FrameDecoder
from protocols.line_format import LineDecoder, LineFormat, preset

BINARY: Mapping[str, Callable[[], Decoder]] = {"frame16": FrameDecoder}
"""Binary formats by name, each with what splits its bytes; such a format numbers its samples."""
CLOCKED = ("frame16",)
"""Those that carry the sensor's clock and latched edges too; all others are counted against their rate."""
DEFAULT_FORMAT = "frame16"
UNSCALED = SampleScale()
WIRE_UNITS = {Channel.FORCE: "N", Channel.DISPLACEMENT: "mm"}


class SerialSensor:
    """Owns the port of one sensor and turns what it sends into ring records in SI.

    Args:
        url: port, anything `SerialPort` takes.
        baudrate: Bd.
        name: device name for messages, as in the bench file.
        channel: ring channel 1..9.
        line_format: name of a binary format or of a line format preset, or a `LineFormat`. A preset that writes a unit
            behind the number is taken to write N for force, mm for displacement.
        scale: from the wire to SI, and the sensor's rate; without a rate the format's own.

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
        line_format: str | LineFormat = DEFAULT_FORMAT,
        scale: SampleScale = UNSCALED,
    ) -> None:
        self.name = name
        self.channel = channel
        self._port = SerialPort(url, baudrate, device=name)
        self._format: LineFormat | None = None
        if isinstance(line_format, LineFormat):
            self._format = line_format
        elif line_format not in BINARY:
            shipped = preset(line_format)
            self._format = replace(shipped, unit=WIRE_UNITS.get(channel, shipped.unit))
        self._decoder: Decoder = (
            BINARY[str(line_format)]() if self._format is None else LineDecoder(self._format)
        )
        if scale.rate_Hz is None and self._format is not None:
            scale = replace(scale, rate_Hz=self._format.nominal_rate_Hz)
        self._stream = SampleStream(self._decoder, channel, scale, has_sequence=self._format is None)

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
        return self._stream.take(chunk, arrival_ns)
