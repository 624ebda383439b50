from __future__ import annotations

import asyncio
import contextlib
import itertools
from collections.abc import Callable

import demo_ecu as ecu
import demo_registers as wire
import numpy as np
import pytest

from drivers.roles import ActuatorStatus, Command, Result, State
from rig.clock import monotonic_ns
from rig.errors import FileProblem
from rig.faults.matrix import MATRIX
from simulators.injection import INJECTORS
from simulators.options import RigOptions
from simulators.plant.records import MODE_PROGRAM
from simulators.rig import RunOptions, SimulatedRig
from simulators.schedule import ScheduledFault, Wiring, parse_fault, wiring_for
from simulators.slcan_bus import SlcanClient


def test_exactly_the_rows_on_the_wire_have_an_injector() -> None:
    assert {slug for slug, row in MATRIX.items() if row.where == "wire"} == set(INJECTORS)


def test_a_fault_is_given_with_or_without_its_time() -> None:
    assert parse_fault("estop@2.5") == ScheduledFault("estop", 2.5)
    assert parse_fault("register-layout") == ScheduledFault("register-layout", None)


@pytest.mark.parametrize(
    ("text", "message"),
    [("ecu-silnt", "did you mean 'ecu-silent'"), ("sigkill", "where = process"),
     ("estop@soon", "not a number"), ("estop@-1", "0 s or more"), ("estop@nan", "0 s or more")],
)
def test_a_fault_that_cannot_be_injected_is_refused(text: str, message: str) -> None:
    with pytest.raises(FileProblem, match=message):
        parse_fault(text)


@pytest.mark.parametrize(
    ("slugs", "wiring"),
    [([], Wiring("tcp", "pty")), (["rtu-crc", "estop"], Wiring("rtu", "pty")),
     (["usb-renumber"], Wiring("tcp", "by-id"))],
)  # fmt: skip
def test_a_fault_brings_the_wires_it_needs(slugs: list[str], wiring: Wiring) -> None:
    assert wiring_for([ScheduledFault(slug, 1.0) for slug in slugs], None, None) == wiring


@pytest.mark.parametrize(
    ("slugs", "actuator", "ports", "message"),
    [(["rtu-stale"], "tcp", None, "--actuator rtu"), (["modbus-reset"], "rtu", None, "--actuator tcp"),
     (["modbus-reset", "rtu-crc"], None, None, "'modbus-reset' .*tcp.*rtu"), (["usb-renumber"], None, "pty", "by-id")],
)  # fmt: skip
def test_a_fault_that_cannot_happen_on_the_wires_requested_is_refused(
    slugs: list[str], actuator: str | None, ports: str | None, message: str
) -> None:
    with pytest.raises(FileProblem, match=message):
        wiring_for([ScheduledFault(slug, 1.0) for slug in slugs], actuator, ports)


def on_a_rig(story: Callable[[SimulatedRig], None], *faults: ScheduledFault) -> None:
    async def run() -> None:
        rig = SimulatedRig(RigOptions(), RunOptions(ports="socket", faults=faults))
        rig.warm_up()
        await rig.open()
        try:
            story(rig)
        finally:
            await rig.close()

    asyncio.run(run())


def moving(rig: SimulatedRig) -> None:
    """Start a program directly in the plant; the fault schedule counts from here."""
    rig.plant.order(mode=MODE_PROGRAM, pressure=2, amplitude_m=0.01, frequency_Hz=1.0, full_cycles=50, ramp_in_cycles=1)
    rig.plant.state["accumulator_Pa"] = 210e5
    rig.advance(8)


def status(rig: SimulatedRig) -> ActuatorStatus:
    words = rig.bank.read(wire.STATUS.address, wire.STATUS.count)
    assert words is not None
    return wire.decode_status(words, 0)


