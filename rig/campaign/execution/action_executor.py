"""What actions do: requests to the station, the recorder, the finaliser, the journal, the display."""

from __future__ import annotations

import errno
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.ring import Channel
from rig.campaign.execution.campaign_context import CampaignContext
from rig.campaign.execution.motion_measurement import WantedMotion
from rig.campaign.execution.observer import Observer
from rig.campaign.execution.station_requests import StationRequests
from rig.campaign.preflight.baseline import Signature, expected_signature, judge_damper, measured_signature
from rig.campaign.preflight.proof_move import PROOF_M, PROOF_SPEED_M_S, Leg, proof_targets
from rig.campaign.preflight.rest_check import AtRest, judge_rest
from rig.campaign.preflight.zero_return import ZeroReturn, at_rest
from rig.campaign.results import PointResult, PointResults
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer.action import Request
from rig.campaign.stop_cause import StopCause, because
from rig.campaign.words import say
from rig.clock import monotonic_ns
from rig.matrix.point import TestPoint
from rig.recording.conversion.finaliser import Finaliser
from rig.recording.conversion.recovery import set_aside
from rig.recording.journal.recorder import PointRecorder, RecorderFailed, kept_apart
from rig.recording.point_files import OUT_OF_TOLERANCE

if TYPE_CHECKING:
    from rig.recording.point_files import FinishedPoint

RETIMING_TIMEOUT_S = 120.0
ASK_AGAIN_S = 0.25
FILES_TIMEOUT_S = 120.0
"""Beside the recorded time itself: a file of ten minutes at 10 kHz takes minutes to make."""


