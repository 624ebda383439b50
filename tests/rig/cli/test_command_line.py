"""The command line as a user meets it: exit codes, one JSON object, clear messages."""

from __future__ import annotations

import importlib
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import pytest
from in_process import rig, rig_process

from rig import __version__, version
from rig.cli.main import COMMANDS, answered, conflicting_packages, needs_linux
from rig.cli.main import _present_spelling as present_spelling
from rig.errors import EXIT_DEFECT

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "examples"
TABLE1 = str(EXAMPLES / "table1.toml")
DEMO = str(EXAMPLES / "demo-bench.toml")
PAPER = str(EXAMPLES / "paper-bench.toml")

# What the help must not load: numbers, validation, plots, devices.
HEAVY = ("numpy", "pydantic", "pandas", "h5py", "scipy", "numba", "matplotlib", "rich", "can", "pymodbus", "serial")


def one_object(result: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    value = json.loads(result.stdout)
    assert isinstance(value, dict)
    return value


def test_help_loads_nothing_heavy_and_costs_less_than_a_fifth_of_a_second_of_CPU() -> None:
    script = (
        "import sys\nfrom rig.cli.main import main\ncode = main(['--help'])\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)\nsys.exit(code)"
    )
    costs = []
    for _ in range(3):
        before = os.times()
        result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT)
        after = os.times()
        costs.append(after.children_user - before.children_user + after.children_system - before.children_system)
        assert result.stderr.strip() == "[]"
    assert all(name in result.stdout for name in COMMANDS)
    assert min(costs) < 0.2


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_with_an_example_and_json(name: str) -> None:
    result = (rig_process if name == "scenarios" else rig)(name, "--help")
    assert result.returncode == 0, result.stderr
    assert re.search(rf"Examples?:\n +rig {name}", result.stdout), result.stdout
    assert "--json" in result.stdout or name == "simulate"


@pytest.mark.parametrize(
    ("old", "present"),
    [
        (("sniff", "--from", "{captured}"), ("check", "--listen", "{captured}")),
        (("sniff", "{captured}", "--seconds", "2"), ("check", "--listen", "{captured}", "--seconds", "2")),
        (("hybrid", TABLE1, "--simulate"), ("run", "--hybrid", TABLE1, "--simulate")),
        (("hybrid", "--benchmark", "--plants", "0"), ("benchmark", "--plants", "0")),
        (("hybrid", "--out", "logs", "--benchmark", "--out=x", "--plants", "0"), ("benchmark", "--plants", "0")),
    ],
)
def test_a_command_by_its_earlier_name_does_the_same_and_names_the_present_one_once(
    old: tuple[str, ...], present: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "captured").write_bytes(b"ST,+012.345 kN\r\n" * 40)
    before, after = (
        rig(*(word.format(captured=tmp_path / "captured") for word in words)) for words in (old, present)
    )
    note, rest = before.stderr.split("\n", 1)
    assert f"`rig {old[0]}` is now `rig {' '.join(present[: 2 if old[0] == 'sniff' else 1])}`" in note
    assert (before.returncode, before.stdout, rest) == (after.returncode, after.stdout, after.stderr)


def test_options_of_listening_belong_to_it() -> None:
    assert rig("check", DEMO, "--baud", "9600").returncode == 2
    assert rig("check", "--listen").returncode == 2
    assert rig("check", "--listen", "--prove", "/dev/null").returncode == 2
    bench = rig("check", "--listen", DEMO)
    assert bench.returncode == 2
    assert f"rig check {DEMO}" in bench.stderr


def test_the_version_names_the_commit() -> None:
    head = subprocess.run(["git", "rev-parse", "HEAD"], capture_output=True, text=True, check=False, cwd=ROOT).stdout
    form = rf"rig {re.escape(__version__)}(?: \(commit ([0-9a-f]+)(?:-dirty)?\))?\n"
    shown = re.fullmatch(form, rig("--version").stdout)
    assert shown
    assert head.startswith(shown[1] or "")


