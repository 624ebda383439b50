"""`rig report`: write the report of a run again, as HTML and PDF."""

from __future__ import annotations

from pathlib import Path

import click

from rig.campaign_folder import CampaignFolder
from rig.cli.options import Command, json_option, run_argument
from rig.cli.output import say, shown_path, write_json, write_pdf
from rig.errors import EXIT_DONE
from rig.text_file import read_json


@click.command(name="report", cls=Command, examples=(
    "rig report logs/20260102T030405Z-MR-001-ab12cd",
    "rig report logs/20260102T030405Z-MR-001-ab12cd --pdf",
))  # fmt: skip
@run_argument
@click.option("--pdf", "on_paper", is_flag=True, help="Also write report.pdf (A4, with vector graphics, bookmarks and "
                                                      "page numbers).")
@json_option
def command(run: Path, on_paper: bool, as_json: bool) -> int:
    """Write report.html for RUN (a campaign folder) as one self-contained file."""
    # loads numba and numpy: not needed for the help
    from rig.report.document import written_report

    report, document = written_report(run)
    path = report.resolve()
    paper = write_pdf(document, path) if on_paper else None
    if as_json:
        characteristics = read_json(CampaignFolder(path.parent).characteristics)
        answer = {"campaign": str(run.resolve()), "report": str(path), "pdf": None if paper is None else str(paper)}
        write_json({**answer, "characteristics": characteristics})
    else:
        say(shown_path(path))
        if paper is not None:
            say(shown_path(paper))
    return EXIT_DONE
