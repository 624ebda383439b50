"""Which runs lie in a folder, remembered in an SQLite file beside them: `.rig-runs.sqlite`.

The files alone say what is true. The index keeps a summary of each run with a stamp of all files it was made of; where
a stamp differs, a run is new or the index cannot be used, the summary is made again, and what is gone is forgotten. It
may be deleted at any time, and nothing is refused where it cannot be written.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import sqlite3
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import rig
from rig.clock import utc_now
from rig.errors import FileProblem

NAME = ".rig-runs.sqlite"
FORMAT = f"1, {rig.__version__}"
"""Of the summaries; another one's are not used."""
SETTLED_NS = 2_000_000_000
"""A file changed so lately may be changed again within the resolution of its time stamp: its summary is not kept."""
DATE = re.compile(r"\d{4}(-\d{2}(-\d{2})?)?")
VERDICTS = ("valid", "suspect", "invalid")

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
                f"{self.date!r}: write 2026, 2026-11, 2026-11-23 or two of them, 2026-11-01:2026-11-23 (UTC)"
            ])  # fmt: skip

    def holds(self, summary: Summary) -> bool:
        """Whether a run is wanted."""
        specimen, date = str(summary["specimen"]), str(summary["started"])
        first, colon, last = (self.date or "").partition(":")
        last = last if colon else first
        return (
            (self.specimen is None or specimen == self.specimen or fnmatchcase(specimen, self.specimen))
            and (not first or date >= first)
            and (not last or (date != "" and date[: len(last)] <= last))
            and self.verdict in {None, summary["verdict"]}
            and self.model in {None, summary["model"]}
        )


def listed(folder: Path, summarise: Callable[[Path], Summary], wanted: RunFilter) -> list[Summary]:
    """Summaries of the runs in a folder, by name.

    Args:
        folder: where they lie.
        summarise: makes a run's summary from its files alone; with `specimen`, `started` (ISO 8601, UTC), `verdict` and
            `model`, each empty where unknown. It must be what JSON can hold.
        wanted: which of them.

    Raises:
        FileProblem: there is no such folder, or it cannot be read.
    """
    try:
        present = dict(sorted(_stamps(folder)))
    except OSError as error:
        raise FileProblem(str(folder), [f"cannot be read: {error.strerror}"]) from error
    known = _kept(folder / NAME)
    runs, changed, now_ns = {}, {}, utc_now().timestamp() * 1e9
    for name, (stamp, newest_ns) in present.items():
        kept = known.get(name)
        if kept is not None and kept[0] == stamp:
            runs[name] = kept[1]
            continue
        runs[name] = summarise(folder / name)
        if newest_ns + SETTLED_NS < now_ns and name.isprintable():
            changed[name] = (stamp, runs[name])
    gone = known.keys() - present.keys()
    stale = {name for name in present if name in known and runs[name] is not known[name][1]} - changed.keys()
    if changed or gone or stale:
        _keep(folder / NAME, changed, gone | stale)
    return [summary for summary in runs.values() if wanted.holds(summary)]


def _stamps(folder: Path) -> Iterator[tuple[str, tuple[str, int]]]:
    """Name, stamp and time of the last change (ns) of every run.

    The stamp is made of inode, time of change and size of each of its files: one that is replaced, renamed, written
    to or copied has another.
    """
    with os.scandir(folder) as entries:
        names = [entry.name for entry in entries if not entry.is_file(follow_symlinks=False)]
    for name in names:
        place = os.path.join(folder, name)
        total, newest = 0, 0
        try:
            with os.scandir(os.path.join(place, "points")) as points:
                states = [entry.stat() for entry in points]
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError:
            yield name, ("", 1 << 63)  # looked at every time
            continue
        for file in ("campaign.json", "fit.json"):
            with contextlib.suppress(OSError):
                states.append(os.stat(os.path.join(place, file)))
        for state in states:
            total += hash((state.st_ino, state.st_ctime_ns, state.st_size))
            newest = max(newest, state.st_ctime_ns)
        yield name, (f"{len(states)}:{total:x}", newest)


def _kept(file: Path) -> dict[str, tuple[str, Summary]]:
    """What the index holds, name -> stamp and summary; nothing where it cannot be used."""
    if not file.is_file():
        return {}
    try:
        with contextlib.closing(sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro", uri=True, timeout=0.5)) as index:
            (written,) = index.execute("SELECT written FROM format").fetchone()
            if written != FORMAT:
                return {}
            rows = index.execute("SELECT name, stamp, summary FROM runs").fetchall()
            return {str(name): (str(stamp), json.loads(summary)) for name, stamp, summary in rows}
    except (sqlite3.Error, TypeError, ValueError):
        return {}  # made again


def _keep(file: Path, changed: dict[str, tuple[str, Summary]], gone: set[str]) -> None:
    """Write to the index; where that cannot be, the next call looks at the files again."""
    with contextlib.suppress(sqlite3.Error, OSError):
        try:
            _write(file, changed, gone)
        except sqlite3.DatabaseError as error:
            if isinstance(error, sqlite3.OperationalError):
                return  # locked, full or read-only
            file.unlink()  # no index any more
            _write(file, changed, gone)


def _write(file: Path, changed: dict[str, tuple[str, Summary]], gone: set[str]) -> None:
    with contextlib.closing(sqlite3.connect(file, timeout=0.5)) as index, index:
        index.execute("BEGIN IMMEDIATE")
        index.execute("CREATE TABLE IF NOT EXISTS format (written TEXT)")
        if index.execute("SELECT written FROM format").fetchall() != [(FORMAT,)]:
            index.execute("DELETE FROM format")
            index.execute("DROP TABLE IF EXISTS runs")
            index.execute("INSERT INTO format VALUES (?)", (FORMAT,))
        index.execute(
            "CREATE TABLE IF NOT EXISTS runs (name TEXT PRIMARY KEY, stamp TEXT, specimen TEXT, started TEXT, verdict "
            "TEXT, model TEXT, summary TEXT)"
        )
        index.executemany("DELETE FROM runs WHERE name = ?", [(name,) for name in gone])
        index.executemany("INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?, ?, ?, ?)", [
            (name, stamp, *(summary[key] for key in ("specimen", "started", "verdict", "model")), json.dumps(summary))
            for name, (stamp, summary) in changed.items()
        ])  # fmt: skip
