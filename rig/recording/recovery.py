"""After a crash: what journals and half-written files are left in a campaign becomes finished points."""

from __future__ import annotations

from pathlib import Path

from rig.errors import FileProblem
from rig.recording.claim import campaign_held, journal_claimed
from rig.recording.conversion import FinishedPoint, finish_point
from rig.recording.run import RecordedPoint


def recover(folder: Path) -> list[FinishedPoint]:
    """Finish every journal of a campaign and clear half-written files away; finished points are not touched.

    Recovered points are marked so, and one whose journal was cut off is invalid with reason INTERRUPTED. A journal of
    which nothing can be read stays where it is, and its answer says why. A finaliser that is still at work, because its
    application was killed, is waited for.

    Args:
        folder: the campaign's directory.

    Returns:
        One answer a journal, in the order of names; empty when there was nothing to recover.

    Raises:
        FileProblem: the directory is not a campaign's.
        Refused: the campaign still runs (slug `two-instances`).
    """
    if not (folder / "points").is_dir():
        raise FileProblem(str(folder), ["not a campaign's directory: it has no points/"])
    with campaign_held(folder):
        return recover_held(folder)


def recover_held(folder: Path) -> list[FinishedPoint]:
    """As `recover`, for a process that holds the campaign already (`claim.campaign_held`)."""
    points = folder / "points"
    finished = [finish_alone(journal, recovered=True) for journal in sorted(points.glob("*.journal"))]
    for partial in points.glob("*.h5.tmp"):
        partial.unlink(missing_ok=True)
    return finished


def finish_alone(journal: Path, *, recovered: bool = False) -> FinishedPoint:
    """`finish_point` by one process at a time; who comes second gets the first one's answer.

    Args:
        journal: the point's journal; nobody may be recording in it.
        recovered: as for `finish_point`.
    """
    try:
        with journal_claimed(journal) as handle:
            if handle is not None:
                return finish_point(journal, recovered=recovered)
        return _finished_before(journal)
    except (OSError, FileProblem) as error:
        return FinishedPoint(journal.stem, error=f"{type(error).__name__}: {error}")


def _finished_before(journal: Path) -> FinishedPoint:
    final = journal.with_suffix(".h5")
    point = RecordedPoint.open(final)
    return FinishedPoint(
        journal.stem, str(final.resolve()), point.verdict, point.reasons, point.lost_samples,
        point.quality.get("skew_s"), point.skew_std_s,
    )
