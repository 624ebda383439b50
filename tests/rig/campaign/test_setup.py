"""The campaign's directory, locks, room and what the station is told."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from rig.bench.model import Bench
from rig.bench.settings_json import from_json
from rig.campaign.execution.point_recording import sensor_contexts
from rig.campaign.file_copies import keep_file
from rig.campaign.machine_resources import locked, station_config
from rig.campaign.results import CampaignOptions
from rig.campaign.setup import (
    campaign_hash,
    check_room,
    make_campaign_folder,
    write_description,
)
from rig.errors import Refused
from rig.matrix.model import Matrix, load_matrix
from rig.matrix.plan import plan

BENCH = """
format = 1
name = "test bench"
[limits]
position = ["-85 mm", "85 mm"]
speed = "0.8 m/s"
acceleration = "60 m/s^2"
force = "5 kN"
current = "3 A"
coil_temperature = "120 degC"
[actuator]
url = "modbus-tcp://127.0.0.1:{port}"
[ecu]
interface = "slcan"
channel = "socket://127.0.0.1:{port}"
[load_cell]
url = "/dev/ttyUSB{port}"
rate = "250 Hz"
range = "10 kN"
delay = "0.2 ms"
[load_cell.calibration]
serial_number = "LC-1"
offset = "3 N"
[lvdt]
url = "/dev/ttyUSB9{port}"
rate = "250 Hz"
range = "100 mm"
[lvdt.calibration]
serial_number = "LV-1"
sensitivity = 0.001
{more}
"""
MATRIX = """
format = 1
[specimen]
serial_number = "MR-007"
stroke = "{stroke}"
mid_stroke = "5 mm"
[matrix]
amplitude = ["20 mm"]
frequency = ["1 Hz", "2 Hz"]
current = ["0 A", "1 A"]
cycles = 5
"""


def bench(tmp_path: Path, port: int = 1, more: str = "") -> Bench:
    path = tmp_path / f"bench{port}.toml"
    path.write_text(BENCH.format(port=port, more=more), encoding="utf-8")
    return Bench.load(path)


def matrix(tmp_path: Path, stroke: str = "120 mm") -> Matrix:
    path = tmp_path / "matrix.toml"
    path.write_text(MATRIX.format(stroke=stroke), encoding="utf-8")
    return load_matrix(path)


def test_a_campaigns_folder_is_named_by_time_and_specimen_and_is_always_new(tmp_path: Path) -> None:
    first, second = (make_campaign_folder(tmp_path / "logs", "MR-007") for _ in range(2))
    assert first != second
    assert "-MR-007-" in first.name
    assert (first / "points").is_dir()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write into read-only folders")
def test_a_read_only_folder_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(Refused, match="--out") as caught:
        make_campaign_folder(tmp_path, "MR-007")
    tmp_path.chmod(0o700)
    assert caught.value.slug == "dir-readonly"


def test_a_file_where_the_folder_should_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "logs").write_text("mine", encoding="utf-8")
    with pytest.raises(Refused) as caught:
        make_campaign_folder(tmp_path / "logs", "MR-007")
    assert caught.value.slug == "dir-readonly"
    assert (tmp_path / "logs").read_text(encoding="utf-8") == "mine"


def test_two_campaigns_on_one_rig_are_refused_and_two_rigs_are_not(tmp_path: Path) -> None:
    one, other = bench(tmp_path, 1), bench(tmp_path, 2)
    with locked(one):
        with locked(other):
            pass
        with pytest.raises(Refused, match="in use by another campaign") as caught, locked(one):
            pytest.fail("the second lock was given")
    assert caught.value.slug == "two-instances"
    assert f"process {os.getpid()}: " in str(caught.value)
    with locked(one):
        pass


def test_room_on_the_disk_is_forecast(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    accepted = plan(matrix(tmp_path), bench(tmp_path))
    check_room(tmp_path, accepted, bench(tmp_path), matrix(tmp_path))
    total, used, _ = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(total, used, 1_000_000))
    with pytest.raises(Refused, match="1 MB free") as caught:
        check_room(tmp_path, accepted, bench(tmp_path), matrix(tmp_path))
    assert caught.value.slug == "disk-full"


def test_a_temperature_window_with_unknown_heat_asks_for_no_more_room(tmp_path: Path) -> None:
    path = tmp_path / "window.toml"
    window = '[temperature]\nwindow = ["25 degC", "45 degC"]\n'
    path.write_text(MATRIX.format(stroke="120 mm") + window, encoding="utf-8")
    check_room(tmp_path, plan(load_matrix(path), bench(tmp_path)), bench(tmp_path), load_matrix(path))


def test_the_campaigns_hash_counts_physics_and_not_addresses(tmp_path: Path) -> None:
    tests = matrix(tmp_path)
    reference = campaign_hash(bench(tmp_path, 1), tests)
    assert campaign_hash(bench(tmp_path, 2), tests) == reference
    assert campaign_hash(bench(tmp_path, 1), matrix(tmp_path, "130 mm")) != reference
    heavier = bench(tmp_path, 1, '[fixture]\nmoving_mass = "2 kg"')
    assert campaign_hash(heavier, matrix(tmp_path)) != reference


def test_the_description_says_what_was_run_and_how(tmp_path: Path) -> None:
    options = CampaignOptions(
        tmp_path / "matrix.toml", tmp_path, simulate=True, speed=50.0, seed=3, simulator_args=("--x",)
    )
    write_description(tmp_path, bench(tmp_path), matrix(tmp_path), options)
    description = json.loads((tmp_path / "campaign.json").read_text(encoding="utf-8"))
    assert description["simulated"] == {"speed": 50.0, "seed": 3, "arguments": ["--x"]}
    assert description["points"] == ["p001", "p002", "p003", "p004"]
    assert description["hash"] == campaign_hash(bench(tmp_path), matrix(tmp_path))
    assert "127.0.0.1" not in json.dumps(description)
    began = json.dumps({**description, "started_utc": "2026-03-05T10:00:00+00:00"})
    (tmp_path / "campaign.json").write_text(began, encoding="utf-8")
    write_description(tmp_path, bench(tmp_path), matrix(tmp_path), options)  # again, once the rig is known
    assert json.loads((tmp_path / "campaign.json").read_text(encoding="utf-8"))["started_utc"][:10] == "2026-03-05"


def test_the_station_receives_the_narrower_of_bench_and_specimen(tmp_path: Path) -> None:
    auxiliary = (
        '[[auxiliary]]\nname = "acceleration"\nunit = "g"\nurl = "/dev/ttyUSB33"\nrate = "1 kHz"\nrange = "50 g"\n'
        '[auxiliary.calibration]\nserial_number = "A-1"'
    )
    rig = bench(tmp_path, more=auxiliary)
    config = station_config(rig, matrix(tmp_path), tmp_path / "ring")
    assert (config.limits.position_min_m, config.limits.position_max_m) == pytest.approx((-0.055, 0.065))
    assert (config.load_cell.offset, config.lvdt.sensitivity) == (3.0, 0.001)
    assert [sensor.name for sensor in config.auxiliary] == ["acceleration"]
    assert from_json(config.to_json()) == config
    wide = station_config(rig, matrix(tmp_path, "400 mm"), tmp_path / "ring")
    assert (wide.limits.position_min_m, wide.limits.position_max_m) == (-0.085, 0.085)


def test_the_recording_knows_each_sensors_calibration(tmp_path: Path) -> None:
    contexts = sensor_contexts(bench(tmp_path))
    assert set(contexts) == {"force", "displacement"}
    assert (contexts["force"].delay_s, contexts["force"].range_SI, contexts["force"].serial_number) == (
        2e-4,
        1e4,
        "LC-1",
    )


def test_a_users_file_is_on_the_disk_before_the_rig_is_connected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power cut a moment later must not leave a torn bench file: the campaign could never be resumed."""
    flushed: list[str] = []
    monkeypatch.setattr(os, "fsync", lambda handle: flushed.append(os.readlink(f"/proc/self/fd/{handle}")))
    source = tmp_path / "mine.toml"
    source.write_bytes(b"format = 1\r\n")
    folder = tmp_path / "campaign"
    folder.mkdir()
    keep_file(source, folder / "bench.toml")
    assert (folder / "bench.toml").read_bytes() == b"format = 1\r\n"
    assert flushed == [str(folder / "bench.toml.tmp"), str(folder)]
