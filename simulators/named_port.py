"""A sensor's port behind a name that stays: what `/dev/serial/by-id` is for USB adapters."""

from __future__ import annotations

from pathlib import Path

from simulators.serial_port import SensorPort, open_port


class NamedPort:
    """A symbolic link, named by a serial number, to a pty; `renumber` makes it lead to another one.

    Args:
        folder: where the name is put.
        name: the device's serial number.
        baudrate: at which the device sends (Bd).

    Raises:
        OSError: no pty, or the folder cannot be written.
    """

    def __init__(self, folder: Path, name: str, baudrate: int = 0) -> None:
        self.url = str(folder / name)
        self._baudrate = baudrate
        self._port = self._connect()
        self._dropped_before = self._sent_before = 0
        self._listens = False

    @property
    def waits(self) -> bool:
        """Nothing is dropped: the rig's clock stands until the host has read."""
        return self._port.waits

    @waits.setter
    def waits(self, waits: bool) -> None:
        self._port.waits = waits

    @property
    def dropped_frames(self) -> int:
        """Whole frames dropped because the host had not read."""
        return self._dropped_before + self._port.dropped_frames

    @property
    def unheard_frames(self) -> int:
        """Whole frames dropped before any host read from the present port."""
        return self._port.unheard_frames

    @property
    def sent_bytes(self) -> int:
        """Bytes accepted so far."""
        return self._sent_before + self._port.sent_bytes

    @property
    def read_once(self) -> bool:
        """Whether the host has ever read from the present port."""
        return self._port.read_once

    def write(self, data: bytes, frame_size: int) -> None:
        """Send whole frames as far as there is room; drop and count the rest."""
        self._port.write(data, frame_size)

    def unread(self) -> int:
        """Bytes sent and not yet read by the host."""
        return self._port.unread()

    def listen(self) -> None:
        """Keep what the host sends from now on; until then it is thrown away."""
        self._listens = True
        self._port.listen()

    def heard(self) -> list[tuple[int, bytes]]:
        """What the host has sent since the last call, each part with the monotonic time (ns) it came at."""
        return self._port.heard()

    def renumber(self) -> None:
        """Come up as another port, as a USB adapter does after a short loss of power; the old one ends."""
        before, self._port = self._port, self._connect()
        if self._listens:
            self._port.listen()
        self._dropped_before += before.dropped_frames
        self._sent_before += before.sent_bytes
        before.close()

    def close(self) -> None:
        """Hang up and take the name away."""
        self._port.close()
        Path(self.url).unlink(missing_ok=True)

    def _connect(self) -> SensorPort:
        port = open_port("pty", self._baudrate)
        fresh = Path(f"{self.url}.new")
        fresh.symlink_to(port.url)
        fresh.replace(self.url)
        return port
