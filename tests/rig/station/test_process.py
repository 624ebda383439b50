"""The station as a process, without devices: its weight, its files, its link, and how it ends."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from rig.bench.sensor_settings import Calibration, LoadCell, Lvdt
from rig.bench.settings import ActuatorConfig, EcuConfig, Limits, StationConfig
from rig.clock import monotonic_ns
from rig.recording.journal.ring_reader import RingReader
from rig.station.client import StationClient, StationLost, StationRefused
from rig.station.process import MUTATION_VARIABLE
from simulators.shared_clock import SharedClock

MOST_RESIDENT_KB = 64 * 1024


def config_in(folder: Path) -> StationConfig:
    """Devices at a port where nobody listens."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    return StationConfig(
        actuator=ActuatorConfig(url=f"modbus-tcp://127.0.0.1:{port}"),
        ecu=EcuConfig(interface="slcan", channel=f"socket://127.0.0.1:{port}"),
        load_cell=LoadCell(
            url=str(folder / "no-such-port"), rate_Hz=250.0, range_N=1e4, calibration=Calibration(serial_number="LC-1")
        ),
        lvdt=Lvdt(
            url=f"socket://127.0.0.1:{port}", rate_Hz=250.0, range_m=0.1, calibration=Calibration(serial_number="LV-1")
        ),
        limits=Limits(
            position_m=(-0.085, 0.085), speed_m_s=0.8, acceleration_m_s2=60.0, force_N=5000.0, current_A=3.0,
            coil_temperature_degC=120.0,
        ),
        ring_path=str(folder / "ring"),
    )


@pytest.fixture(scope="module")
def idle_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("idle")


@pytest.fixture(scope="module")
def idle(idle_folder: Path) -> Iterator[StationClient]:
    """One station for all tests that look at it and leave it as it is."""
    started = StationClient.start(config_in(idle_folder), idle_folder)
    yield started
    started.close()


@pytest.fixture
def client(tmp_path: Path) -> Iterator[StationClient]:
    started = StationClient.start(config_in(tmp_path), tmp_path)
    yield started
    started.close()


def test_a_station_does_not_start_on_the_clock_of_a_rig_that_is_not_its_own(tmp_path: Path) -> None:
    kept = SharedClock(tmp_path / "clock", ["/dev/pts/1"], monotonic_ns(), fast=False)
    try:
        config = replace(config_in(tmp_path), shared=str(tmp_path / "clock"))
        with pytest.raises(StationLost, match="not a device of the simulated rig"):
            StationClient.start(config, tmp_path)
    finally:
        kept.close()


def test_process_stays_below_64_megabytes_and_loads_no_numpy(idle: StationClient) -> None:
    status = Path(f"/proc/{idle.process.pid}/status").read_text()
    resident_kB = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
    assert resident_kB < MOST_RESIDENT_KB
    mapped = Path(f"/proc/{idle.process.pid}/maps").read_text()
    for package in ("numpy", "pandas", "h5py", "pydantic"):
        assert f"/{package}/" not in mapped


def test_modules_of_the_station_import_no_numeric_package() -> None:
    code = (
        "import sys, rig.station.process, rig.station.client; "
        "print([m for m in ('numpy', 'pandas', 'h5py', 'pydantic', 'asyncio.runners') if m in sys.modules])"
    )
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    found = json.loads(printed.replace("'", '"'))
    assert "numpy" not in found
    assert "pandas" not in found
    assert "h5py" not in found
    assert "pydantic" not in found


def test_it_lives_in_a_session_of_its_own(idle: StationClient) -> None:
    assert os.getsid(idle.process.pid) == idle.process.pid


def test_unreachable_devices_are_all_named_and_the_station_lives_on(idle: StationClient) -> None:
    for _ in range(2):
        with pytest.raises(StationRefused, match="unreachable") as refusal:
            idle.request("connect")
        lines = refusal.value.message.splitlines()
        assert [line.split()[0] for line in lines] == ["load_cell", "lvdt", "ecu", "actuator"]
    assert idle.request("status")["connected"] is False


