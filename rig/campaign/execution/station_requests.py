"""Requests to the station without waiting for them: one thread asks, a second one carries stops past it.

`LoopWatch` is the last resort against a loop that stands still: it closes the station's link, and the station stops the
rig.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

from rig.campaign.sequencer.action import PROOF_WALL_S, Request
from rig.clock import monotonic_ns
from rig.station.client import StationClient, StationLost, StationRefused

Answer = dict[str, Any]

# Request -> the station's name for it, its fixed arguments.
WAYS: dict[Request, tuple[str, dict[str, Any]]] = {
    Request.HYDRAULICS_LOW: ("hydraulics", {"level": "low"}),
    Request.HYDRAULICS_ON: ("hydraulics", {"level": "on"}),
}
AFTER_DEADLINE_S = 5.0
"""An answer is waited for a little longer than the sequencer waits for it (wall s)."""


@dataclass(frozen=True)
class Outcome:
    """How a request ended: `error` is None when the station proved it, `answer` then holds its results."""

    request: Request
    answered_ns: int
    answer: Answer = field(default_factory=dict)
    error: StationRefused | StationLost | None = None


class StationRequests:
    """Asks the station one thing after the other; a stop overtakes everything and makes what was asked before void."""

    def __init__(self, client: StationClient) -> None:
        self._client = client
        self._outcomes: queue.SimpleQueue[tuple[int, Outcome]] = queue.SimpleQueue()
        self._era = 0
        self._ordinary = ThreadPoolExecutor(1, thread_name_prefix="ask")
        self._urgent = ThreadPoolExecutor(1, thread_name_prefix="ask-stop")

    def ask(self, request: Request, **arguments: object) -> None:
        """Ask for something; its outcome comes through `outcomes`."""
        self._ordinary.submit(self._carry_out, self._era, request, arguments)

    def stop(self, **arguments: object) -> None:
        """Ask for a stop at once; outcomes of whatever was asked before are dropped."""
        self.void()
        self._urgent.submit(self._carry_out, self._era, Request.STOP, arguments)

    def void(self) -> None:
        """Drop what was asked and is not answered: not yet sent requests are never sent."""
        self._era += 1

    def outcomes(self) -> list[Outcome]:
        """What was answered since the last call, oldest first."""
        taken: list[Outcome] = []
        while True:
            try:
                era, outcome = self._outcomes.get_nowait()
            except queue.Empty:
                return taken
            if era == self._era:
                taken.append(outcome)

    def close(self) -> None:
        """Send nothing more; does not wait for answers still under way."""
        self.void()
        self._ordinary.shutdown(wait=False, cancel_futures=True)
        self._urgent.shutdown(wait=False, cancel_futures=True)

    def _carry_out(self, era: int, request: Request, arguments: dict[str, object]) -> None:
        if era != self._era:
            return
        do, fixed = WAYS.get(request, (str(request), {}))
        timeout_s = PROOF_WALL_S[request] + AFTER_DEADLINE_S
        send: Callable[..., Answer] = self._client.request
        try:
            outcome = Outcome(request, 0, send(do, timeout_s=timeout_s, **fixed, **arguments))
        except (StationRefused, StationLost) as error:
            outcome = Outcome(request, 0, error=error)
        except (OSError, ValueError) as error:
            outcome = Outcome(request, 0, error=StationLost(f"{do}: {error}"))
        self._outcomes.put((era, Outcome(request, monotonic_ns(), outcome.answer, outcome.error)))


LONGEST_TURN_S = 10.0
"""Longer than any disk may keep the campaign's loop from turning (wall s).

The station has stopped the rig long before, but holds it under pressure for an application that may come back.
"""
LOOK_S = 0.5


class LoopWatch:
    """Looks on a thread of its own whether the loop still turns.

    Time in which this whole process stood still does not count: the thread counts its own looks.

    Args:
        let_go: called once, from that thread, when the loop has not turned for `longest_s`.
        longest_s: how long one turn may take (wall s).
    """

    def __init__(self, let_go: Callable[[], object], longest_s: float = LONGEST_TURN_S) -> None:
        self._let_go = let_go
        self._looks = max(2, round(longest_s / LOOK_S))
        self._turns = 0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="loop watch", daemon=True)
        self._thread.start()

    def turned(self) -> None:
        """The loop has turned once more."""
        self._turns += 1

    def end(self) -> None:
        """Watch no longer."""
        self._ending.set()

    def _watch(self) -> None:
        seen, looks = -1, 0
        while not self._ending.wait(LOOK_S):
            looks = looks + 1 if self._turns == seen else 0
            seen = self._turns
            if looks >= self._looks:
                self._let_go()
                return
