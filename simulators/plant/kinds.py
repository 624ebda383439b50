"""Which plant a simulated rig has."""

from __future__ import annotations

from simulators.options import RigOptions
from simulators.plant.plant import Plant


def plant_of(options: RigOptions) -> Plant:
    """The plant that the options ask for; scipy is loaded for the hybrid benchmark's alone."""
    if options.transfer.stiffness_N_m <= 0.0:
        return Plant(options)
    from simulators.plant.transfer import TransferPlant

    return TransferPlant(options)
