"""A supply's file: what is accepted, and that everything wrong is told at once, with its line."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from drivers.current_source import SourceFault
from drivers.devices.supply_file import FOLDER, supply, supply_names
from rig.errors import FileProblem
from rig.files.descriptions import KINDS, entry_problems, problems_of, table_of

ROOT = Path(__file__).parents[3]
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


def messages_of(tmp_path: Path, text: str) -> list[str]:
    path = tmp_path / "my-supply.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileProblem) as refused:
        table_of("supply", path)
    return refused.value.problems


def test_every_wrong_entry_of_a_file_is_reported_at_once_with_its_line(tmp_path: Path) -> None:
    problems = messages_of(tmp_path, """format = 1
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
[answers]
current = "[0-9"
voltage = "[0-9]+"
on = 1
[faults]
over-temperature = 40
[watchdog]
time_s = 100
""")
    for line, says in {
        2: "settling_ms = 0: too small (allowed: 1.0 to 10000.0)",
        4: 'link.terminator = ";": must be',
        5: "link.parity = \"X\": must be 'N', 'E' or 'O'",
        6: "link.bautrate = 9600: unknown key; did you mean baudrate?",
        8: "range.current_A = [5, 0]: the first value must be less than the second",
        9: "range.voltage_V[2]: missing",
        14: 'answers.current = "[0-9": is not a valid regular expression',
        15: 'answers.voltage = "[0-9]+": must capture the number in a group named value',
        16: "answers.on = 1: must be a string in quotes",
        18: "faults.over-temperature = 40: too large (allowed: 0 to 31)",
        19: "watchdog.start: missing",
        20: "watchdog.time_s = 100: too large (allowed: 0.1 to 60.0)",
    }.items():
        assert any(text.startswith(f"line {line}: {says}") for text in problems), (line, problems)


def test_everything_that_commands_contradict_is_reported_at_once_with_its_line(tmp_path: Path) -> None:
    problems = messages_of(tmp_path, """[range]
current_A = [0, 5]
[commands]
set_current = "CURR 1"
measure_current = ["MEAS:CURR?", "MEAS?"]
output_on = "OUTP {current_A} ON"
clear = "*CLS?"
local = "SYST:LOC {time}"
[faults]
over-temperature = 4
""")
    for line, says in {
        4: 'commands.set_current = "CURR 1": does not contain the current; write, for example, "... {current_A:.3f}"',
        5: 'commands.measure_current = ["MEAS:CURR?", "MEAS?"]: must be a single command',
        6: 'commands.output_on = "OUTP {current_A} ON": contains current, which is not allowed here',
        7: 'commands.clear = "*CLS?": is a query (?)',
        8: 'commands.local = "SYST:LOC {time}": {time} is not allowed here',
        9: "faults: defines the bits of an answer, but its query is missing. Fix: write the query as read_faults",
    }.items():
        assert any(text.startswith(f"line {line}: {says}") for text in problems), (line, problems)
    assert any("commands.output_off: is missing; specify both" in text for text in problems)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (SMALLEST.replace("[0, 5]", "[0.1, 5]"), "the coil could not be switched off"),
        (SMALLEST.replace('measure_current = "I?"\n', ""), "commands.measure_current: missing"),
        (SMALLEST.replace("[0, 5]", "[0, 0]"), "the first value must be less than the second"),
        ("x = [", "not valid TOML"),
        ("a." * 20 + "b = 1", "parts"),
        ("commands = 5", "must be a table"),
    ],
)
def test_what_would_leave_the_coil_with_current_is_refused(tmp_path: Path, text: str, says: str) -> None:
    problems = messages_of(tmp_path, text)
    assert any(says in problem for problem in problems), problems


def test_zero_beside_the_range_is_reached_by_the_switch() -> None:
    given = tomllib.loads(SMALLEST.replace("[0, 5]", "[0.1, 5]") + 'output_on = "ON"\noutput_off = "OFF"\n')
    assert not supply(given).drives_zero
    assert problems_of("supply", given) == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_that_is_not_there_is_named(tmp_path: Path, kind: str) -> None:
    ((_, text),) = entry_problems(kind, str(tmp_path / "gone.toml"))
    assert "gone.toml: there is no such file" in text


@pytest.mark.parametrize(("kind", "ending"), [("supply", "_supply.toml"), ("register-map", "_controller.toml")])
def test_descriptions_that_come_with_the_program_fit_their_models(kind: str, ending: str) -> None:
    shipped = sorted(FOLDER.glob(f"*{ending}"))
    assert shipped
    for path in shipped:
        assert problems_of(kind, tomllib.loads(path.read_text(encoding="utf-8"))) == [], path
