"""A campaign's points judged together: what all of them prove of the bench's instruments enters each file's verdict.

Only attributes of `/entry/quality` are written again, in one step: verdict, reasons, their kinds and who is to blame,
with when and why. What was recorded stays as it was.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rig.clock import utc_now
from rig.recording.calibration_check import campaign_verdicts
from rig.recording.durable import ReservedFile, write_whole
from rig.recording.finished_point import FinishedPoint
from rig.recording.hdf5_image import set_attributes
from rig.recording.run import RecordedPoint
from rig.recording.verdict import Verdict

if TYPE_CHECKING:
    import h5py

WHY = "the campaign's points together, against the controller's own inputs"


def judge_together(points_folder: Path) -> Iterator[FinishedPoint]:
    """Judge the instruments by all points of a campaign; gives each point whose verdict or reasons changed.

    Args:
        points_folder: the campaign's `points/`, in which nobody else is writing.

    Raises:
        FileProblem: a file cannot be trusted.
        OSError: the disk refuses; the files written before are complete, the others are as they were.
    """
    points = {
        point.id: point
        for point in (RecordedPoint.open(file, whole=False) for file in sorted(points_folder.glob("*.h5")))
    }
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
            set_attributes(opened["entry/quality"], {
                "judged_again": why, "judged_again_utc": utc_now().isoformat(timespec="seconds"),
            })

    write_whole(path, fill)


def say_verdict(quality: h5py.Group, verdict: Verdict) -> None:
    """Put a verdict into an open file's `/entry/quality`."""
    for name in verdict.attributes.keys() & quality.attrs.keys():
        del quality.attrs[name]  # no reason left is no attribute
    set_attributes(quality, verdict.attributes)


def finished(point: RecordedPoint) -> FinishedPoint:
    """What became of a point, from its file."""
    numbers = {key: float(value) for key, value in point.quality.items() if isinstance(value, (int, float))}
    return FinishedPoint(
        point.id, str(Path(str(point.path)).resolve()), point.verdict, point.reasons, point.lost_samples,
        point.quality.get("skew_s"), point.skew_std_s, quality=numbers,
    )
