"""What a resting rig must show before it is armed (rows `not-tared`, `sensors-swapped`): values in, verdict out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import Channel
from protocols.quality import NO_VALUE
from rig.bench.model import CHANGE_OF_ZERO, Bench
from rig.bench.settings import StationConfig
from rig.campaign.execution.campaign_context import CampaignContext
from rig.campaign.execution.observer import Observer
from rig.campaign.sequencer import event as ev
from rig.campaign.stop_cause import StopCause, because
from rig.matrix.plan import Plan
from rig.recording.journal.ring_reader import RecordBlock
from rig.recording.quality.point_quality import Tolerances
from rig.signals.estimate import Estimate

FEWEST_SAMPLES = 10
REST_FORCE_SHARE = 0.20
REST_FORCE_NOISE_SHARE = 0.02
REST_DISPLACEMENT_NOISE_M = 0.5e-3
MIRRORED_SHARE = 0.05
CONTROLLER_NOISE_SHARE = 0.001
"""Of the load cell's range: what a single reading of the controller's coarse force input is taken to scatter by."""
FEWEST_FOR_SCATTER = 5
SURE = 5.0
"""Standard errors by which a difference at rest is more than noise."""
BLOCKS = 5
REST_WINDOW_S = 0.5
STATUSES_AT_REST = 10
"""A fast rig's window is over after one or two, which say little of the controller's own noisy force input."""
CURRENT_NOISE_A = 0.002


@dataclass(frozen=True)
class RestLimits:
    """What is compared with what.

    Attributes:
        force_N: the bench's force limit; a damper at rest shows its gas force, not more than a fifth of this.
        position_min_m: lower stroke limit (m).
        position_max_m: upper stroke limit (m).
        disagreement_m: how far host LVDT and controller position may be apart (m).
        range_N: the load cell's range.
        zero_N: how far load cell and the controller's own force input may be apart, in proportion to the test's force.
        current_zero_A: what the ECU may report while its output stage is off.
        force_per_wire, displacement_per_wire: SI units per unit on the wire of load cell (N) and LVDT (m).
        force_offset_N, displacement_offset_m: what they show at zero.
    """

    force_N: float
    position_min_m: float
    position_max_m: float
    disagreement_m: float
    range_N: float
    zero_N: float
    current_zero_A: float
    force_per_wire: float
    displacement_per_wire: float
    force_offset_N: float
    displacement_offset_m: float


def tolerances_of(bench: Bench, plan: Plan) -> Tolerances:
    """What two instruments of the bench may differ by; zeros in proportion to the largest force of the matrix."""
    checks = bench.checks
    predicted_N = [item.predicted_force_N for item in plan.points if item.predicted_force_N is not None]
    zero_N = checks.zero_N(bench.load_cell.range_N, max(predicted_N, default=None))
    return Tolerances(
        force_gain=checks.force_gain, displacement_gain=checks.displacement_gain, force_zero_N=zero_N,
        force_zero_change_N=CHANGE_OF_ZERO * zero_N, displacement_zero_m=checks.displacement_zero_m,
        time_s=checks.time_s, current_zero_A=checks.current_zero_A,
    )


def rest_limits(bench: Bench, config: StationConfig, zero_N: float) -> RestLimits:
    """What a resting rig is compared with; `zero_N` is the tolerance between the two force inputs."""
    return RestLimits(
        force_N=config.limits.force_N,
        position_min_m=bench.limits.position_m[0],
        position_max_m=bench.limits.position_m[1],
        disagreement_m=config.disagreement_m,
        range_N=bench.load_cell.range_N,
        zero_N=zero_N,
        current_zero_A=bench.checks.current_zero_A,
        force_per_wire=bench.load_cell.sensitivity,
        displacement_per_wire=bench.lvdt.sensitivity,
        force_offset_N=bench.load_cell.offset,
        displacement_offset_m=bench.lvdt.offset,
    )


@dataclass(frozen=True)
class AtRest:
    """Samples of the rest window.

    Attributes:
        force_N: of the load cell, (n,).
        displacement_m: of the LVDT, (m,).
        position_m: the controller's own position, (k,).
        controller_force_N: the controller's own coarse force input, (k,).
        force_flagged, displacement_flagged: how many samples the sensor itself says are overloaded, faulty or none.
        current_A: what the ECU reports of the coil, whose output stage is off, (j,).
    """

    force_N: NDArray[np.float64]
    displacement_m: NDArray[np.float64]
    position_m: NDArray[np.float64]
    controller_force_N: NDArray[np.float64]
    force_flagged: int = 0
    displacement_flagged: int = 0
    current_A: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, window: NDArray[Any]) -> AtRest:
        """Of the records (n,) of a rest window."""
        channels = (
            Channel.FORCE, Channel.DISPLACEMENT, Channel.POSITION, Channel.CONTROLLER_FORCE, Channel.COIL_CURRENT,
        )
        force_N, displacement_m, position_m, controller_force_N, current_A = (
            window["value"][window["channel"] == channel].astype(np.float64) for channel in channels
        )
        force_flagged, displacement_flagged = (
            int(np.count_nonzero(window["flags"][window["channel"] == channel] & int(NO_VALUE)))
            for channel in (Channel.FORCE, Channel.DISPLACEMENT)
        )
        return cls(
            force_N, displacement_m, position_m, controller_force_N, force_flagged, displacement_flagged, current_A
        )

    def exchanged(self, limits: RestLimits) -> AtRest:
        """What the same bytes mean when each port carries the other sensor."""
        force_wire = (self.force_N + limits.force_offset_N) / limits.force_per_wire
        displacement_wire = (self.displacement_m + limits.displacement_offset_m) / limits.displacement_per_wire
        return AtRest(
            displacement_wire * limits.force_per_wire - limits.force_offset_N,
            force_wire * limits.displacement_per_wire - limits.displacement_offset_m,
            self.position_m,
            self.controller_force_N,
            current_A=self.current_A,
        )

    @property
    def force_zero(self) -> Estimate:
        """The load cell's mean (N); its standard error from blocks of the window, which see drift and hum too."""
        return _mean(self.force_N, 0.0)

    def force_difference(self, range_N: float) -> Estimate:
        """By how much the load cell shows more than the controller's own force input (N)."""
        floor_N = CONTROLLER_NOISE_SHARE * range_N if len(self.controller_force_N) < FEWEST_FOR_SCATTER else 0.0
        cell, coarse = self.force_zero, _mean(self.controller_force_N, floor_N)
        return Estimate(cell.value - coarse.value, math.hypot(cell.std, coarse.std))

    @property
    def current_zero(self) -> Estimate | None:
        """What the ECU reports while its output stage is off (A); None without a report."""
        known = self.current_A[np.isfinite(self.current_A)]
        return _mean(known, CURRENT_NOISE_A) if len(known) else None

    def numbers(self, range_N: float) -> dict[str, float]:
        """What a point's file tells of the rest before the first motion, by attribute of `/entry/quality`."""
        zero, difference, current = self.force_zero, self.force_difference(range_N), self.current_zero
        values = {
            "rest_force_N": zero.value, "force_zero_std_N": zero.std, "rest_force_difference_N": difference.value,
            "rest_force_difference_std_N": difference.std,
        }
        if current is not None:
            values |= {"rest_current_A": current.value, "rest_current_std_A": current.std}
        return values


