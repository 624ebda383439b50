"""What is named of a misfit, and what not: currents near 0, of both signs, what a model lacks over speed, the rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rig.dampers import parameter_set
from rig.identification import Measurement, identify

DEMO = parameter_set("demo").values
CURRENTS_A, FREQUENCIES_Hz = (0.0, 1.0, 2.0), (0.5, 1.0, 2.0)
Make = Callable[..., list[Measurement]]


def made(make: Make, currents_A: tuple[float, ...] = CURRENTS_A) -> list[Measurement]:
    tests = make(DEMO, currents_A=currents_A, frequencies_Hz=FREQUENCIES_Hz, cycles=2, noise_N=3.0)
    return [replace(test, noise_N=3.0) for test in tests]


def slugs(tests: list[Measurement], **given: object) -> list[str]:
    return [cause.slug for cause in identify(tests, **given).diagnosis]  # type: ignore[arg-type]  # options by name


def test_what_is_measured_without_current_is_not_taken_for_milliamperes(make_synthetic: Make) -> None:
    """An amplifier's zero and noise: 0.05 mA on the mean of a test, as it was commanded or imported."""
    random = np.random.default_rng(1)
    zeros_A = random.normal(0.0, 5e-5, len(FREQUENCIES_Hz)).tolist()
    tests = [
        replace(test, current_A=test.current_A + zero_A, nominal_current_A=zero_A, current_std_A=5e-5)
        for test, zero_A in zip(made(make_synthetic, (0.0,)), zeros_A, strict=True)
    ]
    assert slugs(tests) == []


def test_several_currents_that_no_coil_takes_are_still_named(make_synthetic: Make) -> None:
    tests = [
        replace(test, current_A=1e-3 * test.current_A, nominal_current_A=1e-3 * test.nominal_current_A)
        for test in made(make_synthetic)
    ]
    assert slugs(tests) == ["units-current"]


def test_a_force_that_follows_the_size_of_the_current_is_reported_so(make_synthetic: Make) -> None:
    tests = made(make_synthetic, (1.0, 0.5, 0.0, 1.5, 2.0))
    signed = [
        replace(test, current_A=-test.current_A, nominal_current_A=-test.nominal_current_A)
        if test.nominal_current_A in {0.5, 2.0} else test
        for test in tests
    ]  # fmt: skip
    named = identify(signed).diagnosis
    assert named[0].slug == "current-sign"
    assert named[0].explains > 0.95
    assert "as positive values" in named[0].next


def test_what_a_model_does_not_have_over_speed_is_not_called_two_dampers(make_synthetic: Make) -> None:
    """The force of an orifice grows with the square of the speed; the fastest tests lie apart from the others."""
    tests = [
        replace(test, force_N=test.force_N + 4000.0 * test.v_m_s * np.abs(test.v_m_s)) for test in made(make_synthetic)
    ]
    named = slugs(tests, diagnose=True)
    assert named[0] == "speed-shape"
    assert "mixed-specimens" not in named


def test_a_misfit_that_nothing_explains_is_described(make_synthetic: Make) -> None:
    """A rod with a thread of 5 mm, which no cause is about."""
    tests = [
        replace(test, force_N=test.force_N + 40.0 * np.sin(2.0 * np.pi * test.u_m / 5e-3))
        for test in made(make_synthetic)
    ]
    fit = identify(tests)
    assert fit.adequate is False
    assert [cause.slug for cause in fit.diagnosis] == ["unexplained"]
    assert fit.diagnosis[0].explains == 0.0
    assert any(test.id in fit.diagnosis[0].text for test in tests)
    assert fit.diagnosis[0].next
