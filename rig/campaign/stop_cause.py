"""Causes and kinds of a stop: codes of the fault matrix, and the stops after which a retry is allowed."""

from __future__ import annotations

import errno
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from rig.campaign import words
from rig.faults.matrix import RESTARTS_BY_ITSELF
from rig.faults.row import StopKind
from rig.recording.quality.verdict import BLAMED

CURRENT_FLOWS = frozenset({"current-stuck", "overcurrent"})
"""What the station names where it has measured a current that should not be there."""


@dataclass(frozen=True)
class StopCause:
    """Why something was stopped, refused or invalidated.

    Attributes:
        slug: the fault matrix's name; what is decided is decided by it.
        detail: what was seen, in words.
        message: which words (`rig.campaign.words`); empty where they come from elsewhere.
        values: the numbers and names in them.
    """

    slug: str
    detail: str = ""
    message: str = field(default="", compare=False)
    values: Mapping[str, object] = field(default_factory=dict, compare=False)

    @property
    def blamed(self) -> str:
        """Who has to do something about it: `specimen`, `bench` or `test`."""
        return BLAMED.get(self.slug, "bench")

    def explained(self, slug: str, instead: str) -> StopCause:
        """The same finding under another slug, with what explains it (`words.EXCHANGED`) in place of the advice."""
        detail = words.message(self.message, dict(self.values), instead)
        return replace(self, slug=slug, detail=detail)


def because(slug: str, message: str, **values: object) -> StopCause:
    """A cause in the words of `rig.campaign.words.MESSAGES`."""
    return StopCause(slug, words.message(message, values), message, values)


OPERATOR = frozenset({"sigint", "sigterm", "operator"})
"""Stops that were requested: no fault."""

# The point may restart by itself from zero amplitude, where the matrix file's `[campaign] retries` allows it.
MOST_RETRIES = 2
# Of these, the ones whose cause needs time to pass: a reset is tried again and again until it succeeds.
COOLS_FIRST = frozenset({"ecu-overtemp"})

# Warnings of the station that make the running point invalid. Those of samples are judged by their share instead.
SPOIL = frozenset({"rtu-stale"})


def may_restart(stop: StopKind, cause: StopCause) -> bool:
    """Whether a point stopped like this may be repeated without the operator; never after HALT or PRESSURE_OFF."""
    return stop is StopKind.FADE_OUT and cause.slug in RESTARTS_BY_ITSELF


def stop_note(stop: StopKind, cause: StopCause) -> tuple[str, str]:
    """Level and text of the line that says why the rig stops."""
    if cause.slug in OPERATOR:
        return "info", words.say("operator-stop", detail=cause.detail)
    return "error", words.say("stop", slug=cause.slug, detail=cause.detail, stop=stop)


def cause_of(error: Exception) -> StopCause:
    """Why an action failed, by the kind of its error."""
    slug = disk_slug(error) if isinstance(error, OSError) else "task-dies"
    return because(slug, "said", text=str(error) or type(error).__name__)


def disk_slug(error: BaseException) -> str:
    """The fault matrix's slug for an error of the disk: by its error number, also of what caused it."""
    link: BaseException | None = error
    while link is not None:
        number = link.errno if isinstance(link, OSError) else None
        if number in {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}:
            return "disk-full"
        if number in {errno.EROFS, errno.EACCES, errno.EPERM, errno.EEXIST, errno.ENOENT, errno.ENOTDIR}:
            return "dir-readonly"
        link = link.__cause__
    return "fsync-error"
