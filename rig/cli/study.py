"""`rig study`: the papers' comparison over recordings, or a benchmark on open ones; can be resumed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rig.cli.options import Command, json_option, scheduler_option
from rig.cli.output import console, show, write_json
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
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    # loads numba and scipy: not needed for the help
    from rig.study.benchmark_file import is_benchmark
    from rig.study.comparison import run_study
    from rig.study.outputs import as_json as plain

    folder = out or Path("logs") / f"study-{file.stem}"
    if is_benchmark(file):
        with _resumable(folder):
            return _benchmark(file, folder, processes, as_json)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[left]}"))
    with _resumable(folder), Progress(*columns, console=console(as_json=True)) as bar:
        task = bar.add_task("searches", total=None, left="")

        def follow(progress: StudyProgress) -> None:
            left = "" if progress.seconds_left is None else f"{_minutes(progress.seconds_left)} left"
            bar.update(task, description=progress.doing, completed=progress.done, total=progress.total, left=left)

        outcome = run_study(file, folder, processes, follow, scheduler)
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


@contextmanager
def _resumable(folder: Path) -> Iterator[None]:
    """Ctrl-C says what is kept and how to go on.

    Raises:
        KeyboardInterrupt: Passed on, with that text.
    """
    try:
        yield
    except KeyboardInterrupt as stop:
        raise KeyboardInterrupt(f"finished results are kept in {folder}; run the same command again to "
            "continue the study") from stop


def _benchmark(file: Path, folder: Path, processes: int | None, as_json: bool) -> int:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    # loads numpy and h5py: not needed for the help
    from rig.study.benchmark import run_benchmark
    from rig.study.outputs import as_json as plain
    from rig.study.outputs import written

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=console(as_json=True)) as bar:
        task = bar.add_task("fits", total=None)

        def follow(progress: StudyProgress) -> None:
            bar.update(task, completed=progress.done, total=progress.total)

        outcome = run_benchmark(file, folder, processes, follow)
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


def _minutes(seconds: float) -> str:
    whole = round(seconds)
    return f"{whole // 60} min {whole % 60:02d} s" if whole >= 60 else f"{whole} s"
