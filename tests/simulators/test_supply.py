"""The simulated supply, from its wire: it speaks what a description says, and drives the plant's coil."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from drivers.devices.supply_file import supply, supply_names
from protocols.patterns import Pattern
from protocols.scpi import number_in
from simulators.clock import DeviceClock
from simulators.ecu import Ecu
from simulators.options import RigOptions
from simulators.plant.plant import Plant
from simulators.supply import SimulatedSupply, number_like, pattern_of, simulated_supply

OWN = """
settling_ms = 200
[range]
current_A = [0, 5]
voltage_V = [0, 30]
[commands]
identify = "*IDN?"
set_current = "ISET1:{current_mA:.0f}"
set_voltage_limit = "VSET1:{voltage_V:.2f}"
output_on = "OUT1"
output_off = "OUT0"
measure_current = "IOUT1?"
measure_voltage = "VOUT1?"
read_output = "OUT?"
error_queue = "ERR?"
read_faults = "STAT?"
[answers]
current = '^I (?P<value>[-+0-9.]+)$'
on = ["ON"]
[faults]
over-temperature = 4
[watchdog]
time_s = 2.0
start = "WDOG {time_ms:.0f}"
"""


@pytest.fixture
def rig() -> tuple[Plant, SimulatedSupply]:
    options = RigOptions()
    plant = Plant(options)
    ecu = Ecu(plant, options.coil, 23.0, DeviceClock(0.0, 0.0), np.random.default_rng(0), lambda what, value: None)
    made = simulated_supply(ecu, tomllib.loads(OWN), 7)
    assert made is not None
    return plant, made


def settle(plant: Plant) -> None:
    for _ in range(40):
        plant.advance(80)


def test_the_coil_follows_set_point_and_switch(rig: tuple[Plant, SimulatedSupply]) -> None:
    plant, source = rig
    assert source.line("ISET1:1500") is None
    settle(plant)
    assert plant.value("current_A") == pytest.approx(0.0, abs=1e-3), "the output is off"
    source.line("OUT1")
    settle(plant)
    assert plant.value("current_A") == pytest.approx(1.5, abs=0.01)
    assert str(source.line("IOUT1?")).startswith("I 1.")
    assert source.line("OUT?") == "ON"
    source.line("OUT0")
    settle(plant)
    assert abs(plant.value("current_A")) < 0.01


def test_what_it_does_not_know_or_give_stands_in_its_error_queue(rig: tuple[Plant, SimulatedSupply]) -> None:
    _, source = rig
    source.line("ISET1:9000")
    source.line("CURR 1")
    assert [source.line("ERR?") for _ in range(3)] == [
        '-222,"Data out of range"', '-113,"Undefined header"', '+0,"No error"',
    ]


def test_its_own_time_out_switches_it_off(rig: tuple[Plant, SimulatedSupply]) -> None:
    _, source = rig
    source.tick(0.0)
    for line in ("WDOG 2000", "ISET1:1000", "OUT1"):
        source.line(line)
    source.tick(1.9)
    assert source.on
    source.tick(2.1)
    assert not source.on
    assert not source.stays_on


def test_heat_shows_in_its_bits_and_at_its_output(rig: tuple[Plant, SimulatedSupply]) -> None:
    _, source = rig
    source.line("ISET1:1000")
    source.line("OUT1")
    source.ecu.faults.over_temperature = True
    source.ecu.tick(0.1)
    assert (source.line("STAT?"), source.line("OUT?")) == ("16", "0")


@pytest.mark.parametrize("text", ["CURR {current_A:.3f}", "curr {current_A}", "I1={current_mA:.0f};X"])
def test_a_command_is_known_whatever_number_stands_in_it(text: str) -> None:
    line = text.replace("{current_A:.3f}", "+1.5E0").replace("{current_A}", "1.5").replace("{current_mA:.0f}", "1500")
    assert pattern_of(text).fullmatch(line)
    assert not pattern_of(text).fullmatch(line + "x")


def test_an_answer_looks_as_the_description_says() -> None:
    assert number_like(1.5, None) == "+1.50000E+00"
    assert number_like(1.5, Pattern(r"^(?P<value>[-+0-9.]+)A$")) == "1.50000A"
    assert number_like(1.5, Pattern(r"MC: (?P<value>[-+0-9.]+) A")) == "MC: 1.50000 A"


@pytest.mark.parametrize("name", supply_names())
def test_every_preset_is_spoken_by_the_simulated_supply(name: str) -> None:
    """Each command is one it knows, each answer one that its description knows."""
    options = RigOptions()
    ecu = Ecu(
        Plant(options), options.coil, 23.0, DeviceClock(0.0, 0.0), np.random.default_rng(0), lambda what, value: None
    )
    source, described = simulated_supply(ecu, name, 7), supply(name)
    assert source is not None
    commands = described.commands
    commands_sent = (*commands.connect, *commands.remote, *commands.prepare, *commands.clear,
            *commands.set_voltage_limit,
            *commands.set_current, *commands.output_on)  # fmt: skip
    assert [source.line(command.line(1.0, 5.0).decode()) for command in commands_sent] == [None] * len(commands_sent)
    assert (source.current_A, source.limit_V, source.on) == (1.0, 5.0, True)
    queries = {
        field: source.line(command.text) or ""
        for field in ("identify", "measure_current", "read_output", "error_queue")
        for command in getattr(commands, field)
    }
    assert described.identity is None or described.identity.search(queries["identify"])
    assert number_in(queries["measure_current"], described.current) == pytest.approx(0.0, abs=0.02)
    assert queries["read_output"] in described.on
    assert described.no_error.search(queries.get("error_queue", "0"))
