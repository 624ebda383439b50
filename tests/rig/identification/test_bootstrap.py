"""Tests drawn again: what the intervals of a wrong model must know, and what does not depend on how the work is
shared."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.errors import IdentificationFailed
from rig.identification import Measurement, Method, bootstrap, identify
from rig.identification.uncertainty.bootstrap_result import intervals_of

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)


def test_an_interval_ends_at_the_bound_of_its_parameter() -> None:
    draws = np.random.default_rng(0).normal(0.51, 0.02, (400, 2))
    bounds = np.array([[0.5, np.inf], [-np.inf, 0.515]])
    low, high, spread = intervals_of(np.array([0.51, 0.51]), draws, 20, 1.0, bounds)
    assert (low[0], high[1]) == (0.5, 0.515)
    assert low[1] < 0.48 < 0.54 < high[0]
    assert spread == pytest.approx(np.std(draws, axis=0, ddof=1) * 1.96 / 2.093, rel=1e-3)


def test_draws_are_the_same_however_they_are_shared_out(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0, 2.0), (1.0, 2.0), cycles=3)
    fit = identify(tests)
    alone = bootstrap(fit, tests, count=24, seed=4)
    with ThreadPoolExecutor(2) as executor:
        shared = bootstrap(fit, tests, count=24, seed=4, executor=executor, chunks=5)
    assert np.allclose(alone.draws, shared.draws, rtol=1e-6)
    assert not np.allclose(alone.draws, bootstrap(fit, tests, count=24, seed=5).draws, rtol=1e-6)


def test_tests_that_the_fit_has_not_seen_are_refused(make_synthetic: Make) -> None:
    """Held-out tests among the drawn ones would move the draws away from the fit, and narrow its intervals."""
    tests = make_synthetic(DEMO, (0.0, 1.0, 2.0), (1.0, 2.0), cycles=3)
    fit = identify(tests[:5], holdout=tests[5:])
    with pytest.raises(IdentificationFailed, match="not fitted: p006"):
        bootstrap(fit, tests, count=24)
    with pytest.raises(IdentificationFailed, match="missing: p005"):
        bootstrap(fit, tests[:4], count=24)


@pytest.mark.nightly
def test_a_right_models_spread_is_that_of_fits_to_new_noise(make_synthetic: Make) -> None:
    fits = [identify(make_synthetic(DEMO, (0.0, 1.0, 2.0), (0.5, 1.0, 2.0), seed=seed, cycles=4)) for seed in range(25)]
    tests = make_synthetic(DEMO, (0.0, 1.0, 2.0), (0.5, 1.0, 2.0), seed=99, cycles=4)
    drawn = bootstrap(identify(tests), tests, count=150).to_pandas()
    for name in ("Fyb", "Ca_plus", "Cb_minus", "Ka"):
        true = float(np.std([fit.values[name] for fit in fits], ddof=1))
        assert 0.5 < drawn.loc[name, "standard_error"] / true < 2.2, name
        assert drawn.loc[name, "low"] < DEMO[name] < drawn.loc[name, "high"]


@pytest.mark.nightly
def test_halves_of_the_tests_of_another_damper_agree_within_the_drawn_intervals(make_synthetic: Make) -> None:
    true = dict(model("lost_motion").demonstration)
    agree, own = [], []
    for seed in range(4):
        tests = make_synthetic(true, name="lost_motion", seed=seed, cycles=3)
        order = np.random.default_rng(seed).permutation(len(tests))
        parts = [[tests[k] for k in half] for half in np.array_split(order, 2)]
        fits = [identify(part, model="kwok") for part in parts]
        tables = [bootstrap(fit, part, count=60).to_pandas() for fit, part in zip(fits, parts, strict=True)]
        for name in set(tables[0].index) & set(tables[1].index):
            gap = abs(fits[0].values[name] - fits[1].values[name])
            agree.append(
                gap <= math.hypot(*(0.5 * float(one.loc[name, "high"] - one.loc[name, "low"]) for one in tables))
            )
            ends = [fit.parameters[name] for fit in fits]
            if all(end.low is not None and end.high is not None for end in ends):
                own.append(gap <= math.hypot(*(0.5 * (end.high - end.low) for end in ends)))  # type: ignore[operator]  # not None: above
        assert fits[0].adequate is False
    assert np.mean(agree) >= 0.88
    assert np.mean(agree) > np.mean(own)


def test_a_prediction_knows_what_the_draws_disagree_about(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0, 2.0), (1.0, 2.0), cycles=3)
    fit = identify(tests)
    drawn = bootstrap(fit, tests, count=40)
    table = {"displacement_m": 0.0, "velocity_m_s": [0.1, 3.0], "current_A": 1.0}
    plain, wide = fit.predict(table), drawn.predict(table)
    assert np.allclose(wide["force_N"], plain["force_N"])
    assert wide["low_N"].equals(plain["low_N"])
    width_N = wide["model_high_N"] - wide["model_low_N"]
    assert width_N.iloc[0] < 0.5 * (plain["high_N"] - plain["low_N"]).iloc[0]  # inside the tests the noise decides
    assert width_N.iloc[1] > 2.0 * width_N.iloc[0]  # five times beyond their speed the values do
    assert list(wide["extrapolates"]) == [False, True]


def test_what_cannot_be_drawn_is_refused_with_every_reason(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0), cycles=3)
    fit = identify(tests)
    with pytest.raises(IdentificationFailed, match="expected 20 or more"):
        bootstrap(fit, tests, count=5)
    related = identify(tests, model="kwok", current="per-current-affine")
    with pytest.raises(IdentificationFailed, match=r"2 tests, expected 3 or more.*functions of the current"):
        bootstrap(related, tests[:2])
    with pytest.raises(IdentificationFailed, match="searched simultaneously"):
        bootstrap(replace(fit, model="viscoelastic_plastic"), tests)


def test_outliers_and_relative_weights_stay_what_they_were_in_the_fit(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0, 2.0), (1.0, 2.0), cycles=3)
    far = [replace(test, force_N=test.force_N + 900.0 * (np.arange(test.u_m.size) % 31 == 3)) for test in tests]
    for method in (Method(loss="huber"), Method(loss="huber", weight="relative")):
        fit = identify(far, method=method)
        drawn = bootstrap(fit, far, count=30).to_pandas()
        assert abs(drawn.loc["F0", "value"] + 270.0) < 5.0
        assert drawn.loc["F0", "standard_error"] < 2.0
