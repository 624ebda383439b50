"""Wear of a specimen over its cycles: medians of sections of an endurance test, stop rules, forecasts.

A section is some consecutive cycles, described by the medians of their statistics (`rig.signals.cycle_statistics`).
Change is relative to the baseline, the median of the first sections after the running-in. A relative limit is reached
when it is exceeded by more than the uncertainty of the baseline and of the last sections, and when the change cannot be
scatter: a test of thousands of blocks is evaluated thousands of times, and one evaluation in error ends it. How much a
level scatters from block to block is not known before there are some blocks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from rig.signals.arrays import BoolArray, FloatArray, IntArray
from rig.signals.delay_estimation.sample_match import student

SECTIONS_A_BLOCK = 10
FEWEST_CYCLES = 10
"""In a section, where the block has so many."""
FEWEST_SECTIONS = 8
"""For a forecast."""
RECENT_SHARE = 0.5
"""Of the sections, the last ones that a forecast is made from: wear is a straight line only for a while."""
NORMAL = 1.959964
"""Quantile of the normal distribution for an interval of 95 %."""
T_OF_FEW = (12.7062, 4.3027)
"""Of Student's t with 1 and 2 degrees of freedom, where the expansion of `student` is too small by up to a quarter."""
STRONGEST_CORRELATION = 0.95
VISIBLE, FEWEST_FOR_SCATTER, NORMAL_OF_MAD = 3.0, 4, 1.4826
"""A baseline is so many standard deviations of its sections at least, where it has so many; by the median deviation."""
STANDARD_ERRORS = 5.0
"""A baseline is more standard errors of a section's median than this, from the scatter of its cycles; a change is more
standard errors of the mean of the last blocks than this, since it is evaluated after every block."""
ERRORS_OF_BASELINE = 2.6
"""Standard errors of the baseline in a change, in addition: it is determined once (1 in 200)."""
FEWEST_BLOCKS = 5
"""From the baseline on, for the scatter of the level from block to block."""
BLOCKS_A_SCALE = 8
"""So many means of blocks at least, for their scatter: one step, as real wear may have, changes few of them."""
BLOCKS_A_LAG = 6
"""As `BLOCKS_A_SCALE`, for the differences of single blocks that are apart by a lag."""
BY_CHANCE = 1.1
"""By this factor the scatter of distant blocks may exceed that of neighbours where the level does not change slowly."""
SHARE_OF_MAD = 0.28
"""Degrees of freedom of each value of a median deviation: its efficiency of 0.37, less as differences correlate."""
LUCK, BLOCKS_OF_LUCK = 1.0 / 3.0, 12
"""A median deviation of fewer blocks can be almost zero by chance: below this share of the spread it is not believed.
"""
BEYOND_SCATTER = 0.5
"""A change beyond the limit by this share of the level at the limit is no scatter, even where that is not known."""
FEW_BLOCKS = f"its scatter from block to block is not known before {FEWEST_BLOCKS} blocks"
ERROR_OF_MEDIAN = 1.2533
"""Standard error of a median of normal values, relative to that of their mean."""
LEAST_OF_LARGER = 0.05
"""A peak force is at least this share of the peak force in the other direction, or it is that of offset and noise."""
DIRECTIONS = ("force_max", "force_min")
NOT_DISTINGUISHABLE = "the baseline cannot be clearly distinguished from zero"
QUANTITIES = (
    "force_max", "force_min", "energy", "stiffness", "friction", "mean_force", "temperature", "current",
)
"""Statistics of a cycle whose medians a section has."""


class RuleKind(NamedTuple):
    """What a stop rule watches, without its limit.

    Attributes:
        quantities: whose change counts; of several the largest.
        rising: whether the quantity reaches the limit upwards.
        relative: whether the limit is a change relative to the baseline.
        words: its name for people.
    """

    quantities: tuple[str, ...]
    rising: bool
    relative: bool
    words: str


RULES: Mapping[str, RuleKind] = {
    "force_down": RuleKind(DIRECTIONS, False, True, "decrease of the peak force"),
    "energy_down": RuleKind(("energy",), False, True, "decrease of the energy per cycle"),
    "stiffness_down": RuleKind(("stiffness",), False, True, "decrease of the stiffness"),
    "friction_up": RuleKind(("friction",), True, True, "increase of the friction"),
    "gas_force_down": RuleKind(("mean_force",), False, True, "decrease of the mean of rebound and compression force"),
    "temperature": RuleKind(("temperature",), True, False, "coil temperature"),
}
"""Stop rules by their key in a matrix file."""


