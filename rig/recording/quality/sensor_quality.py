"""Clocks, delays and skew of the sensors, and how each lies over the controller's own input: fields and measurement."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rig.recording.quality.section import Section, Stored, estimate, section, stored
from rig.signals.clock_model import EDGES
from rig.signals.delay_estimation.delay_model import at_likely_compliance
from rig.signals.delay_estimation.sample_match import Match
from rig.signals.estimate import Estimate

if TYPE_CHECKING:
    from rig.recording.alignment.alignment import Alignment


@dataclass(frozen=True)
class SkewQuality(Section):
    """Force against displacement in time.

    Attributes:
        value_s: by how much force lagged displacement beyond the declared delays; taken out.
        std_s: what the signals leave open, whatever was declared; `trusted_std_s` what is left for somebody who trusts
            the bench file; `low_s` to `high_s` the 95 % interval by the signals alone.
        checked: whether both delays were compared with the controller's own record.
        method: the clock models that were used.
        arrival_s: what pairing by arrival would have given.
    """

    value_s: float | None = stored("skew_s")
    std_s: float | None = stored("skew_std_s")
    trusted_std_s: float | None = stored("skew_trusted_std_s")
    low_s: float | None = stored("skew_low_s")
    high_s: float | None = stored("skew_high_s")
    checked: bool | None = stored("skew_checked", Stored.FLAG)
    method: str | None = stored("skew_method", Stored.TEXT)
    arrival_s: float | None = stored("arrival_skew_s")


@dataclass(frozen=True)
class SensorQuality(Section):
    """A sensor's clock, its delays, and how it lies over the controller's own input of the same quantity.

    `sensor(t) = gain input(t - lag) + offset + compliance force(t)`, SI, each with its standard deviation.
    `matched_lag_s` is what the signals alone say, together with the compliance (covariance `matched_coupling`, s m/N);
    `reference_lag_s` the same once a load train's usual stiffness is taken into account.
    """

    clock_drift_ppm: float | None = stored("{sensor}_clock_drift_ppm")
    clock_drift_std_ppm: float | None = stored("{sensor}_clock_drift_std_ppm")
    clock_std_s: float | None = stored("{sensor}_clock_std_s")
    disordered_samples: int | None = stored("{sensor}_disordered_samples", Stored.COUNT)
    arrival_latency_s: float | None = stored("{sensor}_arrival_latency_s")
    declared_delay_s: float | None = stored("{sensor}_declared_delay_s")
    undeclared_delay_s: float | None = stored("{sensor}_undeclared_delay_s")
    tie_std_s: float | None = stored("{sensor}_tie_std_s")
    compared: bool | None = stored("{sensor}_compared", Stored.FLAG)
    matched_lag_s: float | None = stored("{sensor}_matched_lag_s")
    matched_lag_std_s: float | None = stored("{sensor}_matched_lag_std_s")
    reference_lag_s: float | None = stored("{sensor}_reference_lag_s")
    reference_lag_std_s: float | None = stored("{sensor}_reference_lag_std_s")
    reference_gain: float | None = stored("{sensor}_reference_gain")
    reference_gain_std: float | None = stored("{sensor}_reference_gain_std")
    reference_offset: float | None = stored("{sensor}_reference_offset_{unit}")
    reference_offset_std: float | None = stored("{sensor}_reference_offset_std_{unit}")
    reference_compliance_m_N: float | None = stored("{sensor}_reference_compliance_m_N")
    reference_compliance_std_m_N: float | None = stored("{sensor}_reference_compliance_std_m_N")
    matched_coupling: float | None = stored("{sensor}_matched_coupling")

    @property
    def gain(self) -> Estimate | None:
        """Of the sensor relative to the controller's input."""
        return estimate(self.reference_gain, self.reference_gain_std)

    @property
    def offset(self) -> Estimate | None:
        """What the sensor shows where the controller's input shows 0 (SI)."""
        return estimate(self.reference_offset, self.reference_offset_std)

    @property
    def lag(self) -> Estimate | None:
        """By how much the sensor is later than the input beyond both declared delays (s), by the signals alone."""
        return estimate(self.matched_lag_s, self.matched_lag_std_s)


FORCE = section(SensorQuality, sensor="force", unit="N")
DISPLACEMENT = section(SensorQuality, sensor="displacement", unit="m")


def skew_quality(alignment: Alignment) -> SkewQuality:
    """How the clocks were tied, and what is left uncertain."""
    low_s, high_s = alignment.delays.interval_s or (None, None)
    tied = alignment.skew_s is not None
    return SkewQuality(
        value_s=alignment.skew_s, std_s=alignment.skew_std_s, trusted_std_s=alignment.skew_trusted_s,
        low_s=low_s if tied else None, high_s=high_s if tied else None, checked=alignment.skew_checked,
        method=alignment.skew_method, arrival_s=alignment.arrival_skew_s,
    )


def sensor_quality(name: str, alignment: Alignment) -> SensorQuality:
    """How a sensor's clock was found, its delays, and how it lies over the controller's input."""
    channel = alignment.timed[name]
    clock, sensor = channel.clock, channel.sensor
    quality = SensorQuality(
        clock_drift_ppm=1e6 * (1.0 / clock.rate - 1.0) if clock.rate_measured else None,
        clock_drift_std_ppm=1e6 * clock.rate_std if clock.rate_measured else None, clock_std_s=clock.std_s,
        disordered_samples=channel.disordered,
        arrival_latency_s=channel.latency_s if alignment.arrival_skew_s is not None else None,
    )
    if sensor is None:
        return quality
    by_edges = clock.method == EDGES
    quality = replace(
        quality, declared_delay_s=sensor.declared_s, undeclared_delay_s=sensor.undeclared_s,
        tie_std_s=sensor.tie_std_s if by_edges else None, compared=sensor.compared if by_edges else None,
    )
    return quality if sensor.match is None else _with_match(quality, sensor.match, by_edges=by_edges)


def _with_match(quality: SensorQuality, match: Match, *, by_edges: bool) -> SensorQuality:
    if by_edges:
        lag_s, lag_std_s = at_likely_compliance(
            match.lag_s, match.lag_std_s, match.compliance, match.compliance_std, match.coupling
        )
        quality = replace(
            quality, matched_lag_s=match.lag_s, matched_lag_std_s=match.lag_std_s, reference_lag_s=lag_s,
            reference_lag_std_s=lag_std_s,
        )
    if math.isfinite(match.gain_std):
        quality = replace(
            quality, reference_gain=match.gain, reference_gain_std=match.gain_std, reference_offset=match.offset,
            reference_offset_std=match.offset_std,
        )
    if match.compliance is not None:
        quality = replace(
            quality, reference_compliance_m_N=match.compliance, reference_compliance_std_m_N=match.compliance_std,
            matched_coupling=match.coupling,
        )
    return quality
