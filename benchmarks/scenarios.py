"""How fast worlds are, how many bad days fit into a time, and whether a seed is always the same world.

    python benchmarks/scenarios.py speed [--seeds 0:12]
    python benchmarks/scenarios.py campaigns [--minutes 15] [--first 0] [--jobs 2]
    python benchmarks/scenarios.py same [--seeds 0:20] [--runs 20] [--jobs 2]

Each prints the line that `docs/benchmarks.md` quotes: date, machine, load. `speed` counts rig seconds for each second
of processor time, so that what else the machine does counts less (it does count: shared caches, a shared core), and for
each second of the wall. `same` runs every seed in processes of their own, under other hashes of Python's, in folders of
other names, and compares journal, files and truth, all in one number. Another Python is tried by running
`same --runs 1 --json` with each and comparing `verdicts`: exit codes, what did not hold, and the events by name.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from campaign_process import machine

from simulators.scenarios.request import ScenarioRequest, seeds_of
from simulators.scenarios.runs import Ended, begin_worker, every, live, memory

CAMPAIGN_S = 8.0
"""A campaign with less motion than that does not count."""
WORKER = "one-after-the-other"


def machine_text() -> str:
    """Date, machine and load in short."""
    load = " ".join(f"{value:.1f}" for value in os.getloadavg())
    python = f"Python {platform.python_version()}"
    return f"{datetime.now(UTC):%Y-%m-%d}, {machine()}, {python}, load {load}"


def run(seed: int, root: Path) -> Ended:
    """One world of a seed in a folder of `root`."""
    with tempfile.TemporaryDirectory(prefix="world-", dir=root) as name:
        return live(ScenarioRequest().plan(seed), Path(name))[1]


def one_after_the_other(seeds: range) -> list[Ended]:
    """Worlds in this process; a first one, which loads what is compiled, is not among them."""
    begin_worker()
    root = Path(memory() or tempfile.gettempdir())
    run(seeds[0], root)
    return [run(seed, root) for seed in seeds]


def speed(arguments: argparse.Namespace) -> dict[str, Any]:
    """Rig seconds for each second of one core."""
    scenarios = one_after_the_other(seeds_of(arguments.seeds))
    rig_s, cpu_s, wall_s = (sum(getattr(one, name) for one in scenarios) for name in ("rig_s", "cpu_s", "wall_s"))
    ratios = sorted(one.rig_s / one.cpu_s for one in scenarios)
    return {
        "worlds": len(scenarios), "rig_s": round(rig_s, 1), "rig_s_per_cpu_s": round(rig_s / cpu_s, 2),
        "slowest": round(ratios[0], 2), "fastest": round(ratios[-1], 2), "rig_s_per_wall_s": round(rig_s / wall_s, 2),
    }  # fmt: skip


def campaigns(arguments: argparse.Namespace) -> dict[str, Any]:
    """Random campaigns with enough motion, in a given time."""
    end_s, scenarios = time.perf_counter() + 60.0 * arguments.minutes, []
    seeds = range(arguments.first, arguments.first + 1_000_000)
    for ran in every(seeds, ScenarioRequest(), arguments.jobs):
        scenarios.append(ran)
        if time.perf_counter() > end_s:
            break
    moving = [ran for ran in scenarios if ran.moved_s >= CAMPAIGN_S]
    disturbed = [ran for ran in moving if ran.scheduled]
    return {
        "minutes": arguments.minutes, "jobs": arguments.jobs, "worlds": len(scenarios), "campaigns": len(disturbed),
        "undisturbed": len(moving) - len(disturbed),
        "rig_hours": round(sum(ran.rig_s for ran in scenarios) / 3600.0, 2),
        "killed_or_resumed": sum(len(ran.sessions) > 1 for ran in disturbed),
        "failed": {ran.seed: [entry[0] for entry in ran.failed] for ran in scenarios if ran.failed},
    }  # fmt: skip


def same(arguments: argparse.Namespace) -> dict[str, Any]:
    """Whether every run of a seed is the same world."""
    numbers, seen = range(arguments.runs), defaultdict(set)
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for scenarios in pool.map(lambda number: _elsewhere(arguments.seeds, number), numbers):
            for one in scenarios:
                verdict = json.dumps([one["sessions"], one["failed"], one["events"]])
                seen[one["seed"]].add((one["digest"], verdict))
    differing = sorted(seed for seed, outcomes in seen.items() if len(outcomes) > 1)
    return {
        "seeds": len(seen), "runs": arguments.runs, "differing": differing,
        "digests": {seed: sorted(digest for digest, _ in outcomes) for seed, outcomes in seen.items()},
        "verdicts": {seed: sorted({verdict for _, verdict in outcomes}) for seed, outcomes in seen.items()},
    }  # fmt: skip


def _elsewhere(seeds: str, number: int) -> list[dict[str, Any]]:
    """The worlds of these seeds in a process of its own, in a folder of another name."""
    with tempfile.TemporaryDirectory(prefix="x" * (1 + number % 90)) as folder:
        done = subprocess.run(
            [sys.executable, __file__, WORKER, "--seeds", seeds, "--folder", folder], check=True, capture_output=True,
            text=True, env={**os.environ, "PYTHONHASHSEED": str(number), "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
    return [json.loads(line) for line in done.stdout.splitlines()]


def main() -> None:
    """What was asked for, as a line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("speed", "campaigns", "same", WORKER))
    parser.add_argument("--seeds")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--minutes", type=float, default=15.0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--json", action="store_true", help="only the numbers")
    arguments = parser.parse_args()
    arguments.seeds = arguments.seeds or ("0:20" if arguments.what == "same" else "0:12")
    if arguments.what == WORKER:
        begin_worker()
        for seed in seeds_of(arguments.seeds):
            print(json.dumps(asdict(run(seed, arguments.folder))), flush=True)
        return
    before = machine_text()
    answer = {"speed": speed, "campaigns": campaigns, "same": same}[arguments.what](arguments)
    if not arguments.json:
        print(f"{arguments.what}: {before}")
        answer = {key: value for key, value in answer.items() if key not in {"digests", "verdicts"}}
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
