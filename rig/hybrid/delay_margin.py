"""Critical delay of a specimen's force, at which a hybrid test of a linear structure becomes unstable."""

from __future__ import annotations

import math

import numpy as np

from rig.hybrid.building import Specimen, Structure
from rig.signals.arrays import FloatArray

SWEEP = 4000
LOWEST_Hz, HIGHEST_Hz = 0.01, 1000.0


def critical_delay_s(computed: Structure, specimen: Specimen) -> float:
    """The shortest pure delay of the specimen's force at which a root of the loop crosses the imaginary axis, s.

    The loop of computed part and specimen, seen at the first floor, is 1 + G(s) Z(s) exp(-s tau). It crosses where the
    magnitude of G Z is 1 and tau makes up its phase. Infinite where that magnitude is nowhere 1.
    """

    def loop(frequency_Hz: float) -> complex:
        s = 2j * math.pi * frequency_Hz
        inner = computed.mass * s**2 + computed.damping * s + computed.stiffness
        resistance = specimen.mass_kg * s**2 + specimen.damping_N_s_m * s + specimen.stiffness_N_m
        return complex(np.linalg.inv(inner)[0, 0] * resistance)

    from scipy.optimize import brentq  # only this needs it

    def above_one(frequency_Hz: float) -> float:
        return math.log(abs(loop(frequency_Hz)))

    sweep: FloatArray = np.geomspace(LOWEST_Hz, HIGHEST_Hz, SWEEP)
    levels = [above_one(float(frequency)) for frequency in sweep]
    delays = []
    for i in range(SWEEP - 1):
        if levels[i] * levels[i + 1] <= 0.0:
            frequency_Hz = float(brentq(above_one, sweep[i], sweep[i + 1], xtol=1e-12))
            turn = np.angle(-loop(frequency_Hz)) % (2.0 * math.pi)
            delays.append(turn / (2.0 * math.pi * frequency_Hz))
    return float(min(delays, default=math.inf))
