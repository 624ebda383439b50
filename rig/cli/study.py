"""`rig study`: the papers' comparison over recordings, resumable."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rig.cli.options import Command, json_option, scheduler_option
from rig.cli.output import console, write_json
from rig.errors import EXIT_DONE

if TYPE_CHECKING:
    from rig.study.execution import StudyProgress


@click.command(name="study", cls=Command, examples=("rig study examples/paper-tables.toml --out logs/paper-tables",))
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the results; an interrupted study in it is continued.  [default: logs/study-<file's name>]",
)
@click.option("--processes", type=click.IntRange(1, 1024), help="Worker processes.  [default: one per processor]")
@scheduler_option
@json_option
def command(file: Path, out: Path | None, processes: int | None, scheduler: str | None, as_json: bool) -> int:
    """Run the study FILE: tables, statistics and figures of both papers from its recordings.

    Writes tables (CSV), study.json and study.html. It can be interrupted: finished searches are kept, and the same
    command continues.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from rig.study.comparison import run_study
    from rig.study.outputs import as_json as plain

    folder = out or Path("logs") / f"study-{file.stem}"
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[left]}"))
    with Progress(*columns, console=console(as_json=True)) as bar:
        task = bar.add_task("searches", total=None, left="")

        def show(progress: StudyProgress) -> None:
            left = "" if progress.seconds_left is None else f"{_minutes(progress.seconds_left)} left"
            bar.update(task, description=progress.doing, completed=progress.done, total=progress.total, left=left)

        outcome = run_study(file, folder, processes, show, scheduler)
    if as_json:
        results = plain(outcome.tables, outcome.kruskal_wallis, outcome.facts)
        write_json({"folder": folder.absolute(), "page": outcome.page.absolute(), **results})
    else:
        shown = console()
        counts = f"{outcome.facts['searches']} searches over {outcome.facts['samples']} samples"
        shown.print(f"{counts}, {len(outcome.tables)} tables")
        shown.print(f"page: {outcome.page}")
        shown.print(f"tables: {folder / 'tables'}")
    return EXIT_DONE


def _minutes(seconds: float) -> str:
    whole = round(seconds)
    return f"{whole // 60} min {whole % 60:02d} s" if whole >= 60 else f"{whole} s"
