"""Long tests by their mean cycles: the same fit, the same intervals, the recorded samples' errors."""

from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.identification import Measurement, identify
from rig.identification.models.measurement import samples_a_cycle
from rig.identification.models.model_slope import FittedModel
from rig.identification.models.projection import Weighting
from rig.identification.models.solving import Method, solve
from rig.identification.models.undetermined import examine
from rig.identification.points import mean_cycles as module
from rig.identification.points.inputs import fit_inputs
from rig.identification.points.mean_cycles import mean_cycles
from rig.identification.uncertainty.covariance import information

NOISE_N = 5.0
WITHOUT_JUMP = {**parameter_set("demo").values, "delta": 0.0}


def long_test(
    frequency_Hz: float = 1.0, current_A: float = 0.5, seed: int = 1, values: dict[str, float] | None = None
) -> Measurement:
    """70,000 samples of a sine at 1 kHz of the demo damper."""
    rate_Hz, omega, count = 1000.0, 2.0 * np.pi * frequency_Hz, 70_000
    phase = omega / rate_Hz * np.arange(count)
    u, v, a = 0.03 * np.sin(phase), 0.03 * omega * np.cos(phase), -0.03 * omega**2 * np.sin(phase)
    current = np.full(count, current_A)
    force = model("asymmetric").force(values or parameter_set("demo").values, u, v, a, current, 1.0 / rate_Hz)
    return Measurement(
        id=f"p{seed}", u_m=u, v_m_s=v, a_m_s2=a, current_A=current, dt_s=1.0 / rate_Hz, amplitude_m=0.03,
        force_N=force + np.random.default_rng(seed).normal(0.0, NOISE_N, count), frequency_Hz=frequency_Hz,
        nominal_current_A=current_A, noise_N=NOISE_N, samples_per_cycle=round(rate_Hz / frequency_Hz),
    )


@pytest.mark.parametrize("frequency_Hz", [1.0, 0.7123, 0.043])
def test_a_mean_is_the_value_at_its_phase_and_its_scatter_is_that_of_the_recorded_samples(frequency_Hz: float) -> None:
    """Whole samples in a cycle; parts of one; so slow a cycle that neighbours are averaged too."""
    test = long_test(frequency_Hz, values=WITHOUT_JUMP)
    means = mean_cycles(test)
    assert means.means is not None
    assert means.u_m.size < 0.7 * test.u_m.size
    omega, time_s = 2.0 * np.pi * frequency_Hz, means.dt_s * np.arange(means.u_m.size)
    assert means.dt_s * samples_a_cycle(means.u_m) == pytest.approx(1.0 / frequency_Hz, rel=1e-6)
    np.testing.assert_allclose(means.u_m, 0.03 * np.sin(omega * time_s), atol=3e-8)
    np.testing.assert_allclose(means.v_m_s, 0.03 * omega * np.cos(omega * time_s), atol=1e-6 * omega)
    noise_N = NOISE_N / np.sqrt(means.recorded_each)
    force_N = model("asymmetric").force(
        WITHOUT_JUMP, means.u_m, means.v_m_s, means.a_m_s2, means.current_A, means.dt_s
    )
    assert np.std(means.force_N - force_N) == pytest.approx(noise_N, rel=0.03)
    assert means.sample_noise_N == pytest.approx(noise_N, rel=0.05)
    assert np.hypot(means.scatter_N, noise_N) == pytest.approx(NOISE_N, rel=0.03)
    assert means.recorded_each * means.u_m.size == pytest.approx(test.u_m.size, rel=0.01)


