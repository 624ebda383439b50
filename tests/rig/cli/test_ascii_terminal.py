"""Terminals that know ASCII only: every command works there, and nothing but ASCII is sent to them."""

from __future__ import annotations

import contextlib
import json
import os
import re
import subprocess
import sys
import termios
from pathlib import Path

import pytest

from rig.cli.main import COMMANDS
from rig.cli.output import replaced

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "examples"
ASCII = {"PYTHONIOENCODING": "ascii", "LANG": "C"}
C_LOCALE = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


@pytest.fixture
def files(tmp_path: Path) -> dict[str, str]:
    """A bench and a matrix whose names and contents are not ASCII."""
    bench, matrix = tmp_path / "prüfstand°.toml", tmp_path / "mätrix.toml"
    bench.write_text((EXAMPLES / "demo-bench.toml").read_text().replace("demo bench", "Prüfstand µ²√☃"), "utf-8")
    matrix.write_text((EXAMPLES / "table1.toml").read_text() + "# ±\n", "utf-8")
    wrong = tmp_path / "fälsch.toml"
    wrong.write_text(bench.read_text("utf-8").replace('"0.8 m/s"', '"0.8 µΩ"'), "utf-8")
    return {"bench": str(bench), "matrix": str(matrix), "wrong": str(wrong), "none": str(tmp_path / "nïchts")}


REPLACED = ("scenarios", "simulate")
"""Commands in whose place another program runs."""
HELPS = """
import sys
from rig.cli.main import main
for name in sys.argv[1:]:
    print("ended", name, main([*name.split(), "--help"]))
"""


def rig(environment: dict[str, str], *arguments: str) -> tuple[int, str]:
    return ran(environment, "-m", "rig.cli.main", *arguments)


def ran(environment: dict[str, str], *arguments: str) -> tuple[int, str]:
    """Exit code and what Python with these arguments wrote, which is ASCII."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith(("LC_", "PYTHON", "LANG"))}
    result = subprocess.run(
        [sys.executable, *arguments], capture_output=True, cwd=ROOT, timeout=120, check=False,
        env={**inherited, **environment},
    )  # fmt: skip
    assert b"Traceback" not in result.stderr, result.stderr
    return result.returncode, result.stdout.decode("ascii") + result.stderr.decode("ascii")


@pytest.mark.few(4)
@pytest.mark.parametrize("environment", [ASCII, C_LOCALE], ids=["PYTHONIOENCODING", "LC_ALL"])
@pytest.mark.parametrize(
    ("arguments", "code", "expected"),
    [
        (("plan", "matrix", "--bench", "bench"), 0, "Prufstand u^2sqrt?"),
        (("plan", "matrix", "--bench", "bench", "--json"), 0, r"\u2603"),
        (("plan", "matrix", "--bench", "wrong"), 2, 'unknown unit "u'),
        (("plan", "none", "--bench", "bench"), 2, "there is no such file"),
        (("plan", "matrix"), 2, "Missing option '--bench'"),
        (("runs", "--in", "none"), 2, "no such folder"),
        (("report", "none"), 2, "no such folder"),
        (("recover", "none"), 2, "not a campaign folder"),
        (("identify", "none"), 2, "no such folder"),
        (("study", "none"), 2, "there is no such file"),
        (("import", "none", "--column", "time=t_s"), 2, ""),
        (("plän",), 2, "No such command"),
    ],
)
def test_a_command_works_and_writes_ascii(
    environment: dict[str, str], files: dict[str, str], arguments: tuple[str, ...], code: int, expected: str
) -> None:
    ended, reported = rig(environment, *(files.get(item, item) for item in arguments))
    assert ended == code, reported
    assert expected in reported


def test_every_help_is_ascii() -> None:
    """In one process as far as that goes."""
    here = ["", *(name for name in COMMANDS if name not in REPLACED)]
    code, reported = ran(ASCII, "-c", HELPS, *here)
    assert code == 0
    *helps, rest = re.split(r"^ended .* 0\n", reported, flags=re.MULTILINE)
    assert len(helps) == len(here)
    assert not rest
    for name in REPLACED:
        code, reported = rig(ASCII, name, "--help")
        assert code == 0
        helps.append(reported)
    assert all("Usage" in text for text in helps)


def test_json_stays_json(files: dict[str, str]) -> None:
    _, reported = rig(ASCII, "plan", files["matrix"], "--bench", files["bench"], "--json")
    assert json.loads(reported)["bench"].startswith("Prüfstand")


def test_what_is_no_error_of_encoding_is_raised_again() -> None:
    with pytest.raises(UnicodeDecodeError):
        replaced(UnicodeDecodeError("ascii", b"\xff", 0, 1, "ordinal not in range"))


@pytest.mark.few(2)
@pytest.mark.parametrize("columns", [40, 80, 121])
@pytest.mark.parametrize("terminal", ["dumb", "xterm-256color"])
def test_a_plan_fits_the_terminal_it_is_shown_on(columns: int, terminal: str) -> None:
    main, side = os.openpty()
    termios.tcsetwinsize(side, (25, columns))
    inherited = {name: value for name, value in os.environ.items() if name not in {"COLUMNS", "LINES", "NO_COLOR"}}
    files = (str(EXAMPLES / "quick.toml"), "--bench", str(EXAMPLES / "paper-bench.toml"))
    with subprocess.Popen(
        [sys.executable, "-m", "rig.cli.main", "plan", *files], stdin=side, stdout=side, stderr=side,
        cwd=ROOT, env={**inherited, "TERM": terminal, **ASCII},
    ) as process:  # fmt: skip
        os.close(side)
        shown = b""
        with contextlib.suppress(OSError):  # the terminal ends with the process
            while part := os.read(main, 4096):
                shown += part
    os.close(main)
    assert process.returncode == 3
    plain = re.sub(r"\x1b\[[0-9;]*m", "", shown.decode("ascii"))
    assert max(map(len, plain.splitlines())) <= columns
    assert plain.rstrip().endswith("2 of 2 points outside limits")
    assert ("\x1b[31m" in shown.decode("ascii")) is (terminal != "dumb")
    assert " ".join(plain.split()).count("and streaming)") == 1
    assert plain.count("11.78") == 2
