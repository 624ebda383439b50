"""Models with internal states: fitted to the noise, truth inside the intervals, told apart from each other."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import MODELS, model, parameter_set
from rig.identification import Measurement, identify
from rig.identification.models.model_slope import modelled_force

NOISE_N = 5.0
CURRENTS_A = (0.0, 0.7, 1.3, 2.0)
FREQUENCIES_HZ = (0.5, 2.0)


def recorded(set_name: str, seed: int = 3) -> list[Measurement]:
    """Two settled cycles of each test, white noise on the force."""
    rng = np.random.default_rng(seed)
    chosen = parameter_set(set_name)
    tests = []
    for current in CURRENTS_A:
        for frequency in FREQUENCIES_HZ:
            t = np.arange(round(2 / frequency * 250)) / 250.0
            omega = 2.0 * np.pi * frequency
            each = Measurement(
                id=f"{current:g} A, {frequency:g} Hz",
                u_m=0.05 * np.sin(omega * t),
                v_m_s=0.05 * omega * np.cos(omega * t),
                a_m_s2=-0.05 * omega**2 * np.sin(omega * t),
                force_N=np.zeros_like(t),
                current_A=np.full_like(t, current),
                dt_s=0.004,
                amplitude_m=0.05,
                frequency_Hz=frequency,
                nominal_current_A=current,
                samples_per_cycle=round(250 / frequency),
                noise_N=NOISE_N,
            )
            each.force_N[:] = modelled_force(model(chosen.model), chosen.values, each) + rng.normal(0, NOISE_N, t.size)
            tests.append(each)
    return tests


SPRUNG = "demo-sprung-bouc-wen"


def moved(
    current_A: float,
    amplitude_m: float,
    frequency_Hz: float,
    rng: np.random.Generator,
    named: str = SPRUNG,
    values: Mapping[str, float] | None = None,
) -> Measurement:
    """Two settled cycles of a damper behind a spring, a demonstration's or `values`, 250 samples each, 3 N of noise."""
    chosen, omega = parameter_set(named), 2.0 * np.pi * frequency_Hz
    t = np.arange(500) / (250.0 * frequency_Hz)
    test = Measurement(
        id=f"{current_A:g} A, {amplitude_m:g} m, {frequency_Hz:g} Hz",
        u_m=amplitude_m * np.sin(omega * t),
        v_m_s=amplitude_m * omega * np.cos(omega * t),
        a_m_s2=-amplitude_m * omega**2 * np.sin(omega * t),
        force_N=rng.normal(0.0, 3.0, t.size),
        current_A=np.full_like(t, current_A),
        dt_s=1.0 / (250.0 * frequency_Hz),
        amplitude_m=amplitude_m,
        frequency_Hz=frequency_Hz,
        nominal_current_A=current_A,
        samples_per_cycle=250,
        noise_N=3.0,
    )
    test.force_N[:] += modelled_force(model(chosen.model), chosen.values if values is None else values, test)
    return test


@pytest.mark.few(2)
@pytest.mark.parametrize("named", [SPRUNG, "demo-thixotropic-bouc-wen"], ids=["sprung", "thixotropic"])
@pytest.mark.parametrize(
    ("currents_A", "motions"),
    [
        ((1.0,), ((0.005, 3.0), (0.02, 0.5), (0.02, 2.0))),
        ((0.0,), ((0.005, 3.0), (0.02, 0.5), (0.02, 2.0))),
        ((0.0, 1.0), ((0.02, 1.0),)),
        ((0.0, 0.5, 1.0, 2.0), ((0.002, 20.0), (0.005, 10.0), (0.001, 30.0))),
        ((0.0, 0.5, 1.0, 2.0), ((0.02, 0.01), (0.01, 0.02))),
    ],
    ids=["one current", "no current", "one motion", "fast", "slow"],
)
def test_a_damper_behind_a_spring_is_found_from_few_or_unusual_tests(
    currents_A: tuple[float, ...], motions: tuple[tuple[float, float], ...], named: str
) -> None:
    rng, plant = np.random.default_rng(8), parameter_set(named)
    tests = [moved(amps, *motion, rng, named) for motion in motions for amps in currents_A]
    fit = identify(tests, model=plant.model)
    assert fit.error.rmse_N == pytest.approx(3.0, rel=0.08)
    assert fit.adequate
    spring = fit.parameters["k"]
    assert spring.identifiable
    assert spring.value == pytest.approx(plant.values["k"], rel=0.1)


