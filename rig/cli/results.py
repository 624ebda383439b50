"""`rig results`: the results database of a folder of runs, its rows, and their delivery to a server."""

from __future__ import annotations

import csv
import os
import sys
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rig.bench.server_address import ADDRESS_VARIABLE, checked_address
from rig.campaign_folder import LOGS, by_age
from rig.cli.delivering import ServerAddress, address_of_run
from rig.cli.options import Command, json_option
from rig.cli.output import console, progress_bar, say, show, shown_path, write_json
from rig.document.blocks import Column, Paragraph, table
from rig.errors import EXIT_DONE, EXIT_USAGE, FileProblem

if TYPE_CHECKING:
    from rig.results.connection import Database
    from rig.results.delivery import State
    from rig.results.reader import ResultFilter, ResultRow

MOST_SHOWN = 200
"""Rows of the table; the last ones."""
WIDE = 110
UNFOLDED = 1_000


@click.command(
    name="results", cls=Command,
    examples=(
        "rig results",
        "rig results --specimen 'MR-0*' --quantity rebound_force",
        "rig results --csv results.csv --date 2026-11",
        "rig results --deliver --results postgresql://rig@HOST/rig",
        "rig results --results postgresql://rig@HOST/rig --station 'line *' --json",
    ),
)
@click.option(
    "--in", "folder", type=click.Path(path_type=Path), default=LOGS, show_default=True,
    help="Folder that contains the runs.",
)
@click.option(
    "--results", "url", type=ServerAddress(), metavar="URL",
    help="PostgreSQL server (postgresql://USER@HOST/DATABASE): with --deliver, the target; otherwise the database to "
         "read instead of the folder. Password: PGPASSWORD or ~/.pgpass.",
)
@click.option("--deliver", is_flag=True, help="Deliver all campaigns that the server does not have. The default server "
              "is that of the RIG_RESULTS variable or the newest run's bench file.")
@click.option("--rebuild", is_flag=True, help="Rebuild the database from the run directories.")
@click.option("--csv", "csv_file", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE",
              help="Write the selected values to a CSV file.")  # fmt: skip
@click.option("--specimen", metavar="TEXT", help="Serial number; * and ? are wildcards, here and below.")
@click.option("--date", metavar="DATE", help="Start date (UTC): a year, month or day, or a range "
              "(2026-11-01:2026-11-23).")
@click.option("--quantity", metavar="TEXT", help="Quantity, such as rebound_force, or parameter of a fit.")
@click.option("--matrix", metavar="TEXT", help="Name of the matrix file.")
@click.option("--station", metavar="TEXT", help="Name of the station.")
@click.option("--operator", metavar="TEXT", help="Person who performed the test.")
@json_option
def command(
    folder: Path, url: str | None, deliver: bool, rebuild: bool, csv_file: Path | None, as_json: bool,
    **wanted: Any,  # noqa: ANN401 - click's, by their names
) -> int:
    """Update the results database of a folder, and show its state or the values that the filters select.

    The database .rig-runs.sqlite in that folder is made from the run directories; runs that have changed are read
    again. Campaigns that cannot be delivered are kept and delivered at the next attempt.
    """
    # loads SQLAlchemy: not needed for the help
    from rig.results.reader import ResultFilter

    selected = ResultFilter(**wanted)
    reads = csv_file is not None or not selected.empty
    _check_usage(deliver=deliver, reads=reads, rebuilds_server=rebuild and url is not None and not deliver)
    if reads:
        return _rows(folder, url, selected, csv_file, rebuild=rebuild, as_json=as_json)
    return _state(folder, url, deliver=deliver, rebuild=rebuild, as_json=as_json)


def _check_usage(*, deliver: bool, reads: bool, rebuilds_server: bool) -> None:
    """Refuse options that contradict each other.

    Raises:
        UsageError: with what to write instead.
    """
    if deliver and reads:
        raise click.UsageError("--deliver delivers all campaigns. Fix: remove the filters and --csv")
    if rebuilds_server:
        raise click.UsageError("--rebuild makes the database of a folder. Fix: remove --results, or add --deliver")


def _state(folder: Path, url: str | None, *, deliver: bool, rebuild: bool, as_json: bool) -> int:
    """Update, deliver if requested, and show the state."""
    # loads SQLAlchemy: not needed for the help
    from rig.results.delivery import deliver as deliver_all
    from rig.results.delivery import state_of
    from rig.results.filling import filled_database

    with progress_bar("reading runs") as report_progress, filled_database(
        folder, rebuild=rebuild, report_progress=report_progress
    ) as (database, filled):
        target = (url or _configured(folder, database)) if deliver else url
        failed = False
        if deliver and target is not None:
            with progress_bar("delivering") as report_delivery:
                failed = bool(deliver_all(database, target, report_delivery).error)
        state = state_of(database, filled, target)
    for note in filled.notes:
        say(f"warning: {note}", err=True)
    if as_json:
        write_json(_json_of(state))
    else:
        _show_state(state)
    return EXIT_USAGE if failed else EXIT_DONE


