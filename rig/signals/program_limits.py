"""Limits of a current program, which the plan checks and the station checks again; it loads no numeric packages."""

from __future__ import annotations

MOST_STEPS = 2000
"""Longest program; its text in a recorded file stays below the 64 KiB of an HDF5 attribute."""
SHORTEST_HOLD_S = 0.002
"""Between two steps."""
