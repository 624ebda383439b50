"""Control charts, gauge studies and capability: published examples, and intervals that cover what they claim."""

from __future__ import annotations

import numpy as np
import pytest

from rig.process_quality import gauge_study as gauge_module
from rig.process_quality.capability import distance_index, gauge_capability, process_capability, spread_index
from rig.process_quality.control_chart import (
    D2,
    Rule,
    TooFewValues,
    control_chart,
    moving_range_variance,
    violations_of,
)
from rig.process_quality.gauge_study import gauge_study, table_of

LOANS = (
    310, 288, 297, 298, 307, 303, 294, 297, 308, 306, 294, 299, 297, 299, 314, 295, 293, 306, 301, 304,
    305, 282, 305, 296, 314, 295, 287, 301, 298, 311, 310, 292, 305, 299, 304, 310, 304, 305, 333, 328,
)  # fmt: skip
"""Montgomery, Introduction to Statistical Quality Control, example 6.5: 20 weeks of phase I, 20 of phase II."""
AIAG = (
    ((0.29, -0.56, 1.34, 0.47, -0.80, 0.02, 0.59, -0.31, 2.26, -1.36),
     (0.41, -0.68, 1.17, 0.50, -0.92, -0.11, 0.75, -0.20, 1.99, -1.25),
     (0.64, -0.58, 1.27, 0.64, -0.84, -0.21, 0.66, -0.17, 2.01, -1.31)),
    ((0.08, -0.47, 1.19, 0.01, -0.56, -0.20, 0.47, -0.63, 1.80, -1.68),
     (0.25, -1.22, 0.94, 1.03, -1.20, 0.22, 0.55, 0.08, 2.12, -1.62),
     (0.07, -0.68, 1.34, 0.20, -1.28, 0.06, 0.83, -0.34, 2.19, -1.50)),
    ((0.04, -1.38, 0.88, 0.14, -1.46, -0.29, 0.02, -0.46, 1.77, -1.49),
     (-0.11, -1.13, 1.09, 0.20, -1.07, -0.67, 0.01, -0.56, 1.45, -1.77),
     (-0.15, -0.96, 0.67, 0.11, -1.45, -0.49, 0.21, -0.49, 1.87, -2.16)),
)  # fmt: skip
"""AIAG, Measurement Systems Analysis, 4th edition: appraiser, trial, part. The data and results are those that Minitab
publishes as GAGEAIAG.MTW, compared digit by digit with their copy in github.com/dflores296/msa-toolkit."""


def aiag() -> np.ndarray:
    return np.transpose(np.array(AIAG), (2, 0, 1))


def test_the_individuals_chart_is_that_of_the_textbook() -> None:
    chart = control_chart(np.array(LOANS, float), 20)
    assert chart.centre == pytest.approx(300.5)
    assert chart.mean_range == pytest.approx(7.79, abs=0.005)
    assert chart.limits == pytest.approx((279.78, 321.22), abs=0.02)
    assert chart.range_limit == pytest.approx(25.45, abs=0.02)
    beyond = [one.index for one in chart.violations if one.rule == Rule.BEYOND]
    assert beyond == [38, 39]
    assert not chart.in_control
    assert control_chart(np.array(LOANS[:38], float), 20).in_control


def test_each_rule_signals_on_its_pattern_and_only_there() -> None:
    patterns = {
        Rule.BEYOND: [0.0, 0.0, 3.1], Rule.TWO_OF_THREE: [0.1, 2.1, -0.1, 2.2],
        Rule.FOUR_OF_FIVE: [-0.2, 1.1, 1.2, -0.1, 1.1, 1.3], Rule.EIGHT: [-0.5, *([0.5] * 8)],
    }  # fmt: skip
    for rule, values in patterns.items():
        for sign in (1.0, -1.0):
            signals = violations_of(sign * np.array(values), 0.0, 1.0, 10.0)
            assert [(one.index, one.rule, one.side) for one in signals] == [(len(values) - 1, rule, int(sign))], rule
            assert violations_of(sign * np.array(values[:-1]), 0.0, 1.0, 10.0) == ()
    (jump,) = violations_of(np.array([-1.5, 1.5, 1.4]), 0.0, 1.0, 0.9)
    assert (jump.index, jump.rule) == (1, Rule.RANGE)
    disturbed = violations_of(np.array([0.0, 5.0, 0.0]), 0.0, 1.0, D2)
    assert {one.index for one in disturbed} == {1}, "the return from a marked value is no signal"


