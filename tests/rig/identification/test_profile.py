"""Profile likelihoods against direct minimisation, and against the linear intervals where those are exact."""

import json
from collections.abc import Callable, Mapping

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.dampers.algebraic import AlgebraicSeparation, AsymmetricModel
from rig.errors import IdentificationFailed
from rig.identification import Fit, Measurement, Method, identify
from rig.identification.models.model_slope import FittedModel
from rig.identification.models.projection import Projection
from rig.identification.uncertainty.covariance import information
from rig.identification.uncertainty.profile import profiles

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)


@pytest.fixture(scope="module")
def weak(make_synthetic: Make) -> tuple[list[Measurement], Fit]:
    """A test so slow and noisy that the intervals of beta and delta are far from symmetric."""
    tests = make_synthetic(DEMO, (0.0, 0.05), (0.5,), cycles=4, noise_N=20.0)
    return tests, identify(tests, profile=["beta", "delta", "F0"])


def test_the_deviance_is_that_of_the_best_fit_with_the_parameter_held(weak: tuple[list[Measurement], Fit]) -> None:
    tests, fit = weak
    weighting = Method().weighting(model("asymmetric"))
    projection = Projection(AlgebraicSeparation(model("asymmetric")), tests, weighting, without=frozenset({"m"}))  # type: ignore[arg-type] - algebraic
    found = fit.profiles["beta"]

    def least(beta: float) -> float:
        return min(projection.objective(np.array([beta, delta])) for delta in np.linspace(-1.0, 8.0, 450))

    rise = np.array([least(beta) for beta in found.values]) - fit.objective
    assert rise / rise[-1] == pytest.approx(np.array(found.deviance) / found.deviance[-1], abs=0.01)


def test_intervals_far_from_symmetric_differ_from_the_linear_ones_and_end_at_the_threshold(
    weak: tuple[list[Measurement], Fit],
) -> None:
    fit = weak[1]
    found, linear = fit.profiles["beta"], fit.parameters["beta"]
    assert found.low is not None
    assert found.high is not None
    assert found.high - fit.values["beta"] > 2.0 * (fit.values["beta"] - found.low)
    assert found.high > linear.high  # type: ignore[operator] - identifiable
    assert np.interp(found.high, found.values, found.deviance) == pytest.approx(3.84, abs=0.05)
    assert list(found.values) == sorted(found.values)


@pytest.mark.parametrize("name", ["F0", "Fyb", "m"])
def test_where_the_data_are_plenty_both_intervals_agree(name: str, make_synthetic: Make) -> None:
    fit = identify(make_synthetic(DEMO, (0.0, 1.0, 2.0), (1.0, 2.0)), profile=[name])
    found, linear = fit.profiles[name], fit.parameters[name]
    assert (found.low, found.high) == pytest.approx((linear.low, linear.high), rel=1e-3)


def test_models_with_internal_states_have_profiles_too(make_synthetic: Make) -> None:
    true = dict(parameter_set("demo-normalized-bouc-wen").values)
    tests = make_synthetic(true, (0.0, 1.0), (1.0,), name="normalized_bouc_wen", cycles=3)
    fit = identify(tests, model="normalized_bouc_wen", profile=True)
    assert set(fit.profiles) == {"rho", "sigma", "n"}
    for name, found in fit.profiles.items():
        assert found.low < fit.values[name] < found.high, name  # type: ignore[operator] - both ends are found here
    assert fit.to_json()["profiles"]["n"]["low"] == fit.profiles["n"].low


def test_a_parameter_without_any_effect_has_an_open_profile(make_synthetic: Make) -> None:
    tests = make_synthetic({**DEMO, "beta": 1e6, "delta": 0.0})
    found = identify(tests, profile=["beta"]).profiles["beta"]
    assert found.high is None


def test_what_was_not_fitted_has_no_profile(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (1.0,), (1.0, 2.0))
    with pytest.raises(IdentificationFailed, match="'Fyb': this parameter was not fitted; fitted parameters: m, F0"):
        identify(tests, profile=["Fyb"])
    with pytest.raises(IdentificationFailed, match="expected least squares"):
        identify(tests, method=Method(loss="huber"), profile=True)
    with pytest.raises(IdentificationFailed, match="c_foa stopped before the least-squares solution"):
        identify(tests, method=Method("c_foa", weight="1", budget=500), profile=True)


def test_a_parameter_at_its_bound_stays_there_while_others_are_profiled(make_synthetic: Make) -> None:
    tests = make_synthetic({**DEMO, "m": -2.0}, (0.0, 1.0), (1.0, 2.0))
    fit = identify(tests, profile=["beta", "m"])
    assert fit.values["m"] == 0.0
    deviance = np.array(fit.profiles["beta"].deviance)
    assert np.count_nonzero(deviance == 0.0) == 1
    assert fit.profiles["m"].low == 0.0
    assert min(fit.profiles["m"].values) == 0.0


@pytest.fixture(scope="module")
def redundant(make_synthetic: Make) -> tuple[list[Measurement], Fit]:
    """A Bouc-Wen damper, whose A only scales alpha, beta and gamma."""
    true = dict(parameter_set("demo-bouc-wen").values)
    tests = make_synthetic(true, (0.0, 1.0), (1.0,), name="bouc_wen", cycles=3)
    return tests, identify(tests, model="bouc_wen", profile=True)


def test_a_profile_does_not_depend_on_how_redundant_the_parameters_beside_it_are(
    redundant: tuple[list[Measurement], Fit],
) -> None:
    tests, fit = redundant
    same = identify(tests, model="normalized_bouc_wen", profile=["n"])
    found, expected = fit.profiles["n"], same.profiles["n"]
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), rel=0.01)
    json.dumps(fit.to_json(), allow_nan=False)


def test_redundant_parameters_have_no_profile_and_do_not_count_as_fitted(
    redundant: tuple[list[Measurement], Fit],
) -> None:
    tests, fit = redundant
    assert set(fit.profiles) == {"x0", "n"}
    assert fit.selection[0].parameters == 9  # of the ten, A is a choice
    assert fit.values["A"] == 1.0
    with pytest.raises(IdentificationFailed, match="'gamma': this parameter is identified only for the chosen A"):
        identify(tests, model="bouc_wen", profile=["gamma"])


def test_a_side_on_which_the_force_is_not_finite_is_open(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0), cycles=2)
    fit = identify(tests)
    weighting = Method().weighting(model("asymmetric"))
    names = [name for name in fit.values if name != "eta"]

    class Ending(AsymmetricModel):
        """A damper whose force is not finite beyond a preload."""

        def force(self, parameters: Mapping[str, float], *motion: np.ndarray) -> np.ndarray:
            force = super().force(parameters, *motion)  # type: ignore[arg-type] - the last one is the interval
            return np.where(parameters["F0"] > fit.values["F0"] + 0.05, np.inf, force)

    known = information(FittedModel(Ending(), fit.values, tuple(names)), tests, weighting)
    found = profiles(FittedModel(Ending(), fit.values, known.names), known, tests, weighting, ["F0"])["F0"]
    assert found.high is None
    assert found.low is not None
    assert np.all(np.isfinite(found.deviance))
