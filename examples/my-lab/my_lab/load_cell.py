"""The driver of this lab's load cell: lines such as `@+01234.5*04`, the last two digits the XOR of those before."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from drivers.catalogue import SensorConnection
from drivers.sample_stream import Batch, SampleStream
from drivers.serial_port import SerialPort

END = b"\r\n"
LONGEST = 64
NO_CLOCK = -1


class Lines:
    """Splits what arrives into readings; a chunk may begin and end anywhere.

    Attributes:
        bad_frames: lines that were damaged.
        skipped_bytes: bytes that belonged to no reading.
    """

    def __init__(self) -> None:
        self.bad_frames = 0
        self.skipped_bytes = 0
        self._rest = b""
        self._begun = False
        self._number = 0

    def feed(self, chunk: bytes) -> list[tuple[int, int, float, int, int]]:
        """Readings that these bytes complete: number modulo 65536, no clock, value (N), status, no edges."""
        *lines, self._rest = (self._rest + chunk).split(END)
        readings = []
        for line in lines:
            if not self._begun:  # the first line's beginning may be missing
                self._begun = True
                self.skipped_bytes += len(line)
                continue
            self._number = (self._number + 1) % 65_536
            value = reading(line)
            if value is None:
                self.bad_frames += 1
                self.skipped_bytes += len(line)
                continue
            readings.append((self._number, NO_CLOCK, value, 0, 0))
        if len(self._rest) > LONGEST:
            self.skipped_bytes += len(self._rest)
            self._rest, self._begun = b"", False
        return readings

    def clear(self) -> None:
        """Forget the unfinished line."""
        self._rest, self._begun = b"", False


def reading(line: bytes) -> float | None:
    """The force (N) that a line says; None for a damaged one."""
    if len(line) != 12 or line[:1] != b"@" or line[9:10] != b"*":
        return None
    check = 0
    for letter in line[1:9]:
        check ^= letter
    if line[10:] != b"%02X" % check:
        return None
    try:
        return float(line[1:9])
    except ValueError:
        return None


class MyLabCell:
    """The driver: `format = "my_lab_cell"` in the bench file. It has what `drivers.roles.Sensor` asks for.

    Args:
        connection: port, name, channel and scale, as the bench file says.
    """

    simulated_as: ClassVar[Mapping[str, str]] = {
        "name": "my_lab_cell", "pattern": r"@(?P<value>[+-]\d{5}\.\d)\*(?P<checksum>[0-9A-F]{2})",
        "template": "@{value:+08.1f}*{checksum}", "checksum": "xor-hex", "checksum_from": "@", "checksum_to": "*",
    }  # fmt: skip
    """What a simulated sensor writes for this driver: tests and worlds run it on the simulated rig."""

    def __init__(self, connection: SensorConnection) -> None:
        self._port = SerialPort(connection.url, connection.baudrate, device=connection.name)
        self._lines = Lines()
        self._stream = SampleStream(self._lines, connection.channel, connection.scale, has_sequence=False)

    @property
    def bad_frames(self) -> int:
        """Lines that came damaged."""
        return self._lines.bad_frames

    @property
    def skipped_bytes(self) -> int:
        """Bytes that belonged to no reading."""
        return self._lines.skipped_bytes

    @property
    def moved(self) -> bool:
        """The port's name leads to another port than the one that was opened."""
        return self._port.moved

    def open(self) -> None:
        """Open the port."""
        self._port.open()
        self._lines.clear()

    def close(self) -> None:
        """Close the port; closing twice is harmless."""
        self._port.close()

    def discard_input(self) -> None:
        """Throw away what has arrived."""
        self._port.discard_input()
        self._lines.clear()

    def read_batch(self, timeout_s: float) -> Batch:
        """Wait up to `timeout_s` for samples and return those that came; raises when the cable is pulled."""
        chunk, arrival_ns = self._port.read_available(timeout_s)
        return self._stream.take(chunk, arrival_ns)
