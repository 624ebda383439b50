"""A sensor against the controller's own input: gain, offset, lag and compliance found together, with honest errors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from rig.signals.arrays import TimeSeries
from rig.signals.delay_estimation.cycle_match import CycleStretch, cycle_series, match_cycles
from rig.signals.delay_estimation.sample_match import Match
from rig.signals.fourier import series_of


@dataclass(frozen=True)
class Pair:
    """One point: sensors at 250 Hz and the controller's record of force and position, both of one true motion.

    The position input is late by `position_late_s`, the force input by `force_late_s`; the displacement sensor sits
    behind a load train of `compliance_m_N`; the load cell picks up hum.
    """

    seed: int = 0
    frequency_Hz: float = 1.0
    amplitude_m: float = 0.02
    cycles: int = 6
    yield_N: float = 300.0
    damping: float = 800.0
    force_late_s: float = 0.0
    position_late_s: float = 0.0
    gain: float = 1.0
    zero_N: float = 0.0
    lvdt_gain: float = 1.0
    compliance_m_N: float = 0.0
    hum_N: float = 0.0
    poll_s: float = 0.01
    force_noise_N: float = 10.0
    step_N: float = 0.0

    def position(self, time_s: np.ndarray) -> np.ndarray:
        return self.amplitude_m * np.sin(math.tau * self.frequency_Hz * time_s)

    def force(self, time_s: np.ndarray) -> np.ndarray:
        phase = math.tau * self.frequency_Hz * time_s
        speed = np.cos(phase)
        peak_m_s = math.tau * self.frequency_Hz * self.amplitude_m
        return self.damping * peak_m_s * speed + self.yield_N * np.tanh(18.0 * (speed + 0.05 * np.sign(np.sin(phase))))

    @cache  # noqa: B019 - a frozen value, asked several times
    def matches(self) -> tuple[Match | None, Match | None]:
        """Force and displacement as laid over the controller's record."""
        random = np.random.default_rng((self.seed, 5))
        length_s = self.cycles / self.frequency_Hz
        cycles = CycleStretch(0.0, length_s, 1.0 / self.frequency_Hz)
        time_s = np.arange(-0.05, length_s + 0.05, 0.004) + random.uniform(0.0, 0.004)
        at_s = np.arange(random.uniform(0.0, self.poll_s), length_s, self.poll_s)
        hum_N = self.hum_N * np.sin(math.tau * 50.0 * time_s + random.uniform(0.0, math.tau))
        cell_N = self.gain * self.force(time_s) + self.zero_N + hum_N + 5.0 * random.standard_normal(len(time_s))
        if self.step_N > 0.0:
            cell_N = self.step_N * np.round(cell_N / self.step_N)
        lvdt_m = self.lvdt_gain * (self.position(time_s) + self.compliance_m_N * self.force(time_s))
        lvdt_m += 5e-6 * random.standard_normal(len(time_s))
        force_N = self.force(at_s - self.force_late_s) + self.force_noise_N * random.standard_normal(len(at_s))
        position_m = self.position(at_s - self.position_late_s) + 10e-6 * random.standard_normal(len(at_s))
        force, displacement = cycle_series(time_s, cell_N, cycles), cycle_series(time_s, lvdt_m, cycles)
        assert force is not None
        assert displacement is not None
        return (
            match_cycles(TimeSeries(at_s, force_N), force, cycles, reach_s=0.03),
            match_cycles(TimeSeries(at_s, position_m), displacement, cycles, reach_s=0.03, force=force),
        )


SEEDS = range(24)


def deviations(pairs: list[Pair], of: str, expected: float, which: int = 0) -> np.ndarray:
    """Errors over stated standard deviations."""
    found = [pair.matches()[which] for pair in pairs]
    return np.array([
        (getattr(match, of) - expected) / getattr(match, f"{of}_std" if of != "lag_s" else "lag_std_s")
        for match in found if match is not None
    ])


