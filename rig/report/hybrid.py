"""The report's part on hybrid tests: what was led ahead and what was not, side by side, each beside the reference."""

from __future__ import annotations

from collections.abc import Sequence

from rig.characteristics.hybrid_tests import HybridTest
from rig.hybrid.assessment import Record
from rig.report.chart import Chart, Trace, thinned
from rig.report.fragment import (
    NOTHING,
    box,
    card,
    charts,
    heading,
    key,
    key_line,
    number,
    table,
    text,
)
from rig.report.style import FITTED, MEASURED, OVERLAID
from rig.signals.arrays import FloatArray

HEAD = (
    "Point", "Compensation", "Law", "Delay ms", "Tracking %", "Body to 3 Hz %", "Wheel, 8 to 15 Hz %", "Energy error %",
    "Late set-points", "J1 ms", "J2 %", "J4 %", "J6 %", "J7 %",
)
NOTE = (
    "The damper moves as the computed car moves it. Delay: of the rod behind its set-points, measured before the test. "
    "Tracking: rod against target, RMS as a share of the target's. Body and wheel: against the whole car computed "
    "with the assumed damper, in these bands. Where the damper is another one than assumed, the difference is its "
    "answer, no error of the test."
)
SHOWN_S = 2.0
"""Of the tracking, about the middle of the test: more is not legible."""


def hybrid_part(tests: Sequence[HybridTest]) -> str:
    """Table and plots of the run's hybrid tests; empty without any."""
    if not tests:
        return ""
    rows = [(text(test.id), _row(test)) for test in tests]
    parts = [heading("Hybrid tests", NOTE), table(HEAD, [("", (name, *cells)) for name, cells in rows], range(3, 14))]
    missing = [text(test.id) for test in tests if test.record is None]
    if missing:
        parts.append(box("warn", f"Too little was recorded of {', '.join(missing)} to compare."))
    parts += [_plots(test, test.record) for test in tests if test.record is not None]
    return "".join(parts)


def _row(test: HybridTest) -> tuple[str, ...]:
    shown = test.to_json()
    criteria = shown["criteria"]
    percent = (shown["tracking_nrms"], shown["reference_error"], shown["hop_error"], shown["energy_error"])
    return (
        text(test.compensator), text(test.law), _number(shown["delay_ms"]),
        *(_number(None if value is None else 100.0 * value) for value in percent),
        NOTHING if shown["late_steps"] is None else str(shown["late_steps"]),
        *(_number(criteria.get(name)) for name in ("J1", "J2", "J4", "J6", "J7")),
    )


def _number(value: float | None) -> str:
    return NOTHING if value is None else number(value, 3)


def _plots(test: HybridTest, record: Record) -> str:
    """Rod against target over a short time, body against reference over all of it."""
    middle_s = 0.5 * (record.time_s[0] + record.time_s[-1])
    near = abs(record.time_s - middle_s) <= 0.5 * SHOWN_S
    tracking = Chart(
        "Time s", "Extension mm",
        [_trace(record.time_s[near], record.target_m[near], "target", OVERLAID),
         _trace(record.time_s[near], record.measured_m[near], "rod", MEASURED)],
        480, 260, title=f"{test.id}: rod and target",
    )
    rows = thinned(len(record.time_s), 1500)
    body = Chart(
        "Time s", "Body mm",
        [_trace(record.time_s[rows], record.reference_m[rows, 1], "reference", FITTED),
         _trace(record.time_s[rows], record.body_m[rows], "hybrid", MEASURED)],
        480, 260, title=f"{test.id}: body",
    )
    keys = key_line("", key("rod, hybrid", MEASURED) + key("target", OVERLAID) + key("whole car computed", FITTED))
    return heading(text(test.id), level=3) + keys + charts([card("", tracking.svg()), card("", body.svg())])


def _trace(time_s: FloatArray, values_m: FloatArray, name: str, colour: str) -> Trace:
    return Trace(time_s, 1e3 * values_m, "m", name, colour)