def test_the_rules_together_signal_as_often_as_published() -> None:
    random = np.random.default_rng(5)
    lengths = []
    for _ in range(500):
        values = random.standard_normal(900)
        # A rule looks only back: most series signal early, and their later values need not be evaluated.
        signals = violations_of(values[:150], 0.0, 1.0, 100.0) or violations_of(values, 0.0, 1.0, 100.0)
        lengths.append(1 + min((one.index for one in signals), default=899))
    # Champ and Woodall, Technometrics 29 (1987) 393: 91.75 values on average
    assert np.mean(lengths) == pytest.approx(91.75, abs=3.0 * np.std(lengths) / np.sqrt(500))


def test_phase_i_loses_disturbances_and_too_few_or_equal_values_are_named() -> None:
    random = np.random.default_rng(2)
    values = random.normal(100.0, 1.0, 30)
    clean = control_chart(values, 25)
    values[7] += 12.0
    chart = control_chart(values, 25)
    assert chart.removed == (7,)
    assert chart.sigma == pytest.approx(clean.sigma, rel=0.1)
    assert any("do not include: 1 of 25" in remark for remark in chart.remarks)
    with pytest.raises(TooFewValues, match="got 5 values"):
        control_chart(values[:5])
    assert any("equal" in remark for remark in control_chart(np.ones(10)).remarks)
    drifting = control_chart(np.linspace(0.0, 1.0, 25) + 0.02 * random.standard_normal(25))
    assert any("correlated" in remark for remark in drifting.remarks)


def test_the_spread_of_a_moving_range_is_as_stated() -> None:
    random = np.random.default_rng(2)
    sigma = np.mean(np.abs(np.diff(random.standard_normal((4000, 25)))), axis=1) / D2
    assert np.var(sigma) == pytest.approx(moving_range_variance(25), rel=0.08)


def test_the_gauge_study_is_that_of_the_manual() -> None:
    study = gauge_study(aiag())
    assert study.pooled
    squares = {row.name: row.sum_of_squares for row in gauge_study(aiag(), pool=False).anova}
    assert squares == pytest.approx(
        {"operator": 3.1673, "part": 88.3619, "interaction": 0.3590, "repeatability": 2.7589}, abs=5e-5
    )
    tests = {row.name: (row.F, row.p) for row in gauge_study(aiag(), pool=False).anova}
    assert [tests[name][0] for name in ("part", "operator", "interaction")] == pytest.approx(
        [492.291, 79.406, 0.434], abs=6e-4
    )
    assert tests["interaction"][1] == pytest.approx(0.974, abs=5e-4)
    components = study.components
    assert {name: components[name].std for name in ("repeatability", "operator", "gauge", "part")} == pytest.approx(
        {"repeatability": 0.199933, "operator": 0.226838, "gauge": 0.302373, "part": 1.042327}, abs=2e-6
    )
    names = ("repeatability", "operator", "gauge", "part")
    assert [round(components[name].std ** 2, 5) for name in names] == [0.03997, 0.05146, 0.09143, 1.08645]
    assert [round(components[name].study_percent, 2) for name in names] == [18.42, 20.90, 27.86, 96.04]
    assert [round(components[name].contribution_percent, 2) for name in names] == [3.39, 4.37, 7.76, 92.24]
    assert study.categories[0] == pytest.approx(4.861, abs=1e-3)
    assert study.ndc == 4
    # Exact interval of the repeatability: 78 degrees of freedom.
    repeatability = components["repeatability"]
    assert (repeatability.low, repeatability.high) == pytest.approx((0.1727, 0.2373), abs=6e-4)
    assert gauge_study(aiag(), 3.0).components["gauge"].tolerance_percent == pytest.approx(60.47, abs=0.01)