def _configured(folder: Path, database: Database) -> str:
    """Address of the server in the environment, or in the newest run's bench file.

    Raises:
        FileProblem: there is none, or it is not valid; the servers that campaigns wait for are named.
    """
    from rig.results.delivery import servers_waited_for  # loads SQLAlchemy: not needed for the help

    if address := os.environ.get(ADDRESS_VARIABLE):
        try:
            return checked_address(address)
        except ValueError as error:
            raise FileProblem(ADDRESS_VARIABLE, [str(error)]) from error
    for name in reversed(by_age(folder)):
        if (configured := address_of_run(folder / name)) is not None:
            return configured
    if waited_for := servers_waited_for(database):  # stored without options such as sslmode: not used silently
        raise FileProblem(str(folder), [
            f"no results server is configured; campaigns are waiting for {', '.join(waited_for)}. Fix: specify "
            f"--results {waited_for[0]}"
        ])
    raise FileProblem(str(folder), [
        "no results server is configured. Fix: specify --results postgresql://USER@HOST/DATABASE, or set url in the "
        "[results] table of the bench file"
    ])


def _json_of(state: State) -> dict[str, Any]:
    filled = state.filled
    return {
        "database": str(state.database.resolve()), "runs": filled.runs, "read": filled.read,
        "removed": filled.removed, "running": filled.running, "campaigns": state.campaigns,
        "specimens": state.specimens, "values": state.values, "remarks": filled.remarks, "notes": filled.notes,
        "delivery": [outbox.to_json() for outbox in state.outboxes],
    }  # fmt: skip


def _show_state(state: State) -> None:
    filled = state.filled
    changed = f" ({filled.read} new or changed)" if filled.read else ""
    lines = [
        f"{state.campaigns} campaigns of {state.specimens} specimens with {state.values} values, from {filled.runs} "
        f"runs{changed}: {shown_path(state.database)}",
    ]
    lines += [f"{name}: {remark}" for name, remark in sorted(filled.remarks.items())]
    lines += [f"{name}: running; added to the database when the campaign has ended" for name in filled.running]
    lines += [outbox.line for outbox in state.outboxes]
    show(map(Paragraph, lines), console())


def _rows(
    folder: Path, url: str | None, selected: ResultFilter, csv_file: Path | None, *, rebuild: bool, as_json: bool
) -> int:
    """Show or write the selected values."""
    with _opened(folder, url, rebuild=rebuild) as (database, notes):
        from rig.results.reader import result_rows  # loads SQLAlchemy: not needed for the help

        rows = result_rows(database, selected)
        if csv_file is not None:
            count = _write_csv(rows, csv_file)
        elif as_json:
            write_json({"results": [_plain(row) for row in rows]})
        else:
            last: deque[ResultRow] = deque(maxlen=MOST_SHOWN)
            count = 0
            for count, row in enumerate(rows, start=1):  # noqa: B007 - the number of all rows
                last.append(row)
            _show_rows(last, count)
    for note in notes:
        say(f"warning: {note}", err=True)
    if csv_file is not None:
        if as_json:
            write_json({"file": str(csv_file.resolve()), "rows": count})
        else:
            say(f"Values written to {shown_path(csv_file)}: {count}")
    return EXIT_DONE


@contextmanager
def _opened(folder: Path, url: str | None, *, rebuild: bool) -> Iterator[tuple[Any, list[str]]]:
    # loads SQLAlchemy: not needed for the help
    from rig.results.filling import filled_database
    from rig.results.reader import open_results

    with ExitStack() as opened:
        with progress_bar("reading runs") as report_progress:  # gone before the values are shown
            database, filled = opened.enter_context(
                filled_database(folder, rebuild=rebuild, report_progress=report_progress) if url is None
                else open_results(folder, url)
            )
        yield database, filled.notes


def _plain(row: ResultRow) -> dict[str, Any]:
    return {
        name: value.isoformat() if isinstance(value, datetime) else value for name, value in row._asdict().items()
    }


def _write_csv(rows: Iterable[ResultRow], file: Path) -> int:
    """Write the rows with a head of names; returns their number.

    Raises:
        FileProblem: the file cannot be written.
    """
    from rig.results.reader import ResultRow  # loads SQLAlchemy: not needed for the help

    count = 0
    try:
        with file.open("w", newline="", encoding="utf-8") as opened:
            writer = csv.DictWriter(opened, ResultRow._fields)
            writer.writeheader()
            for count, row in enumerate(rows, start=1):  # noqa: B007 - the number of all rows
                writer.writerow(_plain(row))
    except OSError as error:
        raise FileProblem(str(file), [f"cannot be written: {error.strerror}"]) from error
    return count


def _show_rows(rows: Iterable[ResultRow], count: int) -> None:
    shown = console()
    rows = list(rows)
    if not rows:
        shown.print("no matching results", markup=False)
        return
    if not shown.is_terminal:  # one line for each value, however long, for a file or another program
        shown.width = UNFOLDED
    wide = shown.width >= WIDE
    head = [
        Column("specimen"), Column("started"), *((Column("station"),) if wide else ()), Column("quantity"),
        Column("motion"), Column("current", "A", True), Column("value", "", True), Column("std", "", True),
        Column("unit"), *((Column("point verdict"), Column("specimen verdict")) if wide else ()),
    ]  # fmt: skip
    cells = []
    for row in rows:
        started = "" if row.started is None else f"{row.started:%Y-%m-%d %H:%M}" if wide else f"{row.started:%Y-%m-%d}"
        cells.append([
            row.specimen, started, *((row.station,) if wide else ()), row.quantity, row.motion,
            "-" if row.current_A is None else f"{row.current_A:.4g}", f"{row.value:.5g}",
            "-" if row.std is None else f"{row.std:.2g}", row.unit,
            *((row.verdict, row.specimen_verdict) if wide else ()),
        ])  # fmt: skip
    hidden = count > len(rows)
    notes = [f"The last {len(rows)} of {count} values are shown; use filters, --csv or --json."] if hidden else []
    show([table(head, cells), *map(Paragraph, notes)], shown)
    sys.stdout.flush()
