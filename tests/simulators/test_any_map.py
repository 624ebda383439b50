"""The simulated controller takes every register map that a bench file takes: drawn maps, served on the wire and driven.

Any address, type, order of words and bytes, first address, gap, function, recipe style, watchdog, and limits.
"""

from __future__ import annotations

import asyncio
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.connection import ActuatorConnection, MotionTerms
from drivers.modbus_actuator import ModbusActuator
from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.map_file import controller
from drivers.register_maps.quantity import BITS, TYPES
from drivers.roles import ActuatorLimits, Command, Program, State, WatchdogAction, Waveform
from drivers.setpoint_generator import Setpoint
from simulators.actuator import Actuator
from simulators.clock import DeviceClock
from simulators.modbus_server import ModbusServer
from simulators.options import RigOptions
from simulators.plant.plant import Plant
from simulators.registers import RegisterBank

LIMITS = ActuatorLimits(-0.05, 0.06, 0.5, 40.0, 4000.0, 2.0, 8.0, 400, int(WatchdogAction.FADE_AND_HOLD))
LENGTHS = {"f32": "mm", "i32": "um", "f64": "in", "i64": "um"}
LIMIT_KINDS = {
    "position_min": ("f32", "mm"), "position_max": ("i32", "um"), "speed_max": ("f32", "mm/s"),
    "acceleration_max": ("f64", "m/s^2"), "force_max": ("u32", "N"), "fade_out_cycles": ("f32", ""),
    "halt_deceleration": ("f32", "m/s^2"), "watchdog_time": ("u16", "ms"), "watchdog_action": ("u16", ""),
}  # fmt: skip


class Layout:
    """Places quantities: anywhere, far apart or side by side, and keeps them apart."""

    def __init__(self, draw: st.DrawFn) -> None:
        self.draw = draw
        self.first = draw(st.sampled_from([0, 1, 40001]))
        self.next: dict[str, int] = {}
        self.lines: list[str] = []

    def add(self, name: str, kind: str, *spaces: str, unit: str = "", count: int = 1) -> None:
        draw = self.draw
        space = draw(st.sampled_from(spaces))
        size = 1 if space in BITS else TYPES[kind][1] * count
        at = self.next.get(space, draw(st.sampled_from([0, 97, 100, 4096, 60_000])))
        at += draw(st.sampled_from([0, 0, 1, 7, 9, 15, 16, 130, 400]))
        self.next[space] = at + size
        entries = [f"address = {at + self.first}", f'function = "{space}"']
        if space not in BITS:
            entries += [f'type = "{kind}"', f'word_order = "{draw(st.sampled_from(["big", "little"]))}"']
            entries += [f'byte_order = "{draw(st.sampled_from(["big", "little"]))}"']
        if space == "holding" and size == 1:
            entries += [f"write_function = {draw(st.sampled_from([6, 16]))}"]
        if space == "coil":
            entries += [f"write_function = {draw(st.sampled_from([5, 15]))}"]
        entries += [f'unit = "{unit}"'] if unit else []
        self.lines.append(f"{name} = {{{', '.join(entries)}}}")

    def length(self, name: str, *spaces: str) -> None:
        kind = self.draw(st.sampled_from(sorted(LENGTHS)))
        self.add(name, kind, *spaces, unit=LENGTHS[kind])


