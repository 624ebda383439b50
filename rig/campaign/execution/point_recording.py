"""Recording of points: start and end of the journal, conversion to a file, entry of the verdict."""

from __future__ import annotations

import json
import traceback
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from pathlib import Path

from drivers.catalogue import sensor_wire_text
from rig import __version__
from rig.bench.model import Bench
from rig.bench.sensor_settings import SensorConfig
from rig.campaign.execution.campaign_context import CampaignContext
from rig.campaign.operator_link import Signals
from rig.campaign.results import PointResult
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.setup import campaign_hash
from rig.campaign.stop_cause import StopCause, because, cause_of
from rig.campaign.words import say
from rig.clock import machine_ns, monotonic_ns, utc_now
from rig.recording.conversion.finaliser import Finaliser
from rig.recording.conversion.recovery import set_aside
from rig.recording.journal.recorder import PointRecorder, RecorderFailed, kept_apart
from rig.recording.layout import PointContext, SensorContext
from rig.recording.point_attributes import Commanded
from rig.recording.point_files import OUT_OF_TOLERANCE, FinishedPoint, attempt_name
from rig.test_point import ENDURANCE, TestPoint
from rig.verdicts import VALID

RETIMING_TIMEOUT_S = 120.0
ASK_AGAIN_S = 0.25
FILES_TIMEOUT_S = 120.0
"""Beside the recorded time itself: a file of ten minutes at 10 kHz takes minutes to make."""


