"""The papers' algorithms look where they are told to: in the model's ranges, in a wide box, anywhere."""

from __future__ import annotations

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.errors import IdentificationFailed
from rig.identification import Measurement, Method, identify
from rig.identification.models.problem import unmirrored


def demo_tests() -> list[Measurement]:
    """Four tests of the demonstration damper by its equation, with 5 N of noise."""
    random, damper, tests = np.random.default_rng(1), model("asymmetric"), []
    for current_A in (0.5, 1.5):
        for frequency_Hz in (1.0, 2.0):
            angle = 2.0 * np.pi * frequency_Hz * (np.arange(round(3 * 200 / frequency_Hz)) / 200.0 + 0.0011)
            rate = 2.0 * np.pi * frequency_Hz
            u, v, a = 0.03 * np.sin(angle), 0.03 * rate * np.cos(angle), -0.03 * rate**2 * np.sin(angle)
            force_N = damper.force(dict(parameter_set("demo").values), u, v, a, current_A, 0.005)
            tests.append(
                Measurement(
                    id=f"p{len(tests)}", u_m=u, v_m_s=v, a_m_s2=a, force_N=force_N + random.normal(0.0, 5.0, u.size),
                    current_A=np.full(u.size, current_A), dt_s=0.005, amplitude_m=0.03, frequency_Hz=frequency_Hz,
                    nominal_current_A=current_A, noise_N=5.0, samples_per_cycle=round(200 / frequency_Hz),
                )
            )  # fmt: skip
    return tests


@pytest.mark.parametrize("bounds", ["wide", "none"])
def test_in_the_papers_unknown_range_a_swarm_starts_from_nothing_known(bounds: str) -> None:
    tests = demo_tests()
    fit = identify(tests, method=Method("pso", budget=3000, bounds=bounds))
    known = identify(tests, method=Method("pso", budget=3000))
    assert fit.evaluations == known.evaluations == 3000
    assert fit.objective > 3.0 * known.objective  # it knows less
    searched = [value for name, value in fit.values.items() if name != "eta"]
    assert fit.values["beta"] >= 0.0
    if bounds == "wide":
        assert max(map(abs, searched)) <= 1e4
        low, high = model("asymmetric").parameter("Ca_plus").low, model("asymmetric").parameter("Ca_plus").high
        assert (low, high) != (-1e4, 1e4)


def test_a_method_without_a_search_has_no_bounds() -> None:
    with pytest.raises(IdentificationFailed, match="does not use a search range"):
        Method("separable", bounds="wide")
    with pytest.raises(IdentificationFailed, match="bounds = 'huge'"):
        Method("pso", bounds="huge")


@pytest.mark.parametrize("name", ["demo", "demo-kwok", "demo-symmetric"])
def test_a_mirror_image_has_the_same_force_and_a_positive_beta(name: str) -> None:
    chosen = parameter_set(name)
    damper, values = model(chosen.model), dict(chosen.values)
    turned = {key: -value if key in {"beta", "delta", "Fya", "Fyb", "alpha", "alpha_b"} else value
              for key, value in values.items()}  # fmt: skip
    t = np.linspace(0.01, 1.0, 50)
    motion = (0.02 * np.sin(6.0 * t), 0.12 * np.cos(6.0 * t), -0.72 * np.sin(6.0 * t))
    forces = [damper.force(each, *motion, 1.0, 0.02) for each in (values, turned)]
    assert np.allclose(*forces)
    assert unmirrored(turned) == values