@st.composite
def maps(draw: st.DrawFn) -> str:
    """A register map of a controller with a generator, or of one that follows set-points."""
    layout = Layout(draw)
    streams, coded = draw(st.booleans()), draw(st.booleans())
    watchdog = draw(st.sampled_from(["none", "counter", "keep-alive"]))
    layout.length("position", "holding", "input")
    for name in ("ready", "trip", "runs", "dog"):
        layout.add(name, "u16", "coil", "discrete", "holding", "input")
    layout.add("order", "u16", "holding")
    layout.add("power", "u16", "holding", "coil")
    layout.length("target", "holding")
    layout.add("alive", "u32", "holding")
    if not streams:
        layout.length("amplitude", "holding")
        layout.add("frequency", "f32", "holding", unit="Hz")
        layout.add("cycles", "f64", "holding")
    limits = draw(st.sets(st.sampled_from(sorted(LIMIT_KINDS))))
    if watchdog == "none":
        limits -= {"watchdog_time", "watchdog_action"}
    for name in draw(st.permutations(sorted(limits))):
        kind, unit = LIMIT_KINDS[name]
        layout.add(name, kind, "holding", unit=unit)
    if coded:
        layout.add("state", "u32", "holding", "input")
    rules = (
        "off = 0\nhold = 4\nrunning = [5, 6]\ntripped = 9" if coded else
        'tripped = {quantity = "trip"}\noff = {quantity = "ready", equals = 0}\n'
        'running = [{quantity = "ready"}, {quantity = "runs"}]\nhold = true'
    )
    lines = [
        f"[modbus]\nfirst_address = {layout.first}\nlargest_gap = {draw(st.sampled_from([0, 8, 124]))}",
        f"largest_read = {draw(st.sampled_from([4, 16, 125]))}", "[quantities]", *layout.lines, "[state]", rules,
        '[faults]\nwatchdog = {quantity = "dog"}\ninternal = {quantity = "trip"}' if not coded else
        '[faults]\nwatchdog = {quantity = "dog"}', "[commands]",
        "hydraulics-on = {write = {power = 1}}", "hydraulics-off = {write = {power = 0}}",
        "halt = {write = {order = 7}}", "reset = {write = {order = 8}}",
    ]  # fmt: skip
    if streams:
        lines += ['[setpoint]\nwrite = {target = "$position"}']
    else:
        lines += [
            'move-to = {write = {target = "$target", order = 5}}',
            'start = [{write = {amplitude = "$amplitude", frequency = "$frequency", cycles = "$all_cycles"}}, '
            '{write = {order = 6}}]',
        ]
    if watchdog != "none":
        fed = '"$counter"' if watchdog == "counter" else '"$toggle"'
        lines += [f'[watchdog]\nkind = "{watchdog}"\nwrite = {{alive = {fed}}}\ntime = "500 ms"']
    if "watchdog_action" in limits:
        lines += ["[watchdog_actions]\nnone = 7\nfade-and-hold = 3"]
    return "\n".join(lines)


def drive(made: ControllerMap, driver: ModbusActuator) -> None:
    """What a campaign does with a controller, as far as it needs no time to pass."""
    driver.open()
    driver.read_identity()
    assert driver.read_status().state == State.OFF
    able = made.capabilities
    if made.limits:
        driver.write_limits(LIMITS)
        assert driver.read_limits() == LIMITS
    if able.watchdog != "none":
        driver.exchange(1)
    driver.send(Command.HYDRAULICS_ON)
    status = driver.read_status()
    assert (status.state, status.hydraulics_off) == (State.HOLD, False)
    if able.generator:
        driver.send(Command.START, Program(Waveform.SINE, 0.01, 1.0, cycles=6.0))
        assert driver.read_status().state == State.RUNNING
        driver.send(Command.HALT)
    else:
        status = driver.follow(Setpoint(0.001, 0.0), None)
    driver.send(Command.HYDRAULICS_OFF)
    status = driver.read_status()
    assert (status.state, status.hydraulics_off) == (State.OFF, True)


def served(made: ControllerMap) -> None:
    """The map on the wire, and its own driver at it."""
    options = RigOptions()
    actuator = Actuator(Plant(options), options.controller, DeviceClock(0.0, 0.0), lambda *_: None)
    server = ModbusServer(RegisterBank(actuator, options.servo, np.random.default_rng(3), made), 1)

    async def story() -> None:
        await server.open()
        try:
            connection = ActuatorConnection(server.url, 1, 1.0, 7, motion=MotionTerms())
            driver = ModbusActuator(connection, made)
            try:
                await asyncio.to_thread(drive, made, driver)
            finally:
                driver.close()
        finally:
            await server.close()

    asyncio.run(story())


