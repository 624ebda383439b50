"""Planted bugs looked for in random worlds: `python3 dev.py scenarios --planted [NAME...] [--seeds 0:200] [--shrink]`.

With `--made` each in the world that was made for it, which must fail with the bug and hold without.

For each bug the worlds are tried first in which the most happens of what happens in the world made for it, and points
have names where they have there, which their plans say. Then, for those not found, a block of worlds is run without a
bug, and which bugs they come by is noted: those that come by where a bug matters are tried with it, by seed; where a
line of the bug is reached by less than half of the worlds, only those that come by such a line. So on with the next
block.

Told are the first world tried in which an invariant does not hold (but holds without the bug), the same world again in
another process, and what happens in it, or in the smallest world in which it still does not hold. Worlds are run to the
end of their first session, in which everything happens.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass

import click
from planted_cases import CASES, PLANTED, checked_by_case, scenario_of, with_the_bug
from planted_cases import without as without_bugs
from planted_patching import in_force
from planted_reach import Mark, watched

from simulators.scenarios import scenario as scenarios
from simulators.scenarios.drawn_rig import STREAMED_MAPS
from simulators.scenarios.plan import FaultEvent, ScenarioPlan, drawn
from simulators.scenarios.request import seeds_of
from simulators.scenarios.runs import Ended, alone, begin_worker
from simulators.scenarios.shrink import shrunk

SESSION_S, REST_S = 120.0, 30.0
"""Longer than a drawn campaign of these worlds takes, and than a stop."""
LIKELY = 10
"""So many of the worlds are tried first in which what a bug needs is drawn."""
BLOCK = 40
"""So many worlds are run without a bug before the bugs are tried in them."""
NAMED_POINT = "[[point]]"
FEW = 0.5
"""A line that a smaller share of all worlds comes by says where it is worth looking."""


@dataclass(frozen=True)
class Unbugged:
    """A seed's world without any bug: what it comes by, and whether something does not hold in it anyway."""

    seed: int
    comes_by: frozenset[Mark]
    fails: bool


def first_session(plan: ScenarioPlan) -> Ended:
    """A world to the end of its first session."""
    scenarios.SESSION_S, scenarios.REST_S = SESSION_S, REST_S
    return alone(plan, most_sessions=1)


def unbugged(seed: int) -> Unbugged:
    """The drawn world of a seed as the program is."""
    with watched(PLANTED) as marks:
        ended = first_session(drawn(seed))
    return Unbugged(seed, frozenset(marks), bool(ended.failed))


def tried(name: str, seed: int) -> Ended:
    """The drawn world of a seed with a planted bug."""
    with in_force(PLANTED[name]):
        return first_session(drawn(seed))


def smallest(name: str, seed: int) -> str:
    """What must happen in the smallest world that fails as this one does."""
    plan = drawn(seed)
    with in_force(PLANTED[name]):
        least, _ = shrunk(plan, first_session(plan), lambda _: None, first_session)
    return " ".join(map(str, least.events)) or "nothing has to happen"


def worth_trying(name: str, without: Sequence[Unbugged]) -> list[int]:
    """Seeds of worlds in which a bug can make a difference, ascending."""
    seeds = [
        [scenario.seed for scenario in without if (name, number) in scenario.comes_by and not scenario.fails]
        for number in range(len(PLANTED[name]))
    ]
    few = [some for some in seeds if len(some) < FEW * len(without)]
    return sorted({seed for some in few or seeds for seed in some})


def streamed(bench: str) -> bool:
    """The controller of this bench file follows set-points."""
    return any(f'"{name}"' in bench for name in STREAMED_MAPS)


def likely(name: str, seeds: range) -> list[int]:
    """Seeds in whose worlds something is drawn that happens in the world made for a bug: the most of it first.

    Another variant of the same row comes after all that are the same.
    """
    case, drawn_too = CASES[name], list[tuple[int, int, bool, int]]()
    what = {FaultEvent.parse(text).what for text in case.events}
    for seed in seeds:
        plan = drawn(seed)
        given = {event.what for event in plan.events}
        rows = {text.partition(":")[0] for text in what} & {text.partition(":")[0] for text in given}
        fits = NAMED_POINT in plan.matrix or NAMED_POINT not in case.matrix
        fits = fits and (streamed(plan.bench) or not streamed(case.bench))
        if (rows or not what) and fits:
            drawn_too.append((-len(what & given), -len(rows), plan.held_up < case.held_up, seed))
    return [seed for *_, seed in sorted(drawn_too)[:LIKELY]]


