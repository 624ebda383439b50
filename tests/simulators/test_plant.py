from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.roles import Command
from rig import dampers
from rig.errors import RigError
from rig.identification import Measurement, identify
from simulators.options import DamperOptions, RigOptions, with_option
from simulators.plant.plant import MAXIMUM_STEPS, Plant, specimen_model
from simulators.plant.records import EVENT_PULSE
from simulators.plant.step import (
    BODY_TEMPERATURE,
    COIL_TEMPERATURE,
    DAMPER_DISPLACEMENT,
    DAMPER_FORCE,
    DISPLACEMENT,
    FORCE,
    PISTON,
    VELOCITY,
)

if TYPE_CHECKING:
    from tests.simulators.conftest import Bench


T, X, V, F, CURRENT, TEMPERATURE = range(6)


UNLOADED = ("servo.stiffness_N_m=0", "servo.piston_area_m2=1e3", "servo.accumulator_sag_Pa_m3=0")
"""Neither force nor flow changes what the servo does."""


def harmonic(time_s: np.ndarray, x: np.ndarray, frequency_Hz: float) -> tuple[float, float]:
    """Amplitude and phase (rad, against sin(2 pi f t)) of the fundamental."""
    turn = 2 * np.pi * frequency_Hz * time_s
    design = np.column_stack([np.sin(turn), np.cos(turn), np.ones_like(turn)])
    (sine, cosine, _), *_ = np.linalg.lstsq(design, x, rcond=None)
    return math.hypot(sine, cosine), math.atan2(cosine, sine)


@pytest.mark.parametrize("frequency_Hz", [1.0, 2.0, 5.0, 10.0])
def test_servo_droops_and_lags_as_its_second_order_loop_says(
    make_bench: Callable[..., Bench], frequency_Hz: float
) -> None:
    bench = make_bench(*UNLOADED).ready()
    bench.start(0.005, frequency_Hz, 8)
    began_s = bench.plant.time_s
    rows = bench.run(10 / frequency_Hz)
    inside = (rows[:, T] > began_s + 2 / frequency_Hz) & (rows[:, T] <= began_s + 8 / frequency_Hz)
    amplitude, phase = harmonic(rows[inside, T] - began_s, rows[inside, X], frequency_Hz)
    ratio = frequency_Hz / 30.0
    expected = 1 / (1 - ratio**2 + 2j * 0.7 * ratio)
    assert amplitude == pytest.approx(0.005 * abs(expected), rel=2e-3)
    assert phase == pytest.approx(np.angle(expected), abs=2e-3)


def test_triangle_holds_the_speed_4fA_between_its_corners(bench: Bench) -> None:
    bench.start(0.02, 0.5, 4, waveform=1)
    rows = bench.run(12.0)
    began_s = next(time_s for time_s, kind, _ in bench.events if kind == EVENT_PULSE)
    phase = (rows[:, T] - began_s) * 0.5
    straight = (phase > 2.1) & (phase < 2.2)
    assert rows[straight, V] == pytest.approx(4 * 0.5 * 0.02, rel=1e-3)
    falling = (phase > 2.4) & (phase < 2.6)
    assert rows[falling, V] == pytest.approx(-4 * 0.5 * 0.02, rel=1e-3)


def test_pulses_mark_each_cycle_start_and_the_end_to_the_microsecond(bench: Bench) -> None:
    bench.start(0.01, 1.3, 3)
    bench.run(6.0)
    pulses = [time_s for time_s, kind, _ in bench.events if kind == EVENT_PULSE]
    assert len(pulses) == 6
    assert np.diff(pulses) == pytest.approx(np.full(5, 1 / 1.3), abs=1e-6)


def test_force_is_the_models_own_along_the_motion_that_happened(bench: Bench) -> None:
    bench.plant.order(coil_A=1.0)
    bench.run(1.0)
    bench.start(0.03, 1.0, 3)
    rows = bench.run(5.0)
    chosen = dampers.parameter_set("demo")
    model = dampers.model(chosen.model)
    dt_s = bench.plant.dt_s
    acceleration = np.diff(rows[:, V], prepend=rows[0, V]) / dt_s
    expected = model.force(chosen.values, rows[:, X], rows[:, V], acceleration, rows[:, CURRENT], dt_s)
    assert rows[1:, F] == pytest.approx(expected[1:], abs=1e-6)


def test_dissipated_energy_is_the_loop_area_and_heats_the_damper(bench: Bench) -> None:
    bench.start(0.05, 1.0, 5)
    before_J, before_degC = bench.plant.value("dissipated_J"), bench.plant.value("temperature_degC")
    rows = bench.run(8.0)
    loop_J = np.trapezoid(rows[:, F], rows[:, X])
    assert bench.plant.value("dissipated_J") - before_J == pytest.approx(loop_J, rel=2e-3)
    rise = bench.plant.value("temperature_degC") - before_degC
    assert rise == pytest.approx(loop_J / 1500.0, rel=0.1)