@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
@given(text=maps())
def test_a_drawn_map_is_served(text: str) -> None:
    served(controller(tomllib.loads(text)))


SMALL = """
[quantities]
position = {address = 0, type = "i16", unit = "um"}
state = {address = 1}
dog = {address = 2}
order = {address = 9}
target = {address = 10, type = "i16", unit = "um"}
alive = {address = 11}
PLACES
[state]
off = 0
hold = 1
[faults]
watchdog = {quantity = "dog"}
[commands]
hydraulics-on = {write = {power = 1}}
hydraulics-off = {write = {power = 0}}
reset = {write = {order = 1}}
[setpoint]
write = {target = "$position"}
[watchdog]
kind = "counter"
write = {alive = "$counter"}
"""


@pytest.mark.parametrize(
    "places",
    [
        *(f'power = {{address = {address}, function = "coil"}}' for address in (0, 15, 16, 99, 100, 1023, 8192, 65535)),
        """power = {address = 5}
        position_min = {address = 20, type = "f32", unit = "mm"}
        position_max = {address = 40, type = "f32", unit = "mm"}
        force_max = {address = 900, unit = "N"}""",
        """power = {address = 5}
        watchdog_time = {address = 30, unit = "ms"}""",
        """power = {address = 5}
        halt_deceleration = {address = 30, unit = "mm/s^2"}
        watchdog_time = {address = 50, type = "f32", unit = "s"}""",
    ],
)
def test_places_that_were_refused_once_are_served(places: str) -> None:
    served(controller(tomllib.loads(SMALL.replace("PLACES", places))))


MEASURED = """power = {address = 5}
force = {address = 30, type = "f32", unit = "N"}
low = {address = 40, bit = 3}
high = {address = 40, bit = 5}
serial = {address = 44, type = "u64"}"""


@pytest.mark.parametrize(
    "faults",
    [
        "", 'force-limit = {quantity = "force", at_least = 5000}',
        'position-limit = {quantity = "position", at_least = 80000}',
    ],
)
def test_what_a_condition_looks_at_is_shown_as_it_is_measured(faults: str) -> None:
    text = SMALL.replace("PLACES", MEASURED).replace("[faults]", f"[faults]\n{faults}")
    made = controller(tomllib.loads(text + "[identity]\nlow = 1\nhigh = 1\nserial = 0x0102030405060708\n"))
    served(made)
    options = RigOptions()
    actuator = Actuator(Plant(options), options.controller, DeviceClock(0.0, 0.0), lambda *_: None)
    registers = RegisterBank(actuator, options.servo, np.random.default_rng(3), made)
    for name in ("force", "position"):
        quantity = made.quantities[name]
        assert registers.read(quantity.address, quantity.length) != [0] * quantity.length, name


def test_single_bits_a_split_position_and_a_handshake_are_served() -> None:
    made = controller(tomllib.loads((Path(__file__).parent / "maps" / "single-bits.toml").read_text("utf-8")))
    served(made)
    assert (made.capabilities.watchdog_tested, made.setpoint_waits) == ("on", True)


def test_a_drive_goes_through_its_states_on_the_way_to_power() -> None:
    """The preset for CiA 402 waits for "ready to switch on" and "switched on" before it enables the operation."""
    made = controller("cia402-drive")
    options = RigOptions()
    actuator = Actuator(Plant(options), options.controller, DeviceClock(0.0, 0.0), lambda *_: None)
    bank = RegisterBank(actuator, options.servo, np.random.default_rng(3), made)
    bank.write(0x6060, [1])
    shown = []
    for word in (0x06, 0x07, 0x0F, 0x00):
        bank.write(0x6040, [word])
        status = bank.read(0x6041, 1)
        assert status is not None
        shown.append((status[0] & 0x7, actuator.state))
    assert shown == [(1, State.OFF), (3, State.OFF), (7, State.HOLD), (0, State.OFF)]
