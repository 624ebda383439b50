"""A hybrid test in process: the computed part against an independent solver, delays, compensators, what stops it."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from drivers.roles import State
from drivers.setpoint_generator import Setpoint, SetpointGenerator
from rig import dampers
from rig.hybrid.delay_probe import Probe
from rig.hybrid.hybrid_motion import HybridMotion, HybridOrder, Moment, Phase
from rig.hybrid.lead import COMPENSATORS
from rig.hybrid.motion_bounds import Bounds, Measured, Watch
from rig.hybrid.quarter_car import QuarterCar
from rig.hybrid.substructure import Sent, Target
from rig.signals.stopping import halted_m
from rig.vehicle.car import Car
from rig.vehicle.laws import Control
from rig.vehicle.motion import CornerDamper
from rig.vehicle.road import Sweep, sweep_road

BODY_KG, WHEEL_KG, SPRING_N_M, TYRE_N_M, TYRE_N_S_M = 600.0, 90.0, 40e3, 220e3, 300.0

DAMPING = 1200.0
DELAY_S = 0.008
REST_N = -270.0
FINE_S = 1e-3


def linear_damper(damping_N_s_m: float) -> CornerDamper:
    """A damper whose force is its damping times its speed, either way."""
    model = dampers.model("asymmetric")
    return CornerDamper(
        model, {name: damping_N_s_m if name in {"Ca_plus", "Ca_minus"} else 0.0 for name in model.names}
    )


def quarter_car(damper: CornerDamper, duration_s: float = 4.0) -> QuarterCar:
    """A corner of a van on a sweep from 1 to 5 Hz."""
    car = Car.model_validate({
        "format": 1, "name": "corner", "kind": "quarter", "source": "a test", "body": {"mass": "600 kg"},
        "front": {
            "unsprung_mass": "90 kg", "wheel_rate": "40 kN/m", "tyre_stiffness": "220 kN/m",
            "tyre_damping": "300 N s/m",
        },
    })  # fmt: skip
    return QuarterCar(car, sweep_road(Sweep(duration_s, 1.0, 5.0, 20e-3, 10e-3, 0.0)), damper)


def order(car: QuarterCar, compensator: str, step_s: float = 0.01, **bounds: float) -> HybridOrder:
    """A test in steps of 10 ms within wide bounds."""
    within = Bounds(**{
        "extension_m": 0.2, "speed_m_s": 5.0, "acceleration_m_s2": 500.0, "energy_share": 0.3, "delay_s": 0.03,
        "travel_m": 0.5, "halt_deceleration_m_s2": 20.0, "energy_floor_J": 4.0, "planned_m_s": 5.0, **bounds,
    })  # fmt: skip
    return HybridOrder(car.part(step_s), within, Probe(1e-3, 5.0), compensator, centre_m=0.05)


def run(
    request: HybridOrder, damping: float = DAMPING, delay_s: float = DELAY_S,
    seen: Callable[[float, float], float] = lambda force_N, _: force_N,
) -> tuple[HybridMotion, list[Moment]]:
    """A test whose rod is where it was told to be `delay_s` ago, and whose specimen is linear, with a force at rest."""
    motion, moments = HybridMotion(request), []
    # The newest place is that of the last instant.
    sent, late = (0.05, 0.0, 0.0), round(delay_s / FINE_S) - 1
    places = [0.05] * (late + 2)
    every = round(request.part.step_s / FINE_S)
    for k in range(round(request.duration_s / FINE_S) + 2 * every):
        t_s = k * FINE_S
        extension_m, before_m = places[-1 - late], places[-2 - late]
        if k % every == 0:
            force_N = seen(REST_N + damping * (extension_m - before_m) / FINE_S, t_s)
            setpoint = motion.at(t_s, Measured(force_N, extension_m))
            if setpoint is None or motion.problem is not None:
                break
            sent = (*setpoint, t_s)
            if motion.moment is not None:
                moments.append(motion.moment)
        places.append(sent[0] + sent[1] * (t_s - sent[2]))
    return motion, moments


def test_the_computed_part_answers_as_an_independent_solver_says() -> None:
    part = quarter_car(linear_damper(0.0)).part(0.005)

    def force_N(t_s: float) -> float:
        return 300.0 * t_s

    def rates(t_s: float, x: np.ndarray) -> list[float]:
        body, wheel, body_speed, wheel_speed = x
        spring = SPRING_N_M * (body - wheel) + force_N(t_s)
        road = float(np.interp(t_s, np.arange(len(part.road_N)) * 0.005, part.road_N))
        pushed = spring - TYRE_N_M * wheel - TYRE_N_S_M * wheel_speed + road
        return [body_speed, wheel_speed, -spring / BODY_KG, pushed / WHEEL_KG]

    solved = solve_ivp(rates, (0.0, 1.0), [0.0] * 4, rtol=1e-9, atol=1e-12, max_step=0.005)
    state: list[float] = [0.0] * 4
    for step in range(200):
        state = part.moved(state, (force_N(step * 0.005), force_N((step + 1) * 0.005)), step)
    assert state == pytest.approx(solved.y[:, -1].tolist(), rel=2e-4, abs=1e-7)
    target = part.target(state, force_N(1.0), 200)
    slopes = rates(1.0, np.array(state))
    assert target.acceleration_m_s2 == pytest.approx(slopes[2] - slopes[3], rel=1e-6)


def test_an_order_survives_the_link_to_the_station() -> None:
    request = order(quarter_car(linear_damper(DAMPING)), "model")
    assert HybridOrder.from_json(json.loads(json.dumps(request.to_json()))) == request
    with pytest.raises(TypeError, match="surplus"):
        HybridOrder.from_json({**request.to_json(), "part": {**request.part.to_json(), "surplus": 1}})


@pytest.mark.parametrize("delay_s", [0.006, 0.012])
def test_the_delay_is_measured_before_the_road_begins(delay_s: float) -> None:
    motion, moments = run(order(quarter_car(linear_damper(DAMPING), 1.0), "none"), delay_s=delay_s)
    assert motion.delay_s == pytest.approx(delay_s, abs=1e-3)
    assert moments[0].t_s == pytest.approx(0.0, abs=0.011)
    assert motion.phase is Phase.OVER


def test_an_actuator_later_than_allowed_ends_the_test_before_the_road() -> None:
    motion, moments = run(order(quarter_car(linear_damper(DAMPING), 1.0), "model", delay_s=0.006), delay_s=0.012)
    assert moments == []
    assert motion.problem is not None
    assert motion.problem.limit == 0.006
    assert motion.problem.value == pytest.approx(0.012, abs=1e-3)


def test_every_compensator_but_none_follows_four_times_better_and_the_body_answers_as_the_whole_car() -> None:
    car = quarter_car(linear_damper(DAMPING))
    step_s, ride = car.reference()
    tracking, body = {}, {}
    for name in ("model", "ats", "inverse", "none"):
        motion, moments = run(order(car, name))
        assert motion.problem is None
        rows = np.array(moments)
        expected = np.interp(rows[:, 0], np.arange(len(ride.place)) * step_s, ride.place[:, 0])
        body[name] = float(np.std(rows[:, 3] - expected) / np.std(expected))
        tracking[name] = motion.outcome.tracking
    assert tracking["none"] > 0.08
    assert max(tracking["model"], tracking["ats"]) < min(0.02, 0.25 * tracking["none"])
    assert tracking["inverse"] < 0.25 * tracking["none"]
    assert body["model"] < 0.03 < body["none"]


def test_polynomial_extrapolation_is_led_by_past_targets() -> None:
    request = order(quarter_car(linear_damper(100.0), 2.0), "polynomial", 0.005)
    motion, _ = run(request, damping=100.0, delay_s=0.005)
    plain, _ = run(order(quarter_car(linear_damper(100.0), 2.0), "none", 0.005), damping=100.0, delay_s=0.005)
    assert motion.outcome.tracking < 0.5 * plain.outcome.tracking
    assert set(COMPENSATORS) == {"model", "ats", "inverse", "polynomial", "none"}


def test_the_force_at_rest_is_carried_by_the_springs() -> None:
    """270 N at rest would lower the body by 270 / 40,000 m if it were taken for the damper's answer."""
    _, moments = run(order(quarter_car(linear_damper(DAMPING), 1.0), "model"))
    assert abs(moments[3].body_m) < 1e-4


