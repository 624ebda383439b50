"""A car's motion against the analytic transfer function, SciPy's solvers, and what energy and tyres can do."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig import dampers
from rig.dampers.kernel import advance_of, force_series
from rig.vehicle.car import Car, load_car
from rig.vehicle.corner_speeds import pull_of
from rig.vehicle.laws import Control
from rig.vehicle.motion import CornerDamper, DrivenCar
from rig.vehicle.road_file import load_road
from rig.vehicle.structure import Structure, structure

HALF = {
    "format": 1, "name": "half", "kind": "half", "source": "a test",
    "body": {"mass": "900 kg", "pitch_inertia": "1400 kg m^2"},
    "front": {"distance": "1.1 m", "unsprung_mass": "50 kg", "wheel_rate": "32 kN/m", "tyre_stiffness": "240 kN/m"},
    "rear": {
        "distance": "1.5 m", "unsprung_mass": "45 kg", "wheel_rate": "29 kN/m", "tyre_stiffness": "240 kN/m",
        "motion_ratio": 0.8,
    },
}  # fmt: skip
QUARTER = {
    "format": 1, "name": "quarter", "kind": "quarter", "source": "a test", "body": {"mass": "400 kg"},
    "front": {
        "unsprung_mass": "45 kg", "wheel_rate": "20 kN/m", "tyre_stiffness": "200 kN/m", "tyre_damping": "100 N s/m",
        "jounce_travel": "20 mm", "rebound_travel": "20 mm", "stop_stiffness": "150 kN/m",
    },
}  # fmt: skip
DEMO = dict(dampers.parameter_set("demo").values)
FREQUENCIES_HZ = (0.5, 1.25, 2.5, 4.0, 6.0, 8.0, 11.0, 14.0, 18.0)


def car_of(kind: str) -> Car:
    return load_car("compact-suv") if kind == "full" else Car.model_validate(QUARTER if kind == "quarter" else HALF)


def linear(damping_N_s_m: float, inertia_kg: float) -> CornerDamper:
    values = dict.fromkeys(DEMO, 0.0) | {"beta": 1.0, "eta": 25.0, "m": inertia_kg}
    return CornerDamper(
        dampers.model("asymmetric"), values | {"Ca_plus": damping_N_s_m, "Ca_minus": damping_N_s_m}
    )


SMOOTH = CornerDamper(dampers.model("asymmetric"), DEMO | {"beta": 20.0, "delta": 0.0, "m": 0.0})


def smooth_N(u: float, v: float, current: float) -> float:
    """The paper's equation with delta = 0 and m = 0, and without its force at rest."""
    c = DEMO["Ca_plus"] + DEMO["Cb_plus"] * current if v >= 0.0 else DEMO["Ca_minus"] + DEMO["Cb_minus"] * current
    stiffness = DEMO["Ka"] + DEMO["Kb"] * current
    return float(c * v + stiffness * u + (DEMO["Fya"] + DEMO["Fyb"] * current) * np.tanh(20.0 * v))


def sine(t: np.ndarray, frequency_Hz: float, height_m: float) -> tuple[np.ndarray, np.ndarray]:
    """A sine that begins softly over a second, and how fast it rises."""
    w, begun = 2.0 * np.pi * frequency_Hz, np.minimum(t, 1.0)
    ramp, slope = 0.5 * (1.0 - np.cos(np.pi * begun)), 0.5 * np.pi * np.sin(np.pi * begun) * (t < 1.0)
    return height_m * ramp * np.sin(w * t), height_m * (slope * np.sin(w * t) + w * ramp * np.cos(w * t))


def under(own: Structure, column: tuple[np.ndarray, np.ndarray], wheels: tuple[int, ...]) -> list[np.ndarray]:
    made = [np.zeros((len(column[0]), own.corners)) for _ in column]
    for array, values in zip(made, column, strict=True):
        array[:, wheels] = values[:, None]
    return made


