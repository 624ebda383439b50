from __future__ import annotations

import math
import struct
from pathlib import Path

import demo_ecu as wire
import numpy as np
import pytest

from drivers.current_source import SourceFault, SourceState
from simulators.clock import DeviceClock
from simulators.ecu import Ecu
from simulators.ecu_wire import Frame
from simulators.emulated_ecu import EmulatedEcuFiles
from simulators.options import CoilOptions, RigOptions
from simulators.plant.plant import Plant


class Coil:
    """An ECU on its plant, without a bus."""

    def __init__(self, noise_A: float = 0.0, temperatures_until_s: float = math.inf,
                 files: EmulatedEcuFiles | None = None) -> None:
        self.plant = Plant(RigOptions())
        self.log: list[tuple[str, str]] = []
        options = CoilOptions(current_noise_A=noise_A, temperatures_until_s=temperatures_until_s)
        self.ecu = Ecu(self.plant, options, 23.0, DeviceClock(0.0, 0.0), np.random.default_rng(0),
                       lambda code, text: self.log.append((code, text)), None if files is None else files.load())
        self.counter = 0

    def command(self, current_A: float, enable: bool = True, clear: bool = False) -> None:
        self.counter = (self.counter + 1) % 15
        self.ecu.receive(0x120, wire.encode(wire.CoilCommand(self.counter, enable, clear, current_A)))

    def run(self, seconds: float) -> list[Frame]:
        frames: list[Frame] = []
        for _ in range(round(seconds / 0.002)):
            self.plant.advance(16)
            frames += self.ecu.frames()
        return frames


@pytest.fixture
def coil() -> Coil:
    return Coil()


def statuses(frames: list[Frame]) -> list[wire.CoilStatus]:
    return [wire.decode(wire.CoilStatus, data) for identifier, data in frames if identifier == 0x121]


def test_periods_follow_the_device_clock(coil: Coil) -> None:
    frames = coil.run(2.0)
    by_id = {identifier: sum(1 for each, _ in frames if each == identifier) for identifier in (0x121, 0x122, 0x123)}
    assert by_id[0x121] in {200, 201}
    assert by_id[0x122] in {20, 21}
    assert by_id[0x123] in {2, 3}
    times = [status.device_time_ticks for status in statuses(frames)]
    assert set(np.diff(times).tolist()) == {100}


def test_a_message_on_request_is_sent_once_for_each_request_or_at_its_period_on_a_faster_rig() -> None:
    roles = {
        "command": "CoilCommand.CurrentSetpoint", "measured_current": "CoilStatus.Current",
        "requests": {"CoilStatus": "remote"}, "periods": {"CoilStatus": "10 ms"},
    }  # fmt: skip
    coil = Coil(files=EmulatedEcuFiles(Path(__file__).parents[2] / "drivers/devices/demo_ecu.dbc", roles))
    assert coil.run(0.1) == []
    for _ in range(2):
        coil.ecu.request(0x121, b"", remote=True)
    coil.ecu.request(0x121, bytes(8), remote=False)
    coil.ecu.request(0x122, b"", remote=True)
    assert [identifier for identifier, _ in coil.run(0.002)] == [0x121, 0x121]
    assert coil.run(0.1) == []
    coil.ecu.request(0x121, b"", remote=True, answers=5)
    assert 1 <= len(coil.run(0.02)) <= 3
    assert len(coil.run(1.0)) <= 4


def test_temperatures_can_end_while_everything_else_goes_on() -> None:
    frames = Coil(temperatures_until_s=1.0).run(2.0)
    by_id = {identifier: sum(1 for each, _ in frames if each == identifier) for identifier in (0x121, 0x122, 0x123)}
    assert by_id[0x122] in {10, 11}
    assert by_id[0x121] in {200, 201}


def test_counters_run_0_to_14_and_every_crc_is_right(coil: Coil) -> None:
    counters = [status.counter for status in statuses(coil.run(0.4))]
    assert counters[:16] == [*range(15), 0]


def test_it_drives_the_commanded_current_with_the_coils_lag(coil: Coil) -> None:
    coil.command(1.5)
    last = statuses(coil.run(0.04))[-1]
    assert last.state == SourceState.ENABLED
    assert 0.8 < last.current_A < 1.0
    coil.command(1.5)
    assert statuses(coil.run(0.5))[-1].current_A == pytest.approx(1.5, abs=0.001)


