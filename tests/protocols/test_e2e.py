"""Protected frames: examples of the standard, a check bit by bit, and the package autosar-e2e as a peer."""

import pytest
from e2e import p01, p02, p05, p11
from hypothesis import given, settings
from hypothesis import strategies as st

from protocols.can_signals import Signal
from protocols.e2e import (
    Covered,
    Crc,
    Protection,
    checked,
    counted,
    profile_1,
    profile_2,
    profile_5,
    profile_11,
)

CRC, COUNTER, NIBBLE = Signal("CRC", 0, 8), Signal("Counter", 8, 4), Signal("Nibble", 12, 4)
CRC16, COUNTER8 = Signal("CRC", 0, 16), Signal("Counter", 16, 8)
MODES_1 = {"both": p01.E2E_P01_DATAID_BOTH, "alt": p01.E2E_P01_DATAID_ALT, "low": p01.E2E_P01_DATAID_LOW,
           "nibble": p01.E2E_P01_DATAID_NIBBLE}  # fmt: skip
MODES_11 = {"both": p11.E2E_P11_DATAID_BOTH, "nibble": p11.E2E_P11_DATAID_NIBBLE}


def by_hand(data: bytes, width: int, polynomial: int, initial: int, final: int) -> int:
    """The textbook's division, one bit after the other."""
    register = initial
    for byte in data:
        for place in range(7, -1, -1):
            carry = register >> width - 1 ^ byte >> place & 1
            register = register << 1 & (1 << width) - 1
            if carry & 1:
                register ^= polynomial
    return register ^ final


def sealed(protection: Protection, counter: int, size: int = 8, payload: bytes = b"") -> bytes:
    data = bytearray(payload.ljust(size, b"\0"))
    protection.seal(data, counter)
    return bytes(data)


def test_the_standards_examples_data_id_0x123_over_zeros() -> None:
    # PRS_E2EProtocol, examples of the profiles 1 and 11 (counter 0, then 1), 2 (ids 1..16) and 5 (id 0x1234).
    assert sealed(profile_1(0x123, COUNTER, CRC), 0) == bytes.fromhex("CC 00 00 00 00 00 00 00")
    assert sealed(profile_1(0x123, COUNTER, CRC), 1) == bytes.fromhex("91 01 00 00 00 00 00 00")
    assert sealed(profile_1(0x123, COUNTER, CRC, "nibble", NIBBLE), 0) == bytes.fromhex("2A 10 00 00 00 00 00 00")
    assert sealed(profile_11(0x123, COUNTER, CRC), 0) == bytes.fromhex("CC 00 00 00 00 00 00 00")
    assert sealed(profile_11(0x123, COUNTER, CRC, "nibble", NIBBLE), 1) == bytes.fromhex("77 11 00 00 00 00 00 00")
    assert sealed(profile_2(range(1, 17), COUNTER, CRC), 1) == bytes.fromhex("1B 01 00 00 00 00 00 00")
    assert sealed(profile_5(0x1234, COUNTER8, CRC16), 0) == bytes.fromhex("1C CA 00 00 00 00 00 00")


@pytest.mark.parametrize(("counter", "known"), [(4, "21"), (5, "A7")])
def test_profile_1_in_mode_alt_covers_one_byte_of_the_data_id(counter: int, known: str) -> None:
    frame = sealed(profile_1(0xA721, COUNTER, CRC, "alt"), counter, payload=bytes(range(8)))
    assert frame[0] == by_hand(bytes.fromhex(known) + frame[1:], 8, 0x1D, 0, 0)


def test_a_checksum_in_the_middle_covers_what_is_before_and_behind_it() -> None:
    frame = sealed(profile_1(0x0102, Signal("Counter", 24, 4), Signal("CRC", 16, 8)), 3, payload=b"\x11\x22\0\0\x55")
    assert frame[3] & 0xF == 3
    assert frame[2] == by_hand(b"\x02\x01" + frame[:2] + frame[3:], 8, 0x1D, 0, 0)


@settings(deadline=None, max_examples=60)
@given(
    st.binary(min_size=8, max_size=32), st.integers(0, 0xFFF), st.integers(0, 14), st.binary(min_size=16, max_size=16)
)
def test_the_peer_accepts_every_profile(payload: bytes, data_id: int, counter: int, ids: bytes) -> None:
    size = len(payload)
    for mode, peer in MODES_1.items():
        made = profile_1(data_id, COUNTER, CRC, mode, NIBBLE if mode == "nibble" else None)
        assert p01.e2e_p01_check(bytearray(sealed(made, counter, size, payload)), data_id, data_id_mode=peer)
    for mode, peer in MODES_11.items():
        made = profile_11(data_id, COUNTER, CRC, mode, NIBBLE if mode == "nibble" else None)
        assert p11.e2e_p11_check(bytearray(sealed(made, counter, size, payload)), data_id, data_id_mode=peer)
    assert p02.e2e_p02_check(sealed(profile_2(ids, COUNTER, CRC), counter, size, payload), ids, length=size)
    assert p05.e2e_p05_check(sealed(profile_5(data_id, COUNTER8, CRC16), counter, size, payload), data_id)


