"""Standard damper tests on dampers whose answers are known in closed form."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.characteristics.force_table import ForceTable, force_tables
from rig.characteristics.loop import Measured, characterise_loop
from rig.characteristics.summary import Characteristics, characterise, dynamic_range, friction_of
from rig.identification.points.preparation import prepare
from rig.identification.uncertainty.scoring import cycle_energy_J
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

RATE_HZ, AMPLITUDE_M = 500.0, 0.02


def viscous(damping_N_s_m: float, frequency_Hz: float, gas_N: float = 0.0, current_A: float = 0.0) -> RecordedPoint:
    """A sine on a viscous damper with gas force and 1 N of noise; `damping_N_s_m` in both directions."""
    time_s = np.arange(0.0, 8.0 / frequency_Hz, 1.0 / RATE_HZ)
    omega = math.tau * frequency_Hz
    noise = np.random.default_rng(1).standard_normal(len(time_s))
    return RecordedPoint.from_arrays(
        time_s=time_s,
        displacement_m=AMPLITUDE_M * np.sin(omega * time_s),
        force_N=gas_N + damping_N_s_m * AMPLITUDE_M * omega * np.cos(omega * time_s) + noise,
        id=f"p-{frequency_Hz:g}-{current_A:g}",
        waveform="sine",
        amplitude_m=AMPLITUDE_M,
        frequency_Hz=frequency_Hz,
        current_A=current_A,
        sample_rate_Hz=RATE_HZ,
    )


def test_a_viscous_dampers_energy_damping_and_peak_forces_are_the_closed_form() -> None:
    loop = characterise_loop(viscous(800.0, 1.5, gas_N=-120.0))
    speed_m_s = AMPLITUDE_M * math.tau * 1.5
    assert loop.peak_speed_m_s == pytest.approx(speed_m_s, rel=1e-3)
    assert loop.energy_J.value == pytest.approx(math.pi * 800.0 * math.tau * 1.5 * AMPLITUDE_M**2, rel=2e-3)
    assert loop.equivalent_damping_N_s_m.value == pytest.approx(800.0, rel=2e-3)
    assert loop.rebound_N.value == pytest.approx(-120.0 + 800.0 * speed_m_s, abs=5.0 * loop.rebound_N.std)
    assert loop.jounce_N.value == pytest.approx(-120.0 - 800.0 * speed_m_s, abs=5.0 * loop.jounce_N.std)
    assert loop.rebound_N.std < 0.5
    assert loop.force_scatter_N == pytest.approx(1.0, rel=0.2)
    exact_J = math.pi * 800.0 * math.tau * 1.5 * AMPLITUDE_M**2
    assert 0.0 < loop.energy_J.std < 0.01 * exact_J
    assert abs(loop.energy_J.value - exact_J) < 4.0 * loop.energy_J.std + 1e-3 * exact_J
    assert loop.peak_force_N == pytest.approx((loop.rebound_N.value, loop.jounce_N.value), abs=3.0)


def test_the_force_of_a_triangle_is_that_of_its_constant_velocity_and_not_of_its_overshoot() -> None:
    rate_Hz, frequency_Hz, speed_m_s = 500.0, 1.0, 0.1
    time_s = np.arange(0.0, 8.0 / frequency_Hz, 1.0 / rate_Hz)
    since_s = (time_s + 0.25 / frequency_Hz) % (0.5 / frequency_Hz)
    side = np.where((time_s + 0.25 / frequency_Hz) % (1.0 / frequency_Hz) < 0.5 / frequency_Hz, 1.0, -1.0)
    settling = np.exp(-since_s / 0.02) * np.cos(since_s / 0.02)  # a position loop after a corner
    velocity_m_s = side * speed_m_s * (1.0 - 2.0 * settling)
    point = RecordedPoint.from_arrays(
        time_s=time_s, displacement_m=np.cumsum(velocity_m_s) / rate_Hz, velocity_m_s=velocity_m_s,
        force_N=2000.0 * velocity_m_s - 50.0, id="cv", waveform="triangle",
        amplitude_m=speed_m_s / (4.0 * frequency_Hz), frequency_Hz=frequency_Hz, current_A=0.0, sample_rate_Hz=rate_Hz,
    )  # fmt: skip
    loop = characterise_loop(point)
    assert np.max(np.abs(velocity_m_s)) > 1.05 * speed_m_s
    assert loop.peak_speed_m_s == pytest.approx(speed_m_s, rel=2e-3)
    assert (loop.rebound_N.value, loop.jounce_N.value) == pytest.approx((150.0, -250.0), abs=1.0)
    assert loop.peak_force_N.rebound_N > 155.0


def test_the_force_table_has_a_row_for_each_velocity_and_a_column_for_each_current() -> None:
    loops = [
        characterise_loop(viscous(damping, frequency_Hz, -50.0, current_A))
        for damping, current_A in ((500.0, 0.0), (1500.0, 1.0)) for frequency_Hz in (2.0, 1.0)
    ]
    again = replace(loops[0], id="repeat")
    (table,) = force_tables([*loops[:3], again])
    assert (table.kind, table.currents_A, table.constant_stroke) == ("peak velocity", (0.0, 1.0), True)
    assert [row.frequency_Hz for row in table.rows] == [1.0, 2.0]
    assert table.rows[1].speed_m_s == pytest.approx(AMPLITUDE_M * math.tau * 2.0, rel=1e-3)
    assert table.rows[0].cells[1] is None  # 1 Hz was not run at 1 A
    cell = table.rows[1].cells[0]
    assert cell is not None
    assert cell.points == ("p-2-0", "repeat")
    assert cell.rebound_N == pytest.approx(500.0 * AMPLITUDE_M * math.tau * 2.0 - 50.0, abs=1.0)
    assert cell.compression_N == pytest.approx(-500.0 * AMPLITUDE_M * math.tau * 2.0 - 50.0, abs=1.0)
    assert 0.0 < cell.rebound_std_N < loops[0].rebound_N.std
    unknown = replace(loops[0], waveform="triangle", rebound_N=Measured(math.nan, math.nan, math.nan))
    tables = force_tables([unknown, *loops])
    assert [one.kind for one in tables] == ["peak velocity", "constant velocity"]
    written = json.loads(json.dumps([one.to_json() for one in tables], allow_nan=False))
    assert written[1]["rows"][0]["cells"][0]["rebound_N"] is None
    assert ForceTable.from_json(written[0]) == tables[0]
    assert [row["cells"][0]["tests"] for row in table.to_json()["rows"]] == [1, 2]
    assert (table.averaged, tables[0].averaged, table.rows[1].tests) == (True, False, "mean of 1 to 2")


@pytest.mark.parametrize("rate_Hz", [250.0, 1000.0, 10_000.0])
@pytest.mark.parametrize("knee_m_s", [0.01, 0.05, 10.0])
def test_the_steepest_change_of_force_is_that_of_the_reversal(rate_Hz: float, knee_m_s: float) -> None:
    omega, noise_N = math.tau * 1.0, 3.0
    time_s = np.arange(0.0, 9.0, 1.0 / rate_Hz)
    speed_m_s = AMPLITUDE_M * omega * np.cos(omega * time_s)
    yield_N = 800.0 * math.hypot(1.0, knee_m_s / 0.1)
    point = RecordedPoint.from_arrays(
        time_s=time_s,
        displacement_m=AMPLITUDE_M * np.sin(omega * time_s),
        force_N=yield_N * np.tanh(speed_m_s / knee_m_s)
        + noise_N * np.random.default_rng(4).standard_normal(len(time_s)),
        id="loop", waveform="sine", amplitude_m=AMPLITUDE_M, frequency_Hz=1.0, current_A=1.0,
    )  # fmt: skip
    exact_N_s = yield_N / knee_m_s * AMPLITUDE_M * omega**2
    assert characterise_loop(point).steepest_N_s == pytest.approx(exact_N_s, rel=0.1)


def test_dynamic_range_is_the_ratio_of_forces_without_the_gas_force() -> None:
    loops = [characterise_loop(viscous(500.0, 1.0, -200.0)), characterise_loop(viscous(1500.0, 1.0, -200.0, 1.0))]
    (found,) = dynamic_range(loops)
    assert found.current_A == 1.0
    assert (found.rebound, found.jounce) == (pytest.approx(3.0, rel=5e-3), pytest.approx(3.0, rel=5e-3))


def test_without_a_loop_at_no_current_there_is_no_range() -> None:
    assert dynamic_range([characterise_loop(viscous(1500.0, 1.0, current_A=1.0))]) == []


@pytest.mark.parametrize(("gas_N", "friction_N", "stiffness_N_m"), [(-270.0, 35.0, 0.0), (150.0, 8.0, 2000.0)])
def test_gas_force_friction_and_gas_spring_come_from_a_slow_triangle(
    gas_N: float, friction_N: float, stiffness_N_m: float
) -> None:
    frequency_Hz = 0.25
    time_s = np.arange(0.0, 16.0, 1.0 / RATE_HZ)
    phase = time_s * frequency_Hz
    displacement_m = 0.005 * 2.0 / math.pi * np.arcsin(np.sin(math.tau * phase))
    speed_m_s = 0.005 * np.sign(np.cos(math.tau * phase))
    noise = np.random.default_rng(2).standard_normal(len(time_s))
    point = RecordedPoint.from_arrays(
        time_s=time_s,
        displacement_m=displacement_m,
        velocity_m_s=speed_m_s,
        force_N=gas_N + friction_N * np.sign(speed_m_s) + stiffness_N_m * displacement_m + noise,
        id="friction",
        waveform="triangle",
        amplitude_m=0.005,
        frequency_Hz=frequency_Hz,
        current_A=0.0,
    )
    found = friction_of(point)
    assert found.gas_force_N.value == pytest.approx(gas_N, abs=0.3)
    assert found.friction_N.value == pytest.approx(friction_N, abs=0.3)
    assert found.stiffness_N_m.value == pytest.approx(stiffness_N_m, abs=60.0)
    assert found.speed_m_s == pytest.approx(0.005, rel=1e-6)


@pytest.mark.parametrize("rate_Hz", [250.0, 1000.0, 10_000.0])
@pytest.mark.parametrize("speed_m_s", [1e-4, 1e-3, 1e-2])
def test_friction_and_gas_force_do_not_depend_on_sampling_rate_or_speed(rate_Hz: float, speed_m_s: float) -> None:
    amplitude_m = 5e-4 if speed_m_s < 1e-3 else 3e-3
    frequency_Hz = speed_m_s / (4.0 * amplitude_m)
    time_s = np.arange(0.0, 4.3 / frequency_Hz, 1.0 / rate_Hz)
    rng = np.random.default_rng(round(rate_Hz + 1e6 * speed_m_s))
    phase = np.clip(time_s * frequency_Hz - 0.1, 0.0, None)
    true_m = amplitude_m * 2.0 / math.pi * np.arcsin(np.sin(math.tau * phase))
    up = np.where((phase % 1.0 < 0.25) | (phase % 1.0 >= 0.75), 1.0, -1.0)
    displacement_m = 0.002 + true_m + 5e-6 * rng.standard_normal(len(time_s))
    point = RecordedPoint.from_arrays(
        time_s=time_s,
        displacement_m=displacement_m,
        force_N=-270.0 + 40.0 * up + 5.0 * rng.standard_normal(len(time_s)),
        id="slow", waveform="triangle", amplitude_m=amplitude_m, frequency_Hz=frequency_Hz, current_A=0.0,
    )  # fmt: skip
    found = friction_of(point)
    for measured, exact_N in ((found.friction_N, 40.0), (found.gas_force_N, -270.0)):
        assert measured.value == pytest.approx(exact_N, abs=1.0)
        assert measured.scatter < 1.0
        assert abs(measured.value - exact_N) < 10.0 * measured.std + 0.01
    assert found.speed_m_s == pytest.approx(speed_m_s, rel=2e-3)


def test_everything_can_be_written_as_json_without_nan() -> None:
    loop = characterise_loop(viscous(800.0, 1.5))
    found = Characteristics((loop,), (), (), None, ("p009: invalid",))
    text = json.dumps(found.to_json(), allow_nan=False)
    assert json.loads(text)["signature"] == [loop.id]


@pytest.mark.parametrize("frequency_Hz", [1.0549, 0.5049, 3.3])
@pytest.mark.parametrize("share", [1.0, 0.95, 1.04])
def test_energy_and_damping_follow_the_measured_period_not_the_nominal_one(frequency_Hz: float, share: float) -> None:
    point = replace(viscous(800.0, frequency_Hz, gas_N=-270.0), frequency_Hz=share * frequency_Hz)
    loop = characterise_loop(point)
    exact_J = math.pi * 800.0 * math.tau * frequency_Hz * AMPLITUDE_M**2
    assert loop.energy_J.value == pytest.approx(exact_J, rel=2e-3)
    assert loop.equivalent_damping_N_s_m.value == pytest.approx(800.0, rel=3e-3)
    measured = prepare(point)
    assert cycle_energy_J(measured, measured.force_N) == pytest.approx(loop.energy_J.value, rel=1e-9)


def test_a_short_test_of_two_kept_cycles_has_the_energy_of_one_cycle() -> None:
    point = viscous(800.0, 1.0)
    short = point.time_s < 4.6
    cut = RecordedPoint.from_arrays(
        time_s=point.time_s[short], displacement_m=point.displacement_m[short], force_N=point.force_N[short],
        id="short", waveform="sine", amplitude_m=AMPLITUDE_M, frequency_Hz=1.0, current_A=0.0,
    )  # fmt: skip
    measured = prepare(cut)
    exact_J = math.pi * 800.0 * math.tau * AMPLITUDE_M**2
    assert cycle_energy_J(measured, measured.force_N) == pytest.approx(exact_J, rel=5e-3)


def with_a_load_cell_of(range_N: float, point: RecordedPoint) -> RecordedPoint:
    """The point as a load cell records it that stands still beyond its range."""
    return replace(point, arrays={**(point.arrays or {}), "force": np.clip(point.force_N, -range_N, range_N)})


def test_a_saturated_force_leaves_energy_and_peak_force_unknown_and_says_so(tmp_path: Path) -> None:
    passive, strong = viscous(800.0, 1.0), with_a_load_cell_of(248.0, viscous(2000.0, 1.0, current_A=1.0))
    found = characterise(Run(tmp_path, (passive, strong)))
    loop = found.loops[1]
    assert math.isnan(loop.energy_J.value)
    assert math.isnan(loop.equivalent_damping_N_s_m.value)
    assert math.isnan(loop.rebound_N.value)
    assert found.dynamic_range == ()
    assert any(strong.id in line and "energy per cycle" in line for line in found.left_out)
    assert json.loads(json.dumps(found.to_json(), allow_nan=False))["loops"][1]["energy_J"]["value"] is None


def test_a_force_cut_off_before_its_noise_leaves_its_peak_unknown_and_says_so(tmp_path: Path) -> None:
    random, passive, strong = np.random.default_rng(1), viscous(800.0, 1.0), viscous(2000.0, 1.0, current_A=1.0)

    def noisy(point: RecordedPoint) -> RecordedPoint:
        force_N = point.force_N + random.normal(0.0, 1.5, point.force_N.size)
        return replace(point, arrays={**(point.arrays or {}), "force": force_N})

    cut = noisy(with_a_load_cell_of(120.0, strong))
    found = characterise(Run(tmp_path, (noisy(passive), cut)))
    assert [math.isnan(loop.rebound_N.value) for loop in found.loops] == [False, True]
    assert math.isnan(found.loops[1].energy_J.value)
    assert found.dynamic_range == ()
    assert any("+120 N, within noise" in line for line in found.left_out)
    assert characterise(Run(tmp_path, (noisy(passive), noisy(strong)))).left_out == ()


def test_a_peak_force_unknown_in_one_direction_leaves_the_other_ratio_standing() -> None:
    one_sided = viscous(1500.0, 1.0, current_A=1.0)
    cut = replace(one_sided, arrays={**(one_sided.arrays or {}), "force": np.minimum(one_sided.force_N, 183.0)})
    (found,) = dynamic_range([characterise_loop(viscous(500.0, 1.0)), characterise_loop(cut)])
    assert found.to_json()["rebound"] is None
    assert found.jounce == pytest.approx(3.0, rel=2e-2)


def test_a_few_lost_samples_leave_the_energy_as_it_was() -> None:
    whole = viscous(800.0, 1.5)
    force_N = whole.force_N.copy()
    force_N[np.random.default_rng(3).choice(len(force_N), 100, replace=False)] = np.nan
    lossy = characterise_loop(replace(whole, arrays={**(whole.arrays or {}), "force": force_N}))
    assert lossy.energy_J.value == pytest.approx(characterise_loop(whole).energy_J.value, rel=2e-3)


def test_a_single_cycle_of_no_whole_number_of_samples_has_its_whole_energy() -> None:
    """Half a sample near the greatest power was missing, and half a sample of the period: 2 % at 59.5 samples."""
    time_s = np.arange(0.0, 3.9 / 2.0, 1.0 / 119.0)
    phase = 4.0 * np.pi * time_s + 1.0
    x_m, v_m_s = 0.009 * np.sin(phase), 0.036 * np.pi * np.cos(phase)
    point = RecordedPoint.from_arrays(
        id="p1", waveform="sine", amplitude_m=0.009, frequency_Hz=2.0, current_A=0.0, time_s=time_s, displacement_m=x_m,
        force_N=400.0 * v_m_s,
    )
    loop = characterise_loop(point)
    assert loop.cycles == 1
    assert loop.equivalent_damping_N_s_m.value == pytest.approx(400.0, rel=0.003)
