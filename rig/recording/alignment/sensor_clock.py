"""Times of the sensors' samples on the controller's clock, and their uncertainty.

Best first: edges latched in both clocks; the signal itself, compared with the controller's own; arrival times,
corrected by the latency from other points of the campaign; arrival times. With edges, the signals still show whether
the sensors' declared delays are right: the quantity passes through the conditioner's filter, an edge does not. Both
sensors are compared with the controller's inputs before either delay is estimated
(`rig.signals.delay_estimation.delay_model`), because a common delay cannot be attributed to one of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.roles import ProgramPhase
from protocols.quality import DOUBTFUL
from rig.recording.layout import PointContext, SensorContext
from rig.recording.ring_records import Records
from rig.signals.arrays import FloatArray, TimeSeries
from rig.signals.chunked_column import Values, mapped, parts
from rig.signals.clock_model import (
    LARGEST_DRIFT,
    UNKNOWN_LATENCY_S,
    ClockModel,
    HostMap,
    by_edges,
    by_envelope,
    miscount_std_s,
    unwrapped,
)
from rig.signals.delay_estimation.cycle_match import CycleStretch, cycle_series, match_cycles, refined
from rig.signals.delay_estimation.delay_model import (
    Seen,
    Skew,
    at_likely_compliance,
    tolerance_s,
    weighed,
    weighed_alone_s,
)
from rig.signals.delay_estimation.over_steps import stepped_match, together
from rig.signals.delay_estimation.poll_locked import corrected
from rig.signals.delay_estimation.same_phases import doubted
from rig.signals.delay_estimation.sample_match import Course, Match, match
from rig.signals.estimate import Estimate
from rig.signals.fourier import Series

EDGE_COUNT_MODULO = 256
PULSE_COUNT_MODULO = 65536
REFERENCES = {"force": "controller_force", "displacement": "position"}
"""The controller's record of the same quantity."""
DELAY_REACH_S = 0.03
"""Undeclared delays are looked for up to this."""
ARRIVAL_REACH = 4.0
"""Clocks known by arrivals only are looked for within so many of their standard deviations."""
MATCHING_RATE_Hz = 1000.0
MOST_MATCHED = 60_000
"""Samples of the stretch of cycles that is compared; the first ones of a longer point."""
FEWEST_FULL_CYCLES = 3.0
FEWEST_COMPARED_CYCLES = 2.05
"""Two whole ones, whatever their period turns out to be in the sensor's clock."""
SHORTEST_SETTLING_CYCLES = 0.5
MOST_SPREAD = 1.0 / np.sqrt(12.0)


@dataclass(frozen=True)
class Reference:
    """The controller's own record (m,) of a sensor's quantity, and its full cycles if any."""

    record: TimeSeries
    cycles: CycleStretch | None


@dataclass(frozen=True)
class SensorClock:
    """A sensor's times.

    Attributes:
        time_s: (n,) s, delays taken off.
        clock: the model behind them; its `std_s` includes the delay's.
        declared_s: delay the bench file declares (s); 0 where it was not needed, None where it states none.
        undeclared_s: delay beyond the declared one, taken off too (s).
        tie_std_s: standard deviation of the clock's tie alone (s).
        match: the sensor's signal laid over the controller's; None where that was not possible.
        compared: whether the controller recorded the same quantity.
        checked: whether the delay was compared with an input that may be relied on, and not only declared.
        arrival_lag: by how much the quantity lags the earliest arrivals at mid-record, by its signal (s): the sensor's
            delay and the least latency of its link. None where edges or nothing ties the clock.
        arrival_scatter_s: how far the earliest arrivals scatter, and what a count of samples adds (s).
    """

    time_s: Values
    clock: ClockModel
    declared_s: float | None
    undeclared_s: float
    tie_std_s: float
    match: Match | None
    compared: bool
    checked: bool
    arrival_lag: Estimate | None = None
    arrival_scatter_s: float | None = None


@dataclass(frozen=True)
class _Tie:
    """A sensor's clock before its delay is known: local times (s), the model, and its samples thinned for a match."""

    name: str
    sensor: SensorContext
    local_s: Values
    clock: ClockModel
    by_edges: bool
    miscount_s: float
    reference: Reference | None
    thin_s: FloatArray
    thin: FloatArray
    period_s: float

    def times_s(self, delay_s: float) -> Values:
        """Sample times (n,) s with a delay taken off."""
        return mapped(self.local_s, lambda part_s: self.clock.time_s(part_s) - delay_s, np.float64)


