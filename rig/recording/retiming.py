"""A campaign's points brought to one skew once all of them are recorded.

A delay that nobody declared is one constant of the rig, but each point's file is made when the point ends, by what that
point alone could see. At the end of the campaign all of them together know it several times better
(`rig.recording.skew_pooling`). A finished file is not touched lightly: only one whose loop is certainly wrong, or whose
verdict changes because its skew is known now, is written again, in one step: force laid over displacement anew, the
statements on skew and the verdict's reason about it replaced. What was received stays as it was.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from protocols.quality import Quality
from rig.recording.alignment import BAD_VALUE
from rig.recording.clock_model import ARRIVAL
from rig.recording.conversion import ReadBackDiffers
from rig.recording.durable import replace_durably
from rig.recording.finished_point import FinishedPoint
from rig.recording.hdf5_image import set_attributes
from rig.recording.interpolation import cubic_at, status_at
from rig.recording.layout import FloatArray, check_of, parts
from rig.recording.run import RecordedPoint
from rig.recording.skew_pooling import Skew, pooled_skews
from rig.recording.verdict import Verdict, with_skew

if TYPE_CHECKING:
    import h5py

CERTAIN = 2.0
"""Standard deviations of the pooled skew by which a file must be off ..."""
MATTERS_S = 1e-4
"""... and by how much, which is what a skew is to be known to."""
STATUS = {"current": "coil_current", "coil_temperature": "coil_temperature"}


def retime(points_folder: Path) -> Iterator[FinishedPoint]:
    """Write those points of a campaign again whose skew the campaign as a whole knows better; gives each as it is then.

    Args:
        points_folder: the campaign's `points/`, in which nobody else is writing.

    Raises:
        FileProblem: a file cannot be trusted.
        OSError: the disk refuses; the files written before are complete, the others are as they were.
    """
    points = [RecordedPoint.open(file, whole=False) for file in sorted(points_folder.glob("*.h5"))]
    skews = pooled_skews([point for point in points if point.verdict != "invalid"])
    for point in points:
        skew = skews.get(point.id)
        if skew is None or point.path is None:
            continue
        if _certainly_wrong(skew) or _judged(point, skew).verdict != point.verdict:
            _write_again(point.path, RecordedPoint.open(point.path), skew)
            yield _finished(RecordedPoint.open(point.path))


def _certainly_wrong(skew: Skew) -> bool:
    return abs(skew.shift_s) > max(CERTAIN * skew.std_s, MATTERS_S)


def _judged(point: RecordedPoint, skew: Skew) -> Verdict:
    return with_skew(Verdict(point.verdict, tuple(point.reasons)), skew.std_s, point.frequency_Hz)


def _finished(point: RecordedPoint) -> FinishedPoint:
    numbers = {key: float(value) for key, value in point.quality.items() if isinstance(value, (int, float))}
    return FinishedPoint(
        point.id, str(Path(str(point.path)).resolve()), point.verdict, point.reasons, point.lost_samples,
        point.quality.get("skew_s"), point.skew_std_s, quality=numbers,
    )


def _write_again(path: Path, point: RecordedPoint, skew: Skew) -> None:
    import h5py

    partial = path.with_name(path.name + ".tmp")
    shutil.copyfile(path, partial)
    with h5py.File(partial, "r+") as file:
        _move(file["entry"], point, skew)
    with h5py.File(partial, "r") as file:
        for group in (file["entry/data"], *file["entry/raw"].values()):
            for dataset in group.values():
                if "crc32" in dataset.attrs and check_of(dataset[:]) != int(dataset.attrs["crc32"]):
                    raise ReadBackDiffers(f"{path}: {dataset.name} read back differs from what was written again")
    replace_durably(partial, path)


def _move(entry: h5py.Group, point: RecordedPoint, skew: Skew) -> None:
    """Move every channel's samples on the displacement's time base, and all that is said about it."""
    displacement_s = skew.displacement.value_s - float(point.quality["displacement_undeclared_delay_s"])
    raw, data = entry["raw"], entry["data"]
    shifted = {  # read before any is written: channels of one message may share their times
        name: channel["time"][:] + (skew.shift_s if name == "force" else displacement_s)
        for name, channel in raw.items() if name != "displacement" and "time" in channel
    }
    for name, times_s in shifted.items():
        _replace(raw[name]["time"], times_s)
    moved = {"force": "force"}
    if displacement_s != 0.0:
        moved |= {name: STATUS.get(name, name) for name in data if name in STATUS or name in raw}
        moved.pop("displacement")
    for name, source in moved.items():
        if source in raw:
            _replace(data[name], _brought(data, raw[source], name))
    lost = np.isnan(data["force"][:]) | np.isnan(data["displacement"][:])
    flags = data["flags"][:] & ~np.int8(Quality.NOT_A_NUMBER)
    _replace(data["flags"], flags | (lost * np.int8(Quality.NOT_A_NUMBER)))
    _say(entry, point, skew, displacement_s)


def _brought(data: h5py.Group, channel: h5py.Group, name: str) -> FloatArray:
    """A channel at the displacement's sample times (n,); NaN where nothing was measured."""
    bad = (channel["flags"][:].astype(np.int64) & int(BAD_VALUE)) != 0
    values, times_s = np.where(bad, np.nan, channel["value"][:]), channel["time"][:]
    wanted_s = data["time"]
    if name in STATUS:
        by_arrival = channel.attrs.get("clock_method") == ARRIVAL
        return np.concatenate([
            status_at(wanted_s[rows], times_s, values, by_arrival=by_arrival) for rows in parts(len(wanted_s))
        ])
    increasing = np.diff(np.maximum.accumulate(times_s), prepend=-np.inf) > 0
    values, times_s = values[increasing], times_s[increasing]
    period_s = float(np.median(np.diff(times_s)))
    return np.concatenate([cubic_at(wanted_s[rows], times_s, values, period_s) for rows in parts(len(wanted_s))])


def _replace(dataset: h5py.Dataset, values: NDArray[np.generic]) -> None:
    kept = np.asarray(values).astype(dataset.dtype)
    dataset[...] = kept
    dataset.attrs["crc32"] = check_of(kept)


def _say(entry: h5py.Group, point: RecordedPoint, skew: Skew, displacement_s: float) -> None:
    """The statements on skew, as `rig.recording.conversion` writes them."""
    quality = entry["quality"].attrs
    quality["skew_s"] = skew.force.value_s - skew.displacement.value_s
    quality["skew_std_s"] = skew.std_s
    quality["skew_checked"] = np.int8(skew.force.checked and skew.displacement.checked)
    judged = _judged(point, skew)
    for name in {"reasons", "blamed"} & quality.keys():
        del quality[name]  # no reason left is no attribute
    set_attributes(entry["quality"], {
        "verdict": judged.verdict, "reasons": judged.reasons, "blamed": judged.blamed,
    })
    for name, delay in (("force", skew.force), ("displacement", skew.displacement)):
        quality[f"{name}_undeclared_delay_s"] = delay.value_s
        std_s = math.hypot(float(point.quality[f"{name}_tie_std_s"]), delay.std_s)
        quality[f"{name}_clock_std_s"] = entry["raw"][name].attrs["clock_std_s"] = std_s
    entry["test"].attrs["controller_clock_at_zero_s"] = float(
        point.test["controller_clock_at_zero_s"]
    ) - displacement_s