def test_an_interaction_one_operator_and_bad_studies() -> None:
    random = np.random.default_rng(4)
    crossed = random.normal(0.0, 1.0, (10, 3, 1)) + random.normal(0.0, 0.1, (10, 3, 3))
    study = gauge_study(crossed)
    assert study.pooled is False
    assert study.components["interaction"].std == pytest.approx(1.0, rel=0.4)
    alone = gauge_study(crossed[:, :1])
    assert alone.pooled is None
    assert alone.components["gauge"].std == alone.components["repeatability"].std
    assert "one operator" in alone.remarks[0]
    for bad, message in ((np.ones((3, 2, 2)), "equal"), (np.full((3, 2, 2), np.nan), "finite")):
        with pytest.raises(ValueError, match=message):
            gauge_study(bad)
    with pytest.raises(TooFewValues, match="trials: got 1"):
        gauge_study(crossed[:, :, :1])
    values, parts, operators = table_of({("b", "x"): [1, 2, 3], ("a", "x"): [4, 5]})
    assert (values.shape, parts, operators) == ((2, 1, 3), ["a", "b"], ["x"])
    assert np.isnan(values[0, 0, 2])
    with pytest.raises(ValueError, match=r"a by y.*Fix"):
        table_of({("a", "x"): [1, 2], ("b", "x"): [1, 2], ("b", "y"): [1, 2]})
    with pytest.raises(ValueError, match="at least one finite value"):
        gauge_study(np.where(np.arange(10)[:, None, None] == 4, np.nan, crossed))


def test_an_unbalanced_study_uses_every_value(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gauge_module, "DRAWS", 100)
    # Worked by hand: means 2, 5, 9, 10 with 3, 2, 1, 2 trials; harmonic mean 4 / (1/3 + 1/2 + 1 + 1/2) = 12/7.
    values = np.array([[[1, 2, 3], [4, 6, np.nan]], [[9, np.nan, np.nan], [8, 12, np.nan]]], float)
    study = gauge_study(values, pool=False)
    trials = 12.0 / 7.0
    assert (study.trials, study.count) == (pytest.approx(trials), 8)
    assert (study.fewest_trials, study.most_trials) == (1, 3)
    assert [row.name for row in study.anova] == ["part", "operator", "interaction", "repeatability"]
    assert [row.freedom for row in study.anova] == [1, 1, 1, 4]
    assert [row.sum_of_squares for row in study.anova] == pytest.approx([36.0 * trials, 4.0 * trials, trials, 12.0])
    assert study.components["part"].std ** 2 == pytest.approx((36.0 - 1.0) * trials / (2.0 * trials))
    assert any("1 to 3" in remark for remark in study.remarks)
    random = np.random.default_rng(12)
    truth, variances = np.array([0.09, 0.13, 1.0]), []
    for _ in range(150):
        drawn = (random.standard_normal((10, 1, 1)) + 0.2 * random.standard_normal((1, 3, 1))
                 + 0.3 * random.standard_normal((10, 3, 3)))  # fmt: skip
        drawn[:, :, 1:][random.random((10, 3, 2)) < 0.5] = np.nan
        one = gauge_study(drawn).components
        variances.append([one[name].std ** 2 for name in ("repeatability", "gauge", "part")])
    error = np.std(variances, axis=0) / np.sqrt(len(variances))
    assert np.all(np.abs(np.mean(variances, axis=0) - truth) < 3.5 * error)


def test_limits_are_not_narrower_than_the_measurement() -> None:
    noise = 1e-11 * np.random.default_rng(1).standard_normal(40)
    chart = control_chart(500.0 + noise, 25, 0.2)
    assert (chart.sigma, chart.mean_range) == pytest.approx((0.2, 0.2 * D2))
    assert chart.in_control
    assert "repeatability" in chart.remarks[0]
    assert not control_chart(np.append(500.0 + noise, 500.7), 25, 0.2).in_control
    wide = control_chart(np.random.default_rng(1).normal(500.0, 1.0, 40), 25, 0.2)
    assert wide.sigma > 0.5
    assert not any("repeatability" in remark for remark in wide.remarks)
    with pytest.raises(ValueError, match="resolution"):
        process_capability(500.0 + noise, 490.0, 510.0)
    parts = np.arange(5.0)[:, None, None] + np.zeros((5, 2, 3)) + 500.0
    exact = gauge_study(parts)
    assert not exact.resolved
    assert exact.components["gauge"].study_percent < 0.1
    assert any("lower limit" in remark for remark in exact.remarks)