@pytest.mark.parametrize("do", ["arm", "move", "start", "stop", "reset", "disarm", "starve_watchdog"])
def test_nothing_is_done_before_connect(idle: StationClient, do: str) -> None:
    with pytest.raises(StationRefused, match="not-connected"):
        idle.request(do)


def test_unknown_request_is_refused_with_those_that_exist(idle: StationClient) -> None:
    with pytest.raises(StationRefused, match="starve_watchdog"):
        idle.request("dance")


def test_shutdown_ends_it_with_exit_code_0(client: StationClient) -> None:
    client.request("shutdown")
    assert client.process.wait(10) == 0
    assert not client.alive
    with pytest.raises(StationLost):
        client.request("status")


def test_end_of_the_link_ends_a_station_that_is_not_armed(tmp_path: Path) -> None:
    client = StationClient.start(config_in(tmp_path), tmp_path)
    assert client.close() == 0
    assert not (tmp_path / "ring").exists(), "nobody else may be there to remove it"
    with pytest.raises(StationLost):
        client.beat(True)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_signal_ends_a_station_that_is_not_armed(client: StationClient, number: signal.Signals) -> None:
    os.kill(client.process.pid, number)
    assert client.process.wait(10) == 0


def test_ring_exists_when_the_station_is_ready_and_its_writer_beats(
    idle: StationClient, idle_folder: Path
) -> None:
    idle.request("status")
    with RingReader(idle_folder / "ring") as reader:
        assert reader.writer_pid == idle.process.pid
        assert reader.writer_heartbeat_ns > 0


def speak(folder: Path, config: str, data: bytes, **environment: str) -> tuple[int, list[dict[str, object]], str]:
    """Start the station as any program would and talk bytes to it."""
    path = folder / "station.json"
    path.write_text(config)
    ended = subprocess.run(
        [sys.executable, "-m", "rig.station", str(path)],
        input=data,
        capture_output=True,
        timeout=30,
        check=False,
        env=os.environ | environment,
    )
    return ended.returncode, [json.loads(line) for line in ended.stdout.splitlines()], ended.stderr.decode()


def test_garbage_on_the_link_is_answered_by_warnings_and_requests_behind_it_are_heard(tmp_path: Path) -> None:
    data = b'\n{"do"\n\xff\xfe\n[1]\n{"id": 5, "do": "dance"}\n{"id": 6, "do": "shutdown"}\n'
    code, messages, _ = speak(tmp_path, config_in(tmp_path).to_json(), data)
    assert code == 0
    assert [message.get("event") for message in messages].count("warning") == 3
    assert {message["id"] for message in messages if "id" in message} >= {6}


def test_wrong_configuration_ends_it_with_exit_code_2_and_a_message(tmp_path: Path) -> None:
    code, messages, error = speak(tmp_path, '{"limits": 3}', b"")
    assert code == 2
    assert messages == []
    assert "actuator: missing" in error or "limits" in error


def test_no_room_for_the_samples_is_reported_in_one_line(tmp_path: Path) -> None:
    most = resource.RLIMIT_FSIZE
    before = resource.getrlimit(most)
    resource.setrlimit(most, (1 << 20, before[1]))
    try:
        code, messages, error = speak(tmp_path, config_in(tmp_path).to_json(), b"")
    finally:
        resource.setrlimit(most, before)
    assert (code, messages) == (3, [])
    (line,) = error.splitlines()
    place = re.escape(str(tmp_path))
    assert re.match(rf"the sample ring \(\d+ MB\) cannot be created in {place}: .*File too large", line)
    assert [path.name for path in tmp_path.iterdir()] == ["station.json"]


def test_detectors_cannot_be_disabled_outside_a_mutation_check(tmp_path: Path) -> None:
    config = replace(config_in(tmp_path), disabled_detectors=("stroke-limit",)).to_json()
    code, _, error = speak(tmp_path, config, b"")
    assert code == 2
    assert "disabled_detectors" in error
    code, messages, _ = speak(tmp_path, config, b"", **{MUTATION_VARIABLE: "1"})
    assert code == 0
    assert messages[0]["disabled_detectors"] == ["stroke-limit"]
