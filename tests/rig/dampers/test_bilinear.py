"""Models of straight pieces: against the pieces as they are published, and what a single current leaves."""

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.identification import Measurement, identify

CURRENT_A = 1.0


def published_biviscous(v: float, rising: bool, post: float, pre: float, fy: float, v0: float) -> float:
    """Wereley, Pang and Park (1998), equation for the nonlinear hysteretic bi-viscous model, piece by piece."""
    v1, v2 = (fy - pre * v0) / (pre - post), (fy + pre * v0) / (pre - post)
    if rising:
        if v <= -v1:
            return post * v - fy
        return pre * (v - v0) if v < v2 else post * v + fy
    if v >= v1:
        return post * v + fy
    return pre * (v + v0) if v > -v2 else post * v - fy


def test_the_play_of_speed_gives_the_published_pieces_on_a_loop() -> None:
    values = {**parameter_set("demo-hysteretic-biviscous").values, "kx": 0.0, "f0": 0.0}
    t = np.arange(0.0, 2.0, 1e-3)
    omega, amplitude = 2.0 * np.pi, 0.03
    u, v = amplitude * np.sin(omega * t), amplitude * omega * np.cos(omega * t)
    a = -amplitude * omega**2 * np.sin(omega * t)
    found = model("hysteretic_biviscous").force(values, u, v, a, CURRENT_A, 1e-3)
    post, fy, vy = 700.0 + 110.0, 60.0 + 240.0, 0.03 + 0.01
    pre = post + fy / vy
    offset = 0.015 * (pre - post) / pre  # so that pre (v - v0) and the line through the play meet
    expected = [published_biviscous(v[k], a[k] > 0.0, post, pre, fy, offset) for k in range(t.size)]
    assert found[500:] == pytest.approx(expected[500:], abs=1e-9 * fy)


@pytest.mark.parametrize(
    ("speed_m_s", "expected_N"),
    [
        (0.04, 300.0 * 0.01 - 150.0 + 5000.0 * 0.04),
        (0.2, 300.0 * 0.01 - 150.0 + 5000.0 * 0.06 + 800.0 * 0.14),
        (-0.05, 300.0 * 0.01 - 150.0 - 3700.0 * 0.05),
        (-0.3, 300.0 * 0.01 - 150.0 - 3700.0 * 0.09 - 650.0 * 0.21),
    ],
)
def test_a_digressive_damper_has_a_knee_in_each_direction(speed_m_s: float, expected_N: float) -> None:
    values = parameter_set("demo-digressive-bilinear").values
    force = model("digressive_bilinear").force(values, [0.01], [speed_m_s], [0.0], CURRENT_A, 1e-3)
    assert force[0] == pytest.approx(expected_N)


def recorded(name: str, current_A: float) -> Measurement:
    """Two cycles of a demonstration, 2 N of noise."""
    t = np.arange(1000) / 500.0
    omega = 2.0 * np.pi
    motion = (0.03 * np.sin(omega * t), 0.03 * omega * np.cos(omega * t), -0.03 * omega**2 * np.sin(omega * t))
    force_N = model(name).force(model(name).demonstration, *motion, current_A, 2e-3)
    force_N += np.random.default_rng(5).normal(0.0, 2.0, 1000)
    return Measurement(
        f"{current_A:g} A", *motion, force_N, np.full(1000, current_A), dt_s=2e-3, samples_per_cycle=500,
        amplitude_m=0.03, frequency_Hz=1.0, nominal_current_A=current_A, noise_N=2.0,
    )  # fmt: skip


def test_both_knees_are_found() -> None:
    tests = [recorded("digressive_bilinear", current_A) for current_A in (0.0, CURRENT_A)]
    fit = identify(tests, model="digressive_bilinear")
    assert fit.error.rmse_N == pytest.approx(2.0, rel=0.06)
    truth = model("digressive_bilinear").demonstration
    for name in ("vk_plus", "vk_minus", "cl_plus", "cl_minus_b", "ch_plus", "ch_minus"):
        assert fit.values[name] == pytest.approx(truth[name], rel=0.03), name


def test_a_knee_beyond_the_tested_speeds_is_not_identified_and_neither_is_which_slope_was_seen() -> None:
    """At most 0.075 m/s: beyond the knee in rebound (0.06 m/s), not in jounce (0.09 m/s)."""
    truth, tests = model("digressive_bilinear").demonstration, []
    for frequency_Hz in (0.2, 0.4):
        for current_A in (0.0, CURRENT_A):
            t, omega = np.arange(round(1000 / frequency_Hz)) / 500.0, 2.0 * np.pi * frequency_Hz
            u, v = 0.03 * np.sin(omega * t), 0.03 * omega * np.cos(omega * t)
            force = model("digressive_bilinear").force(truth, u, v, -(omega**2) * u, current_A, 2e-3)
            tests.append(Measurement(
                f"{current_A:g} A {frequency_Hz:g} Hz", u, v, -(omega**2) * u,
                force + np.random.default_rng(len(tests)).normal(0.0, 1.0, t.size), np.full(t.size, current_A), 2e-3,
                amplitude_m=0.03, frequency_Hz=frequency_Hz, nominal_current_A=current_A,
                samples_per_cycle=round(500 / frequency_Hz), noise_N=1.0,
            ))  # fmt: skip
    fit = identify(tests, model="digressive_bilinear")
    assert fit.adequate
    unknown = {name for name, each in fit.parameters.items() if not each.identifiable}
    assert unknown == {"vk_minus", "cl_minus", "cl_minus_b", "ch_minus", "ch_minus_b"}
    assert "vk_minus is outside the tested speeds" in fit.parameters["ch_minus"].reason
    assert fit.values["vk_plus"] == pytest.approx(truth["vk_plus"], rel=0.02)
    assert fit.values["ch_plus"] == pytest.approx(truth["ch_plus"], rel=0.1)


def test_a_shape_that_needs_another_current_stays_at_zero_with_one() -> None:
    fit = identify([recorded("hysteretic_biviscous", CURRENT_A)], model="hysteretic_biviscous")
    assert fit.parameters["vy_b"].value == 0.0
    assert fit.values["vy"] == pytest.approx(0.04, rel=0.03)
    assert fit.values["ky"] == pytest.approx(300.0, rel=0.03)