@dataclass
class PointRecording:
    """The recorder of the running point, and the points whose files are being made.

    Attributes:
        campaign: what the campaign works with; results are entered there.
        finaliser: the process that writes the points' files.
        recorder: recording's thread on the station's ring; None before the station is connected.
        handed_in: points whose files are being made, by the name of their files.
        apart: those of these names that are records out of tolerance.
        counted: what the last file of a block of an endurance test says of it, by id of the point.
    """

    campaign: CampaignContext
    finaliser: Finaliser
    recorder: PointRecorder | None = None
    handed_in: dict[str, TestPoint] = field(default_factory=dict)
    apart: set[str] = field(default_factory=set)
    counted: dict[str, ev.BlockCounted] = field(default_factory=dict)

    def begin(self, action: act.BeginRecording) -> None:
        """Open the journal of a point's attempt.

        Raises:
            RecorderFailed: there is no recorder, or it has ended.
            OSError: the disk refused the journal; the point is given up.
        """
        recorder, point, campaign = self._connected(), action.point, self.campaign
        try:
            if point.kind == ENDURANCE:
                action = replace(action, point=campaign.endurance.begun(point, campaign.bench))
                name = campaign.endurance.name_of(point, campaign.point_ids)
            else:
                name = self._cleared_name(action)
            expected_s = point.motion_s / campaign.bench.clock.device_rate
            recorder.begin(point_context(campaign, action, name), expected_s=expected_s)
        except Exception as error:
            self.give_up(point, cause_of(error))
            raise
        if campaign.results.began_ns is None:
            campaign.results.began_ns = machine_ns()
        campaign.log.note("point", point=point.id, attempt=action.attempt)
        if action.drive is not None:
            campaign.results.iterations[point.id] = action.drive.to_json()

    def _cleared_name(self, action: act.BeginRecording) -> str:
        """Name of a point's files; what an earlier session left of the point makes room for this one's."""
        campaign, point = self.campaign, action.point
        if action.attempt == 1:
            names = set_aside(campaign.files.points, point.id, campaign.point_ids)
            campaign.results.renamed(names)
        return attempt_name(point.id, action.attempt, campaign.point_ids)

    def end(self, action: act.EndRecording) -> None:
        """Close the journal and have the point's file made.

        Raises:
            RecorderFailed: as `begin`.
            OSError: the disk refused the journal's end; the point is given up.
        """
        recorder, results = self._connected(), self.campaign.results
        results.ended_ns = machine_ns()
        results.motion_s += action.point.motion_s
        try:
            journal = recorder.end(stopped_by=None if action.fault is None else action.fault.slug)
        except Exception as error:
            self.give_up(action.point, cause_of(error))
            if action.point.kind == ENDURANCE:
                self._count(action.point, None)  # the rod has moved; what the journal holds is counted after a resume
                del self.counted[action.point.id]
            raise
        self.handed_in[journal.id] = action.point
        self.finaliser.submit(journal)

    def drop(self, action: act.DropRecording) -> None:
        """Close the journal and keep it apart from the points.

        Raises:
            RecorderFailed: as `begin`, or the disk refused.
        """
        recorder = self._connected()
        recorder.note(OUT_OF_TOLERANCE, action.reason, monotonic_ns())
        try:
            kept = kept_apart(recorder.end(), self.campaign.point_ids)
        except OSError as error:
            raise RecorderFailed(f"{self.campaign.files.points}: {error}") from error
        self.handed_in[kept.id] = action.point
        self.apart.add(kept.id)
        self.finaliser.submit(kept)
        text = say("dropped", kept=kept.id)
        self.campaign.log.note("dropped", point=action.point.id, kept=kept.id, text=text)

    def _connected(self) -> PointRecorder:
        if self.recorder is None:
            raise RecorderFailed("no recorder: the station is not connected yet")
        return self.recorder

    def remark(self, action: act.Remark) -> None:
        """Put a finding into the running point's journal."""
        if self.recorder is not None:
            self.recorder.note(action.code, action.text, monotonic_ns())

    def give_up(self, point: TestPoint, cause: StopCause) -> PointResult:
        """Enter a point that could not be begun or whose file could not be written."""
        return self._announced(self.campaign.results.given_up(point, cause))

    def _announced(self, result: PointResult) -> PointResult:
        self.campaign.log.note("judged", **result.to_json())
        self.campaign.display.point_done(result)
        return result

    def verdicts(self, attempts: tuple[str, ...]) -> list[ev.Event]:
        """What was judged since the last call.

        Args:
            attempts: point ids, one entry for each attempt begun; a late verdict on an earlier attempt decides nothing.
        """
        events: list[ev.Event] = []
        for finished in self.finaliser.results():
            result = self._entered(finished)
            if result is None:
                continue
            block = self.counted.pop(result.id, None)
            if block is not None:
                events.append(ev.Judged(result.id, result.verdict == VALID, block))
            elif finished.id == attempt_name(result.id, max(1, attempts.count(result.id)), self.campaign.point_ids):
                events.append(ev.Judged(result.id, result.verdict == VALID))
        return events

    def _entered(self, finished: FinishedPoint) -> PointResult | None:
        """Enter what the finaliser says about a point's attempt; None for anything else that it tells of."""
        campaign, point = self.campaign, self.handed_in.pop(finished.id, None)
        attempt = point is not None and finished.id not in self.apart
        if finished.error and not attempt:
            campaign.log.note("warning", slug=finished.error_slug, text=f"{finished.id}: {finished.error}")
        if point is None:
            return None
        if point.kind == ENDURANCE:
            self._count(point, None if finished.error else campaign.files.points / finished.file)
        if finished.error or not finished.file:
            return self.give_up(point, because("not-written", "said", text=finished.error)) if attempt else None
        entry = (
            point, campaign.files.points / finished.file, finished.verdict, finished.reasons,
            finished.lost_samples, finished.quality,
        )
        if attempt:
            return self._announced(campaign.results.record_verdict(*entry))
        campaign.results.recorded_apart(*entry)
        return None

    def _count(self, point: TestPoint, file: Path | None) -> None:
        """Count the cycles of a block's file, and show the operator the state of the test."""
        campaign = self.campaign
        self.counted[point.id] = campaign.endurance.count(point, file)
        campaign.endurance.save()
        text = campaign.endurance.summary(point)
        campaign.log.note("endurance", point=point.id, text=text)
        campaign.display.message("info", text)

    def withdraw(self, action: act.Withdraw) -> None:
        """Leave out the points that are not run, since a stop rule ended their endurance test."""
        campaign = self.campaign
        campaign.endurance.withdraw(action.test, action.points)
        campaign.endurance.save()
        campaign.results.withdraw(action.points)
        campaign.log.note("withdrawn", test=action.test, points=list(action.points))

    def collect(self, signals: Signals) -> ev.Abort | None:
        """Wait for the files of the points that were recorded; the rig is at rest, whatever happens here.

        Args:
            signals: the operator's; a stop among them ends the waiting.

        Returns:
            That stop; None when there was none.
        """
        enough = _Enough(signals)
        try:
            self._collect(enough)
        except Exception as error:  # noqa: BLE001 - the rig is at rest: whatever fails here costs no safety
            self.campaign.log.note("error", text=f"the points' files: {error!r}", trace=traceback.format_exc())
            self.campaign.display.message("error", say("points-files", error=error))
        return enough.abort

    def _collect(self, enough: _Enough) -> None:
        recorded_s = sum(point.motion_s for point in self.handed_in.values())
        deadline_ns = monotonic_ns() + int(1e9 * (FILES_TIMEOUT_S + recorded_s))
        for name in tuple(self.handed_in):
            while name in self.handed_in:
                try:
                    self._entered(self.finaliser.wait(name, ASK_AGAIN_S))
                except TimeoutError:
                    if enough() or monotonic_ns() > deadline_ns:
                        cause = because("not-written", "file-unfinished")
                        self._entered(FinishedPoint(name, error=cause.detail, error_slug=cause.slug))
        planned = {point.id for point in self.campaign.results.points}
        if self.campaign.results.results.keys() >= planned and not enough():
            self._bring_to_one_skew(enough)

    def _bring_to_one_skew(self, enough: _Enough) -> None:
        """All points together know the sensors' delays better than each alone; files certainly wrong are corrected."""
        log, thread = self.campaign.log, ThreadPoolExecutor(1, thread_name_prefix="one-skew")
        try:
            waiting = thread.submit(self.finaliser.retime, self.campaign.files.points, RETIMING_TIMEOUT_S)
            while not waiting.done() and not enough():
                wait((waiting,), ASK_AGAIN_S)
            if not waiting.done():
                log.note("warning", text=say("own-skews", why="the operator requested a stop before the comparison"))
                return
            corrected = waiting.result()
        except OSError as error:
            log.note("warning", text=say("own-skews", why=error))
            return
        finally:
            thread.shutdown(wait=False)
        for finished in corrected:
            log.note(
                "retimed", file=finished.id, skew_s=finished.skew_s, skew_std_s=finished.skew_std_s,
                verdict=finished.verdict,
            )
            self._say_changed(finished)
            self.campaign.results.corrected(Path(finished.file), finished.verdict, finished.reasons, finished.quality)

    def _say_changed(self, finished: FinishedPoint) -> None:
        """Tell the operator of a verdict that all points together changed, before it is entered."""
        for before in self.campaign.results.results.values():
            if before.file == Path(finished.file) and before.verdict != finished.verdict:
                why = "; ".join(finished.reasons) or say("no-doubt")
                text = say("verdict-changed", point=before.id, before=before.verdict, after=finished.verdict, why=why)
                self.campaign.display.message("info" if finished.verdict == VALID else "warning", text)

    def close(self) -> None:
        """Let go of the ring; a point still open is closed as interrupted, where the disk allows it."""
        if self.recorder is not None:
            try:
                self.recorder.close()
            except OSError as error:
                self.campaign.log.note("warning", text=say("recorder-left", error=error))