def honest(errors: np.ndarray) -> None:
    assert len(errors) > 0.9 * len(SEEDS)
    assert np.abs(errors).max() < 4.0
    assert 0.5 < np.sqrt(np.mean(errors**2)) < 1.4


@pytest.mark.parametrize("poll_s", [0.01, 0.2])
def test_gain_zero_and_lag_of_a_load_cell_are_found_within_their_deviations(poll_s: float) -> None:
    pairs = [Pair(seed, gain=1.05, zero_N=-150.0, force_late_s=2e-3, poll_s=poll_s, cycles=8) for seed in SEEDS]
    honest(deviations(pairs, "gain", 1.05))
    honest(deviations(pairs, "lag_s", -2e-3))
    honest(deviations(pairs, "offset", -150.0))


def test_gain_of_a_displacement_sensor_is_found_within_its_deviation() -> None:
    honest(deviations([Pair(seed, lvdt_gain=1.03) for seed in SEEDS], "gain", 1.03, 1))


def test_a_load_train_that_gives_way_is_no_delay() -> None:
    pairs = [Pair(seed, compliance_m_N=1e-7) for seed in SEEDS]
    honest(deviations(pairs, "lag_s", 0.0, 1))
    honest(deviations(pairs, "compliance", 1e-7, 1))


def test_a_delay_of_the_position_input_is_no_compliance() -> None:
    pairs = [Pair(seed, position_late_s=1e-3) for seed in SEEDS]
    honest(deviations(pairs, "lag_s", -1e-3, 1))
    honest(deviations(pairs, "compliance", 0.0, 1))


@pytest.mark.few(2)
@pytest.mark.parametrize("frequency_Hz", [0.5, 1.37, 2.0])
@pytest.mark.parametrize("yield_N", [300.0, 20.0])
def test_hum_on_the_load_cell_is_no_knowledge_of_its_lag(frequency_Hz: float, yield_N: float) -> None:
    errors = deviations(
        [Pair(seed, hum_N=40.0, frequency_Hz=frequency_Hz, yield_N=yield_N) for seed in SEEDS], "lag_s", 0.0
    )
    assert np.abs(errors).max() < 4.0
    assert np.sqrt(np.mean(errors**2)) < 1.5


def test_noise_makes_no_knowledge_of_the_lag_of_a_force_that_hardly_changes() -> None:
    found = [Pair(seed, frequency_Hz=0.5, yield_N=0.0, damping=100.0).matches()[0] for seed in SEEDS]
    errors = [match.lag_s / match.lag_std_s for match in found if match is not None]
    assert np.abs(errors).max() < 4.0
    assert min(match.lag_std_s for match in found if match is not None) > 5e-3


@pytest.mark.few(1)
@pytest.mark.parametrize("step_N", [5.0, 20.0])
def test_a_coarse_resolution_is_in_the_deviations(step_N: float) -> None:
    errors = deviations([Pair(seed, step_N=step_N, yield_N=60.0) for seed in SEEDS], "lag_s", 0.0)
    assert np.abs(errors).max() < 4.5
    assert np.sqrt(np.mean(errors**2)) < 1.5


def test_noise_alone_makes_a_harmonic_in_one_of_a_hundred_series() -> None:
    time_s = np.arange(0.0, 10.0, 0.004)
    false = 0
    for seed in range(200):
        random = np.random.default_rng(seed)
        values = np.sin(math.tau * time_s) + 0.3 * random.standard_normal(len(time_s))
        series = series_of(time_s, values, 1.0)
        assert series is not None
        assert 1 in series.orders
        false += len(series.orders) > 1
    assert false <= 8


def test_a_line_apart_from_the_motion_is_not_in_its_series() -> None:
    time_s = np.arange(0.0, 8.0, 0.004)
    values = 100.0 * np.sin(math.tau * time_s) + 30.0 * np.sin(3.0 * math.tau * time_s)
    values += 40.0 * np.sin(50.0 * math.tau * time_s) + np.random.default_rng(0).standard_normal(len(time_s))
    series = series_of(time_s, values, 1.0)
    assert series is not None
    assert series.orders.tolist() == [1, 3]
