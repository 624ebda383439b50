"""Planted bugs looked for in random worlds: `python3 dev.py worlds --planted [NAME...] [--seeds 0:200]`.

For each bug the first seed in whose drawn world an invariant does not hold, the same world again in another process,
and the smallest world in which it still does not hold.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path

import click
from planted_cases import PLANTED
from planted_patching import in_force

from simulators.world import world as worlds
from simulators.world.asked import Asked, seeds_of
from simulators.world.plan import drawn
from simulators.world.runs import Ended, begin_worker, live, memory, one
from simulators.world.shrink import shrunk

SESSION_S = 120.0
"""Longer than a drawn campaign of these worlds takes."""


def tried(name: str, seed: int) -> Ended:
    """The drawn world of a seed with a planted bug."""
    worlds.SESSION_S = SESSION_S
    with in_force(PLANTED[name]):
        return one(seed, Asked())


def smallest(name: str, seed: int) -> str:
    """What must happen in the smallest world that fails as this one does."""
    worlds.SESSION_S = SESSION_S
    plan = drawn(seed)
    with in_force(PLANTED[name]), tempfile.TemporaryDirectory(prefix="world-", dir=memory()) as folder:
        _, ended = live(plan, Path(folder))
        least, _ = shrunk(plan, ended, lambda _: None)
    return " ".join(map(str, least.happenings)) or "nothing has to happen"


def looked_for(name: str, seeds: range, pool: Executor, jobs: int) -> Iterator[str]:
    """The cells of a bug's row: seed, invariants, replay, shrunk to."""
    for start in range(seeds.start, seeds.stop, jobs):
        block = range(start, min(start + jobs, seeds.stop))
        for world in pool.map(tried, [name] * len(block), block):
            if world.failed:
                again = pool.submit(tried, name, world.seed).result()
                same = (again.digest, again.failed) == (world.digest, world.failed)
                broken = dict.fromkeys(invariant for invariant, _, _ in world.failed)
                yield from (str(world.seed), ", ".join(broken), "the same" if same else "ANOTHER WORLD")
                yield pool.submit(smallest, name, world.seed).result()
                return
    yield from (f"none of {len(seeds)}", "", "", "")


def main() -> int:
    """A table: bug, first failing seed, invariants, replay, shrunk to."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("names", nargs="*", choices=sorted(PLANTED), metavar="NAME")
    parser.add_argument("--seeds", default="0:200")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args()
    seeds, missed, begin_s = seeds_of(given.seeds), 0, time.monotonic()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    click.echo("| planted | first seed | does not hold | replay | shrunk to |\n|---|---|---|---|---|")
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(given.jobs, mp_context=context, initializer=begin_worker, max_tasks_per_child=50) as pool:
        for name in given.names or PLANTED:
            cells = list(looked_for(name, seeds, pool, given.jobs))
            missed += not cells[1]
            click.echo(f"| {name} | {' | '.join(cells)} |")
    click.echo(f"{len(given.names or PLANTED) - missed} found, {missed} not, {time.monotonic() - begin_s:.0f} s")
    return 5 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