def timed_sensors(
    by_name: Mapping[str, Records], host: HostMap, context: PointContext, given: Skew | None = None,
    behind_arrivals: Estimate | None = None,
) -> tuple[dict[str, SensorClock], Skew]:
    """Find the sensors' clocks and delays.

    Args:
        by_name: all channels: the sensors', edges, pulses and the controller's own records.
        host: the map from host time to the controller's clock.
        context: what the bench declares of the sensors and of the controller's inputs, and the device rate.
        given: delays known from elsewhere (all points of a campaign together); None: by what this point shows.
        behind_arrivals: by how much the force lags the displacement if paired by their earliest arrivals (s), by the
            other points of the campaign; only used where no edges tie the clocks.

    Returns:
        The clock of each sensor that has samples, by name, and the delays that were taken off.
    """
    ties = {
        name: _tied(name, by_name, host, sensor, context)
        for name, sensor in context.sensors.items() if name in by_name and len(by_name[name])
    }
    clocks = {name: _by_signal(tie, context) for name, tie in ties.items() if not tie.by_edges}
    if behind_arrivals is not None:
        clocks |= _by_campaign(ties, clocks, behind_arrivals)
    compared = {name: tie for name, tie in ties.items() if tie.by_edges and tie.reference is not None}
    matches = _matches(compared, steps=context.streamed)
    skew = given
    if skew is None:
        force, displacement = (_seen(ties.get(name), matches.get(name)) for name in ("force", "displacement"))
        skew = weighed(force, displacement, context.controller_delay_s)
    for name, tie in ties.items():
        if not tie.by_edges:
            continue
        delay = {"force": skew.force, "displacement": skew.displacement}.get(name)
        value_s, std_s = (0.0, tolerance_s(tie.sensor.delay_s)) if delay is None else (delay.value_s, delay.std_s)
        sure = replace(tie.clock, std_s=math.hypot(tie.clock.std_s, std_s))
        clocks[name] = SensorClock(
            tie.times_s(tie.sensor.declared_s + value_s), sure, tie.sensor.delay_s, value_s, tie.clock.std_s,
            matches.get(name), tie.reference is not None, delay is not None and delay.checked,
        )
    return clocks, skew


def _seen(tie: _Tie | None, match_: Match | None) -> Seen:
    if tie is None or not tie.by_edges or tie.reference is None:
        return Seen(None if tie is None else tie.sensor.delay_s, input=False)
    if match_ is None:
        return Seen(tie.sensor.delay_s)
    lag_s, std_s = at_likely_compliance(
        match_.lag_s, match_.lag_std_s, match_.compliance, match_.compliance_std, match_.coupling
    )
    return Seen(tie.sensor.delay_s, lag_s, math.hypot(std_s, tie.clock.std_s))


def _tied(
    name: str, by_name: Mapping[str, Records], host: HostMap, sensor: SensorContext, context: PointContext,
) -> _Tie:
    """A sensor's clock by edges where there are any, else by arrivals."""
    channel = by_name[name]
    has_clock = all(bool(np.all(channel["device_us"][rows] >= 0)) for rows in parts(len(channel)))
    local_s: Values
    if has_clock:
        local_s = mapped(channel["device_us"], lambda device_us: device_us * 1e-6, np.float64)
    else:
        local_s = unwrapped(np.asarray(channel["sequence"])) / sensor.rate_Hz
    reference = _reference(name, by_name, context)
    pairs = matched_edges(by_name.get(f"{name}_edge"), by_name.get("pulse"))
    edges, miscount_s = has_clock and len(pairs) > 0, 0.0
    if edges:
        clock = by_edges(pairs[:, 0], pairs[:, 1])
        clock = replace(clock, std_s=float(np.hypot(clock.std_s, clock.rate_std * MOST_SPREAD * _span_s(local_s))))
    else:
        arrival_s = mapped(channel["host_ns"], host.time_s, np.float64)
        clock = by_envelope(local_s, arrival_s, device_rate=context.device_rate)
        if not has_clock:
            clock = replace(clock, method="nominal rate")
            miscount_s = miscount_std_s(local_s, arrival_s, 1.0 / sensor.rate_Hz, device_rate=context.device_rate)
    tie = _Tie(name, sensor, local_s, clock, edges, miscount_s, reference, np.zeros(0), np.zeros(0), 0.0)
    if reference is None:
        return tie
    thin_s, thin, period_s = _coarsened(tie.times_s(sensor.declared_s if edges else 0.0), channel, sensor.rate_Hz)
    return replace(tie, thin_s=thin_s, thin=thin, period_s=period_s)


