"""A run as CSV: one file a point with a column a channel, and one file that lists the points."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from rig.recording.atomic_write import write_text_durably
from rig.recording.recorded_point import CHANNELS, RecordedPoint
from rig.recording.run import Run
from rig.signals.arrays import FloatArray

LISTED = (
    "id", "waveform", "amplitude_m", "frequency_Hz", "current_A", "cycles", "repeat", "verdict", "lost_samples",
    "skew_s", "skew_std_s",
)  # fmt: skip


def described(point: RecordedPoint) -> dict[str, object]:
    """What every format says of a point beside its channels: `LISTED`, and where `current_measured_A` comes from.

    `current_source` is `measured`, or says what an imported test had in place of a measurement.
    """
    source = str(point.provenance.get("current", "measured"))
    return {**{name: getattr(point, name) for name in LISTED}, "current_source": source}


def write_points(run: Run, folder: Path) -> list[Path]:
    """Write `points.csv` and one `ID.csv` a point.

    Columns are SI and named with their unit; what a point has not recorded has no column; NaN is an empty cell.

    Args:
        run: the campaign.
        folder: where to; it is there.

    Returns:
        The files, the list first.
    """
    listed = folder / "points.csv"
    rows = [[_cell(value) for value in described(point).values()] for point in run.points]
    write_text_durably(listed, _csv((*LISTED, "current_source"), rows))
    return [listed, *(_write(point, folder / f"{point.id}.csv") for point in run.points)]


def _write(point: RecordedPoint, path: Path) -> Path:
    channels = {name: point.channel(dataset) for name, dataset in CHANNELS.items()}
    given = {name: values for name, values in channels.items() if np.isfinite(values).any()}
    columns = [_column(name, values) for name, values in given.items()]
    write_text_durably(path, _csv(tuple(given), [list(row) for row in zip(*columns, strict=True)]))
    return path


def _column(name: str, values: FloatArray) -> list[str]:
    """Numbers with the digits that were recorded: times to 1 ns, single precision as such."""
    if name == "time_s":
        return [_cell(value) for value in np.round(values, 9).tolist()]
    single = values.astype(np.float32)
    if np.array_equal(single, values, equal_nan=True):
        return ["" if not np.isfinite(value) else str(value) for value in single]
    return [_cell(value) for value in values.tolist()]


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "" if not np.isfinite(value) else repr(value)
    return str(value)


def _csv(head: tuple[str, ...], rows: list[list[str]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()
