"""Sections of an endurance test, stop rules, and forecasts whose intervals hold the truth."""

from __future__ import annotations

import numpy as np
import pytest

from rig.signals.wear_trend import (
    FEW_BLOCKS,
    QUANTITIES,
    RULES,
    Sections,
    StopRule,
    baseline_of,
    changes,
    forecast,
    reached_by,
    sections_of,
    uncertainty_of,
    why_not_evaluated,
)


def statistics(count: int, **values: np.ndarray) -> dict[str, np.ndarray]:
    return {name: values.get(name, np.full(count, 1.0)) for name in QUANTITIES}


def test_a_block_has_ten_sections_and_a_short_one_fewer() -> None:
    numbers = np.arange(101, 701)
    sections = sections_of(numbers, 2, statistics(600, force_max=numbers.astype(float)))
    assert len(sections) == 10
    assert sections.cycle[-1] == 700
    assert sections.medians["force_max"][0] == pytest.approx(130.5)
    assert len(sections_of(np.arange(1, 26), 1, statistics(25))) == 2
    assert len(sections_of(np.arange(1, 4), 1, statistics(3))) == 1


def test_the_baseline_is_the_first_block_after_the_running_in() -> None:
    parts = [
        sections_of(np.arange(100 * n + 1, 100 * n + 101), n + 1, statistics(100, force_max=np.full(100, 10.0 - n)))
        for n in range(4)
    ]
    sections = Sections.joined(parts)
    assert baseline_of(sections, 0)["force_max"] == 10.0
    assert baseline_of(sections, 150)["force_max"] == 8.0
    assert np.isnan(baseline_of(sections, 1000)["force_max"])


@pytest.mark.parametrize(
    ("rule", "limit", "values", "expected"),
    [
        ("force_down", 0.2, {"force_max": 900.0, "force_min": -700.0}, 0.3),
        ("friction_up", 0.5, {"friction": 1500.0}, 0.5),
        ("gas_force_down", 0.3, {"mean_force": 600.0}, 0.4),
        ("temperature", 90.0, {"temperature": 85.0}, 85.0),
    ],
)
def test_a_rule_measures_the_change_toward_its_limit(
    rule: str, limit: float, values: dict[str, float], expected: float
) -> None:
    last = {name: np.array([values.get(name, 1000.0)]) for name in QUANTITIES}
    sections = Sections(np.array([10.0]), np.array([1.0]), last, np.zeros(1, np.int64))
    baseline = {name: -1000.0 if name == "force_min" else 1000.0 for name in QUANTITIES}
    assert changes(StopRule(rule, limit), sections, baseline)[0] == pytest.approx(expected)


def test_every_rule_is_known() -> None:
    assert set(RULES) == {
        "force_down", "energy_down", "stiffness_down", "friction_up", "gas_force_down", "temperature",
    }


def test_a_rule_on_what_cannot_be_told_says_nothing() -> None:
    unknown = {name: np.array([np.nan]) for name in QUANTITIES}
    nothing = Sections(np.array([10.0]), np.array([1.0]), unknown, np.zeros(1, np.int64))
    change = changes(StopRule("friction_up", 0.5), nothing, dict.fromkeys(QUANTITIES, np.nan))
    assert np.isnan(change[0])
    assert not change[0] >= 0.5


def test_forecast_intervals_hold_the_truth_in_95_percent() -> None:
    random = np.random.default_rng(4)
    cycle = np.arange(1, 41) * 1000.0
    held = total = 0
    for _ in range(400):
        expected = forecast(cycle, 0.1 * cycle / 40000.0 + 0.004 * random.normal(size=40), 0.2)
        assert expected.low is not None
        if expected.state == "trend":
            assert expected.high is not None
            total += 1
            held += expected.low <= 80_000.0 <= expected.high
    assert total > 390
    assert 0.92 <= held / total <= 0.99


def test_without_a_trend_there_is_no_forecast() -> None:
    random = np.random.default_rng(5)
    cycle = np.arange(1, 41) * 1000.0
    flat = forecast(cycle, 0.001 * random.normal(size=40), 0.2)
    assert (flat.state, flat.cycles) == ("none", None)
    away = forecast(cycle, -0.1 * cycle / 40000.0, 0.2)
    assert (away.state, away.low) == ("none", None)
    assert forecast(cycle[:5], cycle[:5] / 1e5, 0.2).state == "unknown"


