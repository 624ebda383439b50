"""`rig reanalyse`: analyse recorded runs again with this version, next to the original results."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rig.cli.hangups import hangups_interrupt
from rig.cli.options import Command, RunPath, json_option, scheduler_option
from rig.cli.output import console, job_bar, kept_after_stop, say, show, shown_path, write_json
from rig.document.blocks import Block, Blocks, Column, Heading, Note, Paragraph, Row, table
from rig.document.words import FAIR, GOOD, POOR
from rig.errors import EXIT_DONE, EXIT_IDENTIFICATION, EXIT_NOT_ALL_VALID, EXIT_USAGE
from rig.jobs.choice import workers_for
from rig.jobs.time_left import TimeLeft

if TYPE_CHECKING:
    from rig.reanalysis import Reanalysis, ReanalysisOptions

MOST_SHOWN = 12
"""Rows of each table on the terminal."""


@click.command(
    name="reanalyse", cls=Command,
    examples=(
        "rig reanalyse logs/20260102T030405Z-MR-001-ab12cd",
        "rig reanalyse logs/2026* --json",
        "rig reanalyse /archive/2024* --out results --scheduler tcp://HOST:8786",
        "rig compare last last/reanalysed/last",
    ),
)
@click.argument("runs", type=RunPath(), nargs=-1, required=True, metavar="RUN...")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), metavar="FOLDER",
              help="Write the results to FOLDER/RUN instead of RUN/reanalysed, for example if RUN is read-only.")
@click.option("--model", default="", metavar="NAME",
              help="Damper model to fit, or `auto`.  [default: model and settings of the original fit; if there "
                   "is no fit, as in the matrix file]")
@click.option("--no-fit", is_flag=True, help="Do not fit a model.")
@click.option("--again", is_flag=True, help="Repeat the analysis even if a result of this version already exists.")
@scheduler_option
@json_option
def command(
    runs: tuple[Path, ...], out: Path | None, model: str, no_fit: bool, again: bool, scheduler: str | None,
    as_json: bool,
) -> int:  # fmt: skip
    """Analyse each RUN again: align the received samples, and regenerate verdicts, characteristics, fit and report.

    The originals are not changed. Each result is written to RUN/reanalysed/DATE-VERSION, which is a complete run:
    other commands accept it, for example as RUN/reanalysed/last. The command lists the differences from the original
    results and their causes. The exit code is 2 if a run cannot be analysed, 6 if a fit cannot be repeated, and 5 if a
    point cannot be regenerated.
    """
    # loads numba and numpy: not needed for the help
    from rig.reanalysis import ReanalysisOptions, reanalyse_each

    options = ReanalysisOptions(out, model, not no_fit, again)
    ended = 0
    clock = TimeLeft(len(runs))
    with hangups_interrupt(), job_bar("runs") as show_progress:
        show_progress(0, len(runs))

        def finished(_result: Reanalysis, done: int) -> None:
            nonlocal ended
            ended = done
            show_progress(done, len(runs), clock.after(done))

        processes = min(len(runs), os.cpu_count() or 1)
        kept = kept_after_stop(
            lambda: f"{ended} of {len(runs)} runs were analysed; their results are kept. The same command continues "
            "with the other runs"
        )
        with kept, workers_for(scheduler, processes) as workers:
            results = reanalyse_each(runs, options, workers=workers, finished=finished)
    if as_json:
        failed = sum(bool(one.error) for one in results)
        write_json({"runs": [one.to_json() for one in results], "reanalysed": len(results) - failed, "failed": failed})
    else:
        _show(results)
    return _exit_code(results, options)


def _exit_code(results: Sequence[Reanalysis], options: ReanalysisOptions) -> int:
    if any(one.error for one in results):
        return EXIT_USAGE
    if options.fit and any(one.fit_error for one in results):
        return EXIT_IDENTIFICATION
    return EXIT_NOT_ALL_VALID if any(one.left_out for one in results) else EXIT_DONE


def _show(results: Sequence[Reanalysis]) -> None:
    # loads numpy: not needed for the help
    from rig.reanalysis.document import changes

    blocks: Blocks = []
    for result in results:
        title = Heading(result.run.name, 3)
        if len(results) > 1 and not result.error and not result.up_to_date:
            failures = [*([f"fit: {result.fit_error}"] if result.fit_error else []), *result.left_out]
            blocks += [title, *(Note(POOR, failure) for failure in failures)] if failures else []
        elif result.error:
            blocks += [title, Note(POOR, result.error)]
        elif result.up_to_date:
            blocks += [title, Paragraph("already analysed by this version from the same files (to repeat: --again)")]
        else:
            blocks += [title, *changes(result, MOST_SHOWN)]
    if len(results) > 1:
        blocks = [_overview(results), *blocks]
    show(blocks, console())
    for result in results:
        if result.result is not None:
            say(shown_path(result.result))


def _overview(results: Sequence[Reanalysis]) -> Block:
    """One row per run."""
    head = [
        Column("run"), Column("result"), Column("verdicts changed", "", True), Column("samples changed", "", True),
        Column("characteristics", "", True), Column("fitted values", "", True),
    ]  # fmt: skip
    rows = []
    for one in results:
        level, word = (POOR, "failed") if one.error else (GOOD, "unchanged")
        if one.up_to_date:
            word = "exists already"
        elif one.changed:
            level, word = FAIR, "changed"
        if one.fit_error or one.left_out:
            level, word = POOR, "no new fit" if one.fit_error else "points left out"
        counts = (
            sum(point.before != point.after for point in one.points),
            sum(bool(point.largest) for point in one.points), len(one.characteristics), len(one.fit),
        )
        rows.append(Row((one.run.name, word, *map(str, counts)), level))
    return table(head, rows)
