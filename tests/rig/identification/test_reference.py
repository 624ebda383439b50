"""What stands beside the models compared: the mean cycle of each test, and a regression."""

import sys
from collections.abc import Callable

import numpy as np
import pytest

from rig.cli.fit_tables import fit_tables
from rig.dampers import parameter_set
from rig.document.blocks import Table
from rig.identification import Fit, Measurement, identify
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
    pytest.importorskip("sklearn")
    groups = [[test for test in tests if test.frequency_Hz == frequency] for frequency in (0.5, 1.0, 2.0)]
    _, regression = references(tests, [], groups)
    again = references(tests, [], groups)[1]
    assert regression == again
    seen, unseen = regression.nrmse_percent_of_peak, regression.holdout_nrmse_percent_of_peak
    assert seen is not None
    assert unseen is not None
    assert seen < 6.0 < unseen < 60.0


def test_without_the_library_the_way_out_is_reported(
    tests: list[Measurement], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "sklearn.ensemble", None)
    _, regression = references(tests, [], [tests])
    assert regression.holdout_nrmse_percent_of_peak is None
    assert "mr-damper-rig[reference]" in regression.reason


def test_a_ranking_shows_both_and_one_model_none(
    tests: list[Measurement], monkeypatch: pytest.MonkeyPatch
) -> None:
    from rig import dampers

    monkeypatch.setattr(dampers, "MODELS", {name: dampers.model(name) for name in ("kwok", "bingham")})
    monkeypatch.setitem(sys.modules, "sklearn.ensemble", None)
    fit: Fit = identify(tests[:4], model="all", holdout=tests[4:])
    assert [entry["name"] for entry in fit.to_json()["references"]] == ["mean_cycle", "regression"]
    tables = (part for part in fit_tables(fit) if isinstance(part, Table))
    table = next(part for part in tables if part.columns[-1].title == "BIC")
    assert [str(row.cells[0]).split(":")[0] for row in table.rows][-2:] == ["no model", "no model"]
    assert max(len(str(cell)) for row in table.rows for cell in row.cells) < 25  # or the table becomes a list
    assert identify(tests, model="kwok").references == ()
