"""The studies of `rig quality`: charts of a process, the golden damper, gauge R&R, each from rows of the database."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any, Literal

import numpy as np

from rig.comparison.bands import Bands
from rig.display import SI, Display, Shown
from rig.errors import FileProblem, some
from rig.fits.plain import plain
from rig.process_quality.capability import (
    Capability,
    GaugeCapability,
    gauge_capability,
    process_capability,
    uncertainty_percent,
)
from rig.process_quality.control_chart import ControlChart, TooFewValues, control_chart
from rig.process_quality.display_units import shown_of
from rig.process_quality.gauge_study import GaugeStudy, gauge_study, table_of
from rig.process_quality.golden import GoldenCheck, Key, golden_check
from rig.process_quality.series import Series, limits_of, remarks_on, series_of, when
from rig.results.quantities import QUANTITIES
from rig.results.reader import MOST_LISTED, ResultRow

Operator = Literal["operator", "station"]
GOLDEN_QUANTITIES = frozenset({"peak_force_rebound", "peak_force_compression"})
"""Values that repeat others of the golden damper, and are not used beside them."""


@dataclass(frozen=True)
class Limits:
    """What values are required to be.

    Attributes:
        bands: acceptance bands; None without.
        low, high: limits for all requested series, in their SI unit; None: open.
        reference: reference value of one specimen, in its SI unit; None: unknown.
        display: units and signs of the series.
    """

    bands: Bands | None = None
    low: float | None = None
    high: float | None = None
    reference: float | None = None
    display: Display = SI

    @property
    def stated(self) -> bool:
        """Whether any limit is stated."""
        return self.bands is not None or self.low is not None or self.high is not None

    def of(self, series: Series) -> tuple[float | None, float | None]:
        """Lower and upper limit of a series, in its unit; None: open."""
        if self.low is not None or self.high is not None:
            low, high = self.low, self.high
        else:
            low, high = limits_of(series, self.bands)
        shown = self._shown(series)
        if shown is None:
            return low, high
        ends = [None if one is None else shown.signed(one) for one in (low, high)]
        low, high = ends[::-1] if shown.positive == "compression" else ends
        return low, high

    def reference_of(self, series: Series) -> float | None:
        """Reference value in the unit of a series; None: unknown."""
        shown = self._shown(series)
        return self.reference if shown is None or self.reference is None else shown.signed(self.reference)

    def _shown(self, series: Series) -> Shown | None:
        """How the series is shown; None: in SI units."""
        about = QUANTITIES.get(series.quantity)
        return None if about is None or self.display.usual else shown_of(about.name, about.unit, self.display)


@dataclass(frozen=True)
class SeriesResult:
    """One series with its chart and capability; `why` states what could not be evaluated.

    Attributes:
        series: the values.
        chart: control chart; None with too few values.
        capability: for its limits; None without limits or with too few values.
        measurement: capability of the measurement, if all values are of one specimen and both limits are known.
        uncertainty_percent: four standard uncertainties of a value in % of the tolerance (VDA 5); NaN if unknown.
        why: what could not be evaluated, and why.
    """

    series: Series
    chart: ControlChart | None = None
    capability: Capability | None = None
    measurement: GaugeCapability | None = None
    uncertainty_percent: float = math.nan
    why: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        return {
            **described(self.series),
            "runs": [row.run for row in self.series.rows], "specimens": list(self.series.specimens),
            "started": [_time(row.started) for row in self.series.rows],
            "chart": None if self.chart is None else self.chart.to_json(),
            "capability": None if self.capability is None else self.capability.to_json(),
            "measurement": None if self.measurement is None else self.measurement.to_json(),
            "uncertainty_percent_of_tolerance": plain(self.uncertainty_percent), "why": list(self.why),
        }  # fmt: skip


def described(series: Series) -> dict[str, Any]:
    """What a series is of."""
    return {"quantity": series.quantity, "unit": series.unit, "motion": series.motion, "current_A": series.current_A,
            "count": len(series.values)}  # fmt: skip


def _time(value: datetime | None) -> str | None:
    return None if value is None else value.isoformat(timespec="seconds")


@dataclass(frozen=True)
class ChartStudy:
    """Charts of all series."""

    results: tuple[SeriesResult, ...]
    remarks: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether every chart is in control."""
        return all(one.chart is None or one.chart.in_control for one in self.results)

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        return {"passed": self.passed, "series": [one.to_json() for one in self.results],
                "remarks": list(self.remarks)}  # fmt: skip