def _matches(ties: Mapping[str, _Tie], *, steps: bool) -> dict[str, Match]:
    """Each sensor's signal over the controller's: all cycles together where they repeat; else sample by sample."""
    matches: dict[str, Match] = {}
    series: dict[str, Series] = {}
    cycles = None if steps else _common_cycles(ties)
    if cycles is not None:
        for name, tie in ties.items():
            if (of_sensor := cycle_series(tie.thin_s, tie.thin, cycles)) is not None:
                series[name] = of_sensor
    for name, tie in ties.items():
        reference = tie.reference
        if reference is None:
            continue
        laid: Match | None = None
        if steps:
            laid = _over_steps(tie, reference, DELAY_REACH_S, with_drift=False)
        elif cycles is not None and name in series:
            force = series.get("force") if name == "displacement" else None
            laid = match_cycles(reference.record, series[name], cycles, reach_s=DELAY_REACH_S, force=force)
            if laid is not None:
                laid = doubted(laid, reference.record, series[name], TimeSeries(tie.thin_s, tie.thin), cycles)
        else:
            laid = _sample_by_sample(tie, reference, DELAY_REACH_S, cycles, with_drift=False)
        if laid is not None:
            matches[name] = laid
    return matches


def _common_cycles(ties: Mapping[str, _Tie]) -> CycleStretch | None:
    """The stretch of cycles to compare over, its period as the displacement shows it; None for no cycles."""
    for name in ("displacement", "force"):
        tie = ties.get(name)
        if tie is None or tie.reference is None or tie.reference.cycles is None:
            continue
        cycles = tie.reference.cycles
        if len(tie.thin_s) > MOST_MATCHED:
            begin = int(np.searchsorted(tie.thin_s, cycles.start_s))
            last_s = float(tie.thin_s[min(begin + MOST_MATCHED, len(tie.thin_s) - 1)])
            least_s = cycles.start_s + FEWEST_FULL_CYCLES * cycles.period_s
            cycles = replace(cycles, end_s=min(cycles.end_s, max(last_s, least_s)))
        return refined(cycles, tie.thin_s, tie.thin)
    return None


def _by_signal(tie: _Tie, context: PointContext) -> SensorClock:
    """Without edges: the signal laid over the controller's, which takes in every delay; else arrivals as they are."""
    reach_s = ARRIVAL_REACH * max(tie.clock.std_s, UNKNOWN_LATENCY_S * context.device_rate)
    sensor, drifting, scatter_s = tie.sensor, None, math.hypot(tie.clock.scatter_s, tie.miscount_s)
    if tie.reference is not None and context.controller_delay_s is not None:
        drifting = _drifting(tie, tie.reference, reach_s)
        if drifting is not None and context.streamed:
            drifting = _without_steps(tie, tie.reference, drifting, reach_s)
    if drifting is None or abs(drifting.drift) > LARGEST_DRIFT:
        doubt_s = math.hypot(weighed_alone_s(sensor.delay_s), tie.miscount_s)
        sure = replace(tie.clock, std_s=math.hypot(tie.clock.std_s, doubt_s))
        return SensorClock(
            tie.times_s(sensor.declared_s), sure, sensor.delay_s, 0.0, tie.clock.std_s, None,
            tie.reference is not None, checked=False, arrival_scatter_s=scatter_s,
        )
    std_s = math.hypot(
        drifting.lag_std_s, drifting.drift_std * MOST_SPREAD * _span_s(tie.local_s),
        tolerance_s(context.controller_delay_s), tie.miscount_s,
    )
    moved = tie.clock.moved(drifting.lag_s, drifting.drift, drifting.middle_s, std_s, drifting.drift_std)
    return SensorClock(
        replace(tie, clock=moved).times_s(0.0), moved, 0.0, 0.0, std_s, drifting, compared=True, checked=True,
        arrival_lag=Estimate(tie.clock.offset_s - moved.offset_s, std_s), arrival_scatter_s=scatter_s,
    )


