"""The check of the rig by a golden damper: each day's values against their own history, and what has drifted.

Each possible cause changes the values in its own pattern: a force sensor that reads 1 % high raises all forces and
energies by 1 %, and nothing else. The size of each cause is estimated from all values of a day by weighted least
squares, and is charted; so a day has one chart per cause in place of one per value. If a chart signals, the cause
whose pattern explains the day best is named, with every other one that explains it about as well.

The gauge's own history determines sigma of each size, so the correlation of a day's values is included.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
from scipy import stats

from rig.process_quality.control_chart import (
    D2,
    FEWEST,
    RESOLUTION,
    USUAL_BASELINE,
    ControlChart,
    Rule,
    TooFewValues,
    Violation,
    control_chart,
    moving_range_freedom,
)
from rig.signals.arrays import FloatArray

FORCES = frozenset({
    "rebound_force", "jounce_force", "friction_force", "gas_force", "peak_force_rebound", "peak_force_compression",
})
WORK = frozenset({"energy", "damping"})
BY_CURRENT = frozenset({*FORCES - {"gas_force", "friction_force"}, *WORK, "dynamic_range"})
OFFSET = frozenset({"rebound_force", "jounce_force", "gas_force", "peak_force_rebound", "peak_force_compression"})
BY_TEMPERATURE = frozenset({*FORCES - {"gas_force"}, *WORK})
TEMPERATURE = "coil_temperature"
INFLUENCE_1_K = -0.005
"""Relative change of force with the temperature of the oil where the history does not show it: -0.5 %/K."""
SURE = 3.0
"""Standard errors from which the history's own change of force with temperature is used."""
AS_GOOD = 3.84
"""Increase of the sum of squares up to which another cause explains a day about as well: chi-squared, 95 %."""
SMALLEST = 1e-12
"""Smallest sigma of a value that is zero on every day."""
FEWEST_K = 0.5
"""Range of the temperatures of phase I below which they cannot show how the force changes with temperature (K)."""
UNEXPLAINED = 0.5
"""Share of a day's sum of squares that a cause must explain to be named."""
WINDOWS = {Rule.BEYOND: 1, Rule.EIGHT: 8}
"""Rules that a day is checked by, for a step and for a slow drift, and the number of days whose mean is explained."""
PHASE_ALARM = 0.01
"""Probability that a phase I without a drift loses a day."""
DAY_ALARM = 0.01
"""Largest probability of a signal on a day without drift, shared equally by all causes and both rules; measured in
`benchmarks/quality.py`. With limits of 3 sigma for each cause and all rules it would be 8 %, because sigma is known
from few days and there are several causes."""


class Cause(StrEnum):
    """What may have drifted; the value is its key in JSON."""

    FORCE = "force"
    FORCE_ZERO = "force-zero"
    DISPLACEMENT = "displacement"
    CURRENT = "current"
    TEMPERATURE = "temperature"
    SPECIMEN = "specimen"

    @property
    def words(self) -> str:
        """The cause in words."""
        return WORDS[self][0]

    @property
    def unit(self) -> str:
        """Unit of its size."""
        return WORDS[self][1]

    @property
    def advice(self) -> str:
        """What to check."""
        return WORDS[self][2]


WORDS = {
    Cause.FORCE: ("sensitivity of the force measurement", "%", "Check the load cell, its amplifier and its mounting."),
    Cause.FORCE_ZERO: ("zero of the force measurement", "N", "Zero the load cell; check the mounting for preload."),
    Cause.DISPLACEMENT: ("sensitivity of the displacement measurement", "%", "Check the LVDT and its mounting."),
    Cause.CURRENT: ("coil current", "%", "Check the current source and its calibration."),
    Cause.TEMPERATURE: ("temperature", "K", "Wait until the golden damper has its usual temperature."),
    Cause.SPECIMEN: ("the golden damper itself", "%", "Test a second golden damper."),
}


@dataclass(frozen=True)
class Key:
    """One value of each day: quantity, motion and current (A; None where there is none)."""

    quantity: str
    motion: str = ""
    current_A: float | None = None

    @property
    def label(self) -> str:
        """In one phrase."""
        current = "" if self.current_A is None else f"{self.current_A:.4g} A"
        return ", ".join(part for part in (self.quantity.replace("_", " "), self.motion, current) if part)