@dataclass(frozen=True)
class StopRule:
    """One stop rule.

    Attributes:
        name: its key in `RULES`.
        limit: relative change (positive), or the value itself (SI).
    """

    name: str
    limit: float

    @property
    def kind(self) -> RuleKind:
        """What it watches."""
        return RULES[self.name]


@dataclass(frozen=True)
class Sections:
    """The sections of an endurance test in order, arrays (n,).

    Attributes:
        cycle: number of the last cycle of each.
        block: number of the block of each.
        medians: by quantity; not-a-number where it is unknown.
        group: of the cycles of each: those with the same current, in a current program; 0 at a constant current.
        errors: standard errors of the medians by quantity, from the scatter of the cycles; unknown where there is none.
    """

    cycle: FloatArray
    block: FloatArray
    medians: Mapping[str, FloatArray]
    group: IntArray
    errors: Mapping[str, FloatArray] = field(default_factory=dict)

    def __len__(self) -> int:
        return self.cycle.size

    def errors_of(self, name: str) -> FloatArray:
        """Standard errors (n,) of the medians of a quantity; not-a-number where they are unknown."""
        return self.errors.get(name, np.full(len(self), np.nan))

    @classmethod
    def joined(cls, parts: Sequence[Sections]) -> Sections:
        """Sections end to end."""
        if not parts:
            return NO_SECTIONS
        medians = {name: np.concatenate([part.medians[name] for part in parts]) for name in QUANTITIES}
        cycle, block, group = (
            np.concatenate(columns) for columns in zip(*((p.cycle, p.block, p.group) for p in parts), strict=True)
        )
        errors = {name: np.concatenate([part.errors_of(name) for part in parts]) for name in QUANTITIES}
        return cls(cycle, block, medians, group.astype(np.int64), errors)

    @property
    def groups(self) -> tuple[Sections, ...]:
        """The sections of each group; at least one, which may be empty."""
        numbers = np.unique(self.group)
        if numbers.size < 2:
            return (self,)
        return tuple(self._chosen(np.flatnonzero(self.group == number)) for number in numbers)

    def _chosen(self, rows: IntArray) -> Sections:
        medians = {name: values[rows] for name, values in self.medians.items()}
        errors = {name: values[rows] for name, values in self.errors.items()}
        return Sections(self.cycle[rows], self.block[rows], medians, self.group[rows], errors)


NO_SECTIONS = Sections(np.zeros(0), np.zeros(0), dict.fromkeys(QUANTITIES, np.zeros(0)), np.zeros(0, np.int64))


