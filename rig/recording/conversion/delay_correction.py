"""Correction of a campaign's points to one sensor delay, and to one verdict, once all of them are recorded.

An undeclared delay is a constant of the rig, but each point's file is made when the point ends, from the data of that
point alone. At the end of the campaign all points combined determine it several times better
(`rig.recording.quality.campaign_delay`), and the instruments too (`rig.recording.quality.cross_checks`). A finished
file is replaced only if its loop is certainly wrong or its verdict changes: it is made again from the received data, by
the same function (`rebuilding.rebuild`), and `/entry/provenance` states this. If only the verdict changes, only its
attributes are rewritten.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rig.clock import utc_now
from rig.recording.atomic_write import ReservedFile, write_whole
from rig.recording.conversion.conversion import Correction
from rig.recording.conversion.rebuilding import can_be_rebuilt, rebuild
from rig.recording.hdf5.hdf5_objects import set_attributes
from rig.recording.layout import Attribute
from rig.recording.point_files import FinishedPoint
from rig.recording.quality.campaign_delay import BehindArrivals, PointSkew, behind_arrivals, pooled_skews
from rig.recording.quality.cross_checks import campaign_verdicts
from rig.recording.quality.instrument_checks import SLUGS
from rig.recording.quality.verdict import Reason, Verdict
from rig.recording.quality.verdict_rules import with_skew
from rig.recording.recorded_point import RecordedPoint
from rig.test_point import ENDURANCE

if TYPE_CHECKING:
    import h5py

CERTAIN = 2.0
"""Standard deviations, of the pooled skew or of what the file states, by which a file must be off; or so many times
what it states is what all points leave open, since they contradict each other ..."""
MATTERS_S = 1e-4
"""... and by how much, which is what a skew is to be known to."""
WHY = "all points of the campaign combined, compared with the controller's own inputs"


@dataclass(frozen=True)
class Change:
    """What is wrong with a finished point by what all points say: why it is made again, and with what."""

    why: str
    skew: PointSkew | BehindArrivals
    instruments: Sequence[Reason] | None


def retime(points_folder: Path) -> Iterator[FinishedPoint]:
    """Make those points of a campaign again that all of its points together know better; gives each as it is then.

    Args:
        points_folder: the campaign's `points/`, in which no other process is writing.

    Raises:
        FileProblem: a file cannot be trusted.
        OSError: the disk refuses; the files written before are complete, the others are as they were.
    """
    points = _whole_points(points_folder)
    usable = [point for point in points if point.verdict != "invalid"]
    skews, behind = pooled_skews(usable), behind_arrivals(usable)
    instruments = campaign_verdicts(points)
    for point in points:
        known = skews.get(point.id) or behind.get(point.id)
        change = None if known is None else _change(point, known, instruments.get(point.id))
        if change is not None and point.path is not None and can_be_rebuilt(point):
            yield make_again(point.path, change)
    yield from judge_together(points_folder)


def _whole_points(points_folder: Path) -> list[RecordedPoint]:
    """The points of a campaign, blocks of endurance tests apart: their files hold only some of their samples.

    Raises:
        FileProblem: a file cannot be trusted.
    """
    points = (RecordedPoint.open(file, whole=False) for file in sorted(points_folder.glob("*.h5")))
    return [point for point in points if point.kind != ENDURANCE]


def _change(point: RecordedPoint, skew: PointSkew | BehindArrivals, instruments: Verdict | None) -> Change | None:
    """Why a point's samples are made again; None where they may stay, though the verdict may not."""
    before = point.quality.verdict
    left_s = skew.std_s if isinstance(skew, BehindArrivals) else skew.trusted_std_s
    after = with_skew(before, left_s, point.highest_Hz)
    checked = before if instruments is None else instruments
    reasons = [reason for reason in checked.entries if reason.slug in SLUGS]
    stated_s = skew.std_s if point.quality.skew.std_s is None else point.quality.skew.std_s
    if isinstance(skew, BehindArrivals):
        if stated_s > max(CERTAIN * skew.std_s, MATTERS_S) or after != before:
            return Change(
                f"all points combined determine the delay between force and displacement to within "
                f"{1e3 * skew.std_s:.2g} ms; this point alone determines the delay to within {1e3 * stated_s:.2g} ms",
                skew, reasons,
            )
        return None
    off = abs(skew.shift_s) > max(CERTAIN * min(skew.std_s, stated_s), MATTERS_S)
    if off or skew.std_s > max(CERTAIN * stated_s, MATTERS_S):
        why = f"all points combined give a sensor delay of {1e3 * skew.delays.value_s:.3f} +- {1e3 * skew.std_s:.2g} ms"
        return Change(why, skew, reasons)
    if after != before:
        return Change(f"with all points combined, the verdict is {after.verdict}; for this "
            f"point alone, the verdict was {before.verdict}", skew, reasons)
    return None


