"""The report's tables with one row a point. A column is one entry: title with unit, and how a point's cell is read.

To add a column, add an entry (`quantity` for a plain number); see docs/how-to/add-a-report-column.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from rig.recording.journal.campaign_log import read_log
from rig.recording.quality.campaign_delay import pooled_skews
from rig.recording.quality.point_quality import SensorQuality
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from rig.report.fragment import (
    CONFIDENCE,
    NOTHING,
    PLUS_MINUS,
    block,
    bullet_list,
    chip,
    heading,
    held_out,
    lines,
    number,
    paragraph,
    plus_minus,
    signed,
    table,
    text,
)
from rig.report.loops import PointView, has_frequency, named
from rig.signals.estimate import Estimate

TEMPERATURE_STEP_K = 0.1
"""The ECU reports its coil's temperature in such steps."""
CONDITION_CODES = frozenset({"temperature", "amplitude"})
"""Codes of the journal's `info` lines about temperature and amplitude compensation."""


@dataclass(frozen=True)
class Column:
    """One column: its title with unit, the escaped cell of a point, and whether cells are set to the right."""

    title: str
    cell: Callable[[PointView], str]
    numeric: bool = True


def quantity(
    title: str, read: Callable[[RecordedPoint], float | None], *, scale: float = 1.0, digits: int = 4,
) -> Column:
    """A column of a number; a dash where it was not measured.

    Args:
        title: with the unit that is shown.
        read: the value in SI, from the point or its `quality`.
        scale: so many of the shown unit are one of SI.
        digits: significant digits.
    """
    return Column(title, lambda view: _scaled(read(view.point), scale, digits))


def words(title: str, read: Callable[[PointView], str]) -> Column:
    """A column of text."""
    return Column(title, lambda view: text(read(view)), numeric=False)


def point_table(columns: Sequence[Column], views: Iterable[PointView]) -> str:
    """One row a point."""
    numeric = [place for place, column in enumerate(columns) if column.numeric]
    rows = [("", [column.cell(view) for column in columns]) for view in views]
    return table([column.title for column in columns], rows, numeric)


def _scaled(value: float | None, scale: float, digits: int = 4) -> str:
    return NOTHING if value is None else number(scale * value, digits)


def _verdict(view: PointView) -> str:
    return chip(view.point.verdict, view.point.verdict)


def _remarks(view: PointView) -> str:
    entries = view.point.quality.verdict.entries
    remarks = [f"{reason} [{reason.blamed}]" for reason in entries]
    remarks += [view.why] if view.why and view.point.verdict != "invalid" else []
    if view.held_out:
        remarks.append(held_out(view.error))
    return block("remark", lines(remarks))


def _skew(view: PointView) -> str:
    point = view.point
    if point.imported:
        return NOTHING
    if point.quality.skew.value_s is None:
        return f"{PLUS_MINUS} {number(1e3 * point.skew_std_s, 2)}"
    return plus_minus(Estimate(point.skew_s, point.skew_std_s).times(1e3))


POINT = words("Point", lambda view: view.point.id)

TEST_POINTS = (
    POINT,
    words("Waveform", lambda view: named(view.point)),
    quantity("A mm", lambda point: _requested(point, point.amplitude_m), scale=1e3),
    quantity("A measured", lambda point: point.quality.motion.amplitude_m, scale=1e3),
    quantity("f Hz", lambda point: _requested(point, point.frequency_Hz) if has_frequency(point) else None),
    quantity("f measured", lambda point: point.quality.motion.frequency_Hz),
    quantity("I A", lambda point: point.current_A),
    quantity("Cycles", lambda point: point.quality.motion.cycles if has_frequency(point) else None, digits=3),
    Column("Lost", lambda view: str(view.point.lost_samples)),
    Column("Skew ms", _skew),
    Column("Verdict", _verdict, numeric=False),
    Column("Error %", lambda view: number(view.error.get("nrmse_percent_of_peak"), 3)),
    Column("Remarks", _remarks, numeric=False),
)


def _requested(point: RecordedPoint, value: float) -> float | None:
    """A requested value; None where it was measured, as in imported tests."""
    return value if point.motion_requested else None


def points_table(views: Sequence[PointView]) -> str:
    """Requested and measured motion, verdict and reasons, error of the fit."""
    note = "Error: 100 \N{MULTIPLICATION SIGN} RMS error / largest deviation of the force from its mean."
    if not all(view.point.imported for view in views):
        note += (
            " Skew: by how much force lagged displacement beyond the declared delays; it is corrected, and "
            f"{PLUS_MINUS} is one standard deviation of what remains. In brackets behind a remark: whether it is "
            "the specimen, the bench or the test that is at fault."
        )
    return heading("Test points", note) + point_table(TEST_POINTS, views)


