"""From ring records to facts: the conditions that the sequencer waits for, on the rig's own clocks.

The observer stores the last value of every channel and at most one condition. It reads no clock: the controller's clock
comes with its status (`device_us` of the channel STATE), arrival times with the records. The displacement of a program
is evaluated while it runs, and its cycles are compared with earlier ones.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Set
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import Channel
from drivers.roles import Input
from drivers.roles import State as ControllerState
from protocols.quality import Quality
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer.event import MeasuredMotion
from rig.recording.journal.ring_reader import RecordBlock
from rig.recording.ring_records import RECORD_DTYPE, good_values
from rig.signals.arrays import FloatArray
from rig.signals.clock_model import unwrapped
from rig.signals.cycles import measured_motion
from rig.signals.load_train import CURRENT_APART_A, EDGE_MODULUS, CycleTrack, LoadTrain
from rig.signals.waveform import HOLD, RECORD_NAMES
from rig.station.safe_stop import ZERO_CURRENT_A

_SATURATED = int(Input.VALVE_SATURATED)
MOVES = frozenset({ControllerState.MOVING, ControllerState.RUNNING})
ENDS = frozenset({ControllerState.FADING, ControllerState.HALTING})
SETTLED_SAMPLES = 3
AT_CENTRE_M = 0.5e-3
CURRENTS = 3
"""So many samples in a row show that a current flows: one may be noise."""
FRESH_TEMPERATURE_NS = 300_000_000
STILL_WINDOW_S = 0.3
STILL_M = 0.2e-3

SAMPLED = (*range(Channel.FORCE, Channel.AUXILIARY_7 + 1), Channel.COIL_CURRENT)
"""Channels of the sensors, and the coil current: what a point's measurement is made of."""

CYCLE_EDGES = {Channel.FORCE_EDGE: Channel.FORCE, Channel.DISPLACEMENT_EDGE: Channel.DISPLACEMENT}

LIVE = {
    "position_m": Channel.DISPLACEMENT,
    "force_N": Channel.FORCE,
    "current_A": Channel.COIL_CURRENT,
    "coil_temperature_degC": Channel.COIL_TEMPERATURE,
}
"""Last values for the display."""

Wait = Callable[[RecordBlock], ev.Event | None]


ENOUGH_SAMPLES_A_CYCLE = 500
"""More are thinned: the loop that watches the rig has no time to waste."""
MOST_SAMPLES = 10_000
"""Of a longer program the last ones are measured, twenty cycles or more: a cycle of 500 samples takes 10 ms."""


@dataclass(frozen=True)
class RequestedMotion:
    """What is to be measured: waveform, frequency (Hz), and the displacement sensor's nominal rate (Hz)."""

    waveform: str
    frequency_Hz: float
    rate_Hz: float


class MotionMeasurement:
    """Follows one program while it runs: what arrives is thinned at once, so that its end takes no time, however long.

    Args:
        wanted: the motion asked for.
    """

    def __init__(self, requested: RequestedMotion) -> None:
        self._requested = requested
        self._stride = max(1, int(requested.rate_Hz / (requested.frequency_Hz * ENOUGH_SAMPLES_A_CYCLE)))
        self._skip = 0
        self._parts: deque[bytes] = deque()
        self._kept = 0
        self._valve_saturated = False
        self._following_error_m = 0.0

    def add(self, block: RecordBlock) -> None:
        """Take new records of the ring, in the order of arrival, from the program's start on."""
        if Channel.DISPLACEMENT in block:
            samples = block.of(Channel.DISPLACEMENT)
            self._keep(samples[self._skip :: self._stride])
            self._skip = (self._skip - len(samples)) % self._stride
        if Channel.INPUTS in block:
            inputs = block.of(Channel.INPUTS)["value"].astype(np.int64)
            self._valve_saturated = self._valve_saturated or bool((inputs & _SATURATED).any())
        if Channel.SERVO_ERROR in block:
            largest_m = float(np.abs(block.of(Channel.SERVO_ERROR)["value"]).max())
            self._following_error_m = max(self._following_error_m, largest_m)

    def _keep(self, chosen: NDArray[Any]) -> None:
        self._parts.append(chosen.tobytes())
        self._kept += len(chosen)
        while self._kept - len(self._parts[0]) // RECORD_DTYPE.itemsize >= MOST_SAMPLES:
            self._kept -= len(self._parts.popleft()) // RECORD_DTYPE.itemsize

    def motion(self) -> MeasuredMotion | None:
        """The program's motion, of a very long one that of its last cycles.

        Returns:
            None when its waveform is none, when there is not one full cycle, or no two cycles beside the ones next to a
            ramp agree on one.
        """
        if self._kept == 0 or self._requested.waveform in {HOLD.name, *RECORD_NAMES}:
            return None
        samples, requested = np.frombuffer(b"".join(self._parts), RECORD_DTYPE), self._requested
        clocked = bool(np.all(samples["device_us"] >= 0))
        time_s = samples["device_us"] * 1e-6 if clocked else unwrapped(samples["sequence"]) / requested.rate_Hz
        order = np.concatenate(([True], np.diff(np.maximum.accumulate(time_s)) > 0))
        motion = measured_motion(time_s[order] - time_s[0], good_values(samples[order]), requested.waveform)
        if motion is None or not math.isfinite(motion.amplitude_m):
            return None
        return MeasuredMotion(
            amplitude_m=motion.amplitude_m, mean_m=motion.mean_m, valve_saturated=self._valve_saturated,
            following_error_m=self._following_error_m,
        )


