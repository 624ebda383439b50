"""`rig runs`: list of runs, how they ended, how well they were fitted."""

from __future__ import annotations

import math
import os
import warnings
from pathlib import Path
from typing import Any

import click

from rig.campaign_folder import LOGS, CampaignFolder, check_folder_of_runs, held_inodes, inode
from rig.cli.options import Command, json_option
from rig.cli.output import console, progress_bar, show, write_json
from rig.document.blocks import Column, Paragraph, table
from rig.errors import EXIT_DONE, DataWarning, FileProblem
from rig.recording.point_files import unfinished
from rig.recording.tested_specimens import NO_BANDS, SpecimenVerdict
from rig.results.run_index import RunFilter, listed
from rig.verdicts import VERDICTS, worst

WIDE = 110
"""Columns from which specimen and date, which are part of most names, have columns of their own."""
MOST_SHOWN = 200
"""Rows of the table; the last ones."""


@click.command(
    name="runs", cls=Command,
    examples=("rig runs", "rig runs --in /data/dampers --specimen 'MR-0*' --date 2026-11 --verdict valid --json"),
)
@click.option(
    "--in", "folder", type=click.Path(path_type=Path), default=LOGS, show_default=True,
    help="Folder that contains the runs.",
)
@click.option("--specimen", metavar="TEXT", help="Serial number of the specimen; * and ? are wildcards.")
@click.option(
    "--date", metavar="DATE",
    help=(
        "Start date (UTC): a year, month or day (2026-11-23), or a range (2026-11-01:2026-11-23); a range may be "
        "open at one end."
    ),
)
@click.option("--verdict", type=click.Choice(VERDICTS), help="Worst verdict of any point in the run.")
@click.option("--model", metavar="NAME", help="Fitted model.")
@json_option
def command(
    folder: Path, specimen: str | None, date: str | None, verdict: str | None, model: str | None, as_json: bool
) -> int:
    """List the runs in a folder; multiple filters are combined with AND.

    Summaries are cached in .rig-runs.sqlite in that folder; runs that have changed are read again.
    """
    runs = _listed(folder, RunFilter(specimen, date, verdict, model), None if as_json else MOST_SHOWN)
    if as_json:
        write_json({"runs": runs})
    else:
        _show(runs, folder)
    return EXIT_DONE


def _listed(folder: Path, run_filter: RunFilter, last: int | None) -> list[dict[str, Any]]:
    """One summary a run.

    Raises:
        FileProblem: there is no such folder.
    """
    check_folder_of_runs(folder)
    whole, held = str(folder.resolve()), held_inodes()
    with progress_bar("reading runs for the first time") as report_progress:
        summaries = listed(folder, _summary, run_filter, last, report_progress)
    runs = [{**run, "path": os.path.join(whole, run["id"])} for run in summaries]
    return [{**run, "running": inode(run["path"]) in held} for run in runs]


def _show(runs: list[dict[str, Any]], folder: Path) -> None:
    shown = console()
    if not runs:
        shown.print(f"no matching runs in {folder}", markup=False)
        return
    tested = any(run["specimen_verdict"] != NO_BANDS for run in runs)
    wide, unfinished = shown.width >= WIDE, any(run["unfinished"] and not run["running"] for run in runs)
    head = [
        Column("run"), *((Column("specimen"), Column("started")) if wide else ()), Column("verdict"),
        *([Column("specimen verdict" if wide else "damper")] if tested else []),
        Column("valid", "", True), *([Column("recoverable", "", True)] if unfinished else []),
        Column("fit and error, % of force amplitude", "", True),
    ]  # fmt: skip
    rows = []
    for run in runs:
        error = run["nrmse_percent_of_peak"]
        verdict, recoverable = ("running", "-") if run["running"] else (_outcome(run), str(run["unfinished"]))
        cells = [run["id"], *((run["specimen"], run["started"][:10]) if wide else ()), verdict]
        cells += [run["specimen_verdict"]] if tested else []
        cells += [f"{run['valid']}/{max(run['planned'], run['points'])}", *([recoverable] if unfinished else [])]
        rows.append([*cells, "-" if error is None else f"{run['model']} {error:.3g}"])
    notes = [f"{run['id']}: {run['remark']}" for run in runs if run["remark"] and not run["running"]]
    notes.append("Commands accept a run's name, part of the name, `last`, or -1, -2, ... (example: rig report last).")
    if len(runs) == MOST_SHOWN:
        notes.append(f"Only the last {MOST_SHOWN} runs are shown; use filters or --json to list the others.")
    show([table(head, rows), *map(Paragraph, notes)], shown)


