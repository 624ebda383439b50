"""A model with a fitted residual: better where the physics lacks something, the physics alone elsewhere."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rig.dampers
from rig.cli.fit_tables import fit_tables
from rig.dampers.arrays import FloatArray
from rig.dampers.grey_box import UnknownPart
from rig.dampers.grey_regressors import ELEMENTS, residual_force, weight_names
from rig.errors import IdentificationFailed
from rig.fits.fit_record import FitRecord
from rig.identification import Fit, Measurement, identify
from rig.identification.models.model_slope import element_states, modelled_force
from rig.identification.next_test import next_tests
from rig.report.fit import parameters

RATE_Hz = 250.0
TRAVELS_m = np.geomspace(0.1e-3, 6e-3, 6)
SEEN, UNSEEN = ((0.004, 0.5), (0.004, 2.5), (0.012, 1.0), (0.02, 0.5)), ((0.008, 1.0), (0.015, 0.7))


def stops(u_m: FloatArray) -> FloatArray:
    """Mean of elastic-plastic elements of the `TRAVELS_m`."""
    state, out = np.zeros(TRAVELS_m.size), np.empty_like(u_m)
    for k, step in enumerate(np.diff(u_m, prepend=u_m[0])):
        state = np.clip(state + step / TRAVELS_m, -1.0, 1.0)
        out[k] = np.mean(state)
    return out


def campaign(motions: tuple[tuple[float, float], ...], slips: float) -> list[Measurement]:
    """Tests of a viscous damper at two currents; `slips` (N) of friction by Maxwell slips, which no model has."""
    tests, random = [], np.random.default_rng(5)
    for amplitude_m, frequency_Hz in motions:
        for current_A in (0.0, 1.5):
            cycle, rate = round(RATE_Hz / frequency_Hz), 2.0 * np.pi * frequency_Hz
            t = np.arange(-2 * cycle, 2 * cycle) / RATE_Hz
            u, v = amplitude_m * np.sin(rate * t), amplitude_m * rate * np.cos(rate * t)
            friction = (slips * stops(u) if slips else 40.0 * np.tanh(v / 0.01)) * (1.0 + 2.0 * current_A)
            force_N = (600.0 + 80.0 * current_A) * v + friction + random.normal(0.0, 0.5, u.size)
            u, v, force_N = (each[2 * cycle :] for each in (u, v, force_N))
            tests.append(
                Measurement(
                    id=f"p{len(tests):03d}", u_m=u, v_m_s=v, a_m_s2=-(rate**2) * u, force_N=force_N,
                    current_A=np.full(u.size, current_A), dt_s=1.0 / RATE_Hz, amplitude_m=amplitude_m,
                    frequency_Hz=frequency_Hz, nominal_current_A=current_A, noise_N=0.5, samples_per_cycle=cycle,
                )
            )  # fmt: skip
    return tests


def error_N(fit: FitRecord, tests: list[Measurement]) -> float:
    """Mean RMS error on tests."""
    model, values = fit.damper, fit.known_values()
    return float(np.mean([np.std(test.force_N - modelled_force(model, values, test)) for test in tests]))


@pytest.fixture(scope="module")
def slipping() -> Fit:
    return identify(campaign(SEEN, 60.0), model="bingham+grey", diagnose=False)


def test_unseen_motions_are_predicted_with_half_of_the_physical_models_error(slipping: Fit) -> None:
    physical = identify(campaign(SEEN, 60.0), model="bingham", diagnose=False)
    unseen = campaign(UNSEEN, 60.0)
    assert slipping.model.startswith("bingham+grey@slip")
    assert error_N(slipping, unseen) < 0.5 * error_N(physical, unseen)
    assert slipping.values["c0"] == physical.values["c0"]
    ranked = {one.model: one.parameters for one in slipping.selection}
    assert list(ranked) == [slipping.model, "bingham"]
    weights = [one for name, one in slipping.parameters.items() if name.startswith("g_")]
    assert weights
    assert all(not one.identifiable and one.standard_error is None and one.value is not None for one in weights)


def test_people_read_the_weights_in_one_line_and_the_file_has_them_all(slipping: Fit, tmp_path: Path) -> None:
    text = "\n".join([str(slipping), repr(slipping.params), str(fit_tables(slipping)), str(parameters(slipping))])
    weights = [name for name in slipping.values if name.startswith("g_")]
    assert len([name for name in weights if f"{name}'" in text or f"{name} " in text]) <= 1  # the largest is named
    assert str(len(weights)) in text
    saved = json.loads(slipping.save(tmp_path / "fit.json").read_text())
    assert set(weights) <= set(saved["parameters"])


def test_far_outside_the_tested_range_the_force_is_the_physical_models(slipping: Fit) -> None:
    model, values = slipping.damper, slipping.known_values()
    own = {name: values[name] for name in rig.dampers.model("bingham").names}
    t = np.arange(0.0, 1.0, 2e-3)
    for amplitude_m, current_A in ((0.2, 1.0), (0.01, 15.0)):
        u, v = amplitude_m * np.sin(6.0 * t + 1.5), 6.0 * amplitude_m * np.cos(6.0 * t + 1.5)
        inside = (np.abs(u) < 1.3 * 0.02) & (np.abs(v) < 1.3 * 0.07) & (current_A < 2.0)
        motion = (u, v, -36.0 * u, current_A, 2e-3)
        left = model.force(values, *motion) - rig.dampers.model("bingham").force(own, *motion)
        assert np.all(np.abs(left[~inside]) < 1e-9)  # the last bits of a compiled sum
        assert np.sum(~inside) > 100


def test_prediction_simulation_and_inverse_agree_after_the_files_round_trip(slipping: Fit, tmp_path: Path) -> None:
    loaded = rig.load_fit(slipping.save(tmp_path / "fit.json"))
    test = campaign(UNSEEN, 60.0)[1]
    time_s = test.dt_s * np.arange(test.u_m.size)
    simulated = loaded.simulate(time_s, test.u_m, 1.0, velocity_m_s=test.v_m_s)
    predicted = slipping.predict(
        displacement_m=test.u_m, velocity_m_s=test.v_m_s, current_A=1.0, time_s=time_s, acceleration_m_s2=test.a_m_s2
    )
    assert np.allclose(simulated.force_N, predicted.force_N, atol=0.05 * np.std(test.force_N))
    states = [name for name in simulated if name.startswith("state_")]
    assert len(states) == ELEMENTS
    assert np.all(np.abs(simulated[states].to_numpy()) <= 1.0)
    current = loaded.inverse(simulated.force_N.to_numpy(), test.v_m_s, test.u_m, time_s=time_s)
    reached = current.attainable.to_numpy(dtype=bool)
    assert np.mean(reached) > 0.95
    assert np.allclose(current.force_N[reached], simulated.force_N[reached], atol=0.1)
    assert np.mean(np.abs(current.current_A - 1.0) < 0.02) > 0.9  # near reversals two currents give one force


def test_the_compiled_residual_is_the_regression(slipping: Fit) -> None:
    model, values = slipping.damper, slipping.known_values()
    test = campaign(UNSEEN, 60.0)[0]
    z = element_states(values, test)
    parts = model.name.rpartition("@")[2].split(",")
    left = residual_force(parts, values, test.u_m, test.v_m_s, test.current_A, z)
    base = rig.dampers.model("bingham")
    own = modelled_force(base, {name: values[name] for name in base.names}, test)
    assert np.allclose(left + own, modelled_force(model, values, test), atol=1e-9)
    assert float(np.std(left)) > 1.0


def test_random_drives_never_make_energy_and_stay_bounded(slipping: Fit) -> None:
    model, values, random = slipping.damper, slipping.known_values(), np.random.default_rng(3)
    t = np.arange(0.0, 20.0, 4e-3)
    for _ in range(20):
        rates = 2.0 * np.pi * np.arange(1, 13) / 20.0 * random.integers(1, 4)
        size, phase = random.normal(size=12), random.uniform(0.0, 6.3, 12)
        u = np.sin(np.outer(t, rates) + phase) @ size
        scale = random.uniform(0.002, 0.04) / np.max(np.abs(u))
        v = scale * (np.cos(np.outer(t, rates) + phase) @ (size * rates))
        force_N = model.force(values, scale * u, v, np.gradient(v, t), random.uniform(0.0, 1.5), 4e-3)
        assert np.all(np.isfinite(force_N))
        assert np.max(np.abs(force_N)) < 5e3
        assert float(np.sum(force_N * v)) > 0.0


@pytest.mark.parametrize(
    ("tests", "reason"),
    [
        (campaign(((0.004, 1.0),), 60.0)[:2], "residual-too-few"),
        (campaign(SEEN, 0.0), "residual-no-gain"),
    ],
    ids=["two tests", "a plant of the library"],
)
def test_the_physical_model_is_used_where_a_residual_does_not_pay(tests: list[Measurement], reason: str) -> None:
    fit = identify(tests, model="kwok+grey", diagnose=False)
    assert fit.model == "kwok"
    assert reason in {getattr(one, "slug", "") for one in fit.warnings}


def drifting(slips: float) -> list[Measurement]:
    """The tests of a specimen whose force falls by half from its first test to its last."""
    tests = campaign(SEEN, slips)
    fall = np.linspace(1.0, 0.5, len(tests))
    return [replace(test, force_N=share * test.force_N) for test, share in zip(tests, fall, strict=True)]


@pytest.mark.nightly
@pytest.mark.parametrize("slips", [0.0, 60.0], ids=["a plant of the library", "friction by Maxwell slips"])
def test_a_drifting_specimen_is_predicted_as_well_as_by_the_physical_model(slips: float) -> None:
    """Each motion is left out of all choices: base values, parts and ridge."""
    tests, errors = drifting(slips), {"bingham": 0.0, "bingham+grey": 0.0}
    for left_out in range(0, len(tests), 2):
        others, unseen = tests[:left_out] + tests[left_out + 2 :], tests[left_out : left_out + 2]
        for name in errors:
            errors[name] += error_N(identify(others, model=name, diagnose=False), unseen)
    assert errors["bingham+grey"] <= 1.05 * errors["bingham"], errors


def test_the_next_tests_narrow_the_physical_parameters_of_an_adequate_fit(slipping: Fit) -> None:
    adequate = replace(slipping, evaluation=replace(slipping.evaluation, adequate=True))
    names = set(rig.dampers.model("bingham").names)
    proposed = next_tests(slipping.damper, adequate, campaign(SEEN, 60.0))
    assert proposed
    assert {one.parameter for one in proposed} <= names


def test_at_one_current_the_residual_ends_near_it() -> None:
    tests = [test for test in campaign(SEEN, 60.0) if test.nominal_current_A == 1.5]
    fit = identify(tests, model="bingham+grey", diagnose=False)
    model, values = fit.damper, {name: value or 0.0 for name, value in fit.values.items()}
    values |= {name: 0.0 for name in model.names if name not in values}
    base = rig.dampers.model("bingham")
    far = np.array([0.05, -0.05])
    own = base.force_at({name: values[name] for name in base.names}, far, 3.0)
    assert np.allclose(model.force_at(values, far, 3.0), own, rtol=1e-12)


def test_wrong_names_and_combinations_are_refused() -> None:
    with pytest.raises(UnknownPart, match="expected one or more of slip, speed, stroke"):
        rig.dampers.model("bingham+grey@speed,slip")
    with pytest.raises(IdentificationFailed, match="Fix: omit"):
        identify(campaign(SEEN[:1], 0.0), model="bingham+grey", current="per-current-affine")
    names = weight_names(("slip", "stroke"))
    assert len(names) == len(set(names)) == 4 * (2 * ELEMENTS + 5)
