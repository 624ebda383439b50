"""Result of the reanalysis of one run, as a value."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.fits.plain import plain
from rig.reanalysis.changes import PointChange, ValueChange


@dataclass(frozen=True)
class Reanalysis:
    """Result of one run.

    Attributes:
        run: the original.
        result: folder of the new result; None without one.
        up_to_date: whether the result existed before: of this version, from the same files.
        software: this version and commit.
        recorded_by: versions that made the original files of points.
        points: every point, changed or not.
        characteristics: numbers that have changed.
        fit: parameters and error of the fit that have changed.
        models: models of the original and of the new fit; empty: none.
        specimen: verdicts on the specimen before and now; empty: no acceptance bands, or no verdict yet.
        left_out: files of points that could not be made again, and why.
        remarks: what must be known before the differences are believed.
        fit_error: why there is no new fit although one was expected; empty otherwise.
        error: why there is no result; empty if there is one.
    """

    run: Path
    result: Path | None = None
    up_to_date: bool = False
    software: str = ""
    recorded_by: tuple[str, ...] = ()
    points: tuple[PointChange, ...] = ()
    characteristics: tuple[ValueChange, ...] = ()
    fit: tuple[ValueChange, ...] = ()
    models: tuple[str, str] = ("", "")
    specimen: tuple[str, str] = ("", "")
    left_out: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    fit_error: str = ""
    error: str = ""

    @property
    def changed_points(self) -> tuple[PointChange, ...]:
        """Points whose verdict or samples differ."""
        return tuple(point for point in self.points if point.changed)

    @property
    def changed(self) -> bool:
        """Whether any result differs."""
        return bool(self.changed_points or self.characteristics or self.fit or self.specimen[0] != self.specimen[1])

    def to_json(self) -> dict[str, Any]:
        """Plain types without NaN; the keys are in `docs/json.md`."""
        content: dict[str, Any] = plain({
            "run": str(self.run), "result": None if self.result is None else str(self.result),
            "up_to_date": self.up_to_date, "software": self.software, "recorded_by": list(self.recorded_by),
            "changed": self.changed, "points": [point.to_json() for point in self.points],
            "characteristics": [one.to_json() for one in self.characteristics],
            "fit": [one.to_json() for one in self.fit],
            "models": {"before": self.models[0] or None, "after": self.models[1] or None},
            "specimen": {"before": self.specimen[0] or None, "after": self.specimen[1] or None},
            "left_out": list(self.left_out), "remarks": list(self.remarks), "fit_error": self.fit_error or None,
            "error": self.error or None,
        })  # fmt: skip
        return content
