"""Drivers of other packages: through the door of all devices, and refused by name when they are broken."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from drivers import plugins
from drivers.catalogue import SensorConnection, actuator_names, make_actuator, make_sensor, sensor_format_names
from drivers.connection import ActuatorConnection
from drivers.plugins import BrokenPlugIn
from drivers.ring import Channel
from drivers.sample_stream import SampleScale
from rig.bench.model import Bench
from rig.errors import FileProblem

if TYPE_CHECKING:
    from conftest import Install

EXAMPLE = (Path(__file__).resolve().parents[2] / "examples" / "demo-bench.toml").read_text(encoding="utf-8")
CONNECTION = SensorConnection("/dev/null", 9600, "load_cell", Channel.FORCE, "my_lab_cell", SampleScale())


def bench(folder: Path, register_map: str = "demo", force_format: str = "frame16") -> Path:
    """A bench file that names these."""
    text = EXAMPLE.replace('register_map = "demo"', f'register_map = "{register_map}"')
    path = folder / "bench.toml"
    path.write_text(text.replace('format = "frame16"', f'format = "{force_format}"', 1), encoding="utf-8")
    return path


def test_a_plug_ins_sensor_is_made_and_named_in_a_bench_file(my_lab: Path) -> None:
    assert type(make_sensor(CONNECTION)).__name__ == "MyLabCell"
    assert "my_lab_cell" in sensor_format_names()
    assert Bench.load(bench(my_lab, force_format="my_lab_cell")).load_cell.format == "my_lab_cell"


def test_the_example_driver_reads_its_lines_and_drops_damaged_ones(my_lab: Path) -> None:
    from my_lab.load_cell import Lines, reading  # type: ignore[import-not-found]  # installed by the fixture

    assert reading(b"@+01234.5*04") == 1234.5  # XOR of 2B 30 31 32 33 34 2E 35, by hand
    assert reading(b"@+01234.5*05") is None
    assert reading(b"@+01x34.5*4E") is None
    lines = Lines()
    got = [one for piece in (b"34.5*04\r\n@-000", b"00.5*0", b"6\r\n@+01234.5*05\r\n") for one in lines.feed(piece)]
    assert got == [(1, -1, -0.5, 0, 0)]  # XOR of 2D 30 30 30 30 30 2E 35: the five 30 leave one
    assert (lines.bad_frames, lines.skipped_bytes) == (1, 7 + 12)


def test_nothing_of_a_plug_in_runs_before_its_name_is_used(install: Install) -> None:
    install("loud-lab", {"mr_rig.actuators": {"loud": "loud_lab:make"}}, "raise RuntimeError('I was loaded')")
    assert "loud" in actuator_names()
    assert make_actuator("demo", ActuatorConnection("modbus-tcp://127.0.0.1:1"))
    assert "loud_lab" not in sys.modules


def test_a_broken_driver_is_refused_with_its_package_and_entry_point_when_the_bench_is_read(install: Install) -> None:
    folder = install("ill-lab", {"mr_rig.actuators": {"ill": "ill_lab:make"}}, "raise RuntimeError('no licence')")
    with pytest.raises(FileProblem) as refused:
        Bench.load(bench(folder, register_map="ill"))
    (problem,) = refused.value.problems
    assert "actuator.register_map" in problem
    assert "package ill-lab 1.0 (entry point mr_rig.actuators: ill = ill_lab:make)" in problem
    assert "RuntimeError: no licence" in problem


@pytest.mark.parametrize(
    ("source", "why"),
    [
        ("", "has no attribute 'make'"),
        ("import not_there_at_all", "No module named 'not_there_at_all'"),
        ("import sys\nsys.exit('bye')", "SystemExit: bye"),
        ("make = 3", "expected a function or class that creates a driver, got int"),
        ("def make(connection): raise ValueError('no such port')", "cannot create a driver: ValueError: no such"),
        ("def make(connection): return object()", "required for its role; missing: busy, capabilities, close"),
    ],
)
def test_whatever_is_wrong_with_a_driver_is_one_kind_of_error(install: Install, source: str, why: str) -> None:
    install("odd-lab", {"mr_rig.actuators": {"odd": "odd_lab:make"}}, source)
    with pytest.raises(BrokenPlugIn, match=r"package odd-lab 1\.0") as broken:
        make_actuator("odd", ActuatorConnection("tcp://127.0.0.1:1"))
    assert why in str(broken.value)
    assert broken.value.code == "plugin-broken"


def test_a_plug_in_cannot_stand_in_a_built_ins_place(install: Install) -> None:
    install(
        "sly-lab", {"mr_rig.actuators": {"demo": "sly_lab:make"}, "mr_rig.sensors": {"frame16": "sly_lab:make"}},
        "raise RuntimeError('never')",
    )
    assert type(make_actuator("demo", ActuatorConnection("modbus-tcp://127.0.0.1:1"))).__name__ == "ModbusActuator"
    assert actuator_names().count("demo") == 1
    made = make_sensor(SensorConnection("/dev/null", 9600, "lvdt", Channel.DISPLACEMENT, "frame16", SampleScale()))
    assert type(made).__name__ == "SerialSensor"


def test_one_name_of_two_packages_is_refused_with_both(install: Install) -> None:
    install("first-lab", {"mr_rig.sensors": {"twice": "first_lab:make"}}, "make = print")
    install("second-lab", {"mr_rig.sensors": {"twice": "second_lab:make"}}, "make = print")
    with pytest.raises(BrokenPlugIn, match=r"first-lab 1\.0.*second-lab 1\.0"):
        plugins.maker_of(plugins.SENSORS, "twice")


def test_the_process_that_owns_the_ports_finds_a_driver_and_stays_small(my_lab: Path) -> None:
    script = (
        "import sys\n"
        "from drivers.catalogue import SensorConnection, make_sensor\n"
        "from drivers.ring import Channel\n"
        "from drivers.sample_stream import SampleScale\n"
        "make_sensor(SensorConnection('/dev/null', 9600, 'load_cell', Channel.FORCE, 'my_lab_cell', SampleScale()))\n"
        "heavy = {'numpy', 'pandas', 'h5py', 'pydantic', 'my_lab.friction'} & set(sys.modules)\n"
        "sys.exit(f'loaded: {heavy}' if heavy else 0)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, env={"PYTHONPATH": str(my_lab)}
    )
    assert done.returncode == 0, done.stderr


def test_a_driver_that_says_what_it_works_with_is_believed(my_lab: Path, install: Install) -> None:
    message = plugins.simulated_as(plugins.SENSORS, "my_lab_cell")
    assert isinstance(message, dict)
    assert message["template"] == "@{value:+08.1f}*{checksum}"
    assert plugins.simulated_as(plugins.SENSORS, "frame16") is None
    install("vague-lab", {"mr_rig.sensors": {"vague": "vague_lab:make"}}, "def make(c): ...\nmake.simulated_as = 7")
    with pytest.raises(BrokenPlugIn, match="simulated_as: got 7, expected a name or a line description"):
        plugins.simulated_as(plugins.SENSORS, "vague")