def test_measured_current_is_quantised_to_a_milliampere() -> None:
    coil = Coil(noise_A=0.002)
    frames = [data for identifier, data in coil.run(1.0) if identifier == 0x121]
    raw = [struct.unpack_from("<h", data, 2)[0] for data in frames]
    assert 1.0 < np.std(raw) < 3.5


def test_silence_of_the_host_means_0_A_by_itself(coil: Coil) -> None:
    coil.command(2.0)
    coil.ecu.tick(0.099)
    assert coil.ecu.state is SourceState.ENABLED
    coil.ecu.tick(0.101)
    last = statuses(coil.run(0.5))[-1]
    assert last.state == SourceState.FAULT
    assert last.faults == SourceFault.COMMAND_TIMEOUT
    assert abs(last.current_A) < 0.001


def test_a_fault_latches_until_it_is_cleared(coil: Coil) -> None:
    coil.command(2.0)
    coil.ecu.tick(0.2)
    coil.command(2.0)
    assert coil.ecu.setpoint_A == 0.0
    coil.command(2.0, clear=True)
    assert coil.ecu.setpoint_A == 2.0


def test_bad_commands_are_ignored_and_the_third_in_a_row_is_a_fault(coil: Coil) -> None:
    coil.command(1.0)
    good = wire.encode(wire.CoilCommand(5, True, False, 3.0))
    for expected in (SourceState.ENABLED, SourceState.ENABLED, SourceState.FAULT):
        coil.ecu.receive(0x120, bytes([good[0] ^ 0xFF]) + good[1:])
        assert coil.ecu.state is expected
    assert coil.ecu.fault_bits == SourceFault.COMMAND_CHECK


def test_a_repeated_counter_is_a_bad_command(coil: Coil) -> None:
    frame = wire.encode(wire.CoilCommand(3, True, False, 1.0))
    for _ in range(4):
        coil.ecu.receive(0x120, frame)
    assert coil.ecu.fault_bits == SourceFault.COMMAND_CHECK


def test_a_short_command_is_no_command(coil: Coil) -> None:
    coil.ecu.receive(0x120, b"\x00\x01")
    assert coil.ecu.state is SourceState.INIT


@pytest.mark.parametrize(
    ("switch", "bit"),
    [
        ("coil_open", SourceFault.OPEN), ("coil_short", SourceFault.SHORT),
        ("over_temperature", SourceFault.OVER_TEMPERATURE),
    ],
)
def test_coil_faults_are_seen_and_drive_0_A(coil: Coil, switch: str, bit: SourceFault) -> None:
    coil.command(1.0)
    coil.run(0.3)
    setattr(coil.ecu.faults, switch, True)
    coil.ecu.tick(0.05)
    assert coil.ecu.fault_bits & bit
    coil.run(0.3)
    assert abs(coil.plant.value("current_A")) < 0.001


def test_undervoltage_is_a_fault(coil: Coil) -> None:
    coil.command(1.0)
    coil.ecu.supply_V = 8.0
    coil.ecu.tick(0.05)
    assert coil.ecu.fault_bits & SourceFault.UNDERVOLTAGE


def test_a_stuck_output_keeps_its_current(coil: Coil) -> None:
    coil.command(1.0)
    coil.run(0.5)
    coil.ecu.faults.stuck_current = True
    for step in range(20):
        coil.command(0.0, enable=False)
        coil.ecu.tick(0.01 * step)
        coil.run(0.02)
    assert coil.plant.value("current_A") == pytest.approx(1.0, abs=0.01)


def test_a_restart_counts_and_says_so(coil: Coil) -> None:
    coil.command(1.0)
    coil.run(0.3)
    coil.ecu.restart()
    frames = coil.run(0.3)
    assert statuses(frames)[-1].faults & SourceFault.RESTARTED
    assert statuses(frames)[0].counter == 0
    boots = [wire.decode(wire.CoilTemperature, data).boot_count for identifier, data in frames if identifier == 0x122]
    assert boots[-1] == CoilOptions().boot_count + 1
