"""The 16-byte sensor frame: golden bytes, any split of the stream, damage, fuzz."""

import math
import struct
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.errors import LocalProtocolError
from protocols.frame_format import SIZE, STATUS_EDGE, FrameDecoder, encode

GOLDEN = tomllib.loads((Path(__file__).parents[1] / "golden" / "frame16.toml").read_text())["frame"]
STREAM = b"".join(bytes.fromhex(frame["bytes"]) for frame in GOLDEN)
READINGS = [tuple(frame["reading"]) for frame in GOLDEN]

readings = st.tuples(
    st.integers(0, 0xFFFF), st.integers(0, 0xFFFFFFFF), st.floats(width=32), st.integers(0, 255), st.integers(0, 255)
)


def same(left: object, right: object) -> bool:
    """Equal, NaN equal to NaN."""
    return repr(left) == repr(right)


@pytest.mark.parametrize("frame", GOLDEN, ids=lambda frame: frame["name"])
def test_golden_bytes_decode_and_encode(frame: dict[str, Any]) -> None:
    wire = bytes.fromhex(frame["bytes"])
    sequence, device_us, value, status, edge_count = frame["reading"]
    assert encode(value, sequence, device_us, status, edge_count) == wire
    assert FrameDecoder().feed(wire) == [tuple(frame["reading"])]


@pytest.mark.parametrize("at", range(len(STREAM) + 1))
def test_every_split_point_gives_the_same_readings(at: int) -> None:
    decoder = FrameDecoder()
    assert decoder.feed(STREAM[:at]) + decoder.feed(STREAM[at:]) == READINGS
    assert decoder.skipped_bytes == 0
    assert decoder.bad_frames == 0


def test_byte_by_byte_gives_the_same_readings() -> None:
    decoder = FrameDecoder()
    assert [reading for byte in STREAM for reading in decoder.feed(bytes([byte]))] == READINGS


@pytest.mark.parametrize("damaged", range(SIZE))
def test_one_damaged_byte_costs_exactly_one_frame(damaged: int) -> None:
    wire = bytearray(STREAM)
    wire[SIZE + damaged] ^= 0x01
    decoder = FrameDecoder()
    assert decoder.feed(bytes(wire)) == [READINGS[0], *READINGS[2:]]
    assert decoder.skipped_bytes == SIZE
    assert decoder.bad_frames == (0 if damaged < 2 else 1)


@pytest.mark.parametrize("lost", range(SIZE))
def test_one_lost_byte_costs_exactly_one_frame(lost: int) -> None:
    decoder = FrameDecoder()
    assert decoder.feed(STREAM[: SIZE + lost] + STREAM[SIZE + lost + 1 :]) == [READINGS[0], *READINGS[2:]]


def test_a_sync_word_inside_garbage_does_not_swallow_the_frame_behind_it() -> None:
    decoder = FrameDecoder()
    assert decoder.feed(b"\xa5\x5a\xa5" + STREAM) == READINGS
    assert (decoder.bad_frames, decoder.skipped_bytes) == (1, 3)


def test_a_sync_byte_at_the_end_of_garbage_is_kept_for_the_next_chunk() -> None:
    decoder = FrameDecoder()
    assert decoder.feed(bytes(40) + STREAM[:1]) == []
    assert decoder.feed(STREAM[1:]) == READINGS
    assert decoder.skipped_bytes == 40


def test_clear_forgets_the_unfinished_frame() -> None:
    decoder = FrameDecoder()
    decoder.feed(STREAM[:7])
    decoder.clear()
    assert decoder.feed(STREAM) == READINGS
    assert decoder.skipped_bytes == 0


@given(st.lists(readings, max_size=20), st.lists(st.integers(1, 40), max_size=30))
def test_what_is_encoded_is_decoded_whatever_the_chunks(
    values: list[tuple[int, int, float, int, int]], cuts: list[int]
) -> None:
    wire = b"".join(encode(v, n, t, s, e) for n, t, v, s, e in values)
    decoder = FrameDecoder()
    got = []
    for cut in [*cuts, len(wire)]:
        got += decoder.feed(wire[:cut])
        wire = wire[cut:]
    got += decoder.feed(wire)
    assert same(got, values)


@given(st.binary(max_size=400), st.integers(0, 400))
def test_random_bytes_never_crash_and_never_make_a_reading(noise: bytes, at: int) -> None:
    decoder = FrameDecoder()
    got = decoder.feed(noise[:at]) + decoder.feed(noise[at:])
    # A reading may only come from 16 bytes that encode to themselves.
    for sequence, device_us, value, status, edge_count in got:
        if not math.isnan(value):
            assert encode(value, sequence, device_us, status, edge_count) in noise


@given(st.binary(max_size=200))
def test_a_stream_is_found_again_behind_any_garbage(noise: bytes) -> None:
    decoder = FrameDecoder()
    got = decoder.feed(noise + STREAM + STREAM)
    assert got[-len(READINGS) :] == READINGS


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("sequence", 65536), ("sequence", -1), ("device_us", 1 << 32), ("status", 256), ("edge_count", 256),
        ("value", 1e39),
    ],
)
def test_a_value_that_does_not_fit_is_our_own_error(field: str, value: float) -> None:
    fields = {"value": 0.0, "sequence": 0, "device_us": 0} | {field: value}
    with pytest.raises(LocalProtocolError, match="frame16"):
        encode(**fields)


def test_not_a_number_travels_as_it_is() -> None:
    (reading,) = FrameDecoder().feed(encode(math.nan, 1, 2, STATUS_EDGE))
    assert math.isnan(reading[2])
    assert struct.calcsize("<2sBBHIfH") == SIZE