@pytest.mark.parametrize("slug", sorted(INJECTORS))
def test_every_injector_runs_in_a_moving_rig_and_physics_goes_on(slug: str) -> None:
    def story(rig: SimulatedRig) -> None:
        moving(rig)
        INJECTORS[slug](rig)
        before_s = rig.plant.time_s
        for step in range(40):
            rig.actuator.tick(0.002 * step)
            rig.ecu.tick(0.002 * step)
            for action in rig.every_tick:
                action()
            rig.advance(80)
        assert rig.plant.time_s == pytest.approx(before_s + 0.4)
        assert np.all(np.isfinite(rig.plant.out))

    on_a_rig(story)


def test_a_scheduled_fault_waits_for_its_time_after_the_first_cycle() -> None:
    def story(rig: SimulatedRig) -> None:
        rig.advance(4000)
        rig.tick()
        moving(rig)
        rig.tick()
        assert not rig.actuator.faults.e_stop_open
        while rig.plant.time_s < rig.first_cycle_s + 0.5:
            rig.advance(80)
        rig.tick()
        assert rig.actuator.faults.e_stop_open

    on_a_rig(story, ScheduledFault("estop", 0.5))


def test_a_fault_without_a_time_is_there_before_the_first_connection() -> None:
    def story(rig: SimulatedRig) -> None:
        assert rig.bank.read(0, 2) == [0x0304, 0x0102]

    on_a_rig(story, ScheduledFault("register-layout", None))


def test_a_frozen_position_register_stays_while_the_rod_moves() -> None:
    def story(rig: SimulatedRig) -> None:
        moving(rig)
        rig.advance(1000)
        frozen_m = status(rig).position_m
        INJECTORS["actuator-frozen"](rig)
        rig.advance(1500)
        assert status(rig).position_m == frozen_m
        assert abs(rig.plant.value("position_m") - frozen_m) > 1e-3
        assert status(rig).heartbeat > 0

    on_a_rig(story)


def test_a_lost_write_is_acknowledged_and_changes_nothing() -> None:
    def story(rig: SimulatedRig) -> None:
        before = rig.bank.read(200, 16)
        INJECTORS["modbus-write-lost"](rig)
        assert rig.bank.write(214, [123]) is True
        assert rig.bank.read(200, 16) == before

    on_a_rig(story)


def test_an_ignored_stop_is_acknowledged_while_the_program_runs_on() -> None:
    def story(rig: SimulatedRig) -> None:
        moving(rig)
        INJECTORS["stop-ignored"](rig)
        rig.bank.write(300, wire.COMMAND.encode({"command": Command.FADE_STOP, "sequence": 9}))
        rig.advance(4000)
        assert status(rig).result == Result.DONE
        assert status(rig).state == State.RUNNING

    on_a_rig(story)


def test_the_e_stop_stops_the_rod_and_the_current() -> None:
    def story(rig: SimulatedRig) -> None:
        moving(rig)
        rig.ecu.receive(0x120, ecu.encode(ecu.CoilCommand(1, True, False, 1.0)))
        rig.advance(2000)
        assert rig.plant.value("current_A") > 0.9
        INJECTORS["estop"](rig)
        for step in range(50):
            rig.actuator.tick(0.002 * step)
            rig.ecu.tick(0.002 * step)
            rig.advance(40)
        assert abs(rig.plant.value("velocity_m_s")) < 1e-3
        assert abs(rig.plant.value("current_A")) < 0.05

    on_a_rig(story)


@pytest.mark.parametrize("slug", ["ecu-silent", "ecu-crc"])
def test_no_valid_status_leaves_a_broken_ecu(slug: str) -> None:
    def story(rig: SimulatedRig) -> None:
        INJECTORS[slug](rig)
        valid = 0
        for _ in range(100):
            rig.plant.advance(16)
            for identifier, data in rig.ecu.frames():
                if identifier == ecu.STATUS_ID and len(data) == 8:
                    with contextlib.suppress(ValueError):
                        ecu.decode(ecu.CoilStatus, data)
                        valid += 1
        assert valid == 0

    on_a_rig(story)


