"""The model behind a spring: its equation, slopes, limits, energy, and the current that it needs for a force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from rig.dampers import model
from rig.dampers.separation import MotionScale
from rig.dampers.trajectory import amplified, inverse_of, rates_N_s
from rig.identification import Measurement
from rig.identification.uncertainty.scoring import passivity

AMPLITUDE_m, OMEGA = 0.01, 2.0 * math.pi * 1.5
DAMPER = model("sprung_bouc_wen")
DEMO = dict(DAMPER.demonstration)


def motion(rate_Hz: float, cycles: float = 1.0) -> tuple[np.ndarray, ...]:
    """Time, extension, velocity and acceleration of a sine."""
    t = np.arange(round(cycles * 2.0 * math.pi / OMEGA * rate_Hz)) / rate_Hz
    u = AMPLITUDE_m * np.sin(OMEGA * t)
    return t, u, AMPLITUDE_m * OMEGA * np.cos(OMEGA * t), -(OMEGA**2) * u


def written_out(p: dict[str, float], current: float) -> tuple[float, float, float]:
    """Damping, yield force and logarithmic force at a current, from the equation in words."""
    kv = max(p["kv"] + p["kv_b"] * current, 0.0)
    ky = p["ky"] + p["ky_b"] * current + p["ky_c"] * current**2
    kt = max(p["kt"] + p["kt_b"] * current + p["kt_c"] * current**2 + p["kt_d"] * current**3, 0.0)
    return kv, ky, kt


def by_an_independent_integrator(p: dict[str, float], current: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and force of one cycle from rest: the piston's speed by bisection, both states by an implicit method."""
    kv, ky, kt = written_out(p, current)
    ku = p["ku"] + p["ku_b"] * current

    def rates(t: float, state: np.ndarray) -> list[float]:
        x, w = state
        place = AMPLITUDE_m * math.sin(OMEGA * t) - x
        rest = p["k"] * x - p["kx"] * place - (ky + ku * place) * w
        v = brentq(lambda v: kv * v + kt * math.asinh(v / p["vt"]) - rest, -20.0, 20.0, xtol=1e-15)
        loop = p["rho"] * (v - 0.5 * abs(v) * abs(w) * w - 0.5 * v * w * w)
        return [AMPLITUDE_m * OMEGA * math.cos(OMEGA * t) - v, loop]

    t, _, _, a = motion(250.0)
    found = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], "LSODA", t_eval=t, rtol=1e-7, atol=[1e-11, 1e-8], max_step=5e-3)
    return t, p["f0"] + p["k"] * found.y[0] + p["m"] * a


def test_the_force_is_that_of_an_independent_integrator() -> None:
    _, force = by_an_independent_integrator(DEMO, 0.8)
    for rate_Hz in (250.0, 2000.0):
        t, u, v, a = motion(rate_Hz)
        ours = DAMPER.force(DEMO, u, v, a, np.full(t.size, 0.8), 1.0 / rate_Hz)[:: round(rate_Hz / 250.0)]
        assert np.max(np.abs(ours - force)) < 4e-3 * np.max(np.abs(force))


def test_one_pass_gives_the_slopes_that_differences_give() -> None:
    t, u, v, a = motion(250.0, cycles=1.5)
    current = 0.6 + 0.4 * np.sin(3.0 * t)
    one_pass = DAMPER.slopes_along()
    assert one_pass is not None
    arguments = (DAMPER.initial_state(), u, v, a, current, 1.0 / 250.0, 0)
    force, slopes = one_pass(DAMPER.vector(DEMO), *arguments)
    assert np.allclose(force, DAMPER.force(DEMO, u, v, a, current, 1.0 / 250.0), atol=1e-9)
    for place, name in enumerate(DAMPER.names):
        step = 1e-6 * max(abs(DEMO[name]), 1e-2)
        ends = [DAMPER.force({**DEMO, name: DEMO[name] + way}, u, v, a, current, 1 / 250) for way in (step, -step)]
        by_difference = (ends[0] - ends[1]) / (2.0 * step)
        assert np.max(np.abs(slopes[:, place] - by_difference)) < 1e-4 * np.max(np.abs(by_difference)), name