@pytest.mark.few(1)
@pytest.mark.parametrize("model", sorted(dampers.MODELS))
def test_every_model_drives_the_plant_and_dissipates(make_bench: Callable[..., Bench], model: str) -> None:
    bench = make_bench(f'damper.model="{model}"', "plant_rate_Hz=4000.0").ready()
    bench.plant.order(coil_A=0.5)
    bench.run(0.5)
    assert bench.start(0.02, 1.0, 2).name == "DONE"
    began_s = bench.plant.time_s
    rows = bench.run(4.5)
    assert np.all(np.isfinite(rows))
    whole = (rows[:, T] > began_s + 1) & (rows[:, T] <= began_s + 3)
    assert np.trapezoid(rows[whole, F], rows[whole, X]) > 1.0


def test_coil_follows_its_first_order_lag_exactly(bench: Bench) -> None:
    bench.plant.order(coil_A=2.0)
    began_s = bench.plant.time_s
    rows = bench.run(0.2)
    assert rows[:, CURRENT] == pytest.approx(2.0 * (1 - np.exp(-25.0 * (rows[:, T] - began_s))), abs=1e-9)


def test_the_fluid_follows_the_coil_with_a_lag_of_its_own_where_it_has_one() -> None:
    """Two lags of 40 ms and 8 ms behind each other; without the option, the damper gets the coil's current itself."""
    for lag_s in (0.0, 0.008):
        options = RigOptions()
        plant = Plant(replace(options, damper=replace(options.damper, fluid_lag_s=lag_s)))
        plant.order(coil_A=2.0)
        plant.advance(400)
        t_s, coil_s = plant.time_s, 0.04
        expected_A = 2.0 * (1.0 - math.exp(-t_s / coil_s))
        assert plant.value("current_A") == pytest.approx(expected_A, abs=1e-9)
        if lag_s:
            both = coil_s * math.exp(-t_s / coil_s) - lag_s * math.exp(-t_s / lag_s)
            expected_A = 2.0 * (1.0 - both / (coil_s - lag_s))
        assert plant.value("fluid_A") == pytest.approx(expected_A, abs=5e-3 if lag_s else 1e-9)


def test_coil_current_is_bounded_by_supply_over_resistance(bench: Bench) -> None:
    bench.plant.order(coil_A=20.0)
    bench.run(1.0)
    warmer_K = bench.plant.value("coil_degC") - 20.0
    assert bench.plant.value("current_A") == pytest.approx(13.5 / (1.5 * (1 + 0.0039 * warmer_K)), rel=1e-3)


def test_load_cell_sees_the_moving_mass(make_bench: Callable[..., Bench]) -> None:
    light, heavy = make_bench().ready(), make_bench("moving_mass_kg=10.0").ready()
    for each in (light, heavy):
        each.start(0.02, 2.0, 3)
    a, b = light.run(2.5), heavy.run(2.5)
    acceleration = np.diff(b[:, V], prepend=b[0, V]) / heavy.plant.dt_s
    assert (b[:, F] - a[:, F])[1:] == pytest.approx(10.0 * acceleration[1:], abs=0.5)


def test_force_pushes_the_rod_against_the_loops_stiffness(make_bench: Callable[..., Bench]) -> None:
    """What a current changes of the force, it changes of the motion too: once over the stiffness."""
    amplitudes_m = []
    for current_A in (0.0, 2.0):
        bench = make_bench("servo.friction_N=0").ready()
        bench.plant.order(coil_A=current_A)
        bench.run(0.5)
        bench.start(0.005, 1.0, 4)
        rows = bench.run(7.0)
        inside = (rows[:, T] > rows[0, T] + 2.0) & (rows[:, T] <= rows[0, T] + 5.0)
        amplitudes_m.append(np.ptp(rows[inside, X]) / 2.0)
    assert 10e-6 < amplitudes_m[0] - amplitudes_m[1] < 40e-6


@pytest.mark.parametrize("current_A", [0.0, 0.5, 1.0, 2.0])
def test_a_rod_at_rest_is_at_rest_within_the_valves_overlap(bench: Bench, current_A: float) -> None:
    """Models with `sgn(u)` jump at mid-stroke: a loop that answers the least error would chatter there."""
    bench.plant.order(coil_A=current_A)
    bench.run(0.5)
    bench.start(0.005, 1.0, 2)
    bench.run(5.0)
    rows = bench.run(1.0)[:, 1:]
    assert np.ptp(rows[:, FORCE]) < 1e-6
    assert not np.any(rows[:, VELOCITY])
    assert abs(rows[-1, PISTON]) < 50e-6