@pytest.mark.few(2)
@pytest.mark.parametrize("kind", ["quarter", "half", "full"])
def test_constant_damping_gives_the_analytic_transfer_function(kind: str) -> None:
    own = structure(car_of(kind))
    damper = linear(1500.0, 12.0)
    t = np.arange(14_001) * 1e-3
    last = t > 10.0 - 1e-9
    analytic = own.transfer(np.array(FREQUENCIES_HZ), np.full(own.corners, 1500.0), np.full(own.corners, 12.0))
    for frequency_Hz, expected in zip(FREQUENCIES_HZ, analytic[:, :, 0], strict=True):
        ride = DrivenCar(own, damper).drive(*under(own, sine(t, frequency_Hz, 1e-4), (0,)), 1e-3)
        turning = np.exp(-2j * np.pi * frequency_Hz * t[last])
        answered = 2.0 * np.mean(ride.place[last] * turning[:, None], axis=0) / 1e-4
        level_dB = 20.0 * np.log10(np.abs(answered) / np.abs(expected))
        assert np.max(np.abs(level_dB)) < 0.1, (frequency_Hz, level_dB)


def test_the_transfer_function_of_a_quarter_car_is_the_text_book_s() -> None:
    own = structure(car_of("quarter"))
    frequency_Hz = np.array([0.7, 1.1, 5.0, 10.5, 18.0])
    s = 2j * np.pi * frequency_Hz
    body, wheel, k, c, kt, ct, b = 400.0, 45.0, 20e3, 1500.0, 200e3, 100.0, 12.0
    apart = b * s**2 + c * s + k
    over = (body * s**2 + apart) * (wheel * s**2 + apart + kt + ct * s) - apart**2
    expected = apart * (kt + ct * s) / over
    answered = own.transfer(frequency_Hz, np.array([c]), np.array([b]))[:, 0, 0]
    assert np.allclose(answered, expected, rtol=1e-9)


@pytest.mark.nightly
def test_a_quarter_car_that_hits_its_stops_and_leaves_the_road_moves_as_radau_says() -> None:
    own = structure(car_of("quarter"))
    t = np.arange(30_001) * 1e-4
    road = sine(t, 2.0, 0.06)
    ride = DrivenCar(own, SMOOTH, control=Control(current_A=0.5)).drive(*under(own, road, (0,)), 1e-4)
    weight_N = (400.0 + 45.0) * 9.80665

    def rates(now: float, state: np.ndarray) -> list[float]:
        z, zu, v, vu = state
        (zr, vr) = (float(value[0]) for value in sine(np.array([now]), 2.0, 0.06))
        damper = smooth_N(z - zu, v - vu, 0.5)
        suspension = 20e3 * (zu - z) - damper
        jounce = zu - z
        suspension += 150e3 * (max(0.0, jounce - 0.02) + min(0.0, jounce + 0.02))
        tyre = max(-weight_N, 200e3 * (zr - zu) + 100.0 * (vr - vu))
        return [v, vu, suspension / 400.0, (tyre - suspension) / 45.0]

    exact = solve_ivp(rates, (0.0, 3.0), np.zeros(4), "Radau", t_eval=t, rtol=1e-7, atol=1e-9, max_step=5e-3).y.T
    assert np.max(np.abs(ride.place[:, 1] - ride.place[:, 0])) > 0.025, "the stops were reached"
    assert np.min(ride.tyre_N) == 0.0, "the tyre left the road"
    assert np.max(np.abs(ride.place - exact[:, :2])) < 0.01 * np.max(np.abs(exact[:, :2]))


