"""What actions do: requests to the station, the recorder, the finaliser, the journal, the display."""

from __future__ import annotations

import errno
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.ring import Channel
from rig.campaign import action as act
from rig.campaign import event as ev
from rig.campaign.action import Request
from rig.campaign.asker import Asker
from rig.campaign.cause import Cause
from rig.campaign.crew import Crew
from rig.campaign.ledger import Ledger
from rig.campaign.motion_seen import MotionWanted
from rig.campaign.observer import Observer
from rig.campaign.options import PointResult
from rig.campaign.preflight import AtRest, judge_rest
from rig.campaign.proof_move import PROOF_M, PROOF_SPEED_M_S, Leg, proof_targets
from rig.campaign.signature import Signature, expected_signature, judge_damper, measured_signature
from rig.campaign.zero_return import ZeroReturn, at_rest
from rig.clock import monotonic_ns
from rig.matrix.point import TestPoint
from rig.recording.conversion.finaliser import Finaliser
from rig.recording.conversion.recovery import set_aside
from rig.recording.journal.recorder import PointRecorder, RecorderFailed, kept_apart
from rig.recording.point_names import OUT_OF_TOLERANCE

if TYPE_CHECKING:
    from rig.recording.conversion.finished_point import FinishedPoint

RETIMING_TIMEOUT_S = 120.0
ASK_AGAIN_S = 0.25
FILES_TIMEOUT_S = 120.0
"""Beside the recorded time itself: a file of ten minutes at 10 kHz takes minutes to make."""