def test_energy_brought_by_following_wrongly_ends_the_test() -> None:
    request = order(quarter_car(linear_damper(DAMPING)), "none", energy_share=0.01)
    motion, _ = run(request, delay_s=0.02)
    assert motion.problem is not None
    assert abs(motion.problem.value) > motion.problem.limit == 0.01


@pytest.mark.parametrize(("damping", "delay_s"), [(1200.0, 0.030), (1200.0, 0.040), (2500.0, 0.020)])
def test_an_unstable_loop_is_found_by_its_energy_before_it_reaches_a_limit_of_the_machine(
    damping: float, delay_s: float
) -> None:
    """At and beyond the critical delay, without compensation; 44 mm are 1.5 times the forecast travel."""
    machine = {"speed_m_s": 0.8, "acceleration_m_s2": 60.0, "extension_m": 0.044}
    request = order(quarter_car(linear_damper(damping), 2.0), "none", energy_share=0.2, delay_s=0.1, **machine)
    motion, moments = run(request, damping=damping, delay_s=delay_s)
    assert motion.problem is not None
    assert motion.problem.limit == 0.2, motion.problem.text
    assert max(abs(moment.target_m) for moment in moments) < 0.3 * 0.044


@pytest.mark.parametrize("delay_s", [0.005, 0.012, 0.020])
@pytest.mark.parametrize("law", ["viscous", "friction"])
def test_the_energy_that_a_lagging_rod_gives_back_is_no_energy_error(delay_s: float, law: str) -> None:
    """The energy error of a late rod is -F e / 2 or -F e while it moves and 0 once it has stopped."""
    watch = Watch(Bounds(0.1, 5.0, 500.0, 0.2, 0.03, 0.1, 20.0, 1.0, 5.0))
    omega, amplitude_m = 2.0 * math.pi * 3.0, 0.02
    for step in range(200):
        t_s = 0.005 * step
        late_s = max(0.0, t_s - delay_s)
        rod_m, speed_m_s = amplitude_m * math.sin(omega * late_s), amplitude_m * omega * math.cos(omega * late_s)
        force_N = 1500.0 * speed_m_s if law == "viscous" else math.copysign(400.0, speed_m_s)
        x, v = amplitude_m * math.sin(omega * t_s), amplitude_m * omega * math.cos(omega * t_s)
        now = Target(x, v, -(omega**2) * x)
        watch.add(now, Measured(force_N, rod_m), force_N)
        assert watch.problem(now) is None
    assert watch.worst_share < 0.15


