"""`--model all` on every model's plant picks that model or an equivalent; plants of no model are said not to fit."""

from collections.abc import Callable

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.identification import Measurement, identify
from rig.identification.models.model_slope import modelled_force

Force = Callable[[Measurement], np.ndarray]

CURRENTS_A = (0.0, 0.6, 1.2, 2.0)
MOTIONS = ((0.05, 0.5), (0.05, 2.0), (0.02, 1.0))
HELD_OUT = (0.02, 1.0)
EQUIVALENT = {
    "bouc_wen": {"normalized_bouc_wen"},
    "kwok": {"symmetric"},
    "normalized_bouc_wen": {"bouc_wen"},
}


def plant(set_name: str) -> Force:
    chosen = parameter_set(set_name)
    return lambda test: modelled_force(model(chosen.model), chosen.values, test)


def recorded(force: Force, noise_N: float, seed: int) -> tuple[list[Measurement], list[Measurement]]:
    """Three settled cycles of each test at 250 Hz, to fit and held out."""
    rng = np.random.default_rng(seed)
    kept: list[Measurement] = []
    held_out: list[Measurement] = []
    for current in CURRENTS_A:
        for amplitude, frequency in MOTIONS:
            t = np.arange(round(3 / frequency * 250)) / 250.0 + 0.0013
            omega = 2.0 * np.pi * frequency
            each = Measurement(
                id=f"{current:g} A, {amplitude:g} m, {frequency:g} Hz",
                u_m=amplitude * np.sin(omega * t),
                v_m_s=amplitude * omega * np.cos(omega * t),
                a_m_s2=-amplitude * omega**2 * np.sin(omega * t),
                force_N=np.zeros_like(t),
                current_A=np.full_like(t, current),
                dt_s=0.004,
                amplitude_m=amplitude,
                frequency_Hz=frequency,
                nominal_current_A=current,
                samples_per_cycle=round(250 / frequency),
                noise_N=noise_N,
            )
            each.force_N[:] = force(each) + rng.normal(0.0, noise_N, t.size)
            (held_out if (amplitude, frequency) == HELD_OUT else kept).append(each)
    return kept, held_out


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("set_name", "noise_N"),
    [
        ("demo", 5.0),
        ("demo-symmetric", 2.0),
        ("demo-kwok", 20.0),
        ("demo-bingham", 5.0),
        ("demo-viscoelastic-plastic", 5.0),
        ("demo-bouc-wen", 5.0),
        ("demo-normalized-bouc-wen", 20.0),
        ("demo-modified-bouc-wen", 2.0),
        ("demo-thinning-bouc-wen", 5.0),
        ("demo-lost-motion", 5.0),
        ("demo-dahl", 5.0),
        ("demo-hysteretic-biviscous", 5.0),
        ("demo-digressive-bilinear", 5.0),
        ("demo-asymmetric-bouc-wen", 5.0),
        ("demo-lugre", 5.0),
        ("demo-generalized-bouc-wen", 5.0),
        ("demo-sprung-bouc-wen", 5.0),
        ("demo-thixotropic-bouc-wen", 5.0),
    ],
)
def test_the_plants_own_model_is_picked_and_covers_its_truth(set_name: str, noise_N: float) -> None:
    chosen = parameter_set(set_name)
    kept, held_out = recorded(plant(set_name), noise_N, seed=len(set_name))
    fit = identify(kept, model="all", holdout=held_out)
    assert fit.model in {chosen.model} | EQUIVALENT.get(chosen.model, set())
    assert fit.adequate
    own = fit if fit.model == chosen.model else identify(kept, model=chosen.model)
    for name in own.identifiable:
        each = own.parameters[name]
        assert each.simultaneous_low <= chosen.values[name] <= each.simultaneous_high, name  # type: ignore[operator]  # identifiable


def _with_seal(test: Measurement) -> np.ndarray:
    return plant("demo")(test) + 40.0 * np.tanh(test.v_m_s / 0.002)


def _warming(test: Measurement) -> np.ndarray:
    """Every test at a force 0 to 4 % lower than the last parameters say, as a damper that warms up."""
    return plant("demo")(test) * (1.0 - 0.02 * test.nominal_current_A * (test.frequency_Hz > 1.0))


def _with_gap(test: Measurement) -> np.ndarray:
    """A mounting that slips: no hysteretic force within 4 mm after each reversal."""
    travelled = test.amplitude_m - np.sign(test.v_m_s) * -test.u_m
    return plant("demo-normalized-bouc-wen")(test) * np.clip(travelled / 0.004, 0.0, 1.0)


def _with_stop(test: Measurement) -> np.ndarray:
    """Rubber before the ends of the stroke, which no model here has."""
    beyond = np.maximum(np.abs(test.u_m) - 0.04, 0.0)
    return plant("demo-normalized-bouc-wen")(test) + 4e3 * np.sign(test.u_m) * beyond


@pytest.mark.few(1)
@pytest.mark.parametrize(("law", "noise_N"), [(_with_seal, 5.0), (_with_stop, 5.0), (_with_gap, 20.0), (_warming, 5.0)])
def test_a_plant_of_no_model_is_reported_not_to_fit(law: Force, noise_N: float) -> None:
    kept, held_out = recorded(law, noise_N, seed=7)
    fit = identify(kept, model="all", holdout=held_out)
    assert not fit.adequate
    assert any("scatter" in text for text in fit.warnings)


def test_a_model_that_describes_the_tests_comes_before_one_that_foretells_others_better() -> None:
    """Constant speeds, the slowest left out, tell no bend of the plant's own model; another one is 35 times off."""
    truth = {
        "m": 3.68, "F0": -238.5, "beta": 65.1, "delta": 1.15, "Fya": 5.2, "Fyb": 321.7, "Ca_plus": 1047.0,
        "Ca_minus": 633.9, "Cb_plus": 38.75, "Cb_minus": 180.0, "Ka": 314.3, "Kb": 45.9, "eta": 24.4,
    }  # fmt: skip
    rng, tests = np.random.default_rng(7), []
    for amplitude, frequency in ((0.006, 1.0), (0.006, 2.5), (0.02, 1.0), (0.02, 2.5)):
        for current in (0.0, 0.5, 1.0, 2.0):
            phase = (np.arange(round(750 / frequency)) / 250.0 * frequency + 0.25) % 1.0
            speed = 4.0 * amplitude * frequency
            rising = phase < 0.5
            each = Measurement(
                id=f"{amplitude:g} m, {frequency:g} Hz, {current:g} A",
                u_m=amplitude * np.where(rising, 4.0 * phase - 1.0, 3.0 - 4.0 * phase),
                v_m_s=np.where(rising, speed, -speed), a_m_s2=np.zeros_like(phase), force_N=np.zeros_like(phase),
                current_A=np.full_like(phase, current), dt_s=0.004, waveform="triangle", amplitude_m=amplitude,
                frequency_Hz=frequency, nominal_current_A=current, samples_per_cycle=round(250 / frequency),
                noise_N=2.0,
            )  # fmt: skip
            each.force_N[:] = modelled_force(model("asymmetric"), truth, each) + rng.normal(0.0, 2.0, phase.size)
            tests.append(each)
    fit = identify(tests, model="all")
    assert fit.model == "asymmetric"
    assert fit.adequate
    assert fit.selection[0].rmse_N < 2.2
    assert any(text.startswith("asymmetric is ranked first because it fits all tests") for text in fit.warnings)
