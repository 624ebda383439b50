"""The report's section on endurance tests: cycles, wear over the cycles, stop rules, performance points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rig.characteristics.endurance_tests import EnduranceTest
from rig.display import Display
from rig.document.blocks import (
    Blocks,
    Column,
    Fact,
    Facts,
    Figures,
    Heading,
    Keys,
    Note,
    Paragraph,
    Row,
    section,
    table,
)
from rig.document.figure import Axis, Figure, Panels, Style, Trace, thinned
from rig.document.numbers import MINUS, NOTHING, number
from rig.document.style import FITTED, MEASURED, RESIDUAL, current_colour
from rig.document.words import FAIR, GOOD, PLAIN, POOR, Key, Severity, capitalised
from rig.recording.endurance import COMPLETE, ENDED
from rig.recording.recorded_point import RecordedPoint
from rig.signals.arrays import FloatArray
from rig.signals.wear_trend import RULES, Forecast, Sections, StopRule

NOTE = (
    "The specimen was cycled in blocks; the points of the matrix were repeated between them. Statistics are stored "
    "for every cycle. Each point of the plots is the median of a section of a block. Changes are relative to the first "
    "block after the running-in; the value after ± is the half-width of the 95 % interval of the last change, from the "
    "scatter of the cycles. A relative limit is reached if it is exceeded by more than this scatter explains. "
    "Forecast: cycles at which a straight line through the last half of the sections reaches the limit, with its 95 % "
    "interval. In a current program, cycles at the same current are compared; each rule shows the current at which it "
    "is closest to its limit."
)
MEAN_FORCE_NOTE = (
    "A decrease of the mean of rebound and compression force is no proof of a gas leak: the mean is the gas force only "
    "of a symmetric damper; otherwise it decreases with the damping forces, too."
)
MOST_DRAWN = 2000
MOST_LISTED = 100
"""Rows of the table of blocks that are not valid."""
MOST_ROUNDS = 7
"""Loops of performance points that a figure shows: the first, the last, and some between."""
NEAR_LIMIT = 0.7
"""Share of a limit from which a rule's row is marked."""
RULE_HEAD = (
    Column("Stop rule"), Column("Limit", "", True), Column("Last value", "", True),
    Column("Forecast", "cycles", True), Column("95 % interval", "cycles", True),
)  # fmt: skip
PERFORMANCE_HEAD = (
    Column("Motion"), Column("Current", "A", True), Column("Cycles before", "", True),
)
WIDTH, HEIGHT = 460, 240


def endurance_section(tests: Sequence[EnduranceTest], display: Display) -> Blocks:
    """Tables and plots of the run's endurance tests; empty without any."""
    if not tests:
        return []
    parts: Blocks = [*section("Endurance", NOTE)]
    for test in tests:
        parts += [
            Heading(f"{test.ledger.test}: {test.motion.phrase(display)}", 3), *_counts(test), *_rules(test, display),
            *_wear(test, display), *_performance(test, display), *_interrupted(test),
        ]  # fmt: skip
    return parts


def endurance_facts(tests: Sequence[EnduranceTest], display: Display) -> list[Fact]:
    """Each test in one fact: cycles, the stop rule that ended it, and the last value of the rules."""
    return [_endurance_fact(test, display) for test in tests]


def _endurance_fact(test: EnduranceTest, display: Display) -> Fact:
    shown = test.to_json()
    state, ended = str(shown["state"]), shown["ended_by"]
    cycles = f"{shown['cycles_run']:,}" if ended else f"{shown['cycles_run']:,} of {shown['cycles_planned']:,}"
    parts = [f"cycles of the endurance test {shown['id']}"]
    if ended:
        parts = [f"{parts[0]}, of {shown['cycles_planned']:,} planned", f"ended by a stop rule: {RULES[ended].words}"]
    for rule in test.ledger.rules:
        last = test.ledger.followed(rule).last
        if last is not None:
            parts.append(f"{rule.kind.words} {_value(rule, last, display)} (limit {_value(rule, rule.limit, display)})")
        elif test.ledger.why_not_evaluated(rule):
            parts.append(f"{rule.kind.words} not evaluated")
    return Fact(cycles, "; ".join(parts), {COMPLETE: GOOD, ENDED: FAIR}.get(state, PLAIN))


