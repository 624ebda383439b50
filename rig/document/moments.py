"""Moments as people read them: local date and time with its zone, from the stamps of recordings (UTC)."""

from __future__ import annotations

from datetime import UTC, datetime


def local_time(stamp: object, *, zone: bool = True, seconds: bool = True) -> str:
    """`2026-11-27 14:10:30 UTC+01:00` from an ISO 8601 stamp, in the time zone of this computer.

    Args:
        stamp: the stamp; what is no stamp, and a date without a time, is returned as text.
        zone: whether the zone is stated; without it, state it once with `zone_of`.
        seconds: whether seconds are stated.
    """
    at = _moment(stamp)
    if at is None:
        return str(stamp)
    shown = at.strftime("%Y-%m-%d %H:%M:%S" if seconds else "%Y-%m-%d %H:%M")
    return f"{shown} {zone_of(stamp)}" if zone else shown


def zone_of(stamp: object) -> str:
    """The time zone of this computer at a moment: `UTC`, `UTC+01:00`; empty for what is no stamp."""
    at = _moment(stamp)
    if at is None:
        return ""
    offset = at.strftime("%z")
    return "UTC" if offset in {"+0000", "-0000"} else f"UTC{offset[:3]}:{offset[3:5]}"


def _moment(stamp: object) -> datetime | None:
    """A stamp in local time; one without a zone is UTC. None of a date, which is the same in every zone."""
    if len(str(stamp)) == len("2026-11-27"):
        return None
    try:
        at = datetime.fromisoformat(str(stamp))
        return (at if at.tzinfo else at.replace(tzinfo=UTC)).astimezone()
    except (ValueError, OverflowError, OSError):
        return None
