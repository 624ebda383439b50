"""Help and examples on a terminal of 80 columns: nothing cut, nothing broken within a word."""

from __future__ import annotations

import shlex

import click
import pytest
from click.testing import CliRunner

from rig.cli.help_examples import continued
from rig.cli.main import cli

COMMANDS = sorted(set(cli.list_commands(click.Context(cli))) - {"scenarios"})
"""`rig scenarios` gives this process to another program, whose help it is."""


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_no_line_of_a_help_is_longer_than_the_terminal(command: str) -> None:
    reported = CliRunner().invoke(cli, [*command.split(), "--help"], terminal_width=80)
    assert reported.exit_code == 0
    assert [line for line in reported.output.splitlines() if len(line) > 80] == []


def test_a_long_example_is_what_a_shell_reads_as_one_command() -> None:
    command = "rig import a.csv --column force=Kraft --current-from-name '_(?P<current>[0-9. ]+)A and more of it'"
    lines = continued(command, 60)
    assert lines == [
        "rig import a.csv --column force=Kraft \\",
        "    --current-from-name '_(?P<current>[0-9. ]+)A and more of it'",
    ]
    assert shlex.split("\n".join(lines).replace("\\\n", " ")) == shlex.split(command)
    assert continued("rig demo", 60) == ["rig demo"]
