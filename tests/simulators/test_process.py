"""The simulated rig as users start it, spoken to by other people's tools."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import demo_registers as wire
import h5py
import numpy as np
import pytest
import serial
from pymodbus.client import ModbusTcpClient

from drivers.roles import ActuatorStatus, Command, Result, State
from protocols.frame_format import FrameDecoder
from rig.bench.model import Bench

pytestmark = pytest.mark.wire
COMMAND = [sys.executable, "-m", "simulators"]


class Process:
    """A running `python -m simulators` and its bench file."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.truth = folder / "truth.h5"
        self.popen = subprocess.Popen(
            [*COMMAND, "--truth", str(self.truth), *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.popen.stdout is not None
        self.bench_path = Path(self.popen.stdout.readline().strip())
        self.bench: dict[str, Any] = tomllib.loads(self.bench_path.read_text(encoding="utf-8"))
        host, _, port = self.bench["actuator"]["url"].removeprefix("modbus-tcp://").partition(":")
        self.modbus = ModbusTcpClient(host, port=int(port), timeout=5, retries=0)
        assert self.modbus.connect()
        self.sequence = 0

    def status(self) -> ActuatorStatus:
        answer = self.modbus.read_holding_registers(100, count=wire.STATUS.count, device_id=1)
        assert not answer.isError()
        return wire.decode_status(answer.registers, 0)

    def command(self, command: Command, **values: float) -> Result:
        self.sequence += 1
        fields: dict[str, Any] = {"command": command, "sequence": self.sequence, "owner_id": 3, **values}
        answer = self.modbus.write_registers(300, wire.COMMAND.encode(fields), device_id=1)
        assert not answer.isError()
        return Result(self.status().result)

    def ready(self) -> None:
        for command in (Command.ACQUIRE, Command.HYDRAULICS_LOW, Command.HYDRAULICS_ON):
            assert self.command(command) is Result.DONE

    def pass_time(self, device_us: int = 50_000) -> None:
        """Let so much of the controller's clock pass."""
        deadline_s = time.monotonic() + 30
        begun_us = self.status().clock_us
        while (self.status().clock_us - begun_us) % (1 << 32) < device_us:
            assert time.monotonic() < deadline_s

    def wait_for(self, state: State) -> ActuatorStatus:
        deadline_s = time.monotonic() + 30
        while (status := self.status()).state != state:
            assert time.monotonic() < deadline_s, status
        return status

    def end(self) -> str:
        self.modbus.close()
        self.popen.terminate()
        _, errors = self.popen.communicate(timeout=30)
        return errors


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Process]]:
    started: list[Process] = []

    def starter(*arguments: str) -> Process:
        started.append(Process(tmp_path, *arguments))
        return started[-1]

    yield starter
    for process in started:
        if process.popen.poll() is None:
            process.end()


PROGRAM = {"waveform": 0, "amplitude": 0.02, "frequency": 2.0, "cycles": 3, "ramp_in_cycles": 1, "ramp_out_cycles": 1}


def test_the_first_line_is_a_bench_file_that_loads_and_every_socket_is_open(start: Callable[..., Process]) -> None:
    process = start("--auxiliary", "1", "--seed", "4")
    bench = Bench.load(process.bench_path)
    assert bench.load_cell.delay_s == pytest.approx(0.225e-3, abs=1e-6)
    assert bench.lvdt.calibration.sensitivity == 0.001
    assert len(bench.auxiliary) == 1
    for sensor in (bench.load_cell, bench.lvdt, bench.auxiliary[0]):
        with serial.serial_for_url(sensor.url, baudrate=sensor.baudrate, timeout=2) as port:
            assert FrameDecoder().feed(port.read(64))
    assert process.status().state == State.OFF


