"""Takt of a production line on the simulated rig: `rig line` at real speed, a person who changes the specimens.

    python benchmarks/line_takt.py --specimens 5 [--change 20] [--phases]

For each specimen: takt (from the entry of the serial number to the verdict), motion of its points, and the rest, which
is goal 3 s; the part of the rest on the rig's own clock (connection, checks, shutdown), which does not depend on the
load of the computer; and the processor time of all processes from entry to verdict, the simulated rig included.
With --phases, the durations on the rig's clock are printed.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Run the line and print its takt."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--specimens", type=int, default=5)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--change", type=float, default=20.0, help="time to change a specimen (s)")
    parser.add_argument("--matrix", type=Path, default=ROOT / "examples" / "line.toml")
    parser.add_argument("--phases", action="store_true")
    given = parser.parse_args()
    used: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        line = subprocess.Popen(
            [sys.executable, "-m", "rig.cli.main", "line", str(given.matrix), "--simulate", "--speed",
             str(given.speed), "--out", folder, "--json"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=ROOT,
        )  # fmt: skip
        assert line.stdin is not None
        for number in range(given.specimens):
            time.sleep(given.change)
            before = processor_s(line.pid)
            line.stdin.write(f"MR-{200 + number}\n")
            line.stdin.flush()
            while len(list(Path(folder).glob("*/acceptance.json"))) <= number and line.poll() is None:
                time.sleep(0.05)
            used.append(processor_s(line.pid) - before)
        answer = json.loads(line.communicate()[0])
        for one, used_s in zip(answer["specimens"], used, strict=True):
            motion_s = one["motion_s"] / given.speed
            durations = phases(Path(one["campaign"])) if one["campaign"] else {}
            print(
                f"{one['serial_number']} {one['verdict']:>10}  takt {one['takt_s']:5.1f} s, motion {motion_s:4.1f} s, "
                f"rest {one['takt_s'] - motion_s:4.1f} s; rest on the rig's clock "
                f"{sum(durations.values()) - motion_s:4.1f} s; processor time {used_s:4.1f} s"
            )
            for name, duration_s in durations.items() if given.phases else ():
                print(f"    {duration_s:6.2f} s  {name}")
    print(f"mean takt {answer['takt_mean_s']:.1f} s; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


def processor_s(root: int) -> float:
    """Processor time of a process and its descendants, ended ones included (s)."""
    stats: dict[int, tuple[int, int]] = {}
    for place in Path("/proc").iterdir():
        if place.name.isdigit():
            with contextlib.suppress(OSError):
                fields = (place / "stat").read_text().rpartition(")")[2].split()
                stats[int(place.name)] = int(fields[1]), sum(map(int, fields[11:15]))
    ticks = 0
    for process, (parent, used) in stats.items():
        while process != root and parent in stats:
            process, parent = parent, stats[parent][0]
        ticks += used if process == root else 0
    return ticks / TICKS_A_SECOND


def phases(run: Path) -> dict[str, float]:
    """Duration of each phase of a campaign on the rig's clock (s): it waits while a simulated rig waits."""
    durations: dict[str, float] = {}
    began: tuple[str, int] | None = None
    for line in (run / "journal.jsonl").read_text().splitlines():
        event = json.loads(line)
        if event.get("event") == "phase":
            if began is not None:
                durations[began[0]] = durations.get(began[0], 0.0) + (event["host_ns"] - began[1]) * 1e-9
            began = event["phase"], event["host_ns"]
    return durations


if __name__ == "__main__":
    main()
