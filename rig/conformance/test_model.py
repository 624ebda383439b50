"""Requirements for a damper model (`rig.dampers.DamperModel`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from rig.dampers import DamperModel, model
from rig.dampers.arrays import FloatArray
from rig.dampers.kernel import advance_of
from rig.dampers.separation import MotionScale, Separation
from rig.identification import Measurement, identify
from rig.identification.models.model_slope import modelled_force

SCALE = MotionScale(0.02, 0.3, 0.8, 0.0, 2.0, 0.002)
CURRENTS_A = (0.0, 1.0, 2.0)
FITTED_A = (0.0, 0.7, 1.3, 2.0)
NOISE_N = 5.0
SPLIT_A = 0.8  # current at which the columns of a split are looked at


@dataclass(frozen=True)
class Sine:
    """Cycles of a sine, sampled: arrays (n,) in SI."""

    u_m: FloatArray
    v_m_s: FloatArray
    a_m_s2: FloatArray
    dt_s: float
    samples_per_cycle: int

    @property
    def current_A(self) -> FloatArray:
        """The current at which its columns are looked at."""
        return np.full(self.u_m.shape, SPLIT_A)


def sine(frequency_Hz: float = 2.0, rate_Hz: float = 1000.0, cycles: float = 3.0, amplitude_m: float = 0.02) -> Sine:
    """A sine that begins a little after mid-stroke, where some models' force jumps."""
    omega = 2.0 * np.pi * frequency_Hz
    t = np.arange(round(cycles * rate_Hz / frequency_Hz)) / rate_Hz + 1e-4
    u_m, v_m_s = amplitude_m * np.sin(omega * t), amplitude_m * omega * np.cos(omega * t)
    return Sine(u_m, v_m_s, -(omega**2) * u_m, 1.0 / rate_Hz, round(rate_Hz / frequency_Hz))


@pytest.fixture
def damper(model_name: str) -> DamperModel:
    """The model to try."""
    return model(model_name)


def force_N(damper: DamperModel, motion: Sine, current_A: float = 1.0, **changes: float) -> FloatArray:
    """The demonstration's force along a motion."""
    values = {**damper.demonstration, **changes}
    return damper.force(values, motion.u_m, motion.v_m_s, motion.a_m_s2, current_A, motion.dt_s)


def split(damper: DamperModel) -> Separation:
    """How it splits; skips the test for one that does not."""
    form = damper.separation(SCALE)
    if form is None:
        pytest.skip("the model has no separable parameters")
    return form


def test_parameters_have_units_and_starts_within_their_limits(damper: DamperModel) -> None:
    assert len(set(damper.names)) == len(damper.names)
    assert damper.equation
    for parameter in damper.parameters:
        assert parameter.unit, parameter.name
        assert parameter.meaning, parameter.name
        assert parameter.low <= parameter.start <= parameter.high, parameter.name
        assert parameter.low < parameter.high, parameter.name
        assert not parameter.at_zero or parameter.at_zero in damper.names, parameter.name


def test_the_demonstration_is_complete_and_within_the_limits(damper: DamperModel) -> None:
    assert set(damper.demonstration) == set(damper.names)
    for parameter in damper.parameters:
        assert parameter.low <= damper.demonstration[parameter.name] <= parameter.high, parameter.name


def test_a_vector_and_its_values_are_inverse_and_wrong_names_are_refused(damper: DamperModel) -> None:
    assert damper.values(damper.vector(damper.demonstration)) == pytest.approx(damper.demonstration)
    with pytest.raises(KeyError):
        damper.vector({**damper.demonstration, "no such parameter": 1.0})
    with pytest.raises(KeyError):
        damper.vector({})


@pytest.mark.parametrize("current_A", CURRENTS_A)
def test_the_force_is_finite_repeatable_and_as_long_as_the_motion(damper: DamperModel, current_A: float) -> None:
    motion = sine()
    once, again = force_N(damper, motion, current_A), force_N(damper, motion, current_A)
    assert once.shape == motion.u_m.shape
    assert np.all(np.isfinite(once))
    assert np.array_equal(once, again)
    rest = np.zeros(50)
    assert np.all(np.isfinite(damper.force(damper.demonstration, rest, rest, rest, current_A, 1e-3)))


@pytest.mark.parametrize("current_A", CURRENTS_A)
def test_the_equation_is_the_kernel_that_the_simulated_rig_steps(damper: DamperModel, current_A: float) -> None:
    motion = sine(rate_Hz=8000.0, cycles=1.5)
    whole = force_N(damper, motion, current_A)
    vector, state = damper.vector(damper.demonstration), damper.initial_state(float(motion.u_m[0]))
    advance = advance_of(damper)
    samples = zip(motion.u_m, motion.v_m_s, motion.a_m_s2, strict=True)
    steps = np.array([
        advance(vector, state, u, v, a, current_A, motion.dt_s if at else 0.0) for at, (u, v, a) in enumerate(samples)
    ])
    assert np.max(np.abs(steps - whole)) < 2e-3 * np.max(np.abs(whole))


