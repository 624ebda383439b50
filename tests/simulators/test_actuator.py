from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, cast

import demo_registers as wire
import numpy as np
import pytest

from drivers.roles import ActuatorLimits, Command, FaultBit, Input, ProgramPhase, Result, State
from simulators.injection import INJECTORS

if TYPE_CHECKING:
    from simulators.faulty import Faulty
    from tests.simulators.conftest import Bench


X, V = 1, 2


def test_identity_proves_word_order_and_layout(bench: Bench) -> None:
    identity = wire.decode_identity(bench.bank.read(0, wire.IDENTITY.count))
    assert (identity.signature_u32, identity.signature_f32) == (0x01020304, 1234.5)
    assert identity.serial_number == "SIM-ACT-1"
    assert bench.bank.read(0, 2) == [0x0102, 0x0304]


def test_registers_between_blocks_are_not_there(bench: Bench) -> None:
    assert bench.bank.read(38, 1) is None
    assert bench.bank.read(130, 8) is None
    assert bench.bank.write(100, [0]) is None
    assert bench.bank.write(350, [1, 2]) is None


def test_commands_need_the_lease(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    assert bench.command(Command.HYDRAULICS_LOW) is Result.REFUSED_OWNER
    assert bench.command(Command.ACQUIRE, owner=0) is Result.REFUSED_VALUE
    assert bench.command(Command.ACQUIRE) is Result.DONE
    assert bench.command(Command.ACQUIRE, owner=8) is Result.REFUSED_OWNER
    assert bench.command(Command.RELEASE) is Result.DONE
    assert bench.command(Command.ACQUIRE, owner=8) is Result.DONE


def test_a_silent_owners_lease_can_be_taken_over(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    bench.command(Command.ACQUIRE)
    bench.actuator.tick(10.0)
    assert bench.command(Command.ACQUIRE, owner=8) is Result.DONE
    assert bench.status().owner == 8


def test_a_sequence_number_executes_once(bench: Bench) -> None:
    fields = {"command": Command.MOVE_TO, "sequence": 500, "owner_id": 7, "target_position": 0.01, "speed": 0.05}
    words = wire.COMMAND.encode(fields)
    bench.bank.write(300, words)
    bench.run(1.0)
    assert bench.status().state == State.HOLD
    bench.command(Command.MOVE_TO, target_position=0.0, speed=0.05)
    bench.run(1.0)
    bench.sequence = 500
    bench.bank.write(300, words)
    assert bench.status().state == State.MOVING
    bench.bank.write(300, words)
    bench.run(1.0)
    assert bench.status().position_m == pytest.approx(0.01, abs=1e-4)
    bench.bank.write(300, words)
    assert bench.status().state == State.HOLD


def test_motion_is_refused_without_pressure_and_beyond_limits(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    bench.command(Command.ACQUIRE)
    assert bench.start(0.01, 1.0, 1) is Result.REFUSED_STATE
    bench.ready()
    assert bench.start(0.2, 0.1, 1) is Result.REFUSED_LIMIT
    assert bench.start(0.05, 4.0, 1) is Result.REFUSED_LIMIT
    assert bench.start(0.01, 0.0, 1) is Result.REFUSED_VALUE
    assert bench.start(0.01, 1.0, 1, centre=0.05) is Result.REFUSED_VALUE
    assert bench.command(Command.MOVE_TO, target_position=0.5, speed=0.1) is Result.REFUSED_LIMIT
    assert bench.command(Command.MOVE_TO, target_position=0.01, speed=5.0) is Result.REFUSED_LIMIT
    assert bench.status().state == State.HOLD


def test_not_a_number_in_a_command_is_refused(bench: Bench) -> None:
    words = wire.COMMAND.encode({"command": Command.MOVE_TO, "sequence": 900, "owner_id": 7, "speed": 0.1})
    words[4:6] = [0x7FC0, 0]
    bench.bank.write(300, words)
    assert bench.status().result == Result.REFUSED_VALUE


def test_a_program_reports_its_phases_and_returns_to_centre(bench: Bench) -> None:
    bench.start(0.02, 2.0, 3)
    seen = []
    for _ in range(60):
        bench.run(0.05)
        status = bench.status()
        seen.append((status.state, status.phase, status.cycles_done))
    phases = [phase for _, phase, _ in seen]
    order = [ProgramPhase.RAMP_IN, ProgramPhase.FULL_AMPLITUDE, ProgramPhase.RAMP_OUT, ProgramPhase.IDLE]
    assert [phase for i, phase in enumerate(phases) if i == 0 or phases[i - 1] != phase] == order
    assert seen[-1][0] == State.HOLD
    assert seen[-1][2] == 5
    assert bench.status().pulse_count == 6
    assert bench.plant.value("position_m") == pytest.approx(0.0, abs=bench.options.servo.overlap_m)


def test_move_keeps_its_speed_and_arrives(bench: Bench) -> None:
    bench.command(Command.MOVE_TO, target_position=0.03, speed=0.02)
    rows = bench.run(3.0)
    assert np.median(rows[800:8000, V]) == pytest.approx(0.02, rel=1e-3)
    assert rows[:, V].max() < 0.02 * 1.05
    assert rows[-1, X] == pytest.approx(0.03, abs=bench.options.servo.overlap_m)
    assert bench.status().state == State.HOLD


def test_fade_stop_takes_one_cycle_around_the_centre_and_holds_there(bench: Bench) -> None:
    bench.start(0.03, 1.0, 10)
    bench.run(3.3)
    assert bench.command(Command.FADE_STOP, owner=0) is Result.DONE
    assert bench.status().state == State.FADING
    rows = bench.run(1.2)
    assert np.abs(rows[:, X]).max() < 0.031
    assert np.abs(rows[-800:, V]).max() < 1e-3
    assert abs(rows[-1, X]) < 1e-4
    assert bench.status().state == State.HOLD
    assert bench.status().fault_bits == 0


def test_halt_brakes_with_the_halt_deceleration_and_holds_where_it_stopped(bench: Bench) -> None:
    bench.start(0.05, 1.0, 10)
    bench.run(3.0)
    speed_m_s = abs(bench.plant.value("velocity_m_s"))
    assert speed_m_s > 0.25
    bench.command(Command.HALT, owner=0)
    rows = bench.run(0.5)
    stopped = np.flatnonzero(rows[:, V] == 0.0)[0] * bench.plant.dt_s
    assert stopped == pytest.approx(speed_m_s / 20.0, abs=1e-3)
    assert np.ptp(rows[2000:, X]) == 0.0
    assert bench.status().state == State.HOLD


@pytest.mark.parametrize("after_s", [0.6, 1.1, 1.4])
def test_a_program_that_loses_its_end_goes_on_without_a_step(bench: Bench, after_s: float) -> None:
    """Seed 1050126: at its full amplitude again in the ramp at its end, the set-point made a step: 0.46 m/s of 0.08."""
    bench.start(0.01, 2.0, 1)
    rows = bench.run(after_s)
    INJECTORS["stop-ignored"](cast("Faulty", bench))
    rows = np.concatenate([rows, bench.run(1.5)])
    assert np.max(np.abs(rows[:, V])) < 1.1 * 0.01 * 2.0 * np.pi * 2.0
    assert bench.status().state == State.RUNNING


def test_move_stops_within_the_halt_deceleration(bench: Bench) -> None:
    bench.command(Command.MOVE_TO, target_position=0.08, speed=0.3)
    bench.run(0.2)
    bench.command(Command.FADE_STOP)
    rows = bench.run(0.3)
    assert np.abs(rows[-400:, V]).max() < 1e-4
    assert rows[-1, X] < 0.07


def feed(bench: Bench, counter: int) -> None:
    assert bench.bank.write(350, [counter]) is True


def arm(bench: Bench, action: int = 1, watchdog_ms: int = 500) -> None:
    limits = ActuatorLimits(-0.08, 0.08, 0.8, 60.0, 5000.0, 1.0, 20.0, watchdog_ms, action)
    assert bench.bank.write(200, wire.encode_limits(limits)) is True


def test_a_starved_watchdog_fades_out_and_latches(bench: Bench) -> None:
    arm(bench)
    feed(bench, 1)
    bench.start(0.03, 1.0, 10)
    bench.run(2.2)
    bench.actuator.tick(0.49)
    assert bench.status().state == State.RUNNING
    bench.actuator.tick(0.51)
    assert bench.status().state == State.TRIPPED
    assert bench.status().fault_bits == FaultBit.WATCHDOG
    rows = bench.run(1.3)
    assert np.abs(rows[-400:, V]).max() < 1e-3
    assert bench.start(0.01, 1.0, 1) is Result.REFUSED_STATE
    assert bench.command(Command.RESET) is Result.DONE
    assert bench.status().state == State.HOLD


def test_only_changed_counters_feed_and_reads_do_not(bench: Bench) -> None:
    arm(bench)
    feed(bench, 1)
    for now_s in (0.2, 0.4, 0.6):
        bench.actuator.tick(now_s)
        feed(bench, 1)
        bench.bank.read(350, 1)
    assert bench.status().state == State.TRIPPED


@pytest.mark.parametrize(("action", "watchdog_ms"), [(0, 500), (1, 0)])
def test_a_watchdog_without_action_or_time_lets_the_rod_go_on(bench: Bench, action: int, watchdog_ms: int) -> None:
    arm(bench, action, watchdog_ms)
    feed(bench, 1)
    bench.start(0.03, 1.0, 10)
    bench.actuator.tick(60.0)
    assert bench.status().state == State.RUNNING


def test_the_force_limit_halts_within_one_step_and_names_itself(bench: Bench) -> None:
    limits = ActuatorLimits(-0.08, 0.08, 0.8, 60.0, 600.0, 1.0, 20.0, 0, 1)
    assert bench.bank.write(200, wire.encode_limits(limits)) is True
    bench.plant.order(coil_A=2.0)
    bench.start(0.05, 1.0, 10)
    bench.run(3.0)
    status = bench.status()
    assert status.state == State.TRIPPED
    assert status.fault_bits == FaultBit.FORCE_LIMIT
    assert bench.plant.value("velocity_m_s") == 0.0


def test_limits_are_read_back_hashed_and_refused_when_absurd(bench: Bench) -> None:
    before = wire.decode_identity(bench.bank.read(0, wire.IDENTITY.count)).config_hash
    arm(bench)
    assert wire.decode_limits(bench.bank.read(200, wire.CONFIG.count)).speed_max_m_s == pytest.approx(0.8)
    assert wire.decode_identity(bench.bank.read(0, wire.IDENTITY.count)).config_hash != before
    absurd = ActuatorLimits(0.1, -0.1, 0.8, 60.0, 5000.0, 1.0, 20.0, 0, 1)
    assert bench.bank.write(200, wire.encode_limits(absurd)) is False
    bench.start(0.01, 1.0, 5)
    assert bench.bank.write(200, bench.bank.read(200, wire.CONFIG.count)) is False


def test_a_table_waveform_plays_the_samples_it_was_given(bench: Bench) -> None:
    samples = 0.01 * np.sin(2 * np.pi * np.arange(60) / 60)
    values = {"table_index": 0, "table_count": 60} | {f"table_values_{i}": float(v) for i, v in enumerate(samples)}
    assert bench.bank.write(400, wire.TABLE.encode(values)) is True
    assert bench.start(0.0, 0.0, 3, waveform=2, table_length=60, table_interval=1 / 60) is Result.DONE
    rows = bench.run(3.5)
    assert rows[:, X].max() == pytest.approx(0.01, rel=0.01)
    assert bench.start(0.0, 0.0, 3, waveform=2, table_length=600, table_interval=0.01) is Result.REFUSED_STATE


def test_the_e_stop_opens_the_chain_and_refuses_reset(bench: Bench) -> None:
    bench.actuator.faults.e_stop_open = True
    bench.actuator.tick(0.0)
    status = bench.status()
    assert status.state == State.TRIPPED
    assert status.fault_bits == FaultBit.E_STOP
    assert not status.inputs & Input.E_STOP_CLOSED
    assert bench.command(Command.RESET) is Result.REFUSED_STATE


def test_a_reboot_forgets_the_lease_and_the_limits(bench: Bench) -> None:
    arm(bench)
    bench.actuator.boot()
    assert bench.status().owner == 0
    assert bench.status().state == State.OFF
    assert wire.decode_limits(bench.bank.read(200, wire.CONFIG.count)).speed_max_m_s == pytest.approx(1.0)
