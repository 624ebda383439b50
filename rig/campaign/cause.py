"""Why and how something stops: slugs of the fault matrix, kinds of stop, and which stops a retry may follow."""

from __future__ import annotations

from dataclasses import dataclass

from rig.faults.matrix import RESTARTS_BY_ITSELF
from rig.faults.row import StopKind


@dataclass(frozen=True)
class Cause:
    """Why something was stopped, refused or invalidated: the fault matrix's slug, and what was seen."""

    slug: str
    detail: str = ""


OPERATOR = frozenset({"sigint", "sigterm"})
"""Stops that somebody wanted: no fault, and nobody's."""

# The point may restart by itself from zero amplitude, where the matrix file's `[campaign] retries` allows it.
MOST_RETRIES = 2
# Of these, the ones whose cause needs time to pass: a reset is tried again and again until it succeeds.
COOLS_FIRST = frozenset({"ecu-overtemp"})

# Warnings of the station that make the running point invalid. Those of samples are judged by their share instead.
SPOIL = frozenset({"rtu-stale"})


def may_restart(stop: StopKind, cause: Cause) -> bool:
    """Whether a point stopped like this may be repeated without the operator; never after S1, SO or HW."""
    return stop is StopKind.FADE_OUT and cause.slug in RESTARTS_BY_ITSELF


def stop_note(stop: StopKind, cause: Cause) -> tuple[str, str]:
    """Level and text of the line that says why the rig stops."""
    if cause.slug in OPERATOR:
        return "info", f"stopped by operator ({cause.detail}): current to 0 A, motion fades out"
    return "error", f"{cause.slug}: {cause.detail}; stop {stop}: current to 0 A, motion ends"
