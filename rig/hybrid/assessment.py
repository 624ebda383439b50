"""Assessment of a hybrid test's record: did the rod follow, and did the structure respond as if computed completely?

The criteria are those of the benchmark (`rig.hybrid.criteria`), the floors being the specimen's extension, the body and
the wheel:

J1       delay of the rod behind its target, ms
J2, J3   rod against its target, RMS and peak, %
J4, J5   rod against the reference's extension, RMS and peak, %
J6, J8   body against the reference's, RMS and peak, %
J7, J9   wheel against the reference's, RMS and peak, %
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rig.hybrid.criteria import criteria, rms_percent
from rig.signals.arrays import FloatArray

BODY_BAND_Hz = (0.3, 3.0)
HOP_BAND_Hz = (8.0, 15.0)
LEAST_SHARE = 0.05
"""Of a motion's RMS: with less of it in a band, nothing is said of the band."""
FEWEST_STEPS = 50
"""With fewer there is nothing to compare."""


@dataclass(frozen=True)
class Record:
    """What was recorded of a test, or what the reference gives, on one time base (n,): s and m.

    Attributes:
        time_s: since the road's beginning, in equal steps.
        target_m: where the specimen should be, about its centre.
        measured_m: where it was, as the displacement sensor showed it at that step.
        body_m, wheel_m: as computed.
        reference_m: extension, body and wheel of the whole car computed (n, 3).
    """

    time_s: FloatArray
    target_m: FloatArray
    measured_m: FloatArray
    body_m: FloatArray
    wheel_m: FloatArray
    reference_m: FloatArray

    @property
    def step_s(self) -> float:
        """Between two samples, s."""
        return float(self.time_s[1] - self.time_s[0])


@dataclass(frozen=True)
class Assessment:
    """What the record says.

    Attributes:
        tracking_nrms: RMS of the rod's distance from its target, as a share of the target's RMS, both without their
            mean; None where the target does not move.
        reference_error: of the body's motion from 0.3 to 3 Hz, RMS, as a share of the reference's; None where it
            hardly moves there.
        hop_error: the same of the wheel's from 8 to 15 Hz; None where it hardly moves there.
        criteria: J1 to J9; without those that compare with what does not move.
    """

    tracking_nrms: float | None
    reference_error: float | None
    hop_error: float | None
    criteria: dict[str, float]


def assess(record: Record) -> Assessment | None:
    """Compare; None where there is too little of a test."""
    if len(record.time_s) < FEWEST_STEPS:
        return None
    target = np.column_stack([record.target_m, record.body_m, record.wheel_m])
    with np.errstate(divide="ignore", invalid="ignore"):
        every_number = criteria(target, record.measured_m, record.reference_m, record.step_s)
    numbers = {name: value for name, value in every_number.items() if math.isfinite(value)}
    body = _band_error(record.body_m, record.reference_m[:, 1], record.step_s, BODY_BAND_Hz)
    wheel = _band_error(record.wheel_m, record.reference_m[:, 2], record.step_s, HOP_BAND_Hz)
    return Assessment(0.01 * numbers["J2"] if "J2" in numbers else None, body, wheel, numbers)


def _band_error(seen: FloatArray, target: FloatArray, step_s: float, band_Hz: tuple[float, float]) -> float | None:
    """RMS of the difference within a band, as a share of the wanted signal's there; None where that is next to none."""
    inside = band_of(target, step_s, band_Hz)
    if not np.std(inside) > LEAST_SHARE * np.std(target):
        return None
    return 0.01 * rms_percent(band_of(seen, step_s, band_Hz), inside)


def band_of(values: FloatArray, step_s: float, band_Hz: tuple[float, float]) -> FloatArray:
    """The part of a signal (n,) within a band, by its spectrum; its mean and the ends' offset are left out."""
    n = len(values)
    line = values[0] + (values[-1] - values[0]) * np.arange(n) / (n - 1)
    spectrum = np.fft.rfft(values - line)
    frequency_Hz = np.fft.rfftfreq(n, step_s)
    kept = (frequency_Hz >= band_Hz[0]) & (frequency_Hz <= band_Hz[1])
    return np.asarray(np.fft.irfft(np.where(kept, spectrum, 0.0), n), np.float64)