def test_an_infinitely_stiff_loop_moves_identical_at_every_current(make_bench: Callable[..., Bench]) -> None:
    motions = []
    for current_A in (0.0, 2.0):
        bench = make_bench(*UNLOADED).ready()
        bench.plant.order(coil_A=current_A)
        bench.run(0.5)
        bench.start(0.005, 1.0, 4)
        motions.append(bench.run(6.0)[:, X])
    assert motions[0] == pytest.approx(motions[1], abs=1e-10)


def test_a_loaded_valve_has_less_gain_so_the_rod_lags_more(make_bench: Callable[..., Bench]) -> None:
    lags = []
    for area in ("1e-3", "0.1e-3"):
        bench = make_bench(f"servo.piston_area_m2={area}", "servo.stiffness_N_m=0").ready()
        began_s = bench.plant.time_s
        bench.start(0.005, 5.0, 8)
        rows = bench.run(2.0)
        inside = (rows[:, T] > began_s + 0.4) & (rows[:, T] <= began_s + 1.6)
        lags.append(-harmonic(rows[inside, T] - began_s, rows[inside, X], 5.0)[1])
    assert lags[1] > 1.05 * lags[0]


def test_a_compliant_load_train_stretches_between_piston_and_lvdt_by_force_over_stiffness(
    make_bench: Callable[..., Bench]
) -> None:
    bench = make_bench("servo.load_train_stiffness_N_m=10e6", "plant_rate_Hz=4000.0").ready()
    bench.plant.order(coil_A=1.0)
    bench.run(0.5)
    bench.start(0.01, 1.0, 2)
    rows = bench.run(3.5)[:, 1:]
    stretch_m = rows[:, PISTON] - rows[:, DISPLACEMENT]
    assert stretch_m == pytest.approx(rows[:, FORCE] / 10e6, abs=1e-12)
    assert np.ptp(stretch_m) > 40e-6
    assert rows[:, DAMPER_DISPLACEMENT] == pytest.approx(rows[:, DISPLACEMENT], abs=1e-7)
    assert np.diff(rows[:, DISPLACEMENT])[100:] / bench.plant.dt_s == pytest.approx(rows[101:, VELOCITY], abs=1e-9)


def test_friction_of_the_piston_moves_the_rod_but_not_the_load_cell(make_bench: Callable[..., Bench]) -> None:
    lost_m = []
    for friction_N in (0.0, 400.0):
        bench = make_bench(f"servo.friction_N={friction_N}", "servo.stiffness_N_m=20e6").ready()
        bench.command(Command.MOVE_TO, target_position=0.02, speed=0.01)
        bench.run(1.0)
        forwards = bench.plant.value("setpoint_m") - bench.plant.value("position_m")
        lost_m.append(forwards - bench.plant.value("cell_force_N") / 20e6)
    assert lost_m[1] - lost_m[0] == pytest.approx(400.0 / 20e6, rel=0.05)


def test_current_heats_the_coil_first_and_the_body_through_it(bench: Bench) -> None:
    """Two nodes: the coil rises by I^2 R over its conductance above the body, with its own time constant of 20 s."""
    bench.plant.order(coil_A=2.0)
    rows = bench.run(120.0)[:, 1:]
    coil, body = rows[:, COIL_TEMPERATURE], rows[:, BODY_TEMPERATURE]
    assert coil[-1] - body[-1] == pytest.approx(4.0 * 1.5 / 3.0, rel=0.05)
    after_20_s = round(20.0 / bench.plant.dt_s)
    assert (coil - body)[after_20_s] == pytest.approx((1 - math.exp(-1)) * (coil[-1] - body[-1]), rel=0.06)
    in_J, out_J = 4.0 * 1.5 * 120.0, 5.0 * 120.0 * (body.mean() - 23.0)
    assert 1500.0 * (body[-1] - 23.0) + 60.0 * (coil[-1] - 23.0) == pytest.approx(in_J - out_J, rel=0.03)


