"""Zeros at the end of a session against those of its start: values in, findings out, and doubt in the points' files.

Load cell and LVDT are compared with the controller's own force and position inputs, before the first motion and again
when the rod rests at 0 A at the end. What has changed between the two comparisons is drift of one of the two
instruments; which one, no bench can tell by itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.ring import Channel
from protocols.quality import NO_VALUE
from rig.campaign.execution.campaign_context import CampaignContext
from rig.campaign.preflight.rest_check import FEWEST_SAMPLES, Reading, RestWindow, RestWindows
from rig.campaign.results import CampaignFinding, PointResult, PointResults
from rig.campaign.setup import ZERO_CHECKS, note_zeros
from rig.campaign.words import say
from rig.errors import FileProblem
from rig.recording.conversion.delay_correction import finished, write_verdict
from rig.recording.journal.ring_reader import RecordBlock
from rig.recording.quality.instrument_checks import ZERO_RETURN
from rig.recording.quality.verdict import suspect
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import read_campaign

DRIFT_SHARE = 0.01
"""Of the largest measured force, or of the largest measured displacement from rest."""
SURE = 5.0
"""Standard errors by which a drift is more than noise ..."""
FEW = 4.0
"""... and so many times more, divided by the degrees of freedom that the noise itself is known by."""
FEWEST_STATUSES = 3
REPEATS = 1e-6
"""Of the noise: the scatter that rounding makes of one value many times over."""
_BAD = np.uint16(NO_VALUE)


@dataclass
class ZeroReturn(RestWindows):
    """Both rest windows of a session, and how much was measured between them.

    Attributes:
        peak_force_N: largest force while points ran.
        peak_displacement_m: largest distance from the start's rest while points ran.
        force_step_N, displacement_step_m: least difference of two samples: the sensors' resolution.
    """

    peak_force_N: float = 0.0
    peak_displacement_m: float = 0.0
    force_step_N: float = math.inf
    displacement_step_m: float = math.inf

    def watch(self, block: RecordBlock) -> None:
        """Take records of a running point."""
        if self.start is None:
            return
        force, displacement = (_spread(block.of(channel)) for channel in (Channel.FORCE, Channel.DISPLACEMENT))
        if force is not None:
            self.peak_force_N = max(self.peak_force_N, abs(force.lowest), abs(force.highest))
            self.force_step_N = min(self.force_step_N, force.step)
        if displacement is not None:
            rest_m = self.start.displacement_m.mean
            apart_m = max(abs(displacement.lowest - rest_m), abs(displacement.highest - rest_m))
            self.peak_displacement_m = max(self.peak_displacement_m, apart_m)
            self.displacement_step_m = min(self.displacement_step_m, displacement.step)

    def findings(self) -> tuple[CampaignFinding, ...]:
        """What has drifted by more than the tests allow; nothing where a window is missing."""
        start, end = self.start, self.end
        if start is None or end is None:
            return ()
        force = _Drift(
            (start.force_N, start.controller_force_N), (end.force_N, end.controller_force_N),
            self.peak_force_N, self.force_step_N, end.force_flagged,
        )
        displacement = _Drift(
            (start.displacement_m, start.position_m), (end.displacement_m, end.position_m),
            self.peak_displacement_m, self.displacement_step_m, end.displacement_flagged,
        )
        pairs = (
            force.finding(("load cell", "controller's force input"), "N", 1.0),
            displacement.finding(("LVDT", "controller's position input"), "mm", 1e3),
        )
        return tuple(finding for finding in pairs if finding is not None)

    def to_json(self) -> dict[str, Any]:
        """One entry of `zero_checks` in `campaign.json`; null where a window is missing."""
        return {
            "start": None if self.start is None else self.start.to_json(),
            "end": None if self.end is None else self.end.to_json(),
            "peak_force_N": self.peak_force_N,
            "peak_displacement_m": self.peak_displacement_m,
            "force_step_N": None if math.isinf(self.force_step_N) else self.force_step_N,
            "displacement_step_m": None if math.isinf(self.displacement_step_m) else self.displacement_step_m,
            "findings": [finding.to_json() for finding in self.findings()],
        }


def _noise(first: Reading, last: Reading) -> float:
    """What the difference of two means may be by noise alone; few samples know their own scatter badly."""
    freedom = first.count + last.count - 2
    variance = ((first.count - 1) * first.std**2 + (last.count - 1) * last.std**2) / freedom
    return SURE * (1.0 + FEW / freedom) * math.sqrt(variance * (1.0 / first.count + 1.0 / last.count))


class _Spread(NamedTuple):
    """Of some values: the lowest, the highest, and the least difference of two that are not equal (inf: all are)."""

    lowest: float
    highest: float
    step: float


def _spread(records: NDArray[Any]) -> _Spread | None:
    """Of the good values of records (n,); None when there are none."""
    values = records["value"][(records["flags"] & _BAD) == 0]
    if not len(values):
        return None
    values.sort()
    steps = values[1:] - values[:-1]
    steps = steps[steps > 0.0]
    return _Spread(float(values[0]), float(values[-1]), float(steps.min()) if len(steps) else math.inf)


@dataclass(frozen=True)
class _Drift:
    """A sensor and the controller's own input of the same quantity, at rest at the start and at the end (SI).

    Attributes:
        start: the sensor's reading and the controller's before the first motion.
        end: both at the end.
        peak: the largest value measured between.
        step: the sensor's resolution; inf where it is not known.
        flagged: samples at the end that the sensor itself calls overloaded or faulty.
    """

    start: tuple[Reading, Reading]
    end: tuple[Reading, Reading]
    peak: float
    step: float
    flagged: int

    @property
    def judged(self) -> bool:
        """Whether the readings can tell; not those of a stuck sensor, whose noise is gone at the end."""
        (first, first_own), (last, last_own) = self.start, self.end
        few = min(first.count, last.count) < FEWEST_SAMPLES or min(first_own.count, last_own.count) < FEWEST_STATUSES
        stuck = last.std < REPEATS * first.std and first.std > self._resolution
        return not (few or self.flagged or stuck)

    @property
    def _resolution(self) -> float:
        return 0.0 if math.isinf(self.step) else self.step

    def finding(self, instruments: tuple[str, str], unit: str, factor: float) -> CampaignFinding | None:
        """The finding when the two agree less at the end than at the start.

        Args:
            instruments: sensor and controller's input.
            unit: of the text.
            factor: from SI to this unit.
        """
        if not self.judged:
            return None
        (first, first_own), (last, last_own) = self.start, self.end
        drift = (last.mean - last_own.mean) - (first.mean - first_own.mean)
        noise = math.hypot(_noise(first, last), _noise(first_own, last_own))
        limit = max(DRIFT_SHARE * self.peak, noise, self._resolution)
        if abs(drift) <= limit:
            return None
        measured, own = instruments
        text = say(
            "drifted-apart", measured=measured, own=own, drift=factor * drift, limit=factor * limit,
            peak=factor * self.peak, unit=unit,
        )
        values = {"drift": drift, "limit": limit, "noise": noise, "largest_measured": self.peak}
        return CampaignFinding("zero-drift", "bench", text, instruments, values)


def read_zero_checks(folder: Path) -> tuple[ZeroReturn, ...]:
    """The zero checks of a campaign's sessions, oldest first.

    Raises:
        FileProblem: an entry is damaged.
    """
    checks = []
    for entry in read_campaign(folder).get(ZERO_CHECKS, ()):
        try:
            start, end = (
                None if entry[name] is None else _rest_window(entry[name]) for name in ("start", "end")
            )
            peaks = float(entry["peak_force_N"]), float(entry["peak_displacement_m"])
            steps = (
                math.inf if entry.get(name) is None else float(entry[name])
                for name in ("force_step_N", "displacement_step_m")
            )
            checks.append(ZeroReturn(start, end, *peaks, *steps))
        except (KeyError, TypeError, ValueError) as error:
            raise FileProblem(str(folder / "campaign.json"), [f"{ZERO_CHECKS}: {error!r}"]) from error
    return tuple(checks)


def _rest_window(values: Mapping[str, Any]) -> RestWindow:
    """The opposite of `RestWindow.to_json`.

    Raises:
        KeyError, TypeError, ValueError: something is missing or of a wrong type.
    """
    names = ("force_N", "displacement_m", "position_m", "controller_force_N")
    force_N, displacement_m, position_m, controller_force_N = (
        Reading(float(values[name]["mean"]), float(values[name]["std"]), int(values[name]["count"]))
        for name in names
    )
    flagged = int(values["force_flagged"]), int(values["displacement_flagged"])
    return RestWindow(force_N, displacement_m, position_m, controller_force_N, *flagged)


def zeros_returned(zeros: ZeroReturn, campaign: CampaignContext) -> tuple[CampaignFinding, ...]:
    """What the zeros show at a session's end, entered in `campaign.json`, in the points' files and in the books."""
    findings = zeros.findings()
    if zeros.start is not None:
        try:
            note_zeros(campaign.folder, zeros.to_json())
        except (OSError, FileProblem) as error:
            campaign.display.message("error", say("at-the-end", error=error))
    warn = partial(campaign.display.message, "warning")
    doubt_points(campaign.results, findings, warn, campaign.stock.results)
    return findings


def doubt_points(
    results: PointResults, findings: Sequence[CampaignFinding], warn: Callable[[str], None],
    earlier: Iterable[PointResult] = (),
) -> None:
    """Make the session's valid points suspect for what the rest after its motion showed, in their files and the books.

    Args:
        results: the campaign's points.
        findings: of `ZeroReturn.findings`; without any nothing is touched.
        warn: told of a file that could not be written; its point then stays as it was judged.
        earlier: points of earlier sessions, which were measured between other rests.
    """
    reasons = [suspect(ZERO_RETURN, finding.text, **finding.values) for finding in findings]
    others = {result.file for result in earlier}
    files = [
        result.file for result in results.results.values()
        if result.file is not None and result.file not in others and result.file.is_file()
    ]
    for file in files if reasons else ():
        try:
            judged = RecordedPoint.open(file, whole=False).quality.verdict.replaced({ZERO_RETURN}, reasons)
            write_verdict(file, judged, "load cell and LVDT at rest after the session's motion")
            told = finished(RecordedPoint.open(file, whole=False))
        except (FileProblem, OSError) as error:
            warn(f"{file.name} does not say that a zero did not return: {error}")
            continue
        results.mended(file, told.verdict, told.reasons, told.quality)
