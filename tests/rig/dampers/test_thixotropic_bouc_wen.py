"""A fluid that remembers its speed: its equation, slopes, steady loops, and what tells it from one that does not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from rig.dampers import model
from rig.dampers.kernel import force_series

DAMPER = model("thixotropic_bouc_wen")
DEMO = dict(DAMPER.demonstration)


def sine(amplitude_m: float, frequency_Hz: float, rate_Hz: float, cycles: float) -> tuple[np.ndarray, ...]:
    """Time, extension, velocity and acceleration."""
    t, omega = np.arange(round(cycles / frequency_Hz * rate_Hz)) / rate_Hz, 2.0 * math.pi * frequency_Hz
    u = amplitude_m * np.sin(omega * t)
    return t, u, amplitude_m * omega * np.cos(omega * t), -(omega**2) * u


@pytest.mark.parametrize("current_A", [0.0, 0.8])
def test_the_force_is_that_of_an_independent_integrator(current_A: float) -> None:
    p, omega, amplitude_m = DEMO, 2.0 * math.pi * 1.5, 0.02
    kt = p["kt"] + p["kt_b"] * current_A + p["kt_c"] * current_A**2 + p["kt_d"] * current_A**3
    ku = p["ku"] + p["ku_b"] * current_A

    def rates(t: float, state: np.ndarray) -> list[float]:
        x, w, s = state
        rod, speed = amplitude_m * math.sin(omega * t), amplitude_m * omega * math.cos(omega * t)
        left = 0.1 / (0.1 + s)
        kv = left * p["kv"] + p["kv_b"] * current_A
        ky = left * p["ky"] + p["ky_b"] * current_A + p["ky_c"] * current_A**2
        place = rod - x
        rest = p["k"] * x - (p["kx"] + p["kxx"] * place) * place - (ky + ku * place) * w
        v = brentq(lambda v: kv * v + kt * math.asinh(v / p["vt"]) - rest, -20.0, 20.0, xtol=1e-15)
        return [speed - v, p["rho"] * (v - 0.5 * abs(v) * abs(w) * w - 0.5 * v * w * w), (abs(speed) - s) / 0.1]

    t, _, _, a = sine(amplitude_m, 1.5, 250.0, 1.5)
    atol = [1e-11, 1e-8, 1e-8]
    found = solve_ivp(rates, (0.0, t[-1]), [0.0] * 3, "LSODA", t_eval=t, rtol=1e-7, atol=atol, max_step=5e-3)
    force = p["f0"] + p["k"] * found.y[0] + p["m"] * a
    for rate_Hz in (250.0, 2000.0):
        many, u, v, a = sine(amplitude_m, 1.5, rate_Hz, 1.5)
        ours = DAMPER.force(p, u, v, a, np.full(many.size, current_A), 1.0 / rate_Hz)[:: round(rate_Hz / 250.0)]
        assert np.max(np.abs(ours - force)[5:]) < 3e-3 * np.max(np.abs(force))  # it begins at full speed


def test_one_pass_gives_the_slopes_that_differences_give() -> None:
    t, u, v, a = sine(0.02, 1.5, 250.0, 1.5)
    current = 0.3 + 0.3 * np.sin(3.0 * t)
    one_pass = DAMPER.slopes_along()
    assert one_pass is not None
    for warm in (0, 166):
        motion = (DAMPER.initial_state(), u, v, a, current, 1.0 / 250.0, warm)
        force, slopes = one_pass(DAMPER.vector(DEMO), *motion)
        assert np.allclose(force, force_series(DAMPER, DAMPER.vector(DEMO), *motion), atol=1e-9)
        for place, name in enumerate(DAMPER.names):
            step = 1e-6 * max(abs(DEMO[name]), 1e-2)
            ends = [
                force_series(DAMPER, DAMPER.vector({**DEMO, name: DEMO[name] + way}), *motion) for way in (step, -step)
            ]
            by_difference = (ends[0] - ends[1]) / (2.0 * step)
            assert np.max(np.abs(slopes[:, place] - by_difference)) < 1e-4 * np.max(np.abs(by_difference)), name


@pytest.mark.parametrize(("amplitude_m", "frequency_Hz"), [(0.02, 0.5), (0.005, 5.0), (0.002, 25.0)])
def test_a_warmed_up_loop_is_that_of_a_long_run(amplitude_m: float, frequency_Hz: float) -> None:
    """A cycle of 25 Hz lasts 40 ms, and the memory a tenth of a second: it begins with the cycle's mean speed."""
    rate_Hz = 100.0 * frequency_Hz
    cycle = 100
    long, few = (sine(amplitude_m, frequency_Hz, rate_Hz, cycles) for cycles in (40.0, 2.0))
    run = DAMPER.force(DEMO, *long[1:], 0.0, 1.0 / rate_Hz)
    no_current = np.zeros(few[0].size)
    warm = force_series(
        DAMPER, DAMPER.vector(DEMO), DAMPER.initial_state(), *few[1:], no_current, 1.0 / rate_Hz, cycle
    )
    assert np.max(np.abs(warm[cycle:] - run[-cycle:])) < 0.01 * np.ptp(run[-cycle:])