class _Enough:
    """Whether the operator does not want to wait any longer: a stop among the signals."""

    def __init__(self, signals: Signals) -> None:
        self._signals = signals
        self.abort: ev.Abort | None = None

    def __call__(self) -> bool:
        for event in self._signals.take():
            if isinstance(event, ev.Abort):
                self.abort = self.abort or event
        return self.abort is not None


def point_context(campaign: CampaignContext, action: act.BeginRecording, name: str) -> PointContext:
    """The header of a point's journal, whose files have this name."""
    return PointContext(
        point=replace(action.point, id=name),
        sensors=sensor_contexts(campaign.bench),
        device_rate=campaign.bench.clock.device_rate,
        controller_delay_s=campaign.bench.actuator.input_delay_s,
        mid_stroke_m=campaign.matrix.specimen.mid_stroke_m,
        moving_mass_kg=campaign.bench.fixture.moving_mass_kg,
        current_tolerance_A=campaign.matrix.campaign.current_settled_A,
        simulated=campaign.simulated,
        current_by_hand=campaign.bench.ecu.by_hand,
        streamed=campaign.bench.actuator.setpoints_s is not None,
        current_unmeasured=not (campaign.bench.ecu.measured or campaign.bench.ecu.by_hand),
        current_delay_s=campaign.bench.ecu.current_delay_s or 0.0,
        provenance=_provenance(campaign, action.point, action.attempt),
        calibration=campaign.at_rest,
        channels=campaign.channels,
        commanded=_commanded(campaign, action),
    )


