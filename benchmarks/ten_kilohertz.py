"""Load cell, LVDT and an auxiliary channel at 10 kHz each: samples lost on the way to the finished file.

    python benchmarks/ten_kilohertz.py              one point of 60 s
    python benchmarks/ten_kilohertz.py --seconds 600 --no-real-time

One point at speed 1 on the simulated rig, whose ports (`--drop-unread`) hold 4 KiB and drop and count what is not read.
Beside the recorder a second reader follows the ring at 25 Hz. Counted: what the ports dropped, what the sequence
numbers miss, what each reader of the ring missed, and the largest resident memory of every process.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import threading
from pathlib import Path

import h5py
from campaign_process import machine, run, sines

from rig.clock import utc_now
from rig.recording.journal.ring_reader import RingProblem, RingReader

FREQUENCY_Hz = 0.5


class Follower(threading.Thread):
    """A reader of the campaign's ring, 25 times a second, as the operator's page is one."""

    def __init__(self, out: Path) -> None:
        super().__init__(daemon=True)
        self.out = out
        self.read = self.lost = 0
        self.ended = threading.Event()

    def run(self) -> None:
        """Read until told to end."""
        ring = None
        while not self.ended.wait(0.04):
            try:
                ring = ring or _ring_of(self.out)
                if ring is not None:
                    self.read += len(ring.read())
                    self.lost = ring.lost
            except (RingProblem, OSError):
                ring = None


def _ring_of(out: Path) -> RingReader | None:
    """The ring of the campaign in `out`; None before there is one."""
    campaigns = list(out.glob("*/campaign.json"))
    paths = [path for found in campaigns for path in Path("/dev/shm").glob(f"*{found.parent.name}.ring")]
    return RingReader(paths[0]) if paths else None


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--seconds", type=float, default=60.0)
    arguments.add_argument("--identify", action="store_true", help="identify at the end too")
    arguments.add_argument("--no-real-time", action="store_true",
                           help="wider time limits, for a machine whose host takes it away for more than 20 ms")
    given = arguments.parse_args()
    options = ["--rate", "10000", "--auxiliary", "1", "--drop-unread"]
    options += [] if given.no_real_time else ["--real-time"]
    with tempfile.TemporaryDirectory() as folder:
        follower = Follower(Path(folder) / "out")
        matrix = Path(folder) / "matrix.toml"
        cycles = max(3, round(given.seconds * FREQUENCY_Hz) - 2)
        text = sines([f"{FREQUENCY_Hz} Hz"], ["0.5 A"], "20 mm", cycles, identify=given.identify)
        matrix.write_text(text, encoding="utf-8")
        follower.start()
        answer = run(matrix, Path(folder) / "out", *options)
        follower.ended.set()
        follower.join()
        if answer.exit_code not in {0, 5} or not answer.json.get("points"):
            print(answer.json)
            return 1
        point = answer.json["points"][0]
        with h5py.File(Path(answer.json["campaign"]) / "truth.h5") as truth:
            dropped = {key: int(value) for key, value in truth["entry/quality"].attrs.items() if "dropped" in key}
        with h5py.File(point["file"]) as file:
            samples = {name: len(file[f"entry/raw/{name}/value"]) for name in ("force", "displacement", "auxiliary_1")}
        size_MB = Path(point["file"]).stat().st_size / 1e6
    print(f"{utc_now().date()}, {machine()}, speed 1, one point of {(cycles + 2) / FREQUENCY_Hz:g} s, 3 x 10 kHz")
    verdict, lost = f"{point['verdict']} {point['reasons']}", point["lost_samples"]
    print(f"verdict {verdict}; lost by sequence {lost}; file {size_MB:.0f} MB")
    print(f"samples {samples}; dropped in the ports {dropped}")
    print(f"25 Hz reader: {follower.read} records, {follower.lost} lost")
    print("largest resident memory: " + ", ".join(f"{k} {v / 1e6:.0f} MB" for k, v in sorted(answer.memory.items())))
    return 0 if point["lost_samples"] == 0 and not any(dropped.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
