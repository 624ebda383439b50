"""Studies on two Dask workers against one, on this computer.

`python benchmarks/two_workers.py` starts two schedulers, one with one worker process and one with two, and runs the
same searches on both, alternating (1, 2, 2, 1, ...). It prints for each pair the ratio of the wall times, and two
numbers that do not depend on what else runs on the computer: `by_cpu`, the processor time of one worker over that of
the busier one of two, and `busy`, the share of the time in which both workers had a search. `--searches N --pairs N`.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from rig.errors import RigError
from rig.jobs.cluster import Cluster, cluster
from rig.jobs.workers import Job
from rig.study.search_cell import SearchCell, all_cells, searches
from rig.study.study_file import load_study
from rig.study.workbench import Workbench

STUDY = """
format = 1
name = "two workers"
seed = 1
[data]
simulate = "table1"
noise = "5 N"
[comparison]
methods = ["c_foa", "pso"]
populations = [50]
budgets = [{budget}]
repeats = {repeats}
"""


@dataclass(frozen=True)
class Timed:
    """Wall time of a study, processor time of each worker, share of the time in which all had a search."""

    wall_s: float
    cpu_s: tuple[float, ...]
    busy: float
    values: tuple[float, ...]


@contextmanager
def started(folder: Path, workers: int) -> Iterator[str]:
    """A scheduler with so many worker processes of one thread; its address."""
    file = folder / f"{workers}.json"
    place = ("--scheduler-file", str(file))
    calls = [("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", *place)]
    calls += [
        ("dask_worker", *place, "--nworkers", "1", "--nthreads", "1", "--no-nanny", "--no-dashboard",
         "--local-directory", str(folder / f"{workers}-{number}"))
        for number in range(workers)
    ]  # fmt: skip
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with ExitStack() as ends:
        for name, *arguments in calls:
            process = subprocess.Popen([sys.executable, "-m", f"distributed.cli.{name}", *arguments], **quiet)
            ends.callback(process.wait)
            ends.callback(process.terminate)
        yield _address(file, workers)


def _address(file: Path, count: int) -> str:
    until_s = time.monotonic() + 120.0
    while time.monotonic() < until_s:
        try:
            address = json.loads(file.read_text())["address"]
            with cluster(address) as workers:
                if workers.count == count:
                    return str(address)
        except (FileNotFoundError, json.JSONDecodeError, RigError):  # not up yet
            pass
        time.sleep(0.2)
    raise TimeoutError("the scheduler and its workers did not start within 120 s")


def search(bench: Workbench, cell: SearchCell) -> tuple[int, float, float, float]:
    """In a worker: process, start and end of a search on the clock of this computer, and the value found."""
    began_s = time.monotonic()
    value = float(bench.run(cell)["value"])
    return os.getpid(), began_s, time.monotonic(), value


def timed(workers: Cluster, bench: Workbench, cells: list[SearchCell]) -> Timed:
    """Run all searches."""
    before = workers.on_each(time.process_time)
    began_s = time.monotonic()
    shared = workers.share(bench)
    rows = workers.in_order(Job(cell.key, search, (shared, cell)) for cell in cells)
    wall_s = time.monotonic() - began_s
    after = workers.on_each(time.process_time)
    spent = {process: 0.0 for process, *_ in rows}
    for process, start_s, end_s, _ in rows:
        spent[process] += end_s - start_s
    busy = sum(spent.values()) / (workers.count * (max(row[2] for row in rows) - min(row[1] for row in rows)))
    return Timed(wall_s, tuple(after[one] - before[one] for one in before), busy, tuple(row[3] for row in rows))


def main() -> None:
    """Print the numbers as JSON, one line a pair and the medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--searches", type=int, default=16)
    parser.add_argument("--budget", type=int, default=4000)
    parser.add_argument("--pairs", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, ExitStack() as ends:
        folder = Path(name)
        file = folder / "study.toml"
        file.write_text(STUDY.format(budget=options.budget, repeats=max(2, options.searches // 2)))
        study = load_study(file)
        bench, cells = Workbench(study), searches(all_cells(study), ())
        one, two = (
            ends.enter_context(cluster(ends.enter_context(started(folder, count)))) for count in (1, 2)
        )
        for workers in (one, two):
            timed(workers, bench, cells[: 4 * workers.count])  # compiled models are loaded
        pairs = []
        for number in range(options.pairs):
            order = (one, two) if number % 2 == 0 else (two, one)
            runs = {workers.count: timed(workers, bench, cells) for workers in order}
            if runs[1].values != runs[2].values:
                raise SystemExit("the values differ")
            pairs.append({
                "wall": runs[1].wall_s / runs[2].wall_s, "by_cpu": runs[1].cpu_s[0] / max(runs[2].cpu_s),
                "busy": runs[2].busy, "wall_s": [runs[1].wall_s, runs[2].wall_s],
                "cpu_s": [*runs[1].cpu_s, *runs[2].cpu_s], "load": os.getloadavg()[0],
            })  # fmt: skip
            print(json.dumps(pairs[-1]), flush=True)
        print(json.dumps({key: statistics.median(pair[key] for pair in pairs) for key in ("wall", "by_cpu", "busy")}))


if __name__ == "__main__":
    main()