def test_the_force_does_not_depend_on_the_step_of_integration(damper: DamperModel) -> None:
    coarse, fine = sine(rate_Hz=1000.0), sine(rate_Hz=8000.0)
    difference = force_N(damper, coarse) - force_N(damper, fine)[::8]
    assert np.sqrt(np.mean(difference**2)) < 5e-3 * np.max(np.abs(force_N(damper, fine)))


def test_the_force_is_linear_in_every_parameter_that_says_so(damper: DamperModel) -> None:
    split(damper)
    motion = sine()
    middle = force_N(damper, motion)
    for parameter in damper.parameters:
        if parameter.linear:
            value = damper.demonstration[parameter.name]
            step = 0.1 * max(abs(value), abs(parameter.start), 1.0)
            above, below = (force_N(damper, motion, **{parameter.name: value + sign * step}) for sign in (1.0, -1.0))
            bend = np.max(np.abs(above + below - 2.0 * middle))
            assert bend < 1e-6 * np.max(np.abs(middle)), f"{parameter.name} is declared linear"


@pytest.mark.parametrize("current_A", CURRENTS_A)
def test_a_settled_cycle_takes_energy_out(damper: DamperModel, current_A: float) -> None:
    motion = sine(frequency_Hz=1.0, rate_Hz=2000.0)
    last = slice(-motion.samples_per_cycle, None)
    work_J = float(np.sum(force_N(damper, motion, current_A)[last] * motion.v_m_s[last])) * motion.dt_s
    assert work_J > 0.0, "a damper must dissipate energy"


def test_a_split_model_is_its_force(damper: DamperModel) -> None:
    form, motion = split(damper), sine()
    shape = form.shape_of(damper.demonstration)
    linear = np.linspace(1.0, 2.0, len(form.fixed_names) + len(form.yield_names))
    values = form.values(linear, shape)
    complete = {**{name: damper.demonstration[name] for name in damper.names}, **values}
    current = motion.current_A
    columns = [form.fixed_columns(motion.u_m, motion.v_m_s, motion.a_m_s2, current)]
    yielding = form.yielding(motion, slice(None), shape, slope=False)
    columns += [
        (column * SPLIT_A**power)[:, None]
        for column, count in zip(yielding, form.powers, strict=True) for power in range(count)
    ]
    force = damper.force(complete, motion.u_m, motion.v_m_s, motion.a_m_s2, current, motion.dt_s)
    last = slice(-motion.samples_per_cycle, None)
    difference = np.hstack(columns)[last] @ linear - force[last]
    assert np.max(np.abs(difference)) < 2e-3 * np.max(np.abs(force))


def test_slopes_of_the_split_are_its_differences(damper: DamperModel) -> None:
    form, motion = split(damper), sine()
    shape = form.shape_of(damper.demonstration)
    slopes = form.yielding(motion, slice(None), shape, slope=True)[len(form.powers) :]
    bent = [(at, place) for at, places in enumerate(form.bends) for place in places]
    for (at, place), slope in zip(bent, slopes, strict=True):
        step = np.zeros(shape.size)
        step[at] = 1e-5 * max(abs(shape[at]), 1e-3)
        above, below = (
            form.yielding(motion, slice(None), shape + sign * step, slope=False)[place] for sign in (1.0, -1.0)
        )
        difference = (above - below) / (2.0 * step[at])
        assert np.max(np.abs(slope - difference)) <= 2e-2 * np.max(np.abs(difference)), form.shape_names[at]


def test_a_fit_finds_the_truth_again(damper: DamperModel) -> None:
    """Eight tests of the demonstration with 5 N of noise: fitted to the noise, the truth inside the intervals."""
    random, tests = np.random.default_rng(3), []
    for current_A in FITTED_A:
        for frequency_Hz in (0.5, 2.0):
            motion = sine(frequency_Hz, 250.0, 2.0, 0.05)
            test = Measurement(
                id=f"{current_A:g} A, {frequency_Hz:g} Hz", u_m=motion.u_m, v_m_s=motion.v_m_s, a_m_s2=motion.a_m_s2,
                force_N=np.zeros_like(motion.u_m), current_A=np.full_like(motion.u_m, current_A), dt_s=0.004,
                amplitude_m=0.05, frequency_Hz=frequency_Hz, nominal_current_A=current_A,
                samples_per_cycle=motion.samples_per_cycle, noise_N=NOISE_N,
            )  # fmt: skip
            true_N = modelled_force(damper, damper.demonstration, test)
            test.force_N[:] = true_N + random.normal(0.0, NOISE_N, true_N.size)
            tests.append(test)
    fit = identify(tests, model=damper.name)
    assert fit.error.rmse_N < 1.15 * NOISE_N, "the residual must be within the noise"
    known = [name for name in fit.identifiable if name in damper.demonstration]
    assert known, "at least one parameter must be identifiable"
    for name in known:
        estimate, truth = fit.parameters[name], damper.demonstration[name]
        assert estimate.simultaneous_low is not None
        assert estimate.simultaneous_high is not None
        width = estimate.simultaneous_high - estimate.simultaneous_low
        assert estimate.simultaneous_low - width <= truth <= estimate.simultaneous_high + width, name
