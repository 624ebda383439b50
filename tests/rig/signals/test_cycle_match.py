"""All cycles together: their period, and what a wider lag says of the compliance that goes with it."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from rig.signals.arrays import FloatArray
from rig.signals.delay_estimation.cycle_match import CycleStretch, refined
from rig.signals.delay_estimation.delay_model import at_likely_compliance
from rig.signals.delay_estimation.sample_match import Match


def triangle_m(time_s: FloatArray, period_s: float) -> FloatArray:
    return 8e-3 * (4.0 * np.abs(np.mod(time_s / period_s, 1.0) - 0.5) - 1.0)


def sine_m(time_s: FloatArray, period_s: float) -> FloatArray:
    return 8e-3 * np.sin(2.0 * np.pi * time_s / period_s)


@pytest.mark.parametrize("wave", [triangle_m, sine_m])
@pytest.mark.parametrize("cycles", [2.05, 4.98, 5.5, 11.3])
@pytest.mark.parametrize("change", [0.0, 3e-4])
def test_the_period_is_that_of_the_motion_wherever_in_a_cycle_the_stretch_ends(
    wave: object, cycles: float, change: float
) -> None:
    assert callable(wave)
    random, period_s = np.random.default_rng(1), 0.4 * (1.0 + change)
    time_s = np.arange(0.0, 0.4 * cycles + 0.1, 0.004)
    values = wave(time_s - 0.123, period_s) + 5e-6 * random.standard_normal(len(time_s))
    found = refined(CycleStretch(0.05, 0.05 + 0.4 * cycles, 0.4), time_s, values)
    assert abs(found.period_s / period_s - 1.0) * cycles < 3e-4, "the cycles lie over each other to 0.1 ms"


def test_a_long_record_takes_little_more_memory_than_its_samples() -> None:
    """A converter may take 2 GiB, and an hour at 1 kHz has 3.6 million samples."""
    time_s = np.arange(400_000) * 1e-3
    values = triangle_m(time_s, 0.4)
    tracemalloc.start()
    refined(CycleStretch(0.05, 399.9, 0.4), time_s, values)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak / len(time_s) < 100.0, "bytes a sample"


@pytest.mark.parametrize("value", [0.0, 5.0, np.nan])
def test_what_stalls_shows_no_period(value: float) -> None:
    time_s, cycles = np.arange(0.0, 3.0, 0.004), CycleStretch(0.05, 2.9, 0.4)
    assert refined(cycles, time_s, np.full_like(time_s, value)) == cycles


def test_what_makes_a_lag_unsure_turns_no_load_train_into_another() -> None:
    """Force and speed of a triangle are proportional: 3 ms of lag look like 1 um/N of compliance, in any mixture."""
    slope_s_N_m, compliance_std, own_s = 3000.0, 2e-7, 1e-5
    laid = Match(
        3000.0 * 8e-7, float(np.hypot(slope_s_N_m * compliance_std, own_s)), 0.0, 0.0, 0.0, 1.0, 500,
        compliance=8e-7, compliance_std=compliance_std, coupling=slope_s_N_m * compliance_std**2,
    )
    for factor in (1.0, 2.0, 5.0):
        wide = laid.widened(factor * laid.lag_std_s)
        lag_s, std_s = at_likely_compliance(
            wide.lag_s, wide.lag_std_s, wide.compliance, wide.compliance_std, wide.coupling
        )
        assert wide.lag_std_s == pytest.approx(factor * laid.lag_std_s)
        assert abs(lag_s) < 2.0 * std_s, "by the stiffness that load trains have, nothing is late"
        assert std_s < 5e-4, "and that is known, however unsure the two are alone"
