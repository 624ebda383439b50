"""Execution of actions: requests to the station, conditions for the observer, start and end of points.

`StationRequests` sends requests without waiting: one thread sends them, a second one lets stops overtake them.
"""

from __future__ import annotations

import base64
import queue
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rig.campaign.execution.campaign_context import CampaignContext
from rig.campaign.execution.drive_calculation import DriveCalculation
from rig.campaign.execution.observer import Observer, RequestedMotion
from rig.campaign.execution.point_recording import PointRecording
from rig.campaign.preflight.proof_move import PROOF_SPEED_M_S, Baseline, DamperCheck, ProofMove
from rig.campaign.preflight.rest_check import RestCheck
from rig.campaign.preflight.zero_return import ZeroReturn
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer.action import PROOF_WALL_S, Request
from rig.campaign.stop_cause import because
from rig.clock import monotonic_ns
from rig.matrix.feasibility import command_room
from rig.recording.conversion.finaliser import Finaliser
from rig.recording.journal.recorder import PointRecorder
from rig.signals.arrays import FloatArray
from rig.signals.record import STEP_S, Record
from rig.station.client import StationClient, StationLost, StationRefused
from rig.test_point import HYBRID, SIGNAL, TestPoint

CENTRING_SPEED_M_S = 0.05
CENTRING_SPEED_SHARE = 0.25
Answer = dict[str, Any]

# Request -> the station's name for it, its fixed arguments.
WAYS: dict[Request, tuple[str, dict[str, Any]]] = {
    Request.HYDRAULICS_OFF: ("hydraulics", {"level": "off"}),
    Request.HYDRAULICS_LOW: ("hydraulics", {"level": "low"}),
    Request.HYDRAULICS_ON: ("hydraulics", {"level": "on"}),
}
AFTER_DEADLINE_S = 5.0
"""An answer is waited for a little longer than the sequencer waits for it (wall s)."""


@dataclass(frozen=True)
class Outcome:
    """How a request ended: `error` is None when the station proved it, `answer` then holds its results."""

    request: Request
    answered_ns: int
    answer: Answer = field(default_factory=dict)
    error: StationRefused | StationLost | None = None


class StationRequests:
    """Asks the station one thing after the other; a stop overtakes everything and makes what was asked before void."""

    def __init__(self, client: StationClient) -> None:
        self._client = client
        self._outcomes: queue.SimpleQueue[tuple[int, Outcome]] = queue.SimpleQueue()
        self._era = 0
        self._ordinary = ThreadPoolExecutor(1, thread_name_prefix="ask")
        self._urgent = ThreadPoolExecutor(1, thread_name_prefix="ask-stop")

    def ask(self, request: Request, **arguments: object) -> None:
        """Ask for something; its outcome comes through `outcomes`."""
        self._ordinary.submit(self._carry_out, self._era, request, arguments)

    def stop(self, **arguments: object) -> None:
        """Ask for a stop at once; outcomes of whatever was asked before are dropped."""
        self.void()
        self._urgent.submit(self._carry_out, self._era, Request.STOP, arguments)

    def void(self) -> None:
        """Drop what was asked and is not answered: not yet sent requests are never sent."""
        self._era += 1

    def outcomes(self) -> list[Outcome]:
        """What was answered since the last call, oldest first."""
        taken: list[Outcome] = []
        while True:
            try:
                era, outcome = self._outcomes.get_nowait()
            except queue.Empty:
                return taken
            if era == self._era:
                taken.append(outcome)

    def close(self) -> None:
        """Send nothing more; does not wait for answers still under way."""
        self.void()
        self._ordinary.shutdown(wait=False, cancel_futures=True)
        self._urgent.shutdown(wait=False, cancel_futures=True)

    def _carry_out(self, era: int, request: Request, arguments: dict[str, object]) -> None:
        if era != self._era:
            return
        do, fixed = WAYS.get(request, (str(request), {}))
        timeout_s = PROOF_WALL_S[request] + AFTER_DEADLINE_S
        send: Callable[..., Answer] = self._client.request
        try:
            outcome = Outcome(request, 0, send(do, timeout_s=timeout_s, **fixed, **arguments))
        except (StationRefused, StationLost) as error:
            outcome = Outcome(request, 0, error=error)
        except (OSError, ValueError) as error:
            outcome = Outcome(request, 0, error=StationLost(f"{do}: {error}"))
        self._outcomes.put((era, Outcome(request, monotonic_ns(), outcome.answer, outcome.error)))


