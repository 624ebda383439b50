"""One world looked at closely: every step of it written down."""

from __future__ import annotations

from pathlib import Path

from simulators.world.asked import Asked
from simulators.world.kernel import Task
from simulators.world.runs import Ended, alone
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
