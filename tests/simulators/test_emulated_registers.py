"""Recipes and registers from the device's side: words worked out by hand, commands known by what is written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drivers.register_maps.map_file import controller
from drivers.register_maps.quantity import Quantity
from drivers.roles import Command
from rig.files.descriptions import table_of
from simulators.actuator import Actuator
from simulators.clock import DeviceClock
from simulators.emulated_bench import appearing_as
from simulators.emulated_codec import bits_of, raw_of, text_words, value_of, words_of
from simulators.emulated_commands import Scripts, scripts_of
from simulators.emulated_registers import registers_of
from simulators.options import RigOptions
from simulators.plant.plant import Plant
from simulators.registers import RegisterBank

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
    worn = controller(table_of("register-map", MAPS / "handshake.toml"))
    scripts = Scripts(scripts_of(worn.recipes.commands), lambda quantity, value: raw_of(quantity, float(value)))
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


def test_the_rigs_own_map_as_a_file_shows_and_takes_the_same_registers() -> None:
    demo = Path(__file__).parents[2] / "drivers" / "devices" / "demo_controller.toml"
    worn, own = registers(appearing_as(RigOptions(), str(demo))), registers(RigOptions())
    # ACQUIRE as number 5 by owner 9, the whole command block
    for bank in (worn, own):
        assert bank.write(300, [1, 5, 9, *[0] * 21]) is True
        assert bank.write(350, [77]) is True
    read = [bank.read(100, 34) for bank in (worn, own)]
    assert read[0] == read[1]
    assert read[0] is not None
    assert read[0][18:23] == [5, 1, 1, 9, 77]
    assert worn.read(0, 38) == own.read(0, 38)
    assert worn.read(200, 16) == own.read(200, 16)
