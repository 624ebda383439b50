"""How a sensor's samples get their times on the controller's clock, and what is left uncertain.

Best first: edges latched in both clocks; the signal itself, laid over the controller's own; arrivals. Where edges tie
the clocks, the signal still shows whether the sensor's delay is the declared one: an edge does not pass through the
conditioner's filter, the quantity does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from protocols.actuator import ProgramPhase
from protocols.quality import Quality
from rig.recording.clock_model import (
    LARGEST_DRIFT,
    UNKNOWN_LATENCY_S,
    ClockModel,
    HostMap,
    by_edges,
    by_envelope,
    miscount_std_s,
)
from rig.recording.column import Records, Values, mapped
from rig.recording.context import PointContext, SensorContext
from rig.recording.cycle_match import Cycles, match_cycles
from rig.recording.layout import FloatArray, parts
from rig.recording.signal_match import Match, match
from rig.recording.skew import tolerance_s, undeclared

EDGE_COUNT_MODULO = 256
PULSE_COUNT_MODULO = 65536
REFERENCES = {"force": "controller_force", "displacement": "position"}
"""The controller's record of the same quantity."""
DELAY_REACH_S = 0.03
"""Undeclared delays are looked for up to this."""
ARRIVAL_REACH = 4.0
"""Clocks known by arrivals only are looked for within so many of their standard deviations."""
MATCHING_RATE_Hz = 1000.0
FEWEST_FULL_CYCLES = 3.0
MOST_SPREAD = 1.0 / np.sqrt(12.0)
BAD = np.uint16(Quality.OVERLOAD | Quality.SENSOR_FAULT | Quality.NOT_A_NUMBER | Quality.SPIKE)


@dataclass(frozen=True)
class Reference:
    """The controller's own record of a sensor's quantity: times (s) and values (m,), and its full cycles if any."""

    time_s: FloatArray
    values: FloatArray
    cycles: Cycles | None


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
        checked: whether the delay was compared with the controller's own record, and not only declared.
    """

    time_s: Values
    clock: ClockModel
    declared_s: float | None
    undeclared_s: float
    tie_std_s: float
    match: Match | None
    checked: bool


def timed_sensor(
    name: str, channel: Records, by_name: Mapping[str, Records], host: HostMap, sensor: SensorContext,
    context: PointContext,
) -> SensorClock:
    """Find a sensor's clock and delay.

    Args:
        name: `force`, `displacement`, `auxiliary_1` ...
        channel: its records (n,).
        by_name: all channels, for edges, pulses and the controller's own record.
        host: the map from host time to the controller's clock.
        sensor: what the bench declares.
        context: device rate and the delay of the controller's inputs.
    """
    has_clock = all(bool(np.all(channel["device_us"][rows] >= 0)) for rows in parts(len(channel)))
    local_s: Values
    if has_clock:
        local_s = mapped(channel["device_us"], lambda device_us: device_us * 1e-6, np.float64)
    else:
        local_s = unwrapped(np.asarray(channel["sequence"])) / sensor.rate_Hz
    reference = _reference(name, by_name, context)
    pairs = matched_edges(by_name.get(f"{name}_edge"), by_name.get("pulse"))
    if has_clock and len(pairs):
        clock = by_edges(pairs[:, 0], pairs[:, 1])
        clock = replace(clock, std_s=float(np.hypot(clock.std_s, clock.rate_std * MOST_SPREAD * _span_s(local_s))))
        return _by_edges(clock, local_s, channel, sensor, reference)
    arrival_s = mapped(channel["host_ns"], host.time_s, np.float64)
    clock = by_envelope(local_s, arrival_s, device_rate=context.device_rate)
    if has_clock:
        return _by_signal(clock, local_s, channel, sensor, reference, context.device_rate)
    miscount_s = miscount_std_s(local_s, arrival_s, 1.0 / sensor.rate_Hz, device_rate=context.device_rate)
    found = _by_signal(
        replace(clock, method="nominal rate"), local_s, channel, sensor, reference, context.device_rate
    )
    return replace(found, clock=replace(found.clock, std_s=float(np.hypot(found.clock.std_s, miscount_s))))


def _by_edges(
    clock: ClockModel, local_s: Values, channel: Records, sensor: SensorContext,
    reference: Reference | None,
) -> SensorClock:
    time_s = _times(local_s, clock, sensor.declared_s)
    found = _match(reference, time_s, channel, sensor, DELAY_REACH_S, with_drift=False)
    measured = (None, 0.0) if found is None else (found.lag_s, found.lag_std_s)
    delay = undeclared(tolerance_s(sensor.delay_s), *measured, stated=sensor.delay_s is not None)
    sure = replace(clock, std_s=float(np.hypot(clock.std_s, delay.std_s)))
    return SensorClock(
        _times(local_s, clock, sensor.declared_s + delay.value_s), sure, sensor.delay_s, delay.value_s, clock.std_s,
        found, delay.checked,
    )


def _by_signal(
    clock: ClockModel, local_s: Values, channel: Records, sensor: SensorContext,
    reference: Reference | None, device_rate: float,
) -> SensorClock:
    """Without edges: the signal laid over the controller's, which takes in every delay; else arrivals as they are."""
    reach_s = ARRIVAL_REACH * max(clock.std_s, UNKNOWN_LATENCY_S * device_rate)
    found = _match(reference, _times(local_s, clock, 0.0), channel, sensor, reach_s, with_drift=True)
    if found is None or abs(found.drift) > LARGEST_DRIFT:
        unchecked = undeclared(tolerance_s(sensor.delay_s), None, 0.0, stated=sensor.delay_s is not None)
        sure = replace(clock, std_s=float(np.hypot(clock.std_s, unchecked.std_s)))
        time_s = _times(local_s, clock, sensor.declared_s)
        return SensorClock(time_s, sure, sensor.delay_s, 0.0, clock.std_s, None, checked=False)
    spread_s = MOST_SPREAD * _span_s(local_s)
    std_s = float(np.hypot(found.lag_std_s, found.drift_std * spread_s))
    moved = clock.moved(found.lag_s, found.drift, found.middle_s, std_s, found.drift_std)
    return SensorClock(_times(local_s, moved, 0.0), moved, 0.0, 0.0, std_s, found, checked=True)


