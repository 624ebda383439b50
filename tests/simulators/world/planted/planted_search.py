"""Planted bugs looked for in random worlds: `python3 dev.py worlds --planted [NAME...] [--seeds 0:200]`.

First every world is run without a bug, and which bugs it comes by is noted. Then, for each bug, the worlds that come by
where it matters are tried with it, by seed, those first that come by a line which few of them reach: the first in which
an invariant does not hold, the same world again in another process, and the smallest world in which it still does not
hold. Worlds are run to the end of their first session, in which everything happens.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass

import click
from planted_cases import PLANTED
from planted_patching import in_force
from planted_reach import Mark, watched

from simulators.world import world as worlds
from simulators.world.asked import seeds_of
from simulators.world.plan import WorldPlan, drawn
from simulators.world.runs import Ended, alone, begin_worker
from simulators.world.shrink import shrunk

SESSION_S, REST_S = 120.0, 30.0
"""Longer than a drawn campaign of these worlds takes, and than a stop."""
FEW = 0.5
"""A line that a smaller share of all worlds comes by says where it is worth looking first."""


@dataclass(frozen=True)
class Unbugged:
    """A seed's world without any bug: what it comes by, and whether something does not hold in it anyway."""

    seed: int
    comes_by: frozenset[Mark]
    fails: bool


def first_session(plan: WorldPlan) -> Ended:
    """A world to the end of its first session."""
    worlds.SESSION_S, worlds.REST_S = SESSION_S, REST_S
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
    return " ".join(map(str, least.happenings)) or "nothing has to happen"


def worth_trying(name: str, without: Sequence[Unbugged]) -> tuple[list[int], int]:
    """Seeds of worlds in which a bug can make a difference, in the order in which they are tried; how many first."""
    seeds = [
        [world.seed for world in without if (name, number) in world.comes_by and not world.fails]
        for number in range(len(PLANTED[name]))
    ]
    first = sorted({seed for some in seeds if len(some) < FEW * len(without) for seed in some})
    return [*first, *sorted({seed for some in seeds for seed in some} - set(first))], len(first)


def looked_for(name: str, seeds: Sequence[int], pool: Executor, jobs: int) -> Iterator[str]:
    """The cells of a bug's row: seed, how many were tried, invariants, replay, shrunk to."""
    for start in range(0, len(seeds), jobs):
        block = seeds[start : start + jobs]
        for place, world in enumerate(pool.map(tried, [name] * len(block), block), start=start + 1):
            if world.failed:
                again = pool.submit(tried, name, world.seed).result()
                same = (again.digest, again.failed) == (world.digest, world.failed)
                broken = dict.fromkeys(invariant for invariant, _, _ in world.failed)
                yield from (str(world.seed), str(place), ", ".join(broken), "the same" if same else "ANOTHER WORLD")
                yield pool.submit(smallest, name, world.seed).result()
                return
    yield from ("none", str(len(seeds)), "", "", "")


def main() -> int:
    """A table: bug, how many worlds come by it, the first of them that fails, invariants, replay, shrunk to."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("names", nargs="*", choices=sorted(PLANTED), metavar="NAME")
    parser.add_argument("--seeds", default="0:200")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args()
    seeds, missed, begin_s = seeds_of(given.seeds), 0, time.monotonic()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(given.jobs, mp_context=context, initializer=begin_worker, max_tasks_per_child=50) as pool:
        without = list(pool.map(unbugged, seeds))
        failing = [world.seed for world in without if world.fails]
        click.echo(f"{len(seeds)} worlds without a bug in {time.monotonic() - begin_s:.0f} s; left out: {failing}")
        click.echo("| planted | come by | first seed | tried | does not hold | replay | shrunk to |")
        click.echo("|---|---|---|---|---|---|---|")
        for name in given.names or PLANTED:
            worth, first = worth_trying(name, without)
            cells = list(looked_for(name, worth, pool, given.jobs))
            missed += not cells[2]
            click.echo(f"| {name} | {first or len(worth)} | {' | '.join(cells)} |")
    click.echo(f"{len(given.names or PLANTED) - missed} found, {missed} not, {time.monotonic() - begin_s:.0f} s")
    return 5 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
