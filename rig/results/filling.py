"""Fill the results database of a folder from the run directories; only what has changed is read again."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Table, delete, insert, select, text
from sqlalchemy.dialects import postgresql, sqlite

from rig import __version__
from rig.campaign_folder import CampaignFolder, check_folder_of_runs, held_inodes, inode
from rig.clock import utc_now
from rig.errors import FileProblem, RigError, evaluating
from rig.results.connection import DamagedDatabase, Database, folder_database
from rig.results.content import Content, content_of
from rig.results.run_index import NAME, SETTLED_NS, own_stamps, points_stamp
from rig.results.schema import CHILDREN, campaigns, sources, specimens, stations

CONTENT = 5
"""Of the rows that a run gives; runs that were read with another one are read again."""
BATCH_S = 2.0
"""Results that were read for so long are written together."""
BESIDE = (
    CampaignFolder.bench, CampaignFolder.matrix, CampaignFolder.details, CampaignFolder.operator,
    CampaignFolder.endurance,
)
"""Further files from which rows are made, in addition to those of the index of runs."""

Progress = Callable[[int, int], None]


@dataclass
class Filled:
    """What an update of the database did.

    Attributes:
        runs: number of run directories.
        read: number of directories that were read, new or changed.
        removed: number of campaigns that were removed because their directory is gone.
        running: names of runs that a process on this computer is recording; they are read when they have ended.
        remarks: run -> reason why it, or a part of it, is not in the database.
        notes: messages on the file itself, such as that it was damaged.
        damaged: files that were damaged and have been made again.
    """

    runs: int = 0
    read: int = 0
    removed: int = 0
    running: list[str] = field(default_factory=list)
    remarks: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    damaged: list[Path] = field(default_factory=list)


@contextmanager
def filled_database(
    folder: Path, *, rebuild: bool = False, report_progress: Progress = lambda _done, _total: None
) -> Iterator[tuple[Database, Filled]]:
    """The database of a folder of runs, brought up to date.

    Args:
        folder: folder that contains the runs.
        rebuild: delete the file first and read every run again.
        report_progress: called with the numbers of processed and of all new or changed runs.

    Raises:
        FileProblem: there is no such folder, or the file is of a newer version or locked.
        DamagedDatabase: the file was damaged again after it had been made again.
    """
    check_folder_of_runs(folder)
    done = Filled()
    if rebuild:
        with folder_database(folder):  # refuses a file of a newer version
            pass
        (folder / NAME).unlink(missing_ok=True)
    while True:
        with folder_database(folder, done.notes.append) as database:
            try:
                fill(database, folder, done, report_progress)
            except DamagedDatabase as error:
                if (folder / NAME) in done.damaged:
                    raise
                done.damaged.append(folder / NAME)
                done.notes.append(f"{error}; it is rebuilt from the run directories")
                (folder / NAME).unlink(missing_ok=True)
                continue
            yield database, done
            return


def fill(database: Database, folder: Path, done: Filled, report_progress: Progress) -> None:
    """Bring the database up to date with the run directories of a folder."""
    present, held = _stamped(folder, held_inodes(), done), dict[str, tuple[str, Content | None, str]]()
    done.runs = len(present) + len(done.running)
    with database.transaction() as connection:
        gone = set(connection.execute(select(sources.c.run)).scalars()) - present.keys() - set(done.running)
        for name in sorted(gone):
            _forget(connection, name)
        done.removed = _remove_without_source(connection) if gone else 0
        known = {row.run: row for row in connection.execute(select(sources))}
    changed = [name for name, stamp in present.items() if name not in known or known[name].stamp != stamp]
    done.remarks = {
        name: row.remark for name, row in known.items() if row.remark and name in present and name not in changed
    }
    written_s = time.monotonic()
    try:
        for number, name in enumerate(changed, start=1):
            content, remark = _read(folder / name)
            held[name] = (present[name], content, remark)
            done.read += 1
            report_progress(number, len(changed))
            if time.monotonic() - written_s > BATCH_S:
                _write(database, folder, held, done)
                held, written_s = {}, time.monotonic()
    finally:  # Ctrl-C in a first reading of thousands of runs loses none of them
        _write(database, folder, held, done)


def _stamped(folder: Path, held: frozenset[int], done: Filled) -> dict[str, str]:
    """Stamp of every run that is not being recorded; empty if it may still change unnoticed."""
    now_ns, stamps = utc_now().timestamp() * 1e9, {}
    for name, (own, own_ns) in sorted(own_stamps(folder)):
        if not name.isprintable():
            continue
        place = folder / name
        if inode(place) in held:
            done.running.append(name)
            continue
        points, points_ns = points_stamp(os.fspath(place / CampaignFolder.points))
        newest_ns, parts = max(own_ns, points_ns), [str(CONTENT), own, points]
        for file in BESIDE:
            try:
                state = os.stat(place / file)
            except OSError:
                parts.append("-")
            else:
                parts.append(f"{state.st_ino} {state.st_ctime_ns} {state.st_size}")
                newest_ns = max(newest_ns, state.st_ctime_ns)
        stamps[name] = " ".join(parts) + ("" if newest_ns + SETTLED_NS < now_ns else f" {time.monotonic_ns()}")
    return stamps


def _read(place: Path) -> tuple[Content | None, str]:
    """The rows of a run, and what could not be read."""
    folder = CampaignFolder(place)
    try:
        if folder.journal.is_file() and not folder.description.is_file() and not any(folder.points.iterdir()):
            return None, ""  # of a campaign that was refused before anything was recorded
        with evaluating("the run"):
            content = content_of(place)
    except (RigError, OSError) as error:
        return None, f"not in the database: {error.problems[0] if isinstance(error, FileProblem) else error}"
    return content, content.remark


def _forget(connection: Connection, name: str) -> None:
    """Forget a directory; copies of its campaign are read again, so that one of them takes its place."""
    row = connection.execute(select(sources.c.campaign_id).where(sources.c.run == name)).first()
    connection.execute(delete(sources).where(sources.c.run == name))
    if row is not None and row.campaign_id:
        copies = sources.c.remark.contains(row.campaign_id, autoescape=True)
        connection.execute(sources.update().where(copies).values(stamp=""))


def _remove_without_source(connection: Connection) -> int:
    with_source = select(sources.c.campaign_id)
    removed = connection.execute(delete(campaigns).where(campaigns.c.campaign_id.not_in(with_source))).rowcount
    for table, column in ((stations, campaigns.c.station), (specimens, campaigns.c.specimen)):
        name = next(iter(table.primary_key.columns))
        used = select(column).where(column.is_not(None))
        connection.execute(delete(table).where(name.not_in(used)))
    return removed


def _write(
    database: Database, folder: Path, read: Mapping[str, tuple[str, Content | None, str]], done: Filled
) -> None:
    """Write what was read, in one transaction."""
    if not read:
        return
    with database.transaction() as connection:
        for name, (stamp, content, remark) in read.items():
            campaign_id = "" if content is None else content.campaign_id
            if content is not None and (other := _other_source(connection, folder, name, campaign_id)):
                campaign_id, remark = "", f"copy of {other} (campaign {campaign_id}); counted once"
            elif content is not None:
                put(connection, content.campaign, content.children, content.digest)
            row = {"run": name, "stamp": stamp, "campaign_id": campaign_id, "remark": remark}
            upsert(connection, sources, row)
            if remark:
                done.remarks[name] = remark
        _remove_without_source(connection)


def _other_source(connection: Connection, folder: Path, name: str, campaign_id: str) -> str:
    """Another present directory from which this campaign is already in the database; empty if there is none."""
    query = select(sources.c.run).where(sources.c.campaign_id == campaign_id, sources.c.run != name)
    return next((run for run in connection.execute(query).scalars() if (folder / run).is_dir()), "")


def put(
    connection: Connection, campaign: Mapping[str, Any], children: Mapping[str, Sequence[Mapping[str, Any]]],
    digest: str,
) -> bool:
    """Insert a campaign with its rows, or replace them if they have changed; in the caller's transaction.

    The row of the campaign is written before its other rows: of two writers of one campaign, the second one waits for
    the first, and then replaces its rows.

    Returns:
        Whether anything was written.
    """
    campaign_id = campaign["campaign_id"]
    for table, key in ((stations, "station"), (specimens, "specimen")):
        if campaign[key] is not None:
            upsert(connection, table, {key: campaign[key]})
    present = select(campaigns.c.digest).where(campaigns.c.campaign_id == campaign_id).with_for_update()
    if connection.execute(present).scalar() == digest:
        return False
    stamp = {"digest": digest, "filled_by": f"mr-damper-rig {__version__}", "filled": utc_now()}
    upsert(connection, campaigns, {**campaign, **stamp}, key="campaign_id")
    number = _number_of(connection, campaign_id)
    for table in CHILDREN:
        connection.execute(delete(table).where(table.c.campaign == number))
        if rows := children.get(table.name):
            connection.execute(insert(table), [{**row, "campaign": number} for row in rows])
    return True


def _number_of(connection: Connection, campaign_id: str) -> int:
    query = select(campaigns.c.campaign).where(campaigns.c.campaign_id == campaign_id)
    return int(connection.execute(query).scalar_one())


def upsert(connection: Connection, table: Table, row: Mapping[str, Any], key: str = "") -> None:
    """Insert a row, or update the one with the same key: the primary key, unless another one is named."""
    keys = [key] if key else [column.name for column in table.primary_key.columns]
    others = {name: value for name, value in row.items() if name not in keys}
    into = sqlite.insert(table) if connection.dialect.name == "sqlite" else postgresql.insert(table)
    statement = into.values(dict(row))
    if others:
        connection.execute(statement.on_conflict_do_update(index_elements=keys, set_=others))
    else:
        connection.execute(statement.on_conflict_do_nothing(index_elements=keys))


def rows_of(connection: Connection, campaign_id: str) -> tuple[dict[str, Any], dict[str, list[dict[str, Any]]], str]:
    """The row of a campaign, those of its other tables, and its digest, as `put` takes them."""
    row = dict(connection.execute(select(campaigns).where(campaigns.c.campaign_id == campaign_id)).mappings().one())
    number = row.pop("campaign")
    children = {
        table.name: [dict(one) for one in connection.execute(
            select(*(column for column in table.c if column.name != "campaign")).where(table.c.campaign == number)
        ).mappings()]
        for table in CHILDREN
    }  # fmt: skip
    digest = str(row.pop("digest"))
    return {name: value for name, value in row.items() if name not in {"filled_by", "filled"}}, children, digest


def optimise(database: Database) -> None:
    """Refresh the statistics with which the database chooses its indices."""
    with database.transaction() as connection:
        connection.execute(text("ANALYZE"))
