"""The pressure of a controller as a fact separate from its state: by its own meaning, inputs, or rules of the state."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from test_register_map_file import SMALLEST, problems, read

from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.map_file import controller
from drivers.roles import ActuatorStatus, FaultBit, Pressure, State
from rig.files.descriptions import table_of
from simulators.emulated_status import EmulatedStatus, taken

MAPS = Path(__file__).parents[1] / "simulators" / "maps"
PULSES = controller(table_of("register-map", MAPS / "pulses.toml"))
OFF, LOW, ON, UNKNOWN = Pressure.OFF, Pressure.LOW, Pressure.ON, Pressure.UNKNOWN


def shown(made: ControllerMap, **values: int | float) -> ActuatorStatus:
    """The status for some quantities; all others show 0."""
    return made.status({quantity.name: 0 for quantity in made.polled} | values, 0, {})


def state_of(text: str) -> ControllerMap:
    """The page's smallest map with other states."""
    before, _, rest = SMALLEST.partition("[state]")
    return read(f"{before}{text}\n[faults]{rest.partition('[faults]')[2]}")


@pytest.mark.parametrize(
    ("made", "values", "state", "pressure"),
    [
        (controller("delta-rmc"), {"status_bits": 1 << 15}, State.TRIPPED, OFF),
        (controller("delta-rmc"), {"status_bits": 1 << 15 | 1 << 8}, State.TRIPPED, ON),
        (controller("delta-rmc"), {"status_bits": 1 << 8, "program": 1}, State.HOLD, ON),
        (controller("float-drive"), {"state": 0}, State.OFF, OFF),
        (controller("float-drive"), {"state": 3}, State.TRIPPED, UNKNOWN),
        (controller("float-drive"), {"state": 4}, State.TRIPPED, OFF),
        (controller("float-drive"), {"state": 9}, 9, UNKNOWN),
        (controller("demo"), {"state": 7, "inputs": 1}, State.TRIPPED, OFF),
        (controller("demo"), {"state": 7, "inputs": 5}, State.TRIPPED, ON),
        (controller("demo"), {"state": 0, "inputs": 5}, State.OFF, ON),
        (controller("demo"), {"state": 1, "inputs": 3}, State.LOW, LOW),
        (PULSES, {"fault": 1, "drive_ready": 0}, State.TRIPPED, OFF),
        (PULSES, {"fault": 1, "drive_ready": 1}, State.TRIPPED, UNKNOWN),
        (state_of("[state]\ntripped = 9\nhold = 1\nrunning = 3\noff = true"), {"state": 9}, State.TRIPPED, UNKNOWN),
        (state_of("[state]\ntripped = 9\nhold = 1\nrunning = 3\noff = true"), {"state": 0}, State.OFF, OFF),
        (state_of("[state]\nhold = 1\nrunning = 3\noff = 0"), {"state": 0, "alarms": 1}, State.TRIPPED, OFF),
        (state_of("[state]\nhold = 1\nrunning = 3\noff = 0"), {"state": 1, "alarms": 1}, State.TRIPPED, ON),
        (state_of("[state]\nhold = 1\nrunning = 3\n[pressure]\noff = {quantity = 'alarms', bit = 9}"),
         {"state": 1, "alarms": 1 << 9}, State.OFF, OFF),
        (state_of("[state]\nhold = 1\nrunning = 3\n[pressure]\noff = {quantity = 'alarms', bit = 9}"),
         {"state": 1}, State.HOLD, UNKNOWN),
    ],
)  # fmt: skip
def test_a_trip_hides_no_pressure_and_proves_none_gone(
    made: ControllerMap, values: dict[str, int], state: int, pressure: Pressure
) -> None:
    status = shown(made, **values)
    assert (status.state, status.pressure) == (state, pressure)
    assert status.hydraulics_off is (pressure is OFF)
    assert status.hydraulics_low is (pressure in {OFF, LOW})


def test_watchdog_and_trip_are_facts_of_their_own() -> None:
    status = shown(controller("delta-rmc"), program=2, status_bits=1 << 8)
    assert (status.watchdog_tripped, status.tripped, status.pressure) == (True, True, ON)
    assert status.fault_bits == FaultBit.WATCHDOG
    assert not shown(controller("delta-rmc"), program=1, status_bits=1 << 8).tripped


@pytest.mark.parametrize("name", ["demo", "demo-streamed", "float-drive", "delta-rmc", "pulses", "handshake"])
@pytest.mark.parametrize("pressure", [OFF, ON])
def test_the_simulated_controller_shows_its_pressure_behind_a_trip(name: str, pressure: Pressure) -> None:
    own = name in {"pulses", "handshake"}
    made = controller(table_of("register-map", MAPS / f"{name}.toml") if own else name)
    registers: dict[tuple[str, int], int] = {}
    inputs = 5 if pressure is ON else 1
    EmulatedStatus(made).show(registers, State.TRIPPED, State.HOLD, int(FaultBit.INTERNAL), inputs, pressure)
    values = {one.name: taken(registers, one, None) for one in made.polled if one.name in {
        quantity.name for quantity in EmulatedStatus(made).quantities
    }}  # fmt: skip
    status = shown(made, **values)
    assert status.state == State.TRIPPED
    assert status.hydraulics_off is (pressure is OFF)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[pressure]\non = 1", "off is missing"),
        ("[pressure]\noff = [0, 1]", "code 1 means hold in .state."),
        ("[pressure]\nof = 0", "did you mean off"),
        ("[pressure]\noff = {quantity = 'alarm'}", "did you mean alarms"),
    ],
)
def test_a_pressure_that_cannot_be_is_refused(text: str, message: str) -> None:
    found = problems(SMALLEST.replace("[faults]", f"{text}\n[faults]", 1))
    assert any(re.search(message, problem) for problem in found), found


@pytest.mark.parametrize(
    "stated",
    [
        '[inputs]\nhydraulics-on = {quantity = "bar", at_least = 10}',
        '[pressure]\noff = {quantity = "bar", not_equals = 100}\non = {quantity = "bar", at_least = 10}',
    ],
)
def test_a_transducer_that_shows_no_number_does_not_prove_that_the_pressure_is_gone(stated: str) -> None:
    made = read(SMALLEST.replace("[state]", f'bar = {{address = 60, type = "f32"}}\n{stated}\n[state]'))
    assert shown(made, bar=120.0, state=9).stated_pressure is ON
    assert shown(made, bar=0.0, state=9).stated_pressure is OFF
    assert shown(made, bar=math.nan, state=9).stated_pressure is UNKNOWN
    assert not shown(made, bar=math.nan, state=9).hydraulics_off
