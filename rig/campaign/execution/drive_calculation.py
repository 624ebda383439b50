"""Calculation of the next command of an iterated signal, on a thread: the loop that watches the rig does not wait."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import Channel
from drivers.roles import Input
from rig.campaign.execution.campaign_context import CampaignContext
from rig.campaign.execution.point_recording import point_context
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.stop_cause import because, cause_of
from rig.campaign.words import say
from rig.errors import FileProblem
from rig.matrix.command_limits import SignalLimits
from rig.matrix.forecast import forecaster
from rig.recording.alignment.alignment import NothingRecorded, align
from rig.recording.drive_file import DriveOwner, kept_drives, write_drive
from rig.recording.quality.tracking import run_of
from rig.signals.drive_iteration import SignalDrive, SignalDrives, advanced, allowed_start, drive_for
from rig.signals.record import NoRecord
from rig.test_point import SIGNAL, TestPoint


class DriveCalculation:
    """Calculates one command at a time.

    Args:
        campaign: what the campaign works with.
    """

    def __init__(self, campaign: CampaignContext) -> None:
        self._campaign = campaign
        self._thread: ThreadPoolExecutor | None = None
        self._running: Future[ev.Iterated] | None = None

    def begin(self, action: act.Iterate, records: Sequence[NDArray[Any]]) -> None:
        """Calculate the next command; its event comes through `events`.

        Args:
            action: what was run.
            records: of the ring, during that run.
        """
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1, thread_name_prefix="next-command")
        self._running = self._thread.submit(self._event, action, tuple(records))

    def events(self) -> list[ev.Event]:
        """The command that was calculated since the last call."""
        if self._running is None or not self._running.done():
            return []
        running, self._running = self._running, None
        return [running.result()]

    def close(self) -> None:
        """Begin nothing more; a calculation under way is not waited for."""
        if self._thread is not None:
            self._thread.shutdown(wait=False, cancel_futures=True)

    def _event(self, action: act.Iterate, records: tuple[NDArray[Any], ...]) -> ev.Iterated:
        point = action.point
        try:
            drive = self._next(action, records)
        except (NoRecord, NothingRecorded) as error:
            return ev.Iterated(point.id, None, because("iteration", "said", text=str(error)))
        except Exception as error:  # noqa: BLE001 - whatever fails here costs this point, not the campaign
            self._campaign.log.note("error", text=f"{point.id}: the next command: {error!r}")
            return ev.Iterated(point.id, None, cause_of(error))
        if drive is None:
            return ev.Iterated(point.id, None, because("iteration", "no-rod"))
        self._keep(point, drive)
        return ev.Iterated(point.id, drive)

    def _next(self, action: act.Iterate, records: tuple[NDArray[Any], ...]) -> SignalDrive | None:
        """The drive with the next command; None where the rod was not recorded.

        Raises:
            NoRecord: the target or the command has no motion.
            NothingRecorded: the run has no samples.
        """
        campaign, point, run = self._campaign, action.point, action.run
        target, settings = point.record_samples, campaign.matrix.sweep.iteration
        limits = SignalLimits(point, campaign.matrix, campaign.bench, forecaster(campaign.matrix.specimen))
        if target is None or settings is None:
            return None
        if action.drive is None or run is None:
            return allowed_start(drive_for(target, point.current_A, action.known, settings), target, limits)
        context = point_context(campaign, act.BeginRecording(point, 1, run), point.id)
        commanded = run.record_samples or target
        received = np.concatenate(records)
        measured = run_of(commanded, target, run.centre_m, align(received, context))
        if measured is None:
            return None
        inputs = received["value"][received["channel"] == Channel.INPUTS].astype(np.int64)
        saturated = bool((inputs & int(Input.VALVE_SATURATED)).any())
        return advanced(
            action.drive, target, measured.motion_m, settings, limits, saturated=saturated, force_N=measured.force_N
        )

    def _keep(self, point: TestPoint, drive: SignalDrive) -> None:
        """Store the drive next to the points; a disk that refuses it does not end the iteration."""
        folder, settings = self._campaign.files.drives, self._campaign.matrix.sweep.iteration
        tolerance = None if settings is None else settings.tolerance
        try:
            write_drive(folder, point.id, drive_owner(self._campaign), point, drive, tolerance)
        except (OSError, FileProblem) as error:
            text = say("drive-not-kept", file=folder / point.id, error=error)
            self._campaign.log.note("warning", text=text)


def drive_owner(campaign: CampaignContext) -> DriveOwner:
    """The machine and the specimen of a campaign."""
    return DriveOwner(campaign.matrix.specimen.serial_number, campaign.bench.digest)


def stored_drives(campaign: CampaignContext) -> SignalDrives:
    """Drives in the campaign's folder, from an earlier session or copied from an earlier run, to start from."""
    settings = campaign.matrix.sweep.iteration
    if settings is None:
        return ()
    points = tuple(item.point for item in campaign.plan.points if item.point.kind == SIGNAL)
    drives, problems = kept_drives(campaign.files.drives, drive_owner(campaign), points, settings.gain)
    for problem in problems:
        campaign.log.note("warning", text=problem)
        campaign.display.message("warning", problem)
    return drives
