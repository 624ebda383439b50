"""Equation (12) evaluated in compiled batches, against the models' own forces."""

import pickle
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.dampers.catalogue import UnknownName
from rig.errors import IdentificationFailed
from rig.identification import Measurement, Method, Problem, identify
from rig.identification.models.coil import with_lag
from rig.identification.models.measurement import thinned
from rig.identification.models.model_slope import modelled_force

Make = Callable[..., list[Measurement]]


@pytest.mark.parametrize("weight", ["v", "1"])
@pytest.mark.parametrize("name", ["demo", "demo-symmetric", "demo-kwok", "demo-bingham", "cfoa-table4-printed"])
def test_objective_is_the_weighted_sum_of_squares(name: str, weight: str, make_synthetic: Make) -> None:
    chosen = parameter_set(name)
    tests = make_synthetic(dict(parameter_set("demo").values), (0.0, 1.0), (1.0, 2.0))
    problem = Problem(tests, chosen.model, weight, chosen.hysteresis)  # type: ignore[arg-type] - parametrised as text
    damper = model(chosen.model, chosen.hysteresis)
    expected = 0.0
    for test in tests:
        force = damper.force(chosen.values, test.u_m, test.v_m_s, test.a_m_s2, test.current_A, test.dt_s)
        expected += float(np.sum(((test.force_N - force) * (test.v_m_s if weight == "v" else 1.0)) ** 2))
    assert problem.objective(problem.vector(chosen.values)) == pytest.approx(expected, rel=1e-9)


def test_a_batch_is_its_candidates_one_by_one(make_synthetic: Make) -> None:
    problem = Problem(make_synthetic(dict(parameter_set("demo").values), (0.0, 1.0), (1.0,)))
    rng = np.random.default_rng(0)
    population = problem.vector(parameter_set("demo").values) * rng.uniform(0.5, 2.0, (7, problem.n_parameters))
    assert problem.batch(population) == pytest.approx([problem.objective(each) for each in population])


def test_hysteretic_objective_vanishes_at_the_truth(make_synthetic: Make) -> None:
    chosen = parameter_set("demo-normalized-bouc-wen")
    rested = make_synthetic(dict(chosen.values), (1.0,), (1.0,), name=chosen.model, noise_N=0.0, cycles=4)[0]
    arrays = {name: getattr(rested, name)[250:] for name in ("u_m", "v_m_s", "a_m_s2", "force_N", "current_A")}
    settled = Measurement(**{**vars(rested), **arrays})
    problem = Problem([settled], chosen.model, "1")
    whole = problem.objective(problem.vector(chosen.values))
    assert whole < 1e-6 * float(np.sum(settled.force_N**2))
    wrong = {**chosen.values, "rho": 800.0}
    assert problem.objective(problem.vector(wrong)) > 100.0 * whole


def test_samples_without_a_force_do_not_count(make_synthetic: Make) -> None:
    test = make_synthetic(dict(parameter_set("demo").values), (1.0,), (1.0,), noise_N=0.0)[0]
    lost = np.arange(test.u_m.size) % 7 != 0
    broken = Measurement(**{**vars(test), "force_N": np.where(lost, test.force_N, 1e6), "usable": lost})
    problem = Problem([broken])
    assert problem.objective(problem.vector(parameter_set("demo").values)) < 1e-12


def test_eta_is_found_where_the_current_steps(make_synthetic: Make) -> None:
    values = dict(parameter_set("demo").values)
    test = make_synthetic(values, (2.0,), (1.0,), noise_N=0.0)[0]
    t = np.arange(test.u_m.size) * test.dt_s
    current = 2.0 * (1.0 - np.exp(-25.0 * t))
    force = model("asymmetric").force(values, test.u_m, test.v_m_s, test.a_m_s2, current, test.dt_s)
    stepped = Measurement(**{**vars(test), "force_N": force, "current_A": current, "commanded_A": np.full(t.size, 2.0)})
    problem = Problem([stepped], lag=True)
    truth = problem.vector(values)
    assert problem.names[-1] == "eta"
    at_truth = problem.objective(truth)
    slower, faster = truth.copy(), truth.copy()
    slower[-1], faster[-1] = 24.0, 26.0
    assert at_truth < 1e-12
    assert min(problem.objective(slower), problem.objective(faster)) > 1.0


