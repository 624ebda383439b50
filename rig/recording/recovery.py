"""After a crash: what journals and half-written files are left in a campaign becomes finished points."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rig.errors import FileProblem
from rig.recording.claim import campaign_held, journal_claimed
from rig.recording.converter import Converter
from rig.recording.durable import flush_directory
from rig.recording.finished_point import FinishedPoint
from rig.recording.point_names import FILE, JOURNAL, PARTIAL, journal_name, partial_files, unfinished

Finish = Callable[[Path], FinishedPoint]


def recover(folder: Path) -> list[FinishedPoint]:
    """Finish every journal of a campaign and clear half-written files away; finished points are not touched.

    Recovered points are marked so, and one whose journal was cut off is invalid with reason INTERRUPTED. A journal that
    was set aside because it could not be read is tried again; its file takes the point's name where that is free, else
    the name of an earlier attempt. A journal of which nothing can be read stays where it is, and its answer says why.
    Each is converted in a process apart (`rig.recording.converter`): one at which that process dies does not keep the
    others. A finaliser that is still at work, because its application was killed, is waited for.

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
    with Converter() as converter:
        return recover_with(folder / "points", lambda journal: converter.finish(journal, recovered=True))


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
    from rig.recording.run import RecordedPoint

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
                return _told(name, final)
        partial.unlink(missing_ok=True)
    except OSError as error:
        return FinishedPoint(name, error=f"{partial.name}: {error}", error_slug="disk-error")
    return None


def finish_alone(journal: Path, *, recovered: bool = False) -> FinishedPoint:
    """`conversion.finish_point` by one process at a time; who comes second gets the first one's answer.

    Nothing is raised: whatever this journal does to the conversion is in the answer, so that the next one is looked at.

    Args:
        journal: the point's journal; nobody may be recording in it.
        recovered: as for `finish_point`.
    """
    from rig.recording.conversion import finish_point

    try:
        with journal_claimed(journal) as handle:
            if handle is not None:
                return finish_point(journal, recovered=recovered)
        return _told(journal_name(journal), journal.with_name(journal_name(journal) + FILE))
    except Exception as error:  # noqa: BLE001 - said by name; a journal may hold anything
        text = f"{journal.name}: {type(error).__name__}: {error}; the journal is kept"
        return FinishedPoint(journal_name(journal), error=text, error_slug=_slug(error))


def _slug(error: Exception) -> str:
    from rig.recording.durable import FULL

    if not isinstance(error, OSError):
        return "unreadable"
    return "disk-full" if error.errno in FULL else "disk-error"


def _told(name: str, final: Path) -> FinishedPoint:
    from rig.recording.run import RecordedPoint

    point = RecordedPoint.open(final)
    return FinishedPoint(
        name, str(final.resolve()), point.verdict, point.reasons, point.lost_samples,
        point.quality.get("skew_s"), point.skew_std_s,
    )
