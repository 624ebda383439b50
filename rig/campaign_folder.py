"""A campaign's folder: the only module that knows the names of its files (`docs/files.md`, "A campaign's directory").

Names inside `points/` are those of `rig.recording.point_files`, names in the live folder those of
`rig.station.live_folder`.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import overload

from protocols.near_miss import near_names
from rig.errors import FileProblem, some

LOGS = Path("logs")
"""Folder in which runs are created by default, and in which short names of runs are searched."""
IDENTIFIER = r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}"
"""Ids of points and serial numbers of specimens, which become parts of file names (also in the form of the bench's
page)."""
IDENTIFIER_TEXT = "a letter or digit, followed by letters, digits, - or _ (at most 32 characters)"
LAST = re.compile(r"last(?:-([1-9]\d{0,5}))?|-([1-9]\d{0,5})", re.IGNORECASE)
STARTED = re.compile(r"\d{8}T\d{6}Z")
"""At the beginning of a run's name (UTC)."""
MOST_LISTED = 10
"""Matching runs that a message lists."""
MOST_COMPARED = 500
"""Newest runs among which similar names are searched: 0.1 s."""
SIMILAR = 3
"""Similar names that a message suggests."""


class _Inside:
    """A file or folder of the campaign's folder: its path in an instance, its name in the class."""

    def __init__(self, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, folder: None, kind: type[CampaignFolder]) -> str: ...

    @overload
    def __get__(self, folder: CampaignFolder, kind: type[CampaignFolder]) -> Path: ...

    def __get__(self, folder: CampaignFolder | None, kind: type[CampaignFolder]) -> str | Path:
        return self._name if folder is None else folder.path / self._name


@dataclass(frozen=True)
class CampaignFolder:
    """The folder at `path`: `CampaignFolder(path).fit` is the path of its fit, `CampaignFolder.fit` the file's name."""

    path: Path

    description = _Inside("campaign.json")
    bench = _Inside("bench.toml")
    matrix = _Inside("matrix.toml")
    records = _Inside("records")
    """Folder of the files that the matrix names."""
    details = _Inside("details.toml")
    """Of an imported run: `[report]` and `[display]`, which a recorded run has in its matrix file."""
    journal = _Inside("journal.jsonl")
    reserve = _Inside("journal.reserve")
    """Room for the journal's last lines on a full disk."""
    baseline = _Inside("baseline.json")
    points = _Inside("points")
    """Folder of the points' files."""

    cache = _Inside("cache")
    """Folder of results cached for each point (`rig.recording.point_cache`); may be deleted."""
    drives = _Inside("drives")
    """Folder of the iterated commands of signals (`rig.recording.drive_file`)."""
    fit = _Inside("fit.json")
    characteristics = _Inside("characteristics.json")
    acceptance = _Inside("acceptance.json")
    """Verdict on the specimen, if the matrix has acceptance bands."""
    report = _Inside("report.html")
    report_pdf = _Inside("report.pdf")
    endurance = _Inside("endurance.json")
    """Count and wear of the endurance tests; made from the points' files at any time."""
    hybrid = _Inside("hybrid.json")
    reanalysed = _Inside("reanalysed")
    """Folder of the results that later versions made of this run (`rig.reanalysis`); each of them is a run."""
    reanalysis = _Inside("reanalysis.json")
    """Of such a result: what it was made of, and what has changed."""
    reanalysis_page = _Inside("reanalysis.html")
    reference = _Inside("reference")
    """Folder of the hybrid tests' courses."""

    live_link = _Inside("live.json")
    operator = _Inside("operator.json")
    """What was entered on the operator's page."""
    station_config = _Inside("station.json")
    station_log = _Inside("station.log")
    finaliser_log = _Inside("finaliser.log")
    simulator_log = _Inside("simulator.log")
    truth = _Inside("truth.h5")

    @classmethod
    def found(cls, path: Path) -> CampaignFolder:
        """The folder at a path or with a short name (`run_path`), or the only campaign that lies directly in it.

        Raises:
            FileProblem: several campaigns lie in the folder, or the name matches no or several runs; the message names
                them.
        """
        path = run_path(path)
        here = cls(path)
        if not path.is_dir() or here.points.is_dir():
            return here
        inside = [folder for folder in map(cls, sorted(path.iterdir())) if folder.points.is_dir()]
        if len(inside) > 1:
            names = some([folder.path.name for folder in inside])
            text = f"{len(inside)} campaigns found in this folder ({names}). Fix: specify one of them"
            raise FileProblem(str(path), [text])
        return inside[0] if inside else here

    def record(self, name: str) -> Path:
        """The run's own copy of a file that its matrix names: another user's run refers to no file of this computer.

        Raises:
            FileProblem: it is a symbolic link.
        """
        file = self.records / name.replace("\\", "/").rpartition("/")[2]
        if self.records.is_symlink() or file.is_symlink():
            raise FileProblem(str(file), ["is a symbolic link; this file must be in the run's folder"])
        return file

    @property
    def evaluated(self) -> list[Path]:
        """Existing files that evaluations read: the points, their descriptions and the fit."""
        beside = (self.description, self.bench, self.matrix, self.fit)
        return [*sorted(self.points.glob("*.h5")), *(file for file in beside if file.is_file())]

    @property
    def written_points(self) -> Path:
        """`points`, into which files are to be written.

        Raises:
            FileProblem: there is none, or it is a symbolic link: what is written there would lie elsewhere.
        """
        if self.points.is_symlink():
            raise FileProblem(str(self.points), ["is a symbolic link; files are written only into a real folder"])
        if not self.points.is_dir():
            raise FileProblem(str(self.path), ["this is not a campaign folder: it does not contain a points/ folder"])
        return self.points

    def session_bench(self, session: int) -> Path:
        """The bench file of a further session; the first one is session 1."""
        return self.bench.with_stem(f"{self.bench.stem}-session{session}")

    def session_truth(self, session: int) -> Path:
        """The truth file of an earlier session."""
        return self.truth.with_stem(f"{self.truth.stem}-session{session}")


