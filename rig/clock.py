"""The one place where host time is read: integer nanoseconds, monotonic. Tests and faults replace it here."""

from __future__ import annotations

import time
from datetime import UTC, datetime


def monotonic_ns() -> int:
    """Host time for control, ages and time-outs (ns); never steps."""
    return time.monotonic_ns()


def utc_now() -> datetime:
    """Wall time (UTC) for file names and provenance only; it may step and is never used for control."""
    return datetime.now(UTC)
