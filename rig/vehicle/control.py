"""The laws of the current (`rig.vehicle.laws`), compiled for the loop over a road."""

from __future__ import annotations

from rig.dampers.compiled_cache import njit
from rig.vehicle import laws

wanted_current = njit()(laws.wanted_current)