class ActionExecutor:
    """Carries out the sequencer's actions; knows nothing of what comes next.

    Args:
        campaign: what the campaign works with.
        finaliser: the process that writes the points' files.
        baseline: what the campaign's first session found.

    Attributes:
        observer: what finds the awaited facts.
        recording: what records the points.
        zeros: what the sensors showed at rest, before and after this session's motion.
        damper: what judges the damper by the proof move.
    """

    def __init__(self, campaign: CampaignContext, finaliser: Finaliser, baseline: Baseline) -> None:
        self.campaign = campaign
        self.observer = Observer()
        self.recording = PointRecording(campaign, finaliser)
        self.zeros = ZeroReturn()
        self.damper = DamperCheck(campaign, baseline, self.observer.last)
        self._requests = StationRequests(campaign.client)
        self._commands = DriveCalculation(campaign)
        self._rest = RestCheck(campaign, self.observer, self.zeros)
        self._proof = ProofMove(self.observer, self.damper.check)
        self._baseline = baseline
        self._when_moving: Callable[[int], None] | None = None
        self._deadline: tuple[str, float, int, int] | None = None
        self._ways: dict[type[act.Action], Callable[[Any], None]] = {
            act.Ask: self._ask,
            act.Move: self._move,
            act.SetCurrent: self._set_current,
            act.AskOperator: self._ask_operator,
            act.Start: self._start,
            act.Iterate: self._iterate,
            act.Stop: self._stop,
            act.WatchZeros: self._watch_zeros,
            act.ProveSensors: self._prove_sensors,
            act.Rest: self._await_rest,
            act.AwaitStandstill: self._await_standstill,
            act.ReadTemperature: self._read_temperature,
            act.AwaitTemperature: self._await_temperature,
            act.BeginRecording: self.recording.begin,
            act.EndRecording: self.recording.end,
            act.DropRecording: self.recording.drop,
            act.Remark: self.recording.remark,
            act.GiveUpPoint: self._give_up_point,
            act.Withdraw: self.recording.withdraw,
            act.Deadline: self._set_deadline,
            act.Note: self._report,
            act.LeaveToStation: self._leave_to_station,
            act.Finish: self._finish,
        }

    def carry_out(self, action: act.Action) -> None:
        """Do one thing; returns without waiting for the rig. Whatever it raises is the caller's event."""
        self._ways[type(action)](action)

    def outcomes(self) -> tuple[list[Outcome], list[ev.Event]]:
        """What the station has answered, and that the phase's deadline has passed; each is said once."""
        overdue: list[ev.Event] = []
        if self._deadline is not None:
            phase, device_s, earliest_ns, latest_ns = self._deadline
            now_ns = monotonic_ns()
            if now_ns >= earliest_ns and (self.observer.device_s >= device_s or now_ns >= latest_ns):
                self._deadline = None
                overdue.append(ev.TimedOut(phase))
        return self._requests.outcomes(), overdue

    def answered(self, outcome: Outcome, *, moves: bool) -> ev.Event:
        """An answer as the sequencer's event; what it sets going is waited for from now on.

        Args:
            outcome: how a request ended.
            moves: the campaign waits for a slow move.

        Raises:
            RingProblem: the station is connected, but its ring cannot be read.
        """
        request, error = outcome.request, outcome.error
        if isinstance(error, StationLost):
            return ev.StationGone(str(error))
        if error is not None:
            return ev.Declined(request, because(error.slug, "said", text=error.message))
        if request is Request.CONNECT:
            campaign = self.campaign
            campaign.channels.update(outcome.answer.pop("channels", {}))
            campaign.identities.update(outcome.answer)
            campaign.log.note("connected", **outcome.answer)
            self.recording.recorder = PointRecorder(Path(campaign.config.ring_path), campaign.files.points)
            other = self._baseline.other_device(outcome.answer)
            if other is not None:
                return ev.Declined(request, other)
        elif request is Request.MOVE and moves and self._when_moving is not None:
            self._when_moving(outcome.answered_ns)
        return ev.Done(request)

    def close(self) -> None:
        """Let go of the ring and the station; a point still open is closed as interrupted, where the disk allows it."""
        self._requests.close()
        self._commands.close()
        self.recording.close()

    def _ask(self, action: act.Ask) -> None:
        self._requests.ask(action.request)

    def _move(self, action: act.Move) -> None:
        speed_m_s = min(CENTRING_SPEED_M_S, CENTRING_SPEED_SHARE * self.campaign.bench.limits.speed_m_s)
        self._when_moving = partial(self.observer.await_centre, action.target_m)
        self._requests.ask(Request.MOVE, target_m=action.target_m, speed_m_s=speed_m_s)

    def _set_current(self, action: act.SetCurrent) -> None:
        tolerance_A = self.campaign.matrix.campaign.current_settled_A
        self.observer.await_current(action.current_A, tolerance_A, monotonic_ns())
        self._requests.ask(Request.SET_CURRENT, current_A=action.current_A)

    def _ask_operator(self, action: act.AskOperator) -> None:
        if self.campaign.hand is not None:
            self.campaign.hand.ask(action.current_A)

    def operator_answers(self) -> list[ev.Event]:
        """What the operator who sets the current has confirmed since the last call.

        Raises:
            OSError: the terminal is gone.
        """
        hand = self.campaign.hand
        return [ev.OperatorAnswered()] if hand is not None and hand.answered() else []

    def _start(self, action: act.Start) -> None:
        point = action.point
        self.observer.await_program(
            point.centre_m,
            monotonic_ns(),
            RequestedMotion(point.waveform, point.frequency_Hz, self.campaign.bench.lvdt.rate_Hz),
            1.0 if point.record is not None else point.ramp_in_cycles + point.cycles + point.ramp_out_cycles,
            keep=point.kind == SIGNAL and self.campaign.matrix.sweep.iterate is not None,
        )
        if point.kind == HYBRID:
            self._requests.ask(Request.START, hybrid=hybrid_order(self.campaign, point))
            return
        steps: dict[str, Any] = {}
        if point.current_programmed:
            times_s, currents_A = zip(*point.steps_in_motion, strict=True)
            steps["current"] = {"time_s": list(times_s), "current_A": list(currents_A)}
        if point.record_samples is not None:
            self._requests.ask(Request.START, signal=signal_order(point, point.record_samples), **steps)
            return
        self._requests.ask(
            Request.START,
            waveform=point.shape.controller,
            amplitude_m=point.amplitude_m,
            frequency_Hz=point.frequency_Hz,
            centre_m=point.centre_m,
            cycles=point.cycles,
            ramp_in_cycles=point.ramp_in_cycles,
            ramp_out_cycles=point.ramp_out_cycles,
            **({"table": point.shape.table_m(point.amplitude_m)} if point.shape.controller == "table" else {}),
            **steps,
        )

    def _iterate(self, action: act.Iterate) -> None:
        self._commands.begin(action, self.observer.kept)

    def next_commands(self) -> list[ev.Event]:
        """The command of an iterated signal that was calculated since the last call."""
        return self._commands.events()

    def _stop(self, action: act.Stop) -> None:
        self.observer.wait = None
        self._requests.stop(kind=str(action.stop), reason=action.cause.slug, detail=action.cause.detail)

    def _prove_sensors(self, action: act.ProveSensors) -> None:
        limits = self.campaign.config.limits
        target_m = self._proof.target(action.leg, limits.position_min_m, limits.position_max_m)
        self._when_moving = partial(self._proof.watch, target_m)
        self._requests.ask(Request.MOVE, target_m=target_m, speed_m_s=PROOF_SPEED_M_S)

    def _watch_zeros(self, action: act.WatchZeros) -> None:
        self._rest.begin(again=action.again)

    def _await_rest(self, action: act.Rest) -> None:
        self.observer.await_rest(action.rest_s)

    def _read_temperature(self, action: act.ReadTemperature) -> None:
        self.observer.await_temperature(monotonic_ns())

    def _await_temperature(self, action: act.AwaitTemperature) -> None:
        self.observer.await_cooling(action.highest_degC)

    def _await_standstill(self, action: act.AwaitStandstill) -> None:
        self.observer.await_standstill()

    def _give_up_point(self, action: act.GiveUpPoint) -> None:
        self.recording.give_up(action.point, action.cause)

    def _set_deadline(self, action: act.Deadline) -> None:
        earliest_ns = monotonic_ns() + int(1e9 * action.wall_s)
        expected_s = action.device_s / self.campaign.bench.clock.device_rate
        latest_ns = earliest_ns + int(1e9 * action.patience * expected_s)
        self._deadline = (action.phase, self.observer.device_s + action.device_s, earliest_ns, latest_ns)

    def _report(self, action: act.Note) -> None:
        about = {name: value for name, value in (("code", action.code), ("stop", action.stop)) if value}
        self.campaign.log.note(action.level, text=action.text, **about)
        self.campaign.display.message(action.level, action.text)
        if action.wait is not None:
            self.campaign.results.waits.append(action.wait)

    def _leave_to_station(self, action: act.LeaveToStation) -> None:
        self._requests.void()
        self.campaign.client.close(0.0)

    def _finish(self, action: act.Finish) -> None:
        self._deadline = None


