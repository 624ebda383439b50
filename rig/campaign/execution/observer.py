"""From ring records to facts: what the sequencer waits for is found here, on the rig's own clocks.

The observer keeps the last value of every channel and at most one thing that is waited for. It reads no clock: the
controller's clock comes with its status (`device_us` of the channel STATE), arrival times with the records.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import Channel
from drivers.roles import State as ControllerState
from protocols.quality import NO_VALUE
from rig.campaign.execution.motion_measurement import MotionMeasurement, WantedMotion
from rig.campaign.preflight.proof_move import DamperJudge, ProofWatch
from rig.campaign.preflight.rest_check import AtRest
from rig.campaign.sequencer import event as ev

SETTLED_SAMPLES = 3
AT_CENTRE_M = 0.5e-3
REST_WINDOW_S = 0.5
FRESH_TEMPERATURE_NS = 300_000_000
STILL_WINDOW_S = 0.3
STILL_M = 0.2e-3

SAMPLED = (*range(Channel.FORCE, Channel.AUXILIARY_7 + 1), Channel.COIL_CURRENT)
"""Channels of the sensors, and the coil current: what a point's measurement is made of."""

LIVE = {
    "position_m": Channel.DISPLACEMENT,
    "force_N": Channel.FORCE,
    "current_A": Channel.COIL_CURRENT,
    "coil_temperature_degC": Channel.COIL_TEMPERATURE,
}

Wait = Callable[[NDArray[Any]], ev.Event | None]


STATUSES_AT_REST = 10
"""A fast rig's window is over after one or two, which say little of the controller's own noisy force input."""
AT_REST = (
    Channel.FORCE, Channel.DISPLACEMENT, Channel.POSITION, Channel.CONTROLLER_FORCE, Channel.COIL_CURRENT,
)


