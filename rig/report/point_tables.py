"""The report's tables with one row for each point. A column is one entry: title, unit, and how a cell is read.

To add a column, add an entry (`quantity` for a plain number); see docs/how-to/add-a-report-column.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rig.characteristics.loop import LoopCharacteristics
from rig.comparison.readings import QUANTITIES, calibration_percent
from rig.display import SI, Display, Shown
from rig.document import blocks
from rig.document.blocks import Blocks, Details, Items, Paragraph, section
from rig.document.numbers import CONFIDENCE, NOTHING, PLUS_MINUS, known_digits, number, signed, with_uncertainty
from rig.document.words import Code, Strong, Words, plain, verdict
from rig.recording.quality.campaign_delay import pooled_skews
from rig.recording.quality.point_quality import CurrentQuality, SensorQuality
from rig.recording.recorded_point import RecordedPoint
from rig.report.fit import validation_words
from rig.report.peak_forces import peak_force_std_N
from rig.report.views import PointView, motion_of

TEMPERATURE_STEP_K = 0.1
MEAN_STEP_M = 1e-6
"""Smaller differences of the mean position are noise of any displacement sensor."""
FEW_CYCLES = 3
"""Up to so many, the standard uncertainty of their mean is itself uncertain by a factor of two."""
"""The ECU reports its coil's temperature in such steps."""
CONDITION_CODES = frozenset({"temperature", "amplitude"})
"""Codes of the journal's `info` lines about temperature and amplitude compensation."""


@dataclass(frozen=True)
class Column:
    """One column: its title and unit, the cell of a point, and whether its cells are numbers.

    `shown` is the quantity of `[display]` whose unit the column has: "force", "displacement", "speed", "temperature",
    "damping".
    """

    title: str
    unit: str
    cell: Callable[[PointView], Words]
    numeric: bool = True
    shown: str = ""


def quantity(
    title: str, unit: str, read: Callable[[RecordedPoint], float | None], *, scale: float = 1.0, digits: int = 4,
    shown: str = "",
) -> Column:
    """A column of a number; a dash where it was not measured.

    Args:
        title: of the column.
        unit: as shown; empty for none, and where `shown` says it.
        read: the value in SI, from the point or its `quality`.
        scale: so many of the shown unit are one of SI.
        digits: significant digits.
        shown: the quantity of `[display]` that it is: "force", "displacement", "speed", "temperature" or "damping".
    """
    def cell(view: PointView) -> Words:
        value = read(view.point)
        if value is None:
            return NOTHING
        return number(shown_as(view.display, shown).value(value) if shown else scale * value, digits)

    return Column(title, unit, cell, shown=shown)


def shown_as(display: Display, quantity_name: str) -> Shown:
    """How a quantity of `[display]` is shown."""
    known = {"force": display.force, "displacement": display.displacement, "speed": display.speed,
             "temperature": display.temperature, "energy": display.energy, "damping": display.damping}  # fmt: skip
    return known[quantity_name]


def words(title: str, read: Callable[[PointView], Words]) -> Column:
    """A column of text."""
    return Column(title, "", read, numeric=False)


def point_table(columns: Sequence[Column], views: Sequence[PointView]) -> blocks.Table:
    """One row for each point; a column without any value is left out."""
    display = views[0].display if views else SI
    read = [(column, [column.cell(view) for view in views]) for column in columns]
    filled = [
        (column, cells) for column, cells in read
        if column is POINT or any(plain(cell) not in {"", NOTHING} for cell in cells)
    ]
    heads = [
        blocks.Column(
            column.title, shown_as(display, column.shown).unit if column.shown else column.unit, column.numeric
        ) for column, _ in filled
    ]
    return blocks.table(heads, list(zip(*(cells for _, cells in filled), strict=True)))


def _remarks(view: PointView) -> str:
    entries = view.point.quality.verdict.entries
    remarks = [f"{reason} [{reason.blamed}]" for reason in entries]
    remarks += [view.why] if view.why and view.point.verdict != "invalid" else []
    if view.held_out:
        remarks.append(validation_words(view.beyond))
    return "\n".join(remarks)


POINT = words("Point", lambda view: view.point.id)


def _of_standard(
    title: str, key: str, read: Callable[[LoopCharacteristics, Display], tuple[float, float]], shown: str,
) -> Column:
    """A column of a result of the standard tests (a quantity of a comparison), with its standard uncertainty."""
    def cell(view: PointView) -> Words:
        if view.standard is None:
            return NOTHING
        value, std = read(view.standard, view.display)
        percent = calibration_percent(QUANTITIES[key], view.point)
        return with_uncertainty(value, math.hypot(std, 0.01 * percent * value) if percent > 0.0 else std)

    return Column(title, "", cell, shown=shown)


def _peak(of: int) -> Callable[[PointView], Words]:
    """A point's peak force in rebound (0) or compression (1), rounded to its uncertainty."""
    def cell(view: PointView) -> Words:
        peak = view.peak_force
        if peak is None or not peak.known:
            return NOTHING
        std_N = math.nan if view.standard is None else peak_force_std_N(view.standard)
        return known_digits(view.display.force.signed(peak[of]), view.display.force.value(std_N))

    return cell