class ActionExecutor:
    """Carries out the sequencer's actions; knows nothing of what comes next.

    Args:
        campaign: what the campaign works with.
        results: where results are entered.
        finaliser: the process that writes the points' files.
    """

    def __init__(self, campaign: CampaignContext, results: PointResults, finaliser: Finaliser) -> None:
        self.campaign = campaign
        self.results = results
        self.requests = StationRequests(campaign.client)
        self.observer = Observer()
        self.move_target_m = 0.0
        """Where the last move goes (m)."""
        self.zeros = ZeroReturn()
        """What the sensors showed at rest, before and after this session's motion."""
        self.trouble: StopCause | None = None
        """Why the campaign's journal can no longer be written; None while it can."""
        self._finaliser = finaliser
        self._expected = expected_signature(campaign.matrix.specimen, PROOF_M, PROOF_SPEED_M_S)
        self._proof = self.observer.proof_watch(self._judge_damper), (0.0, 0.0)
        self._proof_leg = 0
        self._recorder: PointRecorder | None = None
        self._deadline: tuple[str, float, int, int] | None = None
        self._handed_in: dict[str, TestPoint] = {}
        self._ways: dict[type[act.Action], Callable[[Any], None]] = {
            act.Ask: self._ask,
            act.Move: self._move,
            act.SetCurrent: self._set_current,
            act.Start: self._start,
            act.Stop: self._stop,
            act.WatchZeros: self._watch_zeros,
            act.ProveSensors: self._prove_sensors,
            act.Rest: self._rest,
            act.AwaitStandstill: self._await_standstill,
            act.ReadTemperature: self._read_temperature,
            act.AwaitTemperature: self._await_temperature,
            act.BeginRecording: self._begin_recording,
            act.EndRecording: self._end_recording,
            act.DropRecording: self._drop_recording,
            act.Remark: self._remark,
            act.GiveUpPoint: self._give_up_point,
            act.Deadline: self._set_deadline,
            act.Note: self._tell,
            act.LeaveToStation: self._leave_to_station,
            act.Finish: self._finish,
        }

    def carry_out(self, action: act.Action) -> None:
        """Do one thing; returns without waiting for the rig. Whatever it raises is the caller's event."""
        self._ways[type(action)](action)

    def open_recorder(self) -> None:
        """Start recording's thread on the station's ring.

        Raises:
            RingProblem: the ring cannot be read.
        """
        self._recorder = PointRecorder(Path(self.campaign.config.ring_path), self.campaign.folder / "points")

    @property
    def recorder_trouble(self) -> StopCause | None:
        """Why nothing can be recorded any more; None while it can, or before it has to."""
        if self._recorder is None or self._recorder.healthy:
            return None
        failure = self._recorder.failure
        return because("task-dies" if failure is None else disk_slug(failure), "said", text=self._recorder.error)

    def overdue(self) -> str | None:
        """The phase whose deadline has just passed; said once."""
        if self._deadline is None:
            return None
        phase, device_s, earliest_ns, latest_ns = self._deadline
        now_ns = monotonic_ns()
        if now_ns < earliest_ns or (self.observer.device_s < device_s and now_ns < latest_ns):
            return None
        self._deadline = None
        return phase

    def note(self, event: str, **fields: object) -> None:
        """A line for the campaign's journal; a disk that refuses it becomes `trouble` and does not stop the loop."""
        try:
            self.campaign.log.write(event, **fields)
        except OSError as error:
            self.trouble = self.trouble or because(disk_slug(error), "said", text=f"{self.campaign.log.path}: {error}")

    def enter(self, finished: FinishedPoint) -> PointResult | None:
        """Enter what the finaliser says about a point; None when it was not handed in here."""
        point = self._handed_in.pop(finished.id, None)
        if point is None:
            if finished.error:
                self.note("warning", slug=finished.error_slug, text=f"{finished.id}: {finished.error}")
            return None
        if finished.error or not finished.file:
            return self._give_up(point, because("not-written", "said", text=finished.error))
        file = self.campaign.folder / "points" / finished.file
        result = self.results.judged(
            point, file, finished.verdict, finished.reasons, finished.lost_samples, finished.quality
        )
        self._announce(result)
        return result

    def collect_files(self, enough: Callable[[], bool]) -> None:
        """Wait for the files of the points that were recorded; the rig is at rest by now.

        Args:
            enough: asked again and again: whether the operator does not want to wait any longer.
        """
        recorded_s = sum(point.motion_s for point in self._handed_in.values())
        deadline_ns = monotonic_ns() + int(1e9 * (FILES_TIMEOUT_S + recorded_s))
        for name, point in tuple(self._handed_in.items()):
            while name in self._handed_in:
                try:
                    self.enter(self._finaliser.wait(name, ASK_AGAIN_S))
                except TimeoutError:
                    if enough() or monotonic_ns() > deadline_ns:
                        self._handed_in.pop(name)
                        self._give_up(point, because("not-written", "file-unfinished"))
        if self.results.complete and not enough():
            self._bring_to_one_skew(enough)

    def _bring_to_one_skew(self, enough: Callable[[], bool]) -> None:
        """All points together know the sensors' delays better than each alone; files certainly wrong are mended."""
        thread = ThreadPoolExecutor(1, thread_name_prefix="one-skew")
        try:
            waiting = thread.submit(self._finaliser.retime, self.campaign.folder / "points", RETIMING_TIMEOUT_S)
            while not waiting.done() and not enough():
                wait((waiting,), ASK_AGAIN_S)
            if not waiting.done():
                self.note("warning", text=say("own-skews", why="the operator did not wait"))
                return
            mended = waiting.result()
        except OSError as error:
            self.note("warning", text=say("own-skews", why=error))
            return
        finally:
            thread.shutdown(wait=False)
        for finished in mended:
            self.note(
                "retimed", file=finished.id, skew_s=finished.skew_s, skew_std_s=finished.skew_std_s,
                verdict=finished.verdict,
            )
            self.results.mended(Path(finished.file), finished.verdict, finished.reasons, finished.quality)

    def close(self) -> None:
        """Let go of the ring and the station; a point still open is closed as interrupted, where the disk allows it."""
        self.requests.close()
        if self._recorder is not None:
            try:
                self._recorder.close()
            except OSError as error:
                self.note("warning", text=say("recorder-left", error=error))

    def _ask(self, action: act.Ask) -> None:
        self.requests.ask(action.request)

    def _move(self, action: act.Move) -> None:
        self.move_target_m = action.target_m
        self.requests.ask(Request.MOVE, target_m=action.target_m, speed_m_s=self.campaign.centring_speed_m_s)

    def _set_current(self, action: act.SetCurrent) -> None:
        tolerance_A = self.campaign.matrix.campaign.current_settled_A
        self.observer.await_current(action.current_A, tolerance_A, monotonic_ns())
        self.requests.ask(Request.SET_CURRENT, current_A=action.current_A)

    def _start(self, action: act.Start) -> None:
        point = action.point
        self.observer.await_program(
            point.centre_m,
            monotonic_ns(),
            WantedMotion(point.waveform, point.frequency_Hz, self.campaign.bench.lvdt.rate_Hz),
            point.ramp_in_cycles + point.cycles + point.ramp_out_cycles,
        )
        self.requests.ask(
            Request.START,
            waveform=point.shape.controller,
            amplitude_m=point.amplitude_m,
            frequency_Hz=point.frequency_Hz,
            centre_m=point.centre_m,
            cycles=point.cycles,
            ramp_in_cycles=point.ramp_in_cycles,
            ramp_out_cycles=point.ramp_out_cycles,
            **({"table": point.shape.table_m(point.amplitude_m)} if point.shape.controller == "table" else {}),
        )

    def _stop(self, action: act.Stop) -> None:
        self.observer.await_nothing()
        self.requests.stop(kind=str(action.stop), reason=action.cause.slug, detail=action.cause.detail)

    def _prove_sensors(self, action: act.ProveSensors) -> None:
        observer, limits = self.observer, self.campaign.config.limits
        if action.leg == 0:
            start_m = observer.value(Channel.POSITION)
            targets = proof_targets(start_m, limits.position_min_m, limits.position_max_m)
            self._proof = observer.proof_watch(self._judge_damper), targets
        self._proof_leg = action.leg
        self.requests.ask(Request.MOVE, target_m=self._proof[1][action.leg], speed_m_s=PROOF_SPEED_M_S)

    def watch_proof(self, since_ns: int) -> None:
        """The station has begun one way of the proof move: wait for its end."""
        watch, targets = self._proof
        self.observer.await_proof(watch, targets[self._proof_leg], since_ns)

    def _watch_zeros(self, action: act.WatchZeros) -> None:
        self.observer.await_zeros(self._zeros_again if action.again else self._first_zeros)

    def _first_zeros(self, seen: AtRest) -> ev.Event:
        self.zeros.start = at_rest(seen)
        self.note("rest", which="start", **self.zeros.start.to_json())
        cause = judge_rest(seen, self.campaign.rest_limits)
        if cause is None:
            numbers = seen.numbers(self.campaign.bench.load_cell.range_N)
            self.campaign.at_rest = {**self._temperatures_at_rest(), **numbers}
        return ev.ZerosJudged(cause)

    def _temperatures_at_rest(self) -> dict[str, float]:
        """Coil and ECU (degC) before anything was warmed: those of the session's first rest; none where unknown."""
        names = {"rest_coil_degC": Channel.COIL_TEMPERATURE, "rest_ecu_degC": Channel.ECU_TEMPERATURE}
        if names.keys() <= self.campaign.at_rest.keys():
            return {name: self.campaign.at_rest[name] for name in names}
        temperatures = {name: self.observer.value(channel) for name, channel in names.items()}
        return temperatures if self.results.began_ns is None and all(map(math.isfinite, temperatures.values())) else {}

    def _zeros_again(self, seen: AtRest) -> ev.Event:
        self.zeros.end = at_rest(seen)
        self.note("rest", which="end", **self.zeros.end.to_json())
        return ev.ZerosReturned()

    def _judge_damper(self, up: Leg, down: Leg) -> StopCause | None:
        campaign = self.campaign
        signature, expected = measured_signature(up.force_N, down.force_N), self._expected
        if signature is None:
            signature = measured_signature(up.rest_force_N, down.rest_force_N)
        self.note("signature", found=str(signature), expected=str(expected), first=str(campaign.baseline.signature))
        temperature_degC = self.observer.value(Channel.COIL_TEMPERATURE)
        cause = judge_damper(signature, expected, campaign.baseline.signature)
        if cause is None and campaign.matrix.temperature is None and self.results.began_ns is None:
            # With a window every point finds its own temperature; after a restart the session's own points have warmed.
            cause = campaign.baseline.other_temperature(temperature_degC, campaign.stock.temperatures_degC)
        if cause is None and signature is not None:
            self._keep(signature, temperature_degC)
        return cause

    def _keep(self, signature: Signature, temperature_degC: float) -> None:
        try:
            self.campaign.baseline.keep(self.campaign.identities, signature, temperature_degC)
        except OSError as error:
            self.trouble = self.trouble or because(disk_slug(error), "said", text=f"baseline.json: {error}")

    def _rest(self, action: act.Rest) -> None:
        self.observer.await_rest(action.rest_s)

    def _read_temperature(self, action: act.ReadTemperature) -> None:
        self.observer.await_temperature(monotonic_ns())

    def _await_temperature(self, action: act.AwaitTemperature) -> None:
        self.observer.await_cooling(action.highest_degC)

    def _await_standstill(self, action: act.AwaitStandstill) -> None:
        self.observer.await_standstill()

    def _begin_recording(self, action: act.BeginRecording) -> None:
        if self._recorder is None:
            raise RecorderFailed("there is no recorder before the station is connected")
        point = action.point
        try:
            if action.attempt == 1:
                # What an earlier session left of the point makes room for this one's.
                set_aside(self.campaign.folder / "points", point.id, self.campaign.point_ids)
            expected_s = point.motion_s / self.campaign.bench.clock.device_rate
            context = self.campaign.context(point, action.attempt, action.commanded)
            self._recorder.begin(context, expected_s=expected_s)
        except Exception as error:
            self._give_up(point, cause_of(error))
            raise
        self.results.begun(monotonic_ns())
        self.note("point", point=point.id, attempt=action.attempt)

    def _end_recording(self, action: act.EndRecording) -> None:
        if self._recorder is None:
            raise RecorderFailed("there is no recorder before the station is connected")
        self.results.ended(action.point, monotonic_ns())
        try:
            journal = self._recorder.end(stopped_by=None if action.fault is None else action.fault.slug)
        except Exception as error:
            self._give_up(action.point, cause_of(error))
            raise
        self._handed_in[journal.id] = action.point
        self._finaliser.submit(journal)

    def _drop_recording(self, action: act.DropRecording) -> None:
        if self._recorder is None:
            raise RecorderFailed("there is no recorder before the station is connected")
        self._recorder.note(OUT_OF_TOLERANCE, action.reason, monotonic_ns())
        try:
            kept = kept_apart(self._recorder.end(), self.campaign.point_ids)
        except OSError as error:
            raise RecorderFailed(f"{self.campaign.folder / 'points'}: {error}") from error
        self._finaliser.submit(kept)
        text = say("dropped", kept=kept.id)
        self.note("dropped", point=action.point.id, kept=kept.id, text=text)

    def _remark(self, action: act.Remark) -> None:
        if self._recorder is not None:
            self._recorder.note(action.code, action.text, monotonic_ns())

    def _give_up_point(self, action: act.GiveUpPoint) -> None:
        self._give_up(action.point, action.cause)

    def _give_up(self, point: TestPoint, cause: StopCause) -> PointResult:
        result = self.results.given_up(point, cause)
        self._announce(result)
        return result

    def _announce(self, result: PointResult) -> None:
        self.note("judged", **result.to_json())
        self.campaign.display.point_done(result)

    def _set_deadline(self, action: act.Deadline) -> None:
        earliest_ns = monotonic_ns() + int(1e9 * action.wall_s)
        expected_s = action.device_s / self.campaign.bench.clock.device_rate
        latest_ns = earliest_ns + int(1e9 * action.patience * expected_s)
        self._deadline = (action.phase, self.observer.device_s + action.device_s, earliest_ns, latest_ns)

    def _tell(self, action: act.Note) -> None:
        about = {"code": action.code} if action.code else {}
        self.note(action.level, text=action.text, **about)
        self.campaign.display.message(action.level, action.text)
        if action.wait is not None:
            self.results.waits.append(action.wait)

    def _leave_to_station(self, action: act.LeaveToStation) -> None:
        self.requests.void()
        self.campaign.client.close(0.0)

    def _finish(self, action: act.Finish) -> None:
        self._deadline = None


def cause_of(error: Exception) -> StopCause:
    """Why an action failed, by the kind of its error."""
    slug = disk_slug(error) if isinstance(error, OSError) else "task-dies"
    return because(slug, "said", text=str(error) or type(error).__name__)


def disk_slug(error: BaseException) -> str:
    """The fault matrix's slug for an error of the disk: by its error number, also of what caused it."""
    link: BaseException | None = error
    while link is not None:
        number = link.errno if isinstance(link, OSError) else None
        if number in {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}:
            return "disk-full"
        if number in {errno.EROFS, errno.EACCES, errno.EPERM, errno.EEXIST, errno.ENOENT, errno.ENOTDIR}:
            return "dir-readonly"
        link = link.__cause__
    return "fsync-error"
