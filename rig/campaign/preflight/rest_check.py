"""Requirements on the rig at rest, before it is armed (rows `not-tared`, `sensors-swapped`) and at the end.

Load cell and LVDT are compared with the controller's own force and position inputs, before the first motion and when
the rod rests at 0 A at the end (`zero_return` compares both).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import Channel
from protocols.quality import NO_VALUE
from rig.bench.model import CHANGE_OF_ZERO, Bench
from rig.bench.settings import StationConfig
from rig.campaign.execution.campaign_context import CampaignContext
from rig.campaign.execution.observer import Observer
from rig.campaign.preflight.zero_return import ZeroReturn
from rig.campaign.sequencer import event as ev
from rig.campaign.stop_cause import StopCause, because
from rig.matrix.plan import Plan
from rig.recording.journal.ring_reader import RecordBlock
from rig.recording.quality.point_quality import Tolerances
from rig.signals.arrays import FloatArray
from rig.signals.rest import FEWEST_SAMPLES, SURE, AtRest, RestWindow

REST_FORCE_SHARE = 0.20
REST_FORCE_NOISE_SHARE = 0.02
REST_DISPLACEMENT_NOISE_M = 0.5e-3
MIRRORED_SHARE = 0.05
REST_WINDOW_S = 0.5
FEWEST_AT_REST = {Channel.CONTROLLER_FORCE: 10, Channel.FORCE: FEWEST_SAMPLES, Channel.DISPLACEMENT: FEWEST_SAMPLES}
"""A fast rig's window is over after one or two statuses, which say little of the controller's own noisy force input."""


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
        supply: a supply drives the coil: what it shows is a current, not an offset of its measurement.
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
    supply: bool = False


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
    cell, lvdt = bench.load_cell, bench.lvdt
    return RestLimits(
        force_N=config.limits.force_N, position_min_m=bench.limits.position_m[0],
        position_max_m=bench.limits.position_m[1], disagreement_m=config.disagreement_m, range_N=cell.range_N,
        zero_N=zero_N, current_zero_A=bench.checks.current_zero_A, force_per_wire=cell.sensitivity,
        displacement_per_wire=lvdt.sensitivity, force_offset_N=cell.offset, displacement_offset_m=lvdt.offset,
        supply=bench.ecu.url is not None,
    )


def samples_at_rest(window: NDArray[Any]) -> AtRest:
    """The samples among the records (n,) of a rest window."""
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
    # A controller without a force input shows no number; one that has one is watched by the station.
    shown_N = controller_force_N[np.isfinite(controller_force_N)]
    return AtRest(force_N, displacement_m, position_m, shown_N, force_flagged, displacement_flagged, current_A)


def exchanged(seen: AtRest, limits: RestLimits) -> AtRest:
    """What the same bytes mean when each port carries the other sensor."""
    force_wire = (seen.force_N + limits.force_offset_N) / limits.force_per_wire
    displacement_wire = (seen.displacement_m + limits.displacement_offset_m) / limits.displacement_per_wire
    return AtRest(
        displacement_wire * limits.force_per_wire - limits.force_offset_N,
        force_wire * limits.displacement_per_wire - limits.displacement_offset_m,
        seen.position_m, seen.controller_force_N, current_A=seen.current_A,
    )


def check_rest(seen: AtRest, limits: RestLimits) -> StopCause | None:
    """The first thing that does not look like a tared rig at rest, by the samples of a rest window; None: nothing."""
    for name, samples, fewest in (
        ("load cell", seen.force_N, FEWEST_SAMPLES),
        ("LVDT", seen.displacement_m, FEWEST_SAMPLES),
        ("controller position", seen.position_m, 1),
    ):
        if len(samples) < fewest or not np.all(np.isfinite(samples)):
            return because("not-tared", "few-samples", name=name, count=len(samples), fewest=fewest)
    for name, flagged in (("load cell", seen.force_flagged), ("LVDT", seen.displacement_flagged)):
        if flagged:
            return because("not-tared", "flagged-samples", name=name, count=flagged)
    cause = _first(seen, limits)
    what = "" if cause is None else explanation(seen, limits)
    return cause.explained("sensors-swapped", what) if cause is not None and what else cause


def explanation(seen: AtRest, limits: RestLimits) -> str:
    """What explains all that is wrong, a key of `rig.campaign.words.EXCHANGED`; empty where nothing does."""
    if _first(exchanged(seen, limits), limits) is None:
        return "plugs"
    if len(seen.controller_force_N) and _mirrored(seen.force_N, seen.controller_force_N, limits.zero_N):
        return "force-sign"
    return "lvdt-sign" if _mirrored(seen.displacement_m, seen.position_m, limits.disagreement_m) else ""


def _mirrored(shown: FloatArray, expected: FloatArray, allowed: float) -> bool:
    """Whether more is apart than allowed, and the other sign would explain nearly all of it.

    What it explains less of may be a zero that was not taken; near zero, noise alone has either sign.
    """
    apart, mirrored = float(np.mean(shown) - np.mean(expected)), float(-np.mean(shown) - np.mean(expected))
    return abs(apart) > allowed and abs(mirrored) < MIRRORED_SHARE * abs(apart)


def _first(seen: AtRest, limits: RestLimits) -> StopCause | None:
    return next((cause for _, cause in causes_at_rest(seen, limits)), None)


def causes_at_rest(seen: AtRest, limits: RestLimits) -> list[tuple[str, StopCause]]:
    """All that does not look like a tared rig at rest, each with the device it is said of."""
    noise_N, noise_m = float(np.std(seen.force_N)), float(np.std(seen.displacement_m))
    force_N, place_m = float(np.mean(seen.force_N)), float(np.mean(seen.displacement_m))
    apart_m = place_m - float(np.mean(seen.position_m))
    causes = (
        ("load_cell", _over("load cell at rest", abs(force_N), REST_FORCE_SHARE * limits.force_N, "N")),
        ("load_cell", _force_zero(seen, limits)),
        ("load_cell", _over("load cell's noise at rest", noise_N, REST_FORCE_NOISE_SHARE * limits.force_N, "N")),
        ("lvdt", _over("LVDT's noise at rest", 1e3 * noise_m, 1e3 * REST_DISPLACEMENT_NOISE_M, "mm")),
        ("lvdt", _over("LVDT vs. controller position", 1e3 * abs(apart_m), 1e3 * limits.disagreement_m, "mm")),
        ("lvdt", _outside(place_m, limits)),
        ("ecu", _current_zero(seen, limits)),
    )
    return [(device, cause) for device, cause in causes if cause is not None]


def _force_zero(seen: AtRest, limits: RestLimits) -> StopCause | None:
    difference_N = seen.force_difference(limits.range_N)
    if difference_N is None or not difference_N.beyond(0.0, limits.zero_N, SURE):
        return None
    return because("not-tared", "force-zero", difference=difference_N.signed, limit_N=limits.zero_N)


def _current_zero(seen: AtRest, limits: RestLimits) -> StopCause | None:
    zero_A = seen.current_zero
    if zero_A is None or not zero_A.beyond(0.0, limits.current_zero_A, SURE):
        return None
    limit_mA = 1e3 * limits.current_zero_A
    slug, words = ("supply-not-zero",) * 2 if limits.supply else ("not-tared", "current-zero")
    return because(slug, words, zero=zero_A.times(1e3).signed, limit_mA=limit_mA)


def _over(what: str, value: float, limit: float, unit: str) -> StopCause | None:
    if value <= limit:
        return None
    return because("not-tared", "rest-value", what=what, value=value, limit=limit, unit=unit)


def _outside(mean_m: float, limits: RestLimits) -> StopCause | None:
    if limits.position_min_m <= mean_m <= limits.position_max_m:
        return None
    low_mm, high_mm = 1e3 * limits.position_min_m, 1e3 * limits.position_max_m
    return because("not-tared", "rest-position", value_mm=1e3 * mean_m, low_mm=low_mm, high_mm=high_mm)


def watch_rest(observer: Observer, evaluate: Callable[[AtRest], ev.Event]) -> None:
    """Wait for what `evaluate` says of 0.5 s of the controller's clock, or of more where the host was held up.

    The window begins with a standstill that has just been established, else with the last status. Before the first
    records, it is the end of what the ring holds since the devices were connected: nothing can move there either.
    """
    rest = observer.rest
    parts: list[NDArray[Any]] = [] if rest is None else list(rest.parts)
    since_s = observer.device_s if rest is None else rest.since_s
    until_s = since_s + REST_WINDOW_S if since_s else math.nan

    def wait(block: RecordBlock) -> ev.Event | None:
        nonlocal until_s
        records = block.records
        if math.isnan(until_s) and Channel.STATE in block:
            until_s, began_ns = _begin_of_window(block.of(Channel.STATE))
            records = records[records["host_ns"] >= began_ns]
        parts.append(records)
        if not observer.device_s >= until_s:
            return None
        window = np.concatenate(parts)
        if any(np.count_nonzero(window["channel"] == channel) < fewest for channel, fewest in FEWEST_AT_REST.items()):
            return None
        return evaluate(samples_at_rest(window))

    observer.wait = wait


def _begin_of_window(statuses: NDArray[Any]) -> tuple[float, int]:
    """End (s, controller's clock) and begin (host, ns) of the shortest rest window that ends now or later."""
    times_s = 1e-6 * statuses["device_us"]
    first = max(0, int(np.count_nonzero(times_s <= times_s[-1] - REST_WINDOW_S)) - 1)
    return float(times_s[first]) + REST_WINDOW_S, int(statuses["host_ns"][first])


@dataclass
class RestCheck:
    """What the resting rig shows at both ends of a session: kept, written down, and at the start judged.

    Attributes:
        campaign: what the campaign works with; `at_rest` is entered here.
        observer: what follows the ring.
        zeros: where both rest windows are entered.
    """

    campaign: CampaignContext
    observer: Observer
    zeros: ZeroReturn

    def begin(self, *, again: bool) -> None:
        """Wait for `ZerosJudged`; when `again`, at the end, for `ZerosReturned`."""
        watch_rest(self.observer, self._returned if again else self._checked)

    def _returned(self, seen: AtRest) -> ev.Event:
        self.zeros.end = self._written("end", seen)
        return ev.ZerosReturned()

    def _checked(self, seen: AtRest) -> ev.Event:
        self.zeros.start = self._written("start", seen)
        tolerances = tolerances_of(self.campaign.bench, self.campaign.plan)
        limits = rest_limits(self.campaign.bench, self.campaign.config, tolerances.force_zero_N)
        cause = check_rest(seen, limits)
        if cause is None:
            self.campaign.at_rest = {**tolerances.numbers, **self._temperatures(), **seen.numbers(limits.range_N)}
        return ev.ZerosJudged(cause)

    def _written(self, which: str, seen: AtRest) -> RestWindow:
        shown = RestWindow.of(seen)
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