@dataclass(frozen=True, eq=False)
class Rest:
    """A standstill: its begin by the controller's clock (s), and all records since then."""

    since_s: float
    parts: tuple[NDArray[Any], ...]


@dataclass
class Observer:
    """Turns records into at most one awaited fact at a time.

    Attributes:
        last: the last value of every channel seen, SI.
        last_host_ns: when that record arrived (monotonic ns).
        device_s: the controller's clock at its last status (s); 0 before the first one.
        held_ns: when the last status arrived if it says that the controller holds; else 0.
        cycles_done: whole cycles done of the program last awaited, ramps included; 0 until it was seen.
        program_ns: start of the program last awaited.
        kept: records of the program last awaited, if they were to be kept.
        ended_by: states in which the last motion was ended, `FADING` or `HALTING`; empty while it runs, and where it
            ended by itself.
        currents_A: arrival (ns) and value of the last measured currents.
        wait: what finds the awaited fact in new records; None while nothing is waited for.
        rest: the standstill that the last records established; None after any others.
        load_train_change: what the newest records tell of a load train that gives way; None where they do not.
    """

    last: dict[int, float] = field(default_factory=dict)
    last_host_ns: dict[int, int] = field(default_factory=dict)
    device_s: float = 0.0
    held_ns: int = 0
    cycles_done: int = 0
    program_ns: int = 0
    currents_A: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=CURRENTS))
    wait: Wait | None = None
    rest: Rest | None = None
    load_train_change: str | None = None
    ended_by: set[int] = field(default_factory=set)
    kept: list[NDArray[Any]] = field(default_factory=list)
    _load_train: LoadTrainWatch = field(default_factory=lambda: LoadTrainWatch())

    def observe(self, block: RecordBlock) -> ev.Event | None:
        """Take new records of the ring.

        Returns:
            The awaited fact when these records establish it; it is reported once.
        """
        self.load_train_change = self._load_train.watch(block)
        if len(block) == 0:
            return None
        self.rest = None
        newest = block.newest
        channels, arrived_ns = newest["channel"].tolist(), newest["host_ns"].tolist()
        self.last.update(zip(channels, newest["value"].tolist(), strict=True))
        self.last_host_ns.update(zip(channels, arrived_ns, strict=True))
        if Channel.COIL_CURRENT in block:
            samples = block.of(Channel.COIL_CURRENT)[-CURRENTS:]
            self.currents_A += zip(samples["host_ns"].tolist(), good_values(samples).tolist(), strict=True)
        if Channel.STATE in block:
            status = block.of(Channel.STATE)[-1]
            self._follow_motion(block.of(Channel.STATE)["value"].tolist())
            self.device_s = 1e-6 * int(status["device_us"])
            self.held_ns = int(status["host_ns"]) if status["value"] == ControllerState.HOLD else 0
        fact = None if self.wait is None else self.wait(block)
        if fact is not None:
            self.wait = None
        return fact

    def current_left_A(self, since_ns: int) -> float | None:
        """The newest current (A) if the last samples all show one; None: 0 A, or none arrived after `since_ns`."""
        known = [(arrived_ns, abs(value_A)) for arrived_ns, value_A in self.currents_A if math.isfinite(value_A)]
        if not known or known[-1][0] < since_ns or min(value_A for _, value_A in known) < ZERO_CURRENT_A:
            return None
        return known[-1][1]

    def _follow_motion(self, states: list[float]) -> None:
        for state in states:
            if state in MOVES:
                self.ended_by.clear()
            elif state in ENDS:
                self.ended_by.add(int(state))

    def await_centre(self, target_m: float, since_ns: int) -> None:
        """Wait for `Centred`: HOLD at `target_m` (m) in a status that arrived after `since_ns`."""

        def wait(block: RecordBlock) -> ev.Event | None:
            return ev.Centred() if self.held_ns > since_ns and self._near(target_m) else None

        self.wait = wait

    def await_program(
        self, centre_m: float, since_ns: int, requested: RequestedMotion, ordered_cycles: float, *, keep: bool = False
    ) -> None:
        """Wait for `ProgramEnded`: after `since_ns` the controller was seen running, and holds again.

        A caller that stops the rig from here first clears what is awaited (`wait`): a program that faded out, was
        halted, or did fewer than `ordered_cycles` (ramps included) while this is awaited was ended by another client.

        A program too short to be seen running is known by its cycle pulses. It has ended once every sensor was read
        after that: what a busy station had still to read belongs to the test. The `requested` motion is measured. With
        `keep`, all records until then are in `kept`: of a trial from which the next command is calculated.
        """
        pulses, held_ns, stopping, seen = self.last.get(Channel.PULSE, 0.0), 0, "", False
        self.cycles_done, self.program_ns = 0, since_ns
        self.kept.clear()
        self._load_train.begin()
        measurement = MotionMeasurement(requested)

        def wait(block: RecordBlock) -> ev.Event | None:
            nonlocal held_ns, stopping, seen
            states = set(_since(block.of(Channel.STATE), since_ns).tolist())
            stopping = stopping or _stopping(states)
            seen = seen or ControllerState.RUNNING in states or self.last.get(Channel.PULSE, 0.0) != pulses
            self.cycles_done = int(self.last.get(Channel.CYCLES_DONE, 0.0)) if seen else 0
            measurement.add(block)
            if keep and len(block):
                self.kept.append(block.records)
            holds = seen and self.held_ns > since_ns
            if holds and held_ns == 0:
                held_ns = self.held_ns
            if holds and self._read_since(held_ns):
                cut_short = stopping or self._cycles_missing(ordered_cycles)
                return ev.ProgramEnded(self._near(centre_m), measurement.motion(), cut_short)
            return None

        self.wait = wait

    @property
    def signal_s(self) -> float:
        """Time (s) since the start of the signal that was awaited last, by its newest set-point; 0 before the first."""
        recent = self.last_host_ns.get(Channel.SIGNAL_TIME, 0) >= self.program_ns
        return self.last.get(Channel.SIGNAL_TIME, 0.0) if recent else 0.0

    def await_current(self, target_A: float, tolerance_A: float, since_ns: int) -> None:
        """Wait for `CurrentSettled`: the newest three measured currents after `since_ns` are within `tolerance_A`."""
        newest = np.empty(0)

        def wait(block: RecordBlock) -> ev.Event | None:
            nonlocal newest
            measured_A = _since(block.of(Channel.COIL_CURRENT), since_ns)
            newest = np.concatenate((newest, measured_A))[-SETTLED_SAMPLES:]
            settled = len(newest) == SETTLED_SAMPLES and bool(np.all(np.abs(newest - target_A) <= tolerance_A))
            return ev.CurrentSettled() if settled else None

        self.wait = wait

    def await_temperature(self, now_ns: int) -> None:
        """Wait for `TemperatureRead`: a coil temperature that is at most 0.3 s old at `now_ns`, or the next one."""
        oldest_ns = now_ns - FRESH_TEMPERATURE_NS

        def wait(block: RecordBlock) -> ev.Event | None:
            if self.last_host_ns.get(Channel.COIL_TEMPERATURE, 0) < oldest_ns:
                return None
            return ev.TemperatureRead(self.last.get(Channel.COIL_TEMPERATURE, math.nan))

        self.wait = wait

    def await_cooling(self, highest_degC: float) -> None:
        """Wait for `CooledDown`: a coil temperature of at most `highest_degC`."""

        def wait(block: RecordBlock) -> ev.Event | None:
            temperatures = block.of(Channel.COIL_TEMPERATURE)["value"]
            return ev.CooledDown() if len(temperatures) and float(temperatures[-1]) <= highest_degC else None

        self.wait = wait

    def await_rest(self, rest_s: float) -> None:
        """Wait for `RestOver`: `rest_s` seconds of the controller's clock from its last status on."""
        until_s = self.device_s + rest_s

        def wait(block: RecordBlock) -> ev.Event | None:
            return ev.RestOver() if self.device_s >= until_s else None

        self.wait = wait

    def await_standstill(self) -> None:
        """Wait for `Standstill`: the controller's position within 0.2 mm for 0.3 s of its clock."""
        anchor_m, since_s = self.last.get(Channel.POSITION, math.nan), self.device_s
        parts: list[NDArray[Any]] = []

        def wait(block: RecordBlock) -> ev.Event | None:
            nonlocal anchor_m, since_s
            parts.append(block.records)
            for position_m in block.of(Channel.POSITION)["value"].tolist():
                if not abs(position_m - anchor_m) <= STILL_M:
                    anchor_m, since_s = position_m, self.device_s
                    parts.clear()
            if self.device_s < since_s + STILL_WINDOW_S:
                return None
            self.rest = Rest(since_s, tuple(parts))
            return ev.Standstill()

        self.wait = wait

    def _cycles_missing(self, ordered_cycles: float) -> str:
        done, ordered = self.cycles_done, math.floor(ordered_cycles + 1e-6)
        return f"{done} of {ordered} requested cycles completed" if done < ordered else ""

    def _read_since(self, host_ns: int) -> bool:
        return all(self.last_host_ns.get(channel, host_ns) >= host_ns for channel in SAMPLED)

    def _near(self, target_m: float) -> bool:
        return abs(self.last.get(Channel.POSITION, math.nan) - target_m) <= AT_CENTRE_M


