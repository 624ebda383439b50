"""Modbus frames and answers, by bytes from the specification."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols import modbus
from protocols.errors import RemoteProtocolError

READ = modbus.read_request(107, 3)
WRITE = modbus.write_request(1, [10, 258])


def test_requests_are_the_bytes_of_the_specification() -> None:
    assert modbus.read_request(107, 3) == bytes.fromhex("03 006B 0003")
    assert modbus.write_request(1, [10, 258]) == bytes.fromhex("10 0001 0002 04 000A 0102")
    assert modbus.exchange_request(3, 6, 14, [255, 255]) == bytes.fromhex("17 0003 0006 000E 0002 04 00FF 00FF")


def test_requests_of_single_registers_and_of_coils_are_the_bytes_of_the_specification() -> None:
    """The examples of MODBUS Application Protocol V1.1b3, 6.1, 6.5, 6.6 and 6.11."""
    assert modbus.read_request(19, 19, 1) == bytes.fromhex("01 0013 0013")
    assert modbus.write_request(172, [1], 5) == bytes.fromhex("05 00AC FF00")
    assert modbus.write_request(1, [3], 6) == bytes.fromhex("06 0001 0003")
    coils = [1, 0, 1, 1, 0, 0, 1, 1, 1, 0]
    assert modbus.write_request(19, coils, 15) == bytes.fromhex("0F 0013 000A 02 CD 01")
    answer = bytes.fromhex("01 03 CD 6B 05")
    states = modbus.decode_bits(modbus.read_request(19, 19, 1), answer, 19)
    assert states == [1, 0, 1, 1, 0, 0, 1, 1, 1, 1, 0, 1, 0, 1, 1, 0, 1, 0, 1], "coils 20 to 38"
    for wrong in (answer[:-1], answer + b"\0", b"\x01\x02" + answer[2:], b"\x02" + answer[1:]):
        with pytest.raises(RemoteProtocolError):
            modbus.decode_bits(modbus.read_request(19, 19, 1), wrong, 19)


def test_frames_are_the_bytes_of_the_specification() -> None:
    assert modbus.encode_tcp(0x1501, 0xFF, READ) == bytes.fromhex("1501 0000 0006 FF 03 006B 0003")
    assert modbus.encode_rtu(0x11, READ) == bytes.fromhex("11 03 006B 0003 7687")


def test_words_are_believed_only_whole() -> None:
    good = bytes.fromhex("03 06 022B 0000 0064")
    assert modbus.decode_words(READ, good, 3) == [0x22B, 0, 0x64]
    for wrong in (good[:-1], good + b"\0", b"\x03\x04" + good[2:6], b"\x03", b"", b"\x04" + good[1:], b"\x03\x01\x00"):
        with pytest.raises(RemoteProtocolError):
            modbus.decode_words(READ, wrong, 3)


def test_an_answer_to_a_function_is_unknown_is_not_believed() -> None:
    with pytest.raises(RemoteProtocolError, match="cannot be decoded"):
        modbus.decode_words(bytes.fromhex("6A 006B 0001"), bytes.fromhex("6A 02 022B"), 1)


def test_a_write_is_acknowledged_only_by_its_own_address_and_count() -> None:
    modbus.check_written(WRITE, bytes.fromhex("10 0001 0002"))
    for wrong in ("10 0002 0002", "10 0001 0001", "10 0001 0002 00", "03 0001 0002", "10"):
        with pytest.raises(RemoteProtocolError):
            modbus.check_written(WRITE, bytes.fromhex(wrong))


def test_a_refusal_names_its_code() -> None:
    assert modbus.refusal(READ, b"\x83\x06") == modbus.BUSY
    assert modbus.refusal(READ, b"\x84\x06") is None
    assert modbus.refusal(READ, b"\x83") is None


@given(st.lists(st.integers(0, 65535), min_size=1, max_size=20), st.data())
def test_tcp_frames_are_cut_at_any_split_of_the_stream(transactions: list[int], data: st.DataObject) -> None:
    stream = b"".join(modbus.encode_tcp(number, 1, READ) for number in transactions)
    frames, seen, at = modbus.TcpFrames(), [], 0
    while at < len(stream):
        size = data.draw(st.integers(1, len(stream) - at))
        frames.feed(stream[at : at + size])
        at += size
        while (frame := frames.next()) is not None:
            seen.append(frame)
    assert seen == [(number, 1, READ) for number in transactions]


@pytest.mark.parametrize("header", ["0001 0001 0006 01", "0001 0000 0001 01", "0001 0000 00FF 01"])
def test_a_stream_that_is_not_modbus_is_reported(header: str) -> None:
    frames = modbus.TcpFrames()
    frames.feed(bytes.fromhex(header))
    with pytest.raises(RemoteProtocolError, match="invalid Modbus header"):
        frames.next()


@pytest.mark.parametrize(
    ("head", "size"),
    [("", None), ("11", None), ("11 03", None), ("11 03 06", 11), ("11 83", 5), ("11 83 02 00", 5)],
)
def test_the_request_says_how_long_an_answer_is(head: str, size: int | None) -> None:
    assert modbus.rtu_answer_size(bytes.fromhex(head), READ) == size


def test_another_functions_answer_has_no_length_here() -> None:
    assert modbus.rtu_answer_size(b"\x11\x10", WRITE) == 8
    with pytest.raises(RemoteProtocolError, match="function 4"):
        modbus.rtu_answer_size(b"\x11\x04", READ)


def test_an_rtu_frame_is_taken_only_with_its_checksum() -> None:
    frame = modbus.encode_rtu(17, bytes.fromhex("03 02 1234"))
    assert modbus.decode_rtu(frame) == (17, bytes.fromhex("03 02 1234"))
    for index in range(len(frame)):
        damaged = bytearray(frame)
        damaged[index] ^= 0x01
        with pytest.raises(RemoteProtocolError, match="checksum"):
            modbus.decode_rtu(bytes(damaged))
    with pytest.raises(RemoteProtocolError, match="4 bytes"):
        modbus.decode_rtu(frame[:4])


@given(pdu=st.binary(max_size=60), count=st.integers(1, 30))
def test_any_bytes_give_words_or_an_error(pdu: bytes, count: int) -> None:
    try:
        words = modbus.decode_words(READ, pdu, count)
    except RemoteProtocolError:
        return
    assert len(words) == count