def test_over_speed_a_slow_long_stroke_is_flat_and_a_short_fast_one_rises_from_less() -> None:
    """Of the same damper at 0 A, seen while the speed falls to the reversal: what the UTFSM tests show."""
    values = {**DEMO, "kv": 1500.0, "ky": 180.0, "kt": 20.0, "kx": 0.0, "kxx": 0.0, "ku": 0.0, "f0": 0.0, "m": 0.0}

    def at(speed_m_s: float, amplitude_m: float, frequency_Hz: float) -> float:
        rate_Hz = 400.0 * frequency_Hz
        _, u, v, a = sine(amplitude_m, frequency_Hz, rate_Hz, 40.0)
        force = DAMPER.force(values, u, v, a, 0.0, 1.0 / rate_Hz)
        falling = np.flatnonzero((v[:-1] > speed_m_s) & (v[1:] <= speed_m_s))[-1]
        return float(force[falling])

    slow = [at(speed, 0.025, 0.5) for speed in (0.02, 0.07)]
    fast = [at(speed, 0.0045, 3.1) for speed in (0.02, 0.07)]
    assert slow[1] - slow[0] < 0.7 * (fast[1] - fast[0])
    assert fast[0] < 0.95 * slow[0]
    assert fast[1] == pytest.approx(slow[1], rel=0.06)


def test_at_high_current_nothing_is_remembered() -> None:
    values = {**DEMO, "ky": 0.0, "kv": 0.0, "kxx": 0.0}
    without = {name: value for name, value in values.items() if name != "kxx"}
    t, u, v, a = sine(0.02, 1.5, 500.0, 1.0)
    with_memory = DAMPER.force(values, u, v, a, np.full(t.size, 1.0), 2e-3)
    assert np.allclose(with_memory, model("sprung_bouc_wen").force(without, u, v, a, np.full(t.size, 1.0), 2e-3))


def test_a_fluid_at_rest_has_forgotten() -> None:
    """After a rest the same stroke meets more force than amid the motion, whose mean of 0.1 m/s halves ky."""
    rate_Hz = 1000.0
    t, u, v, a = sine(0.005, 5.0, rate_Hz, 20.0)
    rest = np.zeros(round(rate_Hz))
    parts = [np.concatenate((motion, rest, motion)) for motion in (u, v, a)]
    force = DAMPER.force({**DEMO, "m": 0.0}, *parts, 0.0, 1.0 / rate_Hz)
    amid, rested = t.size - round(rate_Hz / 5.0), t.size + rest.size
    more_N = force[rested + 5] - force[amid + 5]
    assert 0.35 * DEMO["ky"] < more_N < 0.65 * DEMO["ky"]
