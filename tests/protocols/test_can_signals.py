"""Numbers in CAN frames: bytes worked out by hand, and cantools as a peer."""

import math
import struct

import pytest
from cantools.database.can import Database
from hypothesis import given, settings
from hypothesis import strategies as st

from protocols.can_signals import FrameReader, FrameWriter, Placed, Signal, put, take
from protocols.errors import LocalProtocolError


def read(frame: str, **signals: Signal) -> dict[str, float]:
    data = bytes.fromhex(frame)
    return FrameReader(len(data), {name: Placed(signal) for name, signal in signals.items()}).read(data)


def test_little_and_big_endian_numbers_lie_where_a_dbc_says() -> None:
    # 0x1234 from bit 8 upwards: bytes 34 12. Big-endian from bit 15 (top of byte 1) downwards: bytes 12 34.
    assert read("00 34 12 00", little=Signal("L", 8, 16)) == {"little": 0x1234}
    assert read("00 12 34 00", big=Signal("B", 15, 16, big_endian=True)) == {"big": 0x1234}
    # Twelve bits from bit 3: 3..0 of byte 0, then 7..0 of byte 1.
    assert read("0A BC", big=Signal("B", 3, 12, big_endian=True)) == {"big": 0xABC}
    # Five bits from bit 9: 9..13 of the frame, so bits 1..5 of byte 1: 0b0010_1010 >> 1 & 31 = 21.
    assert read("FF 2A", little=Signal("L", 9, 5)) == {"little": 21}


def test_a_float_has_no_ends_and_sends_only_numbers_that_it_holds() -> None:
    """1.5 is 3FC00000 in IEEE 754 single, 3E00 in half precision, whose largest number is 65504."""
    single, half = Signal("F", 0, 32, is_float=True), Signal("H", 0, 16, is_float=True)
    assert (single.low, single.high) == (-math.inf, math.inf)
    assert (single.raw(1.5), half.raw(1.5)) == (0x3FC00000, 0x3E00)
    with pytest.raises(LocalProtocolError, match="is not a finite number"):
        single.raw(math.nan)
    with pytest.raises(LocalProtocolError, match="exceeds a float of 16 bits"):
        half.raw(1e6)


def test_signs_scales_and_offsets() -> None:
    assert read("38 FF", a=Signal("A", 0, 16, signed=True, scale=0.01)) == {"a": -2.0}
    assert read("7B", c=Signal("C", 0, 8, offset=-40.0)) == {"c": 83.0}
    assert read("0F", n=Signal("N", 0, 4, signed=True)) == {"n": -1.0}
    assert read("DC 05", m=Signal("M", 0, 16, signed=True, scale=0.001)) == {"m": 1.5}


@pytest.mark.parametrize(("size", "kind"), [(2, "<e"), (4, "<f"), (8, "<d")])
def test_floats_of_both_byte_orders(size: int, kind: str) -> None:
    little = struct.pack(kind, -1.25)
    assert read(little.hex(), f=Signal("F", 0, 8 * size, is_float=True)) == {"f": -1.25}
    assert read(little[::-1].hex(), f=Signal("F", 7, 8 * size, True, is_float=True)) == {"f": -1.25}
    for broken in (math.nan, math.inf):
        both = read((struct.pack(kind, broken) + b"\x07").hex(), f=Signal("F", 0, 8 * size, is_float=True),
                    n=Signal("N", 8 * size, 8))  # fmt: skip
        assert math.isnan(both["f"])
        assert both["n"] == 7


def test_a_signal_on_another_page_is_left_out() -> None:
    page = Signal("Page", 0, 4)
    below = Signal("Sub", 4, 4)
    reader = FrameReader(2, {
        "two": Placed(Signal("Two", 8, 8), conditions=((page, frozenset({2, 3})),)),
        "deep": Placed(Signal("Deep", 8, 8), conditions=((page, frozenset({5})), (below, frozenset({1})))),
    })  # fmt: skip
    assert reader.read(bytes.fromhex("02 63")) == {"two": 99.0}
    assert reader.read(bytes.fromhex("15 63")) == {"deep": 99.0}
    assert reader.read(bytes.fromhex("05 63")) == {}


def test_a_frame_is_made_of_both_byte_orders_and_what_does_not_fit_is_refused() -> None:
    target = Signal("Target", 23, 16, big_endian=True, signed=True, scale=0.00025, unit="A")
    writer = FrameWriter(8, [(Signal("Slew", 39, 8, big_endian=True), 100), (Signal("Tail", 56, 8), 0xEE)], {
        "command": Placed(target), "enable": Placed(Signal("Mode", 13, 3), plain=True),
    })  # fmt: skip
    # 1.5 A are 6000 steps = 0x1770; Mode 2 in bits 13..15 of the frame.
    assert writer.write({"command": 1.5, "enable": 2}) == bytes.fromhex("00 40 17 70 64 00 00 EE")
    with pytest.raises(LocalProtocolError, match=r"8\.2 A is outside the range -8\.192 to 8\.19175 A"):
        writer.write({"command": 8.2, "enable": 2})
    for broken in (math.nan, math.inf):
        with pytest.raises(LocalProtocolError, match="Target"):
            writer.write({"command": broken, "enable": 0})
    with pytest.raises(LocalProtocolError, match="not a finite number"):
        Signal("F", 0, 32, is_float=True).raw(math.inf)


def test_bits_are_put_and_taken_without_touching_their_neighbours() -> None:
    data = bytearray(b"\xff" * 3)
    put(data, Signal("B", 11, 8, big_endian=True), 0x5A)
    assert data == bytes.fromhex("FF F5 AF")
    assert take(data, Signal("B", 11, 8, big_endian=True)) == 0x5A


DBC = """VERSION ""
BU_: A
BO_ 1 M: 8 A
 SG_ X : %d|%d@%d%s (%s,%s) [0|0] "" A
"""


@settings(deadline=None, max_examples=80)
@given(st.data())
def test_any_signal_means_the_same_to_cantools(data: st.DataObject) -> None:
    big, signed = data.draw(st.booleans()), data.draw(st.booleans())
    length = data.draw(st.integers(2, 40))
    first = data.draw(st.integers(0, 63 - length))
    # The most significant bit of a big-endian number that begins `first` bits into the frame.
    start = 8 * (first // 8) + 7 - first % 8 if big else first
    frame = data.draw(st.binary(min_size=8, max_size=8))
    database = Database()
    database.add_dbc_string(DBC % (start, length, not big, "-" if signed else "+", "0.5", "-3"))
    theirs = database.messages[0].decode(frame)["X"]
    signal = Signal("X", start, length, big, signed, scale=0.5, offset=-3.0)
    ours = FrameReader(8, {"x": Placed(signal)}).read(frame)["x"]
    assert ours == theirs
    sent = FrameWriter(8, [], {"x": Placed(signal)}).write({"x": ours})
    assert database.messages[0].decode(bytes(sent))["X"] == theirs
    assert len(signal.bits(8)) == length