def test_a_specimen_that_pushes_where_it_should_hold_ends_the_test_at_its_bounds() -> None:
    motion, moments = run(order(quarter_car(linear_damper(DAMPING)), "model", extension_m=0.06), damping=-3000.0)
    assert motion.problem is not None
    assert max(abs(moment.target_m) for moment in moments[:-1]) <= 0.06


def test_a_test_without_fresh_forces_goes_on_for_two_steps_only() -> None:
    request = order(quarter_car(linear_damper(DAMPING)), "model")
    motion, moments = run(request, seen=lambda force_N, t_s: math.nan if t_s > 3.5 else force_N)
    assert motion.problem is not None
    assert (motion.problem.value, motion.problem.limit) == (3.0, 2.0)
    assert moments


def test_the_rod_returns_to_its_centre_in_the_end() -> None:
    request = order(quarter_car(linear_damper(DAMPING), 1.0), "model")
    motion = HybridMotion(request)
    last, place_m, t_s = None, 0.05, 0.0
    while (sent := motion.at(t_s, Measured(0.0, place_m))) is not None:
        last, place_m, t_s = sent, sent.position_m, t_s + 0.01
    assert last is not None
    assert last.position_m == pytest.approx(0.05, abs=2e-4)
    assert abs(last.velocity_m_s) < 0.03


@pytest.mark.parametrize("compensator", COMPENSATORS)
@pytest.mark.parametrize("spike_N", [3e4, -3e5])
def test_no_set_point_of_a_wrong_force_is_sent_and_the_rod_is_braked_within_its_bounds(
    compensator: str, spike_N: float
) -> None:
    """1 m/s at 50 m/s^2 is 10 mm: so much beyond the last good set-point, which is within 60 mm, and no faster."""
    bounds = {"extension_m": 0.06, "speed_m_s": 1.0, "acceleration_m_s2": 50.0}
    motion = HybridMotion(order(quarter_car(linear_damper(DAMPING)), compensator, **bounds))
    generator = SetpointGenerator(0.05)
    course = Course(motion, lambda t_s, speed_m_s: REST_N + DAMPING * speed_m_s if t_s < 4.0 else spike_N)
    generator.compute(course, 0.0)
    sent = [generator.at(0.01 * k) for k in range(403)]
    assert motion.problem is not None
    generator.halt(4.03)
    sent += [generator.at(0.01 * k) for k in range(403, 450)]
    assert max(abs(place_m - 0.05) for place_m, _ in sent) <= 0.07
    assert max(abs(speed_m_s) for _, speed_m_s in sent) <= 1.0
    assert generator.state is State.HOLD


class Course:
    """A test whose rod is where it was told to be, as the generator of set-points sees it."""

    def __init__(self, motion: HybridMotion, force_N: Callable[[float, float], float]) -> None:
        self.motion, self.force_N = motion, force_N
        self.last = Setpoint(0.05, 0.0)

    def at(self, elapsed_s: float) -> Setpoint | None:
        """The next set-point."""
        force_N = self.force_N(elapsed_s, self.last.velocity_m_s)
        sent = self.motion.at(elapsed_s, Measured(force_N, self.last.position_m))
        if sent is not None:
            self.last = Setpoint(*sent)
        return None if sent is None else self.last