def test_the_version_is_never_that_of_another_repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    git = ["git", "-c", "user.name=A", "-c", "user.email=a@b", "-C", str(tmp_path)]
    try:
        subprocess.run([*git, "init", "-q"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no git here")
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "theirs"], check=True, capture_output=True)
    own = version.commit()
    monkeypatch.setenv("GIT_DIR", str(tmp_path / ".git"))  # as in a hook of theirs
    assert version.commit() == own
    package = tmp_path / "rig"
    package.mkdir()
    (package / "commit.txt").write_text("0123456789\n", encoding="utf-8")
    monkeypatch.setattr(version, "PACKAGE", package)  # installed into the folder of their repository
    assert version.commit() == "0123456789"


def test_what_follows_two_dashes_is_not_an_option_of_an_earlier_name() -> None:
    assert present_spelling(["hybrid", "--benchmark", "--", "--benchmark"]) == ["benchmark"], "never had an effect"
    words = ["a.toml", "--", "--benchmark"]
    assert present_spelling(["hybrid", *words]) == ["run", "--hybrid", *words]


def test_the_plan_refuses_table_1_on_the_papers_machine_with_exit_3_and_the_amplitudes_that_fit() -> None:
    result = rig("plan", TABLE1, "--bench", PAPER, "--json")
    assert result.returncode == 3
    points = one_object(result)["points"]
    assert {point["verdict"] for point in points} == {"infeasible"}
    fits = [point["would_fit"]["amplitude_m"] for point in points[:4]]
    assert fits == pytest.approx([0.04715, 0.02357, 0.01571, 0.01178])
    text = rig("plan", TABLE1, "--bench", PAPER)
    assert text.returncode == 3
    assert "20 of 20 points outside limits" in text.stdout
    assert "fits (mm)" in text.stdout
    assert "47.15" in text.stdout


def test_the_plan_accepts_table_1_on_the_demo_bench_and_gives_the_documented_keys() -> None:
    result = rig("plan", TABLE1, "--bench", DEMO, "--json")
    assert result.returncode == 0
    plan = one_object(result)
    assert plan["feasible"] is True
    assert plan["duration_s"] > 250
    keys = {"id", "peak_speed_m_s", "peak_acceleration_m_s2", "predicted_force_N", "energy_J", "duration_s", "verdict",
            "reason", "would_fit"}  # fmt: skip
    assert all(keys <= point.keys() for point in plan["points"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("plan", "none.toml", "--bench", DEMO), "none.toml: there is no such file"),
        (("plan", TABLE1), "Missing option '--bench'"),
        (("plan", DEMO, "--bench", DEMO), "this is a bench file, expected a matrix file"),
        (("rum",), "No such command 'rum'"),
        (("run", TABLE1), "specify --bench FILE, --simulate, or both"),
        (("check",), "no bench specified"),
        (("check", DEMO, "--", "--fault", "sigint"), "arguments after --"),
        (("run", TABLE1, "--bench", DEMO, "--speed", "2"), "--speed: only allowed with a simulated rig"),
        (("run", TABLE1, "--bench", DEMO, "--", "--fault", "sigint"), "arguments after --"),
        (("run", TABLE1, TABLE1, "--simulate"), "specify only one matrix"),
        (("run", TABLE1, "--simulate", "--speed", "0"), "--speed"),
        (("run", TABLE1, "--bench", DEMO, "--real-time"), "--real-time: only allowed with"),
        (("run", TABLE1, "--simulate", "--speed", "nan"), "--speed"),
        (("runs", "--in", "nowhere"), "nowhere: no such folder"),
        (("recover", "nowhere"), "nowhere: this is not a campaign folder"),
        (("schema", "rig"), "'rig' is not one of 'bench', 'matrix', 'register-map', 'ecu-roles', "),
        (("import", "x.csv", "--column", "time"), "expected a form such as displacement=x_m"),
        (("import", "x.csv", "--column", "time=t_s"), "displacement: no column given"),
        (("import", "x.csv", "--current", "0.5"), "0.5 has no unit"),
    ],
)
def test_bad_usage_and_bad_files_end_in_exit_2_with_one_message_and_no_traceback(
    arguments: tuple[str, ...], message: str
) -> None:
    result = rig(*arguments)
    assert result.returncode == 2
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert result.stdout == ""
    where = arguments.index("--") if "--" in arguments else len(arguments)
    reported = rig(*arguments[:where], "--json", *arguments[where:])
    assert reported.returncode == 2
    error = one_object(reported)
    assert message in error["error"]
    assert error["exit_code"] == 2


