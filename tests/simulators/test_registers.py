"""Recipes and registers from the device's side: words worked out by hand, commands known by what is written."""

from __future__ import annotations

import math
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from drivers.register_maps.map_file import controller
from drivers.register_maps.quantity import Quantity
from drivers.roles import Command, Result
from rig.files.descriptions import table_of
from simulators.actuator import Actuator
from simulators.clock import DeviceClock
from simulators.emulated_bench import appearing_as
from simulators.emulated_codec import bits_of, raw_of, text_words, value_of, words_of
from simulators.emulated_commands import Scripts, scripts_of
from simulators.options import RigOptions
from simulators.plant.plant import Plant
from simulators.registers import RegisterBank, registers_of

MAPS = Path(__file__).parent / "maps"


def registers(options: RigOptions) -> RegisterBank:
    actuator = Actuator(Plant(options), options.controller, DeviceClock(0.0, 0.0), lambda *_: None)
    return registers_of(actuator, options, np.random.default_rng(3))


@pytest.mark.parametrize(
    ("kind", "unit", "order", "value", "words"),
    [
        # -12.34 mm in steps of 0.01 mm: -1234 = 0xFB2E
        ("i16", (0.01, 1e-3), ("big", "big"), -0.01234, [0xFB2E]),
        ("i16", (0.01, 1e-3), ("big", "little"), -0.01234, [0x2EFB]),
        # 70000 um = 0x00011170
        ("u32", (1.0, 1e-6), ("big", "big"), 0.07, [0x0001, 0x1170]),
        ("u32", (1.0, 1e-6), ("little", "big"), 0.07, [0x1170, 0x0001]),
        # 12.5 = 0x41480000, 3.14 = 0x40091EB851EB851F
        ("f32", (1.0, 1e-3), ("little", "big"), 0.0125, [0x0000, 0x4148]),
        ("f64", (1.0, 1.0), ("big", "big"), 3.14, [0x4009, 0x1EB8, 0x51EB, 0x851F]),
    ],
)  # fmt: skip
def test_numbers_lie_in_registers_as_worked_out_by_hand(
    kind: str, unit: tuple[float, float], order: tuple[str, str], value: float, words: list[int]
) -> None:
    quantity = Quantity(
        "q", "holding", 10, kind, len(words), scale=unit[0], factor=unit[1], word_order=order[0], byte_order=order[1]
    )
    assert words_of(quantity, raw_of(quantity, value)) == words
    assert value_of(quantity, bits_of(quantity, words)) == pytest.approx(value)


def test_a_text_is_two_characters_a_register_and_padded() -> None:
    assert text_words(Quantity("q", "holding", 0, "string", 3), "SIM") == [0x5349, 0x4D00, 0]


def written(scripts: Scripts, **values: int) -> list[tuple[Command, bool]]:
    return [(seen.command, seen.decides) for seen in scripts.take(values)]


def test_a_command_is_known_by_its_constants_and_its_request_is_taken_back_without_another() -> None:
    emulated = controller(table_of("register-map", MAPS / "handshake.toml"))
    scripts = Scripts(scripts_of(emulated.recipes.commands), lambda quantity, value: raw_of(quantity, float(value)))
    assert written(scripts, p1=1, p2=2) == [(Command.MOVE_TO, False)]
    assert written(scripts, alive=1) == [], "not of a command"
    assert written(scripts, code=1) == []
    assert written(scripts, request=1) == [(Command.MOVE_TO, True)]
    assert written(scripts, request=0) == [(Command.MOVE_TO, False)]
    written(scripts, code=4)
    assert written(scripts, request=1) == [(Command.HALT, True)]
    assert written(scripts, pump=1) == [(Command.HYDRAULICS_ON, True)]
    assert written(scripts, pump=0) == [(Command.HYDRAULICS_OFF, True)]


def test_what_the_map_does_not_name_is_not_there() -> None:
    bank = registers(appearing_as(RigOptions(), str(MAPS / "streamed.toml")))
    assert bank.read(40, 8) is not None
    assert bank.read(48, 1) is None
    assert bank.read(40, 1, "input") is None
    assert bank.write(40, [0, 0]) is True, "nothing says that it is read only"
    assert bank.write(61, [1]) is None


def test_a_command_is_executed_once_when_its_number_is_written_with_all_else_as_the_registers_hold_it() -> None:
    bank = registers(RigOptions())
    # ACQUIRE as number 5 by owner 9, one register after the other; then the whole command block at once, as number 6
    for address, word in ((300, 1), (302, 9), (301, 5)):
        assert bank.write(address, [word]) is True
    assert bank.write(350, [77]) is True
    assert bank.read(118, 5) == [5, Result.DONE, Command.ACQUIRE, 9, 77]
    assert bank.write(300, [Command.HYDRAULICS_LOW, 6, 9, *[0] * 21]) is True
    assert bank.read(118, 3) == [6, Result.DONE, Command.HYDRAULICS_LOW]
    assert bank.write(300, [Command.RELEASE, 6]) is True
    assert bank.read(118, 4) == [6, Result.DONE, Command.HYDRAULICS_LOW, 9], "the same number again"


@pytest.mark.parametrize("name", ["demo", "demo-streamed"])
def test_a_number_with_a_command_that_the_map_does_not_have_is_refused(name: str) -> None:
    bank = registers(appearing_as(RigOptions(), name))
    for number, code in enumerate((11, 42, Command.NONE, Command.START), start=1):
        bank.write(300, [code, number, 3, *[0] * 21])
        refused = Result.REFUSED_OWNER if (name, code) == ("demo", Command.START) else Result.REFUSED_VALUE
        assert bank.read(118, 3) == [number, refused, code]


def test_a_program_without_a_frequency_is_refused() -> None:
    bank = registers(RigOptions())
    for number, (code, given) in enumerate(((1, []), (3, []), (4, []), (7, [0.01, 0.0, 0.0])), start=1):
        words = struct.unpack(f">{2 * len(given)}H", struct.pack(f">{len(given)}f", *given))
        bank.write(300, [code, number, 9, 0, 0, 0, 0, 0, *words, *[0] * (14 - len(words)), 10, 0])
        bank.actuator.plant.advance(100)
    assert bank.read(118, 3) == [4, Result.REFUSED_VALUE, Command.START]


def test_only_a_read_of_the_status_is_a_poll_and_draws_noise() -> None:
    banks = registers(RigOptions()), registers(RigOptions())
    for address, count in ((0, 38), (200, 16), (300, 24)):
        assert banks[0].read(address, count) is not None
    assert math.isnan(banks[0].polled_s)
    assert banks[0].read(100, 34) == banks[1].read(100, 34)
    assert not math.isnan(banks[0].polled_s)


def test_a_hash_of_the_limits_is_over_their_words_in_the_order_of_the_registers() -> None:
    bank = registers(RigOptions())
    words = bank.read(200, 16)
    assert words is not None
    total = zlib.crc32(b"".join(word.to_bytes(2, "big") for word in words))
    assert bank.read(8, 2) == [total >> 16, total & 0xFFFF]
