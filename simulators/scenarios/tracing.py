"""One world looked at closely: every step of it written down."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path

from simulators.scenarios.kernel import Kernel, Task
from simulators.scenarios.request import ScenarioRequest
from simulators.scenarios.runs import Ended, alone
from simulators.scenarios.scenario import Scenario, Silent


class TracedDisplay(Silent):
    """Shows a world's campaign on the standard error, which is another one inside of it, with its virtual time."""

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self._shown = sys.stderr

    def phase(self, *words: object, **_: object) -> None:
        """A line of it."""
        with contextlib.suppress(OSError):
            print(f"{self._kernel.time_s:9.3f} s ", *words, file=self._shown, flush=True)

    message = phase


def traced(seed: int, request: ScenarioRequest, path: Path) -> Ended:
    """One world, every task that runs as a line: virtual time (s), process, thread.

    Raises:
        OSError: the file cannot be written.
    """
    refused: list[OSError] = []
    with path.open("w", encoding="utf-8") as file:

        def begin(scenario: Scenario) -> None:
            kernel = scenario.kernel
            scenario.display = TracedDisplay(kernel)

            def note(task: Task) -> None:
                try:
                    print(f"{kernel.time_s:.9f} {task.process!r} {task.name}", file=file)
                except OSError as error:  # not the world's
                    kernel.trace = None
                    refused.append(error)

            kernel.trace = note

        ended = alone(request.plan(seed), request.until_s, begin)
        for error in refused:
            raise OSError(error.errno, error.strerror, str(path))
    return ended
