"""The report's tables with one row for each point. A column is one entry: title, unit, and how a point's cell is read.

To add a column, add an entry (`quantity` for a plain number); see docs/how-to/add-a-report-column.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rig.document import blocks
from rig.document.blocks import Blocks, Items, Paragraph, section
from rig.document.numbers import CONFIDENCE, NOTHING, PLUS_MINUS, number, plus_minus, signed
from rig.document.words import Code, Strong, Words, verdict
from rig.recording.quality.campaign_delay import pooled_skews
from rig.recording.quality.point_quality import CurrentQuality, SensorQuality
from rig.recording.recorded_point import RecordedPoint
from rig.report.fit import validation_words
from rig.report.views import PointView
from rig.signals.estimate import Estimate

TEMPERATURE_STEP_K = 0.1
"""The ECU reports its coil's temperature in such steps."""
CONDITION_CODES = frozenset({"temperature", "amplitude"})
"""Codes of the journal's `info` lines about temperature and amplitude compensation."""


@dataclass(frozen=True)
class Column:
    """One column: its title and unit, the cell of a point, and whether its cells are numbers."""

    title: str
    unit: str
    cell: Callable[[PointView], Words]
    numeric: bool = True


def quantity(
    title: str, unit: str, read: Callable[[RecordedPoint], float | None], *, scale: float = 1.0, digits: int = 4,
) -> Column:
    """A column of a number; a dash where it was not measured.

    Args:
        title: of the column.
        unit: as shown; empty for none.
        read: the value in SI, from the point or its `quality`.
        scale: so many of the shown unit are one of SI.
        digits: significant digits.
    """
    return Column(title, unit, lambda view: _scaled(read(view.point), scale, digits))


def words(title: str, read: Callable[[PointView], Words]) -> Column:
    """A column of text."""
    return Column(title, "", read, numeric=False)


def point_table(columns: Sequence[Column], views: Iterable[PointView]) -> blocks.Table:
    """One row for each point."""
    heads = [blocks.Column(column.title, column.unit, column.numeric) for column in columns]
    return blocks.table(heads, [[column.cell(view) for column in columns] for view in views])


def _scaled(value: float | None, scale: float, digits: int = 4) -> str:
    return NOTHING if value is None else number(scale * value, digits)


def _remarks(view: PointView) -> str:
    entries = view.point.quality.verdict.entries
    remarks = [f"{reason} [{reason.blamed}]" for reason in entries]
    remarks += [view.why] if view.why and view.point.verdict != "invalid" else []
    if view.held_out:
        remarks.append(validation_words(view.beyond))
    return "\n".join(remarks)


def _sensor_delay(view: PointView) -> str:
    point = view.point
    if point.imported:
        return NOTHING
    if point.quality.skew.value_s is None:
        return f"{PLUS_MINUS} {number(1e3 * point.skew_std_s, 2)}"
    return plus_minus(Estimate(point.skew_s, point.skew_std_s).times(1e3))


POINT = words("Point", lambda view: view.point.id)

TEST_POINTS = (
    POINT,
    words("Waveform", lambda view: view.point.motion),
    quantity("A", "mm", lambda point: _requested(point, point.amplitude_m), scale=1e3),
    quantity("A measured", "mm", lambda point: point.quality.motion.amplitude_m, scale=1e3),
    quantity("f", "Hz", lambda point: _requested(point, point.frequency_Hz) if point.has_frequency else None),
    quantity("f measured", "Hz", lambda point: point.quality.motion.frequency_Hz),
    quantity("I", "A", lambda point: point.current_A),
    quantity("Cycles", "", lambda point: point.quality.motion.cycles if point.has_frequency else None, digits=3),
    Column("Lost", "", lambda view: str(view.point.lost_samples)),
    Column("Sensor delay", "ms", _sensor_delay),
    words("Verdict", lambda view: verdict(view.point.verdict)),
    Column("Error", "%", lambda view: number(view.error_percent, 3)),
    words("Remarks", _remarks),
)


def _requested(point: RecordedPoint, value: float) -> float | None:
    """A requested value; None where it was measured, as in imported tests."""
    return value if point.motion_requested else None


def points_table(views: Sequence[PointView]) -> Blocks:
    """Requested and measured motion, verdict and reasons, error of the fit."""
    note = "Error: 100 \N{MULTIPLICATION SIGN} RMS error / largest deviation of the force from its mean."
    if not all(view.point.imported for view in views):
        note += (
            " Sensor delay: delay of the force relative to the displacement, in addition to the declared delays. The "
            f"sensor delay is corrected; {PLUS_MINUS} is one standard deviation of the remaining delay. The word in "
            "brackets after a remark indicates whether the cause is the specimen, the bench or the test."
        )
    return [*section("Test points", note), point_table(TEST_POINTS, views)]


def _amplitude(view: PointView) -> str:
    motion = view.point.quality.motion
    if motion.amplitude_m is None or not motion.amplitude_std_m:
        return _scaled(motion.amplitude_m, 1e3)
    return plus_minus(Estimate(motion.amplitude_m, motion.amplitude_std_m).times(1e3))


