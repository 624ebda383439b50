"""What stands beside the models compared: the mean cycle of each test, and a regression."""

from collections.abc import Callable

import numpy as np
import pytest

from rig.cli.fit_tables import fit_tables
from rig.dampers import parameter_set
from rig.document.blocks import Table
from rig.identification import Fit, Measurement, identify
from rig.identification.boosting import DEPTH, RATE, SEED, SHARE, TREES, boosted
from rig.identification.reference import references

NOISE_N = 8.0


@pytest.fixture
def tests(make_synthetic: Callable[..., list[Measurement]]) -> list[Measurement]:
    """Six tests at three frequencies, four cycles each."""
    truth = parameter_set("demo").values
    return make_synthetic(truth, currents_A=(0.0, 2.0), frequencies_Hz=(0.5, 1.0, 2.0), cycles=4, noise_N=NOISE_N)


def test_the_mean_cycle_leaves_the_noise_and_no_more(tests: list[Measurement]) -> None:
    floor, _ = references(tests, [], [tests])
    # The mean of three other cycles has a third of one cycle's variance; interpolation between samples takes a little.
    expected = np.mean([100.0 * NOISE_N * np.sqrt(4.0 / 3.0) / test.peak_force_N for test in tests])
    assert floor.holdout_nrmse_percent_of_peak == pytest.approx(expected, rel=0.15)


def test_a_regression_learns_what_it_sees_and_is_worse_on_motions_it_has_not_seen(tests: list[Measurement]) -> None:
    groups = [[test for test in tests if test.frequency_Hz == frequency] for frequency in (0.5, 1.0, 2.0)]
    _, regression = references(tests, [], groups)
    again = references(tests, [], groups)[1]
    assert regression == again
    seen, unseen = regression.nrmse_percent_of_peak, regression.holdout_nrmse_percent_of_peak
    assert seen is not None
    assert unseen is not None
    assert seen < 6.0 < unseen < 60.0


@pytest.mark.parametrize("width", [4, 14])
def test_boosting_is_as_near_to_unseen_values_as_that_of_scikit_learn(width: int) -> None:
    peer = pytest.importorskip("sklearn.ensemble")
    random = np.random.default_rng(width)
    inputs, weights = random.normal(size=(3000, width)), random.uniform(0.5, 2.0, 3000)
    true = 800.0 * np.tanh(4.0 * inputs[:, 1]) * (1.0 + inputs[:, 2]) + 30.0 * np.sign(inputs[:, 3])
    seen, unseen = slice(0, 2000), slice(2000, None)
    learnt = boosted(inputs[seen], true[seen] + random.normal(0.0, NOISE_N, 2000), weights[seen])
    other = peer.GradientBoostingRegressor(
        n_estimators=TREES, learning_rate=RATE, max_depth=DEPTH, subsample=SHARE, random_state=SEED
    )
    other.fit(inputs[seen], true[seen], sample_weight=weights[seen])
    ours, theirs = (np.sqrt(np.mean((one.predict(inputs) - true)[unseen] ** 2)) for one in (learnt, other))
    assert ours == pytest.approx(theirs, rel=0.15)
    assert ours < 0.2 * np.std(true)


def test_boosting_weighs_its_rows_and_takes_inputs_of_one_value() -> None:
    inputs, values = np.column_stack((np.repeat([0.0, 1.0], 50), np.zeros(100))), np.tile([0.0, 1.0], 50)
    learnt = boosted(inputs, values, np.tile([1.0, 3.0], 50))
    assert learnt.predict(inputs) == pytest.approx(0.75, abs=0.05)
    assert boosted(inputs, inputs[:, 0], np.ones(100)).predict(inputs) == pytest.approx(inputs[:, 0], abs=1e-4)


def test_a_ranking_shows_both_and_one_model_none(tests: list[Measurement], monkeypatch: pytest.MonkeyPatch) -> None:
    from rig import dampers

    monkeypatch.setattr(dampers, "MODELS", {name: dampers.model(name) for name in ("kwok", "bingham")})
    fit: Fit = identify(tests[:4], model="all", holdout=tests[4:])
    assert [entry["name"] for entry in fit.to_json()["references"]] == ["mean_cycle", "regression"]
    tables = (part for part in fit_tables(fit) if isinstance(part, Table))
    table = next(part for part in tables if part.columns[-1].title == "BIC")
    assert [str(row.cells[0]).split(":")[0] for row in table.rows][-2:] == ["no model", "no model"]
    assert max(len(str(cell)) for row in table.rows for cell in row.cells) < 25  # or the table becomes a list
    assert identify(tests, model="kwok").references == ()
