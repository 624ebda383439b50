"""Each driver states where its channels come from: true of the bytes that it reads."""

from __future__ import annotations

import struct

import pytest

from drivers.can_current_source import CanCurrentSource
from drivers.can_port import CanPort
from drivers.connection import CanAddress
from drivers.devices.source import current_source
from drivers.devices.supply import SupplyConnection
from drivers.devices.supply_file import supply
from drivers.manual_current import ManualCurrentSource
from drivers.origins import origins_of
from drivers.register_maps.map_file import controller
from drivers.register_maps.map_origins import map_origins
from drivers.register_maps.quantity import Quantity
from drivers.ring import Channel
from drivers.scpi_supply import ScpiSupply
from drivers.sensor_formats import wire_text


@pytest.mark.parametrize(("name", "position"), [
    ("demo", "value = float32, holding registers 106 to 107"),
    ("delta-rmc", "value = 0.001 * float32, holding registers 4112 to 4113"),
])
def test_a_map_states_the_registers_of_its_own_channels(name: str, position: str) -> None:
    origins = map_origins(controller(name))
    assert origins[Channel.POSITION].from_wire == position
    assert origins[Channel.STATE].from_wire.startswith("value = meaning")
    shown = Channel.SETPOINT in origins
    assert shown is ("setpoint" in controller(name).quantities)


def test_a_velocity_that_the_map_does_not_show_is_computed_here() -> None:
    from dataclasses import replace

    known = controller("demo")
    bare = replace(known, quantities={k: v for k, v in known.quantities.items() if k != "velocity"})
    origin = map_origins(bare)[Channel.VELOCITY]
    assert (origin.source, origin.long_name) == ("station", "Velocity computed from the controller's position")


@pytest.mark.parametrize(("scale", "offset", "kind", "words", "value"), [
    (1.0, 0.0, "f32", struct.unpack(">HH", struct.pack(">f", 1.5)), 1.5),
    (0.01, -3.0, "i16", (65036,), -0.008),
])
def test_the_statement_gives_the_value_that_is_decoded(
    scale: float, offset: float, kind: str, words: tuple[int, ...], value: float
) -> None:
    factor = 1e-3 if offset else 1.0
    quantity = Quantity("x", "input", 7, kind, length=len(words), scale=scale, offset=offset, factor=factor)
    assert quantity.decode(words) == pytest.approx(value)
    types = {"float32": 1.5, "int16": -500}
    stated = quantity.on_wire.partition(",")[0]
    assert eval(stated, {}, types) == pytest.approx(value)


def test_an_ecu_states_its_signals_and_an_operator_that_nothing_is_measured() -> None:
    ecu = CanCurrentSource(CanPort(CanAddress("virtual", "origins", 500_000), device="ecu"), current_source("demo"))  # type: ignore[arg-type]  # the demo is an ECU
    assert origins_of(ecu)[Channel.COIL_CURRENT].from_wire == "value = 0.001 * int16 CoilStatus.Current"
    reported = origins_of(ManualCurrentSource())[Channel.COIL_CURRENT]
    assert (reported.source, "not measured" in reported.long_name) == ("operator", True)
    assert origins_of(object()) == {}


def test_a_phase_is_the_meaning_of_its_codes_and_inputs_of_the_state_that_shows_the_pressure() -> None:
    origins = map_origins(controller("demo"))
    assert origins[Channel.PHASE].from_wire.startswith("value = meaning")
    made = controller("float-drive")
    stated = map_origins(made)[Channel.INPUTS].from_wire
    assert all(one.on_wire in stated for one in made.words.states.quantities | made.words.pressure.quantities)


@pytest.mark.parametrize(("given", "stated"), [
    ("laumas-fast", "laumas-fast"),
    ({"base": "laumas-fast", "decimals": 1},
     "described in the bench file, read as (number / 10 if it has no decimal separator)"),
    ({"pattern": r"(?P<value>[+-]?\d+)(?P<unit>k?N)", "scale": 0.5, "offset": 2.0, "units": {"kN": 1000.0}},
     "described in the bench file, read as (0.5 * number +2) * factor for the unit in the line (N 1, kN 1000)"),
    ({"sync": [1], "length": 4, "fields": {"value": {"at": 1, "type": "u16", "scale": 0.001}}},
     "described in the bench file, read as 0.001 * number"),
    ("a-plug-in", "a-plug-in"),
])  # fmt: skip
def test_a_format_states_how_it_reads_the_number_on_the_wire(given: object, stated: str) -> None:
    assert wire_text(given, given) == stated  # type: ignore[arg-type]  # names and tables, as a bench file has them


def test_a_set_point_in_milliamperes_and_a_state_that_no_device_reports_are_stated_as_such() -> None:
    table = {
        "commands": {"set_current": "ISET {current_mA:.0f}", "measure_current": "MEAS?"},
        "range": {"current_A": [0, 5]},
    }
    source = ScpiSupply(SupplyConnection("socket://127.0.0.1:1", supply(table)))
    stated = source.origins[Channel.COMMANDED_CURRENT].from_wire
    assert stated == "value = 0.001 * number sent in 'ISET {current_mA:.0f}'"
    assert "not reported by any device" in ManualCurrentSource().origins[Channel.ECU_STATE].from_wire
