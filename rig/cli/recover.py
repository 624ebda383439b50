"""`rig recover`: complete the points that a crash left unfinished."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from rig.cli.options import Command, json_option, run_argument
from rig.cli.output import say, write_json
from rig.errors import EXIT_DONE, EXIT_NOT_ALL_VALID


@click.command(name="recover", cls=Command, examples=("rig recover logs/20260102T030405Z-MR-001-ab12cd",))
@run_argument
@json_option
def command(run: Path, as_json: bool) -> int:
    """Finish the points of an interrupted campaign: convert each journal in RUN to a point file marked as recovered.

    Finished points are not changed. The exit code is 5 if a recovered point is not valid, for example because it is
    incomplete.
    """
    # loads numpy: not needed for the help
    from rig.recording.conversion.recovery import recover
    from rig.recording.run import unreadable_points

    finished = recover(run)
    damaged = unreadable_points(run)
    if as_json:
        answer = {"campaign": run.resolve(), "points": [asdict(item) for item in finished]}
        write_json(answer | {"unreadable": damaged})
        damaged = []
    elif not finished:
        say("nothing to recover")
    else:
        for item in finished:
            say("  ".join(filter(None, (item.id, item.verdict, *item.reasons, item.error, item.file))))
    for line in damaged:
        say(f"warning: {line}", err=True)
    return EXIT_DONE if all(item.verdict == "valid" for item in finished) else EXIT_NOT_ALL_VALID