def chart_study(rows: Sequence[ResultRow], baseline: int | None = None, limits: Limits | None = None) -> ChartStudy:
    """Control chart and, with limits, capability of each series.

    Raises:
        FileProblem: there is no valid value.
    """
    limits = limits or Limits()
    series = series_of(rows)
    if not series:
        raise FileProblem("rig quality", [_nothing(rows)])
    _require_match("rig quality", series, limits)
    results = tuple(_charted(one, baseline, limits) for one in series)
    return ChartStudy(results, tuple(remarks_on(rows)))


def _nothing(rows: Sequence[ResultRow]) -> str:
    if rows:
        return f"none of the {len(rows)} values is of a valid point. Fix: select other runs"
    return "no value matches. Fix: use other filters; `rig runs` lists the runs"


def _require_match(place: str, series: Sequence[Series], limits: Limits) -> None:
    """Refuse bands none of which is stated for any of the values.

    Raises:
        FileProblem: with what the bands and the values are of.
    """
    if limits.bands is None or any(limits.of(one) != (None, None) for one in series):
        return
    stated = [
        f"{quantity} at {band.where}" if band.where else quantity for quantity, band in limits.bands.all
        if band.low is not None or band.high is not None
    ]
    present = [f"{one.quantity} at {one.location}" for one in series]
    raise FileProblem(place, [
        f"no band with limits matches any of the values. Bands ({limits.bands.name}): "
        f"{some(stated, '; ', MOST_LISTED) or 'none'}. Values: {some(present, '; ', MOST_LISTED)}. "
        "Fix: specify bands for these values, or use --low and --high"
    ])


def _charted(series: Series, baseline: int | None, limits: Limits) -> SeriesResult:
    result, why = SeriesResult(series), list[str]()
    try:
        result = replace(result, chart=control_chart(series.values, baseline, series.resolution))
    except TooFewValues as error:
        why.append(f"no control chart: {error}")
    low, high = limits.of(series)
    if low is None and high is None:
        if limits.stated:
            why.append("no capability: no limit is stated for this value")
        return replace(result, why=tuple(why))
    try:
        result = replace(result, capability=process_capability(series.values, low, high))
    except ValueError as error:
        why.append(f"no capability: {error}")
    if low is None or high is None or not high > low:
        return replace(result, why=tuple(why))
    result = replace(result, uncertainty_percent=uncertainty_percent(series.uncertainty, high - low))
    if len(set(series.specimens)) == 1 and series.specimens[0]:
        try:
            measured = gauge_capability(series.values, high - low, limits.reference_of(series), series.uncertainty)
            result = replace(result, measurement=measured)
        except ValueError as error:
            why.append(f"no capability of the measurement: {error}")
    return replace(result, why=tuple(why))


