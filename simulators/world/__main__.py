"""`python -m simulators.world`: worlds of a range of seeds, in as many processes as there are cores."""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rig.errors import EXIT_DONE, EXIT_NOT_ALL_VALID, EXIT_USAGE, FileProblem, RigError
from rig.text_file import read_text
from simulators.world.runs import memory, one, plan_of
from simulators.world.stage import load_everything

if TYPE_CHECKING:
    from collections.abc import Callable

    from simulators.world.world import World

LARGEST_MATRIX = 1 << 20
WORLDS_A_WORKER = 100
"""A worker begins anew after so many: what killed processes held is given back with it."""


def seeds_of(text: str) -> range:
    """`A:B` (A up to B-1), or one seed.

    Raises:
        FileProblem: not such a range.
    """
    first, colon, last = text.partition(":")
    try:
        seeds = range(int(first), int(last) if colon else int(first) + 1)
    except ValueError:
        seeds = range(0)
    if not seeds or seeds.start < 0:
        raise FileProblem("--seeds", [f"{text!r}: expected FIRST:END with 0 <= FIRST < END, as 0:1000, or one seed"])
    return seeds


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.option("--seeds", default="0:20", show_default=True, metavar="FIRST:END", help="Which worlds.")
@click.option("--matrix", type=click.Path(path_type=Path), help="Your own matrix in place of a drawn one.")
@click.option("--happening", multiple=True, metavar="WHAT@T[+D]",
              help="What happens, in place of what is drawn (repeatable): a row of the fault matrix, or "
                   "application-killed, power-cut, disk-full ...")
@click.option("--until", type=click.FloatRange(0.0), metavar="S", help="End each world after so many virtual seconds.")
@click.option("--trace", type=click.Path(path_type=Path), help="Write every step of one world to this file.")
@click.option("--shrink", is_flag=True, help="Look for the smallest world that still fails.")
@click.option("--jobs", type=click.IntRange(1), default=os.cpu_count() or 1, show_default=True, help="Processes.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON on standard output.")
def main(seeds: str, as_json: bool, **asked: Any) -> None:  # noqa: ANN401 (click hands options over by name)
    """Run campaigns in simulated worlds drawn from seeds, and check what must hold in each.

    The same seed is the same world, step by step. Exit code 5 when something did not hold, 2 when nothing could begin.
    """
    try:
        wanted = seeds_of(seeds)
        asked["matrix"] = None if asked["matrix"] is None else read_text(asked["matrix"], LARGEST_MATRIX)
        _check(wanted[0], asked)
        if asked["trace"] is not None:
            _trace(wanted[0], asked)
            return
        answer = _run(wanted, asked)
    except RigError as error:
        click.echo(str(error), err=True)
        if as_json:
            click.echo(json.dumps({"error": str(error)}))
        sys.exit(EXIT_USAGE)
    if as_json:
        click.echo(json.dumps(answer))
    sys.exit(EXIT_NOT_ALL_VALID if answer["failed"] else EXIT_DONE)


def _check(seed: int, asked: dict[str, Any]) -> None:
    """Refuse what no world can begin with.

    Raises:
        FileProblem: the matrix or a happening cannot be used.
        RigError: the matrix does not fit the simulated rig.
    """
    from rig.bench.model import Bench
    from rig.matrix.model import load_matrix
    from rig.matrix.plan import plan as planned
    from simulators.bench import Addresses, bench_text
    from simulators.options import RigOptions

    plan = plan_of(seed, asked)
    with tempfile.TemporaryDirectory(prefix="world-") as name:
        matrix, bench = Path(name) / "matrix.toml", Path(name) / "bench.toml"
        matrix.write_text(plan.matrix, encoding="utf-8")
        addresses = Addresses("modbus-tcp://127.0.0.1:1", 2, "socket://127.0.0.1:3", "socket://127.0.0.1:4", ())
        bench.write_text(bench_text(RigOptions(), addresses, 1.0, relaxed=False), encoding="utf-8")
        judged = planned(load_matrix(matrix), Bench.load(bench)).judged
    lines = [f"{item.point.id}: {'; '.join(item.reasons)}" for item in judged if not item.feasible]
    if lines:
        raise RigError("the matrix does not fit the simulated rig:\n" + "\n".join(lines))


