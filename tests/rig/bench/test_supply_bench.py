"""A bench whose coil is driven by a supply: what its file must say, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.bench.model import Bench
from rig.bench.settings import StationConfig
from rig.bench.settings_json import from_json
from rig.campaign.file_copies import keep_bench
from rig.campaign.machine_resources import device_names, station_config
from rig.campaign.setup import accepted
from rig.errors import FileProblem, Refused
from rig.matrix.model import load_matrix

EXAMPLES = Path(__file__).parents[3] / "examples"
TEXT = (EXAMPLES / "demo-bench.toml").read_text(encoding="utf-8")
HEAD, REST = TEXT[: TEXT.index("[ecu]")], TEXT[TEXT.index("[load_cell]") :]
SUPPLY = """[ecu]
url = "tcp://192.168.0.20:5025"
supply = "generic-scpi"
voltage_limit = "12 V"
stale_after = "500 ms"
"""
OWN = """[range]
current_A = [0, 5]
[commands]
set_current = "I {current_A:.3f}"
measure_current = "I?"
"""


def written(folder: Path, ecu: str = SUPPLY, head: str = HEAD) -> Path:
    path = folder / "bench.toml"
    path.write_text(f"{head}{ecu}\n{REST}", encoding="utf-8")
    return path


def problems(folder: Path, ecu: str, head: str = HEAD) -> list[str]:
    with pytest.raises(FileProblem) as caught:
        Bench.load(written(folder, ecu, head))
    return caught.value.problems


def test_a_supply_takes_the_place_of_the_bus(tmp_path: Path) -> None:
    bench = Bench.load(written(tmp_path))
    assert (bench.ecu.port, bench.ecu.voltage_limit_V, bench.ecu.poll_s) == ("tcp://192.168.0.20:5025", 12.0, 0.1)
    assert device_names(bench.ecu.port) == device_names("socket://192.168.0.20:5025")


def test_an_ecu_bench_is_what_it_was() -> None:
    bench = Bench.load(EXAMPLES / "demo-bench.toml")
    assert bench.ecu.port == "socketcan:can0"
    hashed = bench.model_dump(include={"ecu"}, exclude={"ecu": bench.ecu.not_physics})
    assert hashed == {"ecu": {"dbc": "demo", "serial_number": None}}, "what was hashed before there were supplies"


def test_a_file_is_found_beside_the_bench_file_and_kept_with_the_campaign(tmp_path: Path) -> None:
    (tmp_path / "supplies").mkdir()
    (tmp_path / "supplies/mine.toml").write_text(OWN, encoding="utf-8")
    ecu = SUPPLY.replace("generic-scpi", "supplies/mine.toml").replace('voltage_limit = "12 V"\n', "")
    path = written(tmp_path, ecu)
    bench = Bench.load(path)
    assert bench.ecu.supply == str(tmp_path / "supplies/mine.toml")
    kept = tmp_path / "campaign"
    kept.mkdir()
    before = bench.digest
    keep_bench(path, kept / "bench.toml")
    (tmp_path / "supplies/mine.toml").write_text(OWN.replace("I?", "J?"), encoding="utf-8")
    again = Bench.load(kept / "bench.toml")
    assert again.digest == before != Bench.load(path).digest
    assert (kept / "supplies/mine.toml").read_text(encoding="utf-8") == OWN


def test_a_table_says_the_same_as_a_file(tmp_path: Path) -> None:
    table = OWN.replace("[range]", "[ecu.supply.range]").replace("[commands]", "[ecu.supply.commands]")
    ecu = SUPPLY.replace('supply = "generic-scpi"\n', "").replace('voltage_limit = "12 V"\n', "") + table
    bench = Bench.load(written(tmp_path, ecu))
    config = station_config(bench, load_matrix(EXAMPLES / "quick.toml"), tmp_path / "ring")
    there = from_json(config.to_json())
    assert isinstance(there, StationConfig)
    assert there.ecu.supply == {
        "range": {"current_A": [0, 5]}, "commands": {"set_current": "I {current_A:.3f}", "measure_current": "I?"},
    }
    assert there.ecu.url == bench.ecu.url


@pytest.mark.parametrize(
    ("before", "after", "says"),
    [
        ('url = "tcp://192.168.0.20:5025"', "", "ecu.url: missing; write, for example, url ="),
        ('supply = "generic-scpi"', "", "ecu.supply: missing; write supply ="),
        ("generic-scpi", "generic-scip", "unknown 'generic-scip'; known: generic-scpi"),
        ("generic-scpi", "gone.toml", "gone.toml: there is no such file"),
        ('voltage_limit = "12 V"', "", "ecu.voltage_limit: missing"),
        ('"12 V"', '"90 V"', "is outside the supply's range; allowed: 0 V to 60 V"),
        ('"500 ms"', '"150 ms"', "is shorter than two poll periods of the supply; allowed: at least 200 ms"),
        ('"500 ms"', '"300 ms"', "ecu.timeout"),
        ("tcp://192.168.0.20:5025", "tcp://192.168.0.20", "requires a host and a port"),
        ("tcp://192.168.0.20:5025", "visa://192.168.0.20:5025", "unknown kind of port"),
        ('url = "tcp', 'channel = "can0"\nurl = "tcp', "applies to a current controller on CAN"),
        ('url = "tcp', 'serial_number = 5\nurl = "tcp', "write identity"),
    ],
)
def test_what_is_missing_or_wrong_is_named_with_its_place(tmp_path: Path, before: str, after: str, says: str) -> None:
    found = problems(tmp_path, SUPPLY.replace(before, after))
    assert any(says in line for line in found), found


def test_everything_wrong_in_both_files_is_reported_together(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(OWN.replace("[0, 5]", "[1, 5]").replace("I?", "I{x}?"), encoding="utf-8")
    found = problems(tmp_path, '[ecu]\nurl = "tcp://a"\nsupply = "mine.toml"\n')
    assert any("requires a host and a port" in line for line in found)
    assert any("mine.toml: line 5: commands.measure_current = " in line for line in found)
    assert any("mine.toml: line 2: range.current_A = [1, 5]: does not include 0 A" in line for line in found)
    (tmp_path / "mine.toml").write_text(OWN, encoding="utf-8")
    found = problems(tmp_path, '[ecu]\nurl = "tcp://a:1"\nsupply = "mine.toml"\n')
    assert any("stale_after" in line for line in found)


OUTPUT = """[range]
current_A = [0, 5]
[quantities]
current = {address = 0, scale = 0.001, unit = "A"}
"""
BY_OUTPUT = """[ecu]
url = "modbus-tcp://192.168.0.30:502"
supply = "mine.toml"
device_id = 7
stale_after = "500 ms"
"""


def test_an_analogue_output_is_reached_by_modbus_and_is_not_measured_unless_it_says_so(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(OUTPUT, encoding="utf-8")
    bench = Bench.load(written(tmp_path, BY_OUTPUT))
    assert (bench.ecu.port, bench.ecu.device_id, bench.ecu.measured) == ("modbus-tcp://192.168.0.30:502", 7, False)
    assert Bench.load(written(tmp_path)).ecu.measured
    other = BY_OUTPUT.replace("modbus-tcp://", "tcp://")
    assert any("a supply with registers ([quantities]) must be connected over "
        "Modbus" in line for line in problems(tmp_path, other))
    lines = SUPPLY.replace("tcp://", "modbus-tcp://")
    assert any("a supply with text commands cannot be connected over "
        "Modbus" in line for line in problems(tmp_path, lines))
    head, line = HEAD.replace("modbus-tcp://192.168.0.10:502", "modbus-rtu:/dev/ttyS1"), "modbus-rtu:/dev/ttyS1"
    shared = BY_OUTPUT.replace("modbus-tcp://192.168.0.30:502", line)
    assert any("is the serial line of [actuator]" in line for line in problems(tmp_path, shared, head))
    (tmp_path / "mine.toml").write_text(OUTPUT.replace('"A"', '"m"'), encoding="utf-8")
    found = problems(tmp_path, BY_OUTPUT)
    assert any("mine.toml: line 4: quantities.current: must be a current" in line for line in found), found


def test_the_limit_lies_within_what_the_supply_gives(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(OWN.replace("[0, 5]", "[0, 2]"), encoding="utf-8")
    ecu = SUPPLY.replace("generic-scpi", "mine.toml").replace('voltage_limit = "12 V"\n', "")
    assert any("limits.current" in line and "allowed: within 0 A to 2 A" in line for line in problems(tmp_path, ecu))


MATRIX = (EXAMPLES / "quick.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("before", "after", "slug"),
    [
        ("[campaign]", "[campaign]\ndemagnetise = true", "source-without-negative-current"),
        ("[campaign]", '[temperature]\nwindow = ["25 degC", "40 degC"]\n[campaign]', "source-without-temperature"),
    ],
)
def test_a_matrix_that_the_supply_cannot_drive_is_refused(
    tmp_path: Path, before: str, after: str, slug: str
) -> None:
    path = tmp_path / "matrix.toml"
    path.write_text(MATRIX.replace(before, after), encoding="utf-8")
    with pytest.raises(Refused) as caught:
        accepted(load_matrix(path), Bench.load(written(tmp_path)))
    assert caught.value.slug == slug
