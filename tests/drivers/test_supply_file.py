"""A supply's file: what is accepted, and that everything wrong is told at once, with its line."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from drivers.current_source import SourceFault
from drivers.devices.supply_file import supply, supply_names, supply_problems

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/how-to/connect-a-power-supply.md").read_text(encoding="utf-8")
EXAMPLE = PAGE.split("```toml\n")[2].split("```")[0]
SMALLEST = """[range]
current_A = [0, 5]
[commands]
set_current = "I{current_mA:.0f}"
measure_current = "I?"
"""


def test_the_example_of_the_documentation_is_read() -> None:
    described = supply(tomllib.loads(EXAMPLE))
    assert (described.maker, described.current_A, described.voltage_V) == ("Acme", (0.0, 5.0), (0.0, 20.0))
    assert described.settling_s == 0.3
    assert described.commands.set_current[0].line(1.5) == b"CURR 1.500"
    assert described.faults == ((1 << 4, SourceFault.OVER_TEMPERATURE),)
    assert described.watchdog is not None
    assert [command.line(time_s=described.watchdog.time_s) for command in described.watchdog.start] == [
        b"OUTP:PROT:WDOG:DEL 2", b"OUTP:PROT:WDOG ON",
    ]


def test_the_smallest_file_is_enough() -> None:
    described = supply(tomllib.loads(SMALLEST))
    assert described.link.terminator == "\n"
    assert described.drives_zero


@pytest.mark.parametrize("name", supply_names())
def test_every_preset_is_read_and_stands_in_the_documentation(name: str) -> None:
    described = supply(name)
    assert described.drives_zero or described.commands.output_off
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{name}` |"))
    assert ("unverified" in row) == (described.tried == "unverified")


def test_everything_wrong_in_a_file_is_told_at_once_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "my-supply.toml"
    path.write_text("""format = 1
settling_ms = 0
[link]
terminator = ";"
parity = "X"
bautrate = 9600
[range]
current_A = [5, 0]
voltage_V = [0]
[commands]
set_current = "CURR 1"
measure_current = ["MEAS:CURR?", "MEAS?"]
output_on = "OUTP {current_A} ON"
clear = "*CLS?"
local = "SYST:LOC {time}"
[answers]
current = "[0-9"
voltage = "[0-9]+"
on = 1
[faults]
over-temperature = 40
[watchdog]
time_s = 100
""", encoding="utf-8")
    told = [text for _, text in supply_problems(str(path))]
    for line, says in {
        2: "settling_ms: must be a number from 1 to 10000",
        4: "link.terminator: must be one of",
        5: "link.parity: must be one of 'N', 'E', 'O'",
        6: "link.bautrate: unknown key; did you mean baudrate?",
        8: "range.current_A: the first must be below the second",
        9: "range.voltage_V: must be a list of lowest and highest",
        11: 'commands.set_current: does not carry the current; write for example "... {current_A:.3f}"',
        12: "commands.measure_current: must be one command",
        13: "commands.output_on: carries current, which is not known here",
        14: "commands.clear: is a query (?)",
        15: "commands.local: {time} means nothing here",
        17: "answers.current: is not a valid regular expression",
        18: "answers.voltage: must have the number in a group named value",
        19: "answers.on: must be a list of texts",
        21: "faults.over-temperature: must be a number from 0 to 31",
        23: "watchdog.time_s: must be a number from 0.1 to 60",
    }.items():
        assert any(text.startswith(f"my-supply.toml, line {line}: {says}") for text in told), (line, told)
    assert any("watchdog.start: is missing" in text for text in told)
    assert any("commands.output_off: is missing; a supply that has one of the two has both" in text for text in told)
    assert any("faults: means bits of an answer: write the question as read_faults" in text for text in told)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (SMALLEST.replace("[0, 5]", "[0.1, 5]"), "this supply cannot give 0 A"),
        (SMALLEST.replace('measure_current = "I?"\n', ""), "0 A could not be proved"),
        (SMALLEST.replace("[0, 5]", "[0, 0]"), "the first must be below the second"),
        ("x = [", "not TOML"),
        ("a." * 20 + "b = 1", "parts"),
        ("commands = 5", "must be a table"),
    ],
)
def test_what_would_leave_the_coil_with_current_is_refused(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "my-supply.toml"
    path.write_text(text, encoding="utf-8")
    assert any(says in told for _, told in supply_problems(str(path)))


def test_zero_beside_the_range_is_reached_by_the_switch() -> None:
    given = tomllib.loads(SMALLEST.replace("[0, 5]", "[0.1, 5]") + 'output_on = "ON"\noutput_off = "OFF"\n')
    assert not supply(given).drives_zero
    assert supply_problems(given) == []


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    ((_, text),) = supply_problems(str(tmp_path / "gone.toml"))
    assert "gone.toml: there is no such file" in text
