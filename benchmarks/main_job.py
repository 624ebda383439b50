"""The main job's speed and memory: Table 1 at speed 50, overhead at speed 1, resident memory, `rig --help`.

    python benchmarks/main_job.py             all of it, about a minute and a half
    python benchmarks/main_job.py --quick     without the run at speed 1

Limits: Table 1 with identification and report under 30 s on 2 cores; at speed 1 at most 5 % longer than motion, ramps,
settling and rest; station under 64 MB, application with its processes under 400 MB; `rig --help` under 0.2 s of CPU.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from datetime import datetime
from pathlib import Path
from typing import Any

from campaign_process import Answer, machine, run, sines

from rig.clock import utc_now
from rig.recording.journal.campaign_log import read_log

TABLE_1 = Path(__file__).resolve().parent.parent / "examples" / "table1.toml"
SPEED = 50.0
SETTLING_S = 0.5
"""What `rig plan` allows a point beside its motion: current settles, rod back at the centre."""
REAL_TIME_MATRIX = sines(["1.5 Hz", "2 Hz"], ["0 A", "1 A", "2 A"], "50 mm", 10, identify=False)
APPLICATION = ("application", "finaliser", "analyst")
MB = 1e6


def seconds(lines: list[dict[str, Any]], event: str, **fields: str) -> list[float]:
    """Times of the journal's lines of one event (s, UTC)."""
    return [
        datetime.fromisoformat(line["utc"]).timestamp() for line in lines
        if line["event"] == event and all(line.get(key) == value for key, value in fields.items())
    ]  # fmt: skip


def breakdown(folder: Path, began_s: float, ended_s: float) -> dict[str, float]:
    """Wall seconds of each part of a run, from its journal."""
    lines = list(read_log(folder))
    connecting = seconds(lines, "phase", phase="connecting")[0]
    first = seconds(lines, "point")[0]
    last = seconds(lines, "phase", phase="coming to rest")[0]
    result = seconds(lines, "result")[0]
    return {
        "start of the processes": connecting - began_s,
        "connecting, proofs, hydraulics": first - connecting,
        "points": last - first,
        "end of the campaign, last verdicts": result - last,
        "identification, report, truth file": ended_s - result,
    }


def table_1(out: Path) -> tuple[Answer, float]:
    """Table 1 at speed 50, with its breakdown; returns the answer and the wall seconds."""
    began_s, began_cpu_s = utc_now().timestamp(), children_cpu_s()
    answer = run(TABLE_1, out, speed=SPEED)
    ended_s = utc_now().timestamp()
    print(f"Table 1 at speed {SPEED:g}: {ended_s - began_s:.1f} s (limit 30 s), {answer.json['valid']} of "
          f"{answer.json['total']} points valid, exit code {answer.exit_code}")
    if answer.exit_code != 0:
        raise SystemExit(f"stopped by {answer.json['stopped_by']}: {answer.json.get('error')}")
    for part, took_s in breakdown(Path(answer.json["campaign"]), began_s, ended_s).items():
        print(f"  {took_s:6.2f} s  {part}")
    print(f"  {answer.json['motion_s'] / SPEED:6.2f} s  of the points is motion at that speed")
    print(f"  {children_cpu_s() - began_cpu_s:6.2f} s  of CPU over all processes")
    return answer, ended_s - began_s


def real_time(out: Path) -> float:
    """A shorter matrix at speed 1; returns how much longer it takes than motion, ramps and settling (%)."""
    matrix = out / "real_time.toml"
    matrix.write_text(REAL_TIME_MATRIX, encoding="utf-8")
    answer = run(matrix, out)
    wall_s, motion_s, points = answer.json["wall_s"], answer.json["motion_s"], answer.json["total"]
    over_motion = 100.0 * (wall_s / motion_s - 1.0)
    over_all = 100.0 * (wall_s / (motion_s + SETTLING_S * points) - 1.0)
    print(f"{points} points at speed 1: {wall_s:.2f} s for {motion_s:.2f} s of motion and ramps: {over_motion:+.2f} %, "
          f"{over_all:+.2f} % with {SETTLING_S:g} s of settling a point (limit 5 %); {answer.json['valid']} valid")
    return over_all


def children_cpu_s() -> float:
    """CPU seconds of all processes that this one has started and waited for, and theirs."""
    spent = os.times()
    return spent.children_user + spent.children_system


def help_cpu_s() -> float:
    """CPU seconds of `rig --help`, the median of nine."""
    took = []
    for _ in range(9):
        before_s = children_cpu_s()
        subprocess.run([sys.executable, "-m", "rig.cli.main", "--help"], capture_output=True, check=True)
        took.append(children_cpu_s() - before_s)
    return statistics.median(took)


def main() -> int:
    """Measure and judge; returns 1 when a limit is exceeded."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="leave the run at speed 1 out")
    quick = parser.parse_args().quick
    when: datetime = utc_now()
    print(f"{when:%Y-%m-%d}, {machine()}, load {os.getloadavg()[0]:.1f} at the start")
    with tempfile.TemporaryDirectory() as folder:
        answer, wall_s = table_1(Path(folder))
        overhead_percent = 0.0 if quick else real_time(Path(folder))
    station = answer.memory["station"] / MB
    application = sum(answer.memory.get(role, 0) for role in APPLICATION) / MB
    each = ", ".join(f"{role} {answer.memory[role] / MB:.0f}" for role in sorted(answer.memory))
    print(f"resident memory, largest seen (MB): {each}; station {station:.0f} (limit 64), application with finaliser "
          f"and analyst {application:.0f} (limit 400)")
    help_s = help_cpu_s()
    print(f"rig --help: {help_s:.3f} s of CPU (limit 0.2 s)")
    good = wall_s < 30.0 and overhead_percent <= 5.0 and station < 64.0 and application < 400.0 and help_s < 0.2
    print("all within the limits" if good else "NOT within the limits")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