def test_every_problem_of_a_file_is_in_the_json(tmp_path: Path) -> None:
    wrong = tmp_path / "bench.toml"
    wrong.write_text("format = 1\n[limits]\n")
    error = one_object(rig("plan", TABLE1, "--bench", str(wrong), "--json"))
    assert error["file"] == str(wrong)
    assert len(error["problems"]) > 5


@pytest.mark.parametrize("name", ["bench", "matrix"])
def test_the_schema_knows_units_and_refuses_unknown_keys(name: str) -> None:
    schema = one_object(rig("schema", name))
    assert schema["additionalProperties"] is False
    section = schema["$defs"]["Limits" if name == "bench" else "Sweep"]
    properties = section["properties"]
    quantity = properties["speed"] if name == "bench" else properties["amplitude"]["items"]
    assert re.match(quantity["pattern"], quantity["examples"][0])
    assert not re.match(quantity["pattern"], "25 N")
    (suffixed,) = section["patternProperties"]
    assert re.match(suffixed, "speed_m_s" if name == "bench" else "amplitude_mm")


def test_imported_tests_become_a_run_that_is_listed(tmp_path: Path) -> None:
    phases = [2 * math.pi * number / 200 for number in range(1200)]
    rows = [f"{phase / (2 * math.pi)},{20 * math.sin(phase)},{300 * math.cos(phase)}" for phase in phases]
    (tmp_path / "loop_0.50A.csv").write_text("t_s,x_mm,F_N\n" + "\n".join(rows) + "\n")
    out = tmp_path / "runs"
    result = rig(
        "import", str(tmp_path / "loop_0.50A.csv"), "--column", "time=t_s", "--column", "displacement=x_mm",
        "--column", "force=F_N", "--current-from-name", "_(?P<current>[0-9.]+)A", "--out", str(out), "--json",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    made = one_object(result)
    (point,) = made["points"]
    assert point["amplitude_m"] == pytest.approx(0.02, rel=0.02)
    assert point["frequency_Hz"] == pytest.approx(1.0, rel=0.02)
    assert point["current_A"] == 0.5
    assert Path(point["file"]).is_file()
    (listed,) = one_object(rig("runs", "--in", str(out), "--json"))["runs"]
    assert (listed["path"], listed["points"], listed["valid"]) == (made["campaign"], 1, 1)
    assert rig("recover", made["campaign"]).stdout == "nothing to recover\n"


def test_files_read_identical_are_reported_once_and_the_odd_one_by_its_name(tmp_path: Path) -> None:
    rows = [(k / 100, 20 * math.sin(k / 50), 300 * math.cos(k / 50)) for k in range(1200)]
    for name, sign in (("a", ","), ("b", ","), ("odd", ";"), ("c", ",")):
        (tmp_path / f"{name}.csv").write_text(
            sign.join(("t_s", "x_mm", "F_N")) + "\n" + "".join(sign.join(map(str, row)) + "\n" for row in rows)
        )
    expected = ("--column", "time=t_s", "--column", "displacement=x_mm", "--column", "force=F_N", "--current", "1 A")
    reported = rig("import", *sorted(tmp_path.glob("*.csv")), *expected, "--dry-run").stdout
    of_name = "from the column name"
    columns = f"  time t_s (s, {of_name})\n  displacement x_mm (mm, {of_name})\n  force F_N (N, {of_name})\n"
    identical, odd = reported.split(columns)[:2]
    assert identical == (", ".join(str(tmp_path / f"{name}.csv") for name in "abc")
                     + ": CSV, separator ',', decimal '.', utf-8, names in line 1, numbers from line 2\n")  # fmt: skip
    assert odd.startswith(f"{tmp_path / 'odd.csv'}: CSV, separator ';'")
    reported = rig("import", *sorted(tmp_path.glob("?.csv")), *expected, "--dry-run").stdout
    read, signs, tests = reported.partition("positive: extension and rebound (default)")
    assert read == identical.replace(identical.split(": CSV")[0], "all 3 files") + columns
    assert signs
    assert tests.splitlines()[1:] == [f"{tmp_path / name}.csv: 0 to 11.99 s, 1200 rows, 1 A" for name in "abc"]


def test_a_damaged_run_is_remarked_and_hides_no_other(tmp_path: Path) -> None:
    (tmp_path / "bad" / "points").mkdir(parents=True)
    (tmp_path / "bad" / "points" / "p001.h5").write_bytes(b"no HDF5")
    (tmp_path / "empty" / "points").mkdir(parents=True)
    runs = one_object(rig("runs", "--in", str(tmp_path), "--json"))["runs"]
    assert [run["id"] for run in runs] == ["bad", "empty"]
    assert all(run["remark"] for run in runs)


def test_packages_of_the_same_name_from_another_project_are_named(tmp_path: Path) -> None:
    assert conflicting_packages() is None
    for name in ("drivers", "protocols", "simulators"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").touch()
    reported = conflicting_packages([str(tmp_path), *sys.path])
    assert reported is not None
    assert str(tmp_path / "drivers") in reported
    assert "belongs to another project" in reported
    reported = conflicting_packages([])
    assert reported is not None
    assert "missing" in reported


def test_what_is_wrong_in_matrix_and_bench_is_reported_at_once(tmp_path: Path) -> None:
    matrix, bench = tmp_path / "matrix.toml", tmp_path / "bench.toml"
    matrix.write_text(Path(TABLE1).read_text(encoding="utf-8").replace("frequency", "frequenzy"), encoding="utf-8")
    bench.write_text(Path(DEMO).read_text(encoding="utf-8").replace("0.8 m/s\"", "0.8 N\""), encoding="utf-8")
    for command in ("plan", "run"):
        out = ["--out", str(tmp_path / "out")] if command == "run" else []
        result = rig(command, str(matrix), "--bench", str(bench), "--json", *out)
        assert result.returncode == 2
        error = one_object(result)
        assert [text for text in error["problems"] if "matrix.toml" in text and "did you mean frequency?" in text]
        assert [text for text in error["problems"] if "bench.toml" in text and "0.8 N is a force" in text]
    assert not (tmp_path / "out").exists()


@pytest.mark.nightly
def test_arguments_the_simulated_rig_does_not_take_are_bad_usage(tmp_path: Path) -> None:
    quick = str(EXAMPLES / "quick.toml")
    result = rig("run", quick, "--simulate", "--json", "--out", str(tmp_path), "--", "--fault", "x")
    assert result.returncode == 2
    assert "'x' is not in the fault matrix" in one_object(result)["error"]


@pytest.mark.parametrize("closed", [(1,), (0, 1, 2)])
def test_closed_standard_streams_change_no_exit_code_and_no_file(tmp_path: Path, closed: tuple[int, ...]) -> None:
    """A descriptor that the caller closed would be given to the first file that is opened."""
    script = "; ".join([
        "import os, sys", *(f"os.close({number})" for number in closed),
        f"os.execv({sys.executable!r}, [{sys.executable!r}, '-m', 'rig.cli.main', 'explain', 'host-late'])",
    ])
    ended = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 0
    assert ended.stderr == ""
    assert bool(ended.stdout) is (1 not in closed)


def test_a_defect_ends_in_one_line_and_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    @click.command()
    def broken() -> None:
        raise ZeroDivisionError("a defect")

    assert answered(broken, [], "broken") == EXIT_DEFECT
    message = capsys.readouterr().err
    assert "Traceback" not in message
    written = Path(message.split()[-1])
    assert "ZeroDivisionError: a defect" in written.read_text(encoding="utf-8")
    written.unlink()


def test_a_package_of_an_extra_that_is_not_installed_is_named_with_its_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    @click.command()
    def export() -> None:
        importlib.import_module("pyarrow")

    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert answered(export, [], "export") == 2
    assert "pip install 'mr-damper-rig[files]'" in capsys.readouterr().err


@pytest.mark.parametrize(("arguments", "refused"), [
    (["run", "m.toml"], True), (["sniff", "COM3"], True), (["run", "--help"], False), (["import", "t.csv"], False),
    ([], False),
])
def test_on_windows_commands_that_need_linux_name_the_way_out(arguments: list[str], refused: bool) -> None:
    text = needs_linux(arguments, "nt")
    assert (text is not None) is refused
    assert text is None or ("WSL2" in text and "identify" in text)
    assert needs_linux(arguments, "posix") is None
