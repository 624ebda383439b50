"""A steady change of the force during a test is reported; noise alone is not."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import parameter_set
from rig.identification import Measurement
from rig.identification.uncertainty.drift import drifting

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)


@pytest.fixture
def tests(make_synthetic: Make) -> list[Measurement]:
    return make_synthetic(DEMO, (0.5, 1.5), (1.0,), cycles=10)


def noise(test: Measurement, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, 5.0, test.u_m.size)


def test_noise_alone_is_no_drift(tests: list[Measurement]) -> None:
    assert not [remark for seed in range(50) for remark in drifting(tests, [noise(test, seed) for test in tests])]


@pytest.mark.parametrize("kind", ["gain", "zero"])
def test_a_steady_change_is_reported_with_its_size(tests: list[Measurement], kind: str) -> None:
    fading = replace(tests[1], id="p002")
    course = np.linspace(-0.5, 0.5, fading.u_m.size)
    drift = 0.02 * course * (fading.force_N if kind == "gain" else fading.peak_force_N)
    (remark,) = drifting([tests[0], fading], [noise(tests[0], 1), noise(fading, 2) + drift])
    assert remark.slug == "drifting-tests"
    assert remark.numbers["worst"] == "p002"
    assert remark.numbers["percent"] == pytest.approx(2.0 * 9 / 10, rel=0.15)


def test_a_drift_that_does_not_matter_is_not_reported(tests: list[Measurement]) -> None:
    course = np.linspace(-0.5, 0.5, tests[1].u_m.size)
    assert not drifting(tests, [0.0 * tests[0].u_m, 1e-3 * course * tests[1].force_N + 0.01 * noise(tests[1], 1)])
