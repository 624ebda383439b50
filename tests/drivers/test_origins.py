"""Each driver states where its channels come from: true of the bytes that it reads."""

from __future__ import annotations

import struct

import pytest

from drivers.can_current_source import CanCurrentSource
from drivers.can_port import CanPort
from drivers.connection import CanAddress
from drivers.devices.source import current_source
from drivers.hand_source import HandSource
from drivers.origins import origins_of
from drivers.register_maps.map_file import controller
from drivers.register_maps.map_origins import map_origins
from drivers.register_maps.quantity import Quantity
from drivers.ring import Channel


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
    told = origins_of(HandSource())[Channel.COIL_CURRENT]
    assert (told.source, "not measured" in told.long_name) == ("operator", True)
    assert origins_of(object()) == {}
