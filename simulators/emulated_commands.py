"""Recipes played from the device's side: which command it is that a host has written, and what the host waits for.

A command is its writes, step by step. It is carried out with the step that says the last of it: the last that writes
something of the command itself, or a constant that is not 0; what comes after that takes requests back. Where the host
waits after a step, the device makes it true.

A command that is one write with a number is carried out when that number is written; all else is as the registers hold
it then.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from drivers.register_maps.condition import Condition
from drivers.register_maps.quantity import Quantity, Value
from drivers.register_maps.recipe import Recipe, Wait, Write
from drivers.roles import Command

OWN = frozenset({"$sequence", "$owner"})
Written = Mapping[str, int]
"""Quantity -> raw number, of one request."""
RawOf = Callable[[Quantity, Value], int]


@dataclass
class Script:
    """One command's steps, and how far a host has come with them.

    Attributes:
        number: the quantity whose writing executes it, of a command that is one write; else empty.
    """

    command: Command
    steps: list[dict[Quantity, Value]]
    waits: list[list[Condition]]
    decides: int
    number: str = ""
    place: int = 0
    missing: set[str] = field(default_factory=set)


@dataclass(frozen=True)
class Seen:
    """A completed step of a command: whether it triggers the command, and what the host waits for next.

    Attributes:
        leads: whether it precedes the step that triggers the command.
    """

    command: Command
    decides: bool
    waits: tuple[Condition, ...]
    size: int
    leads: bool = False


def scripts_of(recipes: Mapping[Command, Recipe]) -> list[Script]:
    """The scripts of a map's commands."""
    scripts = []
    for command, recipe in recipes.items():
        steps: list[dict[Quantity, Value]] = []
        waits: list[list[Condition]] = []
        for step in recipe:
            if isinstance(step, Write):
                steps.append(dict(step.values))
                waits.append([])
            elif isinstance(step, Wait) and waits:
                waits[-1].append(step.condition)
        if steps:
            numbers = [quantity.name for quantity, value in steps[0].items() if value == "$sequence"]
            number = numbers[0] if numbers and len(steps) == 1 else ""
            scripts.append(Script(command, steps, waits, _decides(steps), number))
    return scripts


def preconditions(recipes: Mapping[Command, Recipe]) -> list[Condition]:
    """What hosts wait for before they write anything: how the device looks while nothing is asked."""
    before = []
    for recipe in recipes.values():
        for step in recipe:
            if not isinstance(step, Wait):
                break
            before.append(step.condition)
    return before


def _decides(steps: list[dict[Quantity, Value]]) -> int:
    """The step with which a command is complete."""
    decided = [
        place for place, step in enumerate(steps)
        if any(value not in OWN if isinstance(value, str) else value != 0 for value in step.values())
    ]
    return decided[-1] if decided else len(steps) - 1


class Scripts:
    """Follows what a host writes.

    Args:
        scripts: of the device's commands.
        raw_of: the raw number of a quantity's value.
        held: the raw number that a quantity's register holds.
    """

    def __init__(self, scripts: list[Script], raw_of: RawOf, held: Callable[[Quantity], int] = lambda _: 0) -> None:
        self._scripts = scripts
        self._raw_of = raw_of
        self._held = held

    @property
    def number(self) -> str:
        """The quantity whose writing executes a command, where every command has it; else empty."""
        numbers = {script.number for script in self._scripts}
        return numbers.pop() if len(numbers) == 1 else ""

    @property
    def code(self) -> Quantity | None:
        """The quantity of which every command writes a constant: the first of them; None without one."""
        every = [
            [quantity for step in script.steps for quantity, value in step.items() if not isinstance(value, str)]
            for script in self._scripts
        ]
        return next((one for one in every[0] if all(one in others for others in every)), None) if every else None

    def take(self, written: Written) -> list[Seen]:
        """A request has written these; the steps that are complete with it, the most telling first."""
        seen = [one for script in self._scripts if (one := self._follow(script, written)) is not None]
        return sorted(seen, key=lambda one: (-one.decides, -one.size))

    def _follow(self, script: Script, written: Written) -> Seen | None:
        """The step that is complete with a request; None where it is of another command, or more is missing."""
        if script.number:
            step = script.steps[0]
            constants = ((one, value) for one, value in step.items() if not isinstance(value, str))
            if script.number not in written or any(self._raw_of(*one) != self._held(one[0]) for one in constants):
                return None
            return Seen(script.command, True, tuple(script.waits[0]), len(step))
        fits = self._fits(script, written)
        if not fits and script.place > 0:
            before = script.place, script.missing
            script.place, script.missing = 0, set()
            begins_again = self._fits(script, written)
            if fits is None and not begins_again:
                script.place, script.missing = before
            fits = begins_again
        if fits is False:
            script.missing = set()
        if not fits:
            return None
        missing = script.missing or {quantity.name for quantity in script.steps[script.place]}
        script.missing = missing - written.keys()
        if script.missing:
            return None
        place, size = script.place, sum(len(step) for step in script.steps[: script.place + 1])
        script.place = (place + 1) % len(script.steps)
        return Seen(
            script.command, place == script.decides, tuple(script.waits[place]), size, leads=place < script.decides
        )

    def _fits(self, script: Script, written: Written) -> bool | None:
        """Whether a request is of the script's next step; None where it touches nothing of it."""
        step = {quantity.name: (quantity, value) for quantity, value in script.steps[script.place].items()}
        touched = step.keys() & written.keys()
        if not touched:
            return None
        constants = (step[name] for name in touched if not isinstance(step[name][1], str))
        return all(self._raw_of(quantity, value) == written[quantity.name] for quantity, value in constants)
