"""The band of a prediction: errors of motions that the fit has not seen, and none where nothing is known."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rig.dampers import parameter_set
from rig.errors import FileProblem
from rig.fits.entries import Band
from rig.identification import Fit, Measurement, identify
from rig.identification.models.measurement import first_cycle
from rig.identification.runs import write_fit
from rig.identification.uncertainty.prediction_error import error_band

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)
CURRENTS_A = (0.0, 1.0, 2.0)


@pytest.fixture(scope="module")
def tests(make_synthetic: Make) -> list[Measurement]:
    return make_synthetic(DEMO, CURRENTS_A, (0.5, 1.0, 1.5, 2.0), cycles=2)


@pytest.fixture(scope="module")
def fit(tests: list[Measurement]) -> Fit:
    """A model without the plant's hysteresis: what it leaves repeats in every cycle."""
    return identify(tests, model="bingham", diagnose=False)


def table_of(test: Measurement) -> pd.DataFrame:
    return pd.DataFrame({"displacement_m": test.u_m, "velocity_m_s": test.v_m_s, "current_A": test.current_A})


def test_hidden_motions_lie_within_the_band_of_a_model_that_does_not_fit(make_synthetic: Make, fit: Fit) -> None:
    assert fit.tested is not None
    band = fit.tested.band
    assert (band.left_out, band.motions, band.source) == (9, 3, "cross-validation")  # the fastest motion is beyond
    inside = []
    for test in make_synthetic(DEMO, CURRENTS_A, (0.75, 1.25, 1.75), cycles=1):
        predicted = fit.predict(table_of(test))
        assert not predicted["extrapolates"].any()
        inside.append(np.mean(predicted["low_N"].le(test.force_N) & predicted["high_N"].ge(test.force_N)))
    assert np.mean(inside) >= 0.9
    widths_N = np.array(band.half_width_N)
    peaks_N = np.array([max(np.abs(test.force_N).max() for test in fit.tests if test.nominal_current_A == each)
                        for each in CURRENTS_A])  # fmt: skip
    assert np.all(widths_N < 0.5 * peaks_N)  # not by being as wide as the force


def test_left_out_motions_widen_the_residuals_of_the_fitted_ones(tests: list[Measurement], fit: Fit) -> None:
    assert fit.tested is not None
    residuals = error_band(fit.law, tests, [], "", to_the_noise=False)
    factors = np.array(fit.tested.band.half_width_N) / np.array(residuals.half_width_N)
    assert factors == pytest.approx(factors[0])
    assert 1.0 < factors[0] < 3.0
    assert not residuals.of_predictions
    errors = np.abs(np.concatenate([(one.force_N - fit.law.force_of(one)) for one in map(first_cycle, tests)
                                    if one.nominal_current_A == 1.0]))  # fmt: skip
    assert residuals.half_width_N[1] == pytest.approx(float(np.quantile(errors, 0.95)))


def test_a_model_that_fits_to_the_noise_has_the_band_of_the_noise(tests: list[Measurement]) -> None:
    fit = identify(tests, diagnose=False)
    assert fit.adequate
    assert fit.tested is not None
    assert fit.tested.band.half_width_N == pytest.approx((9.8, 9.8, 9.8), rel=0.1)  # 5 N of noise: 1.96 x 5


def test_rows_beyond_the_tests_have_no_band(fit: Fit) -> None:
    rows = {"displacement_m": 0.0, "velocity_m_s": [0.1, 5.0, 0.1, 0.1], "current_A": [1.0, 1.0, 3.0, 0.5]}
    predicted = fit.predict(rows)
    assert predicted["extrapolates"].tolist() == [False, True, True, False]
    assert predicted["low_N"].isna().tolist() == predicted["high_N"].isna().tolist() == [False, True, True, False]


def test_a_fit_of_an_earlier_version_opens_and_gives_no_band(fit: Fit, tmp_path: Path) -> None:
    written, _ = write_fit(fit, tmp_path)
    content = json.loads(written.read_text())
    assert (content["tested"]["band"].pop("left_out"), content["tested"]["band"].pop("motions")) == (9, 3)
    written.write_text(json.dumps(content))
    old, row = Fit.load(written), {"displacement_m": 0.0, "velocity_m_s": 0.1, "current_A": 1.0}
    predicted = old.predict(row)
    assert predicted[["low_N", "high_N"]].isna().all(axis=None)
    assert predicted.attrs["band"] != fit.predict(row).attrs["band"]


def test_tests_of_one_motion_give_no_band_between_the_outermost_currents_alone(tests: list[Measurement]) -> None:
    one = [replace(test) for test in tests if test.frequency_Hz == 1.0 and test.nominal_current_A != 1.0]
    fit = identify(one, model="bingham", diagnose=False)
    assert fit.tested is not None
    assert (fit.tested.band.left_out, fit.tested.band.source) == (0, "fitted tests")


def test_one_motion_at_three_currents_gives_no_band(tests: list[Measurement]) -> None:
    fit = identify([test for test in tests if test.frequency_Hz == 1.0], model="bingham", diagnose=False)
    assert fit.tested is not None
    assert (fit.tested.band.left_out, fit.tested.band.motions) == (0, 0)


def test_a_motion_validated_at_another_current_is_no_other_motion(tests: list[Measurement]) -> None:
    apart = [test for test in tests if test.nominal_current_A == 1.0]
    kept = [test for test in tests if test.nominal_current_A != 1.0]
    fit = identify(kept, model="bingham", diagnose=False, holdout=apart)
    assert fit.tested is not None
    assert (fit.tested.band.left_out, fit.tested.band.motions) == (10, 4)  # 3 motions at 2 currents, 4 at the third


@pytest.mark.parametrize("wrong", [
    {"half_width_N": [1.0]}, {"half_width_N": [], "current_A": []}, {"half_width_N": [-1.0, 1.0, 1.0]},
    {"current_A": [1.0, 0.0, 2.0]}, {"left_out": -1}, {"left_out": 1e300}, {"motions": 10},
    {"half_width_N": [None, 1.0, 1.0]},
])  # fmt: skip
def test_numbers_that_no_prediction_error_has_are_refused(fit: Fit, tmp_path: Path, wrong: dict[str, object]) -> None:
    written, _ = write_fit(fit, tmp_path)
    content = json.loads(written.read_text())
    content["tested"]["band"].update(wrong)
    written.write_text(json.dumps(content))
    with pytest.raises(FileProblem, match=r"tested\.band"):
        Fit.load(written)


def test_a_band_of_few_motions_says_so_and_counts_agree_with_their_nouns() -> None:
    for counts, words in (((1, 1), "1 test of only 1 motion "), ((6, 2), "6 tests of only 2 motions "),
                          ((9, 3), "9 tests of 3 motions ")):  # fmt: skip
        assert words in Band((0.0,), (1.0,), "", *counts).describe()
