"""The station's messages about trips and stops: the longer lines of its link, as values."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rig.faults.row import StopKind
from rig.station.interlocks.finding import Finding
from rig.station.interlocks.setpoint_interlock import StepCount
from rig.station.safe_stop import SafeStop, StopInputs, StopPhase
from rig.station.watchdogs import BlindTime, HostWatch

Event = dict[str, object]


@dataclass(frozen=True)
class Trip:
    """The latched first cause."""

    slug: str
    stop: StopKind
    detail: str
    t_ns: int
    value: float
    limit: float


def trip_event(finding: Finding, kind: StopKind, first: bool, now_ns: int) -> Event:
    """The event of a latched first cause (`trip`) or of a later one (`also`)."""
    return {
        "event": "trip" if first else "also",
        "slug": finding.slug,
        "stop": str(kind),
        "detail": finding.detail,
        "t_ns": finding.t_ns,
        "latched_ns": now_ns,
        "value": None if math.isnan(finding.value) else finding.value,
        "limit": None if math.isnan(finding.limit) else finding.limit,
    }


def setpoints_event(counted: StepCount, now_ns: int) -> Event:
    """The event of a streamed motion that ended: its set-points so far, how many late or left out, lateness (s)."""
    return {"event": "setpoints", **counted.numbers(), "t_ns": now_ns}


def late_event(blind: BlindTime, host: HostWatch) -> Event:
    """The event of a time for which the station did not watch: how long (s), allowed, how often and long in all."""
    return {
        "event": "late",
        "late_s": blind.length_ns / 1e9,
        "limit_s": host.limit_ns / 1e9,
        "count": host.count,
        "total_s": host.total_ns / 1e9,
        "t_ns": blind.end_ns,
    }


def step_event(stop: SafeStop, inputs: StopInputs, evidence: Event, now_ns: int) -> Event:
    """The event of a stop's new step; of the last one with what is proved and what is not."""
    proved: Event = {
        "stop": str(stop.kind), "standstill": stop.standstill, "current_zero": stop.current_zero,
        "current_left_A": stop.current_left_A,
    }
    if stop.step is StopPhase.SAFE:
        event: Event = {
            "event": "safe", **proved, **evidence, "stopped_s": (inputs.now_ns - stop.started_ns) / 1e9
        }
    elif stop.step is StopPhase.UNKNOWN:
        event = {"event": "unknown", **proved, "reason": unknown_reason(stop, inputs, evidence), **evidence}
    else:
        event = {"event": "stop", "step": stop.step.name.lower()}
    return {**event, "t_ns": now_ns}


PRESSURE_SEEN = {
    "on": "the controller reports pressure (or power)", "low": "the controller reports low pressure",
    "unknown": "the controller does not report whether pressure (or power) is on in state {state}: reset the "
    "controller, or define in [pressure] of its register map how it reports the pressure",
}

CURRENT_ON = (
    "the coil current is still on: {:.3g} A measured, 0 A commanded. Fix: disconnect the coil's supply, then inspect "
    "the rig"
)


def unknown_reason(stop: SafeStop, inputs: StopInputs, evidence: Event) -> str:
    """What a stop could not prove, and which device it is missing for that."""
    lost = [
        name
        for name, value in (
            ("controller", inputs.controller_moving),
            ("LVDT", inputs.still_s),
            ("ECU", inputs.current_A),
        )
        if value is None
    ]
    if stop.current_left_A is not None and stop.standstill:
        return CURRENT_ON.format(stop.current_left_A)
    if inputs.current_A is None and stop.current_falls_s is None and stop.standstill:
        return (
            "the rod is at rest, but the current source does not respond and may still be delivering current: switch "
            "the source off"
        )
    proof = "it is not confirmed that the hydraulics are off" if stop.standstill else "standstill is not confirmed"
    seen = PRESSURE_SEEN.get(str(evidence.get("pressure")), "").format(state=evidence.get("state"))
    return f"{proof}{': ' if seen else ''}{seen}; devices without fresh data: {', '.join(lost) or 'none'}"