def _counts(test: EnduranceTest) -> Blocks:
    shown = test.to_json()
    state = str(shown["state"])
    severity = {COMPLETE: GOOD, ENDED: FAIR}.get(state, PLAIN)
    facts = [
        Fact(f"{shown['cycles_run']:,} of {shown['cycles_planned']:,}", "cycles run", severity),
        Fact(f"{shown['cycles_recorded']:,}", "cycles with statistics"),
    ]
    missing = shown["cycles_run"] - shown["cycles_recorded"]
    if missing:
        facts.append(Fact(f"{missing:,}", "cycles with incomplete samples", FAIR))
    if shown["cycles_unrecorded_at_most"]:
        facts.append(Fact(f"up to {shown['cycles_unrecorded_at_most']:,}", "further cycles ran without a record", FAIR))
    ended = RULES[shown["ended_by"]].words if shown["ended_by"] else ""
    notes: Blocks = [Note(FAIR, f"A stop rule ended the test: {ended}.")] if ended else []
    return [Facts(tuple(facts)), *notes]


def _rules(test: EnduranceTest, display: Display) -> Blocks:
    rows, notes = [], list[str]()
    for rule in test.ledger.rules:
        followed = test.ledger.followed(rule)
        if why := test.ledger.why_not_evaluated(rule):
            notes.append(f"{capitalised(rule.kind.words)} was not evaluated: {why}.")
        last = np.nan if followed.last is None else followed.last
        cycles, interval = _forecast(followed.forecast)
        shown = _value(rule, last, display, followed.uncertainty)
        cells = (capitalised(rule.kind.words), _value(rule, rule.limit, display), shown, cycles, interval)
        if "mean_force" in rule.kind.quantities:
            notes.append(MEAN_FORCE_NOTE)
        rows.append(Row(cells, _severity(rule, last, reached=followed.forecast.state == "reached")))
    return [table(RULE_HEAD, rows), *(Note(FAIR, note) for note in notes)] if rows else []


def _severity(rule: StopRule, last: float, *, reached: bool) -> Severity:
    return POOR if reached else FAIR if last >= NEAR_LIMIT * rule.limit else PLAIN


def _value(rule: StopRule, value: float, display: Display, uncertainty: float = np.nan) -> str:
    """A share in % with its uncertainty, or a temperature in the unit of the display."""
    if not np.isfinite(value):
        return NOTHING
    if not rule.kind.relative:
        return f"{number(display.temperature.value(value), 3)} {display.temperature.unit}"
    about = f" ± {number(100.0 * uncertainty, 2)}" if np.isfinite(uncertainty) else ""
    return f"{number(100.0 * value, 3)}{about} %"


def _forecast(expected: Forecast) -> tuple[str, str]:
    """Estimate and interval, in words."""
    if expected.state == "reached":
        return f"reached at {_rounded(expected.cycles)}", NOTHING
    if expected.state == "trend":
        return _rounded(expected.cycles), f"{_rounded(expected.low)} to {_rounded(expected.high)}"
    if expected.state == "unknown":
        return expected.reason, NOTHING
    return expected.reason, NOTHING if expected.low is None else f"not before {_rounded(expected.low)}"


def _rounded(cycles: float | None) -> str:
    """To three digits."""
    return NOTHING if cycles is None else f"{int(float(f'{cycles:.3g}')):,}"


def _wear(test: EnduranceTest, display: Display) -> Blocks:
    """Medians of the sections over the cycles, and the limits of the stop rules."""
    sections = test.ledger.sections
    if not len(sections):
        return []
    groups = sections.groups
    colours = [MEASURED] if len(groups) == 1 else [current_colour(place, len(groups)) for place in range(len(groups))]
    figures = []
    for of_groups in zip(*(_columns(group, display) for group in groups), strict=True):
        title, axis, _ = of_groups[0]
        if not any(np.any(np.isfinite(values)) for _, _, values in of_groups):
            continue
        traces = []
        for group, colour, (_, _, values) in zip(groups, colours, of_groups, strict=True):
            rows = thinned(len(group), MOST_DRAWN)
            traces.append(Trace(group.cycle[rows], values[rows], Style.POINTS, colour=colour))
        figures.append(Figure(Axis("Cycles"), axis, traces, WIDTH, HEIGHT, title))
    figures += list(_rule_figures(test))
    drawn = {trace.name for figure in figures for trace in figure.traces}
    medians = [Key("median of a section", MEASURED)]
    if len(groups) > 1:
        medians = [
            Key(f"cycles at {float(np.nanmedian(group.medians['current'])):.3g} A", colour)
            for group, colour in zip(groups, colours, strict=True)
        ]
    return [
        Keys((*medians, *(key for key in (Key("limit", FITTED), Key("forecast", RESIDUAL)) if key.text in drawn))),
        *_in_rows(figures, "Wear over the cycles"),
    ]