def _commanded_m(point: RecordedPoint) -> float | None:
    commanded_m = point.test.get("commanded_amplitude_m")
    return float(commanded_m) if isinstance(commanded_m, (int, float)) else None


def _amplitude(view: PointView) -> str:
    motion = view.point.quality.motion
    scatter = "" if motion.amplitude_std_m is None else f" {PLUS_MINUS} {_scaled(motion.amplitude_std_m, 1e3, 2)}"
    return f"{_scaled(motion.amplitude_m, 1e3)}{scatter}"


def _off_percent(point: RecordedPoint) -> float | None:
    measured_m = point.quality.motion.amplitude_m
    if measured_m is None or not point.motion_requested:
        return None
    return 100.0 * (measured_m / point.amplitude_m - 1.0)


ACHIEVED = (
    POINT,
    quantity("A requested mm", lambda point: _requested(point, point.amplitude_m), scale=1e3),
    quantity("A commanded mm", _commanded_m, scale=1e3),
    Column("A measured mm", _amplitude),
    quantity("Off %", _off_percent, digits=2),
    quantity("Mean mm", lambda point: point.quality.motion.mean_m, scale=1e3, digits=3),
    quantity("f Hz", lambda point: point.quality.motion.frequency_Hz),
    quantity("Phase \N{DEGREE SIGN}", lambda point: point.quality.motion.phase_deg, digits=3),
    quantity("Distortion %", lambda point: point.quality.motion.distortion, scale=100.0, digits=2),
    quantity("I measured A", lambda point: point.quality.current.mean_A),
    quantity("I scatter mA", lambda point: point.quality.current.std_A, scale=1e3, digits=2),
)


def achieved_table(points: Sequence[RecordedPoint]) -> str:
    """What the machine was told and what it did, for every point that moved."""
    moved = [point for point in points if point.quality.motion.amplitude_m is not None and point.amplitude_m != 0.0]
    if not moved:
        return ""
    note = (
        f"Means over the full cycles, {PLUS_MINUS} scatter from cycle to cycle. Phase: of measured displacement to the "
        "controller's set-point. Distortion: harmonics 2 to 9 beyond the ideal waveform's. Values of each cycle are in "
        "the point's file."
    )
    return heading("Achieved motion and current", note) + point_table(ACHIEVED, _views(moved))


def _views(points: Iterable[RecordedPoint]) -> list[PointView]:
    return [PointView(point, None) for point in points]


def _reached(view: PointView) -> str:
    motion, commanded_m = view.point.quality.motion, _commanded_m(view.point)
    if motion.amplitude_m is None or commanded_m is None:
        return NOTHING
    std_m = math.nan if motion.amplitude_std_m is None else motion.amplitude_std_m
    std_m /= math.sqrt(max(1, motion.cycles or 1))
    reached = f"{number(100.0 * motion.amplitude_m / commanded_m, 4)} {PLUS_MINUS} "
    return reached + number(100.0 * CONFIDENCE * std_m / commanded_m, 1)


def _corrected_percent(point: RecordedPoint) -> float | None:
    commanded_m = _commanded_m(point)
    return None if commanded_m is None else 100.0 * (commanded_m / point.amplitude_m - 1.0)


CONDITIONS = (
    POINT,
    quantity("f Hz", lambda point: point.frequency_Hz),
    Column("Servo reached %", _reached),
    quantity("Command corrected by %", _corrected_percent, digits=3),
    quantity("Coil \N{DEGREE SIGN}C, lowest", lambda point: point.quality.coil_low_degC),
    quantity("highest", lambda point: point.quality.coil_high_degC),
)


def conditions(run: Run) -> str:
    """Servo and temperature of every point that moved, and what the campaign did about them; empty without any."""
    driven = [
        point for point in run.points
        if point.quality.motion.amplitude_m is not None and (_commanded_m(point) or 0.0) > 0.0
        and point.amplitude_m > 0.0
    ]
    if not driven:
        return ""
    step = f"{PLUS_MINUS} {number(TEMPERATURE_STEP_K / math.sqrt(12.0) * CONFIDENCE, 1)} K"
    note = (
        "Servo reached: measured over commanded amplitude, with the 95 % interval of its mean over the cycles. The "
        f"coil's temperature over the full cycles is the ECU's, {step} by its resolution; its own error comes on top."
    )
    return heading("Test conditions", note) + point_table(CONDITIONS, _views(driven)) + _waits_and_corrections(run)


