"""Manual current: the operator is asked at the terminal or on a page; a rehearsed operator answers immediately."""

from __future__ import annotations

import contextlib
import os
import select
import sys
from typing import Protocol

from drivers.posix import termios
from rig.bench.model import Bench
from rig.campaign.live_link import LiveLink
from rig.errors import Refused

CHUNK = 4096
UNATTENDED = "by-hand-unattended"


class ManualCurrent(Protocol):
    """The operator at the supply."""

    def ask(self, current_A: float) -> None:
        """A current (A) is asked for from now on; what was said before is no answer to it."""

    def answered(self) -> bool:
        """Whether it was confirmed since; says so once."""


class RehearsedManualCurrent:
    """On a simulated rig: confirms at once; the station turns the simulated knob."""

    def __init__(self) -> None:
        self._waiting = False

    def ask(self, current_A: float) -> None:
        """Something is asked."""
        self._waiting = True

    def answered(self) -> bool:
        """At once, and once."""
        requested, self._waiting = self._waiting, False
        return requested


class TerminalManualCurrent:
    """At the terminal: an empty line (Enter) confirms; anything else on the line does not.

    Args:
        descriptor: of the terminal; nothing waits for it.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting = False
        self._typed = b""

    def ask(self, current_A: float) -> None:
        """Something is asked: forget what was typed before."""
        self._waiting, self._typed = True, b""
        # What is no terminal has nothing typed ahead.
        with contextlib.suppress(termios.error):
            termios.tcflush(self._descriptor, termios.TCIFLUSH)

    def answered(self) -> bool:
        """Whether Enter was typed on an empty line since the question.

        Raises:
            OSError: the terminal is gone.
        """
        if not self._waiting or not select.select([self._descriptor], [], [], 0.0)[0]:
            return False
        data = os.read(self._descriptor, CHUNK)
        if not data:
            self._waiting = False  # it has hung up: no answer will come
            return False
        *lines, self._typed = (self._typed + data).split(b"\n")
        if not any(not line.strip() for line in lines):
            return False
        self._waiting = False
        return True


class PageManualCurrent:
    """The operator with the page's lease and the operator at the terminal: the first answer counts.

    Args:
        live: where pages show what is asked, and answer.
        terminal: None without an operator there.
    """

    def __init__(self, live: LiveLink, terminal: ManualCurrent | None) -> None:
        self._live = live
        self._terminal = terminal

    def ask(self, current_A: float) -> None:
        """On the page and at the terminal."""
        self._live.ask_current(current_A)
        if self._terminal is not None:
            self._terminal.ask(current_A)

    def answered(self) -> bool:
        """Whether this question was confirmed at either place.

        Raises:
            OSError: the terminal is gone.
        """
        typed = self._terminal is not None and self._terminal.answered()
        if not (self._live.current_is_set or typed):
            return False
        self._live.forget_question()
        return True


def manual_current_of(bench: Bench, *, attended: bool, live: LiveLink | None = None) -> ManualCurrent | None:
    """The operator who sets the current of this bench; None if a device drives it.

    Args:
        bench: the bench.
        attended: an operator is at the terminal.
        live: where an operator's page is served; None without one.
    """
    if not bench.ecu.by_hand:
        return None
    if bench.ecu.rehearsal is not None:
        return RehearsedManualCurrent()
    terminal = TerminalManualCurrent(sys.stdin.fileno()) if attended else None
    return terminal if live is None else PageManualCurrent(live, terminal)


def check_manual_current(bench: Bench, *, attended: bool) -> None:
    """Refuse a bench whose current is set manually if no operator can be asked.

    Args:
        bench: the bench.
        attended: an operator is at the terminal and can read prompts, or has the operator's page.

    Raises:
        Refused: not attended (`by-hand-unattended`).
    """
    if bench.ecu.by_hand and bench.ecu.rehearsal is None and not attended:
        raise Refused(
            UNATTENDED,
            "this bench's current is set manually ([ecu] by_hand = true), but no operator can confirm the current "
            "here. No motion was started. Fix: run the command in a terminal, without --json and without redirected "
            "input or output; or use --page and confirm on the page; or rehearse with --simulate",
        )
