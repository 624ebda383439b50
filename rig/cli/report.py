"""`rig report`: write the report of a run again, as HTML and PDF."""

from __future__ import annotations

import contextlib
from pathlib import Path

import click

from rig.campaign_folder import CampaignFolder
from rig.cli.options import Command, json_option, run_argument
from rig.cli.output import console, say, shown_path, write_json, write_pdf
from rig.errors import EXIT_DONE, FileProblem
from rig.text_file import read_json


@click.command(name="report", cls=Command, examples=(
    "rig report logs/20260102T030405Z-MR-001-ab12cd",
    "rig report logs/20260102T030405Z-MR-001-ab12cd --pdf",
    "rig report logs/20260102T030405Z-MR-001-ab12cd --pdf --summary --details customer.toml",
))  # fmt: skip
@run_argument
@click.option("--pdf", "on_paper", is_flag=True, help="Also write report.pdf (with vector graphics, bookmarks and "
                                                      "page numbers; paper size: [display] paper).")
@click.option("--summary", is_flag=True, help="With --pdf: write only the first two pages (verdict, forces, loops, "
                                              "conditions, signatures).")
@click.option("--details", type=click.Path(path_type=Path), metavar="FILE",
              help="TOML file with a [report] table (title, customer, logo, ...), used instead of the run's own table, "
                  "and with a [display] table (units, signs).")
@json_option
def command(run: Path, on_paper: bool, summary: bool, details: Path | None, as_json: bool) -> int:
    """Write report.html for RUN (a campaign folder) as one self-contained file, and show its table of forces."""
    _check_summary(summary, on_paper=on_paper)
    # load numba and numpy: not needed for the help
    from rig.campaign.resume import renew_endurance
    from rig.cli.force_tables import show_recorded_tables
    from rig.matrix.report_table import load_details
    from rig.report.document import written_report

    report, document = written_report(run, None if details is None else load_details(details))
    path = report.resolve()
    with contextlib.suppress(FileProblem):  # without its matrix file, the report is complete but for the stop rules
        renew_endurance(path.parent)
    paper = write_pdf(document.sheets if summary else document, path) if on_paper else None
    if as_json:
        characteristics = read_json(CampaignFolder(path.parent).characteristics)
        answer = {"campaign": str(run.resolve()), "report": str(path), "pdf": None if paper is None else str(paper)}
        write_json({**answer, "characteristics": characteristics})
    else:
        show_recorded_tables(path.parent, console())
        say(shown_path(path))
        if paper is not None:
            say(shown_path(paper))
    return EXIT_DONE


def _check_summary(summary: bool, *, on_paper: bool) -> None:
    """Refuse the summary of a PDF that is not written.

    Raises:
        UsageError: it is none.
    """
    if summary and not on_paper:
        raise click.UsageError("--summary selects pages of the PDF. Fix: add --pdf")
