from __future__ import annotations

from pathlib import Path

import pytest

from rig.errors import FileProblem
from simulators.options import RigOptions, load_options, with_option


def test_a_file_replaces_what_it_names_and_keeps_the_rest(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text('moving_mass_kg = 3\n[load_cell]\nnoise = 2.5\n[damper.values]\nF0 = -100\n', encoding="utf-8")
    options = load_options(file)
    assert options.moving_mass_kg == 3.0
    assert options.load_cell.noise == 2.5
    assert options.load_cell.range == RigOptions().load_cell.range
    assert options.damper.values == {"F0": -100.0}


def test_every_misfit_is_named_at_once(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(
        'speed = 3\n[load_cell]\nnoize = 1.0\nrate_Hz = 99000.0\nrange = "10 kN"\n[servo]\nbandwidth_Hz = 0\n'
        "[coil]\nserial_number = 1.5\n[damper.values]\nF0 = inf\n", encoding="utf-8",
    )
    with pytest.raises(FileProblem) as caught:
        load_options(file)
    text = str(caught.value)
    for expected in (
        "line 1: speed = 3: unknown key", "line 3: load_cell.noize = 1.0: unknown key; did you mean noise?",
        "line 4: load_cell.rate_Hz = 99000.0: too large (allowed: more than 0.0 to 10000.0)",
        'line 5: load_cell.range = "10 kN": must be a number', "line 7: servo.bandwidth_Hz = 0: too small",
        "line 9: coil.serial_number = 1.5: must be a whole number",
        "line 11: damper.values.F0 = inf: must be a finite number",
    ):
        assert expected in text
    assert len(caught.value.problems) == 7


@pytest.mark.parametrize("content", [b"\xff\xfe", b"load_cell = ", b"x" * (2 << 20)])
def test_an_unreadable_file_is_one_clear_problem(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "rig.toml"
    file.write_bytes(content)
    with pytest.raises(FileProblem, match=r"rig\.toml"):
        load_options(file)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileProblem, match=r"absent\.toml"):
        load_options(tmp_path / "absent.toml")


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("noise", "expected table.key=value"), ("load_cell.noise=loud", "must be a number"),
        ("load_cell=3", "must be a table"), ("damper.values=3", "must be a table"),
        ("damper.set=3", "must be a string"),
        ("plant_rate_Hz=100.0", "too small .allowed: 4000"), ("coil.ohm=nan", "finite"),
        ("load_cell.unit=kp", "must be 'N', 'mm' or"), ("lvdt.format=ascii", "expected one of frame16"),
    ],
)
def test_a_wrong_option_says_what_would_fit(assignment: str, message: str) -> None:
    with pytest.raises(FileProblem, match=message):
        with_option(RigOptions(), assignment)


def test_text_needs_no_quotes_on_the_command_line() -> None:
    assert with_option(RigOptions(), "specimen.serial_number=MR-009").specimen.serial_number == "MR-009"