def test_eta_moves_the_objective_of_a_model_with_states_too(make_synthetic: Make) -> None:
    values = dict(parameter_set("spencer-modified").values)
    test = make_synthetic(dict(parameter_set("demo").values), (1.0,), (1.0,), cycles=3)[0]
    commanded = np.where(np.arange(test.u_m.size) < 300, 0.2, 1.0)
    stepped = replace(test, commanded_A=commanded, current_A=commanded)
    damper = model("modified_bouc_wen")
    stepped = replace(stepped, force_N=modelled_force(damper, values, with_lag(stepped, 25.0)))
    problem = Problem([stepped], damper, "1", lag=True)
    found = [problem.objective(problem.vector({**values, "eta": eta})) for eta in (20.0, 25.0, 30.0)]
    assert found[1] < 1e-9 * min(found[0], found[2])
    with pytest.raises(ValueError, match="kwok has no parameter eta; models with eta: asymmetric, symmetric"):
        Problem([test], "kwok", lag=True)


def test_a_candidate_without_a_finite_force_scores_infinity(make_synthetic: Make) -> None:
    problem = Problem(make_synthetic(dict(parameter_set("demo").values), (1.0,), (1.0,)))
    broken = problem.start.copy()
    broken[0] = np.inf
    assert problem.objective(broken) == np.inf


def test_wrong_shapes_and_weights_are_refused(make_synthetic: Make) -> None:
    tests = make_synthetic(dict(parameter_set("demo").values), (1.0,), (1.0,))
    with pytest.raises(ValueError, match="expected \\(N, 12\\)"):
        Problem(tests).batch(np.zeros((3, 5)))
    with pytest.raises(ValueError, match="expected 'v' or '1'"):
        Problem(tests, weight="u")  # type: ignore[arg-type] - a user's typing error
    with pytest.raises(ValueError, match="at least one test"):
        Problem([])
    with pytest.raises(ValueError, match="v_m_s has shape"):
        Measurement(
            id="x",
            u_m=np.zeros(3),
            v_m_s=np.zeros(2),
            a_m_s2=np.zeros(3),
            force_N=np.zeros(3),
            current_A=np.zeros(3),
            dt_s=1.0,
        )


@pytest.mark.parametrize("name", ["u_m", "v_m_s", "a_m_s2", "force_N", "current_A"])
def test_a_sample_that_is_no_number_is_refused_with_its_place(name: str, make_synthetic: Make) -> None:
    test = make_synthetic(dict(parameter_set("demo").values), (1.0,), (1.0,))[0]
    broken = getattr(test, name).copy()
    broken[[7, 9]] = np.nan
    with pytest.raises(ValueError, match=rf"p001: {name}\[7\] = nan \(2 such samples\), expected finite numbers"):
        replace(test, **{name: broken})
    with pytest.raises(ValueError, match="p001: dt_s = 0, expected a positive time"):
        replace(test, dt_s=0.0)
    with pytest.raises(ValueError, match=r"usable has shape \(3,\), expected \(2000,\)"):
        replace(test, usable=np.ones(3, dtype=bool))
    for samples in (-1, 2001, 10**9):
        with pytest.raises(ValueError, match=rf"p001: samples_per_cycle = {samples}, expected 0 .* to 2000"):
            replace(test, samples_per_cycle=samples)
    with pytest.raises(ValueError, match="p001: noise_N = -1, expected 0 or more"):
        replace(test, noise_N=-1.0)


