"""What earlier sessions left of a point makes room for it to be run again; nothing of any other point is touched."""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Collection
from pathlib import Path

from rig.errors import FileProblem
from rig.recording.context import PointContext
from rig.recording.journal import read_header
from rig.recording.point_names import ATTEMPT, FILE, JOURNAL, free_attempt_file, free_old_journal


def set_aside(points: Path, point_id: str, ids: Collection[str]) -> None:
    """Give the files of a point's earlier attempts names that no run lists, before it is run anew.

    Which point a file belongs to is what the file says, not what its name looks like; a damaged one belongs to the
    point of that name, if there is one. A journal that somebody makes a file of at this moment is never moved.

    Args:
        points: the campaign's `points/`.
        point_id: the point in the matrix.
        ids: of all points of the campaign.

    Raises:
        OSError: one cannot be renamed, or a journal of this point is in use (EWOULDBLOCK).
    """
    own = re.compile(rf"({re.escape(point_id)}([-.]{ATTEMPT}\d+)?)({re.escape(FILE)}|{re.escape(JOURNAL)})")
    for path in sorted(points.iterdir()):
        found = own.fullmatch(path.name)
        if found is None:
            continue
        by_name = found[1] if found[1] in ids else point_id
        if path.name.endswith(JOURNAL):
            _set_journal_aside(path, point_id, by_name)
        elif (_files_point(path) or by_name) == point_id:
            path.rename(free_attempt_file(points, point_id))


def _files_point(file: Path) -> str | None:
    """The point that a file holds an attempt of; None for one that cannot be read."""
    from rig.recording.run import RecordedPoint

    try:
        found = RecordedPoint.open(file, whole=False)
    except FileProblem:
        return None
    return str(found.provenance.get("point", found.id))


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