def test_a_limit_that_was_reached_states_when() -> None:
    cycle = np.arange(1, 41) * 1000.0
    reached = forecast(cycle, 0.01 * np.arange(1, 41), 0.3)
    assert (reached.state, reached.cycles) == ("reached", 30_000.0)


def joined(*levels: float, noise: float = 0.0) -> Sections:
    """Blocks of 100 cycles with these levels of every quantity."""
    random = np.random.default_rng(5)
    return Sections.joined([
        sections_of(
            np.arange(100 * n + 1, 100 * n + 101), n + 1,
            {name: level + noise * random.standard_normal(100) for name in QUANTITIES},
        ) for n, level in enumerate(levels)
    ])  # fmt: skip


def test_a_baseline_that_is_noise_ends_no_test() -> None:
    sections = joined(0.0, 0.0, 0.0, noise=2.0)
    for name in ("gas_force_down", "friction_up", "stiffness_down"):
        assert not reached_by(StopRule(name, 0.05), sections, 0)
    sections = joined(20.0, 2.0, noise=2.0)
    assert reached_by(StopRule("gas_force_down", 0.3), sections, 0)


def test_a_peak_force_that_is_noise_or_small_is_not_compared() -> None:
    """Two sections a block, whose medians alone cannot show the scatter; a stroke against the gas force only."""
    random, rule = np.random.default_rng(3), StopRule("force_down", 0.2)

    def tested(rebound_N: float, scatter_N: float, compression_N: float) -> Sections:
        return Sections.joined([
            sections_of(np.arange(20 * n + 1, 20 * n + 21), n + 1, statistics(
                20, force_max=level_N + scatter_N * random.standard_normal(20), force_min=np.full(20, compression_N),
            )) for n, level_N in enumerate((rebound_N, 0.1 * rebound_N))
        ])  # fmt: skip

    for sections in (tested(2.7, 5.0, -490.0), tested(12.0, 0.1, -490.0)):
        baseline = baseline_of(sections, 0)
        assert np.isnan(baseline["force_max"])
        assert not reached_by(rule, sections, 0)
        assert why_not_evaluated(rule, sections, 0) == FEW_BLOCKS, "the other direction is evaluated, when it is known"
    noise = tested(2.7, 5.0, 0.0)
    assert np.all(np.isnan(changes(rule, noise, baseline_of(noise, 0))))
    assert why_not_evaluated(rule, noise, 0) == "the baseline cannot be clearly distinguished from zero"
    assert why_not_evaluated(rule, noise, 1000) == "", "there is no baseline yet"
    weaker = tested(400.0, 5.0, -490.0)
    assert reached_by(rule, weaker, 0)


def test_missing_statistics_do_not_disable_a_rule() -> None:
    rule = StopRule("force_down", 0.2)
    weaker = joined(100.0, 10.0)
    for values in weaker.medians.values():
        values[-1] = np.nan
    assert reached_by(rule, weaker, 0), "the last section has no samples"
    late = joined(np.nan, 100.0, 10.0)
    assert baseline_of(late, 0)["force_max"] == 100.0
    assert reached_by(rule, late, 0), "the first block has no statistics"
    blind = joined(100.0, 10.0, np.nan)
    assert not reached_by(rule, blind, 0), "an earlier block was evaluated when it ended"


