"""CAN frames as ASCII lines."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.errors import LocalProtocolError
from protocols.slcan import SlcanDecoder, encode_fd_frame, encode_frame

STREAM = b"\rz\rt12082713DC0500000000\rT1ABCDEF02A1B2\r\x07t12200001\rr1218\rR000001214\rV1013\rt123011234\r"
FRAMES = [
    (0x120, bytes.fromhex("2713DC0500000000"), False, False, 8),
    (0x1ABCDEF0, b"\xa1\xb2", True, False, 2),
    (0x122, b"", False, False, 0),
    (0x121, b"", False, True, 8),
    (0x121, b"", True, True, 4),
]


@pytest.mark.parametrize("at", range(len(STREAM) + 1))
def test_every_split_point_gives_the_same_frames(at: int) -> None:
    decoder = SlcanDecoder()
    assert decoder.feed(STREAM[:at]) + decoder.feed(STREAM[at:]) == FRAMES
    assert (decoder.malformed, decoder.errors) == (1, 1)


def test_a_time_stamp_behind_the_data_is_allowed() -> None:
    assert SlcanDecoder().feed(b"t1232AABB1F2E\r") == [(0x123, b"\xaa\xbb", False, False, 2)]


@pytest.mark.parametrize(
    "line",
    [
        b"t1209" + b"00" * 9, b"t1202AA", b"t1202AABBC", b"t12", b"tXYZ0", b"x1200", b"t12 0", b"t8000",
        b"T200000000", b"t1201G0", b"t1201 0",
    ],
)
def test_a_malformed_line_is_counted_and_gives_no_frame(line: bytes) -> None:
    decoder = SlcanDecoder()
    assert decoder.feed(line + b"\rt1230\r") == [(0x123, b"", False, False, 0)]
    assert decoder.malformed == 1


def test_a_line_without_end_is_given_up() -> None:
    decoder = SlcanDecoder()
    assert decoder.feed(b"t" * 200) == []
    assert decoder.malformed == 1
    assert decoder.feed(b"\rt1230\r") == [(0x123, b"", False, False, 0)]


def test_clear_forgets_the_unfinished_line() -> None:
    decoder = SlcanDecoder()
    decoder.feed(b"t1230")
    decoder.clear()
    assert decoder.feed(b"\r") == []


def test_frames_are_written_as_the_adapter_expects_them() -> None:
    assert encode_frame(0x120, bytes.fromhex("0013dc05")) == b"t12040013DC05\r"
    assert encode_frame(0x1ABCDEF0, b"\xa1", extended=True) == b"T1ABCDEF01A1\r"
    assert encode_frame(0x121, b"", remote=True, length=8) == b"r1218\r"
    assert encode_frame(0x121, b"", extended=True, remote=True, length=4) == b"R000001214\r"


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_what_is_encoded_is_decoded(identifier: int, data: bytes) -> None:
    assert SlcanDecoder().feed(encode_frame(identifier, data)) == [(identifier, data, False, False, len(data))]


@given(st.binary(max_size=300))
def test_any_bytes_never_crash_and_give_only_possible_frames(noise: bytes) -> None:
    for identifier, data, extended, remote, length in SlcanDecoder().feed(noise + b"\r"):
        assert identifier <= (0x1FFFFFFF if extended else 0x7FF)
        assert len(data) == (0 if remote else length) <= 8


@pytest.mark.parametrize(("identifier", "data"), [(0x800, b""), (-1, b""), (0x123, bytes(9))])
def test_what_no_frame_can_carry_is_our_own_error(identifier: int, data: bytes) -> None:
    with pytest.raises(LocalProtocolError, match="not a classic CAN frame"):
        encode_frame(identifier, data)


def test_can_fd_frames_have_lengths_by_code_and_their_own_letters() -> None:
    data = bytes(range(12))
    assert encode_fd_frame(0x123, data) == b"d1239000102030405060708090A0B\r"
    assert encode_fd_frame(0x18FF2100, bytes(64), extended=True, switched=True) == b"B18FF2100F" + b"00" * 64 + b"\r"
    lines = b"d1239000102030405060708090A0B\rb7FF0\rD000000012ABCD\r"
    assert SlcanDecoder().feed(lines) == [
        (0x123, data, False, False, 12), (0x7FF, b"", False, False, 0), (1, b"\xab\xcd", True, False, 2),
    ]  # fmt: skip
    wrong = SlcanDecoder()
    assert wrong.feed(b"t1239000102030405060708090A0B\rd1239000102\r") == []
    assert wrong.malformed == 2
    with pytest.raises(LocalProtocolError, match="13 bytes is not a CAN FD frame"):
        encode_fd_frame(1, bytes(13))