def _in_rows(figures: Sequence[Figure], title: str) -> Blocks:
    """Figures two by two, a row a block: a printed page breaks between rows."""
    return [Figures((Panels(tuple(figures[place : place + 2]), 2, title),)) for place in range(0, len(figures), 2)]


def _columns(sections: Sections, display: Display) -> Iterator[tuple[str, Axis, FloatArray]]:
    """Title, vertical axis and medians (n,) of each quantity that is drawn."""
    medians, force, energy = sections.medians, Axis("Force", display.force.unit), display.energy
    for title, name in (("Peak force, rebound", "force_max"), ("Peak force, compression", "force_min")):
        yield title, force, np.asarray(display.force.signed(medians[name]))
    yield "Energy per cycle", Axis("Energy", energy.unit), np.asarray(energy.value(medians["energy"]))
    yield "Friction", force, np.asarray(display.force.value(medians["friction"]))
    yield "Mean force", force, np.asarray(display.force.signed(medians["mean_force"]))
    temperature = display.temperature
    coil = np.asarray(temperature.value(medians["temperature"]))
    yield "Coil temperature", Axis("Temperature", temperature.unit), coil


def _rule_figures(test: EnduranceTest) -> Iterator[Figure]:
    """Each relative stop rule: change, limit, and the straight line of the forecast."""
    for rule in test.ledger.rules:
        sections, change, expected, _ = test.ledger.followed(rule)
        cycles = sections.cycle
        rows = thinned(len(sections), MOST_DRAWN)
        if not rule.kind.relative or not np.any(np.isfinite(change)):
            continue
        end = max(float(cycles[-1]), min(float(test.planned), expected.cycles or 0.0))
        limit = np.full(2, 100.0 * rule.limit)
        traces = [
            Trace(cycles[rows], 100.0 * change[rows], Style.POINTS, colour=MEASURED),
            Trace(np.array([0.0, end]), limit, name="limit", colour=FITTED),
        ]
        if expected.state == "trend" and expected.cycles is not None:
            last = int(np.flatnonzero(np.isfinite(change))[-1])
            line = np.array([100.0 * change[last], 100.0 * rule.limit])
            traces.append(Trace(np.array([cycles[last], expected.cycles]), line, Style.THIN, "forecast", RESIDUAL))
        title = capitalised(rule.kind.words)
        yield Figure(Axis("Cycles"), Axis("Change", "%"), traces, WIDTH, HEIGHT, title)


Rounds = Mapping[tuple[object, ...], list[tuple[int, RecordedPoint]]]


def _performance(test: EnduranceTest, display: Display) -> Blocks:
    """Peak forces of the performance points over the cycles, and their loops one over the other."""
    motions: dict[tuple[object, ...], list[tuple[int, RecordedPoint]]] = {}
    for cycles, point in test.performance:
        key = point.kind, point.waveform, point.amplitude_m, point.frequency_Hz, point.current_A
        motions.setdefault(key, []).append((cycles, point))
    several = {key: rounds for key, rounds in motions.items() if len({cycles for cycles, _ in rounds}) > 1}
    if not several:
        return []
    return [
        Heading("Performance points", 3), *_peak_table(several, display),
        Keys(tuple(_keys(several))), *_in_rows(list(_loops(several, display)), "Performance points"),
    ]  # fmt: skip


