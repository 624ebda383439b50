"""`rig init`: files that load as they are, asked for or not, and nothing that is there is overwritten."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner
from in_process import rig

from rig.bench.model import Bench
from rig.cli.init import QUESTIONS, command, write_files
from rig.matrix.model import load_files
from rig.matrix.plan import plan

ROOT = Path(__file__).parents[3]
COMMAND = [sys.executable, "-m", "rig.cli.main", "init"]


def init(*arguments: str) -> subprocess.CompletedProcess[str]:
    return rig("init", *arguments, cwd=ROOT)


def test_the_files_load_and_every_point_of_them_is_feasible(tmp_path: Path) -> None:
    folder = tmp_path / "lab"
    answer = json.loads(init(str(folder), "--force", "laumas-fast", "--yes", "--json").stdout)
    names = ["bench.toml", "matrix.toml", "bench.schema.json", "matrix.schema.json"]
    assert answer == {"folder": str(folder), "files": names}
    matrix, bench = load_files(folder / "matrix.toml", folder / "bench.toml")
    assert (bench.load_cell.format, bench.lvdt.format, bench.actuator.register_map) == (
        "laumas-fast", "frame16", "demo")
    planned = plan(matrix, bench)
    assert planned.feasible
    assert len(planned.points) == 6


def test_the_commands_that_it_prints_can_be_copied_and_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where it was run, for a folder whose name has a space, below a link; a file beside it is found from there."""
    (tmp_path / "far" / "away").mkdir(parents=True)
    (tmp_path / "here").symlink_to(tmp_path / "far" / "away")
    for name in ("coil-driver.dbc", "coil-driver-roles.toml"):
        shutil.copy(ROOT / "examples" / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(command, ["here/my lab", "--yes", "--ecu", "coil-driver.dbc"])
    assert done.exit_code == 0, done.output
    commands = [shlex.split(line) for line in done.output.splitlines() if line.startswith("  rig ")]
    assert [words[1] for words in commands] == ["check", "plan", "run"]
    for words in commands:
        files = [word for word in words if word.endswith(".toml")]
        assert files
        assert all(Path(name).is_file() for name in files)
    assert Path(Bench.load(Path("here/my lab/bench.toml")).ecu.dbc).samefile("coil-driver.dbc")


def test_an_ecu_by_its_dbc_or_a_supply_is_written_with_what_belongs_to_it(tmp_path: Path) -> None:
    examples = ROOT / "examples"
    assert init(str(tmp_path / "dbc"), "--yes", "--ecu", str(examples / "coil-driver.dbc")).returncode == 0
    by_dbc = Bench.load(tmp_path / "dbc" / "bench.toml").ecu
    assert Path(by_dbc.dbc).samefile(examples / "coil-driver.dbc")
    assert Path(str(by_dbc.roles)).samefile(examples / "coil-driver-roles.toml")
    assert init(str(tmp_path / "supply"), "--yes", "--ecu", "generic-scpi").returncode == 0
    by_supply = Bench.load(tmp_path / "supply" / "bench.toml").ecu
    assert (by_supply.url, by_supply.supply) == ("tcp://192.168.0.20:5025", "generic-scpi")


def test_by_hand_and_an_analogue_output_have_tables_of_their_own(tmp_path: Path) -> None:
    """In this process: what the command does once it has its answers."""
    answers = {question.key: question.default for question in QUESTIONS}
    write_files(tmp_path / "hand", answers | {"ecu": "by-hand"})
    assert Bench.load(tmp_path / "hand" / "bench.toml").ecu.by_hand
    registers = tmp_path / "output.toml"
    registers.write_text(
        '[range]\ncurrent_A = [0, 3]\n[quantities]\ncurrent = {address = 0, scale = 0.001, unit = "A"}\n',
        encoding="utf-8",
    )
    write_files(tmp_path / "output", answers | {"ecu": str(registers)})
    ecu = Bench.load(tmp_path / "output" / "bench.toml").ecu
    assert (ecu.url, ecu.measured) == ("modbus-tcp://192.168.0.30:502", False)


def test_every_device_that_there_is_not_is_named_at_once(tmp_path: Path) -> None:
    refused = CliRunner().invoke(command, [str(tmp_path / "new"), "--yes", "--force", "laumas", "--actuator", "x"])
    assert refused.exit_code == 2
    assert "--force: got 'laumas'" in refused.output
    assert "--actuator: got 'x'" in refused.output


def test_editors_find_the_schema_and_every_key_in_it(tmp_path: Path) -> None:
    init(str(tmp_path), "--yes")
    for kind in ("bench", "matrix"):
        text = (tmp_path / f"{kind}.toml").read_text(encoding="utf-8")
        assert text.startswith(f"#:schema ./{kind}.schema.json\n")
        schema = json.loads((tmp_path / f"{kind}.schema.json").read_text(encoding="utf-8"))
        assert tomllib.loads(text).keys() <= schema["properties"].keys()
    assert re.search(r'^# serial_number = ', (tmp_path / "bench.toml").read_text(encoding="utf-8"), re.MULTILINE)


def test_nothing_is_overwritten_and_a_device_that_there_is_not_is_refused(tmp_path: Path) -> None:
    (tmp_path / "matrix.toml").write_text("mine", encoding="utf-8")
    refused = init(str(tmp_path), "--yes")
    assert refused.returncode == 2
    assert "matrix.toml already exists" in refused.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["matrix.toml"]
    unknown = init(str(tmp_path / "new"), "--yes", "--force", "laumas")
    assert unknown.returncode == 2
    assert "laumas-fast" in unknown.stderr
    assert not (tmp_path / "new").exists()


def test_on_a_terminal_it_asks_and_an_answer_without_a_unit_is_requested_again(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    answers = ["blue rig", "", "modbus-tcp://10.0.0.7:502", "", "", "", "", "", "25", "25 kN"]
    os.write(ours, "".join(f"{answer}\n" for answer in [*answers, *[""] * 11]).encode())
    command = [*COMMAND, str(tmp_path / "lab")]
    done = subprocess.run(command, stdin=theirs, capture_output=True, text=True, timeout=60, check=False, cwd=ROOT)
    os.close(ours)
    os.close(theirs)
    assert done.returncode == 0, done.stderr
    assert "25 has no unit" in done.stderr
    bench = Bench.load(tmp_path / "lab" / "bench.toml")
    assert (bench.name, bench.actuator.url, bench.load_cell.range_N) == (
        "blue rig", "modbus-tcp://10.0.0.7:502", 25e3)
