"""Sensors that are Modbus registers: requests and answers byte by byte, as the Modbus specifications state them."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest

from protocols.binary_decoder import BinaryDecoder
from protocols.binary_format import BinaryFormat
from protocols.errors import LocalProtocolError
from protocols.sensor_format import from_description, modbus_framing
from rig.files.descriptions import problems_of
from simulators.frame_writer import FrameWriter, span_of


def made(**table: object) -> BinaryFormat:
    assert problems_of("sensor-format", table) == []
    described = from_description(table)
    assert isinstance(described, BinaryFormat)
    return described


def test_a_register_over_tcp() -> None:
    described = made(base="labjack-t", address=2)
    assert described.exchange.request == bytes.fromhex("0001 0000 0006 01 03 0002 0002")
    decoder = BinaryDecoder(described, answers=True)
    answer = bytes.fromhex("0001 0000 0007 01 03 04") + struct.pack(">f", 2.5)
    assert [reading[2] for reading in decoder.feed(answer)] == [2.5]
    (reading,) = decoder.feed(answer[:-4] + struct.pack(">f", -9999.0))
    assert (reading[3], math.isnan(reading[2])) == (1, True)
    assert decoder.feed(bytes.fromhex("0001 0000 0003 01 83 02")) == [], "an exception is no reading"


def test_a_register_over_a_serial_line_with_status_and_numbers_of_the_manual() -> None:
    described = made(
        framing="rtu", device_id=17, function="input", first_address=30001, address=30108, type="i16", scale=0.1,
        unit="kN", status={"address": 30110, "fault_bits": 4},
    )
    # Registers 107 to 109 of unit 17, function 4; checksum of the request by hand from the specification's table.
    assert described.exchange.request[:-2] == bytes.fromhex("11 04 006B 0003")
    decoder = BinaryDecoder(described, answers=True)
    writer = FrameWriter(described, *span_of(described))
    values, status = np.array([-12.3, 4.0]), np.array([0, 2], np.uint8)
    frames = writer(values, status, np.arange(2), np.arange(2))
    assert frames[0, :-2].tobytes() == bytes.fromhex("11 04 06 FF85 0000 0000")
    first, second = decoder.feed(writer.joined(frames))
    assert first[2:4] == (pytest.approx(-12.3), 0)
    assert second[3] != 0


@pytest.mark.parametrize(
    ("words", "octets", "expected"),
    [("big", "big", "41480000"), ("little", "big", "00004148"), ("big", "little", "48410000"),
     ("little", "little", "00004841")],
)  # fmt: skip
def test_every_order_of_words_and_bytes(words: str, octets: str, expected: str) -> None:
    described = made(address=0, type="f32", word_order=words, byte_order=octets, unit="kN")
    writer = FrameWriter(described, -100.0, 100.0)
    frame = writer(np.array([12.5]), np.zeros(1, np.uint8), np.zeros(1, int), np.zeros(1, int)).tobytes()
    assert frame[9:].hex() == expected
    assert BinaryDecoder(described, answers=True).feed(frame)[0][2] == 12.5


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ({"kind": "modbus"}, "address"), ({"address": 65535, "type": "f32"}, "to 65534"),
        ({"address": 5, "first_address": 30001}, "30001"), ({"address": 0, "scale": 0}, "must not be 0"),
        ({"address": 0, "status": {"address": 300, "fault_bits": 1}}, "at most 125"),
        ({"address": 0, "status": {"address": 0, "fault_bits": 1}}, "belongs to the value"),
        ({"address": 0, "status": {"address": 1}}, "has no entries"),
        ({"address": 0, "overload_values": [70000]}, "70000"), ({"address": 0, "request": "?"}, "request"),
        ({"kind": "modbus", "base": "mantracourt"}, "describes lines"),
        ({"address": 1, "base": "flintec"}, "describes lines"),
        ({"kind": "lines", "base": "labjack-t"}, "describes modbus"),
        ({"address": 0, "type": "f32", "fault_values": [1]}, ""), ({"address": 0, "type": "u8"}, "u16"),
    ],
)  # fmt: skip
def test_what_contradicts_itself_is_refused_in_words(table: dict[str, Any], expected: str) -> None:
    problems = problems_of("sensor-format", table)
    assert expected in " ".join(f"{place}: {text}" for place, text in problems)
    if not problems:
        from_description(table)
    elif "request" not in table and table.get("type") != "u8":
        with pytest.raises(LocalProtocolError):
            from_description(table)


def test_the_framing_that_a_url_must_fit() -> None:
    assert [modbus_framing(given) for given in ("labjack-t", {"address": 0, "framing": "rtu"}, "hbm-aed")] == [
        "tcp", "rtu", "",
    ]  # fmt: skip


def test_another_register_states_the_decimal_places() -> None:
    """A panel meter: the reading in registers 2 and 3, the position of its decimal point in register 8."""
    described = made(address=2, type="i32", decimals={"address": 8}, unit="kN")
    assert described.exchange.request[-4:] == bytes.fromhex("0002 0007")
    head = bytes.fromhex("0001 0000 0011 01 03 0E")
    decoder = BinaryDecoder(described, answers=True)
    for places, value, status in ((0, -12345.0, 0), (2, -123.45, 0), (10, math.nan, 2)):
        answer = head + struct.pack(">iHHHHH", -12345, 9, 9, 9, 9, places)
        ((_, _, shown, told, _),) = decoder.feed(answer)
        assert (shown, told) == (pytest.approx(value, nan_ok=True), status)
    writer = FrameWriter(described, *span_of(described))
    rows = writer.joined(writer(np.array([7.0]), np.array([0], np.uint8), np.arange(1), np.arange(1)))
    assert decoder.feed(rows)[0][2] == 7.0
    assert problems_of("sensor-format", {"kind": "modbus", "address": 2, "type": "i32", "decimals": {"address": 3}})
