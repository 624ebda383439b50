"""Results of a campaign: one for each point, from all of its attempts."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rig.campaign.results import (
    NOT_RUN,
    CampaignFinding,
    CampaignResult,
    PointResult,
    RigState,
    Wait,
)
from rig.campaign.stop_cause import StopCause
from rig.errors import FileProblem
from rig.recording.conversion.delay_correction import finished, write_verdict
from rig.recording.quality.instrument_checks import ZERO_RETURN
from rig.recording.quality.verdict import suspect
from rig.recording.recorded_point import RecordedPoint
from rig.test_point import TestPoint
from rig.verdicts import INVALID, VALID, rank


@dataclass
class PointResults:
    """Results by point id: of a point's attempts the best verdict counts, then one with a file, then the latest.

    What was recorded is never hidden by an attempt of which nothing was recorded; that one's reasons are told with it.

    Attributes:
        points: the planned points in order.
        results: those that there are.
        earlier: what was recorded of points that are to be run again, by earlier sessions or out of tolerance in this
            one; told until something else of them is recorded.
        measured: files of this session; those of others were measured between other rests.
        began_ns: when the first recording of this session began (monotonic); None before.
        ended_ns: when the last one ended.
        motion_s: planned motion of the points recorded (s, rig's clock).
        start_temperature_degC: the coil's first reading in this session; None before.
        waits: what the damper's temperature cost.
        iterations: how the commands of signals were iterated, by point.
        setpoints: counts and lateness (s) of the set-points streamed so far; None without any.
    """

    points: tuple[TestPoint, ...]
    results: dict[str, PointResult] = field(default_factory=dict)
    earlier: dict[str, PointResult] = field(default_factory=dict)
    measured: set[Path] = field(default_factory=set)
    began_ns: int | None = None
    ended_ns: int | None = None
    motion_s: float = 0.0
    start_temperature_degC: float | None = None
    waits: list[Wait] = field(default_factory=list)
    setpoints: dict[str, float] | None = None
    iterations: dict[str, Mapping[str, Any]] = field(default_factory=dict)

    def take_setpoints(self, counts: Mapping[str, Any]) -> None:
        """The station's count of all set-points streamed so far, after a motion."""
        self.setpoints = {name: counts[name] for name in ("steps", "late", "skipped", "p99_s", "worst_s")}

    def record_verdict(
        self, point: TestPoint, file: Path | None, verdict: str, reasons: Iterable[str], lost_samples: int,
        quality: Mapping[str, float] | None = None,
    ) -> PointResult:
        """Enter an attempt's verdict and, when measured, its numbers; returns what was entered."""
        iteration = self.iterations.get(point.id)
        result = PointResult(point, file, verdict, tuple(reasons), lost_samples, quality or {}, iteration)
        if file is not None:
            self.measured.add(file)
        known = self.results.get(point.id)
        self.results[point.id] = result if known is None else _counts(known, result)
        return result

    def recorded_apart(
        self, point: TestPoint, file: Path, verdict: str, reasons: Iterable[str], lost_samples: int,
        quality: Mapping[str, float],
    ) -> None:
        """Enter the record of a motion out of tolerance, after which the point is to be run again.

        Its file may be made after the point was judged: of records out of tolerance the last one entered is told.
        """
        self.earlier[point.id] = PointResult(point, file, verdict, tuple(reasons), lost_samples, quality)

    def renamed(self, names: Mapping[Path, Path]) -> None:
        """Files of earlier sessions have other names now: old path -> new path."""
        for books in (self.results, self.earlier):
            for point_id, result in books.items():
                if result.file is not None and result.file in names:
                    books[point_id] = replace(result, file=names[result.file])

    def corrected(self, file: Path, verdict: str, reasons: Iterable[str], quality: Mapping[str, float]) -> None:
        """A point's file (absolute path) was written again; its verdict and numbers are these now."""
        for books in (self.results, self.earlier):
            for point_id, result in books.items():
                if result.file == file:
                    books[point_id] = replace(result, verdict=verdict, reasons=tuple(reasons), quality=quality)

    def doubted(self, findings: Sequence[CampaignFinding], warn: Callable[[str], None]) -> None:
        """Make the session's valid points suspect for what the rest after its motion showed, in their files too.

        Args:
            findings: what has drifted; without any nothing is touched.
            warn: told of a file that could not be written; its point then stays as it was judged.
        """
        reasons = [suspect(ZERO_RETURN, finding.text, **finding.values) for finding in findings]
        files = [
            result.file for result in self.results.values()
            if result.file is not None and result.file in self.measured and result.file.is_file()
        ]
        for file in files if reasons else ():
            try:
                verdict = RecordedPoint.open(file, whole=False).quality.verdict.replaced({ZERO_RETURN}, reasons)
                write_verdict(file, verdict, "load cell and LVDT at rest after the session's motion")
                finished_point = finished(RecordedPoint.open(file, whole=False))
            except (FileProblem, OSError) as error:
                warn(f"{file.name}: the zero drift could not be written to the file: {error}")
                continue
            self.corrected(file, finished_point.verdict, finished_point.reasons, finished_point.quality)

    def withdraw(self, ids: Collection[str]) -> None:
        """Leave out points that are not to be run any more."""
        self.points = tuple(point for point in self.points if point.id not in set(ids))

    def given_up(self, point: TestPoint, cause: StopCause) -> PointResult:
        """Enter a point that could not be begun or whose file could not be written."""
        return self.record_verdict(point, None, INVALID, (f"{cause.slug}: {cause.detail}",), 0)

    def all_results(self) -> tuple[PointResult, ...]:
        """Every point in planned order; the ones of which no session tells anything were not run."""
        return tuple(self._result_of(point) for point in self.points)

    def _result_of(self, point: TestPoint) -> PointResult:
        """What counts of what was recorded before and of this session's attempts."""
        before, result = self.earlier.get(point.id), self.results.get(point.id)
        if before is None or result is None:
            return before or result or PointResult(point, None, NOT_RUN)
        return _counts(before, result)

    @property
    def valid(self) -> int:
        """How many points are valid."""
        return sum(result.verdict == VALID for result in self.results.values())

    def session(self, folder: Path) -> CampaignResult:
        """What a session leaves that was neither stopped nor refused, of the campaign in this directory."""
        began_ns, ended_ns = self.began_ns, self.ended_ns
        return CampaignResult(
            campaign=folder,
            points=self.all_results(),
            valid=self.valid,
            total=len(self.points),
            rig_state=RigState.SAFE,
            stopped_by=None,
            detail="",
            refused=False,
            wall_s=0.0 if began_ns is None or ended_ns is None else 1e-9 * (ended_ns - began_ns),
            motion_s=self.motion_s,
            start_temperature_degC=self.start_temperature_degC,
            waits=tuple(self.waits),
            setpoints=self.setpoints,
        )


def _counts(known: PointResult, result: PointResult) -> PointResult:
    """Which of two attempts counts; the reasons of one that has no file to tell them stand behind the other's."""
    if result.verdict != known.verdict:
        return max(known, result, key=lambda attempt: rank(attempt.verdict))
    if known.file is None or result.file is not None:
        return result
    return replace(known, reasons=tuple(dict.fromkeys((*known.reasons, *result.reasons))))
