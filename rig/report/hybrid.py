"""The report's section on hybrid tests: each compared with the whole car, computed."""

from __future__ import annotations

from collections.abc import Sequence

from rig.characteristics.hybrid_tests import HybridTest
from rig.display import Display
from rig.document.blocks import Blocks, Card, Cards, Column, Figures, Heading, Keys, Note, section, table
from rig.document.figure import Axis, Figure, Trace, thinned
from rig.document.numbers import NOTHING, number
from rig.document.style import FITTED, MEASURED, OVERLAID
from rig.document.words import FAIR, Key
from rig.hybrid.assessment import Record

CRITERIA = (("J1", "ms"), ("J2", "%"), ("J4", "%"), ("J6", "%"), ("J7", "%"))
HEAD = (
    Column("Point"), Column("Compensation"), Column("Law"), Column("Delay", "ms", True),
    Column("Tracking error", "%", True), Column("Body, up to 3 Hz", "%", True), Column("Wheel, 8 to 15 Hz", "%", True),
    Column("Energy error", "%", True), Column("Late set-points", "", True),
    *(Column(name, unit, True) for name, unit in CRITERIA),
)  # fmt: skip
NOTE = (
    "The damper moves as in the simulated car. Delay: delay between the set-points and the rod motion, measured "
    "before the test. Tracking error: RMS difference between rod and target, relative to the RMS of the "
    "target. Body and wheel: difference from a complete simulation of the car with the assumed damper, in the stated "
    "frequency bands. If the tested damper differs from the assumed damper, this difference is a result, not a test "
    "error."
)
SHOWN_S = 2.0
"""Of the tracking, about the middle of the test: a longer time is not legible."""
MOST_DRAWN = 1500


def hybrid_section(tests: Sequence[HybridTest], display: Display) -> Blocks:
    """Table and plots of the run's hybrid tests; empty without any."""
    if not tests:
        return []
    parts: Blocks = [*section("Hybrid tests", NOTE), table(HEAD, [(test.id, *_row(test)) for test in tests])]
    missing = [test.id for test in tests if test.record is None]
    if missing:
        parts.append(Note(FAIR, f"The recording is too short for a comparison: {', '.join(missing)}."))
    return parts + [block for test in tests if test.record is not None for block in _plots(test, test.record, display)]


def _row(test: HybridTest) -> tuple[str, ...]:
    shown = test.to_json()
    criteria = shown["criteria"]
    percent = (shown["tracking_nrms"], shown["reference_error"], shown["hop_error"], shown["energy_error"])
    return (
        test.compensator, test.law, _number(shown["delay_ms"]),
        *(_number(None if value is None else 100.0 * value) for value in percent),
        NOTHING if shown["late_steps"] is None else str(shown["late_steps"]),
        *(_number(criteria.get(name)) for name, _ in CRITERIA),
    )


def _number(value: float | None) -> str:
    return NOTHING if value is None else number(value, 3)


def _plots(test: HybridTest, record: Record, display: Display) -> Blocks:
    """Rod against target over a short time, body against reference over all of it."""
    time, time_s, shown = Axis("Time", "s"), record.time_s, display.displacement
    middle_s = 0.5 * (time_s[0] + time_s[-1])
    near = abs(time_s - middle_s) <= 0.5 * SHOWN_S
    tracking = Figure(
        time, Axis(shown.title("Rod"), shown.unit),
        [Trace(time_s[near], shown.signed(record.target_m[near]), name="target", colour=OVERLAID),
         Trace(time_s[near], shown.signed(record.measured_m[near]), name="rod", colour=MEASURED)],
        480, 260, title=f"{test.id}: rod and target",
    )
    rows = thinned(len(time_s), MOST_DRAWN)
    body = Figure(
        time, Axis("Body", shown.unit),
        [Trace(time_s[rows], shown.value(record.reference_m[rows, 1]), name="reference", colour=FITTED),
         Trace(time_s[rows], shown.value(record.body_m[rows]), name="hybrid", colour=MEASURED)],
        480, 260, title=f"{test.id}: body",
    )
    keys = (Key("rod, hybrid", MEASURED), Key("target", OVERLAID), Key("complete simulation", FITTED))
    cards = Cards((Card("", (Figures((tracking,)),)), Card("", (Figures((body,)),))))
    return [Heading(test.id, 3), Keys(keys), cards]
