"""Described binary frames: bytes written out by hand, every split point, damage, and what is refused."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocols.binary_decoder import BinaryDecoder
from protocols.binary_format import BinaryFormat
from protocols.checksums import CHECKSUMS
from protocols.descriptions import DescriptionProblems
from protocols.frame_format import STATUS_OVERLOAD, STATUS_SENSOR_FAULT
from protocols.sensor_format import from_description


def binary(**table: object) -> BinaryFormat:
    made = from_description(table)
    assert isinstance(made, BinaryFormat)
    return made


# AA 55, i16 big at 2 in hundredths, counter u8 at 4, status u8 at 5, sum of bytes 0..5 modulo 256 at 6.
PLAIN = {
    "sync": [0xAA, 0x55], "length": 7, "order": "big", "checksum": "sum8", "fields": {
        "value": {"at": 2, "type": "i16", "scale": 0.01}, "sequence": {"at": 4, "type": "u8"},
        "status": {"at": 5, "type": "u8", "overload_bits": 0x01, "fault_bits": 0x80}},
}  # fmt: skip
# AA + 55 = 255. First: 255+1+244+254+0 = 754 = 2F2, second: 255+254+12+255+0 = 776 = 308.
FIRST = bytes.fromhex("AA55 01F4 FE 00 F2")  # 500 -> 5.00
SECOND = bytes.fromhex("AA55 FE0C FF 00 08")  # -500 -> -5.00
THIRD = bytes.fromhex("AA55 0000 00 01 00")  # 255+0+0+1 = 256 -> 00: overload
FOURTH = bytes.fromhex("AA55 0000 01 80 80")  # 255+1+128 = 384 = 180 -> 80: fault
STREAM = b"\x55\x01" + FIRST + SECOND + b"\xaa\x55\x00" + THIRD + FOURTH


@pytest.mark.parametrize("at", range(len(STREAM) + 1))
def test_every_split_point_gives_the_same_readings(at: int) -> None:
    decoder = BinaryDecoder(binary(**PLAIN))
    readings = decoder.feed(STREAM[:at]) + decoder.feed(STREAM[at:])
    assert [(number, status) for number, _, _, status, _ in readings] == [
        (254, 0), (255, 0), (256, STATUS_OVERLOAD), (257, STATUS_SENSOR_FAULT),
    ]  # fmt: skip
    assert [reading[2] for reading in readings[:2]] == pytest.approx([5.0, -5.0])
    assert all(math.isnan(reading[2]) for reading in readings[2:])
    assert decoder.skipped_bytes == 2 + 3


@pytest.mark.parametrize("at", range(len(FIRST)))
@pytest.mark.parametrize("lost", [True, False])
def test_a_damaged_byte_costs_its_own_frame_only(at: int, lost: bool) -> None:
    damaged = SECOND[:at] + SECOND[at + 1 :] if lost else SECOND[:at] + bytes([SECOND[at] ^ 0x10]) + SECOND[at + 1 :]
    decoder = BinaryDecoder(binary(**PLAIN))
    assert [r[0] for r in decoder.feed(FIRST + damaged + THIRD + FOURTH)] == [254, 256, 257]


def test_frames_without_a_checksum_are_believed_where_the_next_one_follows() -> None:
    layout = binary(sync=[0xA5], length=3, fields={"value": {"at": 1, "type": "u16"}})
    decoder = BinaryDecoder(layout)
    # The second byte looks like a sync; the frame that would begin there is followed by none.
    assert decoder.feed(bytes.fromhex("A5A501")) == []
    assert [r[2] for r in decoder.feed(bytes.fromhex("A50200A50300"))] == [0x01A5, 2.0, 3.0]
    answers = BinaryDecoder(layout, answers=True)
    assert [r[2] for r in answers.feed(bytes.fromhex("A50700"))] == [7.0]


DLE = binary(sync=[0x10, 2], end=[0x10, 3], stuffing="dle", length=6, fields={"value": {"at": 2, "type": "u16"}})
ESCAPE = binary(
    sync=[2], end=[3], stuffing="escape", escape=0x10, length=4, fields={"value": {"at": 1, "type": "u16"}}
)
HDLC = binary(
    sync=[0x7E], end=[0x7E], stuffing="escape", escape=0x7D, escape_xor=0x20, length=4,
    fields={"value": {"at": 1, "type": "u16"}},
)  # fmt: skip
SLIP = binary(end=[0xC0], stuffing="slip", length=3, fields={"value": {"at": 0, "type": "u16"}})


@pytest.mark.parametrize(
    ("layout", "stream", "values"),
    [
        (DLE, "03 1002 1010 07 1003 1002 0300 1003", [0x0710, 3.0]),
        (ESCAPE, "05 02 1002 1003 03 02 1010 00 03", [0x0302, 0x0010]),
        (HDLC, "01 7E 7D5E 7D5D 7E 7E 0100 7E 0200 7E", [0x7D7E, 1.0, 2.0]),
        (SLIP, "07 C0 DBDC DBDD C0 0100 C0", [0xDBC0, 1.0]),
    ],
)
def test_stuffed_frames_at_every_split_point(layout: BinaryFormat, stream: str, values: list[float]) -> None:
    data = bytes.fromhex(stream)
    for at in range(len(data) + 1):
        decoder = BinaryDecoder(layout)
        assert [r[2] for part in (data[:at], data[at:]) for r in decoder.feed(part)] == values, at


def test_bits_orders_and_types_mean_what_they_say() -> None:
    layout = binary(
        sync=[0xFF], length=10, fields={
            "value": {
                "at": 1, "type": "u16", "order": "big", "bits": [4, 15], "signed": True, "scale": 0.5, "offset": 1.0,
            },
            "sequence": {"at": 2, "type": "u8", "bits": [0, 3]},
            "time": {"at": 4, "type": "u32", "scale": 10.0},
            "status": {"at": 8, "type": "i16", "overload_values": [-2]},
        },
    )  # fmt: skip
    # bytes 1..2 big FF E3: bits 4..15 = FFE = -2 -> 0.0, counter 3; time 0x64 = 100 ticks of 10 us
    one = bytes.fromhex("FF FFE3 00 64000000 0000")
    two = bytes.fromhex("FF 0014 00 65000000 FEFF")
    got = BinaryDecoder(layout).feed(one + two + one[:1])
    assert got[0] == (3, 1000, 0.0, 0, 0)
    assert got[1][:2] == (4, 1010)
    assert got[1][3] == STATUS_OVERLOAD


def test_a_short_counter_goes_on_beyond_its_end() -> None:
    fields = {"value": {"at": 1, "type": "u8"}, "sequence": {"at": 2, "type": "u8"}}
    layout = binary(sync=[0xA5], length=3, fields=fields)
    data = b"".join(bytes([0xA5, 0, number]) for number in (254, 255, 0, 1, 4)) + b"\xa5"
    assert [r[0] for r in BinaryDecoder(layout).feed(data)] == [254, 255, 256, 257, 260]


PACKED = {
    "packed": ["00vvvvvv", "01vvvvvv", "10xxvvvv"], "order": "little", "fields": {"value": {"valid": [100, 65000]}},
}  # fmt: skip


def test_a_packed_stream_finds_its_beginning_in_its_own_bits() -> None:
    # 0x1234 = 0001 001000 110100: low 110100 -> 34, mid 001000 -> 48, high 0001 -> 81
    frame = bytes.fromhex("344881")
    for missing in range(3):
        for at in range(10):
            decoder = BinaryDecoder(binary(**PACKED))
            data = frame[missing:] + frame + frame
            readings = [r for part in (data[:at], data[at:]) for r in decoder.feed(part)]
            assert [r[2] for r in readings] == [4660.0] * (2 + (missing == 0))
    over = bytes.fromhex("3F7F8F")  # 65535
    assert BinaryDecoder(binary(**PACKED)).feed(over)[0][3] == STATUS_OVERLOAD


def test_checksums_are_the_catalogue_s_check_values() -> None:
    values = {
        "crc8": 0xF4, "crc16-modbus": 0x4B37, "crc16-arc": 0xBB3D, "crc16-ccitt-false": 0x29B1, "crc16-xmodem": 0x31C3,
        "crc16-kermit": 0x2189, "crc16-x25": 0x906E, "crc32": 0xCBF43926, "xor": 0x31, "sum8": 0xDD, "sum16": 0x1DD,
        "sum8-negated": 0x23, "sum8-inverted": 0x22, "sum8-bit7": 0xDD,
    }  # fmt: skip
    assert {kind: CHECKSUMS[kind].of(b"123456789") for kind in CHECKSUMS} == values


VALUE = {"value": {"at": 1, "type": "u16"}}


@pytest.mark.parametrize(
    ("table", "places"),
    [
        ({"sync": [1], "fields": VALUE}, [()]),
        ({"length": 4, "fields": VALUE}, [()]),
        ({"sync": [1], "length": 4, "fields": {"status": {"at": 1, "type": "u8", "fault_bits": 1}}}, [("fields",)]),
        ({"sync": [1], "length": 4, "fields": {"value": {"at": 0, "type": "u16"}}}, [("fields", "value", "at")]),
        ({"sync": [1], "length": 4, "fields": {"value": {"at": 3, "type": "u16"}}}, [("fields", "value", "at")]),
        ({"sync": [1], "length": 4, "fields": {"value": {"type": "u16"}}}, [("fields", "value")]),
        ({"sync": [1], "length": 2, "fields": VALUE, "checksum": "crc32"}, [("checksum_at",), ("length",)]),
        ({"sync": [1], "length": 5, "fields": VALUE, "checksum": "xor", "checksum_over": [0, 4]}, [("checksum_over",)]),
        ({"sync": [1], "length": 4, "fields": VALUE, "escape": 3}, [("escape",)]),
        ({"sync": [1], "length": 4, "fields": VALUE, "stuffing": "dle"}, [("stuffing",)]),
        ({"sync": [1], "length": 4, "fields": {"value": {"at": 1, "type": "u8", "bits": [4, 9]}}},
         [("fields", "value", "bits")]),
        ({"sync": [1], "length": 6, "fields": {"value": {"at": 1, "type": "f32", "scale": 0}}},
         [("fields", "value", "scale")]),
        ({"sync": [1], "length": 6, "fields": {"value": {"at": 1, "type": "u8", "overload_values": [300]}}},
         [("fields", "value", "overload_values")]),
        ({"packed": ["0vvvvvvv", "0vvvvvvv"]}, [("packed",)]),
        ({"packed": ["0vvvvvvv", "1vvvvvv"]}, [("packed", 1)]),
        ({"packed": ["0vvvvvvv", "1nvvvvvv"], "sync": [1]}, [("sync",), ("fields",)]),
    ],
)  # fmt: skip
def test_a_contradictory_description_is_refused_with_its_places(table: dict[str, object], places: list[object]) -> None:
    with pytest.raises(DescriptionProblems) as caught:
        from_description(table)
    assert [place for place, _ in caught.value.problems] == places


@settings(deadline=None, max_examples=60)
@given(st.binary(max_size=120), st.sampled_from([binary(**PLAIN), DLE, ESCAPE, HDLC, SLIP, binary(**PACKED)]))
def test_any_bytes_never_crash_and_every_byte_is_accounted_for(noise: bytes, layout: BinaryFormat) -> None:
    decoder = BinaryDecoder(layout)
    for part in (noise[:50], noise[50:]):
        for _, _, value, status, _ in decoder.feed(part):
            assert math.isfinite(value) or status
    assert decoder.skipped_bytes <= len(noise)