def test_sliding_force_is_the_sum_of_its_terms() -> None:
    """At 0.1 m/s and 1 A, worked by hand: 36 + (40 + 200 + 10) + (15 + 25 + 6 - 2) asinh(50) - 150."""
    by_hand = 36.0 + 250.0 + 44.0 * 4.60527 - 150.0
    place = (by_hand + 150.0) / DEMO["k"]  # the piston lies behind the rod by that, so kx and ku see it
    assert DAMPER.force_at(DEMO, 0.1, 1.0) == pytest.approx(by_hand - place * (300.0 - 100.0), abs=0.05)


def test_at_rest_the_force_is_the_offset_from_the_first_sample_on() -> None:
    still = np.zeros(20)
    assert np.allclose(DAMPER.force(DEMO, still, still, still, 1.0, 1e-3), -150.0, atol=1e-9)
    assert DAMPER.force_at(DEMO, 0.0, 1.0) == pytest.approx(-150.0)


def test_a_damper_that_resists_at_every_speed_is_called_passive() -> None:
    t, u, v, a = motion(250.0)
    tests = [
        Measurement(
            id=f"{current_A:g} A", u_m=u, v_m_s=v, a_m_s2=a, force_N=np.zeros(t.size),
            current_A=np.full(t.size, current_A), dt_s=0.004, amplitude_m=AMPLITUDE_m, frequency_Hz=1.5,
            nominal_current_A=current_A, noise_N=1.0, samples_per_cycle=t.size,
        )
        for current_A in (0.0, 1.0)
    ]  # fmt: skip
    assert passivity(DAMPER, DEMO, tests).share == 1.0
    assert passivity(DAMPER, DEMO | {"ky": -80.0}, tests).share < 1.0


def test_terms_that_are_negative_at_a_current_count_as_none_and_the_damper_dissipates() -> None:
    values = {**DEMO, "kv": -400.0, "kv_b": 300.0, "kt": -30.0, "kx": 0.0, "f0": 0.0}
    assert written_out(values, 0.5)[0] == written_out(values, 0.5)[2] == 0.0
    t, u, v, a = motion(1000.0, cycles=3.0)
    force = DAMPER.force(values, u, v, a, np.full(t.size, 0.5), 1e-3)
    last = slice(-round(2.0 * math.pi / OMEGA * 1000.0), None)
    friction = 4.0 * AMPLITUDE_m * (40.0 + 0.5 * 200.0 + 0.25 * 10.0)  # an ideal yield force of the same size
    assert 0.8 * friction < np.sum(force[last] * v[last]) * 1e-3 < friction


def test_a_soft_spring_makes_the_force_late_and_a_stiff_one_does_not() -> None:
    t, u, v, a = motion(1000.0, cycles=2.0)
    turning = round(1.25 * 2.0 * math.pi / OMEGA * 1000.0)  # rod at its end, in the second cycle
    crossed = []
    for stiffness in (1e5, 1e10):
        force = DAMPER.force({**DEMO, "k": stiffness, "m": 0.0, "f0": 0.0}, u, v, a, np.full(t.size, 1.0), 1e-3)
        crossed.append(int(np.argmax(force[turning:] < 0.0)))
    assert crossed[1] < 39  # the loop is at 0 by 1/rho = 0.67 mm behind the reversal, which takes 39 ms
    assert crossed[0] > crossed[1] + 8  # 400 N stretch 0.1 MN/m by 4 mm


def test_a_spring_stiffer_than_any_rig_sees_is_at_its_limit() -> None:
    search = DAMPER.search()
    unknowns = search.unknowns(DEMO, frozenset())
    assert search.at_limit(unknowns, unknowns.theta({**DEMO, "k": 3e9})) == {"k": 3e8}
    assert search.at_limit(unknowns, unknowns.theta({**DEMO, "k": 1.5e7})) == {}