class Observer:
    """Turns records into at most one awaited fact at a time."""

    def __init__(self) -> None:
        self._last: dict[int, float] = {}
        self._last_host_ns: dict[int, int] = {}
        self._wait: Wait | None = None
        self._program_seen = False
        self.device_s = 0.0
        """The controller's clock at its last status (s); 0 before the first one."""

    def observe(self, records: NDArray[Any]) -> ev.Event | None:
        """Take new records of the ring.

        Args:
            records: (n,) of the ring's record type, oldest first.

        Returns:
            The awaited fact when these records establish it; it is reported once.
        """
        if len(records) == 0:
            return None
        channels = records["channel"]
        for channel in np.unique(channels).tolist():
            newest = records[np.flatnonzero(channels == channel)[-1]]
            self._last[channel] = float(newest["value"])
            self._last_host_ns[channel] = int(newest["host_ns"])
            if channel == Channel.STATE:
                self.device_s = 1e-6 * int(newest["device_us"])
        fact = None if self._wait is None else self._wait(records)
        if fact is not None:
            self._wait = None
        return fact

    def value(self, channel: Channel, default: float = float("nan")) -> float:
        """Last value of a channel, SI; `default` before its first record."""
        return self._last.get(channel, default)

    def last_host_ns(self, channel: Channel) -> int | None:
        """When the last record of a channel arrived (monotonic ns); None before the first."""
        return self._last_host_ns.get(channel)

    @property
    def cycles_done(self) -> int:
        """Whole cycles done of the program last awaited, ramps included; 0 until it was seen."""
        return int(self.value(Channel.CYCLES_DONE, 0.0)) if self._program_seen else 0

    def live(self) -> dict[str, float]:
        """Last values for the display, by name, those known."""
        return {name: self._last[channel] for name, channel in LIVE.items() if channel in self._last}

    def await_nothing(self) -> None:
        """Forget what was waited for."""
        self._wait = None

    def await_centre(self, target_m: float, since_ns: int) -> None:
        """Wait for `Centred`: HOLD at `target_m` (m) in a status that arrived after `since_ns`."""

        def wait(records: NDArray[Any]) -> ev.Event | None:
            return ev.Centred() if self._holds(since_ns) and self._near(target_m) else None

        self._wait = wait

    def await_program(self, centre_m: float, since_ns: int, wanted: WantedMotion, ordered_cycles: float) -> None:
        """Wait for `ProgramEnded`: after `since_ns` the controller was seen running, and holds again.

        Whoever stops the rig from here forgets what is awaited first (`await_nothing`): a program that faded out, was
        halted, or did fewer than `ordered_cycles` (ramps included) while this is awaited was ended by somebody else.

        A program too short to be seen running is known by its cycle pulses. It has ended once every sensor was read
        after that: what a busy station had still to read belongs to the test. The `wanted` motion is measured.
        """
        pulses, held_ns, stopping = self.value(Channel.PULSE, 0.0), 0, ""
        self._program_seen = False
        measurement = MotionMeasurement(wanted)

        def wait(records: NDArray[Any]) -> ev.Event | None:
            nonlocal held_ns, stopping
            states = records["value"][(records["channel"] == Channel.STATE) & (records["host_ns"] > since_ns)]
            stopping = stopping or _stopping(states)
            seen = bool(np.any(states == ControllerState.RUNNING)) or self.value(Channel.PULSE, 0.0) != pulses
            self._program_seen = self._program_seen or seen
            measurement.add(records)
            holds = self._program_seen and self._holds(since_ns)
            if holds and held_ns == 0:
                held_ns = self._last_host_ns[Channel.STATE]
            if holds and self._read_since(held_ns):
                cut_short = stopping or self._cycles_missing(ordered_cycles)
                return ev.ProgramEnded(self._near(centre_m), measurement.motion(), cut_short)
            return None

        self._wait = wait

    def await_current(self, target_A: float, tolerance_A: float, since_ns: int) -> None:
        """Wait for `CurrentSettled`: the newest three measured currents after `since_ns` are within `tolerance_A`."""
        newest = np.empty(0)

        def wait(records: NDArray[Any]) -> ev.Event | None:
            nonlocal newest
            chosen = (records["channel"] == Channel.COIL_CURRENT) & (records["host_ns"] > since_ns)
            newest = np.concatenate((newest, records["value"][chosen]))[-SETTLED_SAMPLES:]
            settled = len(newest) == SETTLED_SAMPLES and bool(np.all(np.abs(newest - target_A) <= tolerance_A))
            return ev.CurrentSettled() if settled else None

        self._wait = wait

    def await_temperature(self, now_ns: int) -> None:
        """Wait for `TemperatureRead`: a coil temperature that is at most 0.3 s old at `now_ns`, or the next one."""
        oldest_ns = now_ns - FRESH_TEMPERATURE_NS

        def wait(records: NDArray[Any]) -> ev.Event | None:
            if self._last_host_ns.get(Channel.COIL_TEMPERATURE, 0) < oldest_ns:
                return None
            return ev.TemperatureRead(self.value(Channel.COIL_TEMPERATURE))

        self._wait = wait

    def await_cooling(self, highest_degC: float) -> None:
        """Wait for `CooledDown`: a coil temperature of at most `highest_degC`."""

        def wait(records: NDArray[Any]) -> ev.Event | None:
            temperatures = records["value"][records["channel"] == Channel.COIL_TEMPERATURE]
            return ev.CooledDown() if len(temperatures) and float(temperatures[-1]) <= highest_degC else None

        self._wait = wait

    def await_rest(self, rest_s: float) -> None:
        """Wait for `RestOver`: `rest_s` seconds of the controller's clock from its last status on."""
        until_s = self.device_s + rest_s

        def wait(records: NDArray[Any]) -> ev.Event | None:
            return ev.RestOver() if self.device_s >= until_s else None

        self._wait = wait

    def await_standstill(self) -> None:
        """Wait for `Standstill`: the controller's position within 0.2 mm for 0.3 s of its clock."""
        anchor_m, since_s = self.value(Channel.POSITION), self.device_s

        def wait(records: NDArray[Any]) -> ev.Event | None:
            nonlocal anchor_m, since_s
            for position_m in records["value"][records["channel"] == Channel.POSITION].tolist():
                if not abs(position_m - anchor_m) <= STILL_M:
                    anchor_m, since_s = position_m, self.device_s
            return ev.Standstill() if self.device_s >= since_s + STILL_WINDOW_S else None

        self._wait = wait

    def await_proof(self, watch: ProofWatch, target_m: float, since_ns: int) -> None:
        """Wait for `ProofLegDone` or `ProofJudged`: one way of the proof move, to `target_m` (m)."""
        self._wait = watch.leg(target_m, since_ns)

    def proof_watch(self, damper: DamperJudge) -> ProofWatch:
        """A fresh watch for a proof move; `damper` judges both ways once the sensors are proved."""
        return ProofWatch(
            lambda at_m, since_ns: self._holds(since_ns) and self._near(at_m), lambda: self.device_s, damper
        )

    def await_zeros(self, judge: Callable[[AtRest], ev.Event]) -> None:
        """Wait for what `judge` says of the next 0.5 s of the controller's clock, ten statuses at the least."""
        until_s = self.device_s + REST_WINDOW_S if self.device_s else math.nan
        parts: list[NDArray[Any]] = []

        def wait(records: NDArray[Any]) -> ev.Event | None:
            nonlocal until_s
            parts.append(records)
            if math.isnan(until_s) and self.device_s:
                # The first status since the station was connected: the window begins with it.
                until_s = self.device_s + REST_WINDOW_S
            if not self.device_s >= until_s:
                return None
            window = np.concatenate(parts)
            if np.count_nonzero(window["channel"] == Channel.CONTROLLER_FORCE) < STATUSES_AT_REST:
                return None
            values = {
                channel: window["value"][window["channel"] == channel].astype(np.float64) for channel in AT_REST
            }
            flagged = (
                int(np.count_nonzero(window["flags"][window["channel"] == channel] & int(NO_VALUE)))
                for channel in (Channel.FORCE, Channel.DISPLACEMENT)
            )
            force, displacement = flagged
            seen = AtRest(
                values[Channel.FORCE], values[Channel.DISPLACEMENT], values[Channel.POSITION],
                values[Channel.CONTROLLER_FORCE], force, displacement, values[Channel.COIL_CURRENT],
            )
            return judge(seen)

        self._wait = wait

    def _cycles_missing(self, ordered_cycles: float) -> str:
        done, ordered = self.cycles_done, math.floor(ordered_cycles + 1e-6)
        return f"{done} of {ordered} ordered cycles done" if done < ordered else ""

    def _holds(self, since_ns: int) -> bool:
        newer = self._last_host_ns.get(Channel.STATE, 0) > since_ns
        return newer and self._last.get(Channel.STATE) == ControllerState.HOLD

    def _read_since(self, host_ns: int) -> bool:
        return all(self._last_host_ns.get(channel, host_ns) >= host_ns for channel in SAMPLED)

    def _near(self, target_m: float) -> bool:
        return abs(self.value(Channel.POSITION) - target_m) <= AT_CENTRE_M


def _stopping(states: NDArray[np.float64]) -> str:
    """How the controller says that it ends a program early; empty where it does not."""
    early = [state for state in (ControllerState.FADING, ControllerState.HALTING) if np.any(states == state)]
    return f"the controller was {early[0].name}" if early else ""