def test_a_full_car_with_nonlinear_dampers_moves_as_an_independent_solver_says() -> None:
    own = structure(load_car("compact-suv"))
    t = np.arange(2501) * 1e-3
    height, rate = np.zeros((len(t), 4)), np.zeros((len(t), 4))
    for wheel, frequency_Hz in enumerate((2.0, 2.5, 4.0, 5.0)):
        height[:, wheel], rate[:, wheel] = sine(t, frequency_Hz, 0.008)
    ride = DrivenCar(own, SMOOTH, control=Control(current_A=1.0)).drive(height, rate, 1e-3)
    a = np.array([1.12, 1.12, -1.54, -1.54])
    b = 0.5 * np.array([1.625, -1.625, 1.63, -1.63])
    k, r, wheel = np.repeat([32e3, 29e3], 2), np.repeat([0.95, 0.8], 2), np.repeat([50.0, 45.0], 2)

    def rates(now: float, state: np.ndarray) -> np.ndarray:
        z, pitch, roll, zu = state[0], state[1], state[2], state[3:7]
        v, vpitch, vroll, vu = state[7], state[8], state[9], state[10:]
        columns = [sine(np.array([now]), f, 0.008) for f in (2.0, 2.5, 4.0, 5.0)]
        zr, vr = (np.array([column[part][0] for column in columns]) for part in (0, 1))
        apart, speed = zu - (z + a * pitch + b * roll), vu - (v + a * vpitch + b * vroll)
        damper = np.array([smooth_N(-ri * x, -ri * s, 1.0) for ri, x, s in zip(r, apart, speed, strict=True)])
        up = k * apart - r * damper
        tyre = 240e3 * (zr - zu) + 100.0 * (vr - vu)
        body = [np.sum(up) / 1773.0, np.sum(a * up) / 2700.0, np.sum(b * up) / 900.0]
        return np.concatenate([state[7:], body, (tyre - up) / wheel])

    exact = solve_ivp(rates, (0.0, 2.5), np.zeros(14), "LSODA", t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.02).y.T
    for column in range(7):
        worst = np.max(np.abs(ride.place[:, column] - exact[:, column]))
        assert worst < 2e-3 * np.max(np.abs(exact[:, column])), (column, worst)


def test_work_of_the_road_is_what_the_car_holds_and_what_dampers_and_tyres_took() -> None:
    own = structure(load_car("compact-suv"))
    _, height, rate = load_road("iso8608-b").under(own.car, 1e-3)
    height, rate = height[:15_001], rate[:15_001]
    damper = CornerDamper(dampers.model("asymmetric"), SMOOTH.values | {"Ka": 0.0, "Kb": 0.0})
    ride = DrivenCar(own, damper, control=Control(current_A=1.0)).drive(height, rate, 1e-3)
    pressed, speed = height - ride.place[:, 3:], rate - ride.velocity[:, 3:]
    tyre_N = own.tyre_stiffness * pressed + own.tyre_damping * speed
    road_J = np.sum(tyre_N * rate) * 1e-3
    taken_J = np.sum(ride.force_N * ride.speed_m_s) * 1e-3 + np.sum(own.tyre_damping * speed**2) * 1e-3
    q, v = ride.place[-1], ride.velocity[-1]
    held_J = 0.5 * v @ own.mass @ v + 0.5 * q @ own.stiffness @ q
    held_J += 0.5 * np.sum(own.tyre_stiffness * (pressed[-1] ** 2 - q[3:] ** 2))
    assert road_J == pytest.approx(held_J + taken_J, rel=0.01)
    assert np.min(np.cumsum(ride.force_N * ride.speed_m_s, axis=0)) >= -1e-9


@pytest.mark.nightly
def test_a_hysteretic_damper_in_a_car_is_the_same_object_as_along_a_recording() -> None:
    own = structure(car_of("quarter"))
    model = dampers.model("bouc_wen")
    damper = CornerDamper(model, dict(model.demonstration))
    t = np.arange(6001) * 5e-4
    ride = DrivenCar(own, damper, control=Control(current_A=0.6)).drive(*under(own, sine(t, 1.5, 0.01), (0,)), 5e-4)
    acceleration = ride.acceleration @ own.damper.T
    along = force_series(
        model, damper.vector, model.initial_state(), ride.extension_m[:, 0].copy(), ride.speed_m_s[:, 0].copy(),
        acceleration[:, 0].copy(), np.full(len(t), 0.6), 5e-4, 0,
    )  # fmt: skip
    apart = ride.force_N[:, 0] - (along - along[0])
    assert np.max(np.abs(apart)) < 0.01 * np.ptp(along)
    assert np.sum(ride.force_N * ride.speed_m_s) > 0.0