def test_a_lead_that_goes_further_than_the_bounds_is_not_sent() -> None:
    """A set-point led by 8 ms and more is beyond the largest speed before the target is: so the test ends there."""
    request = order(quarter_car(linear_damper(DAMPING)), "none", speed_m_s=0.3)
    watch = Watch(request.bounds)
    assert watch.problem_of_sent(Sent(0.1, 0.29)) is None
    for sent in (Sent(0.1, 0.31), Sent(-0.21, 0.0), Sent(math.nan, 0.0), Sent(0.0, -math.inf)):
        assert watch.problem_of_sent(sent) is not None


def test_no_set_point_is_sent_from_which_a_halt_would_leave_the_travel() -> None:
    """0.4 m/s need 8 mm at 10 m/s^2."""
    watch = Watch(order(quarter_car(linear_damper(DAMPING)), "none", travel_m=0.05, halt_deceleration_m_s2=10.0).bounds)
    for sent in (Sent(0.0415, 0.4), Sent(0.0495, -0.4), Sent(-0.0415, -0.4), Sent(0.0499, 0.0)):
        assert watch.problem_of_sent(sent) is None
    for sent in (Sent(0.0425, 0.4), Sent(-0.0425, -0.4), Sent(0.0501, 0.0)):
        assert watch.problem_of_sent(sent) is not None


def test_the_way_back_begins_as_a_halt_and_goes_no_further() -> None:
    motion = HybridMotion(order(quarter_car(linear_damper(DAMPING), 1.0), "none"))
    course = Course(motion, lambda _, speed_m_s: REST_N + DAMPING * speed_m_s)
    left, back, t_s = Setpoint(0.05, 0.0), [], 0.0
    while (sent := course.at(t_s)) is not None:
        if motion.phase is Phase.RETURN:
            back.append(sent)
        else:
            left = sent
        t_s += 0.01
    assert abs(left.velocity_m_s) > 0.05
    left_m = left.position_m - 0.05
    furthest_m = max(abs(left_m), abs(halted_m(left_m, left.velocity_m_s, 5.0)))
    assert max(abs(place_m - 0.05) for place_m, _ in back) <= furthest_m + 1e-9
    assert abs(back[-1][0] - 0.05) < 1e-4
    slopes = np.gradient([place_m for place_m, _ in back], 0.01)
    np.testing.assert_allclose(slopes[1:-1], [speed for _, speed in back[1:-1]], atol=0.01)


LATE = (1.0,)
EXTRAPOLATED = (4.0, -6.0, 4.0, -1.0)


def steady_after(delay_s: float, damping: float, led: tuple[float, ...] = LATE) -> float:
    """Amplitude of a quarter car with a delayed linear damper: late over early, by Euler's rule in steps of 0.1 ms.

    The damper's rod moves as the sum of the car's speeds one, two ... delays ago, with the weights `led`.
    """
    h = 1e-4
    late = round(delay_s / h)
    x = np.array([0.0, 1e-3, 0.0, 0.0])
    speeds, wheel = [0.0] * (len(led) * late + 1), []
    for _ in range(40_000):
        rod_m_s = sum(weight * speeds[-1 - number * late] for number, weight in enumerate(led, start=1))
        force = SPRING_N_M * (x[0] - x[1]) + damping * rod_m_s
        rates = np.array([
            x[2], x[3], -force / BODY_KG, (force - TYRE_N_M * x[1] - TYRE_N_S_M * x[3]) / WHEEL_KG,
        ])  # fmt: skip
        x[2:] += h * rates[2:]
        x[:2] += h * x[2:]
        speeds.append(float(x[2] - x[3]))
        wheel.append(abs(float(x[1])))
    return max(wheel[-4000:]) / max(wheel[8_000:12_000])


def test_the_critical_delay_is_where_a_delayed_damper_turns_unstable() -> None:
    critical_s = quarter_car(linear_damper(DAMPING)).critical_delay_s()
    assert 0.01 < critical_s < 0.05
    assert steady_after(0.93 * critical_s, DAMPING) < 1.0 < steady_after(1.07 * critical_s, DAMPING)


