"""A single sample that leaves a signal is found; what a damper does in every cycle is none."""

from __future__ import annotations

import numpy as np
import pytest

from rig.signals.arrays import FloatArray
from rig.signals.spikes import spikes

T_S = np.arange(2000) * 0.004
V_M_S = 0.2 * np.cos(6.0 * T_S)
NOISE = np.random.default_rng(3).normal(0.0, 1.0, T_S.size)
CLEAN: dict[str, FloatArray] = {
    "viscous": 900.0 * V_M_S, "knee": 200.0 * np.tanh(V_M_S / 1e-3), "jump": 300.0 * np.sign(V_M_S),
    "noise only": 0.0 * V_M_S, "coarse": 20.0 * np.round(45.0 * V_M_S), "triangle": np.abs(T_S % 1.0 - 0.5) * 1e3,
    "cavitation": 400.0 * V_M_S - 300.0 * ((T_S % 1.05) < 0.004),
}


@pytest.mark.parametrize("kind", CLEAN)
@pytest.mark.parametrize("noise_N", [0.0, 2.0])
def test_what_the_signal_does_itself_is_no_spike(kind: str, noise_N: float) -> None:
    assert spikes(CLEAN[kind] + noise_N * NOISE) == []


@pytest.mark.parametrize("kind", ["viscous", "noise only", "coarse", "triangle"])
@pytest.mark.parametrize("height_N", [200.0, -5000.0])
def test_single_samples_are_found(kind: str, height_N: float) -> None:
    values = CLEAN[kind] + 2.0 * NOISE
    values[[300, 1501]] += height_N
    values[900] = np.nan
    assert spikes(values) == [300, 1501]