@dataclass(frozen=True)
class GoldenStudy:
    """The check of a golden damper; `runs` and `started` are those of its days."""

    specimen: str
    check: GoldenCheck
    runs: tuple[str, ...]
    started: tuple[datetime | None, ...]
    remarks: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the last day is without a signal."""
        return self.check.passed

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        check = self.check
        return {
            "passed": self.passed, "specimen": self.specimen, "days": check.days, "baseline": check.baseline,
            "runs": list(self.runs), "started": [_time(one) for one in self.started],
            "values": [key.label for key in check.keys], "missing": [key.label for key in check.missing],
            "causes": {str(cause): {"unit": cause.unit, **chart.to_json()} for cause, chart in check.charts.items()},
            "findings": [{**one.to_json(), "run": self.runs[one.index]} for one in check.findings],
            "remarks": list(self.remarks),
        }  # fmt: skip


def golden_study(rows: Sequence[ResultRow], baseline: int | None = None) -> GoldenStudy:
    """Check the campaigns of one golden damper against their history.

    Raises:
        FileProblem: there is no valid value, values of several specimens or stations, or too few campaigns.
    """
    series = [one for one in series_of(rows) if one.quantity not in GOLDEN_QUANTITIES]
    if not series:
        raise FileProblem("rig quality golden", [_nothing(rows)])
    for name, option in (("specimen", "--specimen"), ("station", "--station")):
        known = sorted({getattr(row, name) for row in rows})
        if len(known) > 1:
            raise FileProblem("rig quality golden", [
                f"the values are of {len(known)} {name}s ({some([*map(repr, known)], most=MOST_LISTED)}), expected "
                f"one. Fix: select it with {option}"
            ])
    specimen, ordered = rows[0].specimen, _days(series)
    campaigns = {row.campaign: place for place, row in enumerate(ordered)}
    values, resolutions = {}, {}
    for one in series:
        column = np.full(len(campaigns), np.nan)
        for row, value in zip(one.rows, one.values, strict=True):
            column[campaigns[row.campaign]] = value
        key = Key(one.quantity, one.motion, one.current_A)
        values[key], resolutions[key] = column, one.resolution
    try:
        check = golden_check(values, baseline, resolutions=resolutions)
    except TooFewValues as error:
        raise FileProblem("rig quality golden", [f"{specimen or 'specimen'}: {error}"]) from error
    _require_last_day(rows, ordered, check)
    return GoldenStudy(
        specimen, check, tuple(row.run for row in ordered), tuple(row.started for row in ordered),
        (*remarks_on(rows), *check.remarks),
    )  # fmt: skip


def _require_last_day(rows: Sequence[ResultRow], days: Sequence[ResultRow], check: GoldenCheck) -> None:
    """Refuse a last day that cannot be checked: it would pass without a measurement.

    Raises:
        FileProblem: its points are not valid, or they do not show every cause.
    """
    last = max(rows, key=lambda row: (when(row), row.run))
    causes = ", ".join(cause.words for cause in check.unchecked)
    why = "no point is valid" if last.campaign != days[-1].campaign else causes and f"no valid value shows: {causes}"
    if why:
        raise FileProblem("rig quality golden", [
            f"the last run ({last.run}) cannot be checked: {why}. Fix: repeat the test, or select other runs (--date, "
            "--matrix)"
        ])


def _days(series: Sequence[Series]) -> list[ResultRow]:
    """One row of each campaign of any series, in the order of time."""
    by_campaign = {row.campaign: row for one in series for row in one.rows}
    return sorted(by_campaign.values(), key=lambda row: (when(row), row.run))


@dataclass(frozen=True)
class GaugeResult:
    """A gauge study of one series; `why` states why there is none."""

    series: Series
    study: GaugeStudy | None = None
    parts: tuple[str, ...] = ()
    operators: tuple[str, ...] = ()
    why: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        return {
            **described(self.series), "specimens": list(self.parts), "operators": list(self.operators),
            "study": None if self.study is None else self.study.to_json(), "why": list(self.why),
        }  # fmt: skip


@dataclass(frozen=True)
class GaugeStudies:
    """Gauge studies of all series."""

    results: tuple[GaugeResult, ...]
    by: Operator
    remarks: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        return {"by": self.by, "series": [one.to_json() for one in self.results], "remarks": list(self.remarks)}


def gauge_studies(
    rows: Sequence[ResultRow], by: Operator = "operator", limits: Limits | None = None
) -> GaugeStudies:
    """Repeatability and reproducibility of each series: specimens are parts, campaigns are trials.

    Args:
        rows: of the study.
        by: what varies between measurements of a specimen: the operator or the station.
        limits: for the percentage of the tolerance.

    Raises:
        FileProblem: there is no valid value, or no study can be made of any series; every reason is listed.
    """
    limits = limits or Limits()
    series = series_of(rows)
    if not series:
        raise FileProblem("rig quality gauge", [_nothing(rows)])
    _require_match("rig quality gauge", series, limits)
    results = tuple(_gauged(one, by, limits) for one in series)
    if all(one.study is None for one in results):
        reasons = dict.fromkeys(reason for one in results for reason in one.why)
        raise FileProblem("rig quality gauge", list(reasons)[:5])
    return GaugeStudies(results, by, tuple(remarks_on(rows)))


def _gauged(series: Series, by: Operator, limits: Limits) -> GaugeResult:
    names = [str(getattr(row, by)) for row in series.rows]
    why = []
    if not all(series.specimens):
        return GaugeResult(series, why=("a campaign states no specimen. Fix: state its serial number",))
    if not all(names) and any(names):
        without = names.count("")
        return GaugeResult(series, why=(f"campaigns that state no {by}: {without} of {len(names)}. Fix: state it",))
    cells: dict[tuple[str, str], list[float]] = {}
    for row, name, value in zip(series.rows, names, series.values, strict=True):
        cells.setdefault((row.specimen, name), []).append(float(value))
    if all(len(one) == 1 for one in cells.values()):  # one campaign each: its repeats are the trials
        for row, name, trials in zip(series.rows, names, series.trials, strict=True):
            cells[row.specimen, name] = list(trials)
        why.append("one campaign per specimen: its repeats are the trials, so the variation by mounting is not "
            "included")
    low, high = limits.of(series)
    tolerance = None if low is None or high is None else high - low
    try:
        values, parts, operators = table_of(cells)
        study = gauge_study(values, tolerance)
    except ValueError as error:
        return GaugeResult(series, why=(str(error),))
    if tolerance is None and limits.stated:
        why.append("no tolerance is stated for this value")
    return GaugeResult(series, study, tuple(parts), tuple(operators), tuple(why))


def json_of(study: ChartStudy | GoldenStudy | GaugeStudies, kind: str) -> Mapping[str, Any]:
    """The keys of `rig quality --json` that a study knows."""
    return {"study": kind, **study.to_json()}
