"""Formats guessed from captured bytes: streams written out here, and what a person would say of them."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from functools import reduce
from operator import xor

import pytest

from drivers.sniffing import guessed, tried
from protocols.guess_can import read_candump, summaries
from protocols.guess_frames import described_frames

SIGNAL = [1000.0 * math.sin(2.0 * math.pi * k / 97.0) + 3.0 * math.sin(k * k) for k in range(240)]


def xored(text: str) -> str:
    return f"${text}*{reduce(xor, text.encode()):02X}\r\n"


LINES = {
    "unit": ([f"ST,{v / 1000:+08.3f} kN\r\n" for v in SIGNAL], 1e-3),
    "counter first": ([f"{k};{v:.2f};N\r\n" for k, v in enumerate(SIGNAL)], 1.0),
    "STX and ETX": ([f"\x02{v:+07.0f}\x03" for v in SIGNAL], 1.0),
    "decimal comma": ([f"  {v:8.1f} mm\r".replace(".", ",") for v in SIGNAL], 1.0),
    "checksum": ([xored(f"F,{v:+09.2f},{k % 10}") for k, v in enumerate(SIGNAL)], 1.0),
}


@pytest.mark.parametrize("name", LINES)
def test_lines_of_text_are_found_with_their_reading(name: str) -> None:
    lines, factor = LINES[name]
    data = "".join(lines).encode()[5:]
    match = guessed(data)
    assert match is not None
    assert match.believed
    assert match.share > 0.98
    values = [value for value, _ in match.readings]
    assert values == pytest.approx([v * factor for v in SIGNAL[-len(values) :]], abs=0.51 * factor)


def test_a_sum_at_a_line_s_end_is_found() -> None:
    match = guessed("".join(LINES["checksum"][0]).encode())
    assert match is not None
    assert not isinstance(match.given, str)
    assert match.given["checksum"] == "xor-hex"
    assert match.given["checksum_over"] == [2, 14]


def modbus_crc(data: bytes) -> bytes:
    """CRC-16/MODBUS bit by bit, as its specification's appendix says."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return crc.to_bytes(2, "little")


def checked(number: int, value: float) -> bytes:
    body = b"\xaa\x55" + struct.pack(">iB", round(1000 * value), number & 255)
    return body + modbus_crc(body)


