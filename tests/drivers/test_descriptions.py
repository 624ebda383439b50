"""A description that cannot serve its device is refused before anything is asked of it, in one line with its place."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from drivers.catalogue import check_actuator
from drivers.devices import controller as controllers
from drivers.devices import source as sources
from drivers.devices.controller import ControllerDescription
from drivers.roles import Command
from protocols.errors import LocalProtocolError
from rig.bench.model import Bench
from rig.errors import FileProblem

CONTROLLER = (controllers.FOLDER / "demo_controller.toml").read_text(encoding="utf-8")
ECU = (sources.FOLDER / "demo_ecu.toml").read_text(encoding="utf-8")
DBC = (sources.FOLDER / "demo_ecu.dbc").read_text(encoding="utf-8")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    for module in (controllers, sources):
        monkeypatch.setattr(module, "FOLDER", tmp_path)
    yield tmp_path
    controllers.controller.cache_clear()
    sources._preset.cache_clear()


def status_without(name: str) -> Callable[[dict[str, Any]], None]:
    def change(data: dict[str, Any]) -> None:
        block = next(block for block in data["block"] if block["name"] == "status")
        block["registers"] = [register for register in block["registers"] if register["name"] != name]

    return change


def without(*place: str) -> Callable[[dict[str, Any]], None]:
    def change(data: dict[str, Any]) -> None:
        for key in place[:-1]:
            data = data[key]
        del data[place[-1]]

    return change


def given(value: object, *place: str) -> Callable[[dict[str, Any]], None]:
    def change(data: dict[str, Any]) -> None:
        for key in place[:-1]:
            data = data[key]
        data[place[-1]] = value

    return change


def register(**entries: object) -> Callable[[dict[str, Any]], None]:
    """The status's last register, the force, with other entries."""

    def change(data: dict[str, Any]) -> None:
        data["block"][1]["registers"][-1] |= entries

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (without("capabilities"), r"\[capabilities\] is missing"),
        (without("capabilities", "watchdog"), "'watchdog' is missing"),
        (given("dog", "capabilities", "watchdog"), "'dog': must be one of counter, timeout, none"),
        (given("false", "capabilities", "lease"), "must be true or false"),
        (given(True, "capabilities", "streamed_setpoints"), "block 'setpoint' is missing"),
        (given(False, "capabilities", "generator"), "it must follow set-points that are streamed to it"),
        (given(True, "capabilities", "leases"), "did you mean lease"),
        (given("can", "driver"), 'driven by "modbus"'),
        (without("codes", "command", "fade-stop"), "'fade-stop' is missing; .* generator = true needs it"),
        (without("codes", "command", "hydraulics-off"), r"'hydraulics-off' is missing; \[capabilities\] hydraulics"),
        (without("bits", "input"), r"\[bits.input\]: 'hydraulics-low' is missing"),
        (without("bits", "input", "e-stop-closed"), r"'e-stop-closed' is missing; \[capabilities\] e_stop_input"),
        (without("bits", "fault", "watchdog"), "'watchdog' is missing"),
        (without("codes", "state", "tripped"), "'tripped' is missing"),
        (status_without("state"), "block 'status': 'state' is missing"),
        (status_without("force"), r"'force' is missing; \[capabilities\] force_input = true needs it"),
        (status_without("owner"), r"'owner' is missing; \[capabilities\] lease = true needs it"),
        (given(3, "codes", "state", "hold"), "hold and moving are both 3"),
        (given("3", "codes", "state", "hold"), "must be a whole number of 0 to 65535"),
        (given(7, "codes", "command", "fade-stop"), "start and fade-stop are both 7"),
        (given(-1, "bits", "fault", "e-stop"), "must be a whole number of 0 to 31"),
        (given(16, "bits", "input", "valve-saturated"), "must be a whole number of 0 to 15"),
        (given([], "block"), r"\[\[block\]\] is missing"),
        (register(name="forces"), "did you mean force"),
        (register(name="position"), "'position' is given twice"),
        (register(address=250), "at most 125"),
        (register(address="132"), "address = '132': must be a whole number"),
        (register(scale=0), "scale 0 is not a usable factor"),
        (register(scale=float("nan")), "scale nan is not a usable factor"),
        (register(scale=float("inf")), "scale inf is not a usable factor"),
        (register(scale="x"), "must be a number"),
        (register(type="string", length=2), "it is a number"),
        (register(colour="red"), "'colour' is not one of"),
        (given("1", "identity", "layout_version"), "must be a number"),
        (given(1, "identity", "layout"), "did you mean layout_version"),
        (given(70000, "identity", "layout_version"), "cannot hold 70000"),
    ],
)
def test_a_controllers_description_that_cannot_serve_it_is_refused_by_place(
    change: Callable[[dict[str, Any]], None], message: str
) -> None:
    data = tomllib.loads(CONTROLLER)
    change(data)
    with pytest.raises(LocalProtocolError, match=message):
        ControllerDescription("other", data)


def commanded_without(data: dict[str, Any], name: str) -> dict[str, Any]:
    command = next(block for block in data["block"] if block["name"] == "command")
    command["registers"] = [item for item in command["registers"] if item["name"] != name]
    return data


def test_a_controller_without_leases_needs_no_register_for_an_owner() -> None:
    data = commanded_without(tomllib.loads(CONTROLLER), "owner_id")
    with pytest.raises(LocalProtocolError, match=r"'owner_id' is missing; \[capabilities\] lease"):
        ControllerDescription("plain", data)
    data["capabilities"]["lease"] = False
    assert ControllerDescription("plain", data).encode_command(Command.HALT, 7, 9)[:2] == [Command.HALT, 7]


def test_a_command_without_a_sequence_could_be_carried_out_twice_and_is_refused() -> None:
    data = commanded_without(tomllib.loads(CONTROLLER), "sequence")
    data["capabilities"] |= {"acknowledge": False}
    with pytest.raises(LocalProtocolError, match="'sequence' is missing; every controller needs it"):
        ControllerDescription("plain", data)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (CONTROLLER.encode("utf-16"), "byte 0 is 0xFF, which is not UTF-8"),
        (CONTROLLER.encode() + b"\n[[[", r"not TOML: .*line"),
        (b"a = " + b"[" * 100_000, "not TOML"),
        (b"#" * 300_000, "larger than the 256 KiB"),
        (b"", r"\[capabilities\] is missing"),
        (None, "there is no such file"),
    ],
)
def test_a_description_that_is_no_such_file_is_refused_with_its_path(
    folder: Path, content: bytes | None, message: str
) -> None:
    path = folder / "other_controller.toml"
    if content is None:
        path.mkdir()
    else:
        path.write_bytes(content)
    with pytest.raises(LocalProtocolError, match=message) as refused:
        check_actuator("other")
    assert str(path) in str(refused.value)


def test_a_bench_whose_device_is_wrongly_described_is_refused_when_it_is_read(folder: Path) -> None:
    for name, content in (("demo_ecu.toml", ECU), ("demo_ecu.dbc", DBC), ("demo_controller.toml", CONTROLLER)):
        (folder / name).write_text(content, encoding="utf-8")
    (folder / "other_controller.toml").write_text(CONTROLLER.replace("hydraulics-off = 5\n", ""), encoding="utf-8")
    example = Path(__file__).parents[2] / "examples" / "demo-bench.toml"
    bench = folder / "bench.toml"
    bench.write_text(example.read_text(encoding="utf-8").replace('register_map = "demo"', 'register_map = "other"'))
    with pytest.raises(FileProblem, match=r"line \d+: actuator.register_map = \"other\".*'hydraulics-off' is missing"):
        Bench.load(bench)