def _commanded(campaign: CampaignContext, action: act.BeginRecording) -> Commanded:
    sweep, temperature = campaign.matrix.sweep, campaign.matrix.temperature
    low_degC, high_degC = (None, None) if temperature is None else temperature.window_degC
    tolerance = sweep.amplitude_tolerance if sweep.adapt_amplitude else None
    program, drive = action.commanded, action.drive
    commanded = Commanded(program.amplitude_m, program.centre_m, tolerance, low_degC, high_degC)
    if drive is None or sweep.iterate is None:
        return commanded
    iteration = json.dumps(drive.to_json(), allow_nan=False)
    return replace(commanded, tracking_tolerance=sweep.iterate.tolerance, iteration=iteration)


def _provenance(campaign: CampaignContext, point: TestPoint, attempt: int) -> dict[str, str]:
    identities = {f"identity_{name}": _text(value) for name, value in campaign.identities.items()}
    return {
        "software": f"mr-damper-rig {__version__}",
        "campaign": campaign.folder.name,
        "bench": campaign.bench.name,
        "bench_hash": campaign.bench.digest,
        "matrix_hash": campaign.matrix.digest,
        "campaign_hash": campaign_hash(campaign.bench, campaign.matrix),
        "specimen": campaign.matrix.specimen.serial_number,
        "point": point.id,
        "attempt": str(campaign.stock.attempts.get(point.id, 0) + attempt),
        "started_utc": utc_now().isoformat(timespec="milliseconds"),
        **identities,
    }


def sensor_contexts(bench: Bench) -> dict[str, SensorContext]:
    """The sensors as the recording names them: `force`, `displacement`, `auxiliary_1` ..."""
    contexts = {
        "force": _sensor(bench.load_cell, "N", "Force at the load cell"),
        "displacement": _sensor(bench.lvdt, "m", "Damper extension"),
    }
    for number, sensor in enumerate(bench.auxiliary, start=1):
        contexts[f"auxiliary_{number}"] = _sensor(sensor, sensor.unit, sensor.name)
    return contexts


def _sensor(sensor: SensorConfig, unit: str, long_name: str) -> SensorContext:
    calibration = sensor.calibration
    return SensorContext(
        sensor=sensor.label,
        rate_Hz=sensor.rate_Hz,
        delay_s=sensor.delay_s,
        range_SI=sensor.span,
        unit=unit,
        long_name=long_name,
        sensitivity=sensor.sensitivity,
        offset=sensor.offset,
        serial_number=calibration.serial_number,
        certificate=calibration.certificate,
        due="" if calibration.due is None else calibration.due.isoformat(),
        uncertainty_percent=calibration.uncertainty_percent,
        overdue=calibration.due is not None and calibration.due < utc_now().date(),
        format=sensor_wire_text(sensor.described, sensor.format),
        bandwidth_Hz=sensor.bandwidth_Hz,
    )


def _text(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(entry)}" for key, entry in value.items())
    return f"{value:.9g}" if isinstance(value, float) else str(value)