def run_path(given: Path | str, *, with_empty: bool = False) -> Path:
    """The path of a run, or of a file in a run, that a user specified.

    A path that exists is returned unchanged. Otherwise its last component is a short name of a run in its folder
    (without a folder: in `LOGS`): `last` or `-1` for the newest run, `last-2` or `-2` for the one before, or a part of
    the name, in upper or lower case. Runs without recorded points, as of a campaign that was refused, are ignored
    unless no other run matches or `with_empty` is true. `last/fit.json` is a file in a run. A path in a folder without
    runs is returned unchanged.

    Raises:
        FileProblem: no run or several runs match; the message lists the similar or matching names.
    """
    path, below = Path(given), list[str]()
    while path.name and not os.path.lexists(path):
        below.append(path.name)
        path = path.parent
    place = path
    while below:
        path /= below.pop()
        place = _inside(None if path.parent == Path() else place, path, with_empty=with_empty and not below)
    return place


def _inside(folder: Path | None, path: Path, *, with_empty: bool) -> Path:
    """The run, or the file in a run, that the last component of a path specifies.

    Args:
        folder: what the path without this component specifies; None: the path has no other component.
        path: as the user specified it.
        with_empty: whether runs without recorded points count.

    Raises:
        FileProblem: as `run_path`.
    """
    if folder is not None and os.path.isdir(CampaignFolder(folder).points):  # False for a path that is too long
        return folder / path.name
    folder = folder or LOGS
    names = by_age(folder)
    if count := LAST.fullmatch(path.name):
        back = int(count[1] or count[2] or 1)
        recorded = (name for name in reversed(names) if with_empty or not is_empty(folder / name))
        newest = list(islice(recorded, back)) or names[::-1]
        return folder / _counted(back, path.name, newest, folder)
    if not names:
        return path
    part = path.name.casefold()
    matches = [name for name in names if part in name.casefold()]
    matches = [name for name in matches if with_empty or not is_empty(folder / name)] or matches
    if len(matches) > 1:
        raise FileProblem(str(folder), [_ambiguous(path.name, matches)])
    if not matches:
        raise FileProblem(str(folder), [_unknown(path.name, names)])
    return folder / matches[0]


