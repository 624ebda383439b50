"""One world looked at closely: every step of it written down, or the smallest one that still fails."""

from __future__ import annotations

import shlex
from pathlib import Path

from rig.cli.output import say
from simulators.world.asked import NOTHING, Asked, Files
from simulators.world.kernel import Task
from simulators.world.plan import WorldPlan
from simulators.world.runs import Ended, alone
from simulators.world.shrink import shrunk
from simulators.world.telling import Told
from simulators.world.world import World


def traced(seed: int, asked: Asked, path: Path) -> Ended:
    """One world, every task that runs as a line: virtual time (s), process, thread.

    Raises:
        OSError: the file cannot be written.
    """
    refused: list[OSError] = []
    with path.open("w", encoding="utf-8") as file:

        def begin(world: World) -> None:
            kernel = world.kernel
            world.display = Told(kernel)

            def note(task: Task) -> None:
                try:
                    print(f"{kernel.time_s:.9f} {task.process!r} {task.name}", file=file)
                except OSError as error:  # not the world's
                    kernel.trace = None
                    refused.append(error)

            kernel.trace = note

        ended = alone(asked.plan(seed), asked.until_s, begin)
        for error in refused:
            raise OSError(error.errno, error.strerror, str(path))
    return ended


def tell_smallest(seed: int, asked: Asked) -> None:
    """Tell the smallest world that still fails, and how to run it."""
    plan = asked.plan(seed)
    ended = alone(plan)
    if not ended.failed:
        say(f"seed {seed} holds this time", err=True)
        return
    smallest, _ = shrunk(plan, ended, lambda words: say(f"  seed {seed} {words}", err=True))
    say(_words(smallest, asked, same_matrix=smallest.matrix == asked.given.matrix), err=True)


def _words(smallest: WorldPlan, asked: Asked, *, same_matrix: bool) -> str:
    """A world that was made smaller: the command that runs it, below it the matrix that it needs."""
    files, name = asked.files, Path(f"smallest-{smallest.seed}.toml")
    words = ["rig", "worlds", "--seeds", str(smallest.seed)]
    words += files.options if same_matrix else Files(name, files.bench).options
    for happening in tuple(map(str, smallest.happenings)) or (NOTHING,):
        words += ["--happening", happening]
    again = f"seed {smallest.seed}, smallest: {shlex.join(words)}"
    return again if same_matrix else f"{again}\nwith {name}:\n{smallest.matrix}"