def test_a_search_begins_with_a_logarithmic_force_at_every_current() -> None:
    scale = MotionScale(0.03, 0.4, 1.0, 0.0, 2.0, 0.004)
    simple = {name: DEMO[name] for name in DEMO if name not in {"k", "m"}}
    kept = DAMPER.search().starts(simple, scale)[0]
    assert [kept[name] for name in ("kt", "kt_b", "kt_c", "kt_d", "vt")] == [15.0, 25.0, 6.0, -2.0, 2e-3]
    less = {**simple, "kt": 2.2, "kt_b": 1.2, "kt_c": -6.1, "kt_d": 1.3, "vt": 4e-5}  # -9 N at 2 A, and 0 counts
    starts = DAMPER.search().starts(less, scale)
    for start in starts:
        assert [start[name] for name in ("kt", "kt_b", "kt_c", "kt_d")] == [4.0, 20.0, 0.0, 0.0]  # a tenth of ky's
    assert starts[0]["vt"] == pytest.approx(0.008)


def test_the_inverse_finds_the_current_though_the_force_only_follows_it() -> None:
    t = np.arange(0.0, 2.0, 1e-3)
    u = 0.018 * np.sin(5.7 * t) + 0.006 * np.sin(14.5 * t + 1.0)
    v = 0.018 * 5.7 * np.cos(5.7 * t) + 0.006 * 14.5 * np.cos(14.5 * t + 1.0)
    a = -0.018 * 5.7**2 * np.sin(5.7 * t) - 0.006 * 14.5**2 * np.sin(14.5 * t + 1.0)
    current = 1.0 + 0.8 * np.sin(4.4 * t)
    expected = DAMPER.force(DEMO, u, v, a, current, 1e-3)
    grid = np.linspace(0.0, 2.0, 33)
    row, start = DAMPER.vector(DEMO)[None, :], DAMPER.initial_state()[None, :]
    answer = inverse_of(DAMPER)(row, grid, grid, start, u, v, a, expected, rates_N_s(expected, 1e-3), 1e-3)
    reported = (t > 0.05) & (answer[:, 3] > 0.0) & (np.abs(answer[:, 2]) > 100.0)  # attainable, and 10 N say 0.1 A
    assert np.mean(reported) > 0.8
    assert np.sqrt(np.mean((answer[reported, 0] - current[reported]) ** 2)) < 0.03 * 2.0
    assert np.allclose(
        answer[reported, 1], expected[reported], atol=0.2
    )  # of 1,500 N: at the state to which this current leads
    noisy = expected + np.random.default_rng(3).normal(0.0, 5.0, t.size)
    answer = inverse_of(DAMPER)(row, grid, grid, start, u, v, a, noisy, rates_N_s(noisy, 1e-3), 1e-3)
    half_N = 1.96 * 5.0 * amplified(answer[:, 6], answer[:, 7], 1e-3, causal=False)
    inside = np.abs(answer[:, 2] * (answer[:, 0] - current)) <= half_N
    reported &= (answer[:, 3] > 0.0) & (half_N < 0.2 * np.abs(answer[:, 2]))
    assert np.mean(reported) > 0.8
    assert 0.93 <= np.mean(inside[reported]) <= 0.98


def test_the_force_at_250_samples_a_second_is_that_of_thirty_times_as_many() -> None:
    forces = []
    for rate_Hz in (250.0, 7500.0):
        t = np.arange(round(2.0 * rate_Hz / 2.0)) / rate_Hz
        omega = 2.0 * math.pi * 2.0
        u, v = 0.03 * np.sin(omega * t), 0.03 * omega * np.cos(omega * t)
        forces.append(DAMPER.force(DEMO, u, v, -(omega**2) * u, 1.3, 1.0 / rate_Hz)[:: round(rate_Hz / 250.0)])
    assert np.max(np.abs(forces[0] - forces[1])[125:]) < 1.0  # of 700 N; with one step a sample 2.0


STIFF = {"k": 1.5e7, "vt": 3e-4, "kt": 25.0, "kt_b": 100.0}
TRUCK = {name: 100.0 * value for name, value in DEMO.items() if name not in {"rho", "vt", "k"}} | {"k": 1e7}


