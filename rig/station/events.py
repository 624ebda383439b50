"""What the station tells the application of trips and stops: the longer lines of its link, as values."""

from __future__ import annotations

import math

from rig.station.fault_table import Stop
from rig.station.interlocks import Finding
from rig.station.safe_stop import SafeStop, View


def trip_event(finding: Finding, kind: Stop, first: bool, now_ns: int) -> dict[str, object]:
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


def unknown_reason(stop: SafeStop, view: View) -> str:
    """What a stop could not prove, and which device it is missing for that."""
    lost = [
        name
        for name, value in (
            ("controller", view.controller_moving),
            ("LVDT", view.still_s),
            ("ECU", view.current_A),
        )
        if value is None
    ]
    proof = "hydraulics off cannot be proved" if stop.standstill else "standstill cannot be proved"
    return f"{proof}; no fresh data from: {', '.join(lost) or 'none lost'}"