def sections_of(
    numbers: FloatArray, block: int, statistics: Mapping[str, FloatArray], groups: IntArray | None = None
) -> Sections:
    """The sections of the cycles of one block.

    Args:
        numbers: of the cycles (k,).
        block: its number.
        statistics: of each cycle (k,), at least `QUANTITIES`.
        groups: of each cycle (k,), see `rig.signals.program_cycles`; -1: in none. Each group has its own sections.
            None: one group.
    """
    if groups is None:
        groups = np.zeros(len(numbers), np.int64)
    names, sizes = np.unique(groups[groups >= 0], return_counts=True)
    if not names.size:
        return NO_SECTIONS
    sections = max(1, min(SECTIONS_A_BLOCK, int(np.min(sizes)) // FEWEST_CYCLES))
    edges = np.linspace(0, len(numbers), sections + 1).round().astype(np.int64)
    last = np.asarray(numbers, np.float64)[edges[1:] - 1]
    parts = []
    for name in names:
        medians, errors = {}, {}
        for quantity in QUANTITIES:
            chosen = [statistics[quantity][a:b][groups[a:b] == name] for a, b in pairwise(edges)]
            medians[quantity] = np.array([_median(values) for values in chosen])
            errors[quantity] = np.array([_error(values) for values in chosen])
        group = np.full(sections, name, np.int64)
        parts.append(Sections(last, np.full(sections, float(block)), medians, group, errors))
    return Sections.joined(parts)


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else math.nan


def _error(values: FloatArray) -> float:
    """Standard error of the median; not-a-number for fewer than two values."""
    known = values[np.isfinite(values)]
    if known.size < 2:
        return math.nan
    scatter = float(np.std(known, ddof=1)) if known.size < FEWEST_FOR_SCATTER else _scatter(known)
    return ERROR_OF_MEDIAN * scatter / math.sqrt(known.size)


class Baseline(NamedTuple):
    """Baseline of one quantity.

    Attributes:
        level: median of the sections of a block; not-a-number where it is unknown or cannot be compared.
        error: its standard error; not-a-number where it is unknown.
        first: place of the block's first section among all sections.
    """

    level: float
    error: float = math.nan
    first: int = 0


def baselines_of(sections: Sections, run_in: float) -> dict[str, Baseline]:
    """Baseline of each quantity: median of the first block after the running-in in which it is known.

    Not-a-number before there is one, and where the baseline cannot be distinguished from zero: a relative change of the
    mean force of a damper without gas, for example, would be that of its noise, and would end a test at random. The
    same is true of a peak force that is small relative to that in the other direction.

    Args:
        sections: of the test.
        run_in: cycles of the running-in.
    """
    after = _first_of_block(sections) >= run_in
    levels = {
        name: _level(values, sections.errors_of(name), sections.block, after)
        for name, values in sections.medians.items()
    }
    larger = max((abs(levels[name].level) for name in DIRECTIONS if math.isfinite(levels[name].level)), default=0.0)
    small = [name for name in DIRECTIONS if abs(levels[name].level) < LEAST_OF_LARGER * larger]
    return levels | dict.fromkeys(small, Baseline(math.nan))


def baseline_of(sections: Sections, run_in: float) -> dict[str, float]:
    """As `baselines_of`, without their errors."""
    return {name: baseline.level for name, baseline in baselines_of(sections, run_in).items()}


def why_not_evaluated(rule: StopRule, sections: Sections, run_in: float) -> str:
    """Why a rule is not evaluated although its quantity is measured; empty where it is, or where nothing is known yet.

    Args:
        rule: the rule.
        sections: of the cycles that are compared.
        run_in: cycles of the running-in.
    """
    if not rule.kind.relative:
        return ""
    after, baseline = _first_of_block(sections) >= run_in, baseline_of(sections, run_in)
    if any(math.isfinite(baseline[name]) for name in rule.kind.quantities):
        return _few_blocks(rule, sections, run_in, baseline)
    measured = any(np.any(np.isfinite(sections.medians[name][after])) for name in rule.kind.quantities)
    return NOT_DISTINGUISHABLE if measured else ""


def _few_blocks(rule: StopRule, sections: Sections, run_in: float, baseline: Mapping[str, float]) -> str:
    """That the blocks are too few for any quantity of a rule whose limit is not reached; empty otherwise."""
    names = [name for name in rule.kind.quantities if math.isfinite(baseline[name])]
    after = _first_of_block(sections) >= run_in
    blocks = [np.unique(sections.block[after & np.isfinite(sections.medians[name])]).size for name in names]
    few = max(blocks) < FEWEST_BLOCKS and not reached_by(rule, sections, run_in)
    return FEW_BLOCKS if few else ""


def _level(values: FloatArray, errors: FloatArray, block: FloatArray, after: BoolArray) -> Baseline:
    known = np.flatnonzero(after & np.isfinite(values))
    if not known.size:
        return Baseline(math.nan)
    known = known[block[known] == block[known[0]]]
    of_block, error = values[known], _median(errors[known])
    level = float(np.median(of_block))
    if level == 0.0 or abs(level) <= STANDARD_ERRORS * error:  # an unknown error excludes nothing
        return Baseline(math.nan)
    if of_block.size >= FEWEST_FOR_SCATTER:
        if abs(level) <= VISIBLE * _scatter(of_block):
            return Baseline(math.nan)
        error = float(np.fmax(error, _step_scatter(of_block)))
    share = ERROR_OF_MEDIAN if of_block.size > 2 else 1.0
    return Baseline(level, share * error / math.sqrt(of_block.size), int(known[0]))


def _scatter(values: FloatArray) -> float:
    """Standard deviation of normal values (n,), by their median deviation."""
    return NORMAL_OF_MAD * float(np.median(np.abs(values - np.median(values))))


def reached_by(rule: StopRule, sections: Sections, run_in: float) -> bool:
    """Whether a rule's limit is reached at the last section of which a value is known, within the last block.

    A relative limit is exceeded by this section, and with confidence: by the section itself, or by the mean of the last
    1, 2, 4, 8, ... blocks. So a well-known quantity ends the test with its first section beyond the limit, and one
    whose scatter is not small against the limit after as many blocks as it takes. An unknown scatter ends no test,
    unless half of what is left at the limit is lost too. The last section itself may have no statistics: its samples
    may be missing.

    Args:
        rule: the rule.
        sections: of the cycles that are compared.
        run_in: cycles of the running-in.
    """
    baselines = baselines_of(sections, run_in)
    return any(_quantity_reached(rule, sections, name, baselines[name]) for name in rule.kind.quantities)


def uncertainty_of(rule: StopRule, sections: Sections, run_in: float) -> float:
    """Half width of the 95 % interval of the last known change, from the scatter of sections and baseline.

    Not-a-number where it is unknown, and of a limit that is no relative change.

    Args:
        rule: the rule.
        sections: of the cycles that are compared.
        run_in: cycles of the running-in.
    """
    baselines, changes_seen = baselines_of(sections, run_in), [(-np.inf, np.nan)]
    for name in rule.kind.quantities if rule.kind.relative else ():
        change = _quantity_change(rule, sections.medians[name], baselines[name].level)
        known = np.flatnonzero(np.isfinite(change))
        if known.size:
            seen = _scatter_seen(sections, name, baselines[name], known)
            wide = NORMAL * math.hypot(seen.baseline * (1.0 + abs(change[known[-1]])), max(seen.section, seen.between))
            unknown = not wide or math.isnan(seen.between)
            changes_seen.append((float(change[known[-1]]), math.nan if unknown else wide))
    return max(changes_seen)[1]


def _quantity_reached(rule: StopRule, sections: Sections, name: str, baseline: Baseline) -> bool:
    beyond = _quantity_change(rule, sections.medians[name], baseline.level) - rule.limit
    known = np.flatnonzero(np.isfinite(beyond))
    if not known.size or sections.block[known[-1]] != sections.block[-1] or beyond[known[-1]] < 0.0:
        return False
    if not rule.kind.relative:
        return True
    seen = _scatter_seen(sections, name, baseline, known)
    known = known[known >= baseline.first]
    of_blocks = _block_means(beyond, sections.block, known)
    at_limit = 1.0 + rule.limit if rule.kind.rising else 1.0 - rule.limit
    lost = bool(of_blocks[-1] >= BEYOND_SCATTER * at_limit + STANDARD_ERRORS * seen.section)
    if lost or math.isnan(seen.between):
        return lost
    counts = 2 ** np.arange(seen.blocks.size)
    means = np.cumsum(of_blocks[::-1])[counts - 1] / counts
    certain = means >= NORMAL * np.hypot(at_limit * seen.baseline, seen.blocks)
    no_scatter = means + rule.limit >= ERRORS_OF_BASELINE * seen.baseline + STANDARD_ERRORS * seen.blocks
    return bool(np.any(certain & no_scatter))


class _Scatter(NamedTuple):
    """Standard errors, relative to the baseline.

    Attributes:
        baseline: of the baseline.
        section: of a section, within its block.
        between: of the level from block to block, at any distance; not-a-number where there are too few blocks.
        blocks: of the mean of the last 1, 2, 4, ... blocks.
    """

    baseline: float
    section: float
    between: float
    blocks: FloatArray


def _scatter_seen(sections: Sections, name: str, baseline: Baseline, known: IntArray) -> _Scatter:
    """What is seen of the scatter of a quantity, by the sections (rows) in which it is known."""
    known = known[known >= baseline.first]
    level = abs(baseline.level)
    values = sections.medians[name]
    of_section = _section_error(sections, name, known) / level
    of_blocks = _block_means(values, sections.block, known)
    between, errors = _errors_of_means(of_blocks / level)
    of_baseline = baseline.error / level if math.isfinite(baseline.error) else 0.0
    within = of_section * math.sqrt(of_blocks.size / known.size) / np.sqrt(2 ** np.arange(errors.size))
    return _Scatter(float(np.fmax(of_baseline, between)), of_section, between, np.maximum(errors, within))


def _errors_of_means(values: FloatArray) -> tuple[float, FloatArray]:
    """Standard errors of the means of the last 1, 2, 4, ... values, and the largest; not-a-number of too few values.

    Neither wear along a straight line nor a single step enlarges them: from the spread about a straight line or the
    median deviation of the differences, whichever is smaller with its factor of Student for few values. For longer
    means the differences of neighbouring means count too (Allan deviation): a level that changes slowly and returns
    is not known better by more blocks.
    """
    size = values.size
    counts = 2 ** np.arange(int(math.log2(size)) + 1)
    if size < FEWEST_BLOCKS:
        return math.nan, np.full(counts.size, math.nan)
    place = np.arange(size) - (size - 1) / 2.0
    left = values - np.mean(values) - place * float(place @ values / (place @ place))
    about_line = _student(size - 2) * math.sqrt(float(left @ left) / (size - 2))
    steps = _student(SHARE_OF_MAD * (size - 1)) * _step_scatter(values)
    single = max(min(about_line, steps), LUCK * about_line if size < BLOCKS_OF_LUCK else 0.0) / NORMAL
    errors, sums = single / np.sqrt(counts), np.concatenate(([0.0], np.cumsum(values)))
    for row in range(1, counts.size):
        count = int(counts[row])
        if BLOCKS_A_SCALE * count > size:
            errors[row] = errors[row - 1] / math.sqrt(2.0)
            continue
        means = (sums[count:] - sums[:-count]) / count
        errors[row] = max(errors[row], _scatter(means[count:] - means[:-count]) / math.sqrt(2.0))
    apart = [_scatter(values[count:] - values[:-count]) for count in counts[1:] if BLOCKS_A_LAG * count <= size]
    between = max(single, max(apart, default=0.0) / math.sqrt(2.0))
    slow = math.sqrt(max(0.0, between**2 - (BY_CHANCE * single) ** 2))
    return between, np.maximum(errors, slow)


def _block_means(values: FloatArray, block: FloatArray, known: IntArray) -> FloatArray:
    """Mean of the known sections (rows) of each block."""
    starts = np.flatnonzero(np.diff(block[known], prepend=-1.0))
    means: FloatArray = np.add.reduceat(values[known], starts) / np.diff(starts, append=known.size)
    return means


def _section_error(sections: Sections, name: str, known: IntArray) -> float:
    """Standard error of a section's median; 0 where it is unknown.

    The largest of what the cycles of all blocks, those of the last block, and the differences of the sections show.
    """
    errors = sections.errors_of(name)[known]
    of_last = sections.block[known] == sections.block[known[-1]]
    candidates = (_median(errors), _median(errors[of_last]), _step_scatter(sections.medians[name][known]))
    return max((one for one in candidates if math.isfinite(one)), default=0.0)


def _step_scatter(values: FloatArray) -> float:
    """Standard deviation of values (n,) about a straight line, by their differences; 0 of too few."""
    if values.size <= FEWEST_FOR_SCATTER:
        return 0.0
    return _scatter(np.diff(values)) / math.sqrt(2.0)


def _first_of_block(sections: Sections) -> FloatArray:
    """Cycles that were run before the block of each section."""
    before = np.concatenate(([0.0], sections.cycle[:-1]))
    starts = np.flatnonzero(np.diff(sections.block, prepend=-1.0))
    return np.repeat(before[starts], np.diff(starts, append=len(sections)))


def changes(rule: StopRule, sections: Sections, baseline: Mapping[str, float]) -> FloatArray:
    """How far each section (n,) is toward a rule's limit, as the limit is stated: relative change or the SI value."""
    stacked = np.vstack(
        [_quantity_change(rule, sections.medians[name], baseline[name]) for name in rule.kind.quantities]
    )
    known = np.isfinite(stacked)
    largest = np.max(np.where(known, stacked, -np.inf), axis=0, initial=-np.inf)
    return np.where(np.any(known, axis=0), largest, np.nan)


def _quantity_change(rule: StopRule, values: FloatArray, level: float) -> FloatArray:
    """How far values (n,) of one quantity are toward a rule's limit."""
    if rule.kind.relative:
        with np.errstate(divide="ignore", invalid="ignore"):
            values = values / level - 1.0
    return values if rule.kind.rising else -values


class Forecast(NamedTuple):
    """When a limit will be reached, in cycles of the test.

    Attributes:
        state: `reached`; `uncertain` (exceeded, but not by more than the uncertainty); `trend` (a straight line through
            the last sections goes there); `none` (no significant trend toward the limit); `unknown` (too few sections).
        cycles: estimate; None without a trend.
        low, high: 95 % interval; of `none` only `low`, before which the limit is not expected. None: not known.
    """

    state: Literal["reached", "uncertain", "trend", "none", "unknown"]
    cycles: float | None = None
    low: float | None = None
    high: float | None = None

    @property
    def reason(self) -> str:
        """Why there is no forecast, in words; empty where there is one."""
        if self.state == "uncertain":
            return "the limit is exceeded, but by less than the uncertainty"
        if self.state == "unknown":
            return f"fewer than {FEWEST_SECTIONS} sections of cycles"
        return "no significant trend toward the limit" if self.state == "none" else ""


def forecast(cycle: FloatArray, change: FloatArray, limit: float) -> Forecast:
    """When the straight line through the last half of the sections reaches a limit (inverse regression, Fieller).

    The interval is where `(a + b n - L)^2 <= t^2 var(a + b n)`. The variance of the residuals is inflated by their
    correlation from section to section, `(1 + r)/(1 - r)`.

    Args:
        cycle: of each section (n,).
        change: toward the limit (n,).
        limit: L, as the changes.
    """
    known = np.isfinite(change)
    x, y = cycle[known], change[known]
    if y.size and y[-1] >= limit:
        over = np.flatnonzero(y < limit)
        return Forecast("reached", float(x[over[-1] + 1] if over.size else x[0]))
    recent = max(FEWEST_SECTIONS, math.ceil(RECENT_SHARE * y.size))
    x, y = x[-recent:], y[-recent:]
    if y.size < FEWEST_SECTIONS or np.ptp(x) == 0.0:
        return Forecast("unknown")
    middle, level = float(np.mean(x)), float(np.mean(y))
    spread = float(np.sum((x - middle) ** 2))
    slope = float(np.sum((x - middle) * (y - level))) / spread
    left = y - level - slope * (x - middle)
    correlation = float(np.sum(left[1:] * left[:-1]) / max(np.sum(left**2), 1e-300))
    correlation = (correlation + 2.0 / y.size) / (1.0 - 4.0 / y.size)  # residuals of a line hide that much of it
    correlation = min(max(correlation, 0.0), STRONGEST_CORRELATION)
    inflation = (1.0 + correlation) / (1.0 - correlation)
    variance = inflation * float(np.sum(left**2)) / (y.size - 2)
    t2 = _student(y.size / inflation - 2.0) ** 2
    return _fieller(middle, level - limit, slope, t2 * variance / y.size, t2 * variance / spread, float(x[-1]))


def _student(freedom: float) -> float:
    """Quantile of Student's t for an interval of 95 %; of the next lower whole number of degrees of freedom."""
    whole = max(1, math.floor(freedom))
    return T_OF_FEW[whole - 1] if whole <= len(T_OF_FEW) else NORMAL * student(whole)


def _fieller(middle: float, above: float, slope: float, level2: float, slope2: float, last: float) -> Forecast:
    """Roots of `(above + slope d)^2 = level2 + slope2 d^2`, d from `middle`; `above` is negative below the limit."""
    square, linear, constant = slope**2 - slope2, above * slope, above**2 - level2
    root = math.sqrt(max(0.0, linear**2 - square * constant))
    if slope > 0.0 and square > 0.0:
        low, high = (-linear - root) / square, (-linear + root) / square
        # A line that is beyond the limit at the last section, which is not: the limit is near, but not in the past.
        cycles, low, high = (max(last, middle + apart) for apart in (-above / slope, low, high))
        return Forecast("trend", cycles, low, high)
    # The line may be flat: the limit is reached at the earliest where the steepest line that fits crosses it.
    steepest = slope + math.sqrt(slope2)
    earliest = None if steepest <= 0.0 else max(last, middle - (above + math.sqrt(level2)) / steepest)
    return Forecast("none", low=earliest)
