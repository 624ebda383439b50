"""What the user of `rig scenarios` sees: failures as they occur, and progress (a bar or lines)."""

from __future__ import annotations

import time
from collections import Counter
from itertools import groupby
from typing import TYPE_CHECKING, Any, Self

from rich.progress import BarColumn, Progress, TaskID, TextColumn
from rich.text import Text

from rig.document import words as severity
from rig.document.terminal import STYLES
from rig.jobs.time_left import duration

if TYPE_CHECKING:
    from rich.console import Console

    from simulators.scenarios.request import ScenarioRequest
    from simulators.scenarios.runs import Ended

GOOD, LOOK, BAD = STYLES[severity.GOOD], STYLES[severity.FAIR], STYLES[severity.POOR]
LINES = 20
"""Where there is no terminal, so many lines tell how far it is."""
LONGEST_WORDS = 1000


class ProgressOutput:
    """Counts worlds and shows them.

    Args (construction):
        count: so many are to be run.
        asked: what is the same for all of them.
        shown: where it is shown.
        bar: on a terminal, how far it is as a bar; not where a world tells of itself there.

    Attributes:
        failed: an object for everything that did not hold, as in the answer; `not_happened` likewise for what was to
            happen later than the campaign lasted.
    """

    def __init__(self, count: int, request: ScenarioRequest, shown: Console, *, bar: bool = True) -> None:
        self.failed: list[dict[str, Any]] = []
        self.not_happened: list[dict[str, Any]] = []
        self.scenarios = 0
        self.rig_s = 0.0
        self.digests: dict[int, str] = {}
        self._count = count
        self._request = request
        self._shown = shown
        self._began_s = time.perf_counter()
        self._lines_shown = 0
        self._bar = Progress(
            BarColumn(30, complete_style="cyan"), TextColumn("{task.description}"), console=shown, transient=True,
            disable=not (bar and shown.is_terminal),
        )  # fmt: skip
        self._task: TaskID = self._bar.add_task(self._progress(), total=count)

    def __enter__(self) -> Self:
        for words in self._request.substitutes:
            self._shown.print(Text(f"in these scenarios {words}", style="dim"), soft_wrap=True)
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    @property
    def wall_s(self) -> float:
        """Since the beginning (s)."""
        return time.perf_counter() - self._began_s

    @property
    def failed_seeds(self) -> list[int]:
        """Seeds of the worlds in which something did not hold, ascending."""
        return sorted({entry["seed"] for entry in self.failed})

    def unfinished(self, seeds: range) -> str:
        """Seeds without a result, in the notation of `--seeds`; empty if there are none."""
        left = [seed for seed in seeds if seed not in self.digests]
        groups = [
            [seed for _, seed in group] for _, group in groupby(enumerate(left), lambda pair: pair[1] - pair[0])
        ]
        return ", ".join(f"{group[0]}:{group[-1] + 1}" if len(group) > 1 else str(group[0]) for group in groups)

    def ended(self, scenario: Ended) -> None:
        """Count a world, tell what did not hold in it, and how far it is."""
        self.scenarios += 1
        self.rig_s += scenario.rig_s
        self.digests[scenario.seed] = scenario.digest
        self.not_happened += [
            {"seed": scenario.seed, "event": words, "happening": words} for words in scenario.not_happened
        ]
        if scenario.not_happened and self._request.events is not None:
            words = f"seed {scenario.seed}: the campaign ended before {', '.join(scenario.not_happened)}"
            self._shown.print(Text(words, style=LOOK), soft_wrap=True)
        again = self._request.again(scenario.seed)
        for invariant, words, at_s in scenario.failed:
            self.failed.append(
                {
                    "seed": scenario.seed, "check": invariant, "at_s": at_s, "message": words, "repeat": again,
                    "events": list(scenario.scheduled), "invariant": invariant, "words": words, "again": again,
                    "happenings": list(scenario.scheduled),
                }
            )  # fmt: skip
            line = Text(f"seed {scenario.seed}, {at_s:.3f} s: {invariant}: {words[:LONGEST_WORDS]}", style=BAD)
            self._shown.print(line, soft_wrap=True)
        if scenario.failed:
            self._shown.print(Text(f"  events: {', '.join(scenario.scheduled) or 'nothing'}"), soft_wrap=True)
            self._shown.print(Text(f"  repeat with: {again}"), soft_wrap=True)
        self._bar.update(self._task, completed=self.scenarios, description=self._progress())
        if not self._shown.is_terminal and self.scenarios * LINES // self._count > self._lines_shown:
            self._lines_shown = self.scenarios * LINES // self._count
            self._shown.print(self._progress())

    def _progress(self) -> str:
        count = len(self.failed_seeds)
        failed = f"[{BAD}]{count} failed[/]" if count else "none failed"
        if not self.scenarios:
            return f"0/{self._count} scenarios"
        left_s = self.wall_s / self.scenarios * (self._count - self.scenarios)
        rate = self.rig_s / self.wall_s
        return f"{self.scenarios}/{self._count} scenarios, {failed}, {rate:.1f} rig s/s, {duration(left_s)} left"

    def summary(self) -> Text:
        """The last sentence."""
        scenarios = "1 scenario" if self.scenarios == 1 else f"{self.scenarios} scenarios"
        if self.scenarios < self._count:
            scenarios += f" of {self._count}"
        line = Text(f"{scenarios}, {duration(self.rig_s)} of rig time in {duration(self.wall_s)}: ")
        seeds = self.failed_seeds
        if not seeds and (not self.scenarios or self._request.until_s is not None):
            return line.append("no checks were performed", style=LOOK)
        if self.not_happened:
            count = len({entry["seed"] for entry in self.not_happened})
            late = f"{count} ended before all events had occurred, "
            line.append(late, style=LOOK)
        if not seeds:
            return line.append("all checks passed", style=GOOD)
        kinds = Counter(entry["invariant"] for entry in self.failed)
        named = ", ".join(f"{invariant} {count}" for invariant, count in kinds.most_common())
        line.append(f"{len(seeds)} failed ({named})", style=BAD)
        return line.append(f". To reduce the first failing scenario: {self._request.again(seeds[0])} --shrink")

    def answer(self) -> dict[str, Any]:
        """The object of `--json`."""
        return {
            "scenarios": self.scenarios,
            "worlds": self.scenarios,
            "checked": self._request.until_s is None,
            "judged": self._request.until_s is None,
            "failed": sorted(self.failed, key=lambda entry: (entry["seed"], entry["at_s"])),
            "not_happened": sorted(self.not_happened, key=lambda entry: entry["seed"]),
            "rig_hours": round(self.rig_s / 3600.0, 4),
            "wall_s": round(self.wall_s, 3),
            "digests": dict(sorted(self.digests.items())),
        }