def test_late_frames_come_as_often_as_ever_each_twice_and_older_and_older() -> None:
    def story(rig: SimulatedRig) -> None:
        rig.plant.advance(800)
        rig.ecu.frames()
        INJECTORS["ecu-late"](rig)
        counters = []
        for _ in range(60):
            rig.plant.advance(80)
            frames = [data for identifier, data in rig.ecu.frames() if identifier == ecu.STATUS_ID]
            counters += [ecu.decode(ecu.CoilStatus, data).counter for data in frames]
        assert len(counters) == pytest.approx(60, abs=4)
        steps = [(after - before) % ecu.COUNTER_MODULUS for before, after in itertools.pairwise(counters)]
        assert set(steps) == {0, 1}
        assert abs(steps.count(0) - steps.count(1)) <= 8

    on_a_rig(story)


def bus_lines(rig: SimulatedRig) -> list[bytes]:
    """Collects what a listening client of the bus would get."""
    got: list[bytes] = []
    rig.bus.send_lines = lambda lines, sender=None: got.extend([] if rig.bus.silent else lines)  # type: ignore[method-assign]
    return got


def test_malformed_frames_are_short_remote_or_extended_and_none_is_right() -> None:
    def story(rig: SimulatedRig) -> None:
        got = bus_lines(rig)
        INJECTORS["can-malformed"](rig)
        for _ in range(30):
            rig.advance(80)
        about_status = [line for line in got if b"121" in line[:9]]
        assert {line[:1] for line in about_status} == {b"t", b"r", b"T"}
        assert not [line for line in got if line[:1] == b"t" and line[4:5] == b"8"]

    on_a_rig(story)


def test_bus_off_is_reported_by_the_adapter_and_then_nothing_passes() -> None:
    def story(rig: SimulatedRig) -> None:
        got = bus_lines(rig)
        INJECTORS["can-busoff"](rig)
        for _ in range(30):
            rig.advance(80)
        assert got == [b"\a"] * 3
        rig.bus.received(b"t1200", SlcanClient(rig.bus))
        assert got == [b"\a"] * 3

    on_a_rig(story)


def test_a_babbling_node_fills_most_of_the_bus() -> None:
    def story(rig: SimulatedRig) -> None:
        got = bus_lines(rig)
        INJECTORS["can-babble"](rig)
        begin_ns = monotonic_ns()
        while monotonic_ns() - begin_ns < 50_000_000:
            rig.every_tick[-1]()
        elapsed_s = (monotonic_ns() - begin_ns) * 1e-9
        bits = 111 * len(got)
        assert 0.7 * 500_000 < bits / elapsed_s < 500_000

    on_a_rig(story)


def test_a_other_sender_commands_with_valid_counters_and_checks() -> None:
    def story(rig: SimulatedRig) -> None:
        got = bus_lines(rig)
        INJECTORS["can-foreign"](rig)
        for _ in range(50):
            rig.every_tick[-1]()
        commands = [ecu.decode(ecu.CoilCommand, bytes.fromhex(line[5:].decode())) for line in got]
        assert [command.counter for command in commands] == [n % ecu.COUNTER_MODULUS for n in range(1, 11)]
        assert {(command.enable, command.setpoint_A) for command in commands} == {(True, 0.1)}

    on_a_rig(story)


def test_swapped_sensors_put_millimetres_on_the_force_port() -> None:
    def story(rig: SimulatedRig) -> None:
        port = rig.channel("load_cell").port
        INJECTORS["sensors-swapped"](rig)
        assert rig.channel("load_cell").sensor.options.unit == "mm"
        assert rig.channel("load_cell").port is port

    on_a_rig(story)


def test_a_loose_joint_changes_the_force_at_reversal() -> None:
    forces = []
    for loose in (False, True):
        def story(rig: SimulatedRig, loose: bool = loose) -> None:
            moving(rig)
            if loose:
                INJECTORS["load-train"](rig)
            rows = []
            for _ in range(20):
                rig.advance(800)
                rows.append(rig.plant.out[:, 2].copy())
            forces.append(np.concatenate(rows))

        on_a_rig(story)
    assert np.abs(forces[1]).min() == 0.0
    assert np.mean(forces[1] == 0.0) > 0.002
    assert np.mean(forces[0] == 0.0) == 0.0
