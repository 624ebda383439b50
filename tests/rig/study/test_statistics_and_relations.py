"""BV, MV, SD, Kruskal-Wallis and the relations to current, against hand computation and SciPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import lagrange as scipy_lagrange

from rig.fits.relation import lagrange, relations
from rig.study.outputs import written
from rig.study.settings import kruskal_wallis, summarise


def test_a_summary_is_best_mean_and_sample_deviation() -> None:
    summary = summarise([2.0, 4.0, 9.0])
    assert (summary.best, summary.mean, summary.median, summary.repeats) == (2.0, 5.0, 4.0, 3)
    assert summary.deviation == pytest.approx(math.sqrt((9.0 + 1.0 + 16.0) / 2.0))


def test_one_repeat_has_no_deviation_and_none_is_refused() -> None:
    assert math.isnan(summarise([3.0]).deviation)
    with pytest.raises(ValueError, match="no repeats"):
        summarise([])


def test_kruskal_wallis_ranks_over_all_values_together() -> None:
    test = kruskal_wallis({"a": [1.0, 2.0, 3.0], "b": [4.0, 5.0, 6.0]})
    assert test is not None
    assert test.mean_ranks == {"a": 2.0, "b": 5.0}
    # H = 12 / (N (N + 1)) sum(R^2 / n) - 3 (N + 1) with R = 6, 15
    assert test.statistic == pytest.approx(12.0 / 42.0 * (36.0 + 225.0) / 3.0 - 21.0)
    assert test.p == pytest.approx(math.erfc(math.sqrt(test.statistic / 2.0)))


@pytest.mark.parametrize(
    "groups", [{"a": [1.0, 2.0]}, {"a": [1.0], "b": [2.0, 3.0]}, {"a": [1.0, 1.0], "b": [1.0, 1.0]}]
)
def test_kruskal_wallis_says_so_when_it_cannot_be_done(groups: dict[str, list[float]]) -> None:
    assert kruskal_wallis(groups) is None


def test_lagrange_passes_through_every_point_as_scipys_does() -> None:
    currents, values = np.array([0.0, 0.4, 0.8, 1.2]), np.array([500.0, 900.0, 1100.0, 1150.0])
    reference = scipy_lagrange(currents, values).coefficients[::-1]
    assert np.allclose(lagrange(currents, values), reference, rtol=1e-9)


def test_an_affine_parameter_is_found_by_every_relation_with_no_error_left_out() -> None:
    currents = np.array([0.0, 0.5, 1.0, 2.0])
    for relation in relations(currents, 20.0 + 60.0 * currents, degree=2):
        assert relation.coefficients[:2] == pytest.approx((20.0, 60.0))
        assert relation.at(1.5) == pytest.approx(110.0)
        assert relation.rms == pytest.approx(0.0, abs=1e-10)
        assert relation.rms_left_out == pytest.approx(0.0, abs=1e-9)


def test_noise_makes_lagrange_look_perfect_and_predict_worst() -> None:
    rng = np.random.default_rng(1)
    currents = np.linspace(0.0, 2.0, 7)
    affine, _, exact = relations(currents, 20.0 + 60.0 * currents + rng.normal(0.0, 5.0, 7), degree=2)
    assert exact.rms < 1e-6 < affine.rms
    assert exact.rms_left_out > 3.0 * affine.rms_left_out


def test_a_relation_needs_different_currents() -> None:
    with pytest.raises(ValueError, match="at least two different currents"):
        relations(np.array([1.0, 1.0]), np.array([2.0, 3.0]))


@pytest.mark.parametrize(
    ("cell", "text"),
    [(3.4e7, "3.40e+07"), (0.0, "0"), (math.nan, ""), (None, ""), (12, "12"), (0.05, "0.05"), ("a", "a")],
)
def test_numbers_are_written_with_the_papers_digits(cell: object, text: str) -> None:
    assert written(cell) == text  # type: ignore[arg-type]  # parametrised over every kind of cell