@pytest.mark.nightly
def test_a_program_run_by_a_third_party_modbus_client_is_in_the_truth(start: Callable[..., Process]) -> None:
    process = start("--speed", "10")
    process.pass_time()
    process.ready()
    assert process.command(Command.START, **PROGRAM) is Result.DONE
    assert process.wait_for(State.HOLD).cycles_done == 5
    process.pass_time()
    errors = process.end()
    assert process.popen.returncode == 0
    assert "dropped_load_cell" in errors
    with h5py.File(process.truth) as file:
        data = file["entry/data"]
        time_s, x, state = (data[name][:] for name in ("time", "displacement", "controller_state"))
        assert np.diff(time_s) == pytest.approx(1e-3, abs=1e-9)
        assert x.max() == pytest.approx(0.02, rel=0.01)
        assert {State.OFF, State.HOLD, State.RUNNING} <= set(state.tolist())
        codes = [code.decode().strip() for code in file["entry/events/code"][:]]
        assert codes[:4] == ["ACQUIRE", "HYDRAULICS_LOW", "HYDRAULICS_ON", "START"]
        assert file["entry/test"].attrs["damper_model"] == b"asymmetric"
        assert file["entry/test"].attrs["parameter_Fyb"] == 238.0
        assert file["entry/quality"].attrs["dropped_can"] == 0
    assert not list(process.truth.parent.glob("*.part"))


def test_python_cans_own_slcan_sees_status_and_drives_current(start: Callable[..., Process]) -> None:
    import demo_ecu as ecu

    process = start()
    channel = process.bench["ecu"]["channel"]
    with can.Bus(interface="slcan", channel=channel, bitrate=500000, sleep_after_open=0) as bus:
        counter, measured_A = 0, 0.0
        deadline_s = time.monotonic() + 10
        while measured_A < 0.9:
            assert time.monotonic() < deadline_s
            message = bus.recv(1.0)
            assert message is not None
            assert message.dlc == 8
            if message.arbitration_id == ecu.STATUS_ID:
                measured_A = ecu.decode(ecu.CoilStatus, bytes(message.data)).current_A
                counter = (counter + 1) % 15
                data = ecu.encode(ecu.CoilCommand(counter, True, True, 1.0))
                bus.send(can.Message(arbitration_id=0x120, data=data, is_extended_id=False))


@pytest.mark.nightly
def test_two_can_clients_hear_each_other(start: Callable[..., Process]) -> None:
    channel = start().bench["ecu"]["channel"]
    with (
        can.Bus(interface="slcan", channel=channel, bitrate=500000, sleep_after_open=0) as one,
        can.Bus(interface="slcan", channel=channel, bitrate=500000, sleep_after_open=0) as two,
    ):
        assert one.recv(2.0) is not None
        assert two.recv(2.0) is not None
        one.send(can.Message(arbitration_id=0x321, data=[1, 2], is_extended_id=False))
        heard = (two.recv(2.0) for _ in range(200))
        assert any(message is not None and message.arbitration_id == 0x321 for message in heard)


@pytest.mark.nightly
def test_a_terminal_shows_load_cell_lines_in_ascii_mode(start: Callable[..., Process]) -> None:
    process = start("--force-format", "ascii", "--ports", "socket")
    assert process.bench["load_cell"]["format"] == "signed-decimal"
    with serial.serial_for_url(process.bench["load_cell"]["url"], timeout=2) as port:
        port.readline()
        line = port.readline()
    assert line.endswith(b" N\r\n")
    assert float(line[:-4]) == pytest.approx(-275, abs=60)