def _mean(values: NDArray[np.float64], floor: float) -> Estimate:
    """Mean of samples (n,) and its standard error: of single samples, or of blocks of them where that is larger."""
    count = len(values)
    scatter = max(float(np.std(values, ddof=1)) if count > 1 else 0.0, floor)
    blocks = [float(np.mean(block)) for block in np.array_split(values, BLOCKS)] if count >= 2 * BLOCKS else []
    slow = float(np.std(blocks, ddof=1)) / math.sqrt(BLOCKS) if blocks else 0.0
    return Estimate(float(np.mean(values)), max(scatter / math.sqrt(count), slow))


def judge_rest(seen: AtRest, limits: RestLimits) -> StopCause | None:
    """The first thing that does not look like a tared rig at rest; None when all is well.

    Args:
        seen: the samples of the rest window.
        limits: the bench's limits.
    """
    for name, samples, fewest in (
        ("load cell", seen.force_N, FEWEST_SAMPLES),
        ("LVDT", seen.displacement_m, FEWEST_SAMPLES),
        ("controller position", seen.position_m, 1),
        ("controller force", seen.controller_force_N, 1),
    ):
        if len(samples) < fewest or not np.all(np.isfinite(samples)):
            return because("not-tared", "few-samples", name=name, count=len(samples), fewest=fewest)
    for name, flagged in (("load cell", seen.force_flagged), ("LVDT", seen.displacement_flagged)):
        if flagged:
            return because("not-tared", "flagged-samples", name=name, count=flagged)
    cause = _first(seen, limits)
    if cause is None:
        return None
    for what, explains in (
        ("plugs", _first(seen.exchanged(limits), limits) is None),
        ("force-sign", _mirrored(seen.force_N, seen.controller_force_N, limits.zero_N)),
        ("lvdt-sign", _mirrored(seen.displacement_m, seen.position_m, limits.disagreement_m)),
    ):
        if explains:
            return cause.explained("sensors-swapped", what)
    return cause


