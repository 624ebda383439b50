"""Cycles told from measured displacement: ramps, rests, offsets and noise."""

import math

import numpy as np
import pytest

from rig.signals import cycles as cycles_of
from rig.signals.cycles import NoCycles, find_cycles, full_cycles, kept_cycles, measured_motion


def ramped_sine(
    cycles: int, frequency_Hz: float, offset_m: float = 0.003, noise_m: float = 5e-6
) -> tuple[np.ndarray, np.ndarray]:
    """A program as the rig runs it: rest, one ramp-in cycle, full cycles, one ramp-out cycle, rest."""
    t = np.arange(0.0, (cycles + 2) / frequency_Hz + 1.0, 0.004)
    phase = (t - 0.5) * frequency_Hz
    envelope = np.clip(phase, 0.0, 1.0) * np.clip(cycles + 2 - phase, 0.0, 1.0)
    noise = np.random.default_rng(1).normal(0.0, noise_m, t.size)
    return t, offset_m + 0.05 * envelope * np.sin(2.0 * np.pi * phase) + noise


@pytest.mark.parametrize("frequency_Hz", [0.5, 1.0, 2.0])
def test_ten_full_cycles_are_found_and_eight_are_kept(frequency_Hz: float) -> None:
    t, u = ramped_sine(10, frequency_Hz)
    cycles = find_cycles(t, u)
    assert len(full_cycles(cycles)) == 10
    kept = kept_cycles(cycles)
    assert len(kept) == 8
    assert kept.start_s[0] == pytest.approx(0.5 + 2.0 / frequency_Hz, abs=2e-4)
    assert kept.frequency_Hz == pytest.approx(frequency_Hz, rel=1e-3)
    assert kept.amplitude_m == pytest.approx(0.05, rel=1e-3)
    assert kept.mean_m == pytest.approx(0.003, abs=5e-6)


def test_rests_of_any_length_and_level_do_not_move_the_mean() -> None:
    t, u = ramped_sine(6, 1.0)
    rest = np.full(5000, 0.02)
    time = np.arange(t.size + 5000) * 0.004
    assert kept_cycles(find_cycles(time, np.concatenate((u, rest)))).mean_m == pytest.approx(0.003, abs=5e-6)


def test_noise_around_the_mean_makes_no_crossings() -> None:
    t, u = ramped_sine(4, 0.5, noise_m=5e-4)
    assert len(full_cycles(find_cycles(t, u))) == 4


def test_samples_that_are_not_numbers_are_skipped() -> None:
    t, u = ramped_sine(6, 1.0)
    u[700:720] = np.nan
    assert len(kept_cycles(find_cycles(t, u))) == 4


def test_a_given_level_is_used_as_it_is() -> None:
    t, u = ramped_sine(6, 1.0)
    assert find_cycles(t, u, mean_m=0.01).mean_m == 0.01


def test_a_single_movement_is_refused_by_name() -> None:
    with pytest.raises(NoCycles, match="upwards 1 time"):
        find_cycles(np.arange(0.0, 1.0, 0.01), np.linspace(-0.02, 0.02, 100))
    with pytest.raises(NoCycles, match="at least 8"):
        find_cycles(np.arange(5.0), np.ones(5))


def test_two_full_cycles_are_too_few_to_drop_the_first_and_last() -> None:
    t, u = ramped_sine(2, 1.0)
    with pytest.raises(NoCycles, match="2 cycles at full amplitude; more than 2"):
        kept_cycles(find_cycles(t, u))


def test_a_motion_stopped_while_it_ramped_in_has_no_full_cycle() -> None:
    t = np.arange(0.0, 6.6, 0.004)
    u = 0.01 * t * np.sin(2.0 * np.pi * t)
    with pytest.raises(NoCycles, match="full amplitude"):
        find_cycles(t, u)
    assert measured_motion(t, u) is None


def harmonics_by_singular_values(t: np.ndarray, u: np.ndarray, frequency_Hz: float) -> np.ndarray:
    """Mean and complex harmonics 1 to 9, by numpy's own least squares over written-out sines."""
    turns = 2.0 * math.pi * frequency_Hz * (t - t[0])
    columns = [np.ones_like(t)]
    for order in range(1, 10):
        columns += [np.cos(order * turns), np.sin(order * turns)]
    found = np.linalg.lstsq(np.stack(columns, axis=1), u, rcond=None)[0]
    return np.concatenate(([found[0] + 0j], found[2::2] + 1j * found[1::2]))


@pytest.mark.parametrize("missing", ["none", "every second for a while", "the last eighth"])
@pytest.mark.parametrize("samples", [60, 97, 1000])
def test_the_shape_of_a_cycle_is_that_of_its_singular_values(samples: int, missing: str) -> None:
    random = np.random.default_rng(samples)
    frequency_Hz, amplitude_m = 3.7, 2e-5
    t = (np.arange(2 * samples) / 2.0 + random.uniform(-0.1, 0.1, 2 * samples)) / (samples * frequency_Hz)
    t = t[::2] if missing == "none" else t
    if missing == "every second for a while":
        t = np.delete(t, np.arange(20, samples, 2))
    if missing == "the last eighth":
        t = t[: -samples // 4]
    phases = 2.0 * math.pi * frequency_Hz * t + 0.4
    u = 0.03 + amplitude_m * (np.sin(phases) + 0.05 * np.sin(3.0 * phases) + random.normal(0.0, 0.01, t.size))
    _, mean_m, _, phase_rad, distortion = cycles_of._cycle(t, u, frequency_Hz, cycles_of.SINE, frequency_Hz)
    mean, first, *higher = harmonics_by_singular_values(t, u, frequency_Hz)
    assert mean_m == pytest.approx(mean.real, abs=1e-9 * amplitude_m)
    began_rad = math.atan2(first.imag, first.real) - 2.0 * math.pi * frequency_Hz * t[0]
    assert math.remainder(phase_rad - began_rad, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert distortion == pytest.approx(np.sqrt(np.sum(np.abs(higher) ** 2)) / abs(first), abs=1e-9)


@pytest.mark.parametrize("rate_Hz", [50.0, 250.0, 5000.0])
@pytest.mark.parametrize("cut", [-0.03, 0.0, 0.03])
@pytest.mark.parametrize("last", [0, 1])
def test_a_record_cut_at_its_crossings_has_all_its_cycles(rate_Hz: float, cut: float, last: int) -> None:
    t = np.arange(int(3 * rate_Hz) + last) / rate_Hz
    noise = np.random.default_rng(3).normal(0.0, 1e-5, t.size)
    found = find_cycles(t, 0.02 * np.sin(2.0 * np.pi * (t + cut)) + noise)
    assert len(found) == (3 if cut == 0.0 else 2)
    assert found.frequency_Hz == pytest.approx(1.0, rel=2e-3)


@pytest.mark.parametrize("rest", [3, 10, 100])
@pytest.mark.parametrize("rate_Hz", [7.0, 250.0])
def test_a_motion_that_starts_from_rest_has_no_crossing_there(rest: int, rate_Hz: float) -> None:
    motion = np.sin(2.0 * np.pi * np.arange(int(3 * rate_Hz)) / rate_Hz)
    u = 0.02 * np.concatenate((np.zeros(rest), motion, np.zeros(rest)))
    found = find_cycles(np.arange(u.size) / rate_Hz, u)
    assert found.start_s - rest / rate_Hz == pytest.approx([1.0, 2.0], abs=0.1 / rate_Hz)