def _times(local_s: Values, clock: ClockModel, delay_s: float) -> Values:
    return mapped(local_s, lambda part_s: clock.time_s(part_s) - delay_s, np.float64)


def _span_s(local_s: Values) -> float:
    return float(local_s[-1] - local_s[0])


def _reference(name: str, by_name: Mapping[str, Records], context: PointContext) -> Reference | None:
    """The controller's own record; None where it may not be relied on."""
    record = by_name.get(REFERENCES.get(name, ""))
    if record is None or context.controller_delay_s is None:
        return None
    records = record[:]
    records = records[records["device_us"] >= 0]
    time_s = records["device_us"] * 1e-6 - context.controller_delay_s
    fresh = np.concatenate(([True], np.diff(np.maximum.accumulate(time_s)) > 0)) if len(time_s) else np.zeros(0, bool)
    return Reference(time_s[fresh], records["value"][fresh], _full_cycles(by_name.get("phase"), context))


def _full_cycles(phase: Records | None, context: PointContext) -> Cycles | None:
    """Where the controller reported full amplitude, less a first cycle that may still settle; None for no cycles."""
    frequency_Hz = float(context.point.get("frequency_Hz", 0.0))
    if phase is None or not frequency_Hz > 0.0 or context.point.get("kind") == "current_step":
        return None
    records = phase[:]
    full = (records["value"] == ProgramPhase.FULL_AMPLITUDE) & (records["device_us"] >= 0)
    full_s = records["device_us"][full] * 1e-6
    if len(full_s) == 0 or (full_s[-1] - full_s[0]) * frequency_Hz < FEWEST_FULL_CYCLES:
        return None
    return Cycles(float(full_s[0]) + 1.0 / frequency_Hz, float(full_s[-1]), 1.0 / frequency_Hz)


def _match(
    reference: Reference | None, time_s: Values, channel: Records, sensor: SensorContext, reach_s: float,
    *, with_drift: bool,
) -> Match | None:
    """All cycles together where they repeat, which sees several times more; else sample by sample."""
    if reference is None:
        return None
    coarse_s, values, period_s = _coarsened(time_s, channel, sensor.rate_Hz)
    cycles = reference.cycles
    laid = (reference.time_s, reference.values, coarse_s, values)
    if cycles is not None and not with_drift:
        found = match_cycles(*laid, cycles, reach_s=reach_s)
        if found is not None:
            return found
    cycle_s = np.inf if cycles is None else cycles.period_s
    rough = match(*laid, period_s, reach_s=reach_s, with_drift=with_drift, cycle_s=cycle_s)
    if rough is None or cycles is None or not with_drift:
        return rough
    return match_cycles(*laid, cycles, reach_s=reach_s, start=rough) or rough


def _coarsened(time_s: Values, channel: Records, rate_Hz: float) -> tuple[FloatArray, FloatArray, float]:
    """Times, values (NaN where bad) and period of means over so many samples that about 1 kHz is left."""
    every = max(1, round(rate_Hz / MATCHING_RATE_Hz))
    times, values = [], []
    for rows in parts(len(channel)):
        records = channel[rows]
        count = len(records) // every * every
        good = np.where((records["flags"] & BAD) != 0, np.nan, records["value"])[:count]
        times.append(np.asarray(time_s[rows])[:count].reshape(-1, every).mean(axis=1))
        values.append(good.reshape(-1, every).mean(axis=1))
    joined = np.concatenate(times)
    after = np.diff(np.maximum.accumulate(joined), prepend=-np.inf) > 0
    return joined[after], np.concatenate(values)[after], every / rate_Hz


def unwrapped(sequence: NDArray[np.uint32]) -> FloatArray:
    """Sample count (n,) from 0, of a sequence modulo 2^32; steps back (a restarted device) count as no step."""
    steps = np.mod(np.diff(sequence.astype(np.int64)), 1 << 32)
    steps[steps >= 1 << 31] = 0
    return np.concatenate(([0.0], np.cumsum(steps, dtype=np.float64)))


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
    wanted = edge_count % EDGE_COUNT_MODULO * span + (edge_ns - first)
    keys = pulse_count % EDGE_COUNT_MODULO * span + (pulse_ns - first)
    order = np.argsort(keys)
    after = np.searchsorted(keys[order], wanted)
    pairs = [
        (int(abs(wanted[edge] - keys[pulse])), int(edge), int(pulse))
        for neighbour in (after - 1, after)
        for edge, pulse in enumerate(order[np.clip(neighbour, 0, len(order) - 1)])
        if (edge_count[edge] - pulse_count[pulse]) % EDGE_COUNT_MODULO == 0
    ]
    return min(pairs)[1:] if pairs else None
