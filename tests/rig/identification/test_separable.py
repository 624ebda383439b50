"""Separable identification: the optimum from no start, whatever the truth."""

from collections.abc import Callable

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.identification import Measurement, Method, identify
from rig.identification.models.measurement import spanning
from rig.identification.models.projection import Weighting
from rig.identification.models.separable import solve_separable
from rig.identification.models.solving import solve
from rig.identification.models.undetermined import Undetermined

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)


def objective_at(
    values: dict[str, float], tests: list[Measurement], weight: str, name: str = "asymmetric", form: str = "kwok"
) -> float:
    total = 0.0
    for test in tests:
        force = model(name, form).force(values, test.u_m, test.v_m_s, test.a_m_s2, test.current_A, test.dt_s)
        total += float(np.sum(((test.force_N - force) * (test.v_m_s if weight == "v" else 1.0)) ** 2))
    return total


@pytest.mark.parametrize("seed", range(12))
def test_random_truths_are_found_without_a_start(seed: int, make_synthetic: Make) -> None:
    rng = np.random.default_rng(seed)
    truth = {name: value * 4.0 ** rng.uniform(-1.0, 1.0) for name, value in DEMO.items()}
    tests = make_synthetic(truth, seed=seed)
    found = solve_separable(tests, model("asymmetric"), Weighting("v"))
    assert found.objective <= objective_at(truth, tests, "v")
    assert found.values["beta"] == pytest.approx(truth["beta"], rel=0.1)
    assert found.objective == pytest.approx(objective_at({**found.values, "eta": 1.0}, tests, "v"), rel=1e-6)


def test_noise_free_parameters_come_back_exactly(make_synthetic: Make) -> None:
    found = solve_separable(make_synthetic(DEMO, noise_N=0.0), model("asymmetric"))
    for name, value in found.values.items():
        assert value == pytest.approx(DEMO[name], rel=1e-6)


def test_printed_form_finds_its_own_width(make_synthetic: Make) -> None:
    truth = {name: value for name, value in DEMO.items() if name != "delta"} | {"lambda": 0.02}
    found = solve_separable(make_synthetic(truth, form="printed"), model("asymmetric", "printed"))
    assert found.values["lambda"] == pytest.approx(0.02, rel=0.02)


@pytest.mark.parametrize(("name", "free"), [("symmetric", "Ca"), ("kwok", "c"), ("bingham", "c0")])
def test_the_smaller_models_separate_too(name: str, free: str, make_synthetic: Make) -> None:
    chosen = parameter_set(f"demo-{name}")
    found = solve_separable(make_synthetic(dict(chosen.values), name=name), model(name))
    assert found.values[free] == pytest.approx(chosen.values[free], rel=0.01)


def test_a_mass_below_zero_is_held_at_zero(make_synthetic: Make) -> None:
    tests = make_synthetic({**DEMO, "m": -2.0})
    found = solve_separable(tests, model("asymmetric"))
    assert found.at_bound == ("m",)
    assert found.values["m"] == 0.0


def test_huber_loss_ignores_spikes(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0, 2.0), (0.5, 1.0, 2.0))
    rng = np.random.default_rng(4)
    spiked = [
        Measurement(**{**vars(test), "force_N": test.force_N + 400.0 * (rng.uniform(size=test.u_m.size) < 0.02)})
        for test in tests
    ]
    plain = solve(model("asymmetric"), spiked, Method(), Undetermined())
    robust = solve(model("asymmetric"), spiked, Method(loss="huber"), Undetermined())
    assert abs(plain.values["F0"] - DEMO["F0"]) > 5.0
    assert abs(robust.values["F0"] - DEMO["F0"]) < 0.5


def test_pieces_give_the_same_answer_as_the_whole(make_synthetic: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (0.5, 1.0))
    whole = solve_separable(tests, model("bingham"))
    monkeypatch.setattr("rig.identification.models.projection.PIECE", 257)
    monkeypatch.setattr("rig.identification.models.projection.KEEP_BELOW", 0)
    pieces = solve_separable(tests, model("bingham"))
    assert pieces.values == pytest.approx(whole.values, rel=1e-6)


def test_a_published_algorithm_runs_by_name_and_does_no_better(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0))
    best = identify(tests, method=Method(weight="v"))
    search = identify(tests, method=Method("de", budget=2000))
    assert search.method == "de"
    assert search.weight == "v"
    assert search.evaluations <= 2000
    assert search.objective >= best.objective


@pytest.mark.parametrize("name", ["de", "hybrid"])
def test_a_published_algorithm_does_not_search_what_one_test_cannot_determine(name: str, make_synthetic: Make) -> None:
    fit = identify(make_synthetic(DEMO, (1.0,), (1.0,)), method=Method(name, weight="1", budget=3000))
    undetermined = {"m", "Fyb", "Cb_plus", "Cb_minus", "Kb"}
    assert {key: fit.values[key] for key in undetermined} == dict.fromkeys(undetermined, 0.0)
    assert all("its value is set to 0" in fit.parameters[key].reason for key in undetermined)
    assert fit.values["Fya"] != 0.0
    assert name != "hybrid" or fit.error.rmse_N == pytest.approx(5.0, rel=0.05)


def test_a_published_algorithm_leaves_the_scale_of_bouc_wen_as_it_is(make_synthetic: Make) -> None:
    true = dict(parameter_set("demo-bouc-wen").values)
    tests = make_synthetic(true, (0.0, 1.0), (1.0,), name="bouc_wen", cycles=3)
    assert identify(tests, model="bouc_wen", method=Method("de", budget=300)).values["A"] == 1.0


def test_a_search_among_misfits_ends_in_the_minimum(make_synthetic: Make) -> None:
    """Bouc-Wen on tests of another damper: n ends at its limit, and no further search finds less."""
    chosen, tests = model("normalized_bouc_wen"), make_synthetic(DEMO)
    found = solve(chosen, tests, Method(), Undetermined())
    again = solve(chosen, tests, Method(), Undetermined(), found.values)
    assert again.objective == pytest.approx(found.objective, rel=1e-7)
    assert again.evaluations < 12
    assert found.at_limit == {"n": pytest.approx(1.001)}


def test_starts_are_compared_on_tests_that_span_all(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO)
    assert spanning(tests, len(tests)) == tests
    few = spanning(tests, 4)
    assert [test for test in tests if test in few] == few
    for quantity in (lambda test: np.max(test.v_m_s), lambda test: np.mean(test.current_A)):
        assert max(map(quantity, few)) == max(map(quantity, tests))
    assert min(np.mean(test.current_A) for test in few) == min(np.mean(test.current_A) for test in tests)
