"""An uncertainty budget for each channel: its contributions, and those that are not stated."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.characteristics.loop import LoopCharacteristics, delay_std_s
from rig.display import SI, Display
from rig.document.blocks import Blocks, Column, Head, Heading, section, table
from rig.document.numbers import NOTHING, number
from rig.identification.models.measurement import Measurement
from rig.recording.quality.cross_checks import checked, instruments_of
from rig.recording.quality.instrument_checks import deviations, trusted, zero_change
from rig.recording.recorded_point import RecordedPoint
from rig.report.instruments import AUXILIARIES, sensors_of
from rig.report.views import PointView
from rig.signals.loop_shape import noise_of

NOT_STATED = math.nan
UNIFORM = 1.0 / math.sqrt(12.0)
"""Standard deviation of what lies anywhere in a span of 1."""


@dataclass(frozen=True)
class Share:
    """One contribution to a channel's uncertainty: a standard deviation, and where it comes from.

    `of_peak`: whether it makes the peak uncertain; a constant delay changes no peak and is not in the total.
    """

    what: str
    value: float
    origin: str
    of_peak: bool = True


@dataclass(frozen=True)
class Channel:
    """A channel's greatest value and the contributions to its uncertainty, all in `unit`."""

    title: str
    unit: str
    peak: float
    shares: tuple[Share, ...]

    @property
    def combined(self) -> float:
        """Standard uncertainty of the peak: root of the summed squares of the known contributions to it."""
        return math.hypot(*(share.value for share in self.shares if share.of_peak and math.isfinite(share.value)))


def budget(views: Sequence[PointView], loops: Sequence[LoopCharacteristics], display: Display = SI) -> Blocks:
    """Standard uncertainties of every channel at its peak, in the loop whose force changes fastest.

    Args:
        views: the points, with their measurements.
        loops: their characteristics.
        display: the units in which forces and displacements are shown.
    """
    steepest = {loop.id: loop.steepest_N_s for loop in loops if math.isfinite(loop.steepest_N_s)}
    known = [
        (view.point, view.measured) for view in views
        if view.measured is not None and view.point.id in steepest and view.point.quality.loop.span_N is not None
    ]
    if not known:
        return []
    point, measured = max(known, key=lambda pair: steepest[pair[0].id])
    note = (
        f"Standard uncertainties of the peak values of point {point.id}, where the force changes fastest. "
        "Contributions marked \"not stated\" are not included in the total. A delay between force and displacement "
        "does not change the peak values; its effect on the force at a given displacement is stated below the total."
    )
    drift_N = _drift_N([view.point for view in views])
    channels = channels_of(point, measured, steepest[point.id], drift_N)
    tables = (block for channel in channels for block in _table(_shown(channel, display)))
    return [*section("Uncertainty budget", note), *tables]


def channels_of(
    point: RecordedPoint, measured: Measurement, steepest_N_s: float, drift_N: float = NOT_STATED,
) -> list[Channel]:
    """The budget of every channel of a point, the uncertainties in the unit that the channel is shown in.

    Args:
        point: the point.
        measured: its measurement, with the skew that is left.
        steepest_N_s: greatest rate of change of its mean cycle's force, N/s.
        drift_N: standard uncertainty by zero drift over the campaign (N); NaN where unknown.
    """
    return [_force(point, measured, steepest_N_s, drift_N), _displacement(point), *_current(point),
            *_temperature(point), *_auxiliaries(point)]


def _drift_N(points: Sequence[RecordedPoint]) -> float:
    """Standard uncertainty (N) by the load cell's zero drift, uniform over the drift of the campaign."""
    group = max(instruments_of(points).values(), key=len, default=[])
    if not group:
        return NOT_STATED
    agreeing = trusted([checked(point.id, point.test, point.quality) for point in group])
    change = zero_change(agreeing, deviations(len(group)))
    if change is None or not change.over_time_N.known:
        return NOT_STATED
    return UNIFORM * math.hypot(change.over_time_N.value, change.over_time_N.std)