def _amplitude_error_percent(point: RecordedPoint) -> float | None:
    measured_m = point.quality.motion.amplitude_m
    if measured_m is None or not point.motion_requested:
        return None
    return 100.0 * (measured_m / point.amplitude_m - 1.0)


ACHIEVED = (
    POINT,
    quantity("A requested", "mm", lambda point: _requested(point, point.amplitude_m), scale=1e3),
    quantity("A commanded", "mm", lambda point: point.commanded.amplitude_m, scale=1e3),
    Column("A measured", "mm", _amplitude),
    quantity("Amplitude error", "%", _amplitude_error_percent, digits=2),
    quantity("Mean", "mm", lambda point: point.quality.motion.mean_m, scale=1e3, digits=3),
    quantity("f", "Hz", lambda point: point.quality.motion.frequency_Hz),
    quantity("Phase", "\N{DEGREE SIGN}", lambda point: point.quality.motion.phase_deg, digits=3),
    quantity("Distortion", "%", lambda point: point.quality.motion.distortion, scale=100.0, digits=2),
    Column("Current", "A", lambda view: _current(view.point.quality.current)),
    quantity("Current SD", "mA", lambda point: point.quality.current.std_A, scale=1e3, digits=2),
)


def _current(current: CurrentQuality) -> str:
    if current.mean_A is None or not current.std_A:
        return number(current.mean_A)
    return signed(Estimate(current.mean_A, current.std_A).alone)


def achieved_table(points: Sequence[RecordedPoint]) -> Blocks:
    """Commanded and measured motion and current of every point that moved."""
    moved = [point for point in points if point.quality.motion.amplitude_m is not None and point.amplitude_m != 0.0]
    if not moved:
        return []
    note = (
        f"Mean over all full cycles {PLUS_MINUS} standard deviation from cycle to cycle. Phase: measured displacement "
        "relative to the controller's set-point. Distortion: harmonics 2 to 9 in addition to those of the ideal "
        "waveform. The values for each cycle are stored in the point file."
    )
    return [*section("Achieved motion and current", note), point_table(ACHIEVED, _views(moved))]


def _views(points: Iterable[RecordedPoint]) -> list[PointView]:
    return [PointView(point, None) for point in points]


def _amplitude_achieved(view: PointView) -> str:
    motion, commanded_m = view.point.quality.motion, view.point.commanded.amplitude_m
    if motion.amplitude_m is None or commanded_m is None:
        return NOTHING
    std_m = math.nan if motion.amplitude_std_m is None else motion.amplitude_std_m
    std_m /= math.sqrt(max(1, motion.cycles or 1))
    achieved = f"{number(100.0 * motion.amplitude_m / commanded_m, 4)} {PLUS_MINUS} "
    return achieved + number(100.0 * CONFIDENCE * std_m / commanded_m, 1)


def _correction_percent(point: RecordedPoint) -> float | None:
    commanded_m = point.commanded.amplitude_m
    return None if commanded_m is None else 100.0 * (commanded_m / point.amplitude_m - 1.0)


CONDITIONS = (
    POINT,
    quantity("f", "Hz", lambda point: point.frequency_Hz),
    Column("Amplitude achieved", "%", _amplitude_achieved),
    quantity("Command correction", "%", _correction_percent, digits=3),
    quantity("Lowest coil temperature", "\N{DEGREE SIGN}C", lambda point: point.quality.coil_low_degC),
    quantity("Highest", "\N{DEGREE SIGN}C", lambda point: point.quality.coil_high_degC),
)


def conditions(points: Sequence[RecordedPoint], log: Sequence[Mapping[str, Any]]) -> Blocks:
    """Amplitude and temperature of every point that moved, and the journal's lines on both; empty without any."""
    driven = [
        point for point in points
        if point.quality.motion.amplitude_m is not None and (point.commanded.amplitude_m or 0.0) > 0.0
        and point.amplitude_m > 0.0
    ]
    if not driven:
        return []
    step = f"{PLUS_MINUS}{number(TEMPERATURE_STEP_K / math.sqrt(12.0) * CONFIDENCE, 1)} K"
    note = (
        "Amplitude achieved: ratio of measured to commanded amplitude, with the 95 % interval of the mean over the "
        f"cycles. The ECU reports the coil temperature with a quantisation error of up to {step}; the sensor's own "
        "error is not included."
    )
    lines = [
        str(line.get("text", NOTHING)) for line in log
        if line["event"] == "info" and line.get("code") in CONDITION_CODES
    ]
    return [
        *section("Test conditions", note), point_table(CONDITIONS, _views(driven)),
        *([Items(tuple(lines))] if lines else []),
    ]  # fmt: skip


def _drift(sensor: SensorQuality) -> str:
    if sensor.clock_drift_ppm is None or sensor.clock_drift_std_ppm is None:
        return NOTHING
    return plus_minus(Estimate(sensor.clock_drift_ppm, CONFIDENCE * sensor.clock_drift_std_ppm))