def make_again(path: Path, change: Change) -> FinishedPoint:
    """Make a point's file from what it holds as received, with delays known from elsewhere; the old one is replaced.

    Args:
        path: the point's file.
        change: why, the delays to take off, and what is said of the instruments.

    Raises:
        FileProblem: the file does not hold what it was made from.
        OSError: the disk refuses; the file is as it was.
    """
    old = RecordedPoint.open(path)
    return rebuild(path, path, _correction(old, change), old=old)


def _correction(old: RecordedPoint, change: Change) -> Correction:
    """What a file is made again with, and what it says of that in `/entry/provenance`."""
    attributes: dict[str, Attribute] = {
        "rewritten": utc_now().isoformat(timespec="seconds"), "rewritten_why": change.why,
    }
    if isinstance(change.skew, BehindArrivals):
        return Correction(None, change.skew.lag, change.instruments, attributes)
    delays = change.skew.delays
    attributes |= {
        "rewritten_from_force_delay_s": old.quality.force.undeclared_delay_s,
        "rewritten_from_displacement_delay_s": old.quality.displacement.undeclared_delay_s,
        "rewritten_to_force_delay_s": delays.force.value_s,
        "rewritten_to_displacement_delay_s": delays.displacement.value_s,
    }
    return Correction(delays, None, change.instruments, attributes)


def judge_together(points_folder: Path) -> Iterator[FinishedPoint]:
    """Judge the instruments by all points of a campaign; gives each point whose verdict or reasons changed.

    Args:
        points_folder: the campaign's `points/`, in which no other process is writing.

    Raises:
        FileProblem: a file cannot be trusted.
        OSError: the disk refuses; the files written before are complete, the others are as they were.
    """
    points = {point.id: point for point in _whole_points(points_folder)}
    for name, verdict in campaign_verdicts(tuple(points.values())).items():
        path = points[name].path
        if path is None:
            continue
        write_verdict(path, verdict, WHY)
        yield finished(RecordedPoint.open(path, whole=False))


def write_verdict(path: Path, verdict: Verdict, why: str) -> None:
    """Replace a file's verdict and reasons; the file says when, and `why`.

    Raises:
        OSError: the disk refuses; the file is as it was.
    """
    import h5py

    data = path.read_bytes()

    def fill(file: ReservedFile) -> None:
        file.write(data)
        with h5py.File(file, "r+", libver=("v108", "v110")) as opened:
            say_verdict(opened["entry/quality"], verdict)
            set_attributes(opened["entry/quality"].id, {
                "judged_again": why, "judged_again_utc": utc_now().isoformat(timespec="seconds"),
            })

    write_whole(path, fill)


def say_verdict(quality: h5py.Group, verdict: Verdict) -> None:
    """Put a verdict into an open file's `/entry/quality`."""
    for name in verdict.attributes.keys() & quality.attrs.keys():
        del quality.attrs[name]  # no reason left is no attribute
    set_attributes(quality.id, verdict.attributes)


def finished(point: RecordedPoint) -> FinishedPoint:
    """What became of a point, from its file."""
    return FinishedPoint.of(point.id, Path(str(point.path)), point.quality)
