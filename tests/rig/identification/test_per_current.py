"""One fit a current, and its parameters' relations to the current."""

from collections.abc import Callable

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.errors import IdentificationFailed
from rig.identification import Measurement, identify

Make = Callable[..., list[Measurement]]
KWOK = dict(parameter_set("demo-kwok").values)
CURRENTS_A = (0.0, 0.5, 1.0, 1.5, 2.0)


def saturating(make: Make, seed: int = 4) -> list[Measurement]:
    """Tests of a damper whose yield force is 60 + 300 I - 60 I^2 (N), which no affine model has."""
    tests = []
    for number, current in enumerate(CURRENTS_A):
        values = {**KWOK, "alpha": KWOK["alpha"] + 300.0 * current - 60.0 * current**2, "alpha_b": 0.0}
        tests += make(values, (current,), (0.5, 2.0), name="kwok", cycles=3, seed=seed + number)
    return tests


def split(tests: list[Measurement], left_out_A: float) -> tuple[list[Measurement], list[Measurement]]:
    kept = [test for test in tests if test.nominal_current_A != left_out_A]
    return kept, [test for test in tests if test.nominal_current_A == left_out_A]


@pytest.mark.parametrize("dependence", ["per-current-polynomial", "per-current-lagrange"])
def test_a_curved_dependence_foretells_a_current_it_has_not_seen(make_synthetic: Make, dependence: str) -> None:
    kept, unseen = split(saturating(make_synthetic), 1.5)
    fit = identify(kept, model="kwok", current=dependence, holdout=unseen)
    assert fit.adequate
    assert fit.holdout is not None
    assert fit.holdout.rmse_N == pytest.approx(5.0, rel=0.05)
    assert fit.current is not None
    assert fit.current.relations["alpha"].at(1.5) == pytest.approx(375.0, abs=2.0)
    at_one = fit.parameters["alpha at 1 A"]
    assert at_one.simultaneous_low < 300.0 < at_one.simultaneous_high  # type: ignore[operator]  # identifiable
    assert fit.to_json()["current"]["dependence"] == dependence


@pytest.mark.parametrize("dependence", ["affine", "per-current-affine"])
def test_an_affine_dependence_says_that_it_misses_a_curved_one(make_synthetic: Make, dependence: str) -> None:
    kept, unseen = split(saturating(make_synthetic), 1.5)
    fit = identify(kept, model="kwok", current=dependence, holdout=unseen)
    assert not fit.adequate
    assert fit.holdout is not None
    assert fit.holdout.rmse_N > 9.0


def test_shape_parameters_stay_inside_the_range_of_the_fitted_ones(make_synthetic: Make) -> None:
    fit = identify(saturating(make_synthetic), model="kwok", current="per-current-lagrange")
    assert fit.current is not None
    low, high = fit.current.ranges["beta"]

    for current in np.linspace(-1.0, 3.0, 9):
        assert low <= fit.current.values_at(model("kwok"), float(current))["beta"] <= high


def test_one_current_all_models_and_currents_that_change_are_refused(make_synthetic: Make) -> None:
    tests = saturating(make_synthetic)
    with pytest.raises(IdentificationFailed, match=r"two or more currents, but all tests ran at 0.5 A"):
        identify(split(tests, 0.5)[1], model="kwok", current="per-current-affine")
    with pytest.raises(IdentificationFailed, match="cannot be combined with several models"):
        identify(tests, model="all", current="per-current-affine")
    with pytest.raises(IdentificationFailed, match="expected one of affine, per-current-affine"):
        identify(tests, model="kwok", current="cubic")
    tests[0].current_A[: tests[0].current_A.size // 2] = 0.4
    with pytest.raises(IdentificationFailed, match=r"p001: its current changes from 0\.00 to 0\.40 A"):
        identify(tests, model="kwok", current="per-current-affine")