def by_age(folder: Path) -> list[str]:
    """Names of the runs in a folder, the oldest first: by the time in a run's name, else by its last change."""
    try:
        runs = [entry for entry in os.scandir(folder) if os.path.isdir(os.path.join(entry, CampaignFolder.points))]
        aged = [(_started(entry), entry.name) for entry in runs]
    except OSError:
        return []
    return [name for _, name in sorted(aged)]


def is_empty(run: Path) -> bool:
    """Whether a run has no files of points, recorded or in progress, and no process holds it."""
    try:
        with os.scandir(run / CampaignFolder.points) as files:
            return next(files, None) is None and os.stat(run).st_ino not in held_inodes()
    except OSError:
        return False


def ignored(run: Path) -> int:
    """Number of newer runs without recorded points in the folder of a run."""
    names = by_age(run.parent)
    newer = names[names.index(run.name) + 1 :] if run.name in names else []
    return sum(is_empty(run.parent / name) for name in newer)


def _started(entry: os.DirEntry[str]) -> str:
    stamp = STARTED.match(entry.name)
    return stamp[0] if stamp else f"{datetime.fromtimestamp(entry.stat().st_mtime, UTC):%Y%m%dT%H%M%SZ}"


def _counted(back: int, given: str, newest: list[str], folder: Path) -> str:
    """The run at this place from the newest (1); `newest` has all runs of the folder if it has fewer than `back`.

    Raises:
        FileProblem: there are not so many runs, or it is `last-1`, which can mean the newest run or the one before.
    """
    if given.casefold() == "last-1":
        text = f"{given} is ambiguous. Fix: use last for the newest run, -2 for the one before"
        raise FileProblem(str(folder), [text])
    if back > len(newest):
        number = f"only {len(newest)} run{'s' * (len(newest) > 1)} with recorded points" if newest else "no runs"
        raise FileProblem(str(folder), [f"{given}: this folder contains {number}. Fix: specify the path of a run"])
    return newest[back - 1]


def _ambiguous(given: str, matches: list[str]) -> str:
    listed = "".join(f"\n  {name}" for name in reversed(matches[-MOST_LISTED:]))
    more = f"\n  and {len(matches) - MOST_LISTED} older runs" if len(matches) > MOST_LISTED else ""
    return f"{given!r} matches {len(matches)} runs:{listed}{more}\nFix: specify a longer part of the name"


def _unknown(given: str, names: list[str]) -> str:
    newest = names[-MOST_COMPARED:]
    whole_names = {piece.casefold(): name for name in newest for piece in _pieces(name)}
    similar = near_names(given.casefold(), whole_names, SIMILAR)
    candidates = list(dict.fromkeys(whole_names[piece] for piece in similar)) or newest[: -SIMILAR - 1 : -1]
    listed = "".join(f"\n  {name}" for name in candidates)
    return (
        f"{given!r} is neither a path nor part of a run's name. {'Similar' if similar else 'Newest'} runs:{listed}"
        "\nFix: specify part of a name; `rig runs` lists all runs"
    )


def _pieces(name: str) -> list[str]:
    """Every sequence of complete words of a run's name."""
    words = name.split("-")[:8]
    return [name, *("-".join(words[i:j]) for i in range(len(words)) for j in range(i + 1, len(words) + 1))]


def check_folder_of_runs(folder: Path) -> None:
    """Refuse a folder of runs that does not exist.

    Raises:
        FileProblem: with where runs are written.
    """
    if not folder.is_dir():
        raise FileProblem(str(folder), ["no such folder. Runs are written to logs/ or to the folder given with --out"])


def inode(path: Path | str) -> int:
    """Inode of a file or folder, as in `held_inodes`; -1 if there is none."""
    try:
        return os.stat(path).st_ino
    except OSError:
        return -1


def held_inodes() -> frozenset[int]:
    """Inodes of the files and folders that a process on this computer holds: those of campaigns that are running.

    The kernel's list is read: a lock that was tried here, even for a moment, could refuse a campaign that starts then.
    """
    try:
        rows = [line.split() for line in Path("/proc/locks").read_text(encoding="ascii").splitlines()]
    except (OSError, ValueError):  # another system than Linux
        return frozenset()
    owned = (row[row.index("FLOCK") :] for row in rows if "FLOCK" in row and "->" not in row)
    return frozenset(int(row[4].rpartition(":")[2]) for row in owned if len(row) > 4 and row[2] == "WRITE")