def _peak_table(motions: Rounds, display: Display) -> Blocks:
    shown = display.force
    head = (
        *PERFORMANCE_HEAD, Column("Peak rebound", shown.unit, True), Column("Change", "%", True),
        Column("Peak compression", shown.unit, True), Column("Change", "%", True),
    )  # fmt: skip
    rows = []
    for rounds in motions.values():
        first = rounds[0][1].peak_force_N
        for cycles, point in rounds:
            peak = point.peak_force_N
            if not peak.known:
                continue
            size = f"{point.waveform} {display.displacement.text(point.amplitude_m)} {point.rate(display)}"
            rows.append((
                size, f"{point.current_A:.3g}", f"{cycles:,}",
                number(shown.signed(peak.rebound_N), 4), _change(peak.rebound_N, first.rebound_N),
                number(shown.signed(peak.compression_N), 4), _change(peak.compression_N, first.compression_N),
            ))  # fmt: skip
    return [table(head, rows)]


def _change(value: float, first: float) -> str:
    if not first or not np.isfinite(value / first):
        return NOTHING
    return f"{100.0 * (value / first - 1.0):+.1f}".replace("-", MINUS)


def _shown_rounds(rounds: Sequence[tuple[int, RecordedPoint]]) -> list[tuple[int, RecordedPoint]]:
    """One of each round, and of many rounds some, the first and the last among them."""
    one = list({cycles: (cycles, point) for cycles, point in rounds}.values())
    return [one[place] for place in thinned(len(one), MOST_ROUNDS)]


def _keys(motions: Rounds) -> Iterator[Key]:
    rounds = _shown_rounds(next(iter(motions.values())))
    for place, (cycles, _) in enumerate(rounds):
        words = "before the first cycle" if cycles == 0 else f"after {cycles:,} cycles"
        yield Key(words, current_colour(place, len(rounds)))


def _loops(motions: Rounds, display: Display) -> Iterator[Figure]:
    """Force over displacement of one measured cycle of each round."""
    length, force = display.displacement, display.force
    for rounds in motions.values():
        shown = _shown_rounds(rounds)
        traces = []
        for place, (cycles, point) in enumerate(shown):
            rows = _one_cycle(point)
            traces.append(Trace(
                np.asarray(length.signed(point.displacement_m[rows])), np.asarray(force.signed(point.force_N[rows])),
                name=f"{cycles:,} cycles", colour=current_colour(place, len(shown)),
            ))  # fmt: skip
        point = shown[0][1]
        axes = Axis(length.title("Displacement"), length.unit), Axis(force.title("Force"), force.unit)
        yield Figure(*axes, traces, WIDTH, HEIGHT, point.phrase(display))


def _one_cycle(point: RecordedPoint) -> NDArray[np.int64]:
    """Rows of the middle one of a point's full cycles."""
    motion, time_s = point.quality.motion, point.time_s
    if motion.start_s is None or motion.end_s is None or not motion.cycles:
        return thinned(len(time_s))
    period_s = (motion.end_s - motion.start_s) / motion.cycles
    begin_s = motion.start_s + period_s * (motion.cycles // 2)
    return np.flatnonzero((time_s >= begin_s) & (time_s <= begin_s + 1.02 * period_s)).astype(np.int64)


def _interrupted(test: EnduranceTest) -> Blocks:
    """The blocks that were interrupted or whose verdict is not valid."""
    rows = [
        (str(piece.step.block), piece.file.removesuffix(".h5"), f"{piece.step.cycles_before:,}", f"{piece.run:,}",
         f"{piece.recorded:,}", f"up to {piece.unseen:,}" if piece.unseen else NOTHING, piece.verdict,
         "; ".join(piece.reasons) or NOTHING)
        for piece in test.ledger.pieces if piece.verdict != "valid"
    ]
    further = len(rows) - MOST_LISTED
    if not rows:
        return [Paragraph(f"All {len(test.ledger.pieces)} blocks are valid.", small=True)]
    head = (
        Column("Block", "", True), Column("File"), Column("Cycles before", "", True), Column("Cycles run", "", True),
        Column("With statistics", "", True), Column("Without a record", "", True), Column("Verdict"),
        Column("Reasons"),
    )  # fmt: skip
    omitted = f"Further blocks that are not valid, not listed: {further:,}."
    more = [Paragraph(omitted, small=True)] if further > 0 else []
    return [Heading("Blocks that are not valid", 3), table(head, rows[:MOST_LISTED]), *more]
