"""A simulated rig that is asked to have the devices of a bench file: what it is told."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from rig.bench.model import Bench
from rig.campaign import simulated_rig
from rig.campaign.results import CampaignOptions
from rig.campaign.simulated_rig import SimulatedRig, wearing
from rig.errors import FileProblem, Refused
from rig.files.toml_source import read_toml
from rig.matrix.sections import Specimen
from simulators.emulated_format import sending
from simulators.options import RigOptions
from simulators.toml_text import toml_text

EXAMPLES = Path(__file__).parents[3] / "examples"


def bench(folder: Path, *changes: tuple[str, str]) -> Path:
    text = (EXAMPLES / "demo-bench.toml").read_text(encoding="utf-8")
    for before, after in changes:
        assert before in text
        text = text.replace(before, after, 1)
    (folder / "bench.toml").write_text(text, encoding="utf-8")
    return folder / "bench.toml"


def after(option: str, arguments: tuple[str, ...]) -> list[str]:
    return [value for name, value in itertools.pairwise(arguments) if name == option]


def test_devices_rates_and_limits_are_those_of_the_file(tmp_path: Path) -> None:
    for name in ("coil-driver.dbc", "coil-driver-roles.toml"):
        (tmp_path / name).write_bytes((EXAMPLES / name).read_bytes())
    path = bench(
        tmp_path, ('dbc = "demo"', 'dbc = "coil-driver.dbc"\nroles = "coil-driver-roles.toml"'),
        ('format = "frame16"', 'format = "laumas-fast"'), ('rate = "250 Hz"', 'rate = "300 Hz"'),
        ("modbus-tcp://192.168.0.10:502", "modbus-rtu:/dev/ttyUSB0"), ('speed = "0.8 m/s"', 'speed = "0.3 m/s"'),
        ('force = "5 kN"', 'force = "8 kN"'),
    )
    arguments = wearing(path)
    assert after("--actuator", arguments) == ["rtu"]
    assert after("--dbc", arguments) == [str(tmp_path / "coil-driver.dbc")]
    assert after("--ecu-roles", arguments) == [str(tmp_path / "coil-driver-roles.toml")]
    assert (after("--force-format", arguments), after("--displacement-format", arguments)) == (
        ["laumas-fast"], ["frame16"])
    options = set(after("--option", arguments))
    assert {"load_cell.rate_Hz=300.0", "lvdt.rate_Hz=250.0", "load_cell.baudrate=921600"} <= options
    assert {"limits.speed_m_s=0.3", "limits.force_N=5000.0"} <= options, "not beyond what the simulated machine reaches"


def test_a_supply_described_inside_of_the_bench_file_is_refused_with_what_to_do(tmp_path: Path) -> None:
    text = (EXAMPLES / "labjack-bench.toml").read_text(encoding="utf-8")
    supply = toml_text(read_toml(EXAMPLES / "labjack-output.toml").data)
    path = tmp_path / "bench.toml"
    path.write_text(text.replace('supply = "labjack-output.toml"', f"supply = {supply}"), encoding="utf-8")
    with pytest.raises(FileProblem, match=r"ecu\.supply: .*in the bench file itself.* separate file"):
        wearing(path)


@pytest.mark.parametrize("name", ["can-sensors", "labjack"])
def test_sensors_described_inside_of_the_bench_file_are_simulated(name: str) -> None:
    """Their tables reach the simulated rig, which sends them; damaged ones are refused."""
    path = EXAMPLES / f"{name}-bench.toml"
    bench, arguments = Bench.load(path), wearing(path)
    for option, entry in (("--force-format", bench.load_cell.format), ("--displacement-format", bench.lvdt.format)):
        (given,) = after(option, arguments)
        sensor = sending(RigOptions().lvdt, given, option, 0.0)
        assert sensor.described == (json.loads(json.dumps(entry)) if isinstance(entry, Mapping) else entry)
        assert not isinstance(sensor.format, str)
    for damaged in ("{", '{"kind": "no such kind"}'):
        with pytest.raises(FileProblem, match="--force-format"):
            sending(RigOptions().load_cell, damaged, "--force-format", 0.0)


def test_a_supply_of_the_bench_is_worn_too(tmp_path: Path) -> None:
    text = (EXAMPLES / "demo-bench.toml").read_text(encoding="utf-8")
    ecu = '[ecu]\nurl = "/dev/ttyUSB2"\nsupply = "rs-hmp"\nvoltage_limit = "9 V"\nstale_after = "1 s"\n\n'
    path = tmp_path / "bench.toml"
    path.write_text(text[: text.index("[ecu]")] + ecu + text[text.index("[load_cell]") :], encoding="utf-8")
    assert after("--supply", wearing(path)) == ["rs-hmp"]


@pytest.mark.parametrize(("does", "cause"), [("exec sleep 30", "no processor time for 0 s"), ("exit 9", "exit code 9")])
def test_a_start_that_takes_too_long_is_not_reported_as_an_exit_code(
    does: str, cause: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "simulator.sh"
    program.write_text(f"#!/bin/sh\n{does}\n", encoding="ascii")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))
    if "sleep" in does:
        monkeypatch.setattr(simulated_rig, "START_TIMEOUT_S", 0.2)
    specimen = Specimen.model_validate({"serial_number": "S", "stroke": "170 mm", "mid_stroke": "0 mm"})
    with pytest.raises(Refused, match=cause) as refused:
        SimulatedRig.start(tmp_path, CampaignOptions(tmp_path / "matrix.toml", tmp_path), specimen, lambda _: None)
    assert refused.value.slug == "simulator"


@pytest.mark.parametrize(("ticks", "line"), [(itertools.count(1), "bench.toml"), (itertools.repeat(0), None)])
def test_a_simulated_rig_that_gets_processor_time_is_waited_for_however_long_it_takes(
    ticks: Iterator[int], line: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated_rig, "_processor_ticks", lambda _: next(ticks))
    monkeypatch.setattr(simulated_rig, "LOOK_AGAIN_S", 0.02)
    with subprocess.Popen(["sh", "-c", "sleep 0.6; echo bench.toml"], stdout=subprocess.PIPE) as process:
        assert simulated_rig._first_line(process, 0.2, lambda _: None) == line
