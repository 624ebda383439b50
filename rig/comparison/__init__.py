"""Runs beside each other: what each says of its damper, what changed, and whether it lies within acceptance bands.

Only finished runs and their fits are read; nothing is measured or fitted here but differences.
"""

from rig.comparison.bands import Bands, load_bands
from rig.comparison.differences import Comparison, compare

__all__ = ["Bands", "Comparison", "compare", "load_bands"]
