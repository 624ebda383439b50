"""After a crash: what journals and half-written files are left in a campaign becomes finished points."""

from __future__ import annotations

from pathlib import Path

from rig.errors import FileProblem
from rig.recording.conversion import FinishedPoint, finish_point


def recover(folder: Path) -> list[FinishedPoint]:
    """Finish every journal of a campaign and clear half-written files away; finished points are not touched.

    Recovered points are marked so, and one whose journal was cut off is invalid with reason INTERRUPTED. A journal of
    which nothing can be read stays where it is, and its answer says why.

    Args:
        folder: the campaign's directory; nobody may be recording in it.

    Returns:
        One answer a journal, in the order of names; empty when there was nothing to recover.

    Raises:
        FileProblem: the directory is not a campaign's.
    """
    points = folder / "points"
    if not points.is_dir():
        raise FileProblem(str(folder), ["not a campaign's directory: it has no points/"])
    for partial in points.glob("*.h5.tmp"):
        partial.unlink()
    return [finish_point(journal, recovered=True) for journal in sorted(points.glob("*.journal"))]