def _force_delay(view: PointView) -> str:
    point = view.point
    if point.quality.skew.value_s is None:
        return NOTHING
    return signed(Estimate(point.skew_s, CONFIDENCE * point.skew_std_s).times(1e3).alone)


def _checked(view: PointView) -> str:
    skew = view.point.quality.skew
    if skew.state is None:  # recorded by an earlier version
        return NOTHING if skew.checked is None else "yes" if skew.checked else "no"
    words = {"checked": "yes", "declared": "declared, not checked", "doubted": "contradicted"}
    return words.get(skew.state, skew.state)


def _remaining_delay(view: PointView) -> str:
    return f"{PLUS_MINUS} {number(1e3 * CONFIDENCE * view.point.skew_std_s, 2)}"


def time_base_words(method: str | None) -> str:
    """How samples were placed in time; `by edges` is the recordings' term."""
    return (method or "").replace("by edges", "hardware-synchronised")


TIME_BASE = (
    POINT,
    words("Time base", lambda view: time_base_words(view.point.quality.skew.method)),
    Column("Force clock", "ppm", lambda view: _drift(view.point.quality.force)),
    Column("Displacement clock", "ppm", lambda view: _drift(view.point.quality.displacement)),
    Column("Force delay", "ms", _force_delay),
    Column("Remaining", "ms", _remaining_delay),
    words("Delays checked", _checked),
    quantity("Arrival delay", "ms", lambda point: point.quality.skew.arrival_s, scale=1e3, digits=3),
)


def time_base(points: Sequence[RecordedPoint]) -> Blocks:
    """Clocks, drifts and sensor delays of every recorded point, and the delays of the campaign as a whole."""
    points = [point for point in points if point.quality.force.clock_std_s is not None]
    if not points:
        return []
    note = (
        "All sample times are referenced to the controller's clock. Force delay: delay of the force relative to the "
        "displacement, in addition to the delays declared in the bench file; this delay is corrected. Delays "
        "checked: the controller's own record of force and position confirms or corrects the delays. Declared, not "
        "checked: the controller's record is not accurate enough for a check. Contradicted: the controller's record "
        "disagrees with the declared delays, and the remaining delay includes the difference. Arrival delay: delay "
        "that would remain if samples were paired by time of arrival (real time only). Intervals: 95 %."
    )
    return [
        *section("Time base and sensor delays", note), *_pooled(points), *_not_stated(points),
        point_table(TIME_BASE, _views(points)),
    ]  # fmt: skip


def _not_stated(points: Sequence[RecordedPoint]) -> Blocks:
    """One sentence on sensors whose delay the bench file does not state."""
    unstated = {
        name for point in points if point.quality.skew.checked is not None for name in ("force", "displacement")
        if point.quality.sensor(name).declared_delay_s is None
    }
    if not unstated:
        return []
    return [Paragraph((
        "The bench file does not state ", Code("delay"), f" for {' and '.join(sorted(unstated))}: 0 ms is assumed, "
        "with a standard uncertainty of 0.7 ms if the delay could not be checked.",
    ))]  # fmt: skip


_OF_STATE: dict[str, Words] = {
    "checked": "",
    "declared": " The signals are not accurate enough to check the declared delays, so the declared delays are used.",
    "doubted": (
        " The signals contradict the declared delays. Check the delays and ", Code("[actuator] input_delay"),
        " in the bench file.",
    ),
}  # fmt: skip
_OWN_INPUTS = (
    " The bench file does not state the delay of the controller's own inputs (", Code("[actuator] input_delay"),
    "); the interval includes this delay.",
)


def _pooled(points: Sequence[RecordedPoint]) -> Blocks:
    """One sentence on the sensor delay of all points together."""
    used = next(iter(pooled_skews([point for point in points if point.verdict != "invalid"]).values()), None)
    if used is None or used.delays.measured_s is None or used.delays.interval_s is None:
        if any(point.quality.skew.checked for point in points):
            return []
        text = "The declared delays could not be checked against the controller's own force and position."
        return [Paragraph(text)]
    low_s, high_s = used.delays.interval_s
    unstated = all(point.test.get("controller_input_delay_s") is None for point in points)
    stated = _OWN_INPUTS if unstated else _OF_STATE[used.delays.state]
    corrected = Estimate(used.delays.value_s, CONFIDENCE * used.std_s).times(1e3)
    left_ms = number(1e3 * CONFIDENCE * used.std_s, 2)
    return [Paragraph((
        "For all points combined, the signals show that the force lags the displacement by ",
        Strong(f"{number(1e3 * low_s, 3)} to {number(1e3 * high_s, 3)} ms"), " in addition to the declared delays.",
        *(stated if isinstance(stated, tuple) else (stated,)),
        f" Correction applied: {signed(corrected.alone)} ms. The uncertainty of this correction, "
        f"{PLUS_MINUS}{left_ms} ms, also affects the fit.",
    ))]  # fmt: skip
