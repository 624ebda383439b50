"""Serial ports that are opened by a name, as those of USB adapters are: a file of the world stands for the device."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from simulators.world.device_loop import WirePort
from simulators.world.machine import Machine


class Tty(WirePort):
    """A sensor's line that the host opens by a path; the file there holds the number of its port."""

    def __init__(self, machine: Machine, folder: Path) -> None:
        super().__init__(machine.kernel, machine.network)
        folder.mkdir(exist_ok=True)
        number = self.url.rpartition(":")[2]
        self._path = folder / f"tty{number}"
        self._path.write_text(number, encoding="utf-8")
        self.url = str(self._path)

    def close(self) -> None:
        """Hang up; the device's file goes with it."""
        super().close()
        self._path.unlink(missing_ok=True)


class Serial:
    """`serial.Serial` of such a line, as the drivers use it."""

    def __init__(self, machine: Machine, url: str) -> None:
        self.exclusive = False
        self._machine = machine
        self._url = url
        self._descriptor = -1

    def open(self) -> None:
        """Open.

        Raises:
            OSError: no such device, or nobody is at its other end.
        """
        number = int(Path(self._url).read_text(encoding="utf-8"))
        self._descriptor = self._machine.descriptor(self._machine.network.connect(number), self._machine.here)
        self._machine.set_blocking(self._descriptor, False)

    def fileno(self) -> int:
        """Its descriptor."""
        return self._descriptor

    def close(self) -> None:
        """Hang up."""
        self._machine.close(self._descriptor)


def serial_for_url(machine: Machine, url: str, **_settings: Any) -> Serial:  # noqa: ANN401 - a line has none here
    """`serial.serial_for_url` of a path."""
    return Serial(machine, url)
