"""What a point's file says of clocks, delays and skew, and of each sensor against the controller's own input."""

from __future__ import annotations

import math

from rig.recording.alignment import Alignment
from rig.recording.layout import Attribute
from rig.recording.signal_match import Match
from rig.recording.skew import at_likely_compliance

UNITS = {"force": "N", "displacement": "m"}


def skew_attributes(alignment: Alignment) -> dict[str, Attribute]:
    """Attributes of `/entry/quality` on the skew.

    `skew_std_s` is what the signals leave open, whatever was declared; `skew_trusted_std_s` what is left for somebody
    who trusts the bench file; `skew_low_s` to `skew_high_s` the 95 % interval of the skew by the signals alone.
    """
    low_s, high_s = alignment.delays.interval_s or (None, None)
    tied = alignment.skew_s is not None
    return {
        "skew_s": alignment.skew_s, "skew_std_s": alignment.skew_std_s, "skew_trusted_std_s": alignment.skew_trusted_s,
        "skew_low_s": low_s if tied else None, "skew_high_s": high_s if tied else None,
        "skew_checked": alignment.skew_checked, "skew_method": alignment.skew_method,
        "arrival_skew_s": alignment.arrival_skew_s,
    }


def clock_attributes(alignment: Alignment) -> dict[str, Attribute]:
    """How each sensor's clock was found: drift against the controller's, delays, and their standard deviations."""
    found: dict[str, Attribute] = {}
    for name in UNITS:
        channel = alignment.timed[name]
        if channel.clock.rate_measured:
            found[f"{name}_clock_drift_ppm"] = 1e6 * (1.0 / channel.clock.rate - 1.0)
            found[f"{name}_clock_drift_std_ppm"] = 1e6 * channel.clock.rate_std
        found[f"{name}_clock_std_s"] = channel.clock.std_s
        found[f"{name}_disordered_samples"] = channel.disordered
        found[f"{name}_arrival_latency_s"] = channel.latency_s if alignment.arrival_skew_s is not None else None
        sensor = channel.sensor
        if sensor is None:
            continue
        found[f"{name}_declared_delay_s"] = sensor.declared_s
        found[f"{name}_undeclared_delay_s"] = sensor.undeclared_s
        if channel.clock.method == "edges":
            found[f"{name}_tie_std_s"] = sensor.tie_std_s
            found[f"{name}_compared"] = sensor.compared
        if sensor.match is not None:
            found |= _match_attributes(name, sensor.match, edges=channel.clock.method == "edges")
    return found


def _match_attributes(name: str, match: Match, *, edges: bool) -> dict[str, Attribute]:
    """`sensor(t) = gain input(t - lag) + offset + compliance force(t)`: values and their standard deviations.

    `<name>_matched_*` is what the signals alone say of lag and compliance together, for pooling over a campaign;
    `<name>_reference_lag_s` the same once a load train's usual stiffness is taken into account.
    """
    unit = UNITS[name]
    lag_s, lag_std_s = at_likely_compliance(
        match.lag_s, match.lag_std_s, match.compliance, match.compliance_std, match.coupling
    )
    found: dict[str, Attribute] = {}
    if edges:
        found |= {
            f"{name}_matched_lag_s": match.lag_s, f"{name}_matched_lag_std_s": match.lag_std_s,
            f"{name}_reference_lag_s": lag_s, f"{name}_reference_lag_std_s": lag_std_s,
        }
    if math.isfinite(match.gain_std):
        found |= {
            f"{name}_reference_gain": match.gain, f"{name}_reference_gain_std": match.gain_std,
            f"{name}_reference_offset_{unit}": match.offset, f"{name}_reference_offset_std_{unit}": match.offset_std,
        }
    if match.compliance is not None:
        found |= {
            f"{name}_reference_compliance_m_N": match.compliance,
            f"{name}_reference_compliance_std_m_N": match.compliance_std,
            f"{name}_matched_coupling": match.coupling,
        }
    return found