def test_intervals_of_a_gauge_study_cover_what_they_claim(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gauge_module, "DRAWS", 2000)
    random = np.random.default_rng(7)
    truth = {"repeatability": 0.3, "operator": 0.2, "part": 1.0}
    gauge = float(np.hypot(0.3, 0.2))
    covered = {"repeatability": 0, "gauge": 0, "share": 0}
    count = 150
    for _ in range(count):
        values = (
            truth["part"] * random.standard_normal((10, 1, 1)) + truth["operator"] * random.standard_normal((1, 3, 1))
            + truth["repeatability"] * random.standard_normal((10, 3, 3))
        )  # fmt: skip
        one = gauge_study(values).components
        covered["repeatability"] += one["repeatability"].low <= truth["repeatability"] <= one["repeatability"].high
        covered["gauge"] += one["gauge"].low <= gauge <= one["gauge"].high
        percent = 100.0 * gauge / float(np.hypot(gauge, truth["part"]))
        covered["share"] += one["gauge"].study_low <= percent <= one["gauge"].study_high
    assert all(0.90 * count <= number <= count for number in covered.values()), covered


def test_capability_is_that_of_the_textbook_and_its_intervals_cover() -> None:
    cp, cpk = spread_index(2.29, 19.0), distance_index(1.33, 20, 19.0)
    assert (cp.low, cp.high) == pytest.approx((1.57, 3.01), abs=0.005)  # Montgomery, example 8.4
    assert (cpk.low, cpk.high) == pytest.approx((0.88, 1.78), abs=0.005)  # example 8.5
    random = np.random.default_rng(3)
    count, inside = 150, np.zeros(4)
    for _ in range(count):
        one = process_capability(random.normal(0.5, 1.0, 50), -4.0, 4.0)
        assert one.cp is not None
        assert one.pp is not None
        true = (4.0 / 3.0, 3.5 / 3.0, 4.0 / 3.0, 3.5 / 3.0)
        indices = (one.cp, one.cpk, one.pp, one.ppk)
        inside += [index.low <= value <= index.high for index, value in zip(indices, true, strict=True)]
    assert np.all(np.abs(inside / count - 0.95) < 0.055), inside / count


def test_capability_of_one_limit_of_odd_values_and_of_a_gauge() -> None:
    random = np.random.default_rng(6)
    values = random.normal(10.0, 1.0, 60)
    one = process_capability(values, 7.0, None)
    assert (one.cp, one.pp) == (None, None)
    assert one.ppk.value == pytest.approx((np.mean(values) - 7.0) / (3.0 * np.std(values, ddof=1)))
    assert "not normally distributed" in process_capability(np.exp(values - 10.0), 0.0, 20.0).remarks[0]
    for low, high, message in ((None, None, "requires"), (2.0, 1.0, "first")):
        with pytest.raises(ValueError, match=message):
            process_capability(values, low, high)
    with pytest.raises(TooFewValues):
        process_capability(values[:5], 0.0, 1.0)
    gauge = gauge_capability(values, 60.0, 10.5, 0.5)
    std = np.std(values, ddof=1)
    assert gauge.cg.value == pytest.approx(0.2 * 60.0 / (6.0 * std))
    assert gauge.cgk is not None
    assert gauge.cgk.value == pytest.approx((6.0 - abs(np.mean(values) - 10.5)) / (3.0 * std))
    assert gauge.uncertainty_percent == pytest.approx(100.0 * 4.0 * 0.5 / 60.0)
    assert gauge.bias_p < 0.01
