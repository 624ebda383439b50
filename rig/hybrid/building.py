"""The benchmark's building: three floors, four cases, divided into the computed and the tested part.

Source: C. E. Silva, D. Gomez, A. Maghareh, S. J. Dyke, B. F. Spencer, "Benchmark control problem for real-time hybrid
simulation", Mechanical Systems and Signal Processing 135 (2020) 106381, Table 1, and the authors' code package
(github.com/MECHS-RCN/BENCHMARKS, V23: `Building cases`, `F1_input_file.m`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rig.signals.arrays import FloatArray

FLOORS = 3
STIFFNESS_N_m = np.array(
    [
        [26054883.879604, -23133938.877108, 5937035.463339],
        [-23133938.877108, 32560774.186380, -14419970.777237],
        [5937035.463339, -14419970.777237, 9267275.506224],
    ]
)
"""Condensed to the floors' horizontal displacements; the same in all cases."""


class Case(NamedTuple):
    """What distinguishes the benchmark's cases: mass of each floor (kg) and damping ratio of each mode."""

    floor_mass_kg: float
    damping_ratio: float


CASES = {1: Case(1000.0, 0.05), 2: Case(1100.0, 0.04), 3: Case(1300.0, 0.03), 4: Case(1000.0, 0.03)}
"""Table 1 of the paper."""


@dataclass(frozen=True)
class Specimen:
    """What is tested in place of computed: part of the first floor's column; its damping follows from its stiffness."""

    stiffness_N_m: float = 1.19e6
    mass_kg: float = 29.13
    damping_ratio: float = 0.0097

    @property
    def damping_N_s_m(self) -> float:
        """Viscous damping, N s/m."""
        return 2.0 * self.damping_ratio * math.sqrt(self.mass_kg * self.stiffness_N_m)


class Structure(NamedTuple):
    """Mass (kg), damping (N s/m) and stiffness (N/m), each (3, 3), of what the ground shakes."""

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray

    def frequencies_Hz(self) -> FloatArray:
        """Natural frequencies (3,), Hz, undamped."""
        from scipy.linalg import eigh  # where it is wanted: a simulated rig loads this room without it

        squares: FloatArray = eigh(self.stiffness, self.mass, eigvals_only=True)
        return np.asarray(np.sqrt(squares) / (2.0 * math.pi))

    def state_space(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """First-order form with displacements, then velocities as states.

        Args:
            inputs: force on each floor per unit of each input (3, m).

        Returns:
            State matrix (6, 6) and input matrix (6, m).
        """
        inverse = np.linalg.inv(self.mass)
        zero, one = np.zeros((FLOORS, FLOORS)), np.eye(FLOORS)
        state = np.block([[zero, one], [-inverse @ self.stiffness, -inverse @ self.damping]])
        return state, np.vstack([np.zeros((FLOORS, inputs.shape[1])), inverse @ inputs])


def reference(case: Case) -> Structure:
    """The whole building of a case: modal damping, the same in all modes."""
    from scipy.linalg import eigh  # as above

    mass = np.eye(FLOORS) * case.floor_mass_kg
    squares, modes = eigh(STIFFNESS_N_m, mass)
    inverse = np.linalg.inv(modes)
    damping = inverse.T @ np.diag(2.0 * case.damping_ratio * np.sqrt(squares)) @ inverse
    return Structure(mass, damping, STIFFNESS_N_m)


def computed_part(whole: Structure, specimen: Specimen) -> Structure:
    """The building without the specimen, which holds the first floor."""
    first = np.zeros((FLOORS, FLOORS))
    first[0, 0] = 1.0
    return Structure(
        whole.mass - specimen.mass_kg * first,
        whole.damping - specimen.damping_N_s_m * first,
        whole.stiffness - specimen.stiffness_N_m * first,
    )


def ground_and_force(whole: Structure) -> FloatArray:
    """Inputs of the computed part (3, 2): ground acceleration (m/s^2), the specimen's resisting force (N)."""
    return np.column_stack([-whole.mass @ np.ones(FLOORS), [-1.0, 0.0, 0.0]])