def looked_for(name: str, seeds: Sequence[int], pool: Executor, jobs: int) -> tuple[int, Ended | None]:
    """How many of these worlds were tried with a bug, and the first in which something does not hold."""
    for start in range(0, len(seeds), jobs):
        block = seeds[start : start + jobs]
        for place, scenario in enumerate(pool.map(tried, [name] * len(block), block), start=start + 1):
            if scenario.failed:
                return place, scenario
    return len(seeds), None


def row(name: str, count: int, scenario: Ended, pool: Executor, *, shrinks: bool) -> str:
    """A line of the table: bug, seed, how many were tried, what does not hold, replay, what happens."""
    again = pool.submit(tried, name, scenario.seed).result()
    same = (again.digest, again.failed) == (scenario.digest, scenario.failed)
    broken = ", ".join(dict.fromkeys(invariant for invariant, _, _ in scenario.failed))
    happens = pool.submit(smallest, name, scenario.seed).result() if shrinks else " ".join(scenario.scheduled)
    return f"| {name} | {scenario.seed} | {count} | {broken} | {'the same' if same else 'ANOTHER WORLD'} | {happens} |"


def main() -> int:
    """A table of the bugs as they are found, and those that are not."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--seeds", default="0:200")
    parser.add_argument("--shrink", action="store_true")
    parser.add_argument("--made", action="store_true")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args()
    if unknown := set(given.names) - set(PLANTED):
        parser.error(f"{', '.join(sorted(unknown))}: there are {', '.join(PLANTED)}")
    begin_s = time.monotonic()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(given.jobs, mp_context=context, initializer=begin_worker) as pool:
        missed = made(given.names or list(CASES), pool) if given.made else drawn_scenarios(given, pool)
    click.echo(f"{missed} not found, {time.monotonic() - begin_s:.0f} s", err=True)
    return 5 if missed else 0


def drawn_scenarios(given: argparse.Namespace, pool: Executor) -> int:
    """Look for bugs in the worlds of the seeds; tell the table, return how many were not found."""
    seeds, tries = seeds_of(given.seeds), dict.fromkeys(given.names or PLANTED, 0)
    click.echo("| planted | first seed | tried | does not hold | replay | what happens |\n|---|---|---|---|---|---|")
    for name in list(tries):
        tries[name], ended = looked_for(name, likely(name, seeds), pool, given.jobs)
        if ended is not None and not pool.submit(unbugged, ended.seed).result().fails:
            click.echo(row(name, tries.pop(name), ended, pool, shrinks=given.shrink))
    for start in range(seeds.start, seeds.stop, BLOCK) if tries else ():
        without = list(pool.map(unbugged, range(start, min(start + BLOCK, seeds.stop))))
        for scenario in without:
            if scenario.fails:
                click.echo(f"seed {scenario.seed} is left out: something does not hold without any bug", err=True)
        for name in list(tries):
            count, ended = looked_for(name, worth_trying(name, without), pool, given.jobs)
            tries[name] += count
            if ended is not None:
                click.echo(row(name, tries.pop(name), ended, pool, shrinks=given.shrink))
        if not tries:
            break
    for name, count in tries.items():
        click.echo(f"| {name} | none | {count} | | | |")
    return len(tries)


def made(names: list[str], pool: Executor) -> int:
    """Run each bug in the world made for it; tell what is wrong, return with how many something is."""
    scenarios_of = {name: scenario_of(CASES[name]) for name in names}
    cases = list(dict.fromkeys(scenarios_of.values()))
    bugs, healthy = pool.map(with_the_bug, names), dict(zip(cases, pool.map(without_bugs, cases), strict=True))
    wrong = 0
    for name, (failed, _) in zip(names, bugs, strict=True):
        words = checked_by_case(name, failed, healthy[scenarios_of[name]])
        click.echo(f"{name}: {words or CASES[name].invariant}")
        wrong += bool(words)
    return wrong


if __name__ == "__main__":
    sys.exit(main())
