"""The smallest world in which something still goes wrong."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from rig.cli.output import say
from simulators.scenarios.drawn_rig import RECORD
from simulators.scenarios.plan import ScenarioPlan
from simulators.scenarios.request import NOTHING, ScenarioRequest
from simulators.scenarios.runs import Ended, alone

FEWEST_CYCLES = 5


def shrunk(
    plan: ScenarioPlan, ended: Ended, report: Callable[[str], None], run: Callable[[ScenarioPlan], Ended] | None = None
) -> tuple[ScenarioPlan, Ended]:
    """Leave out one thing after the other, and points of the matrix, as long as an invariant of the same name breaks.

    Args:
        plan: a world that fails.
        ended: how it ended.
        report: called with what is tried.
        run: runs a world, to its end where nothing is given.
    """
    invariants = {invariant for invariant, _, _ in ended.failed}
    again = True
    while again:
        again, held = False, set[str]()
        while untried := [(smaller, words) for smaller, words in _smaller(plan) if words not in held]:
            smaller, words = untried[0]
            tried = (run or alone)(smaller)
            if invariants & {invariant for invariant, _, _ in tried.failed}:
                report(f"without {words}: still fails")
                plan, ended, again = smaller, tried, bool(held)
            else:
                report(f"without {words}: passes")
                held.add(words)
    return plan, ended


def _smaller(plan: ScenarioPlan) -> list[tuple[ScenarioPlan, str]]:
    """Worlds with one thing less: the last value of one axis of the matrix (the rest takes less time), what happens."""
    scenarios: list[tuple[ScenarioPlan, str]] = []
    lines = plan.matrix.splitlines()
    for key in ("current", "frequency", "amplitude"):
        for place, line in enumerate(lines):
            values = line.partition("= [")[2].rstrip("]").split(", ")
            if line.startswith(f"{key} = [") and len(values) > 1:
                fewer = f"{key} = [{', '.join(values[:-1])}]"
                matrix = "\n".join([*lines[:place], fewer, *lines[place + 1 :], ""])
                scenarios.append((replace(plan, matrix=matrix), f"{key} {values[-1]}"))
    for place, line in enumerate(lines):
        cycles = int(line.removeprefix("cycles = ")) if line.startswith("cycles = ") else 0
        if cycles >= 2 * FEWEST_CYCLES:
            matrix = "\n".join([*lines[:place], f"cycles = {cycles // 2}", *lines[place + 1 :], ""])
            scenarios.append((replace(plan, matrix=matrix), f"{cycles - cycles // 2} cycles"))
    return scenarios + [(plan.without(event), str(event)) for event in plan.events]


def show_smallest(seed: int, request: ScenarioRequest) -> None:
    """Tell the smallest world that still fails, and how to run it."""
    plan = request.plan(seed).fitted()
    ended = alone(plan)
    if not ended.failed:
        say(f"seed {seed}: the failure did not recur", err=True)
        return
    smallest, _ = shrunk(plan, ended, lambda words: say(f"  seed {seed} {words}", err=True))
    say(_words(smallest, request), err=True)


def _words(smallest: ScenarioPlan, request: ScenarioRequest) -> str:
    """A world that was made smaller: the command that runs it, below it the files that it needs."""
    files, needed = request.files, dict[str, str]()
    if smallest.matrix != request.given.matrix:
        needed[f"smallest-{smallest.seed}.toml"] = smallest.matrix
        files = replace(files, matrix=Path(f"smallest-{smallest.seed}.toml"))
    if smallest.kind and smallest.bench:
        needed[f"smallest-{smallest.seed}-bench.toml"] = smallest.bench
        files = replace(files, bench=Path(f"smallest-{smallest.seed}-bench.toml"))
    if smallest.record:
        needed[RECORD] = smallest.record
    words = ["rig", "scenarios", "--seeds", str(smallest.seed), *files.options]
    events = tuple(map(str, smallest.events)) or (NOTHING,)
    words += [word for event in events for word in ("--event", event)]
    if not request.given.actuator and not (smallest.kind and smallest.bench):
        words += ["--actuator", smallest.actuator]
    again = f"seed {smallest.seed}, smallest: {shlex.join(words)}"
    return "\n".join([again, *(f"with {name}:\n{text}" for name, text in needed.items())])
