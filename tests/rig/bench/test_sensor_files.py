"""Sensors described by files, and their calibration: what a bench file may say, and what it is told otherwise."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from drivers.connection import modbus_line
from drivers.sensor_formats import described_format
from protocols.binary_format import BinaryFormat
from rig.bench.model import Bench
from rig.bench.settings_json import from_json
from rig.campaign.file_copies import keep_bench
from rig.campaign.machine_resources import station_config
from rig.errors import FileProblem
from rig.files.descriptions import table_of
from rig.matrix.model import load_matrix

EXAMPLES = Path(__file__).parents[3] / "examples"
MATRIX = load_matrix(EXAMPLES / "quick.toml")
TEXT = (EXAMPLES / "demo-bench.toml").read_text(encoding="utf-8")
FORMAT = """
sync = [0xAA, 0x55]
length = 10
checksum = "crc16-modbus"
[fields.value]
at = 2
type = "i32"
"""


def bench(folder: Path, *edits: tuple[str, str], described: str = FORMAT) -> Path:
    text = TEXT
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    folder.mkdir(exist_ok=True)
    (folder / "cell.toml").write_text(described, encoding="utf-8")
    path = folder / "bench.toml"
    path.write_text(text, encoding="utf-8")
    return path


BY_FILE = ('format = "frame16"', 'format = "cell.toml"\nparity = "E"')
CALIBRATION = 'sensitivity = 1.0                  # N per unit on the wire\noffset = "0 N"'


def refused(path: Path) -> list[str]:
    with pytest.raises(FileProblem) as caught:
        Bench.load(path)
    return caught.value.problems


def test_a_format_s_file_is_looked_for_beside_the_bench_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = bench(tmp_path / "lab", BY_FILE)
    monkeypatch.chdir(tmp_path)
    loaded = Bench.load(path)
    assert isinstance(described_format(loaded.load_cell.described), BinaryFormat)
    assert loaded.load_cell.line.parity == "E"
    config = station_config(loaded, MATRIX, tmp_path / "ring")
    path.with_name("cell.toml").unlink()  # the station reads no file: the table goes with its settings
    assert isinstance(described_format(from_json(config.to_json()).load_cell.format), BinaryFormat)


def test_the_bench_is_another_one_when_its_format_s_content_changes(tmp_path: Path) -> None:
    digests = {
        Bench.load(bench(tmp_path / name, BY_FILE, described=text)).digest
        for name, text in (("a", FORMAT), ("b", FORMAT), ("c", FORMAT + "scale = 2.0\n"))
    }
    assert len(digests) == 2


def test_a_kept_bench_file_finds_its_format_again(tmp_path: Path) -> None:
    path = bench(tmp_path / "lab", BY_FILE)
    kept = tmp_path / "campaign"
    kept.mkdir()
    keep_bench(path, kept / "bench.toml")
    path.with_name("cell.toml").unlink()
    assert Bench.load(kept / "bench.toml").load_cell.format == str(kept / "cell.toml")


NETWORK = (EXAMPLES / "can-sensors.dbc").read_text(encoding="utf-8")
CAN_BENCH = (EXAMPLES / "can-sensors-bench.toml").read_text(encoding="utf-8")
CAN_FORMAT = 'dbc = "{}"\nsignal = "LoadCell.Force"\n'
BY_TABLE = CAN_BENCH[CAN_BENCH.index("[load_cell.format]") : CAN_BENCH.index("[lvdt]")]


@pytest.mark.parametrize(("force", "network", "travel"), [
    ("force.toml", "../n.dbc", "can-sensors.dbc"),
    ("../formats/force.toml", "net/n.dbc", "can-sensors.dbc"),
    ("formats/force.toml", "../../n.dbc", "can-sensors.dbc"),
    ("../a/force.toml", "can-sensors.dbc", "can-sensors.dbc"),  # two files of one name
    ("../bench.toml", "n.dbc", "../t.dbc"),
    ("../kräfte/force.toml", "n.dbc", "../t.dbc"),
])  # fmt: skip
@pytest.mark.parametrize("quote", ['"', "'"])
def test_a_kept_bench_file_finds_every_file_wherever_it_was(
    tmp_path: Path, force: str, network: str, travel: str, quote: str
) -> None:
    lab, kept = tmp_path / "lab" / "benches", tmp_path / "out" / "campaign"
    for name, text in ((force, CAN_FORMAT.format(network)), (str(Path(force).parent / network), NETWORK + "\n"),
                       (travel, NETWORK)):  # fmt: skip
        (lab / name).parent.mkdir(parents=True, exist_ok=True)
        (lab / name).write_text(text, encoding="utf-8")
    text = CAN_BENCH.replace(BY_TABLE, "").replace("[load_cell]", f"[load_cell]\nformat = {quote}{force}{quote}", 1)
    text = text.replace('dbc = "can-sensors.dbc"', f"dbc = {quote}{travel}{quote}")
    (lab / "bench.toml").write_text(text, encoding="utf-8")
    kept.mkdir(parents=True)
    before = Bench.load(lab / "bench.toml").digest
    keep_bench(lab / "bench.toml", kept / "bench.toml")
    (tmp_path / "lab").rename(tmp_path / "elsewhere")
    assert Bench.load(kept / "bench.toml").digest == before
    assert list((tmp_path / "out").iterdir()) == [kept]


@pytest.mark.parametrize(("edits", "place", "text"), [
    ({"lvdt": ("/dev/ttyUSB7", 'address = 2')}, "lvdt.url", 'framing = "rtu"'),
    ({"lvdt": ("modbus-tcp://192.168.0.40:502", "address = 1")}, "lvdt.format", "belong to the reading of [load_cell]"),
    ({"lvdt": ("/dev/ttyUSB7", 'address = 2, framing = "rtu", device_id = 255')}, "device_id", "1 to 247"),
    ({"lvdt": ("socket://192.168.0.40:502", 'address = 2, framing = "rtu"')}, "lvdt.format",
     "[ecu] uses framing tcp on the same connection"),
    ({"ecu": ("modbus-rtu:/dev/ttyUSB0", ""), "lvdt": ("/dev/ttyUSB0", 'address = 2, framing = "rtu"')}, "lvdt.url",
     "921600 Bd and parity N here, 9600 Bd and parity N for [ecu]"),
    ({"lvdt": ("/dev/ttyUSB7\"\nbaudrate = 9600\nparity = \"N", 'address = 2, framing = "rtu"')}, "lvdt.rate",
     "at most 40 Hz"),
    ({"lvdt": ("modbus-tcp://192.168.0.40:502\"\nbandwidth = \"9 kHz", 'address = 2')}, "lvdt.rate", "at most 1000 Hz"),
])  # fmt: skip
def test_what_cannot_be_on_one_modbus_connection_is_refused(
    tmp_path: Path, edits: dict[str, tuple[str, str]], place: str, text: str
) -> None:
    written = (EXAMPLES / "labjack-bench.toml").read_text(encoding="utf-8")
    for table, (url, entries) in edits.items():
        head = f'[{table}]\nurl = "modbus-tcp://192.168.0.40:502"'
        assert head in written
        written = written.replace(head, f'[{table}]\nurl = "{url}"')
        written = written.replace("address = 2", entries) if entries else written
        written = written.replace('rate = "100 Hz"', 'rate = "5 kHz"') if place == "lvdt.rate" else written
    (tmp_path / "labjack-output.toml").write_bytes((EXAMPLES / "labjack-output.toml").read_bytes())
    (tmp_path / "bench.toml").write_text(written, encoding="utf-8")
    with pytest.raises(FileProblem) as error:
        Bench.load(tmp_path / "bench.toml")
    assert place in str(error.value)
    assert text in str(error.value)


def test_a_port_s_name_and_a_link_to_it_are_one_line(tmp_path: Path) -> None:
    port, link = tmp_path / "ttyUSB0", tmp_path / "by-id"
    port.touch()
    link.symlink_to(port)
    text = (EXAMPLES / "labjack-bench.toml").read_text(encoding="utf-8")
    text = text.replace('url = "modbus-tcp://192.168.0.40:502"', f'url = "modbus-rtu:{port}"', 1)
    text = re.sub(r'(\[actuator\]\nurl = )".*"', rf'\1"modbus-rtu:{link}"', text)
    (tmp_path / "labjack-output.toml").write_bytes((EXAMPLES / "labjack-output.toml").read_bytes())
    (tmp_path / "bench.toml").write_text(text, encoding="utf-8")
    assert any("ecu.url" in problem and "cannot be shared" in problem for problem in refused(tmp_path / "bench.toml"))
    assert modbus_line(f"modbus-rtu:{link}") == modbus_line(str(port))


@pytest.mark.parametrize(("identifier", "request_"), [
    (0x182, "{ id = 0x120, data = [255, 255, 255, 255] }"), (0x120, '"remote"'), (0x182, "{ id = 0x121, data = [] }"),
])  # fmt: skip
def test_a_request_that_commands_the_ecu_on_the_same_bus_is_refused(
    tmp_path: Path, identifier: int, request_: str
) -> None:
    fields = 'unit = "mm", fields = { value = { at = 0, type = "i24" } }'
    travel = f"{{ id = {identifier}, length = 8, request = {request_}, {fields} }}"
    text = CAN_BENCH.replace('{ dbc = "can-sensors.dbc", signal = "TravelSensor.Travel" }', travel)
    (tmp_path / "can-sensors.dbc").write_text(NETWORK, encoding="utf-8")
    (tmp_path / "bench.toml").write_text(text, encoding="utf-8")
    if "0x121" in request_:  # the ECU's own status is no command
        Bench.load(tmp_path / "bench.toml")
        return
    with pytest.raises(FileProblem, match="0x120, which is the identifier of a command"):
        Bench.load(tmp_path / "bench.toml")
    bus = '[lvdt]\ninterface = "socketcan"\nchannel = '
    other_bus = text.replace(f'{bus}"can0"', f'{bus}"can1"')
    (tmp_path / "bench.toml").write_text(other_bus, encoding="utf-8")
    Bench.load(tmp_path / "bench.toml")


def test_every_problem_of_a_format_s_file_is_reported_with_its_line(tmp_path: Path) -> None:
    wrong = FORMAT.replace("crc16-modbus", "crc16-modbis").replace('"i32"', '"i33"').replace("length", "length_")
    problems = refused(bench(tmp_path, BY_FILE, described=wrong))
    assert len(problems) == 3
    assert all('load_cell.format = "cell.toml"' in problem for problem in problems)
    assert "cell.toml: line 3: length_ = 10: unknown key; did you mean length?" in problems[0]
    assert 'cell.toml: line 4: checksum = "crc16-modbis"' in problems[1]
    assert "did you mean crc16-modbus?" in problems[1]
    assert 'cell.toml: line 7: fields.value.type = "i33"' in problems[2]


@pytest.mark.parametrize(
    ("described", "says"), [("a = [", "cell.toml: line 1: not valid TOML"), ("x" * 270_000, "larger than 256 KiB")]
)
def test_a_file_that_is_no_format_is_refused(tmp_path: Path, described: str, says: str) -> None:
    assert says in refused(bench(tmp_path, BY_FILE, described=described))[0]


def test_a_pipe_in_place_of_a_format_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(FileProblem, match="is a pipe"):
        table_of("sensor-format", tmp_path / "pipe.toml")


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    (problem,) = refused(bench(tmp_path, ('format = "frame16"', 'format = "other.toml"')))
    assert "other.toml: there is no such file" in problem


@pytest.mark.parametrize(
    ("calibration", "sensitivity", "offset"),
    [
        # 10 kN over 1.9 mV/V; 0.1 mV/V is 0 N.
        ('points = [["0.1 mV/V", "0 N"], ["2 mV/V", "10 kN"]]', 10e3 / 1.9, 0.1 * 10e3 / 1.9),
        ('points = [[100, "-5 N"], [300, "15 N"]]', 0.1, 15.0),
        ('rated_output = "2 mV/V"\ncapacity = "10 kN"', 5e3, 0.0),
        ('rated_output = "2 mV/V"\ncapacity = "10 kN"\nzero = "0.01 mV/V"\npolarity = "reversed"', -5e3, -50.0),
    ],
)
def test_a_calibration_by_points_or_rated_output(
    tmp_path: Path, calibration: str, sensitivity: float, offset: float
) -> None:
    cell = Bench.load(bench(tmp_path, (CALIBRATION, calibration))).load_cell
    assert (cell.sensitivity, cell.offset) == (pytest.approx(sensitivity), pytest.approx(offset))
    config = station_config(Bench.load(tmp_path / "bench.toml"), MATRIX, tmp_path / "ring")
    assert from_json(config.to_json()).load_cell.sensitivity == cell.sensitivity


@pytest.mark.parametrize(
    ("calibration", "says"),
    [
        ('points = [[100, "0 N"], [2, "10 kN"]]', 'polarity = "reversed"'),
        ('points = [[1, "0 N"], [1, "10 kN"]]', "the slope between the two points is zero"),
        ('points = [[1, "0 mm"], [2, "10 kN"]]', "0 mm is a length"),
        ('points = [["much", "0 N"], [2, "10 kN"]]', "'much' is not a valid sensor output"),
        ('points = [[1, "0 N"], [2, "10 kN"]]\nsensitivity = 2.0', "cannot be combined with points"),
        ('rated_output = "2 mV/V"', "requires capacity"),
        ('rated_output = 0\ncapacity = "10 kN"', "the slope between the two points is zero"),
    ],
)
def test_a_calibration_that_contradicts_itself_is_refused(tmp_path: Path, calibration: str, says: str) -> None:
    problems = refused(bench(tmp_path, (CALIBRATION, calibration)))
    assert says in problems[0], problems
    assert "load_cell.calibration" in problems[0]


def test_a_unit_in_the_format_that_the_sensitivity_does_not_know_of_is_refused(tmp_path: Path) -> None:
    (problem,) = refused(bench(tmp_path, BY_FILE, described='unit = "kN"\n' + FORMAT))
    assert "load_cell.calibration.sensitivity" in problem
    assert "kN" in problem
    assert "1000" in problem
    right = (CALIBRATION, "sensitivity = 1000.0")
    assert Bench.load(bench(tmp_path, BY_FILE, right, described='unit = "kN"\n' + FORMAT)).load_cell.sensitivity == 1e3


def test_points_in_another_unit_than_the_format_s_are_refused(tmp_path: Path) -> None:
    points = (CALIBRATION, 'points = [["0 mV/V", "0 N"], ["2 mV/V", "10 kN"]]')
    (problem,) = refused(bench(tmp_path, BY_FILE, points, described='unit = "kN"\n' + FORMAT))
    assert "the format's unit is kN" in problem


def test_the_labjack_page_s_sensors_share_a_device_but_no_register(tmp_path: Path) -> None:
    page = (EXAMPLES.parent / "docs/how-to/use-a-labjack.md").read_text(encoding="utf-8")
    sensors = page.partition("```toml\n")[2].partition("```")[0]
    others = re.sub(r"\[(?:load_cell|lvdt)(?:\.calibration)?\][^\[]*", "", TEXT)
    path = tmp_path / "bench.toml"
    path.write_text(others + sensors, encoding="utf-8")
    loaded = Bench.load(path)
    assert loaded.load_cell.sensitivity == 2000.0
    assert loaded.lvdt.sensitivity == pytest.approx(0.01)
    path.write_text(others + sensors.replace("address = 2", "address = 0"), encoding="utf-8")
    assert "the same reading as load_cell" in refused(path)[0]
    path.write_text(others + sensors.replace('"labjack-t" ', '"frame16" '), encoding="utf-8")
    assert 'requires a format of kind "modbus"' in refused(path)[0]


def can_bench(folder: Path, *edits: tuple[str, str]) -> Path:
    """The example bench with sensors on CAN, beside its DBC file."""
    text = (EXAMPLES / "can-sensors-bench.toml").read_text(encoding="utf-8")
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    dbc = (EXAMPLES / "can-sensors.dbc").read_text(encoding="utf-8")
    (folder / "can-sensors.dbc").write_text(dbc, encoding="utf-8")
    path = folder / "can-bench.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_sensors_on_can_reach_the_station_with_the_text_of_their_dbc(tmp_path: Path) -> None:
    loaded = Bench.load(can_bench(tmp_path))
    config = from_json(station_config(loaded, MATRIX, tmp_path / "ring").to_json())
    made = described_format(config.load_cell.described)
    assert isinstance(made, BinaryFormat)
    assert made.can is not None
    assert (made.unit, made.can.identifier, made.can.protection.modulus) == ("N", 385, 16)
    assert config.load_cell.port == config.ecu.port == "socketcan:can0"
    before = loaded.digest
    keep_bench(tmp_path / "can-bench.toml", tmp_path / "kept" / "bench.toml")
    assert Bench.load(tmp_path / "kept" / "bench.toml").digest == before
    dbc = tmp_path / "can-sensors.dbc"
    dbc.write_text(dbc.read_text(encoding="utf-8").replace("(0.5,0)", "(0.25,0)"), encoding="utf-8")
    assert Bench.load(tmp_path / "can-bench.toml").digest != before


@pytest.mark.parametrize(("edit", "text"), [
    (("sensitivity = 0.001, ", ""), "the format's unit is mm; write sensitivity = 0.001"),
    (("LoadCell.Force", "LoadCell.Farce"), "nearest: Force"),
    (('interface = "socketcan"\nchannel = "can0"\nbitrate = 500000\nformat', 'url = "/dev/ttyUSB9"\nformat'),
     "specify interface and channel instead of url"),
    (("bitrate = 500000\nformat", "bitrate = 250000\nformat"), "is shared with [ecu], but bitrate"),
    (("TravelSensor.Travel", "LoadCell.State"), "no sensor"),
])  # fmt: skip
def test_what_a_sensor_on_can_cannot_be_is_refused(tmp_path: Path, edit: tuple[str, str], text: str) -> None:
    if text == "no sensor":
        Bench.load(can_bench(tmp_path, edit))  # another signal of a shared message is a reading of its own
        return
    assert any(text in problem for problem in refused(can_bench(tmp_path, edit)))


def test_one_labjack_gives_force_travel_and_current(tmp_path: Path) -> None:
    loaded = Bench.load(EXAMPLES / "labjack-bench.toml")
    assert {loaded.load_cell.port, loaded.lvdt.port, loaded.ecu.port} == {"modbus-tcp://192.168.0.40:502"}