def test_dampers_of_different_state_counts_have_the_force_in_a_car_that_they_have_alone() -> None:
    sprung, grey = dampers.model("sprung_bouc_wen"), dampers.model("bingham+grey@slip")
    assert sprung.states < grey.states
    values = {one.name: one.start for one in grey.parameters} | {"fc": 100.0, "c0": 500.0, "g_slip_1": 60.0}
    front, rear = CornerDamper(sprung, dict(sprung.demonstration)), CornerDamper(grey, values)
    car = DrivenCar(structure(Car.model_validate(HALF)), front, rear)
    corners, pull = car._corners(1e-3), pull_of(sprung, grey)
    for corner, damper in enumerate(car.dampers):
        alone, state = advance_of(damper.model), damper.model.initial_state()
        for u, v in ((0.0, 0.2), (0.001, 0.3), (0.002, 0.4)):
            expected = alone(damper.vector, state, u, v, 1.0, 0.0, 5e-3)
            assert pull(corners, corner, u, v, 1.0, 5e-3) == pytest.approx(expected, rel=1e-12)
            corners.states[corner] = corners.trial[corner]


def test_a_sweep_in_phase_does_not_roll_a_symmetric_car_and_in_antiphase_neither_lifts_nor_pitches_it() -> None:
    own = structure(load_car("compact-suv"))
    road = load_road("paper-sweep")
    damper = linear(1500.0, 0.0)
    still = {0.0: [2], 180.0: [0, 1]}
    for phase_deg, columns in still.items():
        _, height, rate = road.with_phase(phase_deg).under(own.car, 1e-3)
        ride = DrivenCar(own, damper).drive(height[:20_000], rate[:20_000], 1e-3)
        moved = np.max(np.abs(ride.place[:, :3]), axis=0)
        moving = [column for column in range(3) if column not in columns]
        assert np.max(moved[columns]) < 1e-9 * np.min(moved[moving])


def test_skyhook_shakes_the_body_less_than_the_same_current_held() -> None:
    own = structure(load_car("compact-suv"))
    _, height, rate = load_road("iso8608-c").under(own.car, 1e-3)
    height, rate = height[:20_001], rate[:20_001]
    damper = CornerDamper(dampers.model("asymmetric"), DEMO | {"beta": 20.0})
    shaken = {}
    for law in ("passive", "skyhook", "groundhook", "hybrid", "inverse"):
        ride = DrivenCar(own, damper, control=Control(law, current_A=2.0, most_A=2.0)).drive(height, rate, 1e-3)
        shaken[law] = float(np.sqrt(np.mean(ride.acceleration[:, 0] ** 2)))
        assert np.min(ride.current_A) >= 0.0
        assert np.max(ride.current_A) <= 2.0
    assert shaken["skyhook"] < 0.95 * shaken["passive"], shaken
    assert shaken["hybrid"] < shaken["passive"], shaken
    assert shaken["inverse"] < shaken["passive"], shaken


def test_a_road_of_other_wheels_or_with_holes_in_its_numbers_is_refused() -> None:
    car = DrivenCar(structure(car_of("quarter")), SMOOTH)
    with pytest.raises(ValueError, match="expected 1 wheels"):
        car.drive(np.zeros((5, 2)), np.zeros((5, 2)), 1e-3)
    with pytest.raises(ValueError, match="finite"):
        car.drive(np.full((5, 1), np.nan), np.zeros((5, 1)), 1e-3)