def _force(point: RecordedPoint, measured: Measurement, steepest_N_s: float, drift_N: float) -> Channel:
    loop, peaks = point.quality.loop, point.peak_force_N
    peak_N = max(map(abs, peaks)) if peaks.known else 0.5 * (loop.span_N or 0.0)
    timing_N = steepest_N_s * delay_std_s(point, measured)
    return Channel("Force", "N", peak_N, (
        _certificate(peak_N, point.test.get("force_uncertainty_percent")),
        Share("zero", _known(point.quality.rest.force_zero_std_N),
              "noise level and duration of the rest period before the first motion"),
        Share("zero drift", drift_N, "compared with the controller's force input, during the campaign"),
        Share("single-sample noise", _known(loop.noise_N), "neighbouring samples"),
        Share("variation between cycles", _known(loop.scatter_N), "differences between cycles beyond the noise"),
        Share("timing, at the reversals", timing_N, "uncertainty of the delay between force and displacement times "
              "the highest rate of change of force", of_peak=False),
    ))


def _displacement(point: RecordedPoint) -> Channel:
    peak_mm = 1e3 * (point.quality.motion.amplitude_m or point.amplitude_m)
    return Channel("Displacement", "mm", peak_mm, (
        _certificate(peak_mm, point.test.get("displacement_uncertainty_percent")),
        Share("single-sample noise", 1e3 * noise_of(point.displacement_m), "neighbouring samples"),
    ))


def _current(point: RecordedPoint) -> Iterator[Channel]:
    """The coil's current as the ECU measures it; the ECU's calibration is not stated."""
    current = point.quality.current
    if current.mean_A is not None:
        yield Channel("Coil current", "A", abs(current.mean_A), (
            Share("calibration", NOT_STATED, "the ECU"),
            Share("SD of one sample", _known(current.std_A), "during the point"),
        ))


def _temperature(point: RecordedPoint) -> Iterator[Channel]:
    """The coil's temperature as the ECU measures it."""
    low_degC, high_degC = point.quality.coil_low_degC, point.quality.coil_high_degC
    if low_degC is not None and high_degC is not None:
        change_K = UNIFORM * (high_degC - low_degC)
        yield Channel("Coil temperature", "degC", high_degC, (
            Share("calibration", NOT_STATED, "the ECU"),
            Share("change during the point", change_K, "highest minus lowest value"),
        ))


def _auxiliaries(point: RecordedPoint) -> Iterator[Channel]:
    """Auxiliary channels that have a calibration."""
    sensors = sensors_of(point)
    for name in (name for name in AUXILIARIES if name in sensors):
        attributes = sensors[name]
        values = point.channel(name)
        known = values[np.isfinite(values)]
        if known.size == 0:
            continue
        peak = float(np.max(np.abs(known)))
        yield Channel(str(attributes.get("sensor") or name), str(attributes.get("units", "")), peak, (
            _certificate(peak, attributes.get("uncertainty_percent")),
            Share("single-sample noise", noise_of(values), "neighbouring samples"),
        ))


def _shown(channel: Channel, display: Display) -> Channel:
    """A channel in the units of the display."""
    known = {"N": (display.force, 1.0), "mm": (display.displacement, 1e-3), "degC": (display.temperature, 1.0)}
    if channel.unit not in known:
        return channel
    shown, si = known[channel.unit]
    shares = tuple(replace(share, value=si * share.value / shown.scale) for share in channel.shares)
    return replace(channel, unit=shown.unit, peak=shown.value(si * channel.peak), shares=shares)


def _known(value: float | None) -> float:
    return NOT_STATED if value is None else value


def _certificate(peak: float, percent: object) -> Share:
    share = peak * percent / 100.0 if isinstance(percent, (int, float)) else NOT_STATED
    return Share("calibration", share, "certificate")


def _table(channel: Channel) -> Blocks:
    sums = (
        Share("combined (k = 1)", channel.combined, ""), Share("expanded (k = 2)", 2.0 * channel.combined, ""),
    )
    rows = [
        [share.what, number(share.value, 3) if math.isfinite(share.value) else "not stated",
         number(100.0 * share.value / channel.peak, 2) if channel.peak > 0.0 else NOTHING, share.origin]
        for share in (*(one for one in channel.shares if one.of_peak), *sums,
                      *(one for one in channel.shares if not one.of_peak))
    ]
    value, part = Column("Value", channel.unit, True), Column("Share", "% of peak", True)
    head: list[Head] = ["Contribution", value, part, "Source"]
    return [Heading(f"{channel.title}, peak {number(channel.peak, 4)} {channel.unit}", 3), table(head, rows)]