# Check values over the text 123456789, from the catalogue of parametrised CRC algorithms.
@pytest.mark.parametrize(
    ("crc", "check"),
    [
        (Crc(8, 0x1D, 0xFF, 0xFF), 0x4B), (Crc(8, 0x2F, 0xFF, 0xFF), 0xDF), (Crc(8, 0x07), 0xF4),
        (Crc(8, 0x31, 0, 0, reflected=True), 0xA1), (Crc(16, 0x1021, 0xFFFF), 0x29B1),
        (Crc(16, 0x8005, 0xFFFF, 0, reflected=True), 0x4B37), (Crc(32, 0x04C11DB7, 0xFFFFFFFF, 0xFFFFFFFF), 0xFC891918),
        (Crc(32, 0x04C11DB7, 0xFFFFFFFF, 0xFFFFFFFF, reflected=True), 0xCBF43926),
    ],
)
def test_a_checksum_of_ones_own_gives_the_catalogues_check_value(crc: Crc, check: int) -> None:
    assert crc.function()(b"123456789") == check


def test_a_checksum_of_ones_own_covers_a_data_id_before_or_behind_and_a_part_of_the_frame() -> None:
    at = range(7, 8)
    front, behind = Covered(0x1234), Covered(0x12, 1, id_first=False, first_byte=2, last_byte=5)
    frame = bytes(range(8))
    assert front.of(8, at)(frame) == b"\x34\x12" + frame[:7]
    assert behind.of(8, at)(frame) == frame[2:6] + b"\x12"
    made = checked(COUNTER, 0, Signal("CRC", 56, 8), Crc(8, 0x07, 0x5A, 0xA5), front.of(8, at))
    sent = sealed(made, 9)
    assert sent[7] == by_hand(b"\x34\x12" + sent[:7], 8, 0x07, 0x5A, 0xA5)


def test_counters_start_again_where_their_profile_says_and_beyond_is_not_valid() -> None:
    one = profile_1(0x123, COUNTER, CRC)
    assert [one.count(sealed(one, count)) for count in (0, 14, 15, 16)] == [0, 14, 0, 1]
    assert one.count(bytes([0, 0x0F, 0, 0])) == -2
    assert profile_2(range(16), COUNTER, CRC).count(bytes([0, 0x0F])) == 15
    assert [counted(COUNTER, 10).count(bytes([0, count])) for count in (9, 10)] == [9, -2]
    assert Protection().count(bytes(8)) == -1


def test_another_data_id_is_wrong_by_the_same_bits_in_every_frame() -> None:
    ours, theirs = profile_1(0x120, COUNTER, CRC), profile_1(0x121, COUNTER, CRC)
    frames = [sealed(theirs, count, payload=bytes([0, 0, count * 7, 3])) for count in range(9)]
    assert len({ours.difference(frame) for frame in frames}) == 1
    assert {theirs.difference(frame) for frame in frames} == {0}


def test_the_data_ids_that_fit_frames_of_the_standard_are_found() -> None:
    """A checksum of 16 bits leaves one of 65536, one of 8 bits 256, one that covers the low byte alone one of 4096."""
    first, second = bytes.fromhex("CC 00 00 00 00 00 00 00"), bytes.fromhex("91 01 00 00 00 00 00 00")
    fitting = profile_1(0x7, COUNTER, CRC).fitting_ids([first, second])
    assert (len(fitting), 0x123 in fitting) == (256, True)
    nibble = bytes.fromhex("2A 10 00 00 00 00 00 00")
    assert profile_1(0x7, COUNTER, CRC, "nibble", NIBBLE).fitting_ids([nibble]) == [0x123]
    assert profile_11(0x7, COUNTER, CRC, "nibble", NIBBLE).fitting_ids([nibble]) == [0x123]
    assert profile_5(0x7, COUNTER8, CRC16).fitting_ids([bytes.fromhex("1C CA 00 00 00 00 00 00")]) == [0x1234]
    assert profile_2(range(1, 17), COUNTER, CRC).fitting_ids([first]) == []
    assert profile_1(0x7, COUNTER, CRC).fitting_ids([first, bytes(8)]) == []
