"""Takt of a production line on the simulated rig: `rig line` with a list of serial numbers, at real speed.

    python benchmarks/line_takt.py --specimens 5

For each specimen: takt (from the entry of the serial number to the verdict), motion of its points, and the rest, which
is goal 3 s. With --phases, the time between the events of each campaign's journal is printed.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from datetime import datetime
from pathlib import Path

ROOT = Path(__file__).parents[1]


def main() -> None:
    """Run the line and print its takt."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--specimens", type=int, default=5)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--matrix", type=Path, default=ROOT / "examples" / "line.toml")
    parser.add_argument("--phases", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        scans = "".join(f"MR-{200 + number}\n" for number in range(given.specimens))
        done = subprocess.run(
            [sys.executable, "-m", "rig.cli.main", "line", str(given.matrix), "--simulate", "--speed",
             str(given.speed), "--out", folder, "--json"],
            input=scans, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False, cwd=ROOT,
        )  # fmt: skip
        answer = json.loads(done.stdout)
        for one in answer["specimens"]:
            rest_s = one["takt_s"] - one["motion_s"] / given.speed
            print(f"{one['serial_number']} {one['verdict']:>10}  takt {one['takt_s']:5.1f} s, motion "
                  f"{one['motion_s'] / given.speed:4.1f} s, rest {rest_s:4.1f} s")
            if given.phases and one["campaign"]:
                show_phases(Path(one["campaign"]))
    print(f"mean takt {answer['takt_mean_s']:.1f} s; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


def show_phases(run: Path) -> None:
    """The events of a campaign's journal, with the time since the event before."""
    before = None
    for line in (run / "journal.jsonl").read_text().splitlines():
        event = json.loads(line)
        stamp = event.get("utc")
        now = None if stamp is None else datetime.fromisoformat(stamp)
        apart = "" if now is None or before is None else f"{(now - before).total_seconds():6.2f}"
        before = now or before
        if event.get("event") != "station" or event.get("what") == "ready":
            what = event.get("text") or event.get("what") or event.get("id") or ""
            print(f"    {apart:>6}  {event.get('event')} {what}")


if __name__ == "__main__":
    main()