def _by_campaign(
    ties: Mapping[str, _Tie], clocks: Mapping[str, SensorClock], behind_arrivals: Estimate,
) -> dict[str, SensorClock]:
    """The less sure of two sensors that no edges tie, by the surer one and what the campaign knows of their arrivals.

    Empty where the point's own signal is surer, or neither sensor's signal shows its time.
    """
    if not {"force", "displacement"} <= clocks.keys():
        return {}
    weak, sure = sorted(("force", "displacement"), key=lambda name: -clocks[name].clock.std_s)
    lag, std_s = clocks[sure].arrival_lag, math.hypot(behind_arrivals.std, clocks[sure].clock.std_s)
    if lag is None or not std_s < clocks[weak].clock.std_s:
        return {}
    apart_s = behind_arrivals.value if weak == "force" else -behind_arrivals.value
    clock = ties[weak].clock.late(lag.value + apart_s, std_s)
    time_s = replace(ties[weak], clock=clock).times_s(0.0)
    return {weak: replace(clocks[weak], time_s=time_s, clock=clock, declared_s=0.0, tie_std_s=std_s, checked=True)}


def _drifting(tie: _Tie, reference: Reference, reach_s: float) -> Match | None:
    """The signal over the controller's with a clock that drifts: sample by sample, then all cycles together."""
    cycles = reference.cycles
    rough = _sample_by_sample(tie, reference, reach_s, cycles, with_drift=True)
    if rough is None or cycles is None:
        return rough
    moved_s = tie.thin_s - rough.lag_s - rough.drift * (tie.thin_s - rough.middle_s)
    cycles = refined(cycles, moved_s, tie.thin)
    if (series := cycle_series(moved_s, tie.thin, cycles)) is None:
        return rough
    left = match_cycles(reference.record, series, cycles, reach_s=DELAY_REACH_S, with_drift=True)
    if left is None or not left.lag_std_s < rough.lag_std_s:
        return rough
    left = doubted(left, reference.record, series, TimeSeries(moved_s, tie.thin), cycles)
    return replace(
        left, lag_s=left.lag_s + rough.lag_s + rough.drift * (left.middle_s - rough.middle_s),
        drift=left.drift + rough.drift,
    )


def _without_steps(tie: _Tie, reference: Reference, laid: Match, reach_s: float) -> Match:
    """The same where set-points were streamed: what goes in steps with the polls is no lag."""
    wide = _over_steps(tie, reference, reach_s)
    if tie.name == "displacement":
        return wide or laid
    own = corrected(laid, reference.record.time_s, TimeSeries(tie.thin_s, tie.thin))
    return own if wide is None else together(own, wide)


def _over_steps(tie: _Tie, reference: Reference, reach_s: float, *, with_drift: bool = True) -> Match | None:
    """The signal over the controller's where both go in steps with its polls."""
    cycle_s = math.inf if reference.cycles is None else reference.cycles.period_s
    record, sensor = reference.record, TimeSeries(tie.thin_s, tie.thin)
    return stepped_match(record, sensor, tie.period_s, reach_s, cycle_s, with_drift=with_drift)


def _sample_by_sample(
    tie: _Tie, reference: Reference, reach_s: float, cycles: CycleStretch | None, *, with_drift: bool,
) -> Match | None:
    course, sensor = Course(math.inf if cycles is None else cycles.period_s), TimeSeries(tie.thin_s, tie.thin)
    return match(reference.record, sensor, tie.period_s, reach_s=reach_s, with_drift=with_drift, course=course)


def _span_s(local_s: Values) -> float:
    return float(local_s[-1] - local_s[0])


def _reference(name: str, by_name: Mapping[str, Records], context: PointContext) -> Reference | None:
    """The controller's own record, its declared delay taken off; None where there is none, or it never changes."""
    record = by_name.get(REFERENCES.get(name, ""))
    if record is None:
        return None
    records = record[:]
    records = records[records["device_us"] >= 0]
    time_s = records["device_us"] * 1e-6 - (context.controller_delay_s or 0.0)
    fresh = np.concatenate(([True], np.diff(np.maximum.accumulate(time_s)) > 0)) if len(time_s) else np.zeros(0, bool)
    if np.count_nonzero(fresh) < 2 or np.ptp(records["value"][fresh]) == 0.0:
        return None
    return Reference(TimeSeries(time_s[fresh], records["value"][fresh]), _full_cycles(by_name.get("phase"), context))


