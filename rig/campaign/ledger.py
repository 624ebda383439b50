"""The campaign's books: what became of every point, when the first began and the last ended."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from rig.campaign.cause import Cause
from rig.campaign.options import PointResult, Wait
from rig.matrix.point import TestPoint

NOT_RUN = "not run"
INVALID = "invalid"
VALID = "valid"
RANKS = (INVALID, "suspect", VALID)
"""Verdicts, worst first: of a point's attempts the best verdict counts, then the latest."""


@dataclass
class Ledger:
    """Results by point id; a later attempt replaces an earlier one unless that one had a better verdict."""

    points: tuple[TestPoint, ...]
    results: dict[str, PointResult] = field(default_factory=dict)
    began_ns: int | None = None
    ended_ns: int | None = None
    motion_s: float = 0.0
    start_temperature_degC: float | None = None
    waits: list[Wait] = field(default_factory=list)

    def found(self, temperature_degC: float) -> None:
        """A reading of the coil's temperature, NaN where unknown; the session's first one counts."""
        if self.start_temperature_degC is None and math.isfinite(temperature_degC):
            self.start_temperature_degC = temperature_degC

    def begun(self, now_ns: int) -> None:
        """A point's recording began at `now_ns` (monotonic)."""
        self.began_ns = now_ns if self.began_ns is None else self.began_ns

    def ended(self, point: TestPoint, now_ns: int) -> None:
        """A point's recording ended at `now_ns` (monotonic)."""
        self.ended_ns = now_ns
        self.motion_s += point.motion_s

    def judged(
        self, point: TestPoint, file: Path | None, verdict: str, reasons: Iterable[str], lost_samples: int,
        quality: Mapping[str, float] | None = None,
    ) -> PointResult:
        """Enter an attempt's verdict and, when measured, its numbers; returns what was entered."""
        result = replace(_result(point, file, verdict, tuple(reasons), lost_samples), quality=quality or {})
        known = self.results.get(point.id)
        if known is None or RANKS.index(verdict) >= RANKS.index(known.verdict):
            self.results[point.id] = result
        return result

    def mended(self, file: Path, verdict: str, reasons: Iterable[str], quality: Mapping[str, float]) -> None:
        """A point's file (absolute path) was written again; its verdict and numbers are these now."""
        for point_id, result in self.results.items():
            if result.file == file:
                self.results[point_id] = replace(result, verdict=verdict, reasons=tuple(reasons), quality=quality)

    def given_up(self, point: TestPoint, cause: Cause) -> PointResult:
        """Enter a point that could not be begun or whose file could not be written."""
        return self.judged(point, None, INVALID, (f"{cause.slug}: {cause.detail}",), 0)

    def all_results(self) -> tuple[PointResult, ...]:
        """Every point in planned order; the ones without a result were not run."""
        return tuple(self.results.get(point.id) or _result(point, None, NOT_RUN, (), 0) for point in self.points)

    @property
    def complete(self) -> bool:
        """Whether every planned point was run, whatever its verdict."""
        return all(point.id in self.results for point in self.points)

    @property
    def valid(self) -> int:
        """How many points are valid."""
        return sum(result.verdict == VALID for result in self.results.values())

    @property
    def wall_s(self) -> float:
        """Wall seconds from the first point's start to the last point's end; 0 when none ran."""
        if self.began_ns is None or self.ended_ns is None:
            return 0.0
        return 1e-9 * (self.ended_ns - self.began_ns)


def _result(point: TestPoint, file: Path | None, verdict: str, reasons: tuple[str, ...], lost: int) -> PointResult:
    return PointResult(
        id=point.id,
        file=file,
        verdict=verdict,
        reasons=reasons,
        waveform=point.waveform,
        amplitude_m=point.amplitude_m,
        frequency_Hz=point.frequency_Hz,
        current_A=point.current_A,
        lost_samples=lost,
    )