def test_low_pressure_and_load_limit_the_speed(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench("servo.rated_speed_m_s=0.2", "controller.following_error_max_m=0.5").ready()
    bench.start(0.05, 1.0, 3)
    rows = bench.run(5.0)
    assert np.abs(rows[:, V]).max() < 0.2
    assert np.abs(rows[:, V]).max() > 0.15


def test_the_rod_drifts_when_hydraulics_are_off(bench: Bench) -> None:
    from drivers.roles import Command

    bench.command(Command.HYDRAULICS_OFF)
    rows = bench.run(5.0)
    assert rows[-1, X] < rows[0, X] - 0.3e-3
    late_m_s = rows[-1, V]
    assert abs(late_m_s) < abs(rows[4000, V])


def test_compliance_lets_the_damper_move_less_than_the_rod(make_bench: Callable[..., Bench]) -> None:
    stiff, soft = make_bench("plant_rate_Hz=4000.0").ready(), make_bench(
        "plant_rate_Hz=4000.0", "damper.mount_stiffness_N_m=5e5").ready()
    for each in (stiff, soft):
        each.plant.order(coil_A=2.0)
        each.start(0.01, 2.0, 2)
    a, b = stiff.run(2.0), soft.run(2.0)
    assert np.abs(b[:, F]).max() < np.abs(a[:, F]).max() * 1.05
    stretch_m = (soft.plant.value("position_m") - soft.plant.value("damper_u_m"))
    assert stretch_m == pytest.approx(soft.plant.value("damper_force_N") / 5e5, abs=1e-6)


def test_free_play_carries_no_force_inside_its_gap(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench("plant_rate_Hz=4000.0", "damper.free_play_m=0.004", 'damper.values.F0=0.0').ready()
    bench.start(0.02, 1.0, 2)
    rows = bench.run(4.0)
    moving = np.abs(rows[:, V]) > 0.02
    assert np.mean(np.abs(rows[moving, F]) < 1e-9) > 0.02


def test_warm_oil_weakens_the_damper_only_where_the_file_asks(make_bench: Callable[..., Bench]) -> None:
    peaks = []
    for change in (0.0, -0.005):
        bench = make_bench(f"damper.force_change_per_K={change}", "damper.start_degC=63.0").ready()
        bench.plant.order(coil_A=1.0)
        bench.run(0.5)
        bench.start(0.03, 1.0, 2)
        rows = bench.run(3.5)
        peaks.append(np.ptp(rows[:, F]))
    assert peaks[1] / peaks[0] == pytest.approx(1 - 0.005 * 40, abs=0.02)


def test_a_fit_finds_how_fast_warm_oil_weakens_the_plant(make_bench: Callable[..., Bench]) -> None:
    """By the coil's temperature, which is what a rig records; the body's is what weakens the oil."""
    change, ambient_degC, tests = -0.006, 23.0, []
    for start_degC in (25.0, 40.0, 60.0):
        for current in (0.0, 1.5):
            bench = make_bench(f"damper.force_change_per_K={change}", f"damper.start_degC={start_degC}").ready()
            bench.plant.order(coil_A=current)
            bench.run(1.0)
            bench.start(0.03, 1.0, 3)
            bench.run(1.0)
            every = round(0.004 / bench.plant.dt_s)
            rows = bench.run(3.0)[::every]
            u, v = rows[:, 1 + DAMPER_DISPLACEMENT], rows[:, V]
            tests.append(Measurement(
                id=f"{start_degC:g} degC {current:g} A", u_m=u, v_m_s=v, a_m_s2=np.gradient(v, 0.004),
                force_N=rows[:, 1 + DAMPER_FORCE], current_A=rows[:, CURRENT], dt_s=0.004, amplitude_m=0.03,
                frequency_Hz=1.0, nominal_current_A=current, samples_per_cycle=250, noise_N=5.0,
                temperature_degC=rows[:, TEMPERATURE],
            ))  # fmt: skip
    bare, fit = (identify(tests, temperature_law=law, diagnose=False) for law in ("none", "common"))
    assert fit.temperature is not None
    slope = -change / (1.0 + change * (fit.temperature.reference_degC - ambient_degC))
    assert fit.values["k_warm"] == pytest.approx(slope, rel=0.05)
    assert fit.error.rmse_N < 0.2 * bare.error.rmse_N


def test_physics_does_not_depend_on_how_it_is_sliced() -> None:
    whole, sliced = Plant(RigOptions()), Plant(RigOptions())
    for plant in (whole, sliced):
        plant.order(mode=3, pressure=2, amplitude_m=0.01, frequency_Hz=3.0, full_cycles=50, ramp_in_cycles=1,
                    position_min_m=-1, position_max_m=1, speed_max_m_s=9, acceleration_max_m_s2=500, force_max_N=1e6)
        plant.state["accumulator_Pa"] = 210e5
    whole.advance(5000)
    for steps in (1, 2, 997, 3000, 1000):
        sliced.advance(steps)
    assert whole.state.tobytes() == sliced.state.tobytes()


def test_a_slice_longer_than_the_output_is_refused() -> None:
    with pytest.raises(ValueError, match="at most"):
        Plant(RigOptions()).advance(MAXIMUM_STEPS + 1)


def test_unknown_models_and_mismatched_sets_are_named() -> None:
    with pytest.raises(RigError, match="did you mean"):
        specimen_model(DamperOptions(set="demoo"))
    with pytest.raises(ValueError, match="belongs to model"):
        specimen_model(DamperOptions(set="spencer-bingham", model="kwok"))
    with pytest.raises(KeyError, match="nonsense"):
        Plant(with_option(RigOptions(), "damper.values.nonsense=1.0"))
