"""Several motions in one record are told apart; one motion, a sweep and random motion are not split."""

from __future__ import annotations

import numpy as np
import pytest

from rig.signals.motions import motions_of

RATE_Hz = 200.0


def played(*pieces: tuple[float, float, float], noise_m: float = 5e-6, rest_s: float = 0.0) -> tuple[np.ndarray, ...]:
    """Time and displacement of sines (amplitude m, frequency Hz, cycles) one after the other, with rests between."""
    parts = [np.zeros(20)]
    for amplitude_m, frequency_Hz, cycles in pieces:
        t = np.arange(round(cycles / frequency_Hz * RATE_Hz)) / RATE_Hz
        parts += [amplitude_m * np.sin(2.0 * np.pi * frequency_Hz * t), np.zeros(round(rest_s * RATE_Hz))]
    x = np.concatenate(parts)
    return np.arange(x.size) / RATE_Hz, x + np.random.default_rng(0).normal(0.0, noise_m, x.size)


@pytest.mark.parametrize("rest_s", [0.0, 2.0])
@pytest.mark.parametrize("pieces", [
    ((0.02, 0.5, 4), (0.02, 1.0, 5), (0.02, 2.0, 6)),
    ((0.03, 2.5, 5), (0.012, 1.5, 20)),
    ((0.05, 1.0, 5), (0.002, 5.0, 10), (0.05, 1.0, 5)),
])
def test_each_motion_is_found_with_its_size(pieces: tuple[tuple[float, float, float], ...], rest_s: float) -> None:
    found = motions_of(*played(*pieces, rest_s=rest_s)).steady
    assert len(found) == len(pieces)
    for motion, (amplitude_m, frequency_Hz, cycles) in zip(found, pieces, strict=True):
        assert motion.amplitude_m == pytest.approx(amplitude_m, rel=0.02)
        assert motion.frequency_Hz == pytest.approx(frequency_Hz, rel=0.01)
        assert cycles - 2 <= motion.cycles <= cycles


def test_steps_of_the_current_part_one_motion() -> None:
    t, x = played((0.02, 1.0, 20))
    current_A = np.where(t < 10.0, 0.25, 1.0)
    assert len(motions_of(t, x).steady) == 1
    low, high = motions_of(t, x, current_A, current_tolerance_A=0.02).steady
    assert (low.current_A, high.current_A) == (0.25, 1.0)


def test_one_motion_with_ramps_a_sweep_and_random_motion_are_not_parted() -> None:
    t = np.arange(0.0, 40.0, 1.0 / RATE_Hz)
    ramped = 0.02 * np.clip(t / 4.0, 0.0, 1.0) * np.clip((40.0 - t) / 4.0, 0.0, 1.0) * np.sin(2.0 * np.pi * t)
    assert len(motions_of(t, ramped).steady) == 1
    assert not motions_of(t, 0.01 * np.sin(2.0 * np.pi * (0.5 * t + 0.1 * t**2))).steady
    assert not motions_of(t, 0.01 * np.sin(2.0 * np.pi * (1.0 * t + 0.004 * t**2))).steady
    smooth = np.convolve(np.random.default_rng(1).normal(size=t.size), np.hanning(80), "same")
    assert not motions_of(t, 1e-3 * smooth).steady
    assert motions_of(t, np.zeros(t.size)).steady == ()


def test_one_odd_cycle_does_not_part_a_motion() -> None:
    t, x = played((0.02, 1.0, 20))
    x[(t > 9.3) & (t < 9.8)] *= 0.8
    (motion,) = motions_of(t, x).steady
    assert motion.cycles >= 16
