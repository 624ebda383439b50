"""The benchmark's transfer system: servo valve, actuator and specimen, nominal and perturbed.

Source: as `rig.hybrid.building`, Table 2 and `F1_input_file.m`. The same values, rounded, stand in
github.com/FermandoisLab/RobustAMBCvRTHS (`AMB_L_1_vRTHS.m`).
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from rig.hybrid.building import Specimen
from rig.signals.arrays import FloatArray

GAIN = 1.0261
VALVE_GAIN = 2.1283e13
"""a1 beta0, m Pa/s."""
NATURAL_FEEDBACK = 4.2297e6
"""a2, m Pa: the actuator's force falls with its velocity."""
ACTUATOR_CAPACITY_N = 8900.0
SATURATION = 3.8
QUANTUM = 2.0**-18
"""The command's range and resolution behind the converter, 18 bit, in the command's own unit (m)."""
POSITION, FORCE = 3, 2
"""States of the plant: valve (2), force (N), position (m), velocity (m/s)."""
ORDER = 5


@dataclass(frozen=True)
class TransferSystem:
    """The four parameters that vary from one assembly of the rig to the next; a mean of each by default.

    a3 and beta1 in 1/s, beta2 in 1/s^2, the specimen's stiffness in N/m.
    """

    a3: float = 3.3
    beta1: float = 425.0
    beta2: float = 9.9976e4
    stiffness_N_m: float = 1.19e6

    @property
    def specimen(self) -> Specimen:
        """What is tested."""
        return Specimen(self.stiffness_N_m)

    def state_space(self) -> tuple[FloatArray, FloatArray]:
        """State matrix (5, 5) and input matrix (5, 1) from the command, m."""
        specimen = self.specimen
        mass, damping, stiffness = specimen.mass_kg, specimen.damping_N_s_m, specimen.stiffness_N_m
        state = np.zeros((ORDER, ORDER))
        state[0, 1] = 1.0
        state[1] = [-self.beta2, -self.beta1, 0.0, -VALVE_GAIN, 0.0]
        state[2] = [1.0, 0.0, -self.a3, 0.0, -NATURAL_FEEDBACK]
        state[3, 4] = 1.0
        state[4] = [0.0, 0.0, 1.0 / mass, -stiffness / mass, -damping / mass]
        inputs = np.zeros((ORDER, 1))
        inputs[1, 0] = VALVE_GAIN * GAIN
        return state, inputs

    def inverse(self) -> FloatArray:
        """Coefficients (6,) of the command in the position and its derivatives, the position first: s^i.

        The transfer system has no zeros: its inverse is this polynomial and nothing else.
        """
        specimen = self.specimen
        moved = np.polymul([1.0, self.a3], [specimen.mass_kg, specimen.damping_N_s_m, specimen.stiffness_N_m])
        with_feedback = np.polyadd(moved, [NATURAL_FEEDBACK, 0.0])
        whole = np.polyadd(np.polymul([1.0, self.beta1, self.beta2], with_feedback), [VALVE_GAIN])
        return np.ascontiguousarray(whole[::-1] / (VALVE_GAIN * GAIN))


SPREAD = TransferSystem(a3=1.3, beta1=3.3, beta2=3.3e3, stiffness_N_m=5.0e4)
"""Standard deviation of each parameter, normally distributed."""


def perturbed(count: int, seed: int) -> list[TransferSystem]:
    """Transfer systems drawn from the published spread, the same for a seed."""
    mean, spread = np.array(astuple(TransferSystem())), np.array(astuple(SPREAD))
    drawn = mean + spread * np.random.default_rng(seed).standard_normal((count, len(mean)))
    return [TransferSystem(*map(float, row)) for row in drawn]


def sensitivity() -> FloatArray:
    """Change of `TransferSystem.inverse` (6, 4) for one standard deviation of each parameter, about the mean."""
    mean, spread = np.array(astuple(TransferSystem())), np.array(astuple(SPREAD))
    columns = []
    for i in range(len(mean)):
        step = np.zeros(len(mean))
        step[i] = 0.1 * spread[i]
        columns.append((TransferSystem(*(mean + step)).inverse() - TransferSystem(*(mean - step)).inverse()) / 0.2)
    return np.ascontiguousarray(np.column_stack(columns))
