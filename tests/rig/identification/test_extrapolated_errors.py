"""Unseen tests that lie beyond the data of their fit are told as what they are, and rank no models unsaid."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.cli.fit_tables import fit_tables
from rig.dampers import model, parameter_set
from rig.document.terminal import lines
from rig.fits.entries import ModelScore
from rig.identification import Fit, Measurement, identify
from rig.identification.models.solving import Method
from rig.identification.selection import candidates_of, compare, doubts_of

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)
SEPARABLE = Method("separable")


def shown(fit: Fit) -> str:
    """What the terminal shows, in one line."""
    return " ".join(" ".join(text.split()) for text, _ in lines(fit_tables(fit), 240))


def scores_of(names: list[str], tests: list[Measurement]) -> tuple[ModelScore, ...]:
    candidates, _, _ = candidates_of([model(name) for name in names], tests, SEPARABLE, None)
    return compare(candidates, tests, [], SEPARABLE)[0]


def moved(test: Measurement, amplitude_m: float, frequency_Hz: float) -> Measurement:
    """A test with another motion; its force is the demo damper's there."""
    t, omega = np.arange(test.u_m.size) * test.dt_s, 2.0 * np.pi * frequency_Hz
    u, v, a = (amplitude_m * factor * part for factor, part in (
        (1.0, np.sin(omega * t)), (omega, np.cos(omega * t)), (-(omega**2), np.sin(omega * t)),
    ))  # fmt: skip
    force = model("asymmetric").force(DEMO, u, v, a, test.current_A, test.dt_s)
    return replace(
        test, id=f"{amplitude_m:g}", u_m=u, v_m_s=v, a_m_s2=a, force_N=force, amplitude_m=amplitude_m,
        frequency_Hz=frequency_Hz, samples_per_cycle=round(1.0 / frequency_Hz / test.dt_s),
    )  # fmt: skip


def test_each_test_left_out_says_in_what_it_lies_beyond_the_others(make_synthetic: Make) -> None:
    names = ["bingham", "symmetric"]
    by_current = make_synthetic(DEMO, (0.0, 1.0), (1.0,), cycles=2)
    assert scores_of(names, by_current)[0].beyond == {"p001": ("current_A",), "p002": ("current_A",)}
    by_speed = make_synthetic(DEMO, (1.0,), (0.5, 2.0), cycles=2)
    assert scores_of(names, by_speed)[0].beyond == {"p002": ("velocity_m_s",)}
    (one,) = make_synthetic(DEMO, (1.0,), (0.5,), cycles=4)
    by_stroke = [moved(one, 0.01, 1.0), moved(one, 0.02, 0.5)]
    assert scores_of(names, by_stroke)[0].beyond == {"0.02": ("displacement_m",)}
    cold = replace(moved(one, 0.02, 0.5), temperature_degC=np.full(one.u_m.size, 20.0))
    warm = replace(cold, id="warm", temperature_degC=np.full(one.u_m.size, 24.0))
    candidates, _, _ = candidates_of([model("bingham")], [cold], SEPARABLE, None)
    assert compare(candidates, [cold], [warm], SEPARABLE)[0][0].beyond == {"warm": ("temperature_degC",)}


def test_the_plants_own_model_is_first_though_it_extrapolates_worse(make_synthetic: Make) -> None:
    """Two slow motions tell no inertia, so the plant's own model misses the fast one more than a simpler one does."""
    tests = make_synthetic(DEMO, (0.0, 2.0), (0.1, 0.2, 4.0), cycles=2, noise_N=20.0)
    scores = scores_of(["bingham", "kwok", "symmetric", "asymmetric"], tests)
    assert scores[0].model == "asymmetric"
    assert scores[0].beyond == {"p003": ("velocity_m_s",), "p006": ("velocity_m_s",)}
    by_name = {score.model: score for score in scores}
    errors = {name: score.holdout_nrmse_percent_of_peak or 0.0 for name, score in by_name.items()}
    assert errors["kwok"] < errors["asymmetric"]
    within = {name: score.within_nrmse_percent_of_peak or 0.0 for name, score in by_name.items()}
    assert within["asymmetric"] == min(within.values())


@pytest.fixture(scope="module")
def two_currents(make_synthetic: Make) -> Fit:
    """Two tests that differ in their current: nothing lies between them."""
    return identify(make_synthetic(DEMO, (0.0, 1.0), (1.0,), cycles=3), model="few", diagnose=False)


def test_where_nothing_lies_within_the_ranking_is_by_information_and_says_so(two_currents: Fit) -> None:
    fit = two_currents
    assert [score.within_nrmse_percent_of_peak for score in fit.selection] == [None] * len(fit.selection)
    assert [score.bic for score in fit.selection] == sorted(score.bic for score in fit.selection)
    assert [getattr(text, "slug", "") for text in fit.warnings].count("ranked-unseen-by-none") == 1
    text = shown(fit)
    assert "Validation error (extrapolated) %" in text
    assert "outside the fitted data (extrapolated): p001 (current); p002 (current)" in text
    regression = next(one for one in fit.references if one.name == "regression")
    assert regression.within_nrmse_percent_of_peak is None


