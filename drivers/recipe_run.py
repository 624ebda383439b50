"""A command's recipe on its way: steps are taken as far as the device lets them, and gone on with at later polls.

No step makes the thread wait: a wait that is not over leaves the rest for the next poll, so that a stop is never kept
back by another command.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum, auto

from drivers.register_maps.access_plan import Written
from drivers.register_maps.condition import Values
from drivers.register_maps.quantity import Quantity
from drivers.register_maps.recipe import Pause, Recipe, Wait, Write
from drivers.roles import Command

Show = Callable[[frozenset[Quantity]], Values]
"""What the device shows now of these quantities (SI)."""
Send = Callable[[Written], None]


class Outcome(Enum):
    """Where a recipe stands."""

    UNDER_WAY = auto()
    DONE = auto()
    NOT_ANSWERED = auto()
    """A wait was not over in time."""


class RecipeRun:
    """One command being carried out.

    Args:
        command: which.
        sequence: its number.
        steps: its recipe.
        given: what it is about, by the recipe's names (SI).
    """

    def __init__(self, command: Command, sequence: int, steps: Recipe, given: Values) -> None:
        self.command = command
        self.sequence = sequence
        self.outcome = Outcome.UNDER_WAY
        self._steps = steps
        self._given = given
        self._next = 0
        self._until_s: float | None = None

    def check(self) -> None:
        """Make sure that every value fits its register.

        Raises:
            LocalProtocolError: one does not; nothing was sent.
        """
        for step in self._steps:
            if isinstance(step, Write):
                step.requests(self._given)

    @property
    def rest(self) -> Recipe:
        """The remaining steps, from the unfinished one on."""
        return self._steps[self._next :]

    @property
    def awaited(self) -> str:
        """Time limit and conditions of the current wait, for messages."""
        step = self._steps[self._next]
        if not isinstance(step, Wait):
            return ""
        names = ", ".join(sorted(quantity.name for quantity in step.condition.quantities))
        return f"within {1e3 * step.within_s:g} ms (waiting for {names})"

    def restart(self) -> None:
        """Begin again with the first step."""
        self._next, self._until_s, self.outcome = 0, None, Outcome.UNDER_WAY

    def go_on(self, now_s: float, show: Show, send: Send) -> Outcome:
        """Take the steps that can be taken now.

        Args:
            now_s: host time; never falls back.
            show: reads the device.
            send: writes to it.

        Raises:
            DriverError: whatever reading or writing raised; the step is not done.
        """
        while self.outcome is Outcome.UNDER_WAY and self._next < len(self._steps):
            step = self._steps[self._next]
            if isinstance(step, Write):
                for request in step.requests(self._given):
                    send(request)
            elif not self._over(step, now_s, show):
                return self.outcome
            self._next, self._until_s = self._next + 1, None
        if self.outcome is Outcome.UNDER_WAY:
            self.outcome = Outcome.DONE
        return self.outcome

    def _over(self, step: Wait | Pause, now_s: float, show: Show) -> bool:
        if self._until_s is None:
            self._until_s = now_s + (step.lasts_s if isinstance(step, Pause) else step.within_s)
        if isinstance(step, Pause):
            return now_s >= self._until_s
        if step.condition.holds(show(step.condition.quantities), self._given):
            return True
        if now_s > self._until_s:
            self.outcome = Outcome.NOT_ANSWERED
        return False
