"""Index of the runs in a folder, stored in the folder's results database: `.rig-runs.sqlite`.

Only the files are authoritative. The index stores a summary of each run with a stamp of all files it was made from; if
a stamp differs, a run is new or the index cannot be used, the summary is made again, and removed runs are deleted from
it. It may be deleted at any time, and nothing is refused if it cannot be written. The files of points, which take most
of the time, are read only for runs that may match the filter by their other data.

This module uses sqlite3 directly: SQLAlchemy takes longer to import than a folder of 10,000 runs takes to list.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import sqlite3
import warnings
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import rig
from rig.campaign_folder import CampaignFolder
from rig.clock import utc_now
from rig.errors import DataWarning, FileProblem

NAME = ".rig-runs.sqlite"
SCHEMA = 2
"""Version of the tables of results in the file; a file with a higher one is neither used nor written."""
FORMAT = f"8, {rig.__version__}"
"""Of the summaries; another one's are not used."""
SETTLED_NS = 2_000_000_000
"""A file changed so lately may be changed again within the resolution of its time stamp: its summary is not kept."""
DATE = re.compile(r"\d{4}(-\d{2}(-\d{2})?)?")

Summary = dict[str, Any]


@dataclass(frozen=True)
class RunFilter:
    """Which runs are wanted; None: any.

    Attributes:
        specimen: serial number, or a pattern with `*` and `?`.
        date: of its start (UTC): a year, month or day, or two of them with a colon between: from the first to the
            end of the second; one may be left out.
        verdict: the worst of its points.
        model: of its fit.
    """

    specimen: str | None = None
    date: str | None = None
    verdict: str | None = None
    model: str | None = None

    def __post_init__(self) -> None:
        """Look at the date.

        Raises:
            FileProblem: it is not written so.
        """
        wrong = [part for part in (self.date or "").split(":") if part and not DATE.fullmatch(part)]
        if wrong or (self.date is not None and (self.date.count(":") > 1 or not self.date.strip(":"))):
            raise FileProblem("--date", [
                f"{self.date!r}: expected 2026, 2026-11, 2026-11-23 or a range such as 2026-11-01:2026-11-23 (UTC)"
            ])  # fmt: skip

    def may_hold(self, specimen: str, started: str, model: str) -> bool:
        """Whether a run is wanted by what does not stand in its points' files."""
        first, colon, last = (self.date or "").partition(":")
        last = last if colon else first
        return (
            (self.specimen is None or fits_pattern(specimen, self.specimen))
            and (not first or started >= first)
            and (not last or (started != "" and started[: len(last)] <= last))
            and self.model in {None, model}
        )

    def holds(self, summary: Summary) -> bool:
        """Whether a run is wanted."""
        texts = (str(summary[name]) for name in ("specimen", "started", "model"))
        return self.may_hold(*texts) and self.verdict in {None, summary["verdict"]}


def fits_pattern(text: str, pattern: str) -> bool:
    """Whether a text equals a pattern or matches it with `*` and `?`, in upper and lower case as written."""
    return text == pattern or fnmatchcase(text, pattern)


class NewerSchema(Exception):
    """The results database was written by a newer version of this software."""


@dataclass(frozen=True)
class Kept:
    """A row of the index: stamps of the run's own files and of its points', what filters need, the summary as JSON."""

    own: str
    points: str
    specimen: str
    started: str
    model: str
    summary: str