@pytest.mark.parametrize(
    ("changed", "amplitude_m", "frequency_Hz", "rate_Hz"),
    [
        (STIFF, 0.01, 8.0, 1000.0),
        (STIFF, 0.02, 4.0, 500.0),
        (STIFF, 0.025, 0.25, 50.0),
        ({"k": 1e5}, 0.01, 10.0, 2000.0),
        ({"k": 1e4}, 0.05, 10.0, 2000.0),
        (TRUCK, 0.02, 5.0, 1000.0),
    ],
    ids=["stiff and fast", "stiff", "stiff and slow", "soft", "very soft", "truck"],
)
def test_the_force_does_not_depend_on_the_sampling(
    changed: dict[str, float], amplitude_m: float, frequency_Hz: float, rate_Hz: float
) -> None:
    """A step whose stages are of first order adds a force that grows with the acceleration, which a fit calls mass.

    And between a soft spring and the logarithm's bend Newton's method would go back and forth for ever.
    """
    values, forces, fine = {**DEMO, **changed}, [], 20
    for rate in (rate_Hz, fine * rate_Hz):
        t = np.arange(round(1.5 * rate / frequency_Hz)) / rate
        omega = 2.0 * math.pi * frequency_Hz
        u, v = amplitude_m * np.sin(omega * t), amplitude_m * omega * np.cos(omega * t)
        forces.append(DAMPER.force(values, u, v, -(omega**2) * u, np.full(t.size, 0.5), 1.0 / rate))
    left = (forces[0] - forces[1][::fine])[t.size // fine // 3 :]
    assert np.sqrt(np.mean(left**2)) < 2e-4 * np.max(np.abs(forces[1]))
    assert np.max(np.abs(left)) < 2e-3 * np.max(np.abs(forces[1]))


@pytest.mark.parametrize("changed", [{}, {"k": 1e5}, STIFF, TRUCK], ids=["demo", "soft", "stiff", "truck"])
@pytest.mark.parametrize("rate_Hz", [250.0, 5000.0])
def test_at_any_sampling_the_force_is_that_of_an_independent_integrator(
    changed: dict[str, float], rate_Hz: float
) -> None:
    values = {**DEMO, **changed}
    _, force = by_an_independent_integrator(values, 0.8)
    t, u, v, a = motion(rate_Hz)
    ours = DAMPER.force(values, u, v, a, np.full(t.size, 0.8), 1.0 / rate_Hz)[:: round(rate_Hz / 250.0)]
    assert np.max(np.abs(ours - force)) < 4e-3 * np.max(np.abs(force))


@pytest.mark.parametrize("place", range(4), ids=["u", "v", "a", "current"])
def test_motion_or_current_that_is_no_number_is_refused(place: int) -> None:
    _, *moved = motion(250.0)
    columns = [*moved, np.full(moved[0].size, 0.8)]
    columns[place] = np.where(np.arange(moved[0].size) == 7, np.nan, columns[place])
    name = ("u", "v", "a", "current")[place]
    with pytest.raises(ValueError, match=rf"sprung_bouc_wen: {name}\[7\] = nan, expected a number"):
        DAMPER.force(DEMO, *columns, 1.0 / 250.0)


@pytest.mark.parametrize("offset_s", [0.0, 0.0013, 0.002, 0.0031])
def test_a_triangle_turns_where_it_turns(offset_s: float) -> None:
    """Between the samples beside a corner the rod goes as far as the samples say: else it would seem to jump."""
    forces, fine, rate_Hz = [], 40, 250.0
    for rate in (rate_Hz, fine * rate_Hz):
        t = np.arange(round(1.5 * rate)) / rate
        phase = (t + offset_s) % 1.0
        u = 0.02 * np.where(phase < 0.5, 4.0 * phase - 1.0, 3.0 - 4.0 * phase)
        v = np.where(phase < 0.5, 0.08, -0.08)
        forces.append(DAMPER.force(DEMO, u, v, np.zeros_like(t), np.full(t.size, 0.8), 1.0 / rate))
    left = (forces[0] - forces[1][::fine])[25:] / np.max(np.abs(forces[1]))
    assert np.sqrt(np.mean(left**2)) < 0.013  # 0.02 and 0.03 where the place jumped