DRAWN = {
    "kx": 328.0, "kv": 204.0, "kv_b": 46.7, "f0": -200.0, "ky": 85.5, "ky_b": 157.0, "ky_c": 11.1, "ku": -145.0,
    "ku_b": 75.7, "kt": 11.6, "kt_b": 18.6, "kt_c": 8.84, "kt_d": -2.47, "rho": 1230.0, "vt": 0.00199, "k": 1.19e6,
    "m": 3.58,
}  # fmt: skip


@pytest.mark.parametrize("more", [{}, {"kxx": 5570.0}], ids=["sprung", "thixotropic"])
def test_a_damper_behind_a_spring_is_found_from_three_currents(more: dict[str, float]) -> None:
    """Three do not tell cubic terms: the fit that the search starts from has some, and must do without them too.

    And the fluid's memory drives kv of the model without it far below 0, where it does nothing.
    """
    named = "demo-thixotropic-bouc-wen" if more else SPRUNG
    rng, values = np.random.default_rng(8), DRAWN | more
    motions = ((0.025, 0.5), (0.025, 1.0), (0.02, 2.0), (0.01, 3.0))
    exact = [moved(amps, *motion, rng, named, values) for motion in motions for amps in (0.0, 1.0, 2.0)]
    tests = [replace(test, current_A=test.current_A + rng.normal(0.0, 0.002, test.u_m.size)) for test in exact]
    fit = identify(tests, model=parameter_set(named).model, diagnose=False)
    assert fit.error.rmse_N == pytest.approx(3.0, rel=0.08)
    assert fit.adequate
    assert fit.values["k"] == pytest.approx(values["k"], rel=0.03)
    assert fit.values["kv"] == pytest.approx(values["kv"], rel=0.2)


def test_a_damper_with_a_memory_is_picked_among_those_without_one() -> None:
    """Its search begins five times as far off as another model ends, which says nothing of where it ends itself."""
    rng, named = np.random.default_rng(8), "demo-thixotropic-bouc-wen"
    motions = ((0.007, 0.5), (0.007, 5.0), (0.021, 0.5), (0.021, 2.5))
    tests = [moved(amps, *motion, rng, named) for motion in motions for amps in (0.0, 0.5, 1.0, 2.0)]
    fit = identify(tests, model="few")
    assert fit.model == "thixotropic_bouc_wen"
    assert fit.adequate
    assert fit.error.rmse_N == pytest.approx(3.0, rel=0.05)


def test_mass_and_stiffness_of_a_sprung_damper_are_not_distinguished_at_one_frequency() -> None:
    rng = np.random.default_rng(8)
    fit = identify([moved(amps, 0.02, 1.0, rng) for amps in (0.0, 0.5, 1.0)], model="sprung_bouc_wen")
    assert not fit.parameters["m"].identifiable
    assert "one frequency" in fit.parameters["m"].reason
    assert fit.values["m"] == 0.0
    assert not fit.parameters["kx"].identifiable


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "set_name",
    [
        "demo-modified-bouc-wen", "demo-viscoelastic-plastic", "demo-thinning-bouc-wen", "demo-bouc-wen",
        "demo-lost-motion", "demo-dahl", "demo-hysteretic-biviscous", "demo-asymmetric-bouc-wen",
        "demo-generalized-bouc-wen", "demo-lugre", "demo-sprung-bouc-wen", "demo-thixotropic-bouc-wen",
    ],
)  # fmt: skip
def test_a_model_with_states_is_found_to_the_noise_with_its_truth_inside_the_intervals(set_name: str) -> None:
    chosen = parameter_set(set_name)
    fit = identify(recorded(set_name), model=chosen.model)
    assert fit.adequate
    assert fit.error.rmse_N == pytest.approx(NOISE_N, rel=0.06)
    known = {name: fit.parameters[name] for name in fit.identifiable}
    assert {"n", "c0", "rho", "vy"} & set(known)
    for name, each in known.items():
        assert each.simultaneous_low <= chosen.values[name] <= each.simultaneous_high, name  # type: ignore[operator]  # identifiable


