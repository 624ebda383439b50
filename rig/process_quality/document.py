"""The studies of the process as documents: verdict, table, charts with limits and marked violations, remarks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import datetime

import numpy as np

from rig.display import SI, Display, Shown
from rig.document.blocks import (
    Block,
    Blocks,
    Card,
    Cards,
    Column,
    Document,
    Fact,
    Facts,
    Figures,
    Heading,
    Items,
    Note,
    Paragraph,
    Row,
    section,
    table,
    with_contents,
)
from rig.document.figure import Axis, Figure, Style, Trace
from rig.document.numbers import NOTHING, number, with_uncertainty
from rig.document.words import FAIR, GOOD, PLAIN, POOR, Severity, Words
from rig.process_quality.capability import REQUIRED, Capability, Index
from rig.process_quality.control_chart import ControlChart, Rule
from rig.process_quality.display_units import size_of
from rig.process_quality.gauge_study import FAIR_PERCENT, FEWEST_CATEGORIES, GOOD_PERCENT, Component, GaugeStudy
from rig.process_quality.golden import DayFinding, Explanation
from rig.process_quality.series import when
from rig.process_quality.study import ChartStudy, GaugeResult, GaugeStudies, GoldenStudy, SeriesResult
from rig.report.cover import SIMULATED
from rig.results.reader import ResultRow
from rig.signals.arrays import FloatArray

Study = ChartStudy | GoldenStudy | GaugeStudies
LIMIT, CENTRE, SIGNAL, TOLERANCE = "#c0392b", "#5b6470", "#c0392b", "#8e44ad"
WIDTH, HEIGHT = 620, 240
MOST_DRAWN = 40
"""Charts in a document; those with signals come first."""
MOST_POINTS = 2_000
"""Values of a chart that are drawn; the last ones."""
MOST_NAMED = 12
"""Signals that are listed for a chart."""
DAYS_NAMED = 20
CHART_HEAD = (
    Column("value"), Column("unit"), Column("campaigns", "", True), Column("centre", "", True),
    Column("sigma", "", True), Column("signals", "", True), Column("last signal"),
)  # fmt: skip
CAPABILITY_HEAD = (
    Column("value"), Column("limits"), Column("Cp", "", True), Column("Cpk", "", True), Column("Pp", "", True),
    Column("Ppk", "", True), Column("outside", "", True), Column("uncertainty", "% of tolerance", True),
)  # fmt: skip
MEASUREMENT_HEAD = (
    Column("value"), Column("tolerance", "", True), Column("Cg", "", True), Column("Cgk", "", True),
    Column("bias", "", True),
)  # fmt: skip
GAUGE_HEAD = (
    Column("value"), Column("specimens", "", True), Column("operators", "", True), Column("trials", "", True),
    Column("%GRR", "", True), Column("95 % interval"), Column("%GRR of tolerance", "", True), Column("ndc", "", True),
)  # fmt: skip
COMPONENT_HEAD = (
    Column("source"), Column("standard deviation", "", True), Column("95 % interval"),
    Column("contribution", "%", True), Column("of study variation", "%", True), Column("of tolerance", "%", True),
)  # fmt: skip
SOURCES = {
    "gauge": "gauge R&R", "repeatability": "repeatability", "reproducibility": "reproducibility",
    "operator": "operator", "interaction": "operator x specimen", "part": "specimen to specimen", "total": "total",
}  # fmt: skip


def document_of(study: Study, *, simulated: bool, display: Display = SI) -> Document:
    """The page of a study: tables as on the terminal, then charts.

    Args:
        study: what to show; charts and gauge studies are already in the units of the display.
        simulated: whether all values come from a simulated rig.
        display: units, signs and paper size.
    """
    title = {ChartStudy: "Control charts", GoldenStudy: "Golden damper check",
             GaugeStudies: "Gauge repeatability and reproducibility"}[type(study)]
    blocks: Blocks = [Heading(title, 1), _facts(study), *blocks_of(study, None, display), *_figures(study, display)]
    return Document(title, tuple(with_contents(blocks)), SIMULATED if simulated else "", display.paper)


def blocks_of(study: Study, most: int | None, display: Display = SI) -> Blocks:
    """Verdict, tables and remarks; at most so many rows in a table (None: all)."""
    if isinstance(study, ChartStudy):
        blocks = _charts(study, most)
    elif isinstance(study, GoldenStudy):
        blocks = _golden(study, most, display)
    else:
        blocks = _gauges(study, most)
    return [*blocks, *(Note(FAIR, f"remark: {remark}") for remark in study.remarks)]


def _facts(study: Study) -> Facts:
    if isinstance(study, ChartStudy):
        charted = [one for one in study.results if one.chart is not None]
        bad = sum(one.chart is not None and not one.chart.in_control for one in charted)
        return Facts((
            Fact(f"{len(charted) - bad} of {len(charted)}", "quantities in control", POOR if bad else GOOD),
            Fact(str(max(len(one.series.values) for one in study.results)), "campaigns"),
        ))
    if isinstance(study, GoldenStudy):
        word = "no signal" if study.passed else "drift"
        return Facts((
            Fact(word, "on the last day", GOOD if study.passed else POOR), Fact(str(study.check.days), "days"),
            Fact(str(len(study.check.findings)), "days with a signal", FAIR if study.check.findings else GOOD),
        ))
    known = [one.study for one in study.results if one.study is not None]
    worst = max(known, key=lambda one: one.components["gauge"].study_percent)
    return Facts((
        Fact(f"{number(worst.components['gauge'].study_percent, 3)} %", "largest %GRR of study variation",
             _grr(worst.components["gauge"].study_percent)),
        Fact(str(min(one.ndc for one in known)), "smallest number of distinct categories"),
    ))


def _charts(study: ChartStudy, most: int | None) -> Blocks:
    rows = [_chart_row(one) for one in _ordered(study.results)]
    blocks: Blocks = [*_listed(CHART_HEAD, rows, most), *_named(study.results)]
    capable = [one for one in study.results if one.capability is not None]
    if capable:
        note = (
            "Cp and Cpk: short-term variation, from moving ranges; Pp and Ppk: total variation. Intervals: 95 %. "
            "All values are included, those with signals too."
        )
        listed = _listed(CAPABILITY_HEAD, map(_capability, capable), most)
        blocks += [*section("Process capability", note), *listed]
    measured = [one for one in study.results if one.measurement is not None]
    if measured:
        note = "All values come from one specimen, so their variation is that of the measurement (type-1 study)."
        blocks += [*section("Measurement capability", note),
                   *_listed(MEASUREMENT_HEAD, map(_measurement, measured), most)]  # fmt: skip
    return [*blocks, *_reasons(
        (one.series.label, (*one.why, *(() if one.chart is None else one.chart.remarks),
                            *(() if one.capability is None else one.capability.remarks)))
        for one in study.results
    )]  # fmt: skip


def _reasons(listed: Iterable[tuple[str, Iterable[str]]]) -> Blocks:
    """One note for each reason, with the first label it applies to and the number of further ones.

    Args:
        listed: label and its reasons, in order.
    """
    by_reason: dict[str, list[str]] = {}
    for label, reasons in listed:
        for reason in reasons:
            by_reason.setdefault(reason, []).append(label)
    notes: Blocks = []
    for reason, labels in by_reason.items():
        more = f" (and {len(labels) - 1} more)" if len(labels) > 1 else ""
        notes.append(Note(FAIR, f"{labels[0]}{more}: {reason}"))
    return notes


def _ordered(results: Sequence[SeriesResult]) -> list[SeriesResult]:
    """Series with signals first, then in their order."""
    return sorted(results, key=lambda one: one.chart is None or one.chart.in_control)


def _listed(head: Sequence[Column], rows: Iterable[Row], most: int | None) -> list[Block]:
    listed = list(rows)
    if most is None or len(listed) <= most:
        return [table(head, listed)]
    omitted = f"{len(listed) - most} more; --json or --out lists all"
    return [table(head, listed[:most]), Paragraph(omitted, small=True)]


def _chart_row(one: SeriesResult) -> Row:
    chart, series = one.chart, one.series
    if chart is None:
        return Row((series.label, series.unit, str(len(series.values)), NOTHING, NOTHING, NOTHING, NOTHING), FAIR)
    shown = chart.signals if len(chart.values) > chart.baseline else chart.violations
    row = series.rows[shown[-1].index] if shown else None
    last = NOTHING if row is None else ", ".join(filter(None, (row.specimen, _date(row.started))))
    cells = (series.label, series.unit, str(len(series.values)), number(chart.centre, 5), number(chart.sigma, 3),
             str(len({violation.index for violation in shown})), last)  # fmt: skip
    return Row(cells, GOOD if chart.in_control else POOR)


def _date(started: datetime | None) -> str:
    return "" if started is None else f"{started:%Y-%m-%d %H:%M}"


def _named(results: Sequence[SeriesResult]) -> Blocks:
    """Each campaign with signals: how many of its values signal, the largest deviation, and the rules."""
    by_run: dict[str, list[tuple[SeriesResult, int, list[Rule]]]] = {}
    for one in results:
        rules: dict[int, list[Rule]] = {}
        for violation in () if one.chart is None else one.chart.violations:
            rules.setdefault(violation.index, []).append(violation.rule)
        for index, violated in rules.items():
            by_run.setdefault(one.series.rows[index].campaign, []).append((one, index, violated))
    if not by_run:
        return []
    ordered = sorted(by_run.values(), key=lambda listed: (when(listed[0][0].series.rows[listed[0][1]]), len(listed)))
    texts = [_campaign_signals(listed) for listed in ordered[-MOST_NAMED:]]
    omitted = f"Earlier campaigns with signals, not listed: {len(ordered) - MOST_NAMED} (--json lists all)"
    more = [Paragraph(omitted, small=True)] if len(ordered) > MOST_NAMED else []
    return [Heading("Campaigns with signals", 3), Items(tuple(texts)), *more]


def _campaign_signals(listed: Sequence[tuple[SeriesResult, int, list[Rule]]]) -> str:
    """The signals of one campaign: (series, index of its value, violated rules) each."""
    def sigmas(item: tuple[SeriesResult, int, list[Rule]]) -> float:
        chart, index = item[0].chart, item[1]
        return 0.0 if chart is None or chart.sigma == 0.0 else float(chart.values[index] - chart.centre) / chart.sigma

    largest = max(listed, key=lambda item: abs(sigmas(item)))
    one, index, _ = largest
    row = one.series.rows[index]
    rules = dict.fromkeys(rule for _, _, violated in listed for rule in violated)
    phase = " (phase I)" if one.chart is not None and index < one.chart.baseline else ""
    values = f"{len(listed)} value{'s' if len(listed) > 1 else ''}"
    return (
        f"{row.specimen or row.run}, {_date(row.started)}{phase}: {values}, largest deviation "
        f"{sigmas(largest):+.1f} sigma ({one.series.label}: {number(one.series.values[index])} {one.series.unit}); "
        f"{'; '.join(rule.words for rule in rules)}"
    )


def _index(index: Index | None) -> str:
    if index is None:
        return NOTHING
    return f"{index.value:.2f} ({index.low:.2f} to {index.high:.2f})"


def _of_index(index: Index) -> Severity:
    return GOOD if index.low >= REQUIRED else FAIR if index.value >= REQUIRED else POOR


def _range(capability: Capability) -> str:
    low, high = capability.low, capability.high
    if low is None:
        return f"at most {number(high)}"
    return f"at least {number(low)}" if high is None else f"{number(low)} to {number(high)}"


def _capability(one: SeriesResult) -> Row:
    capability = one.capability
    if capability is None:
        return Row((one.series.label, *[NOTHING] * (len(CAPABILITY_HEAD) - 1)))
    return Row((
        one.series.label, f"{_range(capability)} {one.series.unit}", _index(capability.cp), _index(capability.cpk),
        _index(capability.pp), _index(capability.ppk), str(capability.outside), number(one.uncertainty_percent, 3),
    ), _of_index(capability.ppk))  # fmt: skip


def _measurement(one: SeriesResult) -> Row:
    measured = one.measurement
    if measured is None:
        return Row((one.series.label, *[NOTHING] * (len(MEASUREMENT_HEAD) - 1)))
    bias = NOTHING
    if measured.bias is not None:
        bias = f"{number(measured.bias, 3)} {one.series.unit} (p = {measured.bias_p:.2g})"
    cells = (one.series.label, f"{number(measured.tolerance)} {one.series.unit}", _index(measured.cg),
             _index(measured.cgk), bias)  # fmt: skip
    return Row(cells, _of_index(measured.cgk or measured.cg))


def _golden(study: GoldenStudy, most: int | None, display: Display) -> Blocks:
    check = study.check
    blocks: Blocks = []
    if study.passed:
        blocks.append(Note(GOOD, f"{study.specimen}: no drift on the last day ({_day(study, check.days - 1)})"))
    for finding in check.findings[-1:]:
        today = finding.index == check.days - 1
        text = f"{study.specimen}, {_day(study, finding.index)}: drift: {_drift(finding, display)}"
        blocks.append(Note(POOR if today else FAIR, text))
        if today and finding.explanations:
            blocks.append(Items(tuple(one.cause.advice for one in finding.explanations)))
    rows = []
    for cause, chart in check.charts.items():
        shown, last = size_of(cause, display), float(chart.values[-1])
        signals = [finding for finding in check.findings if any(one.cause == cause for one in finding.explanations)]
        level = POOR if any(one.index == check.days - 1 for one in signals) else FAIR if signals else GOOD
        rows.append(Row((cause.words, shown.unit, number(shown.signed(last - chart.centre), 3),
                         number(3.0 * chart.sigma / shown.scale, 3),
                         str(len(signals))), level))  # fmt: skip
    head = (Column("possible cause"), Column("unit"), Column("last day", "", True), Column("3 sigma", "", True),
            Column("days attributed to this cause", "", True))  # fmt: skip
    blocks.append(table(head, rows))
    blocks.append(Paragraph("The size of each cause is estimated from all values of a day. A drift due to one cause "
        "also changes the estimates of the others, possibly beyond their limits, so the cause whose pattern fits best "
        "is reported.",
        small=True))
    listed = check.findings[-(most or DAYS_NAMED):]
    if len(listed) > 1:
        days = tuple(f"{_day(study, one.index)}: {_drift(one, display)}" for one in listed)
        blocks += [*section("Days with a signal"), Items(days)]
    return blocks


def _day(study: GoldenStudy, index: int) -> str:
    return _date(study.started[index]) or study.runs[index]


def _drift(finding: DayFinding, display: Display) -> str:
    if not finding.explanations:
        key, sigma = finding.shifted[0]
        return f"no single cause explains the deviations; largest: {key.label}, {sigma:+.1f} sigma"
    return " or ".join(_explained(one, size_of(one.cause, display)) for one in finding.explanations)


def _explained(one: Explanation, shown: Shown) -> str:
    size = with_uncertainty(shown.signed(one.size), one.std / shown.scale)
    return f"{one.cause.words}: {size} {shown.unit} (explains {100.0 * one.share:.0f} % of the deviation)"


def _grr(percent: float) -> Severity:
    return GOOD if percent < GOOD_PERCENT else FAIR if percent <= FAIR_PERCENT else POOR


def _interval(low: float, high: float, digits: int = 3) -> str:
    return f"{number(low, digits)} to {number(high, digits)}"


def _gauges(study: GaugeStudies, most: int | None) -> Blocks:
    rows = []
    for one in study.results:
        if one.study is None:
            rows.append(Row((one.series.label, *[NOTHING] * (len(GAUGE_HEAD) - 1)), FAIR))
            continue
        gauge = one.study.components["gauge"]
        level = max((_grr(gauge.study_percent), GOOD if one.study.ndc >= FEWEST_CATEGORIES else FAIR), key=_badness)
        rows.append(Row((
            one.series.label, str(one.study.parts), str(one.study.operators),
            number(one.study.trials, 3),
            f"{number(gauge.study_percent, 3)} %", f"{_interval(gauge.study_low, gauge.study_high)} %",
            number(gauge.tolerance_percent, 3), str(one.study.ndc),
        ), level))  # fmt: skip
    note = (f"%GRR: below {GOOD_PERCENT:g} % good, up to {FAIR_PERCENT:g} % acceptable for some uses; ndc: at least "
            f"{FEWEST_CATEGORIES} (AIAG MSA 4).")
    blocks: Blocks = [*_listed(GAUGE_HEAD, rows, most), Paragraph(note, small=True)]
    shown = [one for one in study.results if one.study is not None]
    for one in shown if most is None else shown[:1]:
        blocks += _components(one)
    return [*blocks, *_reasons(
        (one.series.label, (*one.why, *(() if one.study is None else one.study.remarks))) for one in study.results
    )]


def _badness(severity: Severity) -> int:
    return (PLAIN, GOOD, FAIR, POOR).index(severity)


def _components(one: GaugeResult) -> Blocks:
    study = one.study
    if study is None:
        return []
    names = [name for name in SOURCES if name in study.components and not (study.operators == 1 and name in {
        "reproducibility", "operator", "interaction"})]  # fmt: skip
    if study.pooled:
        names.remove("interaction")
    rows = [Row(_component(SOURCES[name], study.components[name])) for name in names]
    pooled = {True: "The interaction of operator and specimen is not significant and is pooled with the repeatability.",
              False: "The interaction of operator and specimen is significant.", None: ""}[study.pooled]
    return [Heading(f"{one.series.label} ({one.series.unit})", 3), table(COMPONENT_HEAD, rows),
            *([Paragraph(pooled, small=True)] if pooled else []), _anova(study)]  # fmt: skip


def _component(name: str, one: Component) -> tuple[Words, ...]:
    return (
        name, number(one.std), _interval(one.low, one.high), number(one.contribution_percent, 3),
        number(one.study_percent, 3), number(one.tolerance_percent, 3),
    )  # fmt: skip


def _anova(study: GaugeStudy) -> Block:
    head = (Column("source"), Column("DF", "", True), Column("sum of squares", "", True),
            Column("mean square", "", True), Column("F", "", True), Column("p", "", True))  # fmt: skip
    rows = [Row((SOURCES[row.name], str(row.freedom), number(row.sum_of_squares, 5), number(row.mean_square, 5),
                 number(row.F), number(row.p, 2))) for row in study.anova]  # fmt: skip
    return table(head, rows)


def _figures(study: Study, display: Display) -> Blocks:
    """Charts of the study."""
    if isinstance(study, ChartStudy):
        charted = [one for one in _ordered(study.results) if one.chart is not None]
        note = ("Dashed: centre and control limits at 3 sigma; the vertical line ends phase I. Marked: values that "
                "violate a rule, and moving ranges beyond their limit (the return from a value beyond the limits is "
                "not a signal).")
        blocks: Blocks = section("Charts", note) if charted else []
        for one in charted[:MOST_DRAWN]:
            if one.chart is not None:
                limits = (one.capability.low, one.capability.high) if one.capability is not None else (None, None)
                names = [_campaign_name(row) for row in one.series.rows]
                drawn = chart_figures(one.chart, one.series.unit, limits=limits, names=names)
                blocks += [Heading(one.series.label, 3), Figures(tuple(drawn), 2), *_marked(one.chart, names)]
        if len(charted) > MOST_DRAWN:
            omitted = f"Further charts, not drawn: {len(charted) - MOST_DRAWN}. Use --quantity to select charts."
            blocks.append(Paragraph(omitted))
        return blocks
    if isinstance(study, GoldenStudy):
        blocks = section("Charts", "Size of each possible cause by day, with control limits at 3 sigma.")
        cards = tuple(
            Card(f"{cause.words}, {shown.unit}",
                 (Figures((chart_figures(_scaled(chart, shown), shown.unit, "Day")[0],)),))
            for cause, chart in study.check.charts.items() for shown in (size_of(cause, display),)
        )
        return [*blocks, Cards(cards, large=True)]
    return []


def _campaign_name(row: ResultRow) -> str:
    return row.specimen or row.run


def _marked(chart: ControlChart, names: Sequence[str]) -> list[Block]:
    """Which campaigns the numbers of the marked values are."""
    indices = sorted({one.index for one in chart.violations})
    if not indices:
        return []
    listed = ", ".join(f"{index + 1}: {names[index]}" for index in indices[-MOST_NAMED:])
    earlier = f"; earlier campaigns not listed: {len(indices) - MOST_NAMED}" if len(indices) > MOST_NAMED else ""
    return [Paragraph(f"Campaigns with signals: {listed}{earlier}", small=True)]


def _scaled(chart: ControlChart, shown: Shown) -> ControlChart:
    """A chart of differences in the unit of a display."""
    return replace(chart, values=shown.signed(chart.values), centre=shown.signed(chart.centre),
                   sigma=chart.sigma / shown.scale, mean_range=chart.mean_range / shown.scale)


def chart_figures(
    chart: ControlChart, unit: str, of: str = "Campaign", limits: tuple[float | None, float | None] = (None, None),
    names: Sequence[str] = (),
) -> list[Figure]:
    """Chart of individual values and chart of moving ranges, with limits and marked violations.

    Args:
        chart: what to draw; of many values the last `MOST_POINTS`.
        unit: of the values.
        of: what a value is of.
        limits: specification limits; None: open.
        names: of the campaigns, shown under the pointer on marked values; empty: their numbers only.
    """
    first = max(0, len(chart.values) - MOST_POINTS)
    x = np.arange(first, len(chart.values), dtype=np.float64) + 1.0
    ends = np.array([x[0], x[-1]])
    low, high = chart.limits
    of_values = {one.index for one in chart.violations if one.rule != Rule.RANGE}
    of_ranges = set((np.flatnonzero(chart.ranges > chart.range_limit) + 1).tolist())
    values = [_level(ends, chart.centre, CENTRE), *(_level(ends, one, LIMIT) for one in (low, high))]
    values += [_level(ends, one, TOLERANCE) for one in limits if one is not None]
    everything = [chart.values[first:], np.array([low, high, *(one for one in limits if one is not None)])]
    bottom, top = float(min(np.nanmin(one) for one in everything)), float(max(np.nanmax(one) for one in everything))
    room = 0.05 * (top - bottom) or abs(top) * 0.05 or 1.0
    if first < chart.baseline < len(chart.values):
        values.append(Trace(np.full(2, chart.baseline + 0.5), np.array([bottom - room, top + room]), Style.THIN))
    values += [Trace(x, chart.values[first:], Style.MEASURED), *_marks(x, chart.values[first:], of_values, names)]
    limited = (bottom - room, top + room)
    ranges = np.concatenate(([np.nan], chart.ranges))[first:]
    of_range = [_level(ends, chart.mean_range, CENTRE), _level(ends, chart.range_limit, LIMIT),
                Trace(x, ranges, Style.MEASURED), *_marks(x, ranges, of_ranges, names)]  # fmt: skip
    axis = Axis(of, "")
    return [
        Figure(axis, Axis("Value", unit, limited), values, WIDTH, HEIGHT, "Individual values"),
        Figure(axis, Axis("Moving range", unit), of_range, WIDTH, HEIGHT, "Moving ranges"),
    ]


def _level(ends: FloatArray, value: float, colour: str) -> Trace:
    return Trace(ends, np.full(2, value), Style.FITTED, "", colour)


def _marks(x: FloatArray, y: FloatArray, indices: Iterable[int], names: Sequence[str]) -> list[Trace]:
    """Crosses on the values with these indices; `x` are the numbers of the values, from 1."""
    first = int(x[0]) - 1
    places = sorted(index - first for index in indices if index >= first)
    if not places:
        return []
    if not names:
        return [Trace(x[places], y[places], Style.POINTS, "", SIGNAL)]
    return [Trace(x[[place]], y[[place]], Style.POINTS, f"{place + first + 1}: {names[place + first]}", SIGNAL)
            for place in places]