TEST_POINTS = (
    POINT,
    words("Motion", lambda view: motion_of(view)),
    Column("Current", "A", lambda view: number(view.level_A, 3)),
    Column("Peak velocity", "", lambda view: NOTHING if view.standard is None else number(
        view.display.speed.value(view.standard.peak_speed_m_s), 3), shown="speed"),
    Column("Peak rebound", "", _peak(0), shown="force"),
    Column("Peak compression", "", _peak(1), shown="force"),
    _of_standard("Rebound at peak velocity", "rebound_force", lambda loop, display: (
        display.force.signed(loop.rebound_N.value), display.force.value(loop.rebound_N.std)), "force"),
    _of_standard("Compression at peak velocity", "jounce_force", lambda loop, display: (
        display.force.signed(loop.jounce_N.value), display.force.value(loop.jounce_N.std)), "force"),
    _of_standard("Energy", "energy", lambda loop, display: (
        display.energy.value(loop.energy_J.value), display.energy.value(loop.energy_J.std)), "energy"),
    _of_standard("Damping", "damping", lambda loop, display: (
        display.damping.value(loop.equivalent_damping_N_s_m.value),
        display.damping.value(loop.equivalent_damping_N_s_m.std)), "damping"),
    Column("Model error", "%", lambda view: number(view.error_percent, 3)),
    words("Verdict", lambda view: verdict(view.point.verdict)),
    words("Remarks", _remarks),
)  # fmt: skip


def _requested(point: RecordedPoint, value: float) -> float | None:
    """A requested value; None where it was measured, as in imported tests."""
    return value if point.motion_requested else None


def points_table(views: Sequence[PointView]) -> Blocks:
    """The one table of points: motion, forces, error of the fit, verdict and reasons."""
    note = (
        f"Peak rebound and compression: largest force of the mean cycle in each direction. {PLUS_MINUS}: one standard "
        "uncertainty due to the variation between cycles and to the calibration, if its uncertainty is stated. "
        "Damping: coefficient of the viscous damper that dissipates the same energy. Model error: RMS error of the "
        "test as a percentage of its force amplitude, which is the largest deviation of the force from its mean."
    )
    few = [view.standard.cycles for view in views if view.standard is not None and view.standard.cycles <= FEW_CYCLES]
    if few:
        note += (
            f" Points with only {' or '.join(map(str, sorted(set(few))))} evaluated cycles: {len(few)}; "
            "a standard uncertainty from so few cycles can be wrong by a factor of two."
        )
    if not all(view.point.imported for view in views):
        note += (
            " The word in brackets after a remark states whether the cause is the specimen, the bench or the test."
        )
    return [*section("Test points", note), point_table(TEST_POINTS, views)]


def _amplitude(view: PointView) -> str:
    motion, display = view.point.quality.motion, view.display.displacement
    if motion.amplitude_m is None:
        return NOTHING
    return with_uncertainty(display.value(motion.amplitude_m), display.value(motion.amplitude_std_m or 0.0))


def _mean(view: PointView) -> str:
    mean_m = view.point.quality.motion.mean_m
    return NOTHING if mean_m is None else signed(view.display.displacement.fixed(mean_m, MEAN_STEP_M))


def _amplitude_error_percent(point: RecordedPoint) -> float | None:
    measured_m = point.quality.motion.amplitude_m
    if measured_m is None or not point.motion_requested or point.amplitude_m == 0.0:
        return None
    return 100.0 * (measured_m / point.amplitude_m - 1.0)


def _correction_percent(point: RecordedPoint) -> float | None:
    commanded_m = point.commanded.amplitude_m
    if commanded_m is None or point.amplitude_m == 0.0:
        return None
    return 100.0 * (commanded_m / point.amplitude_m - 1.0)


LEAST_CURRENT_STD_A = 5e-4
"""Smallest uncertainty to which a current is rounded: an ECU's digits beyond it mean nothing."""

ACHIEVED = (
    POINT,
    quantity("Amplitude requested", "", lambda point: _requested(point, point.amplitude_m), shown="displacement"),
    Column("Measured", "", _amplitude, shown="displacement"),
    quantity("Amplitude error", "%", _amplitude_error_percent, digits=2),
    quantity("Command correction", "%", _correction_percent, digits=2),
    Column("Mean", "", _mean, shown="displacement"),
    quantity("Frequency requested", "Hz", lambda point: (
        _requested(point, point.frequency_Hz) if point.has_frequency and not point.at_rest else None)),
    quantity("Measured", "Hz", lambda point: point.quality.motion.frequency_Hz),
    quantity("Cycles", "", lambda point: point.quality.motion.cycles if point.has_frequency else None, digits=5),
    quantity("Phase", "°", lambda point: point.quality.motion.phase_deg, digits=3),
    quantity("Distortion", "%", lambda point: point.quality.motion.distortion, scale=100.0, digits=2),
    Column("Current", "A", lambda view: _current(view.point.quality.current)),
    quantity("Current SD", "mA", lambda point: point.quality.current.std_A, scale=1e3, digits=2),
    quantity("Coil, lowest", "", lambda point: point.quality.coil_low_degC, digits=3, shown="temperature"),
    quantity("Coil, highest", "", lambda point: point.quality.coil_high_degC, digits=3, shown="temperature"),
    Column("Lost samples", "", lambda view: str(view.point.lost_samples) if view.point.lost_samples else NOTHING),
)  # fmt: skip