def test_a_dashpot_quicker_than_the_samples_is_found() -> None:
    """Its state follows at 1,800 1/s, seven times the sampling; a search that may not go so far ends at that edge."""
    truth = {
        "alpha_a": 2e4, "alpha_b": 6.3e4, "c0a": 880.0, "c0b": 80.0, "c1a": 1e4, "c1b": 2300.0, "k0": 955.0,
        "k1": 540.0, "x0": 0.11, "gamma": 3.9e6, "beta": 4.5e6, "A": 120.0, "n": 1.45, "eta": 25.0,
    }  # fmt: skip
    rng, motions = np.random.default_rng(12), ((0.006, 1.0), (0.006, 5.0), (0.02, 1.0), (0.02, 2.5))
    damper, tests = model("modified_bouc_wen"), []
    for amplitude_m, frequency_Hz in motions:
        for current_A in (0.0, 0.5, 1.0, 2.0):
            cycle, omega = round(250.0 / frequency_Hz), 2.0 * np.pi * frequency_Hz
            t = np.arange(-cycle * 8, 3 * cycle * 8) / 2000.0
            u, v = amplitude_m * np.sin(omega * t), amplitude_m * omega * np.cos(omega * t)
            force = damper.force(truth, u, v, -(omega**2) * u, np.full(t.size, current_A), 5e-4)
            u, v, force = (each[cycle * 8 :: 8] for each in (u, v, force))
            tests.append(Measurement(
                f"{len(tests)}", u, v, -(omega**2) * u, force + rng.normal(0.0, 2.0, u.size),
                np.full(u.size, current_A), 4e-3, amplitude_m=amplitude_m, frequency_Hz=frequency_Hz,
                nominal_current_A=current_A, samples_per_cycle=cycle, noise_N=2.0,
            ))  # fmt: skip
    fit = identify(tests, model="modified_bouc_wen")
    assert fit.adequate
    for name in ("c0a", "c1a", "k0", "n"):
        each = fit.parameters[name]
        assert each.simultaneous_low <= truth[name] <= each.simultaneous_high, name  # type: ignore[operator]  # identifiable
    assert fit.values["c1a"] == pytest.approx(truth["c1a"], rel=0.15)


def test_the_bouc_wen_family_says_for_which_scale_its_values_are() -> None:
    fit = identify(recorded("demo-modified-bouc-wen"), model="modified_bouc_wen")
    assert "for A = 100" in fit.parameters["alpha_a"].reason
    assert fit.parameters["A"].value == 100.0


@pytest.mark.nightly
def test_all_models_compared_recommend_the_plant_with_a_roll_off_at_small_speeds() -> None:
    tests = recorded("demo-modified-bouc-wen")
    held_out = [test for test in tests if test.nominal_current_A == 1.3]
    reported: list[str] = []
    fit = identify(
        [test for test in tests if test.nominal_current_A != 1.3],
        model="all",
        holdout=held_out,
        on_progress=reported.append,
    )
    assert fit.model == "modified_bouc_wen"
    assert fit.adequate
    assert reported[0] == f"fitting asymmetric (1 of {len(MODELS)})"
    errors = {score.model: score.holdout_nrmse_percent_of_peak for score in fit.selection}
    assert errors["bingham"] > 2.0 * errors["modified_bouc_wen"]  # type: ignore[operator]  # tests were held out


@pytest.mark.parametrize("currents", [1, 2, 3])
def test_powers_of_the_current_that_the_tests_cannot_determine_are_left_out(
    currents: int, make_synthetic: Callable[..., list[Measurement]]
) -> None:
    tests = make_synthetic(
        parameter_set("demo").values, currents_A=CURRENTS_A[:currents], frequencies_Hz=(1.0,), cycles=2
    )
    fit = identify(tests, model="thinning_bouc_wen")
    powers = ("kt", "kt_b", "kt_c", "kt_d")
    for name in powers[currents:]:
        assert fit.parameters[name].value == 0.0
        assert "current" in fit.parameters[name].reason


@pytest.mark.parametrize("set_name", ["demo-modified-bouc-wen", "demo-viscoelastic-plastic"])
def test_at_one_current_the_terms_per_ampere_are_zero_and_the_rest_is_found(set_name: str) -> None:
    chosen = parameter_set(set_name)
    fit = identify([test for test in recorded(set_name) if test.nominal_current_A == 0.7], model=chosen.model)
    assert fit.error.rmse_N == pytest.approx(NOISE_N, rel=0.1)
    per_ampere = {name for name in chosen.values if name in {"alpha_b", "c0b", "c1b", "fc_b", "c0_b"}}
    assert {fit.parameters[name].value for name in per_ampere} == {0.0}
    together = {"c0a": 877.0, "c0": 777.0}
    for name in together.keys() & fit.parameters.keys():
        assert fit.values[name] == pytest.approx(together[name], rel=0.02)