FRAMES = {
    "CRC and counter": (checked, 1000.0, {"sync": [0xAA, 0x55], "length": 9, "checksum": "crc16-modbus"}),
    "float": (lambda _, v: b"\xfe\xed" + struct.pack("<f", v), 1.0, {"sync": [0xFE, 0xED], "length": 6}),
    "packed": (
        lambda _, v: bytes([round(32000 + v) & 63, 64 | round(32000 + v) >> 6 & 63, 128 | round(32000 + v) >> 12]),
        1.0, None,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FRAMES)
def test_frames_are_found_with_their_value(name: str) -> None:
    frame, factor, expected = FRAMES[name]
    data = b"".join(frame(k, v) for k, v in enumerate(SIGNAL))[7:]
    match = guessed(data)
    assert match is not None
    assert match.believed
    values = [value for value, _ in match.readings]
    offset = 32000.0 if name == "packed" else 0.0
    assert values == pytest.approx([offset + factor * v for v in SIGNAL[-len(values) :]], abs=0.6)
    if expected is None:
        assert match.given == "optoncdt", "a preset comes before a guess"
    else:
        assert not isinstance(match.given, str)
        assert match.given.items() >= expected.items()
    if name == "CRC and counter":
        assert not isinstance(match.given, str)
        assert match.given["fields"]["sequence"] == {"at": 6, "type": "u8"}


def test_a_preset_is_named() -> None:
    match = guessed(b"99\r\n" + b"".join(f"{round(v):06d}\r\n".encode() for v in SIGNAL if v >= 0))
    assert match is not None
    assert match.given == "laumas-fast"


@pytest.mark.parametrize("data", [b"", b"\x00" * 300, bytes(range(256)) * 4, b"hello world\r\n" * 40])
def test_what_is_no_format_is_not_called_one(data: bytes) -> None:
    match = guessed(data)
    assert match is None or not match.believed


def test_where_a_format_does_not_fit_is_reported() -> None:
    match = tried(b"12\r\n001234\r\nbad\r\n001235\r\n", "laumas-fast")
    assert [value for value, _ in match.readings] == [1234.0, 1235.0]
    assert (match.damaged, match.matched) == (1, 25 - 2 - 3)
    assert [(end - count, count) for end, count in match.missed] == [(0, 2), (12, 3)]


def candump(frames: list[tuple[float, str, bytes]]) -> str:
    return "".join(f"({1000 + time_s:.6f}) can0 {name}#{data.hex()}\n" for time_s, name, data in frames)


def test_counters_and_checksums_of_a_bus_are_found() -> None:
    frames: list[tuple[float, str, bytes]] = []
    for k in range(60):
        body = bytes([k & 15, 7, k // 3 & 255])
        frames.append((0.01 * k, "120", bytes([sum((k * k * 37, k * 11)) & 255]) + body))
        if k % 10 == 0:
            frames.append((0.01 * k, "18FF0001", b"\x01\x02"))
    slow, fast = sorted(summaries(read_candump(candump(frames)).frames), key=lambda one: one.count)
    assert (fast.identifier, fast.extended, fast.count, fast.lengths) == (0x120, False, 60, [4])
    assert fast.period_s == pytest.approx(0.01)
    assert fast.counters == [(1, 0, 4)]
    assert fast.checksums == [0]
    assert fast.changing == [0, 1, 3]
    assert (slow.identifier, slow.extended, slow.changing) == (0x18FF0001, True, [])


def test_frames_of_can_fd_remote_frames_and_error_frames_are_told_apart() -> None:
    """Each kind as `candump -l` of can-utils writes it, and as `candump -ta` shows it."""
    log = read_candump(
        "(1000.010000) can0 123#DEADBEEF\n(1000.020000) can0 123##5" + "AB" * 48 + "\n(1000.030000) can0 7E0#R8\n"
        "(1000.040000) can0 20000040#0000000000000000\n(1000.050000) can0 2000008C#0008000000000000\n"
        " (1000.060000)  can0  18FF0001   [3]  01 02 03   '...'\n (1000.070000)  can0  123  [02]  0A 0B\n"
        " (1000.080000)  can0  7E0   [8]  remote request\n"
        " (1000.090000)  can0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME\n\tcontroller-problem{rx-warning}\n"
    )
    assert [(identifier, len(data), extended) for _, identifier, data, extended in log.frames] == [
        (0x123, 4, False), (0x123, 48, False), (0x18FF0001, 3, True), (0x123, 2, False),
    ]
    assert (log.fd, dict(log.remote), log.other_lines) == ({0x123}, {0x7E0: 2}, 1)
    assert dict(log.errors) == {
        "bus-off": 1, "controller problem and protocol violation and bus error": 1, "controller problem": 1,
    }


@pytest.mark.parametrize(
    ("line", "unit", "status", "tokens"),
    [
        (lambda v: f"{v:+08.1f} N {'O' if abs(v) > 900 else ' '}", "N", {"": "ok", "O": "overload"}, None),
        (lambda v: f"{'US' if v < 0 else 'ST'},GS,{v:+08.2f}kN", "kN", {"ST,GS,": "ok", "US,GS,": "ok"}, None),
        (lambda v: f"{v:+08.2f} kN" if abs(v) < 950 else "   OL    kN", "kN", None, ["OL"]),
        (lambda v: f"{v:8.2f} g {'S' if v > 0 else 'D'}", "g", {"D": "ok", "S": "ok"}, None),
        (lambda v: f"{v:8.2f} kg G" if abs(v) < 950 else "-------- kg G", "kg", None, ["--------"]),
        (lambda v: f"N {v:+08.2f} kg  OK", "kg", None, None),
    ],
)
def test_unit_status_and_overload_behind_the_number_are_kept(
    line: Callable[[float], str], unit: str, status: dict[str, str] | None, tokens: list[str] | None
) -> None:
    match = guessed("".join(line(v) + "\r\n" for v in SIGNAL).encode()[3:])
    assert match is not None
    assert not isinstance(match.given, str)
    assert (len(match.readings), match.damaged) == (len(SIGNAL) - 1, 0)
    given = (match.given["unit"], match.given.get("status"), match.given.get("overload_tokens"))
    assert given == (unit, status, tokens)
    overloaded = [math.isnan(value) for value, _ in match.readings]
    assert any(overloaded) is (tokens is not None or (status is not None and "O" in status))
    wrong = tried((line(1.0).replace(unit, "oz") + "\r\n").encode() * 3, match.given, "proposed")
    assert not wrong.readings, "another unit is another line"


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("end", [b"\r", b""])
@pytest.mark.parametrize("middle", [0, 300, 70_000])
def test_bytes_of_a_number_that_stand_still_belong_to_it(order: str, end: bytes, middle: int) -> None:
    """A sensor at rest: the upper bytes of its 32-bit number do not change; they are neither marks nor nothing."""
    data = b""
    for k in range(60):
        number = middle + round(20.0 * math.sin(k / 9.0)) + k % 3
        frame = b"\xaa\x55" + number.to_bytes(4, order, signed=True)  # type: ignore[arg-type]  # "little" or "big"
        data += frame + (end or bytes([sum(frame) & 0xFF]))
    first = next(described_frames(data[3:]))
    assert first["sync"] == [0xAA, 0x55]
    assert first["fields"] == {"value": {"at": 2, "type": "i32", "order": order}}