ACHIEVED_NOTES = (
    ("Measured", f"Amplitude: mean over all full cycles {PLUS_MINUS} standard deviation from cycle to cycle."),
    ("Command correction", "Command correction: commanded amplitude relative to the requested amplitude."),
    ("Phase", "Phase: measured displacement relative to the controller's set-point."),
    ("Distortion", "Distortion: harmonics 2 to 9 in addition to those of the ideal waveform."),
    ("Cycles", "Cycles: full cycles measured; of three or more, forces are evaluated without the first and the last."),
)
"""Column -> its explanation, which is printed with the column."""


def _current(current: CurrentQuality) -> str:
    if current.mean_A is None:
        return NOTHING
    return known_digits(current.mean_A, max(current.std_A or 0.0, LEAST_CURRENT_STD_A))


def point_details(views: Sequence[PointView], log: Sequence[Mapping[str, Any]]) -> Blocks:
    """Motion, current and temperature of every point in detail, then clocks and delays; folded on screen."""
    moved = [view for view in views if view.point.quality.motion.amplitude_m is not None]
    parts: list[blocks.Block] = []
    if moved:
        achieved = point_table(ACHIEVED, moved)
        columns = {column.title for column in achieved.columns}
        note = " ".join(text for title, text in ACHIEVED_NOTES if title in columns)
        if "Coil, highest" in columns and not all(view.point.imported for view in moved):
            step_K = number(TEMPERATURE_STEP_K / math.sqrt(12.0) * CONFIDENCE, 1)
            note += (
                f" The ECU reports coil temperature with a quantisation error of up to {PLUS_MINUS}{step_K} K; the "
                "sensor's own error is not included."
            )
        parts.append(Details("Achieved motion, current and temperature", (Paragraph(note, small=True), achieved)))
    parts += time_base(views)
    lines = [
        str(line.get("text", NOTHING)) for line in log
        if line["event"] == "info" and line.get("code") in CONDITION_CODES
    ]
    parts += [Items(tuple(lines))] if lines else []
    return [*section("Details of the points"), *parts] if parts else []


def _drift(sensor: SensorQuality) -> str:
    if sensor.clock_drift_ppm is None or sensor.clock_drift_std_ppm is None:
        return NOTHING
    return with_uncertainty(sensor.clock_drift_ppm, CONFIDENCE * sensor.clock_drift_std_ppm)


def _force_delay(view: PointView) -> str:
    point = view.point
    if point.quality.skew.value_s is None:
        return NOTHING
    return known_digits(1e3 * point.skew_s, 1e3 * CONFIDENCE * point.skew_std_s)


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


def time_base(views: Sequence[PointView]) -> Blocks:
    """Clocks, drifts and sensor delays of every recorded point, and the delays of the campaign as a whole."""
    recorded = [view for view in views if view.point.quality.force.clock_std_s is not None]
    if not recorded:
        return []
    points = [view.point for view in recorded]
    note = (
        "All sample times are referenced to the controller's clock. Force delay: delay of the force relative to the "
        "displacement, in addition to the delays declared in the bench file; this delay is corrected. Delays "
        "checked: the controller's own record of force and position confirms or corrects the delays. Declared, not "
        "checked: the controller's record is not accurate enough for a check. Contradicted: the controller's record "
        "disagrees with the declared delays, and the remaining delay includes the difference. Each row states what was "
        "known from this point when it was aligned; all points together, as in the sentence above and in the sensor "
        "cross-checks, determine the delays more accurately, and can confirm a delay that one point seems to "
        "contradict. Arrival delay: delay "
        "that would remain if samples were paired by time of arrival (real time only). Intervals: 95 %."
    )
    rows = (Paragraph(note, small=True), point_table(TIME_BASE, recorded))
    return [*_pooled(points), *_not_stated(points), Details("Time base and sensor delays", rows)]


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


def _end_ms(end_s: float, width_s: float) -> str:
    """An end of an interval, rounded to half its width."""
    return known_digits(1e3 * end_s, 0.5e3 * width_s)


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
    left_ms = 1e3 * CONFIDENCE * used.std_s
    return [Paragraph((
        "For all points combined, the signals show that the force lags the displacement by ",
        Strong(f"{_end_ms(low_s, high_s - low_s)} to {_end_ms(high_s, high_s - low_s)} ms"),
        " in addition to the declared delays.",
        *(stated if isinstance(stated, tuple) else (stated,)),
        f" Correction applied: {with_uncertainty(1e3 * used.delays.value_s, left_ms)} ms. The uncertainty of this "
        "correction also affects the fit.",
    ))]  # fmt: skip
