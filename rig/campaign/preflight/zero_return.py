"""Comparison of both rests of a session: has a sensor's zero drifted relative to the controller's own input?

A drift makes the points of the session suspect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import Channel
from protocols.quality import NO_VALUE
from rig.campaign.execution.campaign_context import CampaignContext
from rig.campaign.results import CampaignFinding
from rig.campaign.setup import ZERO_CHECKS, note_zeros
from rig.campaign.words import say
from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem
from rig.recording.journal.ring_reader import RecordBlock
from rig.recording.run import read_campaign
from rig.signals.rest import RestWindow, Spread, ZeroDrift

LEFT_SHARE = 0.25
"""Of the largest force measured: so far the force at rest may lie from the start's by friction and another position."""


@dataclass
class ZeroReturn:
    """Both rest windows of a session, and how much was measured between them.

    Attributes:
        start: before the rig was armed; None when it never came so far.
        end: at the end, at 0 A and standstill; None when the end did not allow it.
        peak_force_N: largest force while points ran.
        peak_displacement_m: largest distance from the start's rest while points ran.
        force_step_N, displacement_step_m: least difference of two samples: the sensors' resolution.
    """

    start: RestWindow | None = None
    end: RestWindow | None = None
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
        force = ZeroDrift(
            (start.force_N, start.controller_force_N), (end.force_N, end.controller_force_N),
            self.peak_force_N, self.force_step_N, end.force_flagged,
        )
        displacement = ZeroDrift(
            (start.displacement_m, start.position_m), (end.displacement_m, end.position_m),
            self.peak_displacement_m, self.displacement_step_m, end.displacement_flagged,
        )
        pairs = (
            _drift_finding(force, ("load cell", "controller's force input"), "N", 1.0),
            _drift_finding(displacement, ("LVDT", "controller's position input"), "mm", 1e3),
        )
        return tuple(finding for finding in pairs if finding is not None)

    def force_left(self, zero_N: float) -> CampaignFinding | None:
        """What the force says of a coil whose 0 A was not measured; None where it has come back, or was not seen.

        Args:
            zero_N: what a force at rest may be off by in any case (N).
        """
        if self.start is None or self.end is None:
            return None
        start_N, end_N = self.start.force_N.mean, self.end.force_N.mean
        limit_N = max(zero_N, LEFT_SHARE * self.peak_force_N)
        if abs(end_N - start_N) <= limit_N:
            return None
        text = say("force-left", start=start_N, end=end_N, limit=limit_N)
        values = {"start": start_N, "end": end_N, "limit": limit_N}
        return CampaignFinding("current-left", "bench", text, ("current source", "load cell"), values)

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


def _spread(records: NDArray[Any]) -> Spread | None:
    return Spread.of(records["value"][(records["flags"] & np.uint16(NO_VALUE)) == 0])


def _drift_finding(
    zero: ZeroDrift, instruments: tuple[str, str], unit: str, factor: float
) -> CampaignFinding | None:
    """The finding when sensor and controller's input agree less at the end than at the start; `factor` from SI."""
    drifted = zero.significant()
    if drifted is None:
        return None
    measured, own = instruments
    text = say(
        "drifted-apart", measured=measured, own=own, drift=factor * drifted.drift, limit=factor * drifted.limit,
        peak=factor * zero.peak, unit=unit,
    )
    values = {**drifted._asdict(), "largest_measured": zero.peak}
    return CampaignFinding("zero-drift", "bench", text, instruments, values)


def current_left(left_A: float | None) -> CampaignFinding | None:
    """The finding of a current (A) that the last measurement shows at a session's end; None where there is none."""
    if left_A is None:
        return None
    text = say("current-measured", left_A=left_A)
    return CampaignFinding("current-left", "bench", text, ("current source",), {"measured": left_A})


def zeros_returned(zeros: ZeroReturn, campaign: CampaignContext) -> tuple[CampaignFinding, ...]:
    """What the zeros show at a session's end, entered in `campaign.json`, in the points' files and in the books."""
    findings = zeros.findings()
    if zeros.start is not None:
        try:
            note_zeros(campaign.folder, zeros.to_json())
        except (OSError, FileProblem) as error:
            campaign.display.message("error", say("at-the-end", error=error))
    warn = partial(campaign.display.message, "warning")
    campaign.results.doubted(findings, warn)
    return findings


def read_zero_checks(folder: Path) -> tuple[ZeroReturn, ...]:
    """The zero checks of a campaign's sessions, oldest first.

    Raises:
        FileProblem: an entry is damaged.
    """
    checks = []
    for entry in read_campaign(folder).get(ZERO_CHECKS, ()):
        try:
            start, end = (
                None if entry[name] is None else RestWindow.from_json(entry[name]) for name in ("start", "end")
            )
            peaks = float(entry["peak_force_N"]), float(entry["peak_displacement_m"])
            steps = (
                math.inf if entry.get(name) is None else float(entry[name])
                for name in ("force_step_N", "displacement_step_m")
            )
            checks.append(ZeroReturn(start, end, *peaks, *steps))
        except (KeyError, TypeError, ValueError) as error:
            raise FileProblem(str(CampaignFolder(folder).description), [f"{ZERO_CHECKS}: {error!r}"]) from error
    return tuple(checks)