def _mirrored(shown: NDArray[np.float64], expected: NDArray[np.float64], allowed: float) -> bool:
    """Whether more is apart than allowed, and the other sign would explain nearly all of it.

    What it explains less of may be a zero that was not taken; near zero, noise alone has either sign.
    """
    apart, mirrored = float(np.mean(shown) - np.mean(expected)), float(-np.mean(shown) - np.mean(expected))
    return abs(apart) > allowed and abs(mirrored) < MIRRORED_SHARE * abs(apart)


def _first(seen: AtRest, limits: RestLimits) -> StopCause | None:
    force_N, displacement_m, position_m = seen.force_N, seen.displacement_m, seen.position_m
    causes = (
        _over("load cell at rest", abs(float(np.mean(force_N))), REST_FORCE_SHARE * limits.force_N, "N"),
        _force_zero(seen, limits),
        _over("load cell's noise at rest", float(np.std(force_N)), REST_FORCE_NOISE_SHARE * limits.force_N, "N"),
        _over("LVDT's noise at rest", 1e3 * float(np.std(displacement_m)), 1e3 * REST_DISPLACEMENT_NOISE_M, "mm"),
        _over(
            "LVDT against controller position",
            1e3 * abs(float(np.mean(displacement_m) - np.mean(position_m))),
            1e3 * limits.disagreement_m,
            "mm",
        ),
        _outside(float(np.mean(displacement_m)), limits),
        _current_zero(seen, limits),
    )
    return next((cause for cause in causes if cause is not None), None)


def _force_zero(seen: AtRest, limits: RestLimits) -> StopCause | None:
    difference_N = seen.force_difference(limits.range_N)
    if not difference_N.beyond(0.0, limits.zero_N, SURE):
        return None
    return because("not-tared", "force-zero", difference=difference_N.signed, limit_N=limits.zero_N)


def _current_zero(seen: AtRest, limits: RestLimits) -> StopCause | None:
    zero_A = seen.current_zero
    if zero_A is None or not zero_A.beyond(0.0, limits.current_zero_A, SURE):
        return None
    limit_mA = 1e3 * limits.current_zero_A
    return because("not-tared", "current-zero", zero=zero_A.times(1e3).signed, limit_mA=limit_mA)


def _over(what: str, value: float, limit: float, unit: str) -> StopCause | None:
    if value <= limit:
        return None
    return because("not-tared", "rest-value", what=what, value=value, limit=limit, unit=unit)


def _outside(mean_m: float, limits: RestLimits) -> StopCause | None:
    if limits.position_min_m <= mean_m <= limits.position_max_m:
        return None
    low_mm, high_mm = 1e3 * limits.position_min_m, 1e3 * limits.position_max_m
    return because("not-tared", "rest-position", value_mm=1e3 * mean_m, low_mm=low_mm, high_mm=high_mm)


@dataclass(frozen=True)
class Reading:
    """One quantity over a rest window: mean and standard deviation (of a sample; SI) of `count` samples."""

    mean: float
    std: float
    count: int

    @classmethod
    def of(cls, samples: NDArray[np.float64]) -> Reading:
        """Of samples (n,); those that are not finite do not count."""
        finite = samples[np.isfinite(samples)]
        if len(finite) == 0:
            return cls(math.nan, math.nan, 0)
        std = float(np.std(finite, ddof=1)) if len(finite) > 1 else 0.0
        return cls(float(np.mean(finite)), std, len(finite))


