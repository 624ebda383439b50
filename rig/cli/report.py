"""`rig report`: the report of a run, written again."""

from __future__ import annotations

import json
from pathlib import Path

import click

from rig.cli.options import Command, json_option, run_argument
from rig.cli.output import say, write_json
from rig.errors import EXIT_DONE


@click.command(name="report", cls=Command, examples=("rig report logs/20260102T030405Z-MR-001-ab12cd",))
@run_argument
@json_option
def command(run: Path, as_json: bool) -> int:
    """Write report.html of RUN (a campaign directory): one self-contained file."""
    from rig.report import write_report

    path = write_report(run).resolve()
    if as_json:
        characteristics = json.loads((path.parent / "characteristics.json").read_text(encoding="utf-8"))
        write_json({"campaign": str(run.resolve()), "report": str(path), "characteristics": characteristics})
    else:
        say(path)
    return EXIT_DONE
