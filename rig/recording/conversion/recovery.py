"""Recovery after a crash: journals and incomplete files of a campaign become finished points.

Before a point is repeated, its files from earlier sessions are set aside; files of other points are not changed.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection
from pathlib import Path

from drivers.posix import fcntl
from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem
from rig.recording.atomic_write import flush_directory
from rig.recording.conversion.converter import Converter
from rig.recording.journal.journal_file import read_header
from rig.recording.journal.journal_lock import campaign_held
from rig.recording.layout import PointContext
from rig.recording.point_files import (
    ATTEMPT,
    FILE,
    JOURNAL,
    PARTIAL,
    FinishedPoint,
    free_attempt_file,
    free_old_journal,
    partial_files,
    unfinished,
)
from rig.recording.recorded_point import RecordedPoint

Finish = Callable[[Path], FinishedPoint]


def recover(folder: Path) -> list[FinishedPoint]:
    """Finish every journal of a campaign and clear half-written files away; finished points are not touched.

    Recovered points are marked so, and one whose journal was cut off is invalid with reason INTERRUPTED. A journal that
    was set aside because it could not be read is tried again; its file takes the point's name where that is free, else
    the name of an earlier attempt. A journal of which nothing can be read stays where it is, and its answer says why.
    Each is converted in a process of its own (`converter`): one at which that process dies does not
    keep the others. A finaliser that is still at work, because its application was killed, is waited for.

    Args:
        folder: the campaign's directory.

    Returns:
        One answer a journal, in the order of names; empty when there was nothing to recover.

    Raises:
        FileProblem: the directory is not a campaign's.
        Refused: the campaign still runs (slug `two-instances`).
    """
    _ = CampaignFolder(folder).written_points
    with campaign_held(folder):
        return recover_held(folder)


def recover_held(folder: Path) -> list[FinishedPoint]:
    """As `recover`, for a process that holds the campaign already (`claim.campaign_held`)."""
    points = CampaignFolder(folder).written_points
    with Converter() as converter:
        return recover_with(points, lambda journal: converter.finish(journal, recovered=True))


def recover_with(points: Path, finish: Finish) -> list[FinishedPoint]:
    """As `recover`, for the folder of points itself.

    Args:
        points: the campaign's `points/`.
        finish: makes a file of one journal and says what became of it.
    """
    finished = [finish(journal) for journal in unfinished(points)]
    return finished + [answer for partial in partial_files(points) if (answer := _cleared(partial)) is not None]


def _cleared(partial: Path) -> FinishedPoint | None:
    """Take a half-written file away; one that is whole and the only one of its point takes its name instead."""
    name = partial.name.removesuffix(PARTIAL)
    final = partial.with_name(name + FILE)
    try:
        if not final.exists() and not final.with_name(name + JOURNAL).exists():
            try:
                RecordedPoint.open(partial)
            except FileProblem:
                pass  # what was written so far is no point
            else:
                partial.replace(final)
                flush_directory(final.parent)
                return FinishedPoint.of(name, final, RecordedPoint.open(final).quality)
        partial.unlink(missing_ok=True)
    except OSError as error:
        return FinishedPoint(name, error=f"{partial.name}: {error}", error_slug="disk-error")
    return None


def set_aside(points: Path, point_id: str, ids: Collection[str]) -> dict[Path, Path]:
    """Give the files of a point's earlier attempts names that no run lists, before it is run anew.

    Which point a file belongs to is what the file says, not what its name looks like; a damaged one belongs to the
    point of that name, if there is one. A journal that another process is converting is never moved.

    Args:
        points: the campaign's `points/`.
        point_id: the point in the matrix.
        ids: of all points of the campaign.

    Returns:
        The new paths of finished files, by their old ones.

    Raises:
        OSError: one cannot be renamed, or a journal of this point is in use (EWOULDBLOCK).
    """
    renamed: dict[Path, Path] = {}
    own = re.compile(rf"({re.escape(point_id)}([-.]{ATTEMPT}\d+)?)({re.escape(FILE)}|{re.escape(JOURNAL)})")
    # Journals first: where one of them is in use, no file has another name yet.
    for path in sorted(points.iterdir(), key=lambda path: (not path.name.endswith(JOURNAL), path.name)):
        named = own.fullmatch(path.name)
        if named is None:
            continue
        by_name = named[1] if named[1] in ids else point_id
        if path.name.endswith(JOURNAL):
            _set_journal_aside(path, point_id, by_name)
        elif (_files_point(path) or by_name) == point_id:
            renamed[path] = path.rename(free_attempt_file(points, point_id))
    return renamed


def _files_point(file: Path) -> str | None:
    """The point that a file holds an attempt of; None for one that cannot be read."""
    try:
        point = RecordedPoint.open(file, whole=False)
    except FileProblem:
        return None
    return str(point.provenance.get("point", point.id))


def _set_journal_aside(journal: Path, point_id: str, by_name: str) -> None:
    """Rename a journal of the point of which no file could be made.

    Raises:
        OSError: it cannot be renamed, or is in use.
    """
    handle = os.open(journal, os.O_RDONLY | os.O_CLOEXEC)
    try:
        if (_journals_point(journal) or by_name) == point_id:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            journal.rename(free_old_journal(journal))
    finally:
        os.close(handle)


def _journals_point(journal: Path) -> str | None:
    try:
        return PointContext.from_json(read_header(journal)).provenance.get("point")
    except ValueError:
        return None