@dataclass(frozen=True)
class RestWindow:
    """A resting rig as its instruments show it; the controller's own inputs are its `position_m` and force.

    `force_flagged` and `displacement_flagged` count samples that the sensor itself calls overloaded or faulty.
    """

    force_N: Reading
    displacement_m: Reading
    position_m: Reading
    controller_force_N: Reading
    force_flagged: int = 0
    displacement_flagged: int = 0

    def to_json(self) -> dict[str, Any]:
        """The fields by name, readings as objects."""
        return asdict(self)


def at_rest(seen: AtRest) -> RestWindow:
    """The rest window of these samples."""
    return RestWindow(
        Reading.of(seen.force_N), Reading.of(seen.displacement_m), Reading.of(seen.position_m),
        Reading.of(seen.controller_force_N), seen.force_flagged, seen.displacement_flagged,
    )


@dataclass
class RestWindows:
    """The rig at rest at both ends of a session.

    Attributes:
        start: before the rig was armed; None when it never came so far.
        end: at the end, at 0 A and standstill; None when the end did not allow it.
    """

    start: RestWindow | None = None
    end: RestWindow | None = None


def watch_rest(observer: Observer, judge: Callable[[AtRest], ev.Event]) -> None:
    """Wait for what `judge` says of the next 0.5 s of the controller's clock, ten statuses at the least."""
    until_s = observer.device_s + REST_WINDOW_S if observer.device_s else math.nan
    parts: list[NDArray[Any]] = []

    def wait(block: RecordBlock) -> ev.Event | None:
        nonlocal until_s
        parts.append(block.records)
        if math.isnan(until_s) and observer.device_s:
            # The first status since the station was connected: the window begins with it.
            until_s = observer.device_s + REST_WINDOW_S
        if not observer.device_s >= until_s:
            return None
        window = np.concatenate(parts)
        if np.count_nonzero(window["channel"] == Channel.CONTROLLER_FORCE) < STATUSES_AT_REST:
            return None
        return judge(AtRest.of(window))

    observer.wait = wait


@dataclass
class RestCheck:
    """What the resting rig shows at both ends of a session: kept, written down, and at the start judged.

    Attributes:
        campaign: what the campaign works with; `at_rest` is entered here.
        observer: what follows the ring.
        windows: where both rest windows are entered.
    """

    campaign: CampaignContext
    observer: Observer
    windows: RestWindows

    def begin(self, *, again: bool) -> None:
        """Wait for `ZerosJudged`; when `again`, at the end, for `ZerosReturned`."""
        watch_rest(self.observer, self._returned if again else self._judged)

    def _returned(self, seen: AtRest) -> ev.Event:
        self.windows.end = self._written("end", seen)
        return ev.ZerosReturned()

    def _judged(self, seen: AtRest) -> ev.Event:
        self.windows.start = self._written("start", seen)
        tolerances = tolerances_of(self.campaign.bench, self.campaign.plan)
        limits = rest_limits(self.campaign.bench, self.campaign.config, tolerances.force_zero_N)
        cause = judge_rest(seen, limits)
        if cause is None:
            self.campaign.at_rest = {**tolerances.numbers, **self._temperatures(), **seen.numbers(limits.range_N)}
        return ev.ZerosJudged(cause)

    def _written(self, which: str, seen: AtRest) -> RestWindow:
        shown = at_rest(seen)
        self.campaign.log.note("rest", which=which, **shown.to_json())
        return shown

    def _temperatures(self) -> dict[str, float]:
        """Coil and ECU (degC) before anything was warmed: those of the session's first rest; none where unknown."""
        names = {"rest_coil_degC": Channel.COIL_TEMPERATURE, "rest_ecu_degC": Channel.ECU_TEMPERATURE}
        if names.keys() <= self.campaign.at_rest.keys():
            return {name: self.campaign.at_rest[name] for name in names}
        temperatures = {name: self.observer.last.get(channel, math.nan) for name, channel in names.items()}
        cold = self.campaign.results.began_ns is None and all(map(math.isfinite, temperatures.values()))
        return temperatures if cold else {}