SENT_EVERY = 4
"""Samples of a record: between two of those that are sent the station goes along a cubic."""


def signal_order(point: TestPoint, record: Record) -> dict[str, Any]:
    """What the station is told of a point whose motion is a record."""
    order = {
        "step_s": SENT_EVERY * STEP_S, "centre_m": point.centre_m, "samples": _samples(record, point.amplitude_m),
    }
    target = point.target
    if target is not None:
        order["target"] = _samples(target, target.amplitude_m)
    if record.force is not None:
        force_N = record.force.force_N
        last = [] if (len(force_N) - 1) % SENT_EVERY == 0 else [force_N[-1:]]
        order["force"] = _packed(force_N[::SENT_EVERY], *last)
    return order


def _samples(record: Record, amplitude_m: float) -> str:
    position_m, velocity_m_s, _ = record.motion(amplitude_m, SENT_EVERY)
    if (len(record.shape) - 1) % SENT_EVERY:  # its last sample, at rest at the centre, is none of them
        position_m, velocity_m_s = np.append(position_m, 0.0), np.append(velocity_m_s, 0.0)
    return _packed(position_m, velocity_m_s)


def _packed(*parts: FloatArray) -> str:
    return base64.b64encode(np.concatenate(parts).astype("<f4").tobytes()).decode()


def hybrid_order(campaign: CampaignContext, point: TestPoint) -> dict[str, Any]:
    """What the station is told of a hybrid test.

    Raises:
        RuntimeError: the matrix has none.
    """
    matrix, assumed = campaign.matrix, campaign.matrix.specimen.assumed
    if matrix.hybrid is None or assumed is None:
        raise RuntimeError(f"{point.id}: the matrix does not define a hybrid test")
    low_m, high_m, _ = command_room(matrix, campaign.bench)
    return matrix.hybrid.order(point, assumed, campaign.bench, (low_m, high_m)).to_json()