@dataclass(frozen=True)
class Explanation:
    """How one cause explains a deviation: size with standard uncertainty (in the cause's unit), explained share."""

    cause: Cause
    size: float
    std: float
    share: float

    def to_json(self) -> dict[str, Any]:
        """Plain types."""
        return {"cause": str(self.cause), "unit": self.cause.unit, "size": self.size, "std": self.std,
                "explained": self.share}  # fmt: skip


@dataclass(frozen=True)
class DayFinding:
    """What a day's chart signals.

    Attributes:
        index: number of the day, from 0.
        signals: violated rules by cause.
        explanations: the cause that explains the deviation best, then those that do so about as well; empty if none
            explains it.
        shifted: the values that deviate most, in sigma.
    """

    index: int
    signals: Mapping[Cause, tuple[Rule, ...]]
    explanations: tuple[Explanation, ...]
    shifted: tuple[tuple[Key, float], ...]

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        return {
            "index": self.index,
            "signals": {str(cause): [str(rule) for rule in rules] for cause, rules in self.signals.items()},
            "explanations": [one.to_json() for one in self.explanations],
            "shifted": [{"value": key.label, "sigma": sigma} for key, sigma in self.shifted],
        }  # fmt: skip


@dataclass(frozen=True)
class GoldenCheck:
    """The golden damper's history.

    Attributes:
        keys: the values that every day of phase I has.
        charts: size of each cause over the days.
        findings: days of phase II with a signal.
        days: number of days.
        baseline: number of days of phase I.
        missing: values that not every day of phase I has, and that are not used.
        remarks: what must be known before a finding is believed.
    """

    keys: tuple[Key, ...]
    charts: Mapping[Cause, ControlChart]
    findings: tuple[DayFinding, ...]
    days: int
    baseline: int
    missing: tuple[Key, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the last day is without a signal."""
        return not any(finding.index == self.days - 1 for finding in self.findings)

    @property
    def unchecked(self) -> tuple[Cause, ...]:
        """Causes that no value of the last day shows."""
        return tuple(cause for cause, chart in self.charts.items() if not math.isfinite(chart.values[-1]))


def golden_check(
    values: Mapping[Key, FloatArray], baseline: int | None = None, influence_1_K: float | None = None,
    resolutions: Mapping[Key, float] | None = None,
) -> GoldenCheck:
    """Check each day of a golden damper against phase I.

    Args:
        values: value -> one number per day in the order of time, (n,), NaN where it was not measured.
        baseline: number of first days that belong to phase I; None: the first `USUAL_BASELINE`, or all but the last.
        influence_1_K: relative change of force per K; None: from the history. If it is known, forces are corrected to
            the mean temperature of phase I; else a change of temperature is recognised by -0.5 %/K.
        resolutions: smallest known difference of each value; `RESOLUTION` of the value where it is not stated.

    Raises:
        TooFewValues: phase I has fewer than `FEWEST` days, or no value was measured on each of them.
    """
    days = max((len(one) for one in values.values()), default=0)
    count = min(days - 1, USUAL_BASELINE) if baseline is None else min(days, baseline)
    if baseline is not None and baseline < FEWEST:
        raise TooFewValues(f"got a phase I of {baseline} days, expected at least {FEWEST}")
    if count < FEWEST:
        raise TooFewValues(f"got {days} day{'' if days == 1 else 's'}, expected at least {FEWEST + 1}: {FEWEST} in "
            "phase I, and 1 to be checked")
    known = {key: one for key, one in values.items() if _has_pattern(key)}
    used = [key for key, one in known.items() if np.all(np.isfinite(one[:count]))]
    missing = tuple(key for key in known if key not in used)
    if not used:
        raise TooFewValues("no value was measured on each day of phase I")
    table = np.column_stack([known[key] for key in used])
    remarks = list[str]()
    if influence_1_K is None:
        influence_1_K, remarks = _influence(used, table[:count])
    corrected = influence_1_K is not None
    if influence_1_K is not None:
        table = _at_mean_temperature(used, table, count, influence_1_K)
    least = _least(used, table[:count], resolutions or {})
    beyond = _beyond(count)
    limits = [control_chart(table[:count, column], count, least[column], beyond) for column in range(len(used))]
    centre = np.array([one.centre for one in limits])
    sigma = np.array([one.sigma for one in limits])
    others = _sigma_of_other_days(table[:count], limits, least)
    patterns = _patterns(used, centre, 0.0 if corrected else INFLUENCE_1_K)
    charts = {}
    for cause, pattern in patterns.items():
        weighted_by = [*others, *[sigma] * (days - count)]
        sizes = np.array([_size(day - centre, pattern, one)[0] for day, one in zip(table, weighted_by, strict=True)])
        if np.all(np.isfinite(sizes[:count])):  # on a later day, the values that show this cause may be missing
            resolution = _resolution(pattern, sigma, least)
            charts[cause] = control_chart(sizes[:count], count, resolution, beyond).continued(sizes)
    remarks += _unchecked(charts, count)
    findings = tuple(_findings(charts, patterns, used, table - centre, sigma, count))
    if missing:
        remarks.append("values not used, because they were not measured on every day of phase I: "
            f"{len(missing)}; first: {missing[0].label}")
    return GoldenCheck(tuple(used), charts, findings, days, count, missing, tuple(remarks))


def _beyond(count: int) -> float:
    """Sigma beyond which a day of phase I is not part of the limits: 1 % of phases without a drift lose a day.

    At 3 sigma, every sixth chart of 15 days would lose one of its own values, which makes its limits 10 % too narrow.
    """
    return max(3.0, float(stats.t.ppf(1.0 - 0.5 * PHASE_ALARM / count, moving_range_freedom(count))))


def _least(keys: Sequence[Key], table: FloatArray, resolutions: Mapping[Key, float]) -> FloatArray:
    """Smallest known difference of each value (k,)."""
    by_size = RESOLUTION * np.max(np.abs(table), axis=0)
    stated = np.array([resolutions.get(key, 0.0) for key in keys])
    return np.asarray(np.maximum(np.maximum(by_size, stated), SMALLEST))


def _sigma_of_other_days(table: FloatArray, limits: Sequence[ControlChart], least: FloatArray) -> FloatArray:
    """Sigma of each value from the moving ranges of the other days, for each day of phase I (days, k).

    The sizes of causes are weighted by sigma. Weights that contain the day itself fit its noise: the sizes of phase I
    would vary by 10 to 15 % less than those of later days, and the limits would be too narrow.

    Args:
        table: values of phase I (days, k).
        limits: chart of each value.
        least: smallest sigma of each value (k,).
    """
    kept = np.ones(table.shape, bool)
    for column, one in enumerate(limits):
        kept[list(one.removed), column] = False
    used = kept[1:] & kept[:-1]
    ranges = np.where(used, np.abs(np.diff(table, axis=0)), 0.0)
    nothing = np.zeros((1, table.shape[1]))
    near, near_count = (
        np.vstack([nothing, one]) + np.vstack([one, nothing]) for one in (ranges, used.astype(np.float64))
    )
    mean = (np.sum(ranges, axis=0) - near) / np.maximum(np.sum(used, axis=0) - near_count, 1.0)
    return np.asarray(np.maximum(mean / D2, least))


def _resolution(pattern: Pattern, sigma: FloatArray, least: FloatArray) -> float:
    """Smallest known size of a cause, from the smallest known differences of the values (k,)."""
    weights = pattern / sigma**2
    return float(np.sqrt(np.sum((weights * least) ** 2)) / (weights @ pattern))


def _unchecked(charts: Mapping[Cause, ControlChart], count: int) -> Iterable[str]:
    """Days of phase II without a value that shows a cause."""
    for cause, chart in charts.items():
        without = np.flatnonzero(~np.isfinite(chart.values[count:])) + count + 1
        if len(without):
            yield (f"{cause.words}: not checked on days without a valid value that shows it: {len(without)}, the last "
                f"of them day {without[-1]}")


def _has_pattern(key: Key) -> bool:
    return key.quantity in {
        *FORCES, *WORK, "dynamic_range", TEMPERATURE, "measured_amplitude", "measured_current", "force_at_rest",
        "force_difference_at_rest", "force_gain", "force_offset", "displacement_gain",
    }  # fmt: skip


Pattern = FloatArray
"""Change of each value (k,) for a size of 1 in the cause's unit."""


def _patterns(keys: Sequence[Key], centre: FloatArray, influence_1_K: float) -> dict[Cause, Pattern]:
    """Pattern of each cause, those without any value left out."""
    slopes = _current_slopes(keys, centre)
    percent = centre / 100.0
    names = [key.quantity for key in keys]

    def where(quantities: Iterable[str]) -> FloatArray:
        chosen = frozenset(quantities)
        return np.array([float(name in chosen) for name in names])

    forces, warm = where({*FORCES, *WORK}), where(BY_TEMPERATURE)
    patterns = {
        Cause.FORCE: percent * where({*FORCES, *WORK, "force_gain"}),
        Cause.FORCE_ZERO: where({*OFFSET, "force_at_rest", "force_difference_at_rest", "force_offset"}),
        Cause.DISPLACEMENT: percent * (
            where({"measured_amplitude", "displacement_gain", "energy"}) - where({"damping"})
        ),
        Cause.CURRENT: percent * (slopes + where({"measured_current"})),
        Cause.TEMPERATURE: influence_1_K * centre * warm + where({TEMPERATURE}),
        Cause.SPECIMEN: percent * forces,
    }
    # A cause is only named if a value shows it apart from the others.
    needed = {
        Cause.CURRENT: bool(np.any(slopes)) or "measured_current" in names, Cause.TEMPERATURE: TEMPERATURE in names,
        Cause.DISPLACEMENT: bool({"measured_amplitude", "displacement_gain"} & set(names)),
    }  # fmt: skip
    return {cause: one for cause, one in patterns.items() if np.any(one) and needed.get(cause, True)}


def _current_slopes(keys: Sequence[Key], centre: FloatArray) -> FloatArray:
    """Relative change of each value per relative change of the current, from its values at other currents."""
    slopes = np.zeros(len(keys))
    groups: dict[tuple[str, str], list[int]] = {}
    for place, key in enumerate(keys):
        if key.quantity in BY_CURRENT and key.current_A is not None:
            groups.setdefault((key.quantity, key.motion), []).append(place)
    for places in groups.values():
        currents = np.array([keys[place].current_A for place in places], np.float64)
        order = np.argsort(currents)
        if len(places) < 2 or len(np.unique(currents)) < len(places):
            continue
        level, force = currents[order], centre[np.array(places)[order]]
        gradient = np.gradient(force, level)
        for number, place in enumerate(np.array(places)[order]):
            if force[number] != 0.0:
                slopes[place] = level[number] * gradient[number] / force[number]
    return slopes


def _influence(keys: Sequence[Key], table: FloatArray) -> tuple[float | None, list[str]]:
    """Relative change of force per K in phase I, None if its temperatures do not show it, and a remark on it."""
    degC = _temperature(keys, table)
    forces = [place for place, key in enumerate(keys) if key.quantity in {"rebound_force", "jounce_force", "energy"}]
    if degC is None:
        return None, []
    if forces and np.ptp(degC) > FEWEST_K:
        relative = np.mean(table[:, forces] / np.mean(table[:, forces], axis=0), axis=1) - 1.0
        line = stats.linregress(degC, relative)
        if abs(line.slope) > SURE * line.stderr:
            return float(line.slope), [f"forces are corrected to the mean temperature of phase I with "
                f"{100.0 * line.slope:.2g} %/K, from the history"]
    return None, [f"the history does not show how the force changes with temperature; {100.0 * INFLUENCE_1_K:g} %/K is "
        "assumed to recognise a change of temperature"]


def _temperature(keys: Sequence[Key], table: FloatArray) -> FloatArray | None:
    """Mean temperature of each day (degC); None without any."""
    places = [place for place, key in enumerate(keys) if key.quantity == TEMPERATURE]
    return np.asarray(np.mean(table[:, places], axis=1)) if places else None


def _at_mean_temperature(keys: Sequence[Key], table: FloatArray, count: int, influence_1_K: float) -> FloatArray:
    """Values with forces at the mean temperature of phase I; days without a temperature stay as they are."""
    degC = _temperature(keys, table)
    if degC is None:
        return table
    warmer_K = np.nan_to_num(degC - np.mean(degC[:count]))
    factor = 1.0 + influence_1_K * warmer_K
    forces = np.array([key.quantity in BY_TEMPERATURE for key in keys])
    return np.where(forces[None, :], table / factor[:, None], table)


def _size(deviation: FloatArray, pattern: Pattern, sigma: FloatArray) -> tuple[float, float, float]:
    """Size of a cause by weighted least squares, its standard uncertainty, and the remaining sum of squares."""
    known = np.isfinite(deviation)
    weights = known / sigma**2
    deviation = np.where(known, deviation, 0.0)
    strength = float(weights @ pattern**2)
    if strength == 0.0:
        return math.nan, math.nan, float(weights @ deviation**2)
    size = float(weights @ (pattern * deviation)) / strength
    return size, 1.0 / math.sqrt(strength), float(weights @ (deviation - size * pattern) ** 2)


def _findings(
    charts: Mapping[Cause, ControlChart], patterns: Mapping[Cause, Pattern], keys: Sequence[Key],
    deviations: FloatArray, sigma: FloatArray, baseline: int,
) -> Iterable[DayFinding]:
    """Days of phase II on which the chart of the cause that explains them signals, or one that is not explained."""
    by_day: dict[int, dict[Cause, list[Violation]]] = {}
    freedom = moving_range_freedom(baseline)
    least = float(stats.t.ppf(1.0 - 0.5 * DAY_ALARM / max(1, len(charts) * len(WINDOWS)), freedom))
    for cause, chart in charts.items():
        for one in chart.signals:
            if one.rule in WINDOWS and _significance(chart, one) > least:
                by_day.setdefault(one.index, {}).setdefault(cause, []).append(one)
    for day, signals in sorted(by_day.items()):
        window = min(WINDOWS[one.rule] for ones in signals.values() for one in ones)
        rows = deviations[max(day - window + 1, 0) : day + 1]
        mean, mean_sigma = np.mean(rows, axis=0), sigma / math.sqrt(len(rows))
        order = np.argsort(-np.abs(np.nan_to_num(mean / mean_sigma)))[:3]
        shifted = tuple((keys[place], float(mean[place] / mean_sigma[place])) for place in order.tolist())
        rules = {cause: tuple(dict.fromkeys(one.rule for one in ones)) for cause, ones in signals.items()}
        explained = tuple(
            replace(one, std=max(one.std, charts[one.cause].sigma / math.sqrt(len(rows))))
            for one in explanations(patterns, mean, mean_sigma) if one.cause in charts
        )
        unexplained = not explained and any(Rule.BEYOND in ones for ones in rules.values())
        if unexplained or any(one.cause in rules for one in explained):
            yield DayFinding(day, rules, explained, shifted)


def _significance(chart: ControlChart, signal: Violation) -> float:
    """Mean of the days of a signal, relative to the standard error of its difference from the mean of phase I."""
    window = min(WINDOWS[signal.rule], signal.index + 1)
    mean = float(np.mean(chart.values[signal.index - window + 1 : signal.index + 1]))
    error = chart.sigma * math.sqrt(1.0 / window + 1.0 / chart.baseline)
    return abs(mean - chart.centre) / error if error > 0.0 else math.inf


def explanations(
    patterns: Mapping[Cause, Pattern], deviation: FloatArray, sigma: FloatArray
) -> tuple[Explanation, ...]:
    """The cause that explains a deviation (k,) best, then those that do so about as well; empty if none explains it.

    Residuals larger than sigma (correlated values, or several causes) make other causes as good sooner.
    """
    known = np.isfinite(deviation)
    total = float(np.sum((deviation[known] / sigma[known]) ** 2))
    sizes = {cause: _size(deviation, pattern, sigma) for cause, pattern in patterns.items()}
    sizes = {cause: one for cause, one in sizes.items() if math.isfinite(one[0])}
    if not sizes or total == 0.0:
        return ()
    least = min(one[2] for one in sizes.values())
    scale = max(1.0, least / max(1, int(np.count_nonzero(known)) - 1))
    listed = [
        Explanation(cause, size, std * math.sqrt(scale), 1.0 - rest / total)
        for cause, (size, std, rest) in sorted(sizes.items(), key=lambda item: item[1][2])
        if rest - least <= AS_GOOD * scale
    ]
    return tuple(one for one in listed if one.share >= UNEXPLAINED)
