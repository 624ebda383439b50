"""What standard damper tests say of a specimen, measured and without a model.

Peak-velocity plot, energy, damping, dynamic range, scatter, gas force and friction, the coil's lag. Reads finished runs
only; no fit is used here, and nothing here decides a verdict.
"""

from rig.characteristics.summary import Characteristics, characterise

__all__ = ["Characteristics", "characterise"]
