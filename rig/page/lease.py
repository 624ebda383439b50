"""The operator's lease: one browser at a time commands, the others watch; every browser may stop.

It is held by a connection, for as long as that lives and a little longer (a phone that sleeps, a page loaded again). A
lock file in the live folder keeps a second page process of the same campaign from giving out another one.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rig.station.live_folder import OPERATOR_LOCK, hold

GRACE_NS = 10_000_000_000
"""So long the lease waits for a holder whose connection is gone."""


@dataclass(frozen=True)
class Holder:
    """Who has it: a browser's own key, and the name typed there."""

    key: str
    name: str


class Lease:
    """One campaign's, or that of a bench and of every campaign on it.

    Args:
        folder: the live folder, asked for anew each time; None: there is no campaign to command.
        now_ns: monotonic time.
        permanent: lease of a bench, which does not depend on a campaign.
    """

    def __init__(
        self, folder: Callable[[], Path | None], now_ns: Callable[[], int], *, permanent: bool = False
    ) -> None:
        self._folder = folder
        self._now_ns = now_ns
        self._permanent = permanent
        self._holder: Holder | None = None
        self._left_ns: int | None = None
        self._lock: int | None = None
        self._of: Path | None = None

    @property
    def holder(self) -> Holder | None:
        """Who has it now; a lease ends with its campaign, that of a bench with its holder's absence."""
        left = self._left_ns is not None and self._now_ns() - self._left_ns > GRACE_NS
        if self._holder is not None and (left or (not self._permanent and self._folder() != self._of)):
            self._end()
        return self._holder

    def take(self, key: str, name: str) -> str:
        """Give the lease to a browser, or to the same one under another name.

        Returns:
            Why not (a slug); empty: it has it.
        """
        holder = self.holder
        if holder is not None and holder.key != key:
            return "lease-taken"
        if not self._locked():
            return "lease-taken"
        if self._of is None and not self._permanent:
            return "not-running"
        self._holder, self._left_ns = Holder(key, name), None
        return ""

    def _locked(self) -> bool:
        """Whether this process is the one that commands the campaign that runs; True where none runs."""
        folder = self._folder()
        if folder == self._of and (folder is None or self._lock is not None):
            return True
        self._unlock()
        if folder is not None:
            try:
                self._lock = hold(folder / OPERATOR_LOCK)
            except OSError:
                return True  # the campaign is gone
            if self._lock is None:
                return False
            self._of = folder
        return True

    def held_by(self, key: str) -> bool:
        """Whether this browser has it, and may command the campaign that runs."""
        holder = self.holder
        return holder is not None and holder.key == key and (not self._permanent or self._locked())

    def left(self, key: str) -> None:
        """The last connection of this browser is gone: wait for it a while."""
        if self._holder is not None and self._holder.key == key:
            self._left_ns = self._now_ns()

    def back(self, key: str) -> None:
        """It is there again."""
        if self._holder is not None and self._holder.key == key and self.holder is not None:
            self._left_ns = None

    def give_back(self, key: str) -> None:
        """This browser gives it up; from another one it stays where it is."""
        if self.held_by(key):
            self._end()

    def _end(self) -> None:
        self._holder = self._left_ns = None
        self._unlock()

    def _unlock(self) -> None:
        self._of = None
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None