def _trace(seed: int, asked: dict[str, Any]) -> None:
    """One world, every task that runs as a line: virtual time (s), process, thread."""
    from simulators.world.invariants import judged
    from simulators.world.world import World

    load_everything()
    with tempfile.TemporaryDirectory(prefix="world-", dir=memory()) as name, asked["trace"].open("w") as file:
        told = Told()
        world = told.world = World(plan_of(seed, asked), Path(name), told)
        world.kernel.trace = lambda task: print(f"{told.time_s:.9f} {task.process!r} {task.name}", file=file)
        world.run(asked["until"])
        for invariant, words, at_s in judged(world) if asked["until"] is None else ():
            click.echo(f"{at_s:9.3f} s  {invariant}: {words}", err=True)


class Told:
    """Shows a world's campaign on the standard error, with its virtual time."""

    def __init__(self) -> None:
        self.world: World | None = None

    @property
    def time_s(self) -> float:
        """Seconds since the world began."""
        return 0.0 if self.world is None else self.world.kernel.time_s

    def __getattr__(self, name: str) -> Callable[..., None]:
        if name not in {"phase", "message"}:
            return lambda *_: None
        return lambda *words: click.echo(f"{self.time_s:9.3f} s  {' '.join(map(str, words))}", err=True)


def _run(seeds: range, asked: dict[str, Any]) -> dict[str, Any]:
    """Run them all; progress on the standard error."""
    began_s, ended = time.perf_counter(), []
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for the workers: one world is one thread
    context = multiprocessing.get_context("spawn")
    jobs = min(asked["jobs"], len(seeds))
    with ProcessPoolExecutor(
        jobs, mp_context=context, initializer=load_everything, max_tasks_per_child=WORLDS_A_WORKER
    ) as pool:
        for future in as_completed([pool.submit(one, seed, asked) for seed in seeds]):
            ended.append(future.result())
            _tell(ended, len(seeds), time.perf_counter() - began_s, asked)
    if sys.stderr.isatty():
        click.echo("", err=True)
    failed = sorted((entry for world in ended for entry in world["failed"]), key=lambda entry: entry["seed"])
    if asked["shrink"]:
        for seed in sorted({entry["seed"] for entry in failed}):
            _shrink(seed, asked)
    rig_hours = sum(world["rig_s"] for world in ended) / 3600.0
    return {
        "worlds": len(ended),
        "failed": failed,
        "rig_hours": round(rig_hours, 4),
        "wall_s": round(time.perf_counter() - began_s, 3),
        "digests": {world["seed"]: world["digest"] for world in ended},
    }


def _tell(ended: list[dict[str, Any]], count: int, wall_s: float, asked: dict[str, Any]) -> None:
    """Failures as they come, and how far it is."""
    newest = ended[-1]
    again = "".join(f" --happening {text}" for text in asked["happening"])
    for entry in newest["failed"]:
        click.echo(
            f"\nseed {entry['seed']} at {entry['at_s']:.3f} s: {entry['invariant']}: {entry['words'][:1000]}\n"
            f"  happened: {' '.join(newest['happenings']) or 'nothing'}\n"
            f"  again: python3 dev.py worlds --seeds {entry['seed']}{again}",
            err=True,
        )
    rate, failed = sum(world["rig_s"] for world in ended) / wall_s, sum(bool(world["failed"]) for world in ended)
    left_s = wall_s / len(ended) * (count - len(ended))
    line = f"{len(ended)}/{count} worlds, {failed} failed, {rate:.1f} rig s/s, {left_s:.0f} s left"
    if sys.stderr.isatty():
        click.echo(f"\r{line}   ", err=True, nl=False)
    elif len(ended) == count or len(ended) % max(1, count // 20) == 0:
        click.echo(line, err=True)


def _shrink(seed: int, asked: dict[str, Any]) -> None:
    """Tell the smallest world that still fails."""
    from simulators.world.runs import live
    from simulators.world.shrink import shrunk

    load_everything()
    plan = plan_of(seed, asked)
    with tempfile.TemporaryDirectory(prefix="world-") as name:
        _, ended = live(plan, Path(name))
    smallest, _ = shrunk(plan, ended, lambda words: click.echo(f"  seed {seed} {words}", err=True))
    told = " ".join(f"--happening {happening}" for happening in smallest.happenings)
    click.echo(f"seed {seed}, smallest: {told or 'nothing has to happen'}\n{smallest.matrix}", err=True)


if __name__ == "__main__":
    main()
