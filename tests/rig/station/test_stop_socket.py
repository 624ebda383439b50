"""The station's second door knows one word."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rig.station.live_folder import address, send_message
from rig.station.stop_socket import BREATH_S, StopSocket

WAIT_S = 20.0


class Stops:
    def __init__(self, path: Path) -> None:
        self.path = path
        self.by: list[str] = []
        self.heard = threading.Event()
        self.door = StopSocket(path, self._stop)

    def _stop(self, by: str) -> None:
        self.by.append(by)
        self.heard.set()
        if by == "defect":
            raise RuntimeError(by)


@pytest.fixture
def stops(tmp_path: Path) -> Iterator[Stops]:
    made = Stops(tmp_path / "station.sock")
    yield made
    made.door.close()


def test_a_stop_is_passed_on_with_who_requested(stops: Stops) -> None:
    assert send_message(stops.path, {"do": "stop", "by": "Ada"})
    assert stops.heard.wait(WAIT_S)
    assert stops.by == ["Ada"]


@pytest.mark.parametrize(
    "message", [{"do": "reset"}, {"do": "start"}, {"do": "move", "target_m": 0.01}, {"do": "beat"}, {"do": "arm"}, {}]
)
def test_everything_else_is_thrown_away(stops: Stops, message: dict[str, Any]) -> None:
    assert send_message(stops.path, message)
    assert send_message(stops.path, {"do": "stop", "by": "then"})
    assert stops.heard.wait(WAIT_S)
    assert stops.by == ["then"]


def test_garbage_and_a_defect_behind_it_do_not_close_the_door(stops: Stops) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as stranger:
        for data in (b"", b"\xff" * 100, b"[" * 5000, b"null"):
            with address(stops.path) as short:
                stranger.sendto(data, short)
    send_message(stops.path, {"do": "stop", "by": "defect"})
    assert stops.heard.wait(WAIT_S)
    stops.heard.clear()
    assert send_message(stops.path, {"do": "stop", "by": "again"})
    assert stops.heard.wait(WAIT_S)
    assert stops.by == ["defect", "again"]


def test_a_flood_is_read_slowly_and_no_sender_waits(stops: Stops) -> None:
    began = time.monotonic()
    taken = sum(send_message(stops.path, {"do": "stop", "by": "x"}) for _ in range(200))
    while len(stops.by) < taken and time.monotonic() - began < WAIT_S:
        time.sleep(0.01)
    assert len(stops.by) == taken
    assert time.monotonic() - began >= (taken - 1) * BREATH_S


def test_the_door_is_its_owners_alone_and_goes_at_the_end(stops: Stops) -> None:
    assert stops.path.stat().st_mode & 0o777 == 0o600
    stops.door.close()
    assert not send_message(stops.path, {"do": "stop"})
