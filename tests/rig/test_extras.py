"""What every message has: the pip of the environment in which the program runs, and no control characters."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from rig.cli.main import main
from rig.cli.output import console, say_error
from rig.errors import FileProblem
from rig.extras import how_to_install


def test_the_pip_of_an_environment_that_is_not_activated_is_named_with_its_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    programs = tmp_path / "my rig" / ".venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "pip").touch()
    monkeypatch.setattr(sys, "prefix", str(programs.parent))
    monkeypatch.delenv("VIRTUAL_ENV", raising=False)
    monkeypatch.chdir(tmp_path)
    assert how_to_install("pdf") == "'my rig/.venv/bin/pip' install 'mr-damper-rig[pdf]'"
    monkeypatch.chdir(tmp_path / "my rig")
    assert how_to_install("pdf") == ".venv/bin/pip install 'mr-damper-rig[pdf]'"
    monkeypatch.setenv("VIRTUAL_ENV", str(programs.parent))
    assert how_to_install("pdf") == "pip install 'mr-damper-rig[pdf]'"
    monkeypatch.delenv("VIRTUAL_ENV")
    (programs / "pip").unlink()  # made without pip
    assert how_to_install("pdf").startswith("pip ")


def test_names_in_files_do_not_control_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    hostile = "\x1b[31mF\u202e_N"
    say_error(str(FileProblem("a.csv", [f"no column {hostile}"])))
    console().print(hostile, markup=False)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "-rf.csv").write_text(f"t_s,x_mm,{hostile}\n" + "".join(f"{k},{k % 7},{k % 5}\n" for k in range(40)))
    assert main(["import", "--", "-rf.csv"]) == 2
    shown = "".join(capsys.readouterr())
    assert shown.count("\\x1b[31mF\\u202e_N") >= 3
    assert not {"\x1b", "\u202e"} & set(shown)
    assert "rig import ./-rf.csv" in shown
