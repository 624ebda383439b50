"""Exceptions of this room, each named after its condition."""

from __future__ import annotations


class StationError(Exception):
    """Base of this room's errors."""


class StationRefused(StationError):
    """The station did not do what was asked, or could not prove that it was done; `slug` names why."""

    def __init__(self, slug: str, message: str) -> None:
        self.slug = slug
        self.message = message
        super().__init__(f"{slug}: {message}")


class StationLost(StationError):
    """The station process is gone, does not read, or did not answer in time: the rig's state is not known here."""
