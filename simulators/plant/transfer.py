"""The hybrid benchmark's transfer system in the place of the rig's servo and damper: valve, actuator and specimen.

The compiled loop goes on making set-points and modes; where the rod is and what force it has is this system's answer
to them, exact over each step of the plant. It is linear about 0 and knows no pressure: it is there for
`rig benchmark --wires`, whose plant it is in process too (`rig.hybrid.transfer_system`).
"""

from __future__ import annotations

import numpy as np

from rig.hybrid.discretisation import held
from rig.hybrid.transfer_system import FORCE, ORDER, POSITION, TransferSystem
from simulators.options import RigOptions
from simulators.plant import step
from simulators.plant.plant import Plant

VELOCITY = 4
"""State of the system, m/s."""


class TransferPlant(Plant):
    """A plant whose rod and force are the transfer system's."""

    def __init__(self, options: RigOptions) -> None:
        super().__init__(options)
        given = options.transfer
        system = TransferSystem(given.a3, given.beta1, given.beta2, given.stiffness_N_m)
        self._going, driven = held(*system.state_space(), self.dt_s)
        self._driven = driven[:, 0]
        self._system = np.zeros(ORDER)

    def _moved(self) -> None:
        setpoint_m, system, out = self.value("setpoint_m"), self._system, self.out
        for row in out:
            system = self._going @ system + self._driven * setpoint_m
            row[step.DISPLACEMENT] = row[step.PISTON] = system[POSITION]
            row[step.VELOCITY], row[step.FORCE] = system[VELOCITY], system[FORCE]
        self._system = system


def plant_of(options: RigOptions) -> Plant:
    """The plant that the options ask for."""
    return TransferPlant(options) if options.transfer.stiffness_N_m > 0.0 else Plant(options)
