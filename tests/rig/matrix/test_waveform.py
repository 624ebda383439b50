"""Waveforms as values: what they say of themselves agrees with their samples; an unknown one is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rig.signals.waveform import HOLD, SINE, TRIANGLE, WAVEFORMS, UnknownWaveform, Waveform, waveform_named
from rig.test_point import TestPoint

ALL = pytest.mark.parametrize("waveform", WAVEFORMS.values(), ids=WAVEFORMS)


@ALL
def test_it_begins_at_0_goes_up_and_has_unit_amplitude(waveform: Waveform) -> None:
    position, velocity, _ = waveform.shape(np.arange(4000) / 4000)
    assert position[0] == pytest.approx(0.0, abs=1e-12)
    assert velocity[0] > 0.0
    assert (np.max(position), np.min(position)) == pytest.approx((1.0, -1.0))


@ALL
def test_velocity_and_acceleration_are_derivatives_of_the_position_between_corners(waveform: Waveform) -> None:
    phase = (np.arange(20_000) + 0.5) / 20_000
    position, velocity, acceleration = waveform.shape(phase)
    smooth = np.abs(np.diff(velocity)) < 0.1
    assert np.allclose(np.diff(position)[smooth] * 20_000, 0.5 * (velocity[1:] + velocity[:-1])[smooth], atol=1e-3)
    middle = 0.5 * (acceleration[1:] + acceleration[:-1])[smooth]
    assert np.allclose(np.diff(velocity)[smooth] * 20_000, middle, atol=1e-2)


@ALL
def test_a_table_plays_the_same_motion(waveform: Waveform) -> None:
    table_m = waveform.table_m(0.02)
    position, _, _ = waveform.shape(np.linspace(0.0, 1.0, 1001))
    played = np.interp(np.linspace(0.0, 1.0, 1001), np.linspace(0.0, 1.0, len(table_m) + 1), [*table_m, table_m[0]])
    assert np.max(np.abs(played - 0.02 * position)) < 0.02 * 1e-3


def test_peaks_are_those_of_the_equations() -> None:
    assert (SINE.peak_velocity, SINE.peak_acceleration) == pytest.approx((math.tau, math.tau**2))
    assert (TRIANGLE.peak_velocity, TRIANGLE.peak_acceleration) == pytest.approx((4.0, 160.0))
    assert (HOLD.peak_velocity, HOLD.peak_acceleration) == (0.0, 0.0)


def test_harmonics_are_those_of_the_series() -> None:
    assert (SINE.fundamental, TRIANGLE.fundamental) == pytest.approx((1.0, 8.0 / math.pi**2))
    assert [SINE.harmonic(order) for order in (1, 2, 3)] == pytest.approx([1.0, 0.0, 0.0])
    expected = [1.0, 0.0, -1.0 / 9.0, 0.0, 1.0 / 25.0, 0.0, -1.0 / 49.0]
    assert [TRIANGLE.harmonic(order) for order in range(1, 8)] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("name", ["", "Sine", "square", "table", "sine "])
def test_an_unknown_waveform_is_refused(name: str) -> None:
    with pytest.raises(UnknownWaveform, match="known: sine, triangle"):
        waveform_named(name)
    with pytest.raises(UnknownWaveform):
        _ = TestPoint("p001", name, 0.02, 1.0, 0.0).shape