def listed(
    folder: Path, summarise: Callable[[Path], Summary], run_filter: RunFilter, last: int | None = None,
    report_progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> list[Summary]:
    """Summaries of the runs in a folder, by name.

    Args:
        folder: where they lie.
        summarise: makes a run's summary from its files alone; with `specimen`, `started` (ISO 8601, UTC), `model` (by
            `campaign.json` and `fit.json`) and `verdict` (by the points), each empty where unknown. It must be what
            JSON can hold.
        run_filter: which of them.
        last: how many at most, from the end; None: all.
        report_progress: called with the numbers of read runs and of all runs after each new summary.

    Raises:
        FileProblem: there is no such folder, or it cannot be read.
    """
    try:
        present = dict(sorted(own_stamps(folder)))
    except OSError as error:
        raise FileProblem(str(folder), [f"cannot be read: {error.strerror}"]) from error
    known, writable = _known(folder / NAME)
    root, now_ns = os.fspath(folder), utc_now().timestamp() * 1e9
    runs: list[Summary] = []
    changed: dict[str, Kept] = {}
    gone = known.keys() - present.keys()
    try:
        for place, name in enumerate(reversed(present), 1):
            kept, (own, own_ns) = known.get(name), present[name]
            same = kept is not None and kept.own == own
            if same and kept is not None and not run_filter.may_hold(kept.specimen, kept.started, kept.model):
                continue
            points, newest_ns = points_stamp(f"{root}/{name}/{CampaignFolder.points}")
            if same and kept is not None and kept.points == points:
                summary = json.loads(kept.summary)
            else:
                summary = summarise(folder / name)
                if max(newest_ns, own_ns) + SETTLED_NS < now_ns and name.isprintable():
                    changed[name] = _row(own, points, summary)
                elif kept is not None:
                    gone.add(name)
                report_progress(place, len(present))
            if run_filter.holds(summary):
                runs.append(summary)
            if len(runs) == last:
                break
    finally:  # Ctrl-C in a first listing of thousands of runs loses none of their summaries
        if writable and (changed or gone):
            _keep(folder / NAME, changed, gone)
    return runs[::-1]


def _known(file: Path) -> tuple[dict[str, Kept], bool]:
    """What the index holds, and whether it may be written; a file of a newer version or a damaged one is named."""
    try:
        return _kept(file), True
    except NewerSchema as newer:
        warnings.warn(f"{newer}. The runs are listed from their files", DataWarning, stacklevel=3)
        return {}, False
    except (sqlite3.DatabaseError, TypeError, ValueError) as error:
        text = f"{file}: damaged ({error}); the index of runs is rebuilt from the run directories"
        warnings.warn(text, DataWarning, stacklevel=3)
        return {}, True


def _row(own: str, points: str, summary: Summary) -> Kept:
    specimen, started, model = (str(summary[key]) for key in ("specimen", "started", "model"))
    return Kept(own, points, specimen, started, model, json.dumps(summary))


def own_stamps(folder: Path) -> Iterator[tuple[str, tuple[str, int]]]:
    """Name of every run; stamp of its folder of points and its files beside it, and their last change (ns)."""
    root = os.fspath(folder)
    with os.scandir(folder) as entries:
        names = [entry.name for entry in entries if not entry.is_file(follow_symlinks=False)]
    for name in names:
        place = f"{root}/{name}/"
        try:
            state = os.stat(f"{place}{CampaignFolder.points}/")
        except OSError:
            continue
        stamp, newest_ns = f"{state.st_ino} {state.st_ctime_ns}", state.st_ctime_ns
        for file in (CampaignFolder.description, CampaignFolder.fit, CampaignFolder.acceptance):
            try:
                state = os.stat(place + file)
            except OSError:
                stamp += " -"
            else:
                stamp += f" {state.st_ino} {state.st_ctime_ns} {state.st_size}"
                newest_ns = max(newest_ns, state.st_ctime_ns)
        yield name, (stamp, newest_ns)


def points_stamp(points: str) -> tuple[str, int]:
    """Stamp of all files of points, and when the last one was changed (ns).

    It is made of inode, time of change and size of each: one that is replaced, renamed, written to or copied has
    another.
    """
    total, newest_ns = 0, 0
    try:
        with os.scandir(points) as entries:
            states = [entry.stat() for entry in entries]
    except OSError:
        return "", 1 << 63  # looked at every time
    for state in states:
        total += hash((state.st_ino, state.st_ctime_ns, state.st_size))
        newest_ns = max(newest_ns, state.st_ctime_ns)
    return f"{len(states)} {total:x}", newest_ns


def _kept(file: Path) -> dict[str, Kept]:
    """What the index holds; nothing if it cannot be opened now or is of another version.

    Raises:
        NewerSchema: a newer version of this software wrote the file.
        sqlite3.DatabaseError: the file is damaged or not a database; also TypeError and ValueError.
    """
    if not file.is_file():
        return {}
    try:
        with contextlib.closing(sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro", uri=True, timeout=0.5)) as index:
            check_schema(index, file)
            if _one(index, "format", "written") != FORMAT:
                return {}
            rows = index.execute("SELECT name, own, points, specimen, started, model, summary FROM runs").fetchall()
    except sqlite3.OperationalError:  # locked, or tables of another version
        return {}
    return {name: Kept(*row) for name, *row in rows}


def check_schema(index: sqlite3.Connection, file: Path) -> None:
    """Refuse a results database of a newer version.

    Raises:
        NewerSchema: with the message.
        sqlite3.DatabaseError: the file is damaged or not a database.
    """
    version = _one(index, "schema_version", "version")
    if isinstance(version, int) and version > SCHEMA:
        raise NewerSchema(newer_schema(str(file), version))


def newer_schema(place: str, version: int) -> str:
    """The message for a results database of a newer version, without a full stop."""
    return (
        f"{place}: got schema version {version}, expected at most {SCHEMA}: a newer version of this software wrote the "
        "database, which is neither read nor written. Fix: update mr-damper-rig"
    )


def _one(index: sqlite3.Connection, table: str, column: str) -> object:
    """The only value in a table; None if there is none or no such table.

    Raises:
        OperationalError: the file is locked or cannot be opened.
    """
    try:
        row = index.execute(f"SELECT {column} FROM {table}").fetchone()
    except sqlite3.OperationalError as error:
        code = getattr(error, "sqlite_errorcode", None)  # a text that is not UTF-8 has none
        if code == sqlite3.SQLITE_ERROR:  # no such table or column; a locked file has another code
            return None
        raise
    return None if row is None else row[0]


def _keep(file: Path, changed: dict[str, Kept], gone: set[str]) -> None:
    """Write to the index; where that cannot be, the next call looks at the files again."""
    with contextlib.suppress(sqlite3.Error, OSError, NewerSchema):
        try:
            _write(file, changed, gone)
        except sqlite3.DatabaseError as error:
            if isinstance(error, sqlite3.OperationalError):
                return  # locked, full or read-only
            file.unlink()  # no index any more
            _write(file, changed, gone)


def _write(file: Path, changed: dict[str, Kept], gone: set[str]) -> None:
    with contextlib.closing(sqlite3.connect(file, timeout=0.5)) as index, index:
        index.execute("BEGIN IMMEDIATE")
        check_schema(index, file)
        index.execute("CREATE TABLE IF NOT EXISTS format (written TEXT)")
        if index.execute("SELECT written FROM format").fetchall() != [(FORMAT,)]:
            index.execute("DELETE FROM format")
            index.execute("DROP TABLE IF EXISTS runs")
            index.execute("INSERT INTO format VALUES (?)", (FORMAT,))
        index.execute(
            "CREATE TABLE IF NOT EXISTS runs (name TEXT PRIMARY KEY, own TEXT, points TEXT, specimen TEXT, started "
            "TEXT, model TEXT, summary TEXT)"
        )
        index.executemany("DELETE FROM runs WHERE name = ?", [(name,) for name in gone])
        index.executemany(
            "INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?, ?, ?, ?)",
            [(name, *astuple(kept)) for name, kept in changed.items()],
        )