def _waits_and_corrections(run: Run) -> str:
    """The journal's lines about temperature and amplitude compensation."""
    if not (run.path / "journal.jsonl").is_file():
        return ""
    return bullet_list([
        str(line.get("text", NOTHING)) for line in read_log(run.path)
        if line["event"] == "info" and line.get("code") in CONDITION_CODES
    ])


def _drift(sensor: SensorQuality) -> str:
    if sensor.clock_drift_ppm is None or sensor.clock_drift_std_ppm is None:
        return NOTHING
    return f"{number(sensor.clock_drift_ppm, 4)} {PLUS_MINUS} {number(CONFIDENCE * sensor.clock_drift_std_ppm, 2)}"


def _lagged(view: PointView) -> str:
    point = view.point
    if point.quality.skew.value_s is None:
        return NOTHING
    return signed(Estimate(point.skew_s, CONFIDENCE * point.skew_std_s).times(1e3).alone)


def _checked(view: PointView) -> str:
    skew = view.point.quality.skew
    if skew.state is None:  # of an earlier version
        return NOTHING if skew.checked is None else "yes" if skew.checked else "no"
    return {"checked": "yes", "declared": "declared, not checked", "doubted": "doubted"}.get(skew.state, skew.state)


TIME_BASE = (
    POINT,
    words("Time base", lambda view: view.point.quality.skew.method or ""),
    Column("Force clock ppm", lambda view: _drift(view.point.quality.force)),
    Column("Displacement clock ppm", lambda view: _drift(view.point.quality.displacement)),
    Column("Force lagged by ms", _lagged),
    Column("left uncertain ms", lambda view: f"{PLUS_MINUS} {number(1e3 * CONFIDENCE * view.point.skew_std_s, 2)}"),
    Column("Delays checked", _checked, numeric=False),
    quantity("Arrival lag ms", lambda point: point.quality.skew.arrival_s, scale=1e3, digits=3),
)


def time_base(run: Run) -> str:
    """Clocks, drifts and skew of every recorded point, and what the campaign as a whole says of the skew."""
    points = [point for point in run.points if point.quality.force.clock_std_s is not None]
    if not points:
        return ""
    note = (
        "Every sample is placed on the controller's clock. Force lagged by: its delay behind displacement beyond the "
        "delays that the bench file declares; it is taken out. Delays checked: the controller's own record of force "
        "and position confirms or corrects them; declared, not checked: it does not show them well enough; doubted: "
        "it contradicts the declared delays, and what is left uncertain includes that. Arrival lag: what pairing by "
        "arrival would have given (real time only). Intervals are 95 %."
    )
    return (
        heading("Time base and skew", note) + _pooled(points) + _not_stated(points)
        + point_table(TIME_BASE, _views(points))
    )


def _not_stated(points: Sequence[RecordedPoint]) -> str:
    """One sentence on sensors whose delay nobody vouches for."""
    unstated = {
        name for point in points if point.quality.skew.checked is not None for name in ("force", "displacement")
        if point.quality.sensor(name).declared_delay_s is None
    }
    if not unstated:
        return ""
    return paragraph(
        f"The bench file states no <code>delay</code> for {' and '.join(sorted(unstated))}: it is taken as 0 ms; "
        "where it could not be checked, its standard uncertainty is taken as 0.7 ms."
    )


_OF_STATE = {
    "checked": "",
    "declared": " They do not show it well enough to check the declared delays, which are used.",
    "doubted": " They contradict the declared delays: check them, and [actuator] input_delay, in the bench file.",
}


def _pooled(points: Sequence[RecordedPoint]) -> str:
    """One sentence on the skew of all points together."""
    used = next(iter(pooled_skews([point for point in points if point.verdict != "invalid"]).values()), None)
    if used is None or used.delays.measured_s is None or used.delays.interval_s is None:
        if any(point.quality.skew.checked for point in points):
            return ""
        return paragraph("The declared delays could not be checked against the controller's own force and position.")
    low_s, high_s = used.delays.interval_s
    unstated = all(point.test.get("controller_input_delay_s") is None for point in points)
    stated = _OF_STATE[used.delays.state] if not unstated else (
        " The bench file states no delay of the controller's own inputs (<code>[actuator] input_delay</code>): what "
        "they may be late by is in it."
    )
    taken = Estimate(used.delays.value_s, CONFIDENCE * used.std_s).times(1e3)
    left_ms = number(1e3 * CONFIDENCE * used.std_s, 2)
    return paragraph(
        f"All points together: by their own signals, force lags displacement by <b>{number(1e3 * low_s, 3)} to "
        f"{number(1e3 * high_s, 3)} ms</b> beyond the declared delays.{stated} Taken out: "
        f"{signed(taken.alone)} ms; {PLUS_MINUS} {left_ms} ms are left, in the fit too."
    )