@pytest.mark.parametrize("damping", [700.0, 2000.0])
def test_extrapolation_turns_unstable_at_its_own_critical_delay(damping: float) -> None:
    car = quarter_car(linear_damper(damping))
    critical_s = car.critical_extrapolated_s()
    assert 0.004 < critical_s < 0.7 * car.critical_delay_s()
    assert steady_after(critical_s - 1e-3, damping, EXTRAPOLATED) < 1.0
    assert steady_after(critical_s + 1e-3, damping, EXTRAPOLATED) > 1.0


def commanded(control: Control, damper: CornerDamper) -> tuple[HybridMotion, list[Moment], list[float]]:
    """A test at 250 steps a second with a law: its course, and the current asked for at each step of the road."""
    car = dataclasses.replace(quarter_car(damper, 2.0), control=control)
    request = dataclasses.replace(order(car, "none", 0.004), control=control)
    motion, moments, currents, place_m, t_s = HybridMotion(request), [], [], 0.05, 0.0
    last_m_s = 0.0
    while (sent := motion.at(t_s, Measured(DAMPING * last_m_s, place_m))) is not None and motion.problem is None:
        place_m, last_m_s, t_s = sent.position_m, sent.velocity_m_s, t_s + 0.004
        if motion.moment is None:
            assert motion.current_A == control.current_A, "outside of the road"
        else:
            moments.append(motion.moment)
            currents.append(motion.current_A)
    assert motion.phase is Phase.OVER
    return motion, moments, currents


def test_skyhook_asks_for_the_whole_current_where_the_damper_can_hold_the_body() -> None:
    """Karnopp: on where the body's speed and the damper's have one sign, off elsewhere; speeds by differences here."""
    control = Control("skyhook", current_A=0.2, most_A=1.5)
    _, moments, currents = commanded(control, linear_damper(DAMPING))
    rows = np.array(moments)
    body, wheel = (np.gradient(rows[:, column], 0.004) for column in (3, 4))
    product = body * (body - wheel)
    clear = np.abs(product) > 0.02 * np.max(np.abs(product))
    assert 0.2 * len(rows) < np.count_nonzero(clear & (product > 0.0)) < 0.8 * len(rows)
    assert np.array_equal(np.array(currents)[clear], np.where(product > 0.0, 1.5, 0.0)[clear])


@pytest.mark.parametrize("rest_A", [0.0, 2.4], ids=["rests at none", "rests at more than the law may ask for"])
def test_the_clipped_inverse_asks_for_the_current_at_which_the_assumed_damper_pulls_what_is_requested(
    rest_A: float,
) -> None:
    known = dampers.parameter_set("demo")
    damper = CornerDamper(dampers.model(known.model), dict(known.values))
    control = Control("inverse", current_A=rest_A, most_A=2.0, sky_share=0.7, damping_N_s_m=2500.0)
    motion, moments, currents = commanded(control, damper)
    rows = np.array(moments)
    body, wheel = (np.gradient(rows[:, column], 0.004)[2:-2] for column in (3, 4))
    request = np.array(currents)[2:-2]
    rest_N = float(damper.model.force_at(damper.values, 0.0, rest_A))
    reached_N = damper.model.force_at(damper.values, body - wheel, request) - rest_N
    target_N = 2500.0 * (0.7 * body - 0.3 * wheel)
    between = (request > 0.05) & (request < 1.95)
    assert np.count_nonzero(between) > 40
    assert np.sqrt(np.mean((reached_N - target_N)[between] ** 2)) < 0.05 * np.std(target_N)
    assert {0.0, 2.0} <= set(request.tolist()), "clipped at both ends"
    assert motion.current_A == rest_A


def test_a_law_that_is_not_requested_between_its_road_and_its_end_leaves_no_current_of_its_own() -> None:
    control = Control("skyhook", current_A=0.2, most_A=1.5)
    car = dataclasses.replace(quarter_car(linear_damper(DAMPING), 2.0), control=control)
    request = dataclasses.replace(order(car, "none"), control=control)
    motion, t_s, place_m = HybridMotion(request), 0.0, 0.05
    while motion.current_A != 1.5:
        place_m = motion.at(t_s, Measured(0.0, place_m)).position_m
        t_s += 0.01
    assert motion.at(request.duration_s + 0.01, Measured(0.0, place_m)) is None
    assert motion.current_A == 0.2


def test_more_current_leaves_less_time_before_the_loop_is_unstable() -> None:
    known = dampers.parameter_set("demo")
    car = quarter_car(CornerDamper(dampers.model(known.model), dict(known.values)))
    alone = dataclasses.replace(car, control=Control(current_A=1.0)).critical_delay_s()
    assert dataclasses.replace(car, control=Control("skyhook", most_A=1.0)).critical_delay_s() == pytest.approx(alone)
    assert alone < 0.8 * car.critical_delay_s()
