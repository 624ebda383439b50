"""The models with internal states against an independent integrator, limits and invariances."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig.dampers import model, parameter_set
from rig.dampers.kernel import advance_of, force_series
from rig.dampers.loop_curve import hysteresis_of, hysteresis_series
from rig.dampers.separation import JoinedMotions

OMEGA, AMPLITUDE, CURRENT = 2.0 * np.pi * 1.5, 0.02, 0.8


@dataclass(frozen=True)
class Swing:
    """One motion with its own rate and cycle."""

    u_m: np.ndarray
    v_m_s: np.ndarray
    dt_s: float
    samples_per_cycle: int

    @property
    def a_m_s2(self) -> np.ndarray:
        """Its acceleration, which no loop depends on."""
        return 0.0 * self.u_m

    @property
    def current_A(self) -> np.ndarray:
        """Its current, which no loop depends on."""
        return 0.0 * self.u_m


def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        AMPLITUDE * np.sin(OMEGA * t),
        AMPLITUDE * OMEGA * np.cos(OMEGA * t),
        -AMPLITUDE * OMEGA**2 * np.sin(OMEGA * t),
    )


def bouc_wen_rate(p: dict[str, float], z: float, v: float) -> float:
    return -p["gamma"] * abs(v) * np.sign(z) * abs(z) ** p["n"] - p["beta"] * v * abs(z) ** p["n"] + p["A"] * v


Slopes = tuple[Callable[..., list[float]], Callable[..., float], list[float]]
NEWER = ("dahl", "lugre", "generalized_bouc_wen", "asymmetric_bouc_wen", "lost_motion")


def newer_slopes(name: str, p: dict[str, float]) -> Slopes:
    """`slopes` of the models of `NEWER`."""
    if name == "dahl":
        return (
            lambda u, v, s: [p["rho"] * (v - abs(v) * s[0])],
            lambda u, v, s: (
                p["kx"] * u + (p["kv"] + p["kv_b"] * CURRENT) * v + (p["kw"] + p["kw_b"] * CURRENT) * s[0] + p["f0"]
            ),
            [0.0],
        )
    if name == "generalized_bouc_wen":

        def leaning(u: float, v: float, s: list[float]) -> list[float]:
            psi = p["sigma"] * np.sign(v * s[0]) + 1.0 - p["sigma"] + p["phi"] * (np.sign(v) + np.sign(s[0]))
            return [p["rho"] * v * (1.0 - abs(s[0]) ** p["n"] * psi)]

        kv, kw = p["kv"] + p["kv_b"] * CURRENT, p["kw"] + p["kw_b"] * CURRENT
        return (leaning, lambda u, v, s: p["kx"] * u + kv * v + kw * s[0] + p["f0"], [0.0])
    if name == "lugre":

        def slip(v: float, w: float) -> float:
            return v - abs(v) * w / (1.0 + p["s"] * np.exp(-((v / p["vs"]) ** 2)))

        kv, kw, kd = (p[key] + p[f"{key}_b"] * CURRENT for key in ("kv", "kw", "kd"))
        return (
            lambda u, v, s: [p["rho"] * slip(v, s[0])],
            lambda u, v, s: p["kx"] * u + kv * v + kw * s[0] + kd * slip(v, s[0]) + p["f0"],
            [0.0],
        )
    if name == "asymmetric_bouc_wen":
        shape = {"gamma": p["rho"] * p["sigma"], "beta": p["rho"] * (1.0 - p["sigma"]), "A": p["rho"], "n": p["n"]}
        kv, kva, kw, kwa = (p[key] + p[f"{key}_b"] * CURRENT for key in ("kv", "kva", "kw", "kwa"))
        return (
            lambda u, v, s: [bouc_wen_rate(shape, s[0], v)],
            lambda u, v, s: p["kx"] * u + kv * v + kva * abs(v) + kw * s[0] + kwa * abs(s[0]) + p["f0"],
            [0.0],
        )
    shape = {"gamma": p["rho"] / 2.0, "beta": p["rho"] / 2.0, "A": p["rho"], "n": 2.0}
    ky, kg, kt = (
        p[key] + p[f"{key}_b"] * CURRENT + p[f"{key}_c"] * CURRENT**2 + p.get(f"{key}_d", 0.0) * CURRENT**3
        for key in ("ky", "kg", "kt")
    )

    def engaging(u: float, v: float, s: list[float]) -> float:
        h = s[0] * abs(s[0]) ** 3
        yielding = (ky + (p["ku"] + p["ku_b"] * CURRENT) * u) * h
        viscous = (p["kv"] + p["kv_b"] * CURRENT) * v + kg * (1.0 - abs(h)) * v
        return p["f0"] + p["kx"] * u + viscous + yielding + kt * np.log(v / p["vt"] + np.hypot(v / p["vt"], 1.0))

    return (lambda u, v, s: [bouc_wen_rate(shape, s[0], v)], engaging, [0.0])


def slopes(name: str, p: dict[str, float]) -> Slopes:
    """Right-hand side, force, and state at rest, written from the equations a second time."""
    if name == "bouc_wen":
        return (
            lambda u, v, s: [bouc_wen_rate(p, s[0], v)],
            lambda u, v, s: (
                (p["c0"] + p["c0_b"] * CURRENT) * v
                + p["k0"] * (u - p["x0"])
                + (p["alpha"] + p["alpha_b"] * CURRENT) * s[0]
            ),
            [0.0],
        )
    if name == "normalized_bouc_wen":
        shape = {"gamma": p["rho"] * p["sigma"], "beta": p["rho"] * (1.0 - p["sigma"]), "A": p["rho"], "n": p["n"]}
        return (
            lambda u, v, s: [bouc_wen_rate(shape, s[0], v)],
            lambda u, v, s: (
                p["kx"] * u + (p["kv"] + p["kv_b"] * CURRENT) * v + (p["kw"] + p["kw_b"] * CURRENT) * s[0] + p["f0"]
            ),
            [0.0],
        )
    if name in NEWER:
        return newer_slopes(name, p)
    if name == "modified_bouc_wen":
        alpha, c0, c1 = (p[f"{key}a"] + p[f"{key}b"] * CURRENT for key in ("alpha_", "c0", "c1"))

        def y_rate(u: float, v: float, s: list[float]) -> float:
            return (alpha * s[1] + c0 * v + p["k0"] * (u - s[0])) / (c0 + c1)

        return (
            lambda u, v, s: [y_rate(u, v, s), bouc_wen_rate(p, s[1], v - y_rate(u, v, s))],
            lambda u, v, s: c1 * y_rate(u, v, s) + p["k1"] * (u - p["x0"]),
            [0.0, 0.0],
        )
    fc, c0 = p["fc"] + p["fc_b"] * CURRENT, p["c0"] + p["c0_b"] * CURRENT

    def slip(u: float, s: list[float]) -> float:
        spring = p["k2"] * (u - s[1])
        return (spring - fc * np.sign(spring)) / c0 if abs(spring) > fc else 0.0

    return (
        lambda u, v, s: [slip(u, s), slip(u, s) + (p["k2"] * (u - s[1]) - p["k1"] * (s[1] - s[0])) / p["c1"]],
        lambda u, v, s: p["k2"] * (u - s[1]) + p["f0"],
        [0.0, 0.0],
    )


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("demo-bouc-wen", {}),
        ("demo-bouc-wen", {"gamma": 1e3, "beta": -1e3}),
        ("demo-bouc-wen", {"n": 0.9, "gamma": 1e3, "beta": 1e3}),
        ("demo-normalized-bouc-wen", {}),
        ("demo-normalized-bouc-wen", {"n": 0.9}),
        ("demo-lost-motion", {}),
        ("demo-dahl", {}),
        ("demo-asymmetric-bouc-wen", {}),
        ("demo-generalized-bouc-wen", {}),
        ("demo-generalized-bouc-wen", {"phi": -0.4, "sigma": 2.0}),
        ("demo-lugre", {}),
        ("demo-lugre", {"rho": 9000.0}),
        ("demo-modified-bouc-wen", {}),
        ("demo-modified-bouc-wen", {"gamma": 1e3, "beta": -1e3}),
        ("demo-modified-bouc-wen", {"n": 0.9, "gamma": 1e3, "beta": 1e3}),
        ("demo-viscoelastic-plastic", {}),
        ("spencer-modified", {}),
    ],
)
def test_series_agrees_with_an_independent_integrator(name: str, changed: dict[str, float]) -> None:
    chosen = parameter_set(name)
    values = {**chosen.values, **changed}
    right, force, rest = slopes(chosen.model, values)
    t = np.arange(0.0, 1.0, 0.002)

    def derivative(time: float, state: list[float]) -> list[float]:
        u, v, _ = motion(np.array(time))
        return right(float(u), float(v), state)

    reference = solve_ivp(derivative, (0.0, t[-1]), rest, "LSODA", t, rtol=1e-9, atol=1e-12, max_step=5e-4)
    u, v, a = motion(t)
    expected = np.array([force(u[k], v[k], reference.y[:, k]) for k in range(t.size)])
    found = model(chosen.model).force(values, u, v, a, CURRENT, 0.002)
    assert np.sqrt(np.mean((found - expected) ** 2)) < 2e-3 * np.max(np.abs(expected))


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "name",
    [
        "demo-bouc-wen", "demo-normalized-bouc-wen", "demo-modified-bouc-wen", "demo-viscoelastic-plastic",
        "demo-lost-motion", "demo-dahl", "demo-hysteretic-biviscous", "demo-digressive-bilinear",
        "demo-asymmetric-bouc-wen", "demo-generalized-bouc-wen", "demo-lugre",
    ],
)  # fmt: skip
def test_plant_steps_follow_the_series(name: str) -> None:
    chosen = parameter_set(name)
    damper = model(chosen.model)
    t = np.arange(0.0, 1.0, 1.0 / 8000.0)
    u, v, a = motion(t)
    series = damper.force(chosen.values, u, v, a, CURRENT, 1.0 / 8000.0)
    vector, state = damper.vector(chosen.values), damper.initial_state()
    steps = [
        advance_of(damper)(vector, state, u[k], v[k], a[k], CURRENT, 0.0 if k == 0 else 1.0 / 8000.0)
        for k in range(t.size)
    ]
    assert np.max(np.abs(np.array(steps) - series)) < 1e-3 * np.max(np.abs(series))


def test_bouc_wen_saturates_at_z0() -> None:
    values = {**parameter_set("spencer-bouc-wen").values, "c0": 0.0, "k0": 0.0}
    u = np.linspace(0.0, 0.05, 501)
    force = model("bouc_wen").force(values, u, np.full(501, 0.1), np.zeros(501), 0.0, 0.001)
    z0 = (values["A"] / (values["beta"] + values["gamma"])) ** (1.0 / values["n"])
    assert force[-1] == pytest.approx(values["alpha"] * z0, rel=1e-4)


@pytest.mark.nightly
def test_normalised_form_is_the_same_damper_as_bouc_wen() -> None:
    bw = parameter_set("spencer-bouc-wen").values
    z0 = (bw["A"] / (bw["beta"] + bw["gamma"])) ** (1.0 / bw["n"])
    normalised = {
        "kx": bw["k0"],
        "kv": bw["c0"],
        "kv_b": 0.0,
        "kw": bw["alpha"] * z0,
        "kw_b": 0.0,
        "f0": -bw["k0"] * bw["x0"],
        "rho": bw["A"] / z0,
        "sigma": bw["gamma"] / (bw["beta"] + bw["gamma"]),
        "n": bw["n"],
    }
    u, v, a = motion(np.arange(0.0, 2.0, 0.001))
    first = model("bouc_wen").force(bw, u, v, a, 0.0, 0.001)
    second = model("normalized_bouc_wen").force(normalised, u, v, a, 0.0, 0.001)
    assert np.max(np.abs(first - second)) < 1e-6 * np.max(np.abs(first))


def test_hysteresis_of_bouc_wen_does_not_depend_on_speed() -> None:
    values = {**parameter_set("demo-bouc-wen").values, "c0": 0.0, "c0_b": 0.0}
    forces = []
    for stretch in (1.0, 5.0):
        t = np.arange(0.0, 1.0, 0.0005)
        u, v, a = motion(t)
        forces.append(model("bouc_wen").force(values, u, v / stretch, a / stretch**2, 1.0, 0.0005 * stretch))
    assert np.max(np.abs(forces[0] - forces[1])) < 2e-3 * np.max(np.abs(forces[0]))


def test_below_yield_the_viscoelastic_plastic_model_does_not_slip() -> None:
    values = {**parameter_set("demo-viscoelastic-plastic").values, "fc": 1e5}
    u, v, a = motion(np.arange(0.0, 4.0, 0.001))
    force = model("viscoelastic_plastic").force(values, u, v, a, 0.0, 0.001) - values["f0"]
    spring, dashpot, series = values["k1"], 1j * OMEGA * values["c1"], values["k2"]
    stiffness = series * (spring + dashpot) / (series + spring + dashpot)
    assert np.max(np.abs(force[2000:])) == pytest.approx(abs(stiffness) * AMPLITUDE, rel=1e-3)


def test_sliding_force_of_a_hysteretic_model_is_its_saturated_branch() -> None:
    values = parameter_set("demo-normalized-bouc-wen").values
    force = model("normalized_bouc_wen").force_at(values, 0.1, 1.0)
    assert float(force) == pytest.approx(0.1 * 810.0 + 330.0 - 150.0, abs=0.5)
    assert float(model("normalized_bouc_wen").force_at(values, 0.0, 1.0)) == pytest.approx(-150.0)


@pytest.mark.parametrize(("sigma", "n"), [(0.3, 1.0), (0.6, 2.0), (0.8, 1.3), (2.5, 12.0), (20.0, 1.1), (20.0, 5.0)])
def test_the_loops_one_curve_agrees_with_an_independent_integrator(sigma: float, n: float) -> None:
    rho, t = 1500.0, np.arange(0.0, 1.4, 0.001)
    u, v = 0.02 * np.sin(9.4 * t) + 0.004 * np.sin(31.0 * t), 0.188 * np.cos(9.4 * t) + 0.124 * np.cos(31.0 * t)

    def rate(time: float, w: np.ndarray) -> np.ndarray:
        speed = 0.188 * np.cos(9.4 * time) + 0.124 * np.cos(31.0 * time)
        return (
            bouc_wen_rate({"gamma": rho * sigma, "beta": rho * (1.0 - sigma), "A": rho, "n": n}, w[0], speed) + 0.0 * w
        )

    reference = solve_ivp(rate, (0.0, t[-1]), [0.0], "LSODA", t, rtol=1e-10, atol=1e-12, max_step=2e-4).y[0]
    assert np.max(np.abs(hysteresis_series(0.0, rho, sigma, n, u, v, 0.001, 0) - reference)) < 2e-3


@pytest.mark.nightly
@pytest.mark.parametrize(("sigma", "n"), [(0.3, 1.2), (0.6, 2.0), (2.5, 4.0)])
def test_slopes_of_the_loop_are_its_differences(sigma: float, n: float) -> None:
    t = np.arange(0.0, 2.0, 0.001)
    u, v = 0.02 * np.sin(6.3 * t), 0.126 * np.cos(6.3 * t)
    shape = np.array([1500.0, sigma, n])
    found = hysteresis_of(*shape, Swing(u, v, 0.001, 997), slope=True)
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-5 * shape[k]
        above, below = (hysteresis_series(0.0, *(shape + sign * step), u, v, 0.001, 997) for sign in (1.0, -1.0))
        difference = (above - below) / (2.0 * step[k])
        assert np.max(np.abs(found[k + 1] - difference)) < 5e-3 * np.max(np.abs(difference))


def test_a_cycle_of_warm_up_leaves_no_jump_at_the_first_sample() -> None:
    for name in ("demo-viscoelastic-plastic", "demo-modified-bouc-wen", "demo-bouc-wen"):
        chosen = parameter_set(name)
        damper = model(chosen.model)
        t = np.arange(0.0, 3.0, 0.004)  # a cycle is 166.67 samples
        u, v, a = motion(t)
        data = (u, v, a, np.full(t.size, CURRENT), 0.004)
        force = force_series(damper, damper.vector(chosen.values), damper.initial_state(u[0]), *data, 167)
        assert force[0] == pytest.approx(force[500], abs=2.0)


def test_a_loop_that_starts_saturated_stays_so_until_the_motion_turns() -> None:
    chosen = parameter_set("demo-normalized-bouc-wen")
    damper, p = model(chosen.model), chosen.values
    t = np.arange(0.0, 0.16, 0.002)  # a quarter of a period: rebound all the way
    u, v, a = motion(t)
    held = force_series(damper, damper.vector(p), np.array([1.0]), u, v, a, np.zeros(t.size), 0.002, 0)
    assert held == pytest.approx(p["kx"] * u + p["kv"] * v + p["kw"] + p["f0"], rel=1e-9)


def test_a_series_of_a_model_without_states_is_its_equation() -> None:
    chosen = parameter_set("demo")
    damper = model(chosen.model)
    u, v, a = motion(np.arange(0.0, 1.0, 0.002))
    current = np.full(u.size, CURRENT)
    series = force_series(damper, damper.vector(chosen.values), np.zeros(0), u, v, a, current, 0.002, 0)
    assert series == pytest.approx(damper.force(chosen.values, u, v, a, current, 0.002), rel=1e-12)


def test_a_cycle_of_warm_up_is_forgotten_by_loops_that_have_no_curve() -> None:
    chosen = parameter_set("demo-normalized-bouc-wen")
    damper = model(chosen.model)
    vector = damper.vector({**chosen.values, "n": 0.9})
    t = np.arange(0.0, 2.0 / 1.5, 0.002)
    data = (*motion(t), np.full(t.size, CURRENT), 0.002)
    from_rest = force_series(damper, vector, np.array([0.0]), *data, 333)
    from_elsewhere = force_series(damper, vector, np.array([0.5]), *data, 333)
    assert np.max(np.abs(from_rest - from_elsewhere)) < 1e-6 * np.max(np.abs(from_rest))


def test_slopes_without_a_warm_up_start_from_rest() -> None:
    t = np.arange(0.0, 0.5, 0.001)
    u, v = 0.02 * np.sin(6.3 * t), 0.126 * np.cos(6.3 * t)
    found = hysteresis_of(1500.0, 0.6, 2.0, Swing(u, v, 0.001, 0), slope=True)
    assert found[:, 0] == pytest.approx([0.0, 0.0, 0.0, 0.0], abs=1e-12)
    assert found[0] == pytest.approx(hysteresis_series(0.0, 1500.0, 0.6, 2.0, u, v, 0.001, 0), abs=1e-9)


@pytest.mark.parametrize("slope", [False, True])
def test_joined_motions_have_the_loops_of_single_ones(slope: bool) -> None:
    """Bit by bit: each motion starts again, from its own warm-up and with its own interval."""
    swings = []
    for amplitude_m, dt_s, warm in ((0.02, 0.001, 997), (0.005, 0.004, 250), (0.03, 0.002, 0)):
        t = dt_s * np.arange(700 if warm == 0 else warm + 9)
        u, v = amplitude_m * np.sin(6.3 * t), 6.3 * amplitude_m * np.cos(6.3 * t)
        swings.append(Swing(u, v, dt_s, warm))
    joined = hysteresis_of(1500.0, 0.6, 2.0, JoinedMotions.of(swings), slope=slope)
    single = [hysteresis_of(1500.0, 0.6, 2.0, swing, slope=slope) for swing in swings]
    np.testing.assert_array_equal(joined, np.concatenate(single, axis=1))