def test_the_band_is_not_widened_by_errors_of_extrapolation(two_currents: Fit) -> None:
    assert two_currents.tested is not None
    assert two_currents.tested.band.source == "fitted tests"
    assert max(two_currents.tested.band.half_width_N) < 60.0  # 5 N of noise, on forces of 700 N
    predicted = two_currents.predict({"displacement_m": 0.0, "velocity_m_s": 0.05, "current_A": 1.0})
    assert not two_currents.tested.band.of_predictions
    assert predicted[["low_N", "high_N"]].isna().all(axis=None)


def test_the_ranking_survives_the_file(two_currents: Fit, tmp_path: Path) -> None:
    written = tmp_path / "fit.json"
    written.write_text(json.dumps(two_currents.to_json()))
    again = Fit.load(written)
    assert again.selection == two_currents.selection
    assert again.references == two_currents.references


def test_a_held_out_test_says_in_what_it_lies_beyond_the_fitted_ones(make_synthetic: Make, tmp_path: Path) -> None:
    tests = make_synthetic(DEMO, (0.0, 0.5, 1.0, 2.0), (0.5, 1.0, 2.0), cycles=3)
    held_out = [test for test in tests if (test.nominal_current_A, test.frequency_Hz) in {(0.5, 1.0), (2.0, 2.0)}]
    fit = identify([test for test in tests if test not in held_out and test.nominal_current_A < 2.0], holdout=held_out)
    assert fit.holdout is not None
    inside, outside = fit.holdout.per_test
    assert (inside.beyond, outside.beyond) == ((), ("current_A",))
    assert fit.holdout.within_nrmse_percent_of_peak == inside.nrmse_percent_of_peak
    assert fit.tests_to_pandas()["beyond"].to_dict() == {
        **{test.id: "" for test in fit.error.per_test}, inside.id: "", outside.id: "current_A",
    }  # fmt: skip
    entry = fit.to_json()["error"]
    assert [test.get("beyond") for test in entry["holdout"]["per_test"]] == [[], ["current_A"]]
    assert all("beyond" not in test for test in entry["per_test"])
    assert "% without the 1 of 2 tests outside the fitted data" in shown(fit)
    written = tmp_path / "fit.json"
    written.write_text(json.dumps(fit.to_json()))
    assert Fit.load(written).holdout == fit.holdout
    alone = identify([test for test in tests if test.nominal_current_A < 2.0], holdout=[tests[-1]])
    assert alone.holdout is not None
    assert alone.holdout.within_nrmse_percent_of_peak is None
    assert "all outside the fitted data (extrapolated)" in shown(alone)
    assert fit.tested is not None
    assert alone.tested is not None
    both = "cross-validation and validation tests"
    assert (fit.tested.band.source, alone.tested.band.source) == (both, "cross-validation")
    assert max(fit.tested.band.half_width_N) < 15.0  # 5 N of noise


def test_a_current_between_too_few_for_the_model_is_beyond_too(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0, 2.0), (0.5, 1.0), cycles=3)
    held_out = [test for test in tests if test.nominal_current_A == 1.0]
    fit = identify([test for test in tests if test.nominal_current_A != 1.0], model="lost_motion", holdout=held_out)
    assert fit.holdout is not None
    assert [test.beyond for test in fit.holdout.per_test] == [("current_A",), ("current_A",)]


def test_each_pair_forereported_says_where_it_lay_beyond_the_others(make_synthetic: Make, tmp_path: Path) -> None:
    fit = identify(make_synthetic(DEMO, (0.0, 1.0, 2.0), (0.5, 1.0, 2.0), cycles=3), unseen="pairs")
    assert fit.unseen is not None
    beyond = {test.frequency_Hz: test.beyond for test in fit.unseen.per_test}
    assert beyond == {0.5: (), 1.0: (), 2.0: ("velocity_m_s",)}
    within = [test.nrmse_percent_of_peak for test in fit.unseen.per_test if test.frequency_Hz < 2.0]
    assert fit.unseen.within_nrmse_percent_of_peak == pytest.approx(np.mean(within))
    assert "without the 3 of 9 tests outside the fitted data" in shown(fit)
    written = tmp_path / "fit.json"
    written.write_text(json.dumps(fit.to_json()))
    assert Fit.load(written).unseen == fit.unseen


def score(name: str, error: float, within: float | None) -> ModelScore:
    beyond = {"p009": ("velocity_m_s", "current_A")}
    return ModelScore(name, error, 1.0, 1.0, 9, "separable", within_nrmse_percent_of_peak=within, beyond=beyond)


def test_held_out_tests_beyond_the_data_decide_as_requested_and_it_is_reported(make_synthetic: Make) -> None:
    held_out = make_synthetic(DEMO, (1.0,), (1.0,), cycles=2)
    (only,) = doubts_of([score("kwok", 20.0, None), score("bingham", 30.0, None)], held_out)
    assert (only.slug, only.numbers["quantities"]) == ("ranked-beyond", "velocity, current")
    (other,) = doubts_of([score("kwok", 20.0, 8.0), score("bingham", 30.0, 4.0)], held_out)
    assert other.slug == "ranked-by-those-beyond"
    assert "but bingham is first by those inside the range: 4 % of force amplitude, compared with 8 % for kwok" in other
    assert doubts_of([score("kwok", 20.0, 4.0), score("bingham", 30.0, 8.0)], held_out) == []
