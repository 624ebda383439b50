"""How far the numbers can be trusted: clocks and skew, and calibrations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rig.recording.estimate import Estimate
from rig.recording.reading import channel_attributes
from rig.recording.run import RecordedPoint, Run
from rig.recording.skew_pooling import pooled_skews
from rig.report.fragment import NOTHING, box, number, signed, table, text

PLUS_MINUS = "\N{PLUS-MINUS SIGN}"
CONFIDENCE = 1.96


def time_base(run: Run) -> str:
    """Clocks, drifts and skew of every recorded point, and what the campaign as a whole says of the skew."""
    points = [point for point in run.points if "force_clock_std_s" in point.quality]
    if not points:
        return ""
    head = [
        "Point", "Time base", "Force clock ppm", "Displacement clock ppm", "Force lagged by ms", "left uncertain ms",
        "Delays checked", "Arrival lag ms",
    ]
    rows = []
    for point in points:
        quality = point.quality
        rows.append(("", [
            text(point.id), text(quality.get("skew_method", "")), _drift(quality, "force"),
            _drift(quality, "displacement"), _lagged(point),
            f"{PLUS_MINUS} {number(1e3 * CONFIDENCE * point.skew_std_s, 2)}", _checked(quality),
            number(_scaled(quality.get("arrival_skew_s"), 1e3), 3),
        ]))
    note = (
        "Every sample is placed on the controller's clock. Force lagged by: its delay behind displacement beyond the "
        "delays that the bench file declares; it is taken out. Delays checked: against the controller's own record of "
        "force and position; else they are as declared. Arrival lag: what pairing by arrival would have given (real "
        "time only). Intervals are 95 %."
    )
    heading = f'<h2>Time base and skew</h2><p class="lead">{note}</p>'
    return heading + _pooled(points) + _not_stated(points) + table(head, rows, (2, 3, 4, 5, 7))


def _lagged(point: RecordedPoint) -> str:
    if "skew_s" not in point.quality:
        return NOTHING
    return signed(Estimate(point.skew_s, CONFIDENCE * point.skew_std_s).times(1e3).alone)


def _checked(quality: Mapping[str, Any]) -> str:
    found = quality.get("skew_checked")
    return NOTHING if found is None else "yes" if found else "no"


def _not_stated(points: Sequence[RecordedPoint]) -> str:
    """One sentence on sensors whose delay nobody vouches for."""
    said = {
        name for point in points if "skew_checked" in point.quality for name in ("force", "displacement")
        if f"{name}_declared_delay_s" not in point.quality
    }
    if not said:
        return ""
    return (
        f"<p>The bench file states no <code>delay</code> for {' and '.join(sorted(said))}: it is taken as 0 ms and, "
        "where it could not be checked, as uncertain as a delay that nobody vouches for.</p>"
    )


def _drift(quality: Mapping[str, Any], name: str) -> str:
    drift, std = quality.get(f"{name}_clock_drift_ppm"), quality.get(f"{name}_clock_drift_std_ppm")
    if drift is None or std is None:
        return NOTHING
    return f"{number(drift, 4)} {PLUS_MINUS} {number(CONFIDENCE * float(std), 2)}"


def _scaled(value: object, factor: float) -> float | None:
    return factor * value if isinstance(value, (int, float)) else None


def _pooled(points: Sequence[RecordedPoint]) -> str:
    """One sentence on the skew of all points together."""
    used = next(iter(pooled_skews([point for point in points if point.verdict != "invalid"]).values()), None)
    if used is None or used.delays.measured_s is None or used.delays.interval_s is None:
        return "<p>The declared delays could not be checked against the controller's own force and position.</p>"
    low_s, high_s = used.delays.interval_s
    stated = "" if used.delays.checked else (
        " The bench file states no delay of the controller's own inputs (<code>[actuator] input_delay</code>): what "
        "they may be late by is in it."
    )
    taken = Estimate(used.delays.value_s, CONFIDENCE * used.std_s).times(1e3)
    return (
        f"<p>All points together: by their own signals, force lags displacement by <b>{number(1e3 * low_s, 3)} to "
        f"{number(1e3 * high_s, 3)} ms</b> beyond the declared delays.{stated} Taken out: "
        f"{signed(taken.alone)} ms; {PLUS_MINUS} {_ms(used.std_s)} ms are left, in the fit too.</p>"
    )


def _ms(std_s: float) -> str:
    return number(1e3 * CONFIDENCE * std_s, 2)


def calibrations(run: Run) -> str:
    """Sensors with their calibration, as recorded in the run's files."""
    point = next((point for point in run.points if point.path is not None and not point.imported), None)
    if point is None or point.path is None:
        return ""
    head = ["Channel", "Sensor", "Serial number", "SI per wire unit", "Certificate", "Due", "Uncertainty %", "Delay ms"]
    rows, overdue = [], []
    for name in ("force", "displacement", *(f"auxiliary_{n}" for n in range(1, 8))):
        found = channel_attributes(point.path, name)
        if "serial_number" not in found:
            continue
        late = bool(found.get("overdue", 0))
        if late:
            overdue.append(f"{name} ({found['serial_number']}, due {found.get('due', '')})")
        rows.append(("no" if late else "", [
            text(name), text(found.get("sensor", "")), text(found["serial_number"]),
            number(found.get("sensitivity"), 6),
            text(found.get("certificate", NOTHING)), text(found.get("due", NOTHING)) + (" overdue" if late else ""),
            number(found.get("uncertainty_percent"), 3), number(_scaled(found.get("delay_s"), 1e3), 4),
        ]))
    warning = box("warn", f"Calibration overdue: {text('; '.join(overdue))}.") if overdue else ""
    return "<h2>Calibration</h2>" + warning + table(head, rows, (3, 6, 7)) if rows else ""
