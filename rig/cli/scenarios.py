"""`rig scenarios`: campaigns in drawn scenarios; replaces this process."""

from __future__ import annotations

import os
import sys
from typing import NoReturn

import click

from drivers.processes import own_program
from rig.cli.options import Command


@click.command(
    name="scenarios",
    cls=Command,
    add_help_option=False,
    context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False},
)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def command(arguments: tuple[str, ...]) -> NoReturn:
    """Run a matrix in simulated scenarios with random faults (`python -m simulators.scenarios` with ARGUMENTS)."""
    os.execv(sys.executable, own_program("simulators.scenarios", *arguments))