def test_a_limit_is_reached_only_beyond_the_uncertainty() -> None:
    """A baseline of 8 standard errors: its scatter alone exceeds 20 % in some blocks of 40; real wear ends the test."""
    rule, scatter = StopRule("stiffness_down", 0.2), 100.0 / 8.0 * np.sqrt(10.0) / 1.2533

    def first_stop(*levels: float) -> int | None:
        sections = joined(*levels, noise=scatter)
        ends = np.flatnonzero(np.diff(sections.block, append=0.0)) + 1
        for number, end in enumerate(ends, 1):
            medians, errors = (
                {n: values[:end] for n, values in one.items()} for one in (sections.medians, sections.errors)
            )
            so_far = Sections(sections.cycle[:end], sections.block[:end], medians, sections.group[:end], errors)
            if reached_by(rule, so_far, 0):
                return number
        return None

    healthy = joined(*[100.0] * 40, noise=scatter)
    assert np.max(changes(rule, healthy, baseline_of(healthy, 0))[9::10]) > 0.2, "the last section alone would end it"
    assert 0.15 < uncertainty_of(rule, healthy, 0) < 0.5
    assert first_stop(*[100.0] * 40) is None
    assert first_stop(*[100.0] * 10, *[40.0] * 8) in range(11, 18)
    exact = joined(*[100.0] * 13, 79.5, noise=0.01)
    assert reached_by(rule, exact, 0), "a well-known quantity ends the test with the first block beyond its limit"


def test_an_unknown_scatter_from_block_to_block_ends_no_test() -> None:
    rule = StopRule("stiffness_down", 0.2)
    few = joined(100.0, 100.0, 75.0, 75.0, noise=0.01)
    assert not reached_by(rule, few, 0)
    assert why_not_evaluated(rule, few, 0)
    assert np.isnan(uncertainty_of(rule, few, 0))
    lost = joined(100.0, 5.0, noise=0.01)
    assert reached_by(rule, lost, 0), "no scatter explains a total loss"
    assert why_not_evaluated(rule, lost, 0) == ""
    absolute = StopRule("temperature", 90.0)
    assert reached_by(absolute, joined(95.0, noise=0.01), 0)
    assert why_not_evaluated(absolute, few, 0) == ""


def test_levels_that_scatter_from_block_to_block_end_few_healthy_tests_and_worn_ones() -> None:
    """White scatter of 5 % of the level, one cycle a block; the limit is 10 %."""
    random, rule, blocks = np.random.default_rng(8), StopRule("stiffness_down", 0.1), 40

    def ended(loss: float) -> bool:
        level = 100.0 * (1.0 - loss * np.arange(blocks) / blocks + 0.05 * random.standard_normal(blocks))
        medians = dict.fromkeys(QUANTITIES, level)
        so_far = [
            Sections(np.arange(1.0, n + 1), np.arange(1.0, n + 1), {q: v[:n] for q, v in medians.items()},
                     np.zeros(n, np.int64)) for n in range(2, blocks + 1, 2)
        ]  # fmt: skip
        return any(reached_by(rule, sections, 0) for sections in so_far)

    assert sum(ended(0.0) for _ in range(8)) <= 1
    assert sum(ended(0.8) for _ in range(4)) >= 3


def test_a_forecast_is_never_in_the_past() -> None:
    random = np.random.default_rng(1)
    for _ in range(300):
        cycle = 100.0 * np.arange(1, 24)
        change = 1e-4 * cycle + 0.03 * random.standard_normal(23)
        expected = forecast(cycle, change, 0.22)
        if expected.state == "trend":
            assert expected.low is not None
            assert expected.cycles is not None
            assert expected.high is not None
            assert cycle[-1] <= expected.low <= expected.cycles <= expected.high


def test_cycles_of_a_current_program_are_compared_with_those_of_the_same_current() -> None:
    """The force at the low current falls to 70 % while that at the high current stays."""
    numbers, groups = np.arange(1, 161), np.tile([0, 1, -1, 1], 40)
    force_N = np.where(groups == 0, np.linspace(100.0, 70.0, 160), np.where(groups == 1, 1000.0, 5.0))
    sections = sections_of(numbers, 1, statistics(160, force_max=force_N, force_min=-force_N), groups)
    low, high = sections.groups
    assert (len(low), len(high)) == (4, 4)
    assert high.medians["force_max"] == pytest.approx(1000.0)
    rule = StopRule("force_down", 0.1)
    assert changes(rule, high, baseline_of(high, 0))[-1] == pytest.approx(0.0)
    baseline = {name: abs(float(values[0])) for name, values in low.medians.items()} | {"force_min": -96.0}
    assert changes(rule, low, baseline)[-1] > 0.2