def _full_cycles(phase: Records | None, context: PointContext) -> CycleStretch | None:
    """Where the controller reported full amplitude, less a first cycle that may still settle; None for no cycles.

    Of three cycles, the fewest a matrix may ask for, so much of the first is left out that two whole ones remain.
    """
    frequency_Hz = context.point.frequency_Hz
    if phase is None or not frequency_Hz > 0.0 or not context.point.cyclic:
        return None
    records = phase[:]
    full = (records["value"] == ProgramPhase.FULL_AMPLITUDE) & (records["device_us"] >= 0)
    full_s = records["device_us"][full] * 1e-6
    settling = 0.0 if len(full_s) == 0 else (full_s[-1] - full_s[0]) * frequency_Hz - FEWEST_COMPARED_CYCLES
    if settling < SHORTEST_SETTLING_CYCLES:
        return None
    return CycleStretch(float(full_s[0]) + min(settling, 1.0) / frequency_Hz, float(full_s[-1]), 1.0 / frequency_Hz)


def _coarsened(time_s: Values, channel: Records, rate_Hz: float) -> tuple[FloatArray, FloatArray, float]:
    """Times, values (NaN where bad) and period of means over so many samples that about 1 kHz is left."""
    every = max(1, round(rate_Hz / MATCHING_RATE_Hz))
    times, values = [], []
    for rows in parts(len(channel)):
        records = channel[rows]
        count = len(records) // every * every
        good = np.where((records["flags"] & np.uint16(DOUBTFUL)) != 0, np.nan, records["value"])[:count]
        times.append(np.asarray(time_s[rows])[:count].reshape(-1, every).mean(axis=1))
        values.append(good.reshape(-1, every).mean(axis=1))
    joined = np.concatenate(times)
    after = np.diff(np.maximum.accumulate(joined), prepend=-np.inf) > 0
    return joined[after], np.concatenate(values)[after], every / rate_Hz


def matched_edges(edge_records: Records | None, pulse_records: Records | None) -> FloatArray:
    """Pairs (k, 2) of latched time and pulse time, s, each in its own clock, matched by their counts.

    An edge frame counts pulses modulo 256. The first edge is matched with the pulse of that count nearest in arrival;
    from there on both counts are unwrapped.
    """
    if edge_records is None or pulse_records is None or len(edge_records) == 0 or len(pulse_records) == 0:
        return np.zeros((0, 2))
    edges, pulses = edge_records[:], pulse_records[:]
    counts = np.round(pulses["value"]).astype(np.int64) % PULSE_COUNT_MODULO
    pulse_count = counts[0] + np.concatenate(([0], np.cumsum(np.diff(counts) % PULSE_COUNT_MODULO)))
    edge_count = edges["sequence"].astype(np.int64)
    best = _surest(edge_count, edges["host_ns"], pulse_count, pulses["host_ns"])
    if best is None:
        return np.zeros((0, 2))
    shift = int(edge_count[best[0]] - pulse_count[best[1]])
    _, at_edge, at_pulse = np.intersect1d(edge_count - shift, pulse_count, return_indices=True)
    return np.column_stack((edges["device_us"][at_edge], pulses["device_us"][at_pulse])) * 1e-6


def _surest(
    edge_count: NDArray[np.int64], edge_ns: NDArray[np.int64], pulse_count: NDArray[np.int64],
    pulse_ns: NDArray[np.int64],
) -> tuple[int, int] | None:
    """Edge and pulse of the same count modulo 256 that arrived nearest to each other; None where no counts agree."""
    first = min(int(edge_ns.min()), int(pulse_ns.min()))
    span = max(int(edge_ns.max()), int(pulse_ns.max())) - first + 1
    edge_at = edge_count % EDGE_COUNT_MODULO * span + (edge_ns - first)
    keys = pulse_count % EDGE_COUNT_MODULO * span + (pulse_ns - first)
    order = np.argsort(keys)
    after = np.searchsorted(keys[order], edge_at)
    pairs = [
        (int(abs(edge_at[edge] - keys[pulse])), int(edge), int(pulse))
        for neighbour in (after - 1, after)
        for edge, pulse in enumerate(order[np.clip(neighbour, 0, len(order) - 1)])
        if (edge_count[edge] - pulse_count[pulse]) % EDGE_COUNT_MODULO == 0
    ]
    return min(pairs)[1:] if pairs else None
