"""Energy of each test and of the model, signs, and models that could drive the rod."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.errors import IdentificationFailed
from rig.identification import Measurement, identify
from rig.identification.points.consistency import without_reversed_signs
from rig.identification.uncertainty.scoring import cycle_energy_J, passivity

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)


def test_a_viscous_force_dissipates_pi_c_omega_amplitude_squared(make_synthetic: Make) -> None:
    test = make_synthetic(DEMO, (0.0,), (2.0,))[0]
    # A period of 37.76 samples: the end of the last cycle is between two samples, where the power is greatest.
    time_s = np.arange(113) * 0.008
    omega = 2.0 * np.pi / (37.76 * 0.008)
    odd = Measurement(**{**{name: getattr(test, name) for name in ("id", "file", "waveform", "amplitude_m")},
                         "u_m": 0.05 * np.sin(omega * time_s), "v_m_s": 0.05 * omega * np.cos(omega * time_s),
                         "a_m_s2": -0.05 * omega**2 * np.sin(omega * time_s), "force_N": np.zeros(113),
                         "current_A": np.zeros(113), "dt_s": 0.008, "frequency_Hz": omega / (2.0 * np.pi),
                         "nominal_current_A": 0.0, "samples_per_cycle": 38})
    for one, omega_1_s, share in ((test, 4.0 * np.pi, 1e-3), (odd, omega, 5e-4)):
        force_N = 700.0 * one.v_m_s + 300.0 * one.u_m - 270.0
        assert cycle_energy_J(one, force_N) == pytest.approx(np.pi * 700.0 * omega_1_s * 0.05**2, rel=share)


def test_measured_and_modelled_energy_stand_beside_each_other(make_synthetic: Make) -> None:
    fit = identify(make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0)))
    assert fit.passivity is not None
    assert fit.passivity.share == 1.0
    for test in fit.to_json()["error"]["per_test"]:
        assert test["modelled_energy_J"] == pytest.approx(test["energy_J"], rel=0.01)
        assert test["residual"]["noise_N"] == pytest.approx(5.0, rel=0.1)


def test_a_model_that_drives_the_rod_is_named_with_where(make_synthetic: Make) -> None:
    pushed = {**DEMO, "Cb_minus": -900.0}
    tests = make_synthetic(pushed, (0.0, 1.0, 2.0), (1.0, 2.0))
    found = passivity(model("asymmetric"), pushed, tests)
    assert 0.5 < found.share < 1.0
    fit = identify(tests)
    assert any("not passive" in text and "at -0.6" in text and "2 A" in text for text in fit.warnings)


@pytest.mark.parametrize("name", ["demo-bingham", "demo-modified-bouc-wen", "demo-viscoelastic-plastic"])
def test_the_demonstration_dampers_are_passive_whatever_their_gas_force(name: str, make_synthetic: Make) -> None:
    chosen = parameter_set(name)
    tests = make_synthetic(DEMO, (0.0, 2.0), (1.0,))
    assert passivity(model(chosen.model), chosen.values, tests).share == 1.0


def test_reversed_signs_are_refused_one_among_others_is_left_out_and_a_spring_is_neither(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0))
    turned = [replace(test, force_N=-test.force_N) for test in tests]
    with pytest.raises(IdentificationFailed, match="and 1 more: the measured force acts with the motion"):
        identify(turned)
    fit = identify([*tests[:3], turned[3]])
    assert any(text.startswith("p004 not used: the measured force acts with the motion") for text in fit.warnings)
    assert [entry.id for entry in fit.error.per_test] == ["p001", "p002", "p003"]
    rng = np.random.default_rng(1)
    springs = [replace(t, force_N=900.0 * t.u_m + rng.normal(0.0, 5.0, t.u_m.size)) for t in tests]
    assert without_reversed_signs(springs) == (springs, [])


def test_a_model_that_misses_the_energy_says_for_which_tests(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 2.0), (0.5, 2.0))
    warnings = identify(tests, model="bingham").warnings
    assert any("model's energy per cycle differs" in text for text in warnings) or all(
        abs(each.modelled_energy_J / each.energy_J - 1.0) < 0.05
        for each in identify(tests, model="bingham").error.per_test
    )
