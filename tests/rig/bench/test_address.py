"""Addresses in a bench file: what python-can and pyserial know, and nothing else."""

from __future__ import annotations

import pkgutil
import subprocess
import sys

import pytest
import serial.urlhandler
from can.interfaces import BACKENDS

from rig.bench import address
from rig.bench.model import Bench
from rig.comparison.bands import Bands
from rig.files.loader import TABLES
from rig.files.section import fields_of, key_of
from rig.matrix.model import Matrix
from rig.study.benchmark_file import BenchmarkFile
from rig.study.study_file import StudyFile
from rig.vehicle.car import Car
from rig.vehicle.road_file import RoadFile


def test_the_interfaces_are_those_of_python_can() -> None:
    assert set(address.INTERFACES) == set(BACKENDS)


def test_the_schemes_are_those_of_pyserial() -> None:
    handlers = {module.name.removeprefix("protocol_") for module in pkgutil.iter_modules(serial.urlhandler.__path__)}
    assert set(address.SCHEMES) == handlers


def test_checking_an_interface_loads_no_CAN_driver() -> None:
    look = "address.can_interface('socketcan'); sys.exit('can' in sys.modules)"
    script = f"import sys; from rig.bench import address; {look}"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


@pytest.mark.parametrize(
    ("written", "meant"),
    [("peak", "pcan"), ("PCAN", "pcan"), ("can0", "socketcan"), ("kvasser", "kvaser"), ("slcn", "slcan")],
)
def test_an_unknown_interface_is_refused_with_the_one_that_was_meant(written: str, meant: str) -> None:
    with pytest.raises(ValueError, match=f'did you mean "{meant}"'):
        address.can_interface(written)


@pytest.mark.parametrize(
    "text",
    ["/dev/ttyUSB0", "/dev/serial/by-id/usb-FTDI_a:b", "COM3", "socket://10.0.0.7:4001", "socket://[::1]:4001",
     "rfc2217://host:2217?ign_set_control", "loop://", "/dev/pts/3"],
)  # fmt: skip
def test_what_pyserial_takes_is_taken(text: str) -> None:
    assert address.serial_url(text) == text
    assert address.modbus_url(f"modbus-rtu:{text}") == f"modbus-rtu:{text}"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("socket://host", "requires a host and a port"),
        ("socket://:4001", "requires a host and a port"),
        ("socket://host:0", "requires a host and a port"),
        ("socket://host:70000", "port out of range"),
        ("host:4001", 'write "socket://host:4001"'),
        ("socket:host:4001", 'write "socket://host:4001"'),
        ("http://host:1", "unknown kind of port http://"),
    ],
)
def test_what_pyserial_does_not_take_is_refused_with_what_would_be_right(text: str, expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        address.serial_url(text)


def test_files_are_recognised_by_tables_that_only_they_have() -> None:
    kinds = {
        "bench": Bench, "matrix": Matrix, "study": StudyFile, "benchmark": BenchmarkFile, "car": Car, "road": RoadFile,
        "bands": Bands,
    }  # fmt: skip
    keys = {kind: {key_of(model, name) for name in fields_of(model)} for kind, model in kinds.items()}
    for kind, tables in TABLES.items():
        assert tables <= keys[kind]
        assert not any(tables & others for other, others in keys.items() if other != kind)


def test_an_interface_whose_package_is_not_installed_is_refused_when_the_file_is_read(
    monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "can.interfaces.canalystii", raising=False)
    monkeypatch.setitem(sys.modules, "canalystii", None)
    with pytest.raises(ValueError, match=r"requires for this interface is not installed: .*canalystii"):
        address.can_interface("canalystii")