def test_an_eta_without_a_finite_current_scores_infinity(make_synthetic: Make) -> None:
    test = make_synthetic(dict(parameter_set("demo").values), (1.0,), (1.0,), cycles=3)[0]
    stepped = replace(test, commanded_A=np.where(np.arange(test.u_m.size) < 300, 0.0, 1.0))
    problem = Problem([stepped], lag=True)
    wild = problem.start
    wild[-1] = -1e6
    assert problem.objective(wild) == np.inf
    assert np.all(np.isfinite(problem.residuals(wild)))


def test_settings_that_do_not_exist_are_refused_with_those_that_do(make_synthetic: Make) -> None:
    with pytest.raises(IdentificationFailed, match="weight = 'u', expected one of None, '1', 'v'"):
        Method(weight="u")
    with pytest.raises(IdentificationFailed, match="loss = 'hubr', expected one of 'squares', 'huber'"):
        Method(loss="hubr")
    tests = make_synthetic(dict(parameter_set("demo").values), (0.0, 1.0), (1.0, 2.0), cycles=2)
    with pytest.raises(UnknownName, match="unknown hysteresis form 'kwock'; expected kwok or printed"):
        identify(tests, hysteresis="kwock")  # type: ignore[arg-type] - a user's typing error


def test_a_problem_travels_to_worker_processes(make_synthetic: Make) -> None:
    problem = Problem(make_synthetic(dict(parameter_set("demo").values), (1.0,), (1.0,)))
    copy = pickle.loads(pickle.dumps(problem))
    assert copy.objective(problem.start) == problem.objective(problem.start)
    assert problem.bounds.shape == (12, 2)
    assert problem.values(problem.start)["beta"] == 40.0


@pytest.mark.parametrize("lag", [False, True])
@pytest.mark.parametrize("name", ["demo", "demo-kwok", "demo-normalized-bouc-wen", "spencer-modified"])
def test_squared_residuals_sum_to_the_objective(name: str, lag: bool, make_synthetic: Make) -> None:
    chosen = parameter_set(name)
    tests = make_synthetic(dict(parameter_set("demo").values), (0.0, 1.0), (1.0,), cycles=3)
    if lag:
        step = np.where(np.arange(tests[0].u_m.size) < 300, 0.0, 1.0)
        tests[0] = replace(tests[0], commanded_A=step)
    problem = Problem(tests, chosen.model, "v", lag=lag and "eta" in model(chosen.model).names)
    vector = problem.vector(chosen.values)
    residuals = problem.residuals(vector)
    assert residuals.shape == (sum(test.u_m.size for test in tests),)
    assert float(residuals @ residuals) == pytest.approx(problem.objective(vector), rel=1e-9)


def test_the_hybrid_reaches_the_noise_where_its_swarm_alone_does_not(make_synthetic: Make) -> None:
    tests = make_synthetic(dict(parameter_set("demo").values), (0.0, 1.0), (1.0, 2.0), cycles=3)
    alone = identify(tests, method=Method("c_foa", weight="1", budget=4000))
    both = identify(tests, method=Method("hybrid", weight="1", budget=4000))
    assert both.error.rmse_N == pytest.approx(5.0, rel=0.05)
    assert alone.error.rmse_N > 2.0 * both.error.rmse_N
    assert both.evaluations <= 4000


def test_a_model_meets_arrays_of_one_layout_only(make_synthetic: Make) -> None:
    """Numba compiles a model once more for arrays that are not contiguous."""
    (test,) = make_synthetic(dict(parameter_set("demo").values), (1.0,), (1.0,))
    columns = np.column_stack((test.u_m, test.v_m_s, test.a_m_s2, test.current_A)).T
    strided = replace(test, **dict(zip(("u_m", "v_m_s", "a_m_s2", "current_A"), columns, strict=True)))
    for given in (strided, thinned(test, 4), test.moved(*columns[:3])):
        arrays = (given.u_m, given.v_m_s, given.a_m_s2, given.current_A, given.force_N)
        assert all(values.flags.c_contiguous for values in arrays)
