"""Register maps as data: word order, scale, text, contradictions, fuzz."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.errors import LocalProtocolError, RemoteProtocolError
from simulators.register_blocks import Block, Register, RegisterMap

REGISTERS = (
    Register(10, "whole", "u32"),
    Register(12, "signed", "i32"),
    Register(14, "short", "i16", "degC", scale=0.1),
    Register(16, "real", "f32", "m", scale=0.001),
    Register(18, "text", "string", length=2),
)
BIG = Block("b", REGISTERS)
LITTLE = Block("b", REGISTERS, word_order="little")
VALUES = {"whole": 0x01020304, "signed": -2, "short": -12.5, "real": 0.0015, "text": "abc"}
# 1.5 is 0x3FC00000; address 15 is covered by no register.
BIG_WORDS = [0x0102, 0x0304, 0xFFFF, 0xFFFE, 0xFF83, 0, 0x3FC0, 0x0000, 0x6162, 0x6300]
LITTLE_WORDS = [0x0304, 0x0102, 0xFFFE, 0xFFFF, 0xFF83, 0, 0x0000, 0x3FC0, 0x6162, 0x6300]


@pytest.mark.parametrize(("block", "words"), [(BIG, BIG_WORDS), (LITTLE, LITTLE_WORDS)], ids=["big", "little"])
def test_word_order_moves_words_of_numbers_and_not_of_text(block: Block, words: list[int]) -> None:
    assert block.encode(VALUES) == words
    assert block.decode(words) == pytest.approx(VALUES)


def test_what_is_not_named_is_written_as_zero() -> None:
    assert BIG.encode({"signed": 1}) == [0, 0, 0, 1, 0, 0, 0, 0, 0, 0]


def test_whole_numbers_stay_whole() -> None:
    assert type(BIG.decode(BIG_WORDS)["whole"]) is int


@given(st.lists(st.integers(0, 0xFFFF), min_size=10, max_size=10))
def test_any_words_decode_or_are_refused(words: list[int]) -> None:
    for block in (BIG, LITTLE):
        try:
            values = block.decode(words)
        except RemoteProtocolError as error:
            assert "not ASCII" in str(error)  # noqa: PT017 - refusing is one of two right outcomes
            continue
        assert values["whole"] in range(1 << 32)


@pytest.mark.parametrize("words", [[0] * 9, [0] * 11, [*[0] * 9, 65536], [*[0] * 9, -1]])
def test_words_that_do_not_make_the_block_are_the_peers_error(words: list[int]) -> None:
    with pytest.raises(RemoteProtocolError, match="block 'b'"):
        BIG.decode(words)


def test_text_beyond_ascii_is_the_peers_error() -> None:
    with pytest.raises(RemoteProtocolError, match=r"'text'.*not ASCII"):
        BIG.decode([0] * 8 + [0xFFFF, 0])


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("whole", 1 << 32, "cannot hold 4294967296"),
        ("whole", -1, "cannot hold -1"),
        ("whole", 1.5, "not a whole number"),
        ("whole", "5", "text where a number belongs"),
        ("short", 3276.8, "cannot hold"),
        ("real", math.nan, "not a finite number"),
        ("real", 1e36, "cannot hold"),
        ("text", "abcde", "longer than 4 characters"),
        ("text", "ä", "cannot hold"),
        ("nothing", 1, "has no register 'nothing'; it has real, short, signed, text, whole"),
    ],
)
def test_a_value_that_does_not_fit_is_our_own_error(name: str, value: float | str, message: str) -> None:
    with pytest.raises(LocalProtocolError, match=message):
        BIG.encode({name: value})


def test_a_whole_number_given_as_float_fits() -> None:
    assert BIG.encode({"whole": 3.0})[1] == 3


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Register(0, "r", "f64"), "type 'f64' is not one of"),
        (lambda: Register(0, "r", "string"), "needs length >= 1"),
        (lambda: Register(65535, "r", "u32"), "outside 0..65535"),
        (lambda: Register(-1, "r", "u16"), "outside 0..65535"),
        (lambda: Register(0, "r", "u16", scale=0.0), "not a usable factor"),
        (lambda: Register(0, "r", "u16", scale=math.nan), "not a usable factor"),
        (lambda: Block("b", ()), "has no registers"),
        (lambda: Block("b", REGISTERS, word_order="middle"), "word_order 'middle'"),
        (lambda: Block("b", (Register(0, "a", "u32"), Register(1, "c", "u16"))), "overlaps"),
        (lambda: RegisterMap("m", (BIG, BIG)), "block 'b' is given twice"),
        (lambda: RegisterMap("m", (BIG, Block("c", (Register(15, "x", "u32"),)))), "'x' and 'real' both use 16"),
        (lambda: RegisterMap("m", (BIG,)).block("c"), "has no block 'c'; it has b"),
        (lambda: RegisterMap("m", (BIG,)).register("c"), "has no register 'c'"),
    ],
)
def test_a_contradictory_map_is_refused_with_its_reason(make: Callable[[], object], message: str) -> None:
    with pytest.raises(LocalProtocolError, match=message):
        make()


def test_a_register_is_found_by_name_in_any_block() -> None:
    other = Block("c", (Register(0, "first", "u16"),))
    assert RegisterMap("m", (other, BIG)).register("real").address == 16
