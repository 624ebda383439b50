"""`rig study`: the papers' comparison over recordings, or a benchmark on open ones; can be resumed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rig.cli.options import Command, json_option, scheduler_option
from rig.cli.output import JobBar, console, job_bar, kept_after_stop, show, write_json
from rig.document.blocks import Column, Head, Paragraph, table
from rig.errors import EXIT_DONE

if TYPE_CHECKING:
    from rig.study.execution import StudyProgress


@click.command(
    name="study",
    cls=Command,
    examples=(
        "rig study examples/paper-tables.toml --out logs/paper-tables",
        "rig study examples/open-recordings.toml",
    ),
)
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the results; an interrupted study in this folder is continued.  [default: "
         "logs/study-<name of the file>]",
)
@click.option("--processes", type=click.IntRange(1, 1024), help="Number of worker processes.  [default: one per "
    "processor]")
@scheduler_option
@json_option
def command(file: Path, out: Path | None, processes: int | None, scheduler: str | None, as_json: bool) -> int:
    """Run the study in FILE: produce the tables, statistics and figures of both papers from the study's recordings.

    If FILE is a benchmark file (such as examples/open-recordings.toml), the command instead fits every model with every
    method to publicly available recordings and writes a table of the validation errors. It also prints a list of the
    files to download.

    The results are tables (CSV), study.json and study.html. After an interruption, run the same command again to
    continue; finished searches are kept.
    """
    # loads numba and scipy: not needed for the help
    from rig.study.benchmark_file import is_benchmark
    from rig.study.comparison import run_study
    from rig.study.outputs import as_json as plain

    folder = out or Path("logs") / f"study-{file.stem}"
    resumable = kept_after_stop(
        lambda: f"finished results are kept in {folder}; run the same command again to continue the study"
    )
    if is_benchmark(file):
        with resumable:
            return _benchmark(file, folder, processes, scheduler, as_json)
    with resumable, job_bar("searches") as show_progress:
        outcome = run_study(file, folder, processes, _followed(show_progress), scheduler)
    if as_json:
        results = plain(outcome.tables, outcome.kruskal_wallis, outcome.facts)
        write_json({"folder": folder.absolute(), "page": outcome.page.absolute(), **results})
    else:
        shown = console()
        counts = f"{outcome.facts['searches']} searches over {outcome.facts['samples']} samples"
        shown.print(f"{counts}, {len(outcome.tables)} tables", soft_wrap=True)
        shown.print(f"page: {outcome.page}", soft_wrap=True)
        shown.print(f"tables: {folder / 'tables'}", soft_wrap=True)
    return EXIT_DONE


def _followed(show_progress: JobBar) -> Callable[[StudyProgress], None]:
    """Function that a study calls with its progress."""
    return lambda progress: show_progress(progress.done, progress.total, progress.seconds_left, progress.doing)


def _benchmark(file: Path, folder: Path, processes: int | None, scheduler: str | None, as_json: bool) -> int:
    # loads numpy and h5py: not needed for the help
    from rig.study.benchmark import run_benchmark
    from rig.study.outputs import as_json as plain
    from rig.study.outputs import written

    with job_bar("fits") as show_progress:
        outcome = run_benchmark(file, folder, processes, _followed(show_progress), scheduler)
    if as_json:
        results = plain([outcome.table], {}, outcome.facts)
        write_json({"folder": folder.absolute(), "page": outcome.page.absolute(), **results})
        return EXIT_DONE
    head: list[Head] = [
        *outcome.table.columns[:3], Column("validation error", "% of force amplitude", True),
        Column("variance explained", "%", True),
    ]  # fmt: skip
    rows = [[written(cell) for cell in row[:5]] for row in outcome.table.rows]
    shown = console()
    show([table(head, rows), *map(Paragraph, outcome.facts["left_out"])], shown)
    shown.print(f"page: {outcome.page}", soft_wrap=True)
    return EXIT_DONE