def test_a_fit_to_mean_cycles_is_that_to_all_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Within a quarter of a standard error, of the same size; beside a short test the long ones count as recorded."""
    short = long_test(current_A=1.5, seed=3)
    short = replace(short.rows(slice(0, 3000)), id="short")
    tests = [long_test(), long_test(frequency_Hz=1.9, current_A=1.0, seed=2), short]
    by_means = identify(tests, model="asymmetric", diagnose=False)
    monkeypatch.setattr(module, "LONG", 10**9)
    by_all = identify(tests, model="asymmetric", diagnose=False)
    for name, one in by_all.parameters.items():
        if one.value is None or one.standard_error is None:
            continue
        other = by_means.parameters[name]
        assert other.value == pytest.approx(one.value, abs=0.25 * one.standard_error), name
        assert other.standard_error == pytest.approx(one.standard_error, rel=0.05), name
    assert (by_means.adequate, by_all.adequate) == (True, True)
    assert by_means.error.rmse_N == pytest.approx(by_all.error.rmse_N, rel=2e-3)
    assert by_means.error.mae_N == pytest.approx(by_all.error.mae_N, rel=1e-2)
    assert by_means.error.nrmse_percent_of_peak == pytest.approx(by_all.error.nrmse_percent_of_peak, rel=2e-3)
    assert [test.samples for test in by_means.error.per_test] == pytest.approx([70_000, 70_000, 3000], rel=0.01)
    assert sum("mean cycles of" in one for one in by_means.warnings) == 2


def test_what_does_not_repeat_or_is_asked_sample_by_sample_is_not_averaged() -> None:
    test = long_test()
    growing = test.moved(test.u_m * np.linspace(1.0, 1.01, test.u_m.size), test.v_m_s, test.a_m_s2)
    assert mean_cycles(growing) is growing
    changing = replace(test, current_A=np.linspace(0.0, 1.0, test.u_m.size))
    assert mean_cycles(changing) is changing
    doubtful = replace(test, samples_per_cycle=900)  # which is not the period of its motion
    assert mean_cycles(doubtful) is doubtful
    short = test.rows(slice(0, 65_000))
    assert mean_cycles(short) is short
    assert fit_inputs([test], None, (), every_sample=True).fitted[0] is test


def test_lost_samples_leave_holes_and_change_nothing_else() -> None:
    test = long_test()
    usable = np.ones(test.u_m.size, dtype=bool)
    usable[np.arange(test.u_m.size) % 1000 < 30] = False  # the same 30 ms of every cycle
    usable[2000:2500] = False
    means = mean_cycles(replace(test, usable=usable))
    assert means.usable is not None
    assert not np.any(means.usable[np.arange(means.u_m.size) % 1000 < 30])
    assert np.mean(means.usable) == pytest.approx(0.97, abs=0.02)


def test_a_force_that_jumps_within_an_interval_is_not_averaged() -> None:
    """At mid-stroke, where the demo damper jumps by hundreds of newtons at low speed: its RMSE would be 25 % larger."""
    assert mean_cycles(long_test(2.5 / 70.0)).means is None
    smooth = {**WITHOUT_JUMP, "beta": 5.0}
    assert mean_cycles(long_test(2.5 / 70.0, values=smooth)).means is not None


def test_few_samples_in_a_cycle_are_averaged_only_where_they_have_the_same_phases() -> None:
    """Between them the force is not known; and of 12 intervals, those within 1.5 of a jump would be nearly all."""
    assert mean_cycles(long_test(1000.0 / 40.1)).means is None
    same_phases = mean_cycles(long_test(1000.0 / 12.0))
    assert same_phases.means is not None
    assert not same_phases.means.spread
    without_guard, guarded = Weighting(), Weighting(guard_s=1e-4)
    assert np.mean(without_guard.counting(same_phases, 0)) == 1.0
    assert np.mean(guarded.counting(same_phases, 0)) == pytest.approx(10 / 12, abs=0.01)


def test_a_drift_of_clock_and_force_does_not_prevent_averaging() -> None:
    test = long_test(1.000001)
    heated = replace(test, force_N=test.force_N * np.linspace(1.0, 0.8, test.u_m.size))
    assert mean_cycles(heated).means is not None


@pytest.mark.parametrize("current_A", [0.0, 0.5])
def test_the_errors_of_a_drifting_test_are_those_of_all_samples(
    current_A: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """140 cycles whose force falls by a fifth: the standard errors include that, also by means of 8 cycles."""
    monkeypatch.setattr(module, "KEPT", 8192)
    whole = long_test(2.0, current_A)
    drifting = replace(whole, force_N=whole.force_N * np.linspace(1.0, 0.8, whole.u_m.size))
    chosen = model("asymmetric")
    errors = []
    for test in (drifting, mean_cycles(drifting)):
        findings = examine(chosen, [test])
        values = solve(chosen, [test], Method(), findings).values
        fitted = FittedModel(chosen, values, tuple(name for name in findings.free(chosen.names) if name != "eta"))
        known = information(fitted, [test], Weighting())
        errors.append([known.standard_error(name) for name in known.names])
    np.testing.assert_allclose(errors[1], errors[0], rtol=0.1)
