"""`rig simulate`: the simulated rig alone; replaces this process."""

from __future__ import annotations

import os
import sys
from typing import NoReturn

import click

from drivers.processes import own_program
from rig.cli.options import Command


@click.command(
    name="simulate",
    cls=Command,
    context_settings={"ignore_unknown_options": True},
    examples=("rig simulate --speed 10 --truth truth.h5", "rig simulate -- --help    (options of the simulated rig)"),
)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def command(arguments: tuple[str, ...]) -> NoReturn:
    """Run only the simulated rig (`python -m simulators` with ARGUMENTS).

    The first line of output is the path to the simulated rig's bench file, for use with `rig run --bench`. Press Ctrl-C
    to stop the rig.
    """
    os.execv(sys.executable, own_program("simulators", *arguments))