class Hands:
    """Carries out the sequencer's actions; knows nothing of what comes next.

    Args:
        crew: what the campaign works with.
        ledger: where results are entered.
        finaliser: the process that writes the points' files.
    """

    def __init__(self, crew: Crew, ledger: Ledger, finaliser: Finaliser) -> None:
        self.crew = crew
        self.ledger = ledger
        self.asker = Asker(crew.client)
        self.observer = Observer()
        self.move_target_m = 0.0
        """Where the last move goes (m)."""
        self.zeros = ZeroReturn()
        """What the sensors showed at rest, before and after this session's motion."""
        self.trouble: Cause | None = None
        """Why the campaign's journal can no longer be written; None while it can."""
        self._finaliser = finaliser
        self._expected = expected_signature(crew.matrix.specimen, PROOF_M, PROOF_SPEED_M_S)
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
        self._recorder = PointRecorder(Path(self.crew.config.ring_path), self.crew.folder / "points")

    @property
    def recorder_trouble(self) -> Cause | None:
        """Why nothing can be recorded any more; None while it can, or before it has to."""
        if self._recorder is None or self._recorder.healthy:
            return None
        failure = self._recorder.failure
        return Cause("task-dies" if failure is None else disk_slug(failure), self._recorder.error)

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
            self.crew.log.write(event, **fields)
        except OSError as error:
            self.trouble = self.trouble or Cause(disk_slug(error), f"{self.crew.log.path}: {error}")

    def enter(self, finished: FinishedPoint) -> PointResult | None:
        """Enter what the finaliser says about a point; None when it was not handed in here."""
        point = self._handed_in.pop(finished.id, None)
        if point is None:
            if finished.error:
                self.note("warning", slug=finished.error_slug, text=f"{finished.id}: {finished.error}")
            return None
        if finished.error or not finished.file:
            return self._give_up(point, Cause("not-written", finished.error))
        file = self.crew.folder / "points" / finished.file
        result = self.ledger.judged(
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
                        text = "its file is not finished; `rig recover` or resuming will finish it"
                        self._give_up(point, Cause("not-written", text))
        if self.ledger.complete and not enough():
            self._bring_to_one_skew(enough)

    def _bring_to_one_skew(self, enough: Callable[[], bool]) -> None:
        """All points together know the sensors' delays better than each alone; files certainly wrong are mended."""
        thread = ThreadPoolExecutor(1, thread_name_prefix="one-skew")
        try:
            waiting = thread.submit(self._finaliser.retime, self.crew.folder / "points", RETIMING_TIMEOUT_S)
            while not waiting.done() and not enough():
                wait((waiting,), ASK_AGAIN_S)
            if not waiting.done():
                self.note("warning", text="the points keep each its own skew: the operator did not wait")
                return
            mended = waiting.result()
        except OSError as error:
            self.note("warning", text=f"the points keep each its own skew: {error}")
            return
        finally:
            thread.shutdown(wait=False)
        for finished in mended:
            self.note(
                "retimed", file=finished.id, skew_s=finished.skew_s, skew_std_s=finished.skew_std_s,
                verdict=finished.verdict,
            )
            self.ledger.mended(Path(finished.file), finished.verdict, finished.reasons, finished.quality)

    def close(self) -> None:
        """Let go of the ring and the station; a point still open is closed as interrupted, where the disk allows it."""
        self.asker.close()
        if self._recorder is not None:
            try:
                self._recorder.close()
            except OSError as error:
                self.note("warning", text=f"the recorder: {error}; `rig recover` finishes what it left")

    def _ask(self, action: act.Ask) -> None:
        self.asker.ask(action.request)

    def _move(self, action: act.Move) -> None:
        self.move_target_m = action.target_m
        self.asker.ask(Request.MOVE, target_m=action.target_m, speed_m_s=self.crew.centring_speed_m_s)

    def _set_current(self, action: act.SetCurrent) -> None:
        tolerance_A = self.crew.matrix.campaign.current_settled_A
        self.observer.await_current(action.current_A, tolerance_A, monotonic_ns())
        self.asker.ask(Request.SET_CURRENT, current_A=action.current_A)

    def _start(self, action: act.Start) -> None:
        point = action.point
        self.observer.await_program(
            point.centre_m,
            monotonic_ns(),
            MotionWanted(point.waveform, point.frequency_Hz, self.crew.bench.lvdt.rate_Hz),
            point.ramp_in_cycles + point.cycles + point.ramp_out_cycles,
        )
        self.asker.ask(
            Request.START,
            waveform=point.waveform,
            amplitude_m=point.amplitude_m,
            frequency_Hz=point.frequency_Hz,
            centre_m=point.centre_m,
            cycles=point.cycles,
            ramp_in_cycles=point.ramp_in_cycles,
            ramp_out_cycles=point.ramp_out_cycles,
        )

    def _stop(self, action: act.Stop) -> None:
        self.observer.await_nothing()
        self.asker.stop(kind=str(action.stop), reason=action.cause.slug, detail=action.cause.detail)

    def _prove_sensors(self, action: act.ProveSensors) -> None:
        observer, limits = self.observer, self.crew.config.limits
        if action.leg == 0:
            start_m = observer.value(Channel.POSITION)
            targets = proof_targets(start_m, limits.position_min_m, limits.position_max_m)
            self._proof = observer.proof_watch(self._judge_damper), targets
        self._proof_leg = action.leg
        self.asker.ask(Request.MOVE, target_m=self._proof[1][action.leg], speed_m_s=PROOF_SPEED_M_S)

    def watch_proof(self, since_ns: int) -> None:
        """The station has begun one way of the proof move: wait for its end."""
        watch, targets = self._proof
        self.observer.await_proof(watch, targets[self._proof_leg], since_ns)

    def _watch_zeros(self, action: act.WatchZeros) -> None:
        self.observer.await_zeros(self._zeros_again if action.again else self._first_zeros)

    def _first_zeros(self, seen: AtRest) -> ev.Event:
        self.zeros.start = at_rest(seen)
        self.note("rest", which="start", **self.zeros.start.to_json())
        cause = judge_rest(seen, self.crew.rest_limits)
        if cause is None:
            self.crew.at_rest = {**self._temperatures_at_rest(), **seen.numbers(self.crew.bench.load_cell.range_N)}
        return ev.ZerosJudged(cause)

    def _temperatures_at_rest(self) -> dict[str, float]:
        """Coil and ECU (degC) before anything was warmed: those of the session's first rest; none where unknown."""
        names = {"rest_coil_degC": Channel.COIL_TEMPERATURE, "rest_ecu_degC": Channel.ECU_TEMPERATURE}
        if names.keys() <= self.crew.at_rest.keys():
            return {name: self.crew.at_rest[name] for name in names}
        found = {name: self.observer.value(channel) for name, channel in names.items()}
        return found if self.ledger.began_ns is None and all(map(math.isfinite, found.values())) else {}

    def _zeros_again(self, seen: AtRest) -> ev.Event:
        self.zeros.end = at_rest(seen)
        self.note("rest", which="end", **self.zeros.end.to_json())
        return ev.ZerosReturned()

    def _judge_damper(self, up: Leg, down: Leg) -> Cause | None:
        crew = self.crew
        found, expected = measured_signature(up.force_N, down.force_N), self._expected
        if found is None:
            found = measured_signature(up.rest_force_N, down.rest_force_N)
        self.note("signature", found=str(found), expected=str(expected), first=str(crew.baseline.signature))
        temperature_degC = self.observer.value(Channel.COIL_TEMPERATURE)
        cause = judge_damper(found, expected, crew.baseline.signature)
        if cause is None and crew.matrix.temperature is None and self.ledger.began_ns is None:
            # With a window every point finds its own temperature; after a restart the session's own points have warmed.
            cause = crew.baseline.other_temperature(temperature_degC, crew.stock.temperatures_degC)
        if cause is None and found is not None:
            self._keep(found, temperature_degC)
        return cause

    def _keep(self, signature: Signature, temperature_degC: float) -> None:
        try:
            self.crew.baseline.keep(self.crew.identities, signature, temperature_degC)
        except OSError as error:
            self.trouble = self.trouble or Cause(disk_slug(error), f"baseline.json: {error}")

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
                set_aside(self.crew.folder / "points", point.id, self.crew.point_ids)
            expected_s = point.motion_s / self.crew.bench.clock.device_rate
            context = self.crew.context(point, action.attempt, action.commanded)
            self._recorder.begin(context, expected_s=expected_s)
        except Exception as error:
            self._give_up(point, cause_of(error))
            raise
        self.ledger.begun(monotonic_ns())
        self.note("point", point=point.id, attempt=action.attempt)

    def _end_recording(self, action: act.EndRecording) -> None:
        if self._recorder is None:
            raise RecorderFailed("there is no recorder before the station is connected")
        self.ledger.ended(action.point, monotonic_ns())
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
            kept = kept_apart(self._recorder.end(), self.crew.point_ids)
        except OSError as error:
            raise RecorderFailed(f"{self.crew.folder / 'points'}: {error}") from error
        self._finaliser.submit(kept)
        text = f"the motion was not the wanted one; its record is kept as {kept.id}, the point is run again"
        self.note("dropped", point=action.point.id, kept=kept.id, text=text)

    def _remark(self, action: act.Remark) -> None:
        if self._recorder is not None:
            self._recorder.note(action.code, action.text, monotonic_ns())

    def _give_up_point(self, action: act.GiveUpPoint) -> None:
        self._give_up(action.point, action.cause)

    def _give_up(self, point: TestPoint, cause: Cause) -> PointResult:
        result = self.ledger.given_up(point, cause)
        self._announce(result)
        return result

    def _announce(self, result: PointResult) -> None:
        self.note("judged", **result.to_json())
        self.crew.display.point_done(result)

    def _set_deadline(self, action: act.Deadline) -> None:
        earliest_ns = monotonic_ns() + int(1e9 * action.wall_s)
        expected_s = action.device_s / self.crew.bench.clock.device_rate
        latest_ns = earliest_ns + int(1e9 * action.patience * expected_s)
        self._deadline = (action.phase, self.observer.device_s + action.device_s, earliest_ns, latest_ns)

    def _tell(self, action: act.Note) -> None:
        about = {"code": action.code} if action.code else {}
        self.note(action.level, text=action.text, **about)
        self.crew.display.message(action.level, action.text)
        if action.wait is not None:
            self.ledger.waits.append(action.wait)

    def _leave_to_station(self, action: act.LeaveToStation) -> None:
        self.asker.void()
        self.crew.client.close(0.0)

    def _finish(self, action: act.Finish) -> None:
        self._deadline = None


def cause_of(error: Exception) -> Cause:
    """Why an action failed, by the kind of its error."""
    slug = disk_slug(error) if isinstance(error, OSError) else "task-dies"
    return Cause(slug, str(error) or type(error).__name__)


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
