"""The reason that makes a stopped point invalid, also for the page, which loads nothing of the recording's format."""

from __future__ import annotations

from collections.abc import Iterable

INVALID = "invalid"
STOPPED_POINT = "the point was stopped before it was complete"


def was_stopped(verdict: str, reasons: Iterable[str]) -> bool:
    """Whether a point is invalid because it was stopped; its code is that of the stop's cause, which may be any.

    Args:
        verdict: the point's.
        reasons: as stored, `code: text`; they may include those of an earlier attempt.
    """
    return verdict == INVALID and any(reason.endswith(f": {STOPPED_POINT}") for reason in reasons)