def _outcome(run: dict[str, Any]) -> str:
    """The verdict of a run with all its points; otherwise how it ended."""
    if run["points"] >= run["planned"] or not run["planned"]:
        return str(run["verdict"])
    if run["unfinished"]:
        return "interrupted"
    return "stopped" if run["points"] else "no points"


def _summary(place: Path) -> dict[str, Any]:
    """One run in a few numbers; what cannot be read is said in `remark`, so that one bad run hides no others."""
    from rig.matrix.acceptance_table import has_acceptance  # loads pydantic
    from rig.recording.endurance import withdrawn_points  # loads numpy
    from rig.recording.run import Run, planned_points, read_campaign  # the same
    from rig.recording.tested_on import when_tested  # the same

    summary: dict[str, Any] = {
        "id": place.name, "path": "", "specimen": "", "started": "", "verdict": "", "model": "", "points": 0,
        "planned": 0, "valid": 0, "unfinished": 0, "out_of_tolerance": 0, "apart": 0, "nrmse_percent_of_peak": None,
        "specimen_verdict": str(SpecimenVerdict.NOT_TESTED) if has_acceptance(place) else NO_BANDS,
        "remark": "",
    }  # fmt: skip
    try:
        summary["unfinished"] = len(unfinished(CampaignFolder(place).points))
        campaign = read_campaign(place)
        summary["specimen"] = str(campaign.get("specimen", ""))
        summary["started"] = when_tested(campaign)
        summary["planned"] = len(set(planned_points(campaign)) - withdrawn_points(place))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)  # it is the remark
            run = Run.open(place)
        summary["remark"] = "; ".join(run.unreadable)
        verdicts = [point.verdict for point in run.judged]
        summary |= {"points": len(verdicts), "valid": verdicts.count("valid")}
        summary |= dict.fromkeys(("out_of_tolerance", "apart"), len(run.apart))
        summary["verdict"] = worst(verdicts)
        if (verdict := CampaignFolder(place).acceptance).is_file():
            summary["specimen_verdict"] = _specimen_verdict(verdict)
        summary["nrmse_percent_of_peak"], summary["model"] = _fit_error(CampaignFolder(place).fit)
    except FileProblem as error:
        name = f"{Path(error.file).name}: " if error.file.endswith(".json") else ""
        summary["remark"] = name + error.problems[0]
    except OSError as error:
        summary["remark"] = f"cannot be read: {error.strerror}"
    return summary


def _specimen_verdict(path: Path) -> str:
    """The verdict on the specimen in a file.

    Raises:
        FileProblem: the file is damaged.
    """
    from rig.comparison.specimen import read_specimen  # here: a list without acceptance bands loads no scipy

    return str(read_specimen(path.parent).verdict)


def _fit_error(path: Path) -> tuple[float | None, str]:
    """The fit's mean error in percent of the force amplitude and its model; None and empty when nothing was fitted.

    Raises:
        FileProblem: the file is no fit.
    """
    if not path.is_file():
        return None, ""
    from rig.fits.fit_record import FitRecord  # here: a list without fits loads no numpy

    fit = FitRecord.load(path)
    error = fit.error.nrmse_percent_of_peak
    return None if math.isnan(error) else error, fit.model
