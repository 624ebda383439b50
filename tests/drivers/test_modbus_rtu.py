"""Modbus RTU against a pseudo terminal: damaged, late and foreign answers. Bytes by hand."""

from __future__ import annotations

import os
import select
import threading
import time
import tty
from collections.abc import Callable, Iterator

import pytest

from drivers.errors import LinkLost, NoAnswer, PortClosed, RequestRefused, WrongAnswer
from drivers.modbus_link import ModbusLink
from protocols.modbus import encode_rtu

TIMEOUT_S = 0.08
UNIT = 7
Fault = Callable[[bytes], list[tuple[float, bytes]]]
"""The right answer frame -> (pause before it in s, bytes) to send instead."""


class RtuDevice:
    """Answers reads with the number of the request in every register, and acknowledges writes.

    Attributes:
        requests: every request frame.
        faults: what happens to the next answers; None entries are answered as they should be.
    """

    def __init__(self) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.url = f"modbus-rtu:{os.ttyname(self._slave)}"
        self.requests: list[bytes] = []
        self.faults: list[Fault | None] = []
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self) -> None:
        if self._ending.is_set():
            return
        self._ending.set()
        self._thread.join(5)
        os.close(self.master)
        os.close(self._slave)

    def _serve(self) -> None:
        while not self._ending.is_set():
            if not select.select([self.master], [], [], 0.02)[0]:
                continue
            frame = os.read(self.master, 300)
            self.requests.append(frame)
            pdu = frame[1:-2]
            count = int.from_bytes(pdu[3:5], "big")
            words = len(self.requests).to_bytes(2, "big") * count
            right = encode_rtu(frame[0], pdu[:5] if pdu[0] == 16 else bytes([pdu[0], 2 * count]) + words)
            fault = self.faults.pop(0) if self.faults else None
            for pause_s, piece in [(0.0, right)] if fault is None else fault(right):
                time.sleep(pause_s)
                os.write(self.master, piece)


@pytest.fixture
def device() -> Iterator[RtuDevice]:
    made = RtuDevice()
    yield made
    made.close()


@pytest.fixture
def link(device: RtuDevice) -> Iterator[ModbusLink]:
    made = ModbusLink(device.url, UNIT, TIMEOUT_S)
    made.open()
    yield made
    made.close()


def late(right: bytes) -> list[tuple[float, bytes]]:
    return [(1.5 * TIMEOUT_S, right)]


def never(right: bytes) -> list[tuple[float, bytes]]:
    return []


def in_pieces(right: bytes) -> list[tuple[float, bytes]]:
    return [(0.001, right[index : index + 1]) for index in range(len(right))]


def damaged(right: bytes) -> list[tuple[float, bytes]]:
    return [(0.0, right[:4] + bytes([right[4] ^ 1]) + right[5:])]


def cut_short(right: bytes) -> list[tuple[float, bytes]]:
    return [(0.0, right[:-3])]


def too_long(right: bytes) -> list[tuple[float, bytes]]:
    return [(0.0, right + b"\x00\x5a")]


def from_another_unit(right: bytes) -> list[tuple[float, bytes]]:
    return [(0.0, encode_rtu(UNIT + 1, right[1:-2]))]


def other_function(right: bytes) -> list[tuple[float, bytes]]:
    return [(0.0, encode_rtu(UNIT, b"\x04" + right[2:-2]))]


def refused(right: bytes) -> list[tuple[float, bytes]]:
    return [(0.0, encode_rtu(UNIT, bytes([right[1] | 0x80, 4])))]


def test_registers_come_in_whatever_pieces_the_line_makes(device: RtuDevice, link: ModbusLink) -> None:
    device.faults = [None, in_pieces]
    assert link.read(100, 3) == [1, 1, 1]
    assert link.read(100, 3) == [2, 2, 2]
    link.write(300, [7, 8])
    assert link.exchange(100, 2, 350, [9]) == [4, 4]
    assert [frame[1] for frame in device.requests] == [3, 3, 16, 23]
    assert link.stale == 0


def test_a_late_answer_is_thrown_away_and_never_taken_for_the_next_one(device: RtuDevice, link: ModbusLink) -> None:
    device.faults = [late]
    assert link.read(100, 2) == [2, 2], "the answer to the second request, not the late one"
    assert (link.stale, link.timeouts) == (1, 1)
    assert link.read(100, 2) == [3, 3]


def test_what_waits_on_the_line_before_a_request_is_thrown_away(device: RtuDevice, link: ModbusLink) -> None:
    os.write(device.master, encode_rtu(UNIT, bytes([3, 4, 0, 99, 0, 99])))
    assert link.read(100, 2) == [1, 1]
    assert link.stale == 1


@pytest.mark.parametrize("fault", [damaged, cut_short, too_long, from_another_unit, other_function])
def test_an_answer_that_is_not_whole_and_ours_is_read_again(device: RtuDevice, link: ModbusLink, fault: Fault) -> None:
    device.faults = [fault]
    assert link.read(100, 2) == [2, 2]
    device.faults = [fault, fault]
    with pytest.raises(WrongAnswer):
        link.read(100, 2)


@pytest.mark.parametrize("fault", [damaged, cut_short, never])
def test_a_write_is_never_sent_again_by_itself(device: RtuDevice, link: ModbusLink, fault: Fault) -> None:
    device.faults = [fault]
    with pytest.raises((WrongAnswer, NoAnswer)):
        link.write(300, [7, 8])
    assert len(device.requests) == 1


def test_a_silent_line_is_reported_and_closed_at_the_second_time_out(device: RtuDevice, link: ModbusLink) -> None:
    device.faults = [never, never]
    with pytest.raises(NoAnswer, match="no answer within 80 ms"):
        link.read(100, 2)
    assert not link.is_open
    with pytest.raises(LinkLost, match="not connected"):
        link.read(100, 2)
    link.open()
    assert link.read(100, 1) == [3]


def test_a_line_that_went_away_is_a_lost_link(device: RtuDevice, link: ModbusLink) -> None:
    device.close()
    with pytest.raises(LinkLost, match="the connection to the port was lost"):
        link.read(100, 2)
    assert not link.is_open


def test_a_refusal_has_its_name(device: RtuDevice, link: ModbusLink) -> None:
    device.faults = [refused]
    with pytest.raises(RequestRefused, match=r"exception 4 \(device failure\)"):
        link.read(100, 2)


def test_a_port_that_is_not_there_is_named() -> None:
    with pytest.raises(PortClosed, match="actuator at /dev/no-such-tty"):
        ModbusLink("modbus-rtu:/dev/no-such-tty").open()
