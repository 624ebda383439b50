"""Statistics of every cycle against the law that made the force."""

from __future__ import annotations

import numpy as np
import pytest

from rig.signals.cycle_statistics import (
    UNITS,
    CycleBounds,
    CycleSamples,
    cycle_bounds,
    cycle_statistics,
    repeated_bounds,
)

AMPLITUDE_M, DAMPING, FRICTION_N, STIFFNESS, MEAN_N = 0.01, 800.0, 120.0, 5000.0, 60.0


def samples(
    frequency_Hz: float = 9.37, rate_Hz: float = 250.0, cycles: int = 40, *, triangle: bool = False, noise: float = 1.0
) -> CycleSamples:
    """Rest, one ramp cycle, cycles at full amplitude, one ramp cycle, rest."""
    random = np.random.default_rng(1)
    time_s = np.arange(int(((cycles + 2) / frequency_Hz + 0.4) * rate_Hz)) / rate_Hz
    done = np.clip((time_s - 0.2) * frequency_Hz, 0.0, cycles + 2.0)
    share = np.clip(np.minimum(done, cycles + 2.0 - done), 0.0, 1.0)
    angle = 2.0 * np.pi * done
    shape, slope = np.sin(angle), 2.0 * np.pi * np.cos(angle)
    if triangle:
        shape, slope = 2.0 / np.pi * np.arcsin(np.sin(angle)), 4.0 * np.sign(np.cos(angle))
    x = AMPLITUDE_M * share * shape
    v = AMPLITUDE_M * share * frequency_Hz * slope
    force = DAMPING * v + FRICTION_N * np.sign(v) + STIFFNESS * x + MEAN_N
    return CycleSamples(
        time_s, x + 2e-6 * noise * random.normal(size=time_s.size), force + noise * random.normal(size=time_s.size),
        np.full(time_s.size, 1.5), np.linspace(20.0, 30.0, time_s.size),
    )


def described(given: CycleSamples, frequency_Hz: float = 9.37, rate_Hz: float = 250.0) -> dict[str, np.ndarray]:
    bounds = cycle_bounds(given.time_s, given.displacement_m, frequency_Hz)
    return cycle_statistics(given, bounds, rate_Hz / frequency_Hz)


def test_every_cycle_at_full_amplitude_is_counted_and_no_ramp() -> None:
    given = samples()
    bounds = cycle_bounds(given.time_s, given.displacement_m, 9.37)
    assert bounds.run == 40
    assert bounds.start_s[0] == pytest.approx(0.2 + 1.0 / 9.37, abs=1e-3)


def test_cycles_whose_offset_grows_until_the_stroke_stops_them_are_counted() -> None:
    """The motion moves away by three amplitudes: of its cycles about the mean of the whole, few crossings are left."""
    given = samples(2.0, cycles=40)
    away_m = 3.0 * AMPLITUDE_M * np.clip((given.time_s - 3.0) / 17.5, 0.0, 1.0)
    bounds = cycle_bounds(given.time_s, given.displacement_m + away_m, 2.0)
    assert 38 <= bounds.run <= 40
    assert np.diff(bounds.start_s) == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize(("frequency_Hz", "rate_Hz"), [(9.37, 250.0), (1.03, 250.0), (10.0, 1000.0)])
def test_the_terms_of_the_force_are_found_cycle_by_cycle(frequency_Hz: float, rate_Hz: float) -> None:
    found = described(samples(frequency_Hz, rate_Hz), frequency_Hz, rate_Hz)
    assert set(found) == set(UNITS)
    assert np.median(found["damping"]) == pytest.approx(DAMPING, rel=0.01)
    assert np.median(found["friction"]) == pytest.approx(FRICTION_N, rel=0.01)
    assert np.median(found["stiffness"]) == pytest.approx(STIFFNESS, rel=0.01)
    assert np.median(found["mean_force"]) == pytest.approx(MEAN_N, abs=0.5)
    assert np.std(found["friction"]) < 6.0


def test_energy_is_the_area_of_the_loop() -> None:
    found = described(samples())
    area_J = np.pi * DAMPING * AMPLITUDE_M**2 * 2.0 * np.pi * 9.37 + 4.0 * FRICTION_N * AMPLITUDE_M
    assert found["energy"] == pytest.approx(area_J, rel=0.02)
    assert found["current"] == pytest.approx(1.5)
    assert np.all(np.diff(found["temperature"]) > 0.0)


def test_peaks_are_those_of_the_samples_without_single_spikes() -> None:
    given = samples(noise=0.0)
    spiked = given.force_N.copy()
    spiked[300] += 5000.0
    found = described(given._replace(force_N=spiked))
    top_N = np.max(given.force_N)
    assert found["force_max"] == pytest.approx(top_N, rel=0.03)
    assert np.max(found["displacement_max"]) == pytest.approx(AMPLITUDE_M, rel=0.01)


def test_a_triangle_does_not_tell_friction_from_viscous_force() -> None:
    given = samples(1.0, triangle=True)
    bounds = cycle_bounds(given.time_s, given.displacement_m, 1.0)
    found = cycle_statistics(given, bounds, 250.0, speed_varies=False)
    assert np.all(np.isnan(found["friction"]))
    assert np.all(np.isnan(found["damping"]))
    assert np.median(found["stiffness"]) == pytest.approx(STIFFNESS, rel=0.02)
    assert np.median(found["mean_force"]) == pytest.approx(MEAN_N, abs=1.0)


def test_cycles_with_missing_samples_are_counted_but_not_described() -> None:
    given = samples(2.0)
    keep = (given.time_s < 5.0) | (given.time_s > 7.1)
    broken = CycleSamples(*(column[keep] for column in given))
    bounds = cycle_bounds(broken.time_s, broken.displacement_m, 2.0)
    found = cycle_statistics(broken, bounds, 125.0)
    assert bounds.run == 40
    assert np.count_nonzero(np.isfinite(found["energy"])) == 40 - 5


def test_no_motion_has_no_cycles() -> None:
    time_s = np.arange(500) / 250.0
    assert cycle_bounds(time_s, np.zeros(500), 2.0).run == 0
    assert cycle_bounds(time_s, np.full(500, np.nan), 2.0).run == 0


def test_repetitions_of_a_signal_that_was_cut_off_are_whole_ones() -> None:
    assert repeated_bounds(1.0, 2.5, 1.0 + 4.1 * 2.5, 100).run == 4
    assert repeated_bounds(1.0, 2.5, 1.0 + 9.0 * 2.5, 5).run == 5
    assert repeated_bounds(1.0, 2.5, 0.5, 5) == CycleBounds(*map(pytest.approx, ([], [])))


@pytest.mark.parametrize("spike_m", [0.6 * AMPLITUDE_M, 2.0 * AMPLITUDE_M, -5.0 * AMPLITUDE_M])
def test_a_spike_of_the_displacement_hides_no_cycles(spike_m: float) -> None:
    given = samples()
    given.displacement_m[600] += spike_m
    bounds = cycle_bounds(given.time_s, given.displacement_m, 9.37)
    assert bounds.run == 40
    statistics = described(given)
    assert np.count_nonzero(np.isfinite(statistics["force_max"])) == 40
    assert np.nanmedian(statistics["friction"]) == pytest.approx(FRICTION_N, rel=0.05)
