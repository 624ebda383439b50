"""The recipes for every night: the shell takes their lines, and `rig scenarios` their options."""

from __future__ import annotations

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from rig.cli.main import COMMANDS
from simulators.scenarios.__main__ import command
from simulators.scenarios.plan import AROUND
from simulators.scenarios.request import seeds_of

PAGE = (Path(__file__).resolve().parents[2] / "docs/how-to/try-your-matrix-in-scenarios.md").read_text(encoding="utf-8")
LINES = re.findall(r"^ *(?:- run: )?(rig scenarios --.*?)(?:   .*)?$", PAGE, re.MULTILINE)


def test_a_shell_takes_the_recipes(tmp_path: Path) -> None:
    """With a program in `rig`'s place that tells what it was given."""
    assert len(LINES) == 7
    program = tmp_path / "rig"
    program.write_text('#!/bin/sh\nprintf "%s\\n" "$3" >&2\n', encoding="utf-8")
    program.chmod(0o755)
    nightly = [line for line in LINES if "$" in line]
    for line in nightly:
        done = subprocess.run(
            ["sh", "-euc", f"GITHUB_RUN_NUMBER=12; first=$((1000 * GITHUB_RUN_NUMBER)); {line}"], cwd=tmp_path,
            env={"PATH": f"{tmp_path}:/usr/bin:/bin"}, capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert len(seeds_of(done.stderr.strip())) == 200
    assert len(nightly) == 2


@pytest.mark.parametrize("line", LINES)
def test_the_command_takes_the_options(line: str) -> None:
    words = shlex.split(line.partition(" > ")[0])
    assert words[:2] == ["rig", "scenarios"]
    context = command.make_context("rig scenarios", words[2:])
    assert context.params["seeds"]


def test_everything_that_happens_around_the_devices_is_named() -> None:
    assert [what for what in AROUND if f"`{what}`" not in PAGE] == []
    assert "scenarios" in COMMANDS
    visible = [option for option in command.params if not getattr(option, "hidden", False)]
    options = {name for option in visible for name in option.opts if name.startswith("--")}
    assert [name for name in options - {"--help"} if f"`{name}" not in PAGE] == []
