"""The bench file: what is accepted, and that everything else is refused with its place."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import date
from pathlib import Path

import pytest

from protocols.line_format import LineFormat
from protocols.sensor_format import from_description
from rig.bench.model import Bench
from rig.campaign.execution.point_recording import sensor_contexts
from rig.errors import EXIT_USAGE, FileProblem

EXAMPLES = Path(__file__).parents[3] / "examples"
TEXT = (EXAMPLES / "demo-bench.toml").read_text()

Edit = Callable[..., list[str]]


@pytest.fixture
def problems(tmp_path: Path) -> Edit:
    """Change the example by (old, new) pairs, load it, give the problems."""

    def edit(*changes: tuple[str, str], append: str = "") -> list[str]:
        text = TEXT
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        path = tmp_path / "bench.toml"
        path.write_text(text + append)
        with pytest.raises(FileProblem) as caught:
            Bench.load(path)
        assert caught.value.exit_code == EXIT_USAGE
        return caught.value.problems

    return edit


def line_of(key: str) -> int:
    return next(number for number, line in enumerate(TEXT.splitlines(), 1) if line.startswith(key))


def test_the_example_is_read_in_SI() -> None:
    bench = Bench.load(EXAMPLES / "demo-bench.toml")
    assert bench.limits.position_m == (-0.085, 0.085)
    assert bench.limits.speed_m_s == 0.8
    assert bench.limits.force_N == 5000.0
    assert bench.actuator.poll_s == 0.01
    assert bench.ecu.stale_after_s == 0.03
    assert bench.lvdt.calibration.sensitivity == 0.001
    assert bench.lvdt.range_m == 0.1
    assert bench.load_cell.calibration.due == date(2030, 1, 1)
    assert bench.clock.device_rate == 1.0


def test_a_device_id_that_a_serial_line_does_not_have_is_refused_there_alone(problems: Edit, tmp_path: Path) -> None:
    serial = ("modbus-tcp://192.168.0.10:502", "modbus-rtu:/dev/ttyUSB0")
    for number in (0, 255):
        assert problems(serial, ("device_id = 1", f"device_id = {number}")) == [
            f"line {line_of('device_id')}: actuator.device_id = {number}: invalid on a serial line; allowed: 1 to 247"
        ]
    path = tmp_path / "bench.toml"
    path.write_text(TEXT.replace("device_id = 1", "device_id = 255"))
    assert Bench.load(path).actuator.device_id == 255


def test_the_unit_may_stand_in_the_key(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(
        TEXT.replace('speed = "0.8 m/s"', "speed_mm_s = 800").replace('["-85 mm", "85 mm"]', "[-85, 85]").replace(
            "position =", "position_mm ="
        )
    )
    assert Bench.load(path).limits == Bench.load(EXAMPLES / "demo-bench.toml").limits


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('speed = "0.8 m/s"', 'speed = "25 N"', 'limits.speed = "25 N": 25 N is a force; a speed is written as'),
        ('speed = "0.8 m/s"', "speed = 0.8", "limits.speed = 0.8: the number 0.8 has no unit"),
        ('speed = "0.8 m/s"', 'speed = "80 m/s"', "too large (allowed: more than 0 m/s to 5 m/s)"),
        ('speed = "0.8 m/s"', 'speed = "0 m/s"', "too small (allowed: more than 0 m/s to 5 m/s)"),
        ('speed = "0.8 m/s"', "speed_m_s = nan", "limits.speed_m_s = nan: not a number with a unit"),
        ('speed = "0.8 m/s"', "speed_m_s = true", "must be a plain number"),
        ('speed = "0.8 m/s"', 'speed = "0.8 m/s"\nspeed_mm_s = 800', "speed is specified twice"),
        ('force = "5 kN"', 'force = "4 MN"', "allowed: more than 0 N to 200 kN"),
        ('current = "3 A"', 'current = "-3 A"', "limits.current"),
        ('["-85 mm", "85 mm"]', '["85 mm", "-85 mm"]', "the first value must be less than the second"),
        ('["-85 mm", "85 mm"]', '["-85 mm"]', "limits.position"),
        ('["-85 mm", "85 mm"]', '"85 mm"', "must be a list in [ ]"),
        ('speed = "0.8 m/s"', 'speed = "0.8 m/s"\nrequire_valid_calibration = true',
            "top of the file, before the first table"),
        ("poll =", "pol =", 'actuator.pol = "10 ms": unknown key; did you mean poll?'),
        ("register_map = \"demo\"", "register_map = \"delta\"", "actuator.register_map"),
        ("modbus-tcp://192.168.0.10:502", "192.168.0.10", "actuator.url"),
        ("bitrate = 500000", 'bitrate = "500000"', "must be a whole number"),
        ("bitrate = 500000", "bitrate = true", "must be a whole number"),
        ("bitrate = 500000", "bitrate = 5.0", "must be a whole number"),
        ("sensitivity = 0.001", "sensitivity = 0.0", "sensitivity = 0.0: too small (allowed: greater than 0)"),
        ("sensitivity = 0.001", "sensitivity = -0.001", 'write sensitivity = 0.001 and polarity = "reversed"'),
        ("sensitivity = 0.001", "sensitivity = inf", "lvdt.calibration.sensitivity = inf"),
        ('offset = "0 mm"', 'offset = "0 N"', 'lvdt.calibration.offset = "0 N": 0 N is a force'),
        ("due = 2030-01-01", 'due = "2030-01-01"', "must be a date such as 2030-01-01"),
        ('format = "frame16"', 'format = "frame17"', "unknown format; did you mean frame16? known: frame16"),
        ('stale_after = "20 ms"', 'stale_after = "6 ms"', "shorter than two samples; allowed: at least 8 ms"),
        ('watchdog = "500 ms"', 'watchdog = "60 ms"', "shorter than two poll periods or time-outs; allowed: at least "
            "80 ms"),
        ('stale_after = "30 ms"', 'stale_after = "15 ms"', "shorter than two status frames; allowed: at least 20 ms"),
        ("by-id/usb-lvdt", "by-id/usb-load-cell", "lvdt.url"),
        ('range = "10 kN"', 'range = "4 kN"', "exceeds the load cell's range; allowed: at most 4 kN"),
        ('range = "100 mm"', 'range = "50 mm"', "exceeds the LVDT's range; allowed: within +-50 mm"),
        ("format = 1", "format = 2", "format = 2"),
    ],
)  # fmt: skip
def test_a_wrong_entry_is_named_with_place_value_and_what_would_fit(
    problems: Edit, old: str, new: str, expected: str
) -> None:
    found = problems((old, new))
    assert len(found) == 1, found
    assert expected in found[0]
    assert found[0].startswith("line ")


def test_all_wrong_entries_are_reported_at_once_with_their_lines(problems: Edit) -> None:
    found = problems(
        ('speed = "0.8 m/s"', 'speed = "25 N"'),
        ("bitrate = 500000", "bitrate = 7"),
        ("sensitivity = 0.001", "sensitivity = 0.0"),
    )
    assert [problem.split(":")[0] for problem in found] == [
        f"line {line_of('speed')}", f"line {line_of('bitrate')}", f"line {line_of('sensitivity = 0.001')}",
    ]  # fmt: skip


def test_a_missing_key_is_shown_with_an_example_at_its_section(problems: Edit) -> None:
    (found,) = problems(('force = "5 kN"\n', ""))
    assert found == f'line {line_of("[limits]")}: limits.force: missing; write, for example, force = "5 kN"'


def test_a_missing_section_is_named(problems: Edit) -> None:
    start, end = TEXT.index("[ecu]"), TEXT.index("[load_cell]")
    (found,) = problems((TEXT[start:end], ""))
    assert found == "ecu: missing; write a table [ecu] with interface, channel"


@pytest.mark.parametrize(("line", "delay_s"), [('delay = "0 ms"\n', 0.0), ("", None)])
def test_a_delay_of_zero_is_stated_and_none_is_not(tmp_path: Path, line: str, delay_s: float | None) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(re.sub(r"^delay = .*\n", line, TEXT, count=1, flags=re.MULTILINE), encoding="utf-8")
    bench = Bench.load(path)
    assert bench.load_cell.delay_s == delay_s
    assert sensor_contexts(bench)["force"].delay_s == delay_s


LINE = (
    """format = { pattern = '(?P<value>[+-][0-9.]+)(?P<unit>kN)', unit = "kN", terminator = "\\r","""
    """ overload_tokens = ["OVER"] }"""
)


def test_a_line_format_may_be_described_in_the_bench_file(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(TEXT.replace('format = "frame16"', LINE, 1))
    described = Bench.load(path).load_cell.format
    assert isinstance(described, dict)
    line = from_description(described)
    assert isinstance(line, LineFormat)
    assert line.terminator == b"\r"
    assert line.decode(b"+1.25kN")[0] == 1.25


@pytest.mark.parametrize(
    ("new", "expected"),
    [
        (LINE.replace("<value>", "<force>"), "pattern requires a group (?P<value>...)"),
        (LINE.replace("terminator", "terminal"), "unknown key; did you mean terminator?"),
        (LINE.replace('"kN"', "3"), "load_cell.format.unit = 3: must be a string in quotes"),
        (LINE.replace("kN)", "kN"), "missing )"),
    ],
)
def test_a_line_format_that_contradicts_itself_is_refused(problems: Edit, new: str, expected: str) -> None:
    found = problems(('format = "frame16"', new))
    assert len(found) == 1, found
    assert expected in found[0]
    line = line_of('format = "frame16"')
    assert found[0].startswith(f"line {line}: load_cell.format")


AUXILIARY = """
[[auxiliary]]
name = "{name}"
unit = "bar"
url = "/dev/aux{port}"
rate = "250 Hz"
range = "{range}"
stale_after = "20 ms"
calibration = {{ serial_number = "P-1", offset = "{offset}" }}
"""


def auxiliary(name: str = "pressure", port: int = 1, limit: str = "400 bar", offset: str = "1 bar") -> str:
    return AUXILIARY.format(name=name, port=port, range=limit, offset=offset)


def test_an_auxiliary_channel_has_its_own_unit(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(TEXT + auxiliary())
    (channel,) = Bench.load(path).auxiliary
    assert channel.span == pytest.approx(4e7)
    assert channel.offset == pytest.approx(1e5)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (auxiliary() + auxiliary(port=2), "name of another auxiliary channel"),
        (auxiliary(name="force"), "is reserved for a standard channel"),
        (auxiliary(name="Kraft!"), "auxiliary[1].name"),
        (auxiliary() + auxiliary(name="second"), "every sensor requires its own port"),
        (auxiliary(limit="400 N"), "400 N is a force"),
        (auxiliary(limit="-1 bar"), "must be greater than 0"),
        (auxiliary(offset="1 mm"), "1 mm is a length"),
        (auxiliary().replace('"bar"', '"barn"'), "unknown unit"),
        ("".join(auxiliary(name=f"p{index}", port=index) for index in range(8)), "auxiliary"),
    ],
)
def test_wrong_auxiliary_channels_are_refused(problems: Edit, text: str, expected: str) -> None:
    assert any(expected in problem for problem in problems(append=text))


def test_an_overdue_calibration_is_named() -> None:
    bench = Bench.load(EXAMPLES / "demo-bench.toml")
    assert bench.overdue(date(2029, 12, 31)) == ()
    assert bench.overdue(date(2030, 1, 2)) == ("load_cell", "lvdt")


def test_the_digest_covers_limits_and_calibration_but_no_address(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    reference = Bench.load(EXAMPLES / "demo-bench.toml").digest
    for old, new, same in [
        ("192.168.0.10:502", "10.0.0.1:503", True),
        ("usb-load-cell", "usb-other", True),
        ('channel = "can0"', 'channel = "can1"', True),
        ('force = "5 kN"', 'force = "4 kN"', False),
        ("sensitivity = 0.001", "sensitivity = 0.00101", False),
        ('serial_number = "LC-1"', 'serial_number = "LC-2"', False),
    ]:
        path.write_text(TEXT.replace(old, new))
        assert (Bench.load(path).digest == reference) is same, old


def test_campaigns_begun_before_newer_entries_existed_can_be_resumed(tmp_path: Path) -> None:
    """The digests that the two examples had then, as `campaign.json` of such campaigns holds them."""
    kept = {
        "demo-bench.toml": "1db19829249a94905551aa7c0888d43a48c84118f097db7cab6cd48e45376425",
        "paper-bench.toml": "bfa51b9c68c118f8f127cba6c72ba83d590119e01bf8c02d8c4c013b21a2a63e",
    }
    assert {name: Bench.load(EXAMPLES / name).digest for name in kept} == kept
    path = tmp_path / "bench.toml"
    path.write_text(TEXT.replace("[actuator]", '[actuator]\nsetpoint_late = "20 ms"'))
    assert Bench.load(path).digest == kept["demo-bench.toml"]
