"""Tests drawn again as a part of a fit, and the band that uncertain parameters give a prediction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.cli.fit_tables import fit_tables
from rig.dampers import parameter_set
from rig.document.blocks import Table
from rig.document.html import fragment
from rig.errors import IdentificationFailed
from rig.fits.entries import Uncertainty
from rig.identification import Fit, Measurement, identify
from rig.identification.runs import write_fit
from rig.report.fit import parameters as reported

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo-bingham").values)
# F = fc sgn v + c0 v + f0, linear in its parameters: beside the covariance's band nothing is to be known
TABLE = {"displacement_m": [0.0, 0.0], "velocity_m_s": [0.05, 0.3], "current_A": [1.0, 1.0]}


@pytest.fixture(scope="module")
def tests(make_synthetic: Make) -> list[Measurement]:
    return make_synthetic(DEMO, (0.0, 1.0, 2.0), (0.5, 1.0, 2.0), name="bingham", noise_N=20.0, cycles=3)


@pytest.fixture(scope="module")
def drawn(tests: list[Measurement]) -> Fit:
    return identify(tests, model="bingham", bootstrap=60)


def test_a_fit_keeps_the_intervals_of_tests_drawn_again(drawn: Fit, tmp_path: Path) -> None:
    assert drawn.drawn is not None
    assert (drawn.drawn.count, drawn.drawn.tests) == (60, 9)
    for name, interval in drawn.drawn.parameters.items():
        assert interval.low < DEMO[name] < interval.high, name
        covariance = drawn.parameters[name].standard_error
        assert covariance is not None
        assert 0.3 < interval.standard_error / covariance < 4.0, name  # 9 tests of white noise: near, and never zero
    path, _ = write_fit(drawn, tmp_path)
    assert Fit.load(path).drawn == drawn.drawn


def test_no_draws_are_made_that_nobody_requested(tests: list[Measurement]) -> None:
    fit = identify(tests, model="bingham")
    assert fit.drawn is None
    assert fit.to_json()["bootstrap"] is None
    with pytest.raises(IdentificationFailed, match="expected 20 or more"):
        identify(tests, model="bingham", bootstrap=5)
    with pytest.raises(IdentificationFailed, match="bootstrap"):
        identify(tests, model="bingham", current="per-current-affine", bootstrap=50)


def test_terminal_and_report_show_both_intervals(drawn: Fit) -> None:
    table = next(part for part in fit_tables(drawn) if isinstance(part, Table) and "Fit:" in part.title)
    assert table.columns[-1].title == "95 %, 60 bootstrap samples"
    assert "60 bootstrap samples" in fragment(reported(drawn))
    without = replace(drawn, uncertainty=replace(drawn.uncertainty, drawn=None))
    assert "bootstrap" not in fragment(reported(without))


def test_the_band_of_the_covariance_is_that_of_linear_least_squares(tests: list[Measurement]) -> None:
    fit = identify(tests, model="bingham")
    predicted = fit.predict(TABLE, band=True)
    half_N = 0.5 * (predicted["model_high_N"] - predicted["model_low_N"]).to_numpy()
    names = ("fc", "fc_b", "c0", "c0_b", "f0")
    errors = np.array([fit.parameters[name].standard_error for name in names], dtype=float)
    matrix = np.array([[fit.correlation[a][b] for b in names] for a in names]) * np.outer(errors, errors)
    for half, v in zip(half_N, (0.05, 0.3), strict=True):
        column = np.array([1.0, 1.0, v, v, 1.0])  # dF/d(each) at 1 A
        assert half == pytest.approx(1.96 * float(np.sqrt(column @ matrix @ column)), rel=0.35)  # 200 draws
    plain = fit.predict(TABLE)
    assert predicted[["low_N", "high_N"]].equals(plain[["low_N", "high_N"]])
    assert not {"model_low_N", "model_high_N"} & set(plain.columns)


def test_a_band_goes_by_the_draws_where_there_are_some(drawn: Fit) -> None:
    assert drawn.drawn is not None
    narrow = {name: tuple(drawn.values[name] for _ in values) for name, values in drawn.drawn.draws.items()}
    kept = replace(drawn.uncertainty, drawn=replace(drawn.drawn, draws=narrow))
    same = replace(drawn, uncertainty=kept).predict(TABLE, band=True)
    assert np.allclose(same["model_low_N"], same["force_N"])  # all draws agree
    predicted = drawn.predict(TABLE, band=True)
    assert np.all(predicted["model_low_N"] < predicted["force_N"])
    assert np.all(predicted["force_N"] < predicted["model_high_N"])


def test_a_fit_that_tells_no_covariance_has_no_band(tests: list[Measurement]) -> None:
    fit = identify(tests, model="bingham")
    with pytest.raises(IdentificationFailed, match="--bootstrap"):
        replace(fit, uncertainty=Uncertainty()).predict(TABLE, band=True)
    with pytest.raises(IdentificationFailed, match="functions of the current"):
        identify(tests, model="bingham", current="per-current-affine").predict(TABLE, band=True)