@pytest.mark.nightly
def test_an_unread_port_drops_and_counts_while_the_rig_runs_on(start: Callable[..., Process]) -> None:
    process = start("--speed", "50")
    began_us = process.status().clock_us
    while (process.status().clock_us - began_us) % 2**32 < 5_000_000:
        os.sched_yield()
    process.end()
    with h5py.File(process.truth) as file:
        simulated_s = file["entry/data/time"][-1]
        unheard = int(file["entry/quality"].attrs["unheard_frames"])
        assert file["entry/quality"].attrs["dropped_load_cell"] == 0
    # A port keeps what its line discipline holds; more only while a busy kernel has not passed it on yet.
    assert 0 < unheard <= 2 * (simulated_s * 250 - 4095 // 16) + 60


@pytest.mark.nightly
def test_a_fault_given_from_the_start_meets_the_first_client(start: Callable[..., Process]) -> None:
    process = start("--fault", "modbus-busy")
    answer = process.modbus.read_holding_registers(0, count=2, device_id=1)
    assert answer.isError()
    assert answer.exception_code == 6


@pytest.mark.nightly
def test_a_half_open_link_swallows_requests(start: Callable[..., Process]) -> None:
    from pymodbus.exceptions import ModbusIOException

    process = start("--fault", "modbus-halfopen")
    process.modbus.comm_params.timeout_connect = 0.3
    with pytest.raises(ModbusIOException):
        process.modbus.read_holding_registers(0, count=2, device_id=1)


def test_sigkill_leaves_the_truths_pieces_readable(start: Callable[..., Process]) -> None:
    from simulators.truth import About, convert

    process = start("--speed", "20")
    process.ready()
    process.command(Command.START, **PROGRAM)
    process.wait_for(State.HOLD)
    process.modbus.close()
    process.popen.kill()
    process.popen.communicate(timeout=30)
    pieces = [process.truth.with_name(process.truth.name + end) for end in (".part", ".events.jsonl")]
    convert(process.truth, *pieces, 1000.0, About({}, {}, {}))
    with h5py.File(process.truth) as file:
        assert file["entry/data/displacement"][:].max() == pytest.approx(0.02, rel=0.01)


def test_it_outlives_its_parent_until_standstill_and_completes_its_truth(tmp_path: Path) -> None:
    truth, bench = tmp_path / "truth.h5", tmp_path / "bench.toml"
    parent = (
        "import subprocess, sys, time\n"
        "child = subprocess.Popen(sys.argv[1:], stdout=subprocess.PIPE, start_new_session=True)\n"
        "print(child.pid, child.stdout.readline().decode().strip(), flush=True)\n"
        "sys.stdin.read()\n"
    )
    arguments = [*COMMAND, "--exit-when-idle", "--truth", str(truth), "--bench", str(bench)]
    with subprocess.Popen(
        [sys.executable, "-c", parent, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        child = int(process.stdout.readline().split()[0])
        host, _, port = tomllib.loads(bench.read_text())["actuator"]["url"].removeprefix("modbus-tcp://").partition(":")
        with ModbusTcpClient(host, port=int(port)) as client:
            for sequence, values in enumerate(
                [{"command": 1}, {"command": 3}, {"command": 4}, {"command": 7, **PROGRAM}], start=1
            ):
                words = wire.COMMAND.encode({"sequence": sequence, "owner_id": 3, **values})
                assert not client.write_registers(300, words, device_id=1).isError()
        process.kill()
        process.wait()
    deadline_s = time.monotonic() + 30
    while not truth.exists():
        assert time.monotonic() < deadline_s
        os.kill(child, 0)
        os.sched_yield()
    with h5py.File(truth) as file:
        assert file["entry/data/displacement"][:].max() == pytest.approx(0.02, rel=0.01)
        assert abs(file["entry/data/velocity"][-1]) < 1e-3


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "arguments",
    [["--fault", "sigkill"], ["--option", "load_cell.noize=1"], ["--model", "kwokk"], ["--speed", "0"],
     ["--config", "no"], ["--option", "damper.values.q=1"], ["--set", "spencer-bingham", "--model", "kwok"]],
)
def test_bad_usage_is_exit_code_2_without_a_traceback(arguments: list[str]) -> None:
    answer = subprocess.run([*COMMAND, *arguments], capture_output=True, check=False, text=True)
    assert answer.returncode == 2
    assert answer.stdout == ""
    assert "Traceback" not in answer.stderr
    assert answer.stderr.strip()


@pytest.mark.nightly
def test_ctrl_c_ends_it_cleanly(start: Callable[..., Process]) -> None:
    process = start()
    process.modbus.close()
    process.popen.send_signal(signal.SIGINT)
    process.popen.communicate(timeout=30)
    assert process.popen.returncode == 0
    assert process.truth.exists()
    assert not process.bench_path.exists()


@pytest.mark.nightly
def test_ctrl_c_the_moment_its_first_line_is_there_ends_it_cleanly_too(tmp_path: Path) -> None:
    """A full pipe holds it behind its first line, where it explains itself, until the signal is there."""
    truth = tmp_path / "truth.h5"
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(write_end, bytes(4096))
    os.set_blocking(write_end, True)
    with subprocess.Popen(
        [*COMMAND, "--truth", str(truth)], stdout=subprocess.PIPE, stderr=write_end, text=True
    ) as process, open(read_end, "rb") as output:
        os.close(write_end)
        assert process.stdout is not None
        assert process.stdout.readline()
        process.send_signal(signal.SIGINT)
        while output.read(4096):
            pass
        process.wait(timeout=30)
    assert process.returncode == 0
    assert truth.exists()
