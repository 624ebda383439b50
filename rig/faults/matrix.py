"""The fault matrix and the station's table of reactions, combined from the rows.

It is the only source: `python -m simulators --list-faults` prints the matrix, the station takes its reactions from it,
the campaign its restarts, and the fault suite (`tests/faults`) its expectations. A row without a test fails the suite.
Detectors only report a code; the row defines the reaction.
"""

from __future__ import annotations

from rig.faults import controller_rows, current_rows, host_rows, sensor_rows, station_rows
from rig.faults.row import FaultRow

_MATRIX_ROWS = (*controller_rows.ROWS, *current_rows.ROWS, *sensor_rows.ROWS, *host_rows.ROWS)

MATRIX: dict[str, FaultRow] = {row.slug: row for row in _MATRIX_ROWS}
"""The rows by slug, in the order of the matrix."""

REACTIONS: dict[str, FaultRow] = {row.slug: row for row in (*_MATRIX_ROWS, *station_rows.ROWS) if row.code}
"""What the station can trip on or warn of, by slug."""

RESTARTS_BY_ITSELF = frozenset(slug for slug, row in MATRIX.items() if row.resume == "a")
"""Slugs after which the point may restart without the operator."""