class LoadTrainWatch:
    """Cuts the ring's records into cycles, by the pulse that every sensor latches in its own clock, and compares them.

    Cycles with lost samples are not compared.
    """

    def __init__(self) -> None:
        self._tracks = {
            channel: CycleTrack(_clocked) for channel in (Channel.FORCE, Channel.DISPLACEMENT, Channel.SERVO_ERROR)
        }
        self._load_train = LoadTrain()
        self._next: int | None = None
        self._current_A = math.nan

    def begin(self) -> None:
        """Another program begins: its first cycle rises from rest, and says nothing of the last one that came to it."""
        self._load_train.forget()
        self._next = None

    def watch(self, block: RecordBlock) -> str | None:
        """Take new records of the ring.

        Returns:
            What changed, when a cycle differs from those before it.
        """
        self._sort(block)
        while self._next is not None:
            force, displacement, servo_error = (track.between(self._next) for track in self._tracks.values())
            if force is None or displacement is None:
                if not self._overtaken(self._next):
                    return None
                self._load_train.forget()
                self._next += 1
                continue
            change = self._load_train.change(force, displacement, servo_error)
            self._next += 1
            for track in self._tracks.values():
                track.forget_before(self._next)
            if change is not None:
                return change
        return None

    def _sort(self, block: RecordBlock) -> None:
        for channel, track in self._tracks.items():
            if channel in block:
                track.take(block.of(channel).tobytes())
        for edge, channel in CYCLE_EDGES.items():
            for record in block.of(edge):
                self._tracks[channel].mark(int(record["sequence"]), float(record["device_us"]))
                if self._next is None:
                    self._next = int(record["sequence"]) % EDGE_MODULUS
        for record in block.of(Channel.PULSE):
            self._tracks[Channel.SERVO_ERROR].mark(int(record["value"]), float(record["device_us"]))
        commanded_A = block.of(Channel.COMMANDED_CURRENT)["value"]
        # What is measured beside the command has a detector of its own.
        measured_A = block.of(Channel.COIL_CURRENT)["value"]
        changed = bool((commanded_A != self._current_A).any())
        self._current_A = float(commanded_A[-1]) if changed else self._current_A
        if changed or (np.abs(measured_A - self._current_A) > CURRENT_APART_A).any():
            self._load_train.current_changed(self._current_A)

    def _overtaken(self, edge: int) -> bool:
        """The cycle from this edge on will not be completed: every channel is already at a later one."""
        newest = [next(reversed(self._tracks[channel].edges), None) for channel in CYCLE_EDGES.values()]
        ahead = [0 if last is None else (last - edge) % EDGE_MODULUS for last in newest]
        return all(1 < lead < EDGE_MODULUS // 2 for lead in ahead)


def _clocked(raw: bytearray) -> tuple[FloatArray, FloatArray]:
    """Device times (n,), us, and values (n,) of the good samples among raw records; one that waited in its port is."""
    records = np.frombuffer(raw, RECORD_DTYPE)
    good = np.isfinite(records["value"]) & ((records["flags"] & ~np.uint16(Quality.STALE)) == 0)
    records = records[good & (records["device_us"] >= 0)]
    return records["device_us"].astype(float), records["value"]


def _since(records: NDArray[Any], since_ns: int) -> NDArray[np.float64]:
    """Values of the records (n,) that arrived after `since_ns`."""
    values: NDArray[np.float64] = records["value"][records["host_ns"] > since_ns]
    return values


def _stopping(states: Set[float]) -> str:
    """How the controller says that it ends a program early; empty where it does not."""
    early = [state for state in (ControllerState.FADING, ControllerState.HALTING) if state in states]
    return f"the controller was {early[0].name}" if early else ""
