"""The peer of a driver under test: its address, and the wire to it, which can be cut."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

import pytest

from drivers import catalogue

ACTUATOR, CURRENT_SOURCE, SENSOR = "actuator", "current source", "sensor"
LOOK_S = 0.02
BENCH = """format = 1
name = "conformance"
[limits]
position = ["-85 mm", "85 mm"]
speed = "0.8 m/s"
acceleration = "60 m/s^2"
force = "5 kN"
current = "3 A"
coil_temperature = "120 degC"
[actuator]
url = "modbus-tcp://127.0.0.1:502"
register_map = "{actuator}"
[ecu]
interface = "slcan"
channel = "socket://127.0.0.1:1"
dbc = "{source}"
[load_cell]
url = "socket://127.0.0.1:2"
format = "{sensor}"
rate = "250 Hz"
range = "10 kN"
stale_after = "40 ms"
[load_cell.calibration]
sensitivity = 1.0
serial_number = "LC-1"
[lvdt]
url = "socket://127.0.0.1:3"
rate = "250 Hz"
range = "100 mm"
[lvdt.calibration]
sensitivity = 0.001
serial_number = "LV-1"
"""


def _by_kind() -> dict[str, tuple[str, ...]]:
    return {
        ACTUATOR: catalogue.actuator_names(), CURRENT_SOURCE: catalogue.known_current_source_names(),
        SENSOR: catalogue.sensor_format_names(),
    }  # fmt: skip


def known_drivers() -> list[str]:
    """Every driver that `--driver` may name; where a name has several roles, `ROLE:NAME`."""
    named = [(kind, name) for kind, names in _by_kind().items() for name in names]
    count = [name for _, name in named]
    return [name if count.count(name) == 1 else f"{kind}:{name}" for kind, name in named]


def kind_of(driver: str) -> str | None:
    """The role of a driver; None when there is none of that name. `demo` alone is the actuator."""
    role, _, rest = driver.rpartition(":")
    return next((kind for kind, names in _by_kind().items() if rest in names and role in {"", kind}), None)


def bench_text(driver: str) -> str:
    """A bench file whose device of that role has this driver, the others being the usual ones."""
    kind, name = kind_of(driver), driver.rpartition(":")[2]
    names = {ACTUATOR: "demo", CURRENT_SOURCE: "demo", SENSOR: "frame16"} | {str(kind): name}
    return BENCH.format(actuator=names[ACTUATOR], source=names[CURRENT_SOURCE], sensor=names[SENSOR])


def silent_port() -> int:
    """A port of this machine without a listener."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


class Peer:
    """A wire to a device: bytes pass both ways until it is cut.

    Args:
        served: the device's URL or channel. One with a host and a port is reached through a relay of this object, at
            `url`; anything else (a serial port) at its own, and cannot be cut.
    """

    def __init__(self, served: str) -> None:
        parts = urlsplit(served)
        self._served, self._target = served, (parts.hostname, parts.port)
        self._listening: socket.socket | None = None
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self._silent = threading.Event()
        self._ended = threading.Event()
        self._relay = threading.Thread(target=self._pass_on, name="wire", daemon=True)

    def __enter__(self) -> Self:
        if all(self._target):
            self._listening = socket.create_server(("127.0.0.1", 0))
            self._relay.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._ended.set()
        if self._listening is not None:
            self._relay.join()
            self._listening.close()

    @property
    def url(self) -> str:
        """Where the driver finds the device."""
        return self._served if self._listening is None else self._at(int(self._listening.getsockname()[1]))

    @property
    def without_listener(self) -> str:
        """The same with a port without a listener; skips the test where there is no such port."""
        self._needs_relay()
        return self._at(silent_port())

    def silence(self) -> None:
        """The device says nothing more, and its connection stands."""
        self._needs_relay()
        self._silent.set()

    def hang_up(self) -> None:
        """The connection ends, as when the cable of an adapter is pulled."""
        self._needs_relay()
        self._ended.set()
        self._relay.join()

    def _at(self, port: int) -> str:
        host, old = self._target
        return self._served.replace(f"{host}:{old}", f"127.0.0.1:{port}")

    def _needs_relay(self) -> None:
        if self._listening is None:
            pytest.skip(
                f"{self._served}: the test cannot interrupt the connection without a host and port. Fix: test with "
                "a network connection"
            )

    def _pass_on(self) -> None:
        """The relay's thread."""
        listening = self._listening
        while not self._ended.is_set() and listening is not None:
            ends = [end for pair in self._pairs for end in pair]
            for ready in select.select([listening, *ends], [], [], LOOK_S)[0]:
                if ready is listening:
                    near, _ = listening.accept()
                    self._pairs.append((near, socket.create_connection(self._target)))
                else:
                    self._forward(ready)
        for pair in list(self._pairs):
            self._drop(pair)

    def _forward(self, end: socket.socket) -> None:
        pair = next((pair for pair in self._pairs if end in pair), None)
        if pair is None:
            return
        try:
            data = end.recv(65_536)
            if data and not self._silent.is_set():
                pair[1 - pair.index(end)].sendall(data)
        except OSError:
            data = b""
        if not data:
            self._drop(pair)

    def _drop(self, pair: tuple[socket.socket, socket.socket]) -> None:
        self._pairs.remove(pair)
        for end in pair:
            with contextlib.suppress(OSError):
                end.close()
